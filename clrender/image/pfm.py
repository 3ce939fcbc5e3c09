"""Portable float maps: linear images of 32-bit floats, `PF` in colours or `Pf` grey, from the bottom row up."""

from __future__ import annotations

import math
import re
from typing import IO, Final

import numpy as np
import numpy.typing as npt

from clrender.image.display import PIXEL_LIMIT, check_size

__all__ = ["pfm_size", "read_pfm"]

_HEADER: Final = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+.0-9eE]{1,30})[ \t\r]*\n")
_HEADER_LIMIT: Final = 200


def _header(file: IO[bytes]) -> tuple[int, int, int, float, int]:
    """Width, height, channels, scale, and the size of the header in bytes."""
    match = _HEADER.match(file.read(_HEADER_LIMIT))
    if match is None:
        raise ValueError("its first lines are not those of a PFM: PF or Pf, width and height, and a scale")
    try:
        scale = float(match[4])
    except ValueError:
        scale = 0.0
    if not math.isfinite(scale) or scale == 0.0:
        raise ValueError("its scale must be a number above 0, or below 0 for numbers in little-endian order")
    return int(match[2]), int(match[3]), 3 if match[1] == b"PF" else 1, scale, match.end()


def pfm_size(file: IO[bytes]) -> tuple[int, int]:
    """Width and height, from the header alone."""
    width, height, *_ = _header(file)
    return width, height


def read_pfm(file: IO[bytes], most: int = PIXEL_LIMIT) -> npt.NDArray[np.float32]:
    """Pixels of a PFM, with the first row at the top.

    Readers ignore the magnitude of the scale, of which only the sign has a meaning that programs agree about: the order
    of bytes.

    Parameters
    ----------
    file : binary file
        At its beginning.
    most : int
        Largest number of pixels.

    Returns
    -------
    (H, W, 3) float32

    Raises
    ------
    ValueError
        It is damaged, or too large.
    """
    width, height, channels, scale, begin = _header(file)
    check_size(width, height, most)
    wanted = width * height * channels * 4
    if file.seek(0, 2) < begin + wanted:
        raise ValueError("it is truncated: it is too small for the size its header gives")
    file.seek(begin)
    pixels = np.frombuffer(file.read(wanted), "<f4" if scale < 0.0 else ">f4").reshape(height, width, channels)[::-1]
    return np.ascontiguousarray(np.broadcast_to(pixels, (height, width, 3)), np.float32)
