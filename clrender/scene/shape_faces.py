"""The faces of a scene's shapes that may touch others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.scene.faces import ROUNDING, Faces, inner

if TYPE_CHECKING:
    from clrender.scene.surfaces import FlatSurfaces

__all__ = ["BOUNDARY", "LAMP", "OPAQUE", "SIMPLE", "is_disk", "shape_faces"]

OPAQUE: Final = 1
LAMP: Final = 2
BOUNDARY: Final = 3
SIMPLE: Final = 12
"""Most faces of a simple shape."""
_MANY: Final = 2**16
"""Of more triangles only those near lamps and boundaries are looked at."""
_CHOICES: Final = 32
"""Most boxes to choose these by."""

_Floats = NDArray[np.float64]


def shape_faces(surfaces: FlatSurfaces, kinds: NDArray[np.int64]) -> Faces:
    """The triangles of shapes that have a kind, as far as they may touch others, and squares around their disks."""
    count = len(surfaces.triangles)
    rows = _near(surfaces, np.flatnonzero(kinds[surfaces.primitive_shape[:count]] > 0), kinds)
    disks = np.flatnonzero((kinds[surfaces.primitive_shape[count:]] > 0) & is_disk(surfaces)) + count
    squares = [_square(surfaces.analytic_shapes[row - count]) for row in disks.tolist()]
    corners = surfaces.vertices[surfaces.triangles[rows]].astype(np.float64).reshape(-1, 3, 3)
    row = np.concatenate([rows, np.repeat(disks, 2)])
    return Faces(np.concatenate([corners, *squares]), row, surfaces.primitive_shape[row].astype(np.int64))


def is_disk(surfaces: FlatSurfaces) -> NDArray[np.bool_]:
    return np.asarray(surfaces.analytic_shapes["normal"][:, 3] == 0.0)


def _near(surfaces: FlatSurfaces, rows: NDArray[np.int64], kinds: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of many triangles only those that may touch a lamp or a boundary, and those of simple shapes."""
    if len(rows) <= _MANY:
        return rows
    shape = surfaces.primitive_shape[rows]
    apart = rows[kinds[shape] > OPAQUE]
    boxes = _boxes_of(surfaces, apart)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(surfaces.primitive_shape[apart])) + 1])
    if len(apart) > _CHOICES:  # around whole shapes, or around all of them
        starts = starts if len(starts) <= _CHOICES else starts[:1]
        low, high = (np.minimum, np.maximum)
        boxes = np.concatenate([low.reduceat(boxes[:, :3], starts), high.reduceat(boxes[:, 3:], starts)], axis=1)
    kept = (kinds[shape] > OPAQUE) | (surfaces.count[shape] <= SIMPLE)
    for at in range(0, len(rows), _MANY):
        these = _boxes_of(surfaces, rows[at : at + _MANY])
        for box in boxes:
            kept[at : at + _MANY] |= ((these[:, :3] <= box[3:]) & (box[:3] <= these[:, 3:])).all(axis=1)
    return rows[kept]


def _boxes_of(surfaces: FlatSurfaces, rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """(n, 6) bounding boxes of triangles, enlarged for rounding."""
    corners = surfaces.vertices[surfaces.triangles[rows]].reshape(-1, 3, 3)
    low, high = corners.min(axis=1), corners.max(axis=1)
    more = np.float32(16.0 * ROUNDING) * np.maximum(np.abs(low), np.abs(high)).max(axis=1, initial=0.0)[:, None]
    return np.concatenate([low - more, high + more], axis=1)


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
