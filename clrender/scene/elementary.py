"""Elementary functions of arrays with the same bits on every machine: only additions, products, divisions and roots."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["arctangent", "degrees_of", "exponential"]

_Floats = NDArray[np.float64]

_LOG2_E: Final = 1.4426950408889634
_LN2_HIGH: Final = float.fromhex("0x1.62e42fee00000p-1")
_LN2_LOW: Final = float.fromhex("0x1.a39ef35793c76p-33")
"""Remainder of ln 2: products of the high part with integers below 2^20 are exact."""


def exponential(x: _Floats) -> _Floats:
    """Exponential, with a relative error below 5e-16; 0 for numbers below -740.

    Parameters
    ----------
    x : ndarray of float64
        At most 700.
    """
    x = np.maximum(x, -1000.0)
    doublings = np.rint(x * _LOG2_E)
    rest = (x - doublings * _LN2_HIGH) - doublings * _LN2_LOW
    total = np.ones_like(rest)
    for n in range(14, 0, -1):
        total = 1.0 + total * rest / n
    return np.ldexp(total, doublings.astype(np.int64))


def arctangent(x: _Floats) -> _Floats:
    """Arctangent of numbers from 0 to 1, radians.

    Parameters
    ----------
    x : ndarray of float64
    """
    for _ in range(2):  # reduces the angle to a quarter
        x = x / (1.0 + np.sqrt(1.0 + x * x))
    square, total = x * x, np.zeros_like(x)
    for n in range(27, 0, -2):
        total = 1.0 / n - square * total
    return 4.0 * x * total


def degrees_of(y: float, x: float) -> float:
    """Angle from the x axis towards the y axis, -180 to 180 degrees; 0 if both are 0.

    Parameters
    ----------
    y, x : float
    """
    largest = max(abs(x), abs(y))
    if largest == 0.0:
        return 0.0
    steep = abs(y) > abs(x)
    angle = float(arctangent(np.array([min(abs(x), abs(y)) / largest]))[0]) * (180.0 / math.pi)
    angle = 90.0 - angle if steep else angle
    angle = 180.0 - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle
