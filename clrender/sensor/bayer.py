"""Colour filter arrays after Bayer: the mosaic of an image, and its colours interpolated again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["PATTERNS", "demosaiced", "filter_colors"]

PATTERNS: Final[Mapping[str, tuple[int, int, int, int]]] = {
    "rggb": (0, 1, 1, 2),
    "bggr": (2, 1, 1, 0),
    "grbg": (1, 0, 2, 1),
    "gbrg": (1, 2, 0, 1),
}
"""Channels of the first two pixels of the first row, and of the second."""


def filter_colors(pattern: str, height: int, width: int) -> npt.NDArray[np.int64]:
    """The channel, 0 to 2, that each pixel measures: (height, width) int64."""
    rows, columns = np.arange(height)[:, None] % 2, np.arange(width)[None, :] % 2
    return np.asarray(np.array(PATTERNS[pattern], np.int64)[2 * rows + columns])


def demosaiced(raw: npt.NDArray[np.integer], pattern: str) -> npt.NDArray[np.int64]:
    """Colours by bilinear interpolation: means of the nearest pixels that measure a channel, rounded half up.

    Parameters
    ----------
    raw : (H, W) integers
        Two pixels a side at least.
    pattern : str
        One of `PATTERNS`.

    Returns
    -------
    (H, W, 3) int64
        Beyond the edges the image is reflected, which keeps the pattern.
    """
    height, width = raw.shape
    colors, result = filter_colors(pattern, height, width), np.empty((height, width, 3), np.int64)
    for channel in range(3):
        plane = np.pad(np.where(colors == channel, raw, 0).astype(np.int64), 1, mode="reflect")
        across = plane[:, :-2] + 2 * plane[:, 1:-1] + plane[:, 2:]
        if channel == 1:
            total = across[1:-1] + (plane[:-2, 1:-1] + plane[2:, 1:-1]) + 2 * plane[1:-1, 1:-1]
        else:
            total = across[:-2] + 2 * across[1:-1] + across[2:]
        # Weights of the pixels that measure the channel add up to 4, wherever one is
        result[..., channel] = (total + 2) // 4
    return result
