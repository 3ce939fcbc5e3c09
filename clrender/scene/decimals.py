"""Numbers from their digits, many at a time."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["decimal_values", "digit_values"]

_POWERS: Final = 10.0 ** np.arange(23)
"""Powers of ten that double precision holds exactly."""
_WORD: Final = 8
_NIBBLES: Final = np.array([0x0F0F0F0F0F0F0F0F << 8 * (8 - n) & 2**64 - 1 for n in range(9)], np.uint64)
"""Of eight bytes, the first one lowest, the digits' values in the last n."""


def decimal_values(
    digits: NDArray[np.int64], decimals: NDArray[np.int64], negative: NDArray[np.bool_]
) -> NDArray[np.float64] | None:
    """Numbers without exponents, correctly rounded.

    Parameters
    ----------
    digits : (n,) int64
        Without their dots, signs included.
    decimals : (n,) int64
        How many digits stand behind the dots, from 0.
    negative : (n,) bool
        Which have a minus sign, so that zeros keep theirs.

    Returns
    -------
    (n,) float64, or None
        None where a number has too many digits for that: see `parse_numbers`.
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
    """Whole numbers whose digits stand before given places.

    Eight digits are one 64-bit word, in which neighbours are added up in three steps: pairs, fours, all
    (Lemire, "Quickly parsing eight digits", 2018).

    Parameters
    ----------
    data : (m,) uint8
        The text.
    ends : (n,) int64
        Places of the first byte behind each number.
    lengths : (n,) int64
        Digits of each number, from 0; where there are none the number is 0.

    Returns
    -------
    (n,) int64, or None
        None where a number has more than 16 digits.
    """
    longest = int(lengths.max(initial=0))
    if longest > 2 * _WORD:
        return None
    padded = np.concatenate([np.zeros(2 * _WORD, np.uint8), data])
    # The word of the eight bytes before each place of the text, wherever these begin
    words = np.ndarray(len(data) + _WORD, "<u8", padded, strides=(1,))
    values = _eight_digits(words[ends + _WORD], np.minimum(lengths, _WORD))
    if longest > _WORD:
        values += 10**_WORD * _eight_digits(words[ends], np.maximum(lengths - _WORD, 0))
    return values


def _eight_digits(words: NDArray[np.uint64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of the last bytes of words, as many as lengths say; overwrites the words."""
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
