"""Finds coinciding faces of different media: a ray hits only one of the two, so it tracks the wrong media."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.scene.interiors import medium_of_primitives

__all__ = ["coinciding_shapes"]

_MOST_TRIANGLES: Final = 2**18
_MOST_PAIRS: Final = 2**20
"""Most pairs that are tested: the result is only a warning, which must not take long."""
_NEAR: Final = 1e-6
"""Fraction of the largest coordinate: a ray cannot distinguish planes this close."""


def coinciding_shapes(arrays: Mapping[str, NDArray[Any]], triangle_count: int) -> tuple[int, int] | None:
    """Two shapes of different media whose triangles overlap in one plane.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        See `clrender.flatten.FlatScene`.
    triangle_count : int
        Number of triangles in world space; only these are tested.

    Returns
    -------
    (int, int) or None
        Indices in the scene's list of shapes.
    """
    if len(arrays["media_rows"]) == 1:
        return None
    medium_of = medium_of_primitives(arrays)[:triangle_count]
    chosen = np.flatnonzero(medium_of)
    if not 0 < len(chosen) <= _MOST_TRIANGLES:
        return None
    corners = arrays["vertices"][arrays["triangles"][chosen]].astype(np.float64)
    for group in _planes(corners):
        media = medium_of[chosen[group]]
        for medium in np.unique(media):
            first, second = group[media == medium], group[media > medium]
            if not 0 < len(first) * len(second) <= _MOST_PAIRS:
                continue
            pairs = np.argwhere(_overlap(corners[first], corners[second]))
            if len(pairs):
                shape_of, (i, j) = arrays["primitive_shape"], pairs[0]
                low, high = sorted((int(shape_of[chosen[first[i]]]), int(shape_of[chosen[second[j]]])))
                return low, high
    return None


def _planes(corners: NDArray[np.float64]) -> list[NDArray[np.intp]]:
    """Groups of two or more coplanar triangles, whichever side they face."""
    size = max(float(np.abs(corners).max()), 1e-30)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.sqrt((normal * normal).sum(axis=1))[:, None]
    largest = np.take_along_axis(normal, np.abs(normal).argmax(axis=1)[:, None], axis=1)
    normal *= np.sign(largest)
    place = (normal * corners[:, 0]).sum(axis=1) / size
    keys = np.rint(np.column_stack([normal, place]) / (4.0 * _NEAR)).astype(np.int64)
    _, number, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    order = np.argsort(number, kind="stable")
    groups = np.split(order, np.cumsum(count)[:-1])
    return [group for group in groups if len(group) > 1]


def _overlap(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether coplanar triangles overlap by more than an edge, (n, m): no edge of either separates them."""
    size = float(max(np.abs(first).max(), np.abs(second).max()))
    across = np.cross(first[0, 1] - first[0, 0], first[0, 2] - first[0, 0])
    kept = [axis for axis in range(3) if axis != int(np.abs(across).argmax())]
    a, b = first[:, None, :, kept], second[None, :, :, kept]
    parted = np.zeros((len(first), len(second)), bool)
    for triangles in (a, b):
        for corner in range(3):
            edge = triangles[:, :, (corner + 1) % 3] - triangles[:, :, corner]
            away = np.stack([-edge[..., 1], edge[..., 0]], axis=-1)
            away /= np.maximum(np.sqrt((away * away).sum(axis=-1)), 1e-30)[..., None]
            p, q = (a * away[:, :, None]).sum(axis=-1), (b * away[:, :, None]).sum(axis=-1)
            common = np.minimum(p.max(axis=2), q.max(axis=2)) - np.maximum(p.min(axis=2), q.min(axis=2))
            parted |= common <= 8.0 * _NEAR * size
    return ~parted
