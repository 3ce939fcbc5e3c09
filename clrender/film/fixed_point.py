"""Fixed-point arithmetic: sums of samples as exact integers, and their conversion to float64."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["QUANTUM_BITS", "SAMPLE_LIMIT_BITS", "add_words", "subtract_words", "to_float64"]

QUANTUM_BITS: Final = 64
"""A sum counts quanta of 2^-QUANTUM_BITS."""

SAMPLE_LIMIT_BITS: Final = 43
"""A sample channel must be below 2^SAMPLE_LIMIT_BITS in magnitude: 2^20 of the largest still fit 128 bits."""


def to_float64(sums: npt.NDArray[np.uint64]) -> npt.NDArray[np.float64]:
    """Convert exact sums to float64, rounded to nearest, ties to even.

    Parameters
    ----------
    sums : (n, ..., 2) uint64
        128-bit two's complement quanta, low word first.

    Returns
    -------
    (n, ...) float64
    """
    low, high = sums[..., 0], sums[..., 1]
    negative = high >> np.uint64(63) == 1
    high = np.where(negative, ~high + (low == 0).astype(np.uint64), high)
    low = np.where(negative, ~low + np.uint64(1), low)
    # Shift the leading bit to the top of one word and use the last bit as the sticky bit of all bits cut off: the
    # conversion of that word to float64 then rounds like the whole number. frexp may return one bit too many (its
    # argument is rounded), which costs one of the ten spare bits. Shifts by 64 give 0.
    used = np.frexp(high.astype(np.float64))[1].clip(0, 64).astype(np.uint64)
    shift = np.uint64(64) - used
    top = (high << shift) | (low >> used)
    top |= (low << shift != 0).astype(np.uint64)
    magnitude: npt.NDArray[np.float64] = np.ldexp(top.astype(np.float64), -shift.astype(np.int32))
    return np.where(negative, -magnitude, magnitude)


def add_words(total: npt.NDArray[np.uint64], words: npt.NDArray[np.uint64]) -> None:
    """Add multi-word integers, (..., n) uint64, least significant word first, to totals in place, modulo 2^(64 n)."""
    carry: npt.NDArray[np.bool_] | None = None
    for k in range(total.shape[-1]):
        word, more = total[..., k], words[..., k]
        word += more
        over = word < more
        if carry is not None:
            word += carry
            over |= (word == 0) & carry
        carry = over


def subtract_words(total: npt.NDArray[np.uint64], words: npt.NDArray[np.uint64]) -> None:
    """The inverse of `add_words`."""
    borrow: npt.NDArray[np.bool_] | None = None
    for k in range(total.shape[-1]):
        word, less = total[..., k], words[..., k]
        under = word < less
        word -= less
        if borrow is not None:
            under |= (word == 0) & borrow
            word -= borrow
        borrow = under
