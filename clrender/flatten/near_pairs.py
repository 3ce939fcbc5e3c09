"""Pairs of boxes that overlap, such as those of triangles that may touch."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["near_pairs", "overlaps"]

_Boxes = NDArray[np.float64]
_FAN: Final = 8
"""Boxes that become one on the next level."""
_CELLS: Final = 1 << 10
_CHUNK: Final = 1 << 14
_FEW: Final = 1 << 12
"""Up to so many pairs, each is tested: two trees would take longer."""


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
    if len(first) * len(second) <= _FEW:
        i, j = np.nonzero(overlaps(first[:, None], second))
        return None if len(i) > most else (i, j)
    of_first = np.flatnonzero(overlaps(first, _around(second)))
    of_second = np.flatnonzero(overlaps(second, _around(first)))
    if not len(of_first) or not len(of_second):
        return none, none
    of_first, a = _tree(first, of_first)
    of_second, b = _tree(second, of_second)
    i, j = np.zeros(1, np.intp), np.zeros(1, np.intp)
    while len(a) > 1 or len(b) > 1:
        if len(a) >= len(b):
            a.pop()
            found = _near_children(i, j, a[-1], b[-1], most)
        else:
            b.pop()
            found = _near_children(j, i, b[-1], a[-1], most)
            found = None if found is None else found[::-1]
        if found is None:
            return None
        i, j = found
    return of_first[i], of_second[j]


def _around(boxes: _Boxes) -> _Boxes:
    """The box around all of them, (6,)."""
    return np.concatenate([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])


def overlaps(a: _Boxes, b: _Boxes) -> NDArray[np.bool_]:
    """Whether boxes overlap, by pairs that are broadcast; the last axis has six coordinates."""
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


def _near_children(
    parent: NDArray[np.intp], other: NDArray[np.intp], below: _Boxes, beside: _Boxes, most: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
    """The children of nodes that overlap the other node of their parent's pair, beside it; None: there are too many."""
    children, others, tested, count = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)], 0, 0
    for start in range(0, len(parent), _CHUNK):  # eight times as many at once would take gigabytes
        child = (parent[start : start + _CHUNK, None] * _FAN + np.arange(_FAN)).reshape(-1)
        there = child < len(below)
        child, partner = child[there], np.repeat(other[start : start + _CHUNK], _FAN)[there]
        near = overlaps(below[child], beside[partner])
        children.append(child[near])
        others.append(partner[near])
        tested, count = tested + len(child), count + len(children[-1])
        if tested > most * _FAN or count > most:
            return None
    return np.concatenate(children), np.concatenate(others)
