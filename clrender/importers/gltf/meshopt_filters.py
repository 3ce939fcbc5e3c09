"""The filters of EXT_meshopt_compression, in single precision: the same bits on every processor.

The filters of the library approximate square roots, each kind of processor in its own way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["FILTERS", "Filter"]

_FAR: Final = np.float32(2**30)


@dataclass(frozen=True)
class Filter:
    """A filter.

    Attributes
    ----------
    strides : tuple of int
        Bytes that an element may have.
    undo : callable
        From stored numbers, (count, 4) int8 or int16, or (count, n) int32, to those that accessors read.
    """

    strides: tuple[int, ...]
    undo: Callable[[NDArray[Any]], NDArray[Any]]

    def undone(self, rows: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Elements as accessors read them, from those as stored: (count, stride) bytes."""
        stride = rows.shape[1]
        size = stride // 4 if len(self.strides) <= 2 else 4
        with np.errstate(all="ignore"):  # damaged data may divide by 0
            found = self.undo(np.ascontiguousarray(rows).view(f"<i{size}"))
        return np.ascontiguousarray(found).view(np.uint8).reshape(rows.shape)


def _rounded(numbers: NDArray[np.float32]) -> NDArray[np.int32]:
    """The nearest integers. Of damaged data they may be any, but on every processor the same."""
    held = np.clip(np.rint(numbers), -_FAR, _FAR)
    return np.where(np.isnan(held), np.float32(0.0), held).astype(np.int32)


def _largest(numbers: NDArray[Any]) -> np.float32:
    return np.float32(np.iinfo(numbers.dtype).max)


def _octahedral(stored: NDArray[Any]) -> NDArray[Any]:
    """Unit vectors from coordinates on an octahedron; the fourth component is not filtered."""
    x, y, one = stored[:, :3].astype(np.float32).T
    z = one - np.abs(x) - np.abs(y)
    below = np.minimum(z, np.float32(0.0))
    x, y = x - np.copysign(below, x), y - np.copysign(below, y)
    scale = _largest(stored) / np.sqrt(x * x + y * y + z * z)
    found = stored.copy()
    for column, part in enumerate((x, y, z)):
        found[:, column] = _rounded(part * scale)
    return found


def _quaternion(stored: NDArray[Any]) -> NDArray[Any]:
    """Unit quaternions from their three smallest components, and the place of the largest one in the last two bits."""
    last = stored[:, 3]
    scale = np.float32(np.sqrt(0.5)) / (last | 3).astype(np.float32)
    small = stored[:, :3].astype(np.float32) * scale[:, None]
    x, y, z = small.T
    largest = np.sqrt(np.maximum(np.float32(1.0) - x * x - y * y - z * z, np.float32(0.0)))
    found, rows = np.empty_like(stored), np.arange(len(stored))
    for step, part in enumerate((largest, x, y, z)):
        found[rows, (last + step) & 3] = _rounded(part * _largest(stored))
    return found


def _exponential(stored: NDArray[Any]) -> NDArray[Any]:
    """Floats from exponents in the highest eight bits and mantissas in the others, both signed."""
    found: NDArray[Any] = np.ldexp(((stored << 8) >> 8).astype(np.float32), stored >> 24)
    return found.astype("<f4")


def _color(stored: NDArray[Any]) -> NDArray[Any]:
    """Colours from YCoCg with an alpha; the highest bit of the alpha tells the number of bits of all."""
    unsigned = stored.view(stored.dtype.str.replace("i", "u")).astype(np.int32)
    luma, alpha = unsigned[:, 0], unsigned[:, 3]
    orange, green = stored[:, 1].astype(np.int32), stored[:, 2].astype(np.int32)
    ones = alpha.copy()
    for shift in (1, 2, 4, 8):
        ones |= ones >> shift
    scale = np.float32(np.iinfo(stored.dtype.str.replace("i", "u")).max) / ones.astype(np.float32)
    parts = luma + orange - green, luma + green, luma - orange - green, ((alpha << 1) & ones) | (alpha & 1)
    shares = np.stack([part.astype(np.float32) * scale for part in parts], 1)
    return _rounded(shares).astype(stored.dtype)


FILTERS: Final[Mapping[str, Filter]] = {
    "OCTAHEDRAL": Filter((4, 8), _octahedral),
    "QUATERNION": Filter((8,), _quaternion),
    "EXPONENTIAL": Filter(tuple(range(4, 257, 4)), _exponential),
    "COLOR": Filter((4, 8), _color),
}
"""By name."""
