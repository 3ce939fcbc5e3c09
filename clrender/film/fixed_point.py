"""Fixed-point arithmetic: conversion of float32 samples to exact integers, and of their sums to float64."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["QUANTUM_BITS", "SAMPLE_LIMIT_BITS", "add_words", "fixed_point", "subtract_words", "to_float64"]

QUANTUM_BITS: Final = 64
"""A sum counts quanta of 2^-QUANTUM_BITS."""

SAMPLE_LIMIT_BITS: Final = 43
"""A sample channel must be below 2^SAMPLE_LIMIT_BITS in magnitude: 2^20 of the largest still fit 128 bits."""


def fixed_point(values: npt.ArrayLike) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.bool_]]:
    """Convert sample channels to fixed point as the film adds them; the reference for the kernels.

    Parameters
    ----------
    values : (...) float32
        Any values, finite or not.

    Returns
    -------
    words : (..., 4) uint32
        128-bit two's complement number of quanta of 2^-64, least significant word first, truncated towards zero. Zero
        where not accepted.
    accepted : (...) bool
        Finite and below 2^43 in magnitude.
    """
    numbers = np.asarray(values, np.float32)
    bits = numbers.reshape(-1).view(np.uint32).astype(np.uint64)
    exponent = (bits >> np.uint64(23)) & np.uint64(0xFF)
    accepted = exponent < 127 + SAMPLE_LIMIT_BITS
    fraction = (bits & np.uint64(0x7FFFFF)) | np.where(exponent > 0, np.uint64(1 << 23), np.uint64(0))
    # value = fraction 2^(exponent - 150), so quanta = fraction << (exponent - 150 + 64). NumPy's shifts by 64 bits or
    # more give 0, as each half needs.
    shift = np.where(accepted, np.maximum(exponent, 1), 0).astype(np.int64) - (150 - QUANTUM_BITS)
    left = np.maximum(shift, 0).astype(np.uint64)
    low = (fraction << left) >> np.maximum(-shift, 0).astype(np.uint64)
    high = np.where(
        left >= 64,
        fraction << (np.maximum(left, 64) - np.uint64(64)),
        fraction >> (np.uint64(64) - np.minimum(left, 64)),
    )
    high = np.where(shift > 0, high, np.uint64(0))
    negative = (bits >> np.uint64(31)) == 1
    low, high = (
        np.where(negative, ~low + np.uint64(1), low),
        np.where(negative, ~high + (low == 0).astype(np.uint64), high),
    )
    halves = np.where(accepted[..., None], np.stack([low, high], -1), np.uint64(0))
    words = np.ascontiguousarray(halves, "<u8").view("<u4").astype(np.uint32, copy=False)
    return words.reshape(*numbers.shape, 4), accepted.reshape(numbers.shape)


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
