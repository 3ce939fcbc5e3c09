"""Random numbers as a function of a key and a counter: integers only, so the same bits on every machine.

Philox4x32 with ten rounds (Salmon, Moraes, Dror and Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3", SC 2011).
Nothing advances: what is drawn for one thing does not depend on what was drawn for others.
"""

from __future__ import annotations

import hashlib
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["Draws", "key_of", "philox", "units"]

_Words = npt.NDArray[np.uint64]

_MULTIPLIERS: Final = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_WEYL: Final = (0x9E3779B9, 0xBB67AE85)
_LOW: Final = np.uint64(0xFFFFFFFF)
_HIGH: Final = np.uint64(32)
_ROUNDS: Final = 10


def key_of(seed: int, name: str) -> int:
    """A key of 64 bits for one purpose: the first bytes of the SHA-256 of both."""
    return int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:8], "little")


def philox(key: int, counter: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike, npt.ArrayLike]) -> _Words:
    """Four words of 32 bits for each counter.

    Parameters
    ----------
    key : int
        Of 64 bits.
    counter : four arrays of whole numbers below 2^32
        Broadcast against each other.

    Returns
    -------
    (4, ...) uint64
        Below 2^32, uniform.
    """
    a, b, c, d = np.broadcast_arrays(*(np.asarray(word, np.uint64) for word in counter))
    low, high = key & 0xFFFFFFFF, key >> 32 & 0xFFFFFFFF
    for _ in range(_ROUNDS):
        first, second = a * _MULTIPLIERS[0], c * _MULTIPLIERS[1]
        a, b, c, d = (
            (second >> _HIGH) ^ b ^ np.uint64(low),
            second & _LOW,
            (first >> _HIGH) ^ d ^ np.uint64(high),
            first & _LOW,
        )
        low, high = low + _WEYL[0] & 0xFFFFFFFF, high + _WEYL[1] & 0xFFFFFFFF
    return np.stack([a, b, c, d])


def units(words: _Words) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Two numbers in [0, 1), multiples of 2^-53, from four words of 32 bits.

    Parameters
    ----------
    words : (4, ...) uint64

    Returns
    -------
    two arrays of (...) float64
    """
    a, b, c, d = words
    pairs = [(high >> np.uint64(5)) * np.uint64(1 << 26) + (low >> np.uint64(6)) for high, low in ((a, b), (c, d))]
    return pairs[0] * 2.0**-53, pairs[1] * 2.0**-53


class Draws:
    """Random numbers for one purpose of one image, one after the other.

    Parameters
    ----------
    seed : int
    name : str
        The purpose: draws of other names are independent.
    index : int
        Of the image, below 2^64.
    """

    def __init__(self, seed: int, name: str, index: int) -> None:
        self._key, self._index, self._next = key_of(seed, name), index, 0

    def _words(self) -> _Words:
        counter = self._next, 0, self._index & 0xFFFFFFFF, self._index >> 32
        self._next += 1
        return philox(self._key, counter)

    def unit(self) -> float:
        """Uniform in [0, 1), a multiple of 2^-53."""
        return float(units(self._words())[0])

    def below(self, count: int) -> int:
        """A whole number from 0 to `count` - 1, all exactly equally probable; `count` is at most 2^63."""
        most = (1 << 64) // count * count
        while True:
            a, b = self._words()[:2].tolist()
            number = int(a) << 32 | int(b)
            if number < most:
                return number % count
