"""The faces of a scene's shapes that may touch others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.faces import ROUNDING, Faces, areas, bounds, inner, joined

if TYPE_CHECKING:
    from clrender.flatten.assembly import Assembly
    from clrender.flatten.surface_arrays import FlatSurfaces
    from clrender.scene.values import Vector

__all__ = ["BOUNDARY", "LAMP", "OPAQUE", "SIMPLE", "Placed", "is_disk", "placed_faces", "shape_faces"]

OPAQUE: Final = 1
LAMP: Final = 2
BOUNDARY: Final = 3
SIMPLE: Final = 12
"""Most faces of a simple shape."""
_MANY: Final = 2**16
"""Of more triangles only those near lamps and boundaries are looked at."""
_CHOICES: Final = 32
"""Most boxes to choose these by."""

_MOST_PLACED: Final = 2**18
"""Most faces of instances that are looked at."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Placed:
    """Faces of instances in world space.

    Attributes
    ----------
    faces : Faces
        Shapes are numbered from the scene's shapes on, each in each instance.
    shape : (n,) int64
        The scene's shape that each of these is.
    """

    faces: Faces
    shape: NDArray[np.int64]


def placed_faces(surfaces: FlatSurfaces, assembly: Assembly, kinds: NDArray[np.int64]) -> Placed | None:
    """Faces of all instances, or, if they are many, of those with boundaries; None: still too many."""
    groups = [shape_faces(surfaces, _only(kinds, each)) for each in assembly.groups]
    times = np.bincount(assembly.group_of, minlength=len(groups))
    taken = [bool(len(faces.row)) for faces in groups]
    if sum(len(faces.row) * n for faces, n in zip(groups, times.tolist(), strict=True)) > _MOST_PLACED:
        taken = [bool((kinds[faces.shape] == BOUNDARY).any()) for faces in groups]
        if sum(len(f.row) * n for f, n, t in zip(groups, times.tolist(), taken, strict=True) if t) > _MOST_PLACED:
            return None
    total = len(kinds)
    every, shapes = [groups[0].at(np.zeros(0, np.intp))], []
    for instance in np.flatnonzero(np.array(taken, bool)[assembly.group_of]).tolist():
        group = int(assembly.group_of[instance])
        faces, own = groups[group], assembly.groups[group]
        every.append(_carried(faces, assembly.maps[instance], surfaces.origin, total - own.start))
        shapes.append(np.arange(own.start, own.stop))
        total += len(own)
    return Placed(joined(every), np.concatenate([np.zeros(0, np.int64), *shapes]))


def _only(kinds: NDArray[np.int64], shapes: range) -> NDArray[np.int64]:
    """The kinds of some shapes; others have none."""
    only = np.zeros_like(kinds)
    only[shapes.start : shapes.stop] = kinds[shapes.start : shapes.stop]
    return only


def _carried(faces: Faces, to_world: _Floats, origin: Vector, offset: int) -> Faces:
    """Faces under a map, with their fronts where they were."""
    x, y, z = faces.corners[..., 0], faces.corners[..., 1], faces.corners[..., 2]
    corners = np.stack(
        [(a * x + b * y) + c * z + (d - o) for (a, b, c, d), o in zip(to_world.tolist(), origin, strict=True)], axis=-1
    )
    determinant = float(inner(np.cross(to_world[0, :3], to_world[1, :3]), to_world[2, :3]))
    if determinant < 0.0:
        corners = corners[:, ::-1]
    # The map multiplies volumes by its determinant, and faces by the ratio of their areas: the rest is along the normal
    stretch = abs(determinant) * areas(faces.corners) / np.maximum(areas(corners), 1e-300)
    return Faces(corners, faces.row, faces.shape + offset, stretch)


