"""The outline of an object in an image, as a path that a page draws."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["outline"]

_MOST_EDGES: Final = 20_000
"""Straight pieces of an outline; of an object with more, such as a tree, it is that of larger pixels."""


def outline(mask: npt.NDArray[np.bool_]) -> tuple[int, int, str]:
    """Where an object ends.

    Parameters
    ----------
    mask : (h, w) bool
        Whether a pixel shows the object.

    Returns
    -------
    width, height : int
        Units of the path: pixels of the mask, or larger ones.
    path : str
        Data of an SVG path: each edge between a pixel of the object and another one, those in a line as one piece;
        empty where nothing is seen of it.
    """
    while True:
        inside = np.pad(mask, 1)
        across, down = inside[1:, 1:-1] != inside[:-1, 1:-1], inside[1:-1, 1:] != inside[1:-1, :-1]
        rows, columns = _runs(across), _runs(down.T)
        height, width = mask.shape
        if len(rows) + len(columns) <= _MOST_EDGES or min(mask.shape) < 2:
            pieces = [f"M{begin} {line}h{length}" for line, begin, length in rows.tolist()]
            pieces += [f"M{line} {begin}v{length}" for line, begin, length in columns.tolist()]
            return width, height, "".join(pieces)
        even = np.pad(mask, ((0, height % 2), (0, width % 2)))
        mask = even[::2, ::2] | even[1::2, ::2] | even[::2, 1::2] | even[1::2, 1::2]


def _runs(edges: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """(n, 3) runs of true values: line, first place and length."""
    steps = np.diff(np.pad(edges, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    begins, ends = np.argwhere(steps == 1), np.argwhere(steps == -1)
    return np.column_stack([begins, ends[:, 1] - begins[:, 1]])
