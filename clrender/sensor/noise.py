"""Random numbers of Poisson's and Gauss's laws for many pixels, from counters: the same bits on every machine."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.exact.elementary import exponential, logarithm, sines_cosines

__all__ = ["Uniforms", "normal", "poisson"]

_Floats = npt.NDArray[np.float64]
Uniforms: TypeAlias = Callable[[npt.NDArray[np.int64], int], tuple[_Floats, _Floats]]
"""Two numbers in [0, 1) for each of some pixels (indices), for this attempt."""

_SMALL: Final = 10.0
_MOST_STEPS: Final = 200
_HALF_LOG_TAU: Final = 0.9189385332046728
"""Half of the logarithm of 2 pi."""


def poisson(means: _Floats, uniforms: Uniforms) -> npt.NDArray[np.int64]:
    """Numbers of Poisson's law.

    Means below 10 by inversion of the distribution function, others by transformed rejection (Hormann, "The transformed
    rejection method for generating Poisson random variables", 1993, algorithm PTRS): exact laws, up to the rounding of
    double precision.

    Parameters
    ----------
    means : (n,) float64
        From 0 to 1e9.
    uniforms : callable
        Called with indices of `means`, and the number of the attempt.

    Returns
    -------
    (n,) int64
    """
    found = np.zeros(len(means), np.int64)
    few = np.flatnonzero((means > 0.0) & (means < _SMALL))
    if len(few):
        found[few] = _inverted(means[few], uniforms(few, 0)[0])
    pending, attempt = np.flatnonzero(means >= _SMALL), 0
    while len(pending):
        number, accepted = _tried(means[pending], *uniforms(pending, attempt))
        found[pending[accepted]] = number[accepted]
        pending, attempt = pending[~accepted], attempt + 1
    return found


def _inverted(means: _Floats, u: _Floats) -> npt.NDArray[np.int64]:
    """The smallest numbers whose distribution function is above u."""
    term = exponential(-means)
    total, number = term.copy(), np.zeros(len(means), np.int64)
    for k in range(1, _MOST_STEPS):
        above = u >= total
        if not above.any():
            break
        term = term * means / k
        total = total + term
        number[above] = k
    return number


def _tried(means: _Floats, u: _Floats, v: _Floats) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """An attempt of PTRS: numbers, and which of them are accepted."""
    b = 0.931 + 2.53 * np.sqrt(means)
    a = -0.059 + 0.02483 * b
    u = u - 0.5
    v = np.maximum(v, 2.0**-54)
    side = np.maximum(0.5 - np.abs(u), 2.0**-54)
    number = np.floor((2.0 * a / side + b) * u + means + 0.43)
    quick = (side >= 0.07) & (v <= 0.9277 - 3.6224 / (b - 2.0))
    possible = (number >= 0.0) & ((side >= 0.013) | (v <= side))
    k = np.maximum(number, 0.0)
    left = logarithm(v) + logarithm(1.1239 + 1.1328 / (b - 3.4)) - logarithm(a / (side * side) + b)
    right = k * logarithm(means) - means - _log_factorial(k)
    return number.astype(np.int64), quick | (possible & (left <= right))


def _log_factorial(k: _Floats) -> _Floats:
    """Logarithm of k!: Stirling's series, whose error is below 1e-14 from 10 on, after a product of ten factors."""
    factors = np.ones_like(k)
    for step in range(1, 11):
        factors = factors * (k + step)
    x = k + 11.0
    inverse = 1.0 / x
    square = inverse * inverse
    series = inverse * (1 / 12 - square * (1 / 360 - square * (1 / 1260 - square * (1 / 1680 - square / 1188))))
    # (k + 10)! by the series, without the ten factors
    whole = (x - 0.5) * logarithm(x) - x + _HALF_LOG_TAU + series
    return np.asarray(whole - logarithm(factors))


def normal(pixels: npt.NDArray[np.int64], uniforms: Uniforms) -> _Floats:
    """Numbers of the normal law with a mean of 0 and a variance of 1 (Box and Muller 1958).

    Parameters
    ----------
    pixels : (n,) int64
        Indices.
    uniforms : callable
        Called with the indices, and 0.

    Returns
    -------
    (n,) float64
    """
    u, v = uniforms(pixels, 0)
    return np.sqrt(-2.0 * logarithm(1.0 - u)) * sines_cosines((2.0 * math.pi) * v)[1]
