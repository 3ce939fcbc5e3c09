"""The faces of a scene's shapes that may touch others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.flatten.faces import ROUNDING, Faces, areas, bounds, inner, joined

if TYPE_CHECKING:
    from clrender.flatten.assembly import Assembly
    from clrender.flatten.surface_arrays import FlatSurfaces
    from clrender.scene.values import Vector

__all__ = ["BOUNDARY", "LAMP", "OPAQUE", "SIMPLE", "Placed", "is_curve", "is_disk", "placed_faces", "shape_faces"]

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
    rows = _near(surfaces, kinds, others)
    disks = np.flatnonzero((kinds[surfaces.primitive_shape[count:]] > 0) & is_disk(surfaces)) + count
    squares = [_square(surfaces.analytic_shapes[row - count]) for row in disks.tolist()]
    corners = surfaces.vertices[surfaces.triangles[rows]].astype(np.float64).reshape(-1, 3, 3)
    row = np.concatenate([rows, np.repeat(disks, 2)])
    shape = surfaces.primitive_shape[row].astype(np.int64)
    return Faces(np.concatenate([corners, *squares]), row, shape, np.ones(len(row)))


def is_disk(surfaces: FlatSurfaces) -> NDArray[np.bool_]:
    return np.asarray(surfaces.analytic_shapes["normal"][:, 3] == 0.0)


def is_curve(surfaces: FlatSurfaces) -> NDArray[np.bool_]:
    return np.asarray(surfaces.analytic_shapes["normal"][:, 3] >= layout.ANALYTIC_SHAPE_CURVE)


def _near(surfaces: FlatSurfaces, kinds: NDArray[np.int64], others: Faces | None) -> NDArray[np.int64]:
    """Of many triangles only those that may touch a lamp, a boundary or others, and those of simple shapes."""
    of_triangles, short = surfaces.primitive_shape[: len(surfaces.triangles)], kinds.astype(np.int8)
    if np.count_nonzero(short[of_triangles]) <= _MANY:
        return np.flatnonzero(short[of_triangles])
    boxes = _around(surfaces, np.flatnonzero(short[of_triangles] > OPAQUE))
    if others is not None and len(others.row):
        more = others.boxes(4.0)
        around = np.concatenate([more[:, :3].min(axis=0), more[:, 3:].max(axis=0)])
        boxes = np.concatenate([boxes, around[None].astype(np.float32)])
    short[(kinds == OPAQUE) & _apart_from(surfaces, boxes)] = 0
    rows = np.flatnonzero(short[of_triangles])
    shape = of_triangles[rows]
    kept = (kinds[shape] > OPAQUE) | (surfaces.count[shape] <= SIMPLE)
    for at in range(0, len(rows), _MANY):
        low, high = _sides_of(surfaces, rows[at : at + _MANY])
        for box in boxes:
            inside = np.ones(len(low[0]), bool)
            for axis in range(3):
                inside &= (low[axis] <= box[3 + axis]) & (box[axis] <= high[axis])
            kept[at : at + _MANY] |= inside
    return rows[kept]


def _apart_from(surfaces: FlatSurfaces, boxes: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which shapes of many triangles are apart from all boxes as a whole, and so is each triangle."""
    apart = np.zeros(len(surfaces.shapes), bool)
    for index in np.flatnonzero(surfaces.count > _MANY).tolist():
        first = int(surfaces.first[index])
        triangles = surfaces.triangles[first : first + int(surfaces.count[index])]
        vertices = surfaces.vertices[int(triangles.min()) : int(triangles.max()) + 1]
        # By component: reductions along the first of two axes are slow, too
        extent = [(column.min(), column.max()) for column in vertices.T]
        corners = np.array([[each[0] for each in extent], *2 * [[each[1] for each in extent]]], np.float32)
        around = bounds(corners[None], 16.0 * ROUNDING)[0]
        apart[index] = not ((boxes[:, :3] <= around[3:]) & (around[:3] <= boxes[:, 3:])).all(axis=1).any()
    return apart


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
    low, high = _sides_of(surfaces, rows)
    return np.stack([*low, *high], axis=1)


def _sides_of(
    surfaces: FlatSurfaces, rows: NDArray[np.int64]
) -> tuple[list[NDArray[np.float32]], list[NDArray[np.float32]]]:
    """Lower and upper sides of these boxes, by axis: as `clrender.flatten.faces.bounds`, and faster for many."""
    corners = surfaces.triangles[rows].T
    low, high = [], []
    for column in surfaces.vertices.T:
        a, b, c = (column[each] for each in corners)
        low.append(np.minimum(np.minimum(a, b), c))
        high.append(np.maximum(np.maximum(a, b), c))
    x, y, z = (np.maximum(np.abs(a), np.abs(b)) for a, b in zip(low, high, strict=True))
    more = np.maximum(np.maximum(x, y), z) * np.float32(16.0 * ROUNDING)
    return [each - more for each in low], [each + more for each in high]


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
