"""Elementary functions of arrays with the same bits on every machine: only additions, products, divisions and roots."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["angles_of", "arctangent", "degrees_of", "exponential", "logarithm", "power_two_fifths", "sines_cosines"]

_Floats = NDArray[np.float64]

_LOG2_E: Final = 1.4426950408889634
_QUARTER: Final = tuple(map(float.fromhex, ("0x1.921fb54400000p+0", "0x1.0b4611a600000p-34", "0x1.3198a2e037073p-69")))
"""Parts of π/2: products of the first two with integers below 2^20 are exact."""
_SQRT_HALF: Final = 0.7071067811865476
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


def logarithm(x: _Floats) -> _Floats:
    """Natural logarithm of positive numbers, with a relative error below 6e-16.

    Parameters
    ----------
    x : ndarray of float64
        Normal numbers.
    """
    share, doublings = np.frexp(x)
    small = share < _SQRT_HALF
    share, doublings = np.where(small, 2.0 * share, share), doublings - small
    slope = (share - 1.0) / (share + 1.0)
    square, total = slope * slope, np.zeros_like(slope)
    for n in range(23, 0, -2):
        total = 1.0 / n + square * total
    return doublings * _LN2_HIGH + (2.0 * slope * total + doublings * _LN2_LOW)


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


def angles_of(y: _Floats, x: _Floats) -> _Floats:
    """Angles from the x axis towards the y axis, radians, -π to π; 0 where both are 0.

    Parameters
    ----------
    y, x : ndarray of float64
    """
    up, along = np.abs(y), np.abs(x)
    largest = np.maximum(up, along)
    slope = np.divide(np.minimum(up, along), largest, out=np.zeros(np.shape(largest)), where=largest > 0.0)
    angle = arctangent(slope)
    angle = np.where(up > along, 0.5 * math.pi - angle, angle)
    angle = np.where(x < 0.0, math.pi - angle, angle)
    return np.where(y < 0.0, -angle, angle)


def sines_cosines(x: _Floats) -> tuple[_Floats, _Floats]:
    """Sines and cosines of angles of magnitude below 10^4, with errors below 3e-16.

    Parameters
    ----------
    x : ndarray of float64
        Radians.
    """
    quarter = np.rint(x * (2.0 / math.pi))
    rest = ((x - quarter * _QUARTER[0]) - quarter * _QUARTER[1]) - quarter * _QUARTER[2]
    square = rest * rest
    sine, cosine = np.ones_like(rest), np.ones_like(rest)
    for n in range(18, 0, -2):
        sine = 1.0 - square * sine / (n * (n + 1))
        cosine = 1.0 - square * cosine / (n * (n - 1))
    sine = rest * sine
    turn = quarter.astype(np.int64) % 4
    swapped = turn % 2 == 1
    sine, cosine = np.where(swapped, cosine, sine), np.where(swapped, sine, cosine)
    return np.where(turn >= 2, -sine, sine), np.where((turn == 1) | (turn == 2), -cosine, cosine)


def power_two_fifths(x: _Floats) -> _Floats:
    """x^0.4 of numbers from 0.01 to 4: the fifth root of the square, by Newton's method.

    Parameters
    ----------
    x : ndarray of float64
    """
    square = x * x
    value = 0.45 + 0.55 * x
    for _ in range(7):
        fourth = value * value * (value * value)
        value = value - (value - square / fourth) / 5.0
    return value


def degrees_of(y: float, x: float) -> float:
    """Angle from the x axis towards the y axis, -180 to 180 degrees; 0 if both are 0."""
    largest = max(abs(x), abs(y))
    if largest == 0.0:
        return 0.0
    steep = abs(y) > abs(x)
    angle = float(arctangent(np.array([min(abs(x), abs(y)) / largest]))[0]) * (180.0 / math.pi)
    angle = 90.0 - angle if steep else angle
    angle = 180.0 - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle
