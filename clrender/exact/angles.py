"""Elementary functions of single numbers, correctly rounded in practice: from integers or decimals of many digits.

So they have the same bits on every machine, whatever its maths library.
"""

from __future__ import annotations

import math
from decimal import Context, Decimal
from functools import lru_cache
from typing import Final

__all__ = [
    "angle_of",
    "arccosine",
    "exponential_minus_one",
    "exponential_of",
    "logarithm_of",
    "power_of_two",
    "root",
    "sin_cos",
    "sin_cos_degrees",
    "tan_degrees",
    "tangent",
]

_CONTEXT: Final = Context(prec=50)
_PI: Final = Decimal("3.14159265358979323846264338327950288419716939937510582")
_LN2: Final = Decimal("0.693147180559945309417232121458176568075500134360255254")
_BITS: Final = 220
_SPARE: Final = 40
"""Bits below those of the last term of a series."""
_HALF_PI: Final = 0x1921FB54442D18469898CC51701B839A252049C1114CF98E804177D4
_TINY: Final = 2.0**-60
"""A slope or an angle this small is equal to its tangent and its sine."""


def _series(x: Decimal, first: Decimal, start: int) -> Decimal:
    """Alternating Taylor series of sine (start 1) or cosine (start 0)."""
    square, term, total, n = _CONTEXT.multiply(x, x), first, first, start
    while abs(term) > Decimal("1e-45"):
        term = _CONTEXT.divide(_CONTEXT.multiply(-term, square), Decimal((n + 1) * (n + 2)))
        total, n = _CONTEXT.add(total, term), n + 2
    return total


def _fixed(x: float) -> int:
    """A number in units of 2^-`_BITS`."""
    numerator, denominator = x.as_integer_ratio()
    return (numerator << _BITS) // denominator


def _fixed_sin_cos(angle: int) -> tuple[int, int]:
    """Sine and cosine of an angle in radians; all in units of 2^-`_BITS`."""
    quarter = (2 * angle + _HALF_PI) // (2 * _HALF_PI)
    x = angle - quarter * _HALF_PI
    square = x * x >> _BITS
    sums = []
    for term, start in ((x, 1), (1 << _BITS, 0)):
        total, n = term, start
        while abs(term) > 1 << _SPARE:
            n += 2
            term = -(term * square >> _BITS) // (n * (n - 1))
            total += term
        sums.append(total)
    sine, cosine = sums
    return [(sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine)][quarter % 4]


@lru_cache(maxsize=4096)
def sin_cos(angle: float) -> tuple[float, float]:
    """Sine and cosine.

    Parameters
    ----------
    angle : float
        Radians, of magnitude below 10^6.

    Returns
    -------
    sine, cosine : float
    """
    if abs(angle) < _TINY:
        return angle + 0.0, 1.0  # the cache does not tell -0 from 0
    sine, cosine = _fixed_sin_cos(_fixed(angle))
    return sine / (1 << _BITS), cosine / (1 << _BITS)


def tangent(angle: float) -> float:
    """Tangent of an angle in radians, of magnitude below 10^6."""
    if abs(angle) < _TINY:
        return angle
    sine, cosine = _fixed_sin_cos(_fixed(angle))
    return sine / cosine


def angle_of(y: float, x: float) -> float:
    """Angle from the x axis towards the y axis, radians, -π to π: like `math.atan2`, whose result it corrects.

    Parameters
    ----------
    y, x : float
        Finite.
    """
    if y == 0.0 or x == 0.0 or abs(x) < _TINY * abs(y):
        return math.atan2(y, x)  # a multiple of π/2
    if abs(y) < _TINY * abs(x):
        return y / x if x > 0.0 else math.copysign(math.pi, y)
    shift = math.frexp(max(abs(y), abs(x)))[1]
    up, along = (_fixed(math.ldexp(each, -shift)) for each in (y, x))
    return _angle_of(up, along, math.atan2(y, x))


def _angle_of(y: int, x: int, near: float) -> float:
    """The angle of a fixed-point vector from one that is near: two terms of the series of their difference do."""
    sine, cosine = _fixed_sin_cos(_fixed(near))
    slope = ((y * cosine - x * sine) << _BITS) // (x * cosine + y * sine)
    third = (slope * slope >> _BITS) * slope // 3 >> _BITS
    return (_fixed(near) + slope - third) / (1 << _BITS)


def arccosine(cosine: float) -> float:
    """Arccosine of a number from -1 to 1, radians."""
    if abs(cosine) == 1.0 or abs(cosine) < _TINY:
        return math.acos(cosine)
    x = _fixed(cosine)
    return _angle_of(math.isqrt((1 << 2 * _BITS) - x * x), x, math.acos(cosine))


def exponential_minus_one(x: float) -> float:
    """exp(x) - 1; infinite beyond 709."""
    if x > 709.0:
        return math.inf
    return float(_CONTEXT.subtract(_CONTEXT.exp(Decimal(x)), Decimal(1)))


def exponential_of(x: float) -> float:
    """exp(x) of a number of magnitude below 700."""
    return float(_CONTEXT.exp(Decimal(x)))


def logarithm_of(x: float) -> float:
    """Natural logarithm of a positive number."""
    return float(_CONTEXT.ln(Decimal(x)))


def power_of_two(x: float) -> float:
    """2^x of a number of magnitude below 1000."""
    whole = math.floor(x)
    return math.ldexp(float(_CONTEXT.exp(_CONTEXT.multiply(Decimal(x - whole), _LN2))), whole)


def root(x: float, degree: int) -> float:
    """The root of a number that is not negative.

    Parameters
    ----------
    x : float
    degree : int
        At least 2.
    """
    if x in (0.0, math.inf):
        return x
    power = _CONTEXT.divide(_CONTEXT.ln(Decimal(x)), Decimal(degree))
    return float(_CONTEXT.exp(power))


@lru_cache(maxsize=4096)
def sin_cos_degrees(angle: float) -> tuple[float, float]:
    """Sine and cosine, correctly rounded in practice and exact at multiples of 90.

    Parameters
    ----------
    angle : float
        Degrees, finite.

    Returns
    -------
    sine, cosine : float
    """
    turn = math.fmod(angle, 360.0) + 0.0  # the cache does not tell -0 from 0
    quarter = round(turn / 90.0)
    rest = _CONTEXT.subtract(Decimal(turn), Decimal(90 * quarter))
    x = _CONTEXT.divide(_CONTEXT.multiply(rest, _PI), Decimal(180))
    sine, cosine = float(_series(x, x, 1)), float(_series(x, Decimal(1), 0))
    return [(sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine)][quarter % 4]


def tan_degrees(angle: float) -> float:
    """Tangent of an angle below 90 degrees."""
    sine, cosine = sin_cos_degrees(angle)
    return sine / cosine
