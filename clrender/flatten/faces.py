"""Flat faces of shapes, and which of them lie in one plane and overlap, as far as single precision can tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.near_pairs import near_pairs, overlaps

__all__ = [
    "NO_CONTACTS",
    "ROUNDING",
    "Contacts",
    "Faces",
    "areas",
    "bounds",
    "coplanar",
    "coplanar_among",
    "cross",
    "inner",
    "joined",
    "normals",
]

ROUNDING: Final = 2.0**-24
"""Relative error of one rounding."""
_PLANE: Final = 4.0 * ROUNDING
"""Of coordinates: planes this close may be meant to be one, after the rounding of their vertices."""
_EDGE: Final = 64.0 * ROUNDING
"""Of coordinates: an overlap this narrow is an edge in common."""
_CHUNK: Final = 2**16
_MOST: Final = 2**21
_MOST_SHAPES: Final = 2**14
_FEW: Final = 64
"""Up to so many faces, all pairs are looked at: the shapes' boxes would take longer."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Faces:
    """Some triangles; a disk is two that form the square around it.

    Attributes
    ----------
    corners : (n, 3, 3) float64
    row : (n,) int64
        The primitive of each.
    shape : (n,) int64
    stretch : (n,) float64
        How far it moves when its primitive moves by 1 in its own space: not 1 in instances.
    """

    corners: _Floats
    row: NDArray[np.int64]
    shape: NDArray[np.int64]
    stretch: _Floats

    def at(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Faces:
        """Some of them."""
        return Faces(self.corners[chosen], self.row[chosen], self.shape[chosen], self.stretch[chosen])

    def boxes(self, slack: float) -> _Floats:
        """(n, 6) their bounding boxes, enlarged for rounding."""
        return bounds(self.corners, slack * _PLANE * 2.0)


@dataclass(frozen=True)
class Contacts:
    """Pairs of faces that lie in one plane and overlap.

    Attributes
    ----------
    first, second : (k,) int64
        Indices of faces.
    normal : (k, 3) float64
        Unit normal of the first one.
    same : (k,) bool
        Whether both have their fronts on the same side.
    gap : (k,) float64
        Distance of their planes, metres.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    normal: _Floats
    same: NDArray[np.bool_]
    gap: _Floats

    def where(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Contacts:
        """Some of the pairs."""
        return Contacts(*(getattr(self, name)[chosen] for name in Contacts.__annotations__))


NO_CONTACTS: Final = Contacts(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.bool_), np.zeros(0)
)


def joined(several: Sequence[Faces]) -> Faces:
    """All faces of several lists."""
    return Faces(*(np.concatenate([getattr(each, name) for each in several]) for name in Faces.__annotations__))


def inner(a: _Floats, b: _Floats) -> _Floats:
    """Dot product along the last axis, added in order."""
    return np.asarray((a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]) + a[..., 2] * b[..., 2])


def cross(a: _Floats, b: _Floats) -> _Floats:
    """Cross product along the last axis; for few vectors in a third of the time of `numpy.cross`, with its bits."""
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    y = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    z = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.stack([x, y, z], axis=-1)


def normals(corners: _Floats) -> _Floats:
    """Unit normals of triangles; (n, 3, 3) gives (n, 3)."""
    n = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(n / np.maximum(np.sqrt(inner(n, n)), 1e-300)[:, None])


def coplanar(first: Faces, second: Faces, slack: float = 1.0) -> Contacts | None:
    """All pairs of faces of `first` and `second` that coincide; None: too many to test.

    Parameters
    ----------
    first, second : Faces
    slack : float
        How many times the rounding of vertices in world space planes may differ.

    Returns
    -------
    Contacts or None
        In ascending order of the first, and then of the second.
    """
    pairs = near_pairs(first.boxes(slack), second.boxes(slack), _MOST)
    if pairs is None:
        return None
    i, j = pairs
    parts = [
        _tested(first, second, i[at : at + _CHUNK], j[at : at + _CHUNK], slack)
        for at in range(0, max(len(i), 1), _CHUNK)
    ]
    found = _joined(parts)
    return found.where(np.lexsort((found.second, found.first)))


def coplanar_among(faces: Faces, slack: float = 1.0) -> Contacts | None:
    """All pairs of `faces` of different shapes that coincide, the first of the lower shape; None: too many to test.

    They are in ascending order of the shapes, and then of the faces.
    """
    if len(faces.shape) < 2 or (faces.shape == faces.shape[0]).all():
        return NO_CONTACTS
    boxes = faces.boxes(slack)
    if len(faces.shape) <= _FEW:
        i, j = np.nonzero(overlaps(boxes[:, None], boxes) & (faces.shape[:, None] < faces.shape))
        few = _tested(faces, faces, i, j, slack)
        shape, other = faces.shape[few.first], faces.shape[few.second]
        return few.where(np.lexsort((few.second, few.first, other, shape)))
    order = np.argsort(faces.shape, kind="stable")
    starts = np.unique(faces.shape[order], return_index=True)[1]
    boxes = boxes[order]
    low, high = np.minimum.reduceat(boxes[:, :3], starts), np.maximum.reduceat(boxes[:, 3:], starts)
    around = np.concatenate([low, high], axis=1)
    near = near_pairs(around, around, _MOST_SHAPES)
    if near is None:
        return None
    of = np.split(order, starts[1:])
    parts = [NO_CONTACTS]
    for i, j in sorted((i, j) for i, j in zip(near[0].tolist(), near[1].tolist(), strict=True) if i < j):
        found = coplanar(faces.at(of[i]), faces.at(of[j]), slack)
        if found is None:
            return None
        parts.append(replace(found, first=of[i][found.first], second=of[j][found.second]))
    return _joined(parts)


def _joined(parts: Sequence[Contacts]) -> Contacts:
    return Contacts(*(np.concatenate([getattr(part, name) for part in parts]) for name in Contacts.__annotations__))


def _tested(first: Faces, second: Faces, i: NDArray[np.intp], j: NDArray[np.intp], slack: float) -> Contacts:
    if not len(i):
        return NO_CONTACTS
    p, q = first.corners[i], second.corners[j]
    normal, other = normals(p), normals(q)
    size_p, size_q = np.abs(p).max(axis=1, initial=0.0), np.abs(q).max(axis=1, initial=0.0)
    largest = np.minimum(size_p.max(axis=1, initial=0.0), size_q.max(axis=1, initial=0.0))
    at = np.maximum(size_p, size_q)
    gaps = []
    for n, plane, points in ((normal, p, q), (other, q, p)):
        away = np.abs(inner(n[:, None], points - plane[:, :1])).max(axis=1, initial=0.0)
        unsure = slack * _PLANE * (inner(np.abs(n), at) + largest)
        gaps.append(np.where(away <= unsure, away, np.inf))
    gap = np.minimum(*gaps)
    meets = np.flatnonzero(gap < np.inf)
    meets = meets[_overlap(p[meets], q[meets], _EDGE * largest[meets])]
    same = inner(normal[meets], other[meets]) > 0.0
    return Contacts(i[meets], j[meets], normal[meets], same, gap[meets])


def _overlap(p: _Floats, q: _Floats, margin: _Floats) -> NDArray[np.bool_]:
    """Whether coplanar triangles overlap by more than an edge: no edge of either separates them. (k, 3, 3) each."""
    across = np.abs(normals(np.where((areas(p) > areas(q))[:, None, None], p, q)))
    kept = np.array([[1, 2], [0, 2], [0, 1]])[across.argmax(axis=1)] if len(p) else np.zeros((0, 2), np.intp)
    a, b = (np.take_along_axis(x, kept[:, None, :], axis=2) for x in (p, q))
    edges = np.concatenate([a[:, [1, 2, 0]] - a, b[:, [1, 2, 0]] - b], axis=1)
    length = np.maximum(np.sqrt(edges[..., 0] * edges[..., 0] + edges[..., 1] * edges[..., 1]), 1e-300)
    x, y = (-edges[..., 1] / length)[..., None], (edges[..., 0] / length)[..., None]
    # Of each of the six edges, where the three corners of either triangle are across it
    s, t = (x * c[:, None, :, 0] + y * c[:, None, :, 1] for c in (a, b))
    common = np.minimum(s.max(axis=2), t.max(axis=2)) - np.maximum(s.min(axis=2), t.min(axis=2))
    return np.asarray(~(common <= margin[:, None]).any(axis=1))


def bounds(corners: NDArray[Any], slack: float) -> NDArray[Any]:
    """Bounding boxes of triangles, enlarged by a share of their largest coordinate; (n, 3, 3) gives (n, 6)."""
    # By component: reductions along short axes are slow
    low = np.minimum(np.minimum(corners[:, 0], corners[:, 1]), corners[:, 2])
    high = np.maximum(np.maximum(corners[:, 0], corners[:, 1]), corners[:, 2])
    size = np.maximum(np.abs(low), np.abs(high))
    more = (np.maximum(np.maximum(size[:, 0], size[:, 1]), size[:, 2]) * corners.dtype.type(slack))[:, None]
    return np.concatenate([low - more, high + more], axis=1)


def areas(corners: _Floats) -> _Floats:
    """Twice the areas of triangles; (n, 3, 3) gives (n,)."""
    n = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(np.sqrt(inner(n, n)))