def shape_faces(surfaces: FlatSurfaces, kinds: NDArray[np.int64], others: Faces | None = None) -> Faces:
    """The triangles of shapes that have a kind, as far as they may touch others, and squares around their disks.

    Parameters
    ----------
    surfaces : FlatSurfaces
    kinds : (S,) int64
        `OPAQUE`, `LAMP` or `BOUNDARY`; 0: left out.
    others : Faces, optional
        More that they may touch.
    """
    count = len(surfaces.triangles)
    rows = _near(surfaces, np.flatnonzero(kinds[surfaces.primitive_shape[:count]] > 0), kinds, others)
    disks = np.flatnonzero((kinds[surfaces.primitive_shape[count:]] > 0) & is_disk(surfaces)) + count
    squares = [_square(surfaces.analytic_shapes[row - count]) for row in disks.tolist()]
    corners = surfaces.vertices[surfaces.triangles[rows]].astype(np.float64).reshape(-1, 3, 3)
    row = np.concatenate([rows, np.repeat(disks, 2)])
    shape = surfaces.primitive_shape[row].astype(np.int64)
    return Faces(np.concatenate([corners, *squares]), row, shape, np.ones(len(row)))


def is_disk(surfaces: FlatSurfaces) -> NDArray[np.bool_]:
    return np.asarray(surfaces.analytic_shapes["normal"][:, 3] == 0.0)


def _near(
    surfaces: FlatSurfaces, rows: NDArray[np.int64], kinds: NDArray[np.int64], others: Faces | None
) -> NDArray[np.int64]:
    """Of many triangles only those that may touch a lamp, a boundary or others, and those of simple shapes."""
    if len(rows) <= _MANY:
        return rows
    shape = surfaces.primitive_shape[rows]
    boxes = _around(surfaces, rows[kinds[shape] > OPAQUE])
    if others is not None and len(others.row):
        more = others.boxes(4.0)
        around = np.concatenate([more[:, :3].min(axis=0), more[:, 3:].max(axis=0)])
        boxes = np.concatenate([boxes, around[None].astype(np.float32)])
    kept = (kinds[shape] > OPAQUE) | (surfaces.count[shape] <= SIMPLE)
    for at in range(0, len(rows), _MANY):
        these = _boxes_of(surfaces, rows[at : at + _MANY])
        for box in boxes:
            inside = (these[:, :3] <= box[3:]) & (box[:3] <= these[:, 3:])
            kept[at : at + _MANY] |= inside[:, 0] & inside[:, 1] & inside[:, 2]
    return rows[kept]


def _around(surfaces: FlatSurfaces, rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """At most `_CHOICES` boxes around triangles: the faces of simple shapes, and other shapes; or shapes; or all."""
    boxes = _boxes_of(surfaces, rows)
    shape = surfaces.primitive_shape[rows]
    begins = np.diff(shape.astype(np.int64), prepend=-1) != 0 if len(rows) else np.zeros(0, bool)
    for starts in (
        np.flatnonzero(begins | (surfaces.count[shape] <= SIMPLE)),
        np.flatnonzero(begins),
        np.zeros(1, int),
    ):
        if len(starts) <= _CHOICES and len(rows):
            low, high = np.minimum.reduceat(boxes[:, :3], starts), np.maximum.reduceat(boxes[:, 3:], starts)
            return np.concatenate([low, high], axis=1)
    return boxes


def _boxes_of(surfaces: FlatSurfaces, rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """(n, 6) bounding boxes of triangles, enlarged for rounding."""
    return bounds(surfaces.vertices[surfaces.triangles[rows]].reshape(-1, 3, 3), 16.0 * ROUNDING)


def _square(row: np.void) -> _Floats:
    """(2, 3, 3) the square around a disk."""
    center, radius = row["center_radius"][:3].astype(np.float64), float(row["center_radius"][3])
    n = row["normal"][:3].astype(np.float64)
    aside = np.zeros(3)
    aside[int(np.abs(n).argmin())] = 1.0
    u = np.cross(n, aside)
    u = u / np.sqrt(inner(u, u)) * radius
    v = np.cross(n, u)
    a, b, c, d = center - u - v, center + u - v, center + u + v, center - u + v
    return np.stack([np.stack([a, b, c]), np.stack([a, c, d])])
