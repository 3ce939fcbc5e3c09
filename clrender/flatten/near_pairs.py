"""Pairs of boxes that overlap, such as those of triangles that may touch."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["near_pairs"]

_Boxes = NDArray[np.float64]
_FAN: Final = 8
"""Boxes that become one on the next level."""
_CELLS: Final = 1 << 10


def near_pairs(first: _Boxes, second: _Boxes, most: int) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
    """Indices of all pairs of overlapping boxes, found by descending two trees together.

    Parameters
    ----------
    first, second : (n, 6) float64
        Lowest and highest coordinates.
    most : int
        Give up when so many pairs of nodes overlap.

    Returns
    -------
    two (k,) intp, or None
        Rows of `first` and of `second`; None: there are too many.
    """
    none = np.zeros(0, np.intp)
    if not len(first) or not len(second):
        return none, none
    of_first = np.flatnonzero(_overlap(first, _around(second)))
    of_second = np.flatnonzero(_overlap(second, _around(first)))
    if not len(of_first) or not len(of_second):
        return none, none
    of_first, a = _tree(first, of_first)
    of_second, b = _tree(second, of_second)
    i, j = np.zeros(1, np.intp), np.zeros(1, np.intp)
    while len(a) > 1 or len(b) > 1:
        if len(a) >= len(b):
            a.pop()
            i, j = _children(i, j, len(a[-1]))
        else:
            b.pop()
            j, i = _children(j, i, len(b[-1]))
        if len(i) > most * _FAN:
            return None
        near = _overlap(a[-1][i], b[-1][j])
        i, j = i[near], j[near]
        if len(i) > most:
            return None
    return of_first[i], of_second[j]


def _around(boxes: _Boxes) -> _Boxes:
    """The box around all of them, (6,)."""
    return np.concatenate([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])


def _overlap(a: _Boxes, b: _Boxes) -> NDArray[np.bool_]:
    near = (a[..., :3] <= b[..., 3:]) & (b[..., :3] <= a[..., 3:])
    return np.asarray(near[..., 0] & near[..., 1] & near[..., 2])


def _tree(boxes: _Boxes, some: NDArray[np.intp]) -> tuple[NDArray[np.intp], list[_Boxes]]:
    """Some of the boxes along a Morton curve, and levels of boxes around `_FAN` of the level before."""
    chosen = boxes[some]
    order = np.argsort(_morton(chosen[:, :3] + chosen[:, 3:]), kind="stable")
    levels = [chosen[order]]
    while len(levels[-1]) > 1:
        level = levels[-1]
        starts = np.arange(0, len(level), _FAN)
        low = np.minimum.reduceat(level[:, :3], starts, axis=0)
        levels.append(np.concatenate([low, np.maximum.reduceat(level[:, 3:], starts, axis=0)], axis=1))
    return some[order], levels


def _morton(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Position of points along a Morton curve through the box around them."""
    low = points.min(axis=0)
    size = np.maximum(points.max(axis=0) - low, 1e-300)
    cells = ((points - low) / size * (_CELLS - 1)).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _children(
    parent: NDArray[np.intp], other: NDArray[np.intp], count: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The children of nodes, each beside the other node of its parent's pair."""
    below = (parent[:, None] * _FAN + np.arange(_FAN)).reshape(-1)
    there = below < count
    return below[there], np.repeat(other, _FAN)[there]
