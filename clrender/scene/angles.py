"""Sine and cosine of degrees with the same bits on every machine, whatever its maths library."""

from __future__ import annotations

import math
from decimal import Context, Decimal
from functools import lru_cache
from typing import Final

__all__ = ["sin_cos_degrees", "tan_degrees"]

_CONTEXT: Final = Context(prec=50)
_PI: Final = Decimal("3.14159265358979323846264338327950288419716939937510582")


def _series(x: Decimal, first: Decimal, start: int) -> Decimal:
    """Alternating Taylor series of sine (start 1) or cosine (start 0)."""
    square, term, total, n = _CONTEXT.multiply(x, x), first, first, start
    while abs(term) > Decimal("1e-45"):
        term = _CONTEXT.divide(_CONTEXT.multiply(-term, square), Decimal((n + 1) * (n + 2)))
        total, n = _CONTEXT.add(total, term), n + 2
    return total


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
    turn = math.fmod(angle, 360.0)
    quarter = round(turn / 90.0)
    rest = _CONTEXT.subtract(Decimal(turn), Decimal(90 * quarter))
    x = _CONTEXT.divide(_CONTEXT.multiply(rest, _PI), Decimal(180))
    sine, cosine = float(_series(x, x, 1)), float(_series(x, Decimal(1), 0))
    return [(sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine)][quarter % 4]


def tan_degrees(angle: float) -> float:
    """Tangent of an angle below 90 degrees."""
    sine, cosine = sin_cos_degrees(angle)
    return sine / cosine
