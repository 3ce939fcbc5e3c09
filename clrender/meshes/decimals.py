"""Vectorised conversion of decimal digits to numbers."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["decimal_values", "digit_values"]

_POWERS: Final = np.array([float(10**k) for k in range(23)])
"""Powers of ten that double precision holds exactly."""
_WORD: Final = 8
_NIBBLES: Final = np.array([0x0F0F0F0F0F0F0F0F << 8 * (8 - n) & 2**64 - 1 for n in range(9)], np.uint64)
"""Masks that keep the digit values in the last n of eight bytes, the first byte being the lowest."""


def decimal_values(
    digits: NDArray[np.int64], decimals: NDArray[np.int64], negative: NDArray[np.bool_]
) -> NDArray[np.float64] | None:
    """Decimal numbers without exponents, correctly rounded.

    Parameters
    ----------
    digits : (n,) int64
        The numbers without decimal points, signs included.
    decimals : (n,) int64
        Number of digits after the decimal point, from 0.
    negative : (n,) bool
        Which numbers have a minus sign, so that zeros keep theirs.

    Returns
    -------
    (n,) float64, or None
        None if a number has too many digits for exact conversion: see `parse_numbers`.
    """
    values = digits.astype(np.float64)
    if len(values) and (max(values.max(), -values.min()) >= 2.0**53 or decimals.max() >= len(_POWERS)):
        return None
    values /= _POWERS.take(decimals)
    zeros = digits == 0
    if zeros.any():
        values[zeros & negative] = -0.0
    return values


def digit_values(
    data: NDArray[np.uint8], ends: NDArray[np.int64], lengths: NDArray[np.int64]
) -> NDArray[np.int64] | None:
    """Integers whose digits end at given positions.

    Eight digits form one 64-bit word, in which neighbours are combined in three steps: pairs, fours, all
    (Lemire, "Quickly parsing eight digits", 2018).

    Parameters
    ----------
    data : (m,) uint8
        The text.
    ends : (n,) int64
        Position of the first byte after each number.
    lengths : (n,) int64
        Digits of each number, from 0; a number without digits is 0.

    Returns
    -------
    (n,) int64, or None
        None if a number has more than 16 digits.
    """
    longest = int(lengths.max(initial=0))
    if longest > 2 * _WORD:
        return None
    padded = np.concatenate([np.zeros(2 * _WORD, np.uint8), data])
    # The word of the eight bytes before each position of the text, at any alignment
    words = np.ndarray(len(data) + _WORD, "<u8", padded, strides=(1,))
    values = _eight_digits(words[ends + _WORD], np.minimum(lengths, _WORD))
    if longest > _WORD:
        values += 10**_WORD * _eight_digits(words[ends], np.maximum(lengths - _WORD, 0))
    return values


def _eight_digits(words: NDArray[np.uint64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Integers from the last `lengths` bytes of the words; overwrites the words."""
    words &= _NIBBLES.take(lengths)
    for weights, bits, kept in (
        (10 << 8 | 1, 8, 0x00FF00FF00FF00FF),
        (100 << 16 | 1, 16, 0x0000FFFF0000FFFF),
        (10000 << 32 | 1, 32, 0x00000000FFFFFFFF),
    ):
        words *= np.uint64(weights)
        words >>= np.uint64(bits)
        words &= np.uint64(kept)
    return words.view(np.int64)
