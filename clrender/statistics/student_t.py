"""Student's t distribution, for tests and confidence intervals from few values.

It is implemented here because this and `clrender.statistics.chi_squared` are all that clrender needs of a statistics
library. So `compare --integrators` and `furnace` work without SciPy; the tests compare with SciPy.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["SMALLEST", "critical_value", "p_value"]

Floats = npt.NDArray[np.float64]

SMALLEST: Final = 1e-300
"""Smallest probability that is resolved."""
_ITERATIONS: Final = 400


def p_value(t: npt.ArrayLike, df: npt.ArrayLike) -> Floats:
    """Two-sided p-value: the probability that Student's t is at least as far from 0 as `t`.

    P(|T| >= t) = I_x(ν/2, 1/2) with x = ν / (ν + t²), I the regularised incomplete beta function (Abramowitz and Stegun
    26.7.1). It is computed by its continued fraction (DLMF 8.17.22) where that converges fast, else by its complement.

    Parameters
    ----------
    t, df : float arrays of one shape, or broadcast to one
        Degrees of freedom above 0.
    """
    t_, nu = np.broadcast_arrays(np.asarray(t, np.float64), np.asarray(df, np.float64))
    flat, nu = np.abs(t_.ravel()), nu.ravel()
    result = np.where(flat == 0.0, 1.0, 0.0)
    inner = (flat > 0.0) & np.isfinite(flat)
    square, nu = flat[inner] ** 2, nu[inner]
    x, y = nu / (nu + square), square / (nu + square)
    a, b = nu / 2.0, np.full_like(nu, 0.5)
    swap = x >= (a + 1.0) / (a + b + 2.0)
    p, q, z = np.where(swap, b, a), np.where(swap, a, b), np.where(swap, y, x)
    # x^a (1 - x)^b / (a B(a, b)) is the same for the complement, except for the divisor a.
    front = np.exp(_log_gamma(a + b) - _log_gamma(a) - _log_gamma(b) + a * np.log(x) + b * np.log(y))
    part = front / p * _beta_fraction(p, q, z)
    result[inner] = np.clip(np.where(swap, 1.0 - part, part), 0.0, 1.0)
    return result.reshape(t_.shape)


def critical_value(probability: float, df: npt.ArrayLike) -> Floats:
    """The value that |t| exceeds with this probability: the inverse of `p_value`.

    It is found by Newton's method for log p as a function of log t, which is concave, so it converges from any start.

    Parameters
    ----------
    probability : float
        Two-sided, between 0 and 1: 0.05 for a 95 % interval.
    df : float array
        Degrees of freedom, at least 1.
    """
    nu = np.asarray(df, np.float64)
    t = np.full_like(nu, -NormalDist().inv_cdf(probability / 2.0))
    scale = _log_gamma((nu + 1.0) / 2.0) - _log_gamma(nu / 2.0) - 0.5 * np.log(nu * math.pi)
    for _ in range(60):
        p = np.maximum(p_value(t, nu), SMALLEST)
        density = np.exp(scale - (nu + 1.0) / 2.0 * np.log1p(t * t / nu))
        step = np.log(p / probability) * p / (2.0 * density * t)
        t = t * np.exp(step)
        if np.all(np.abs(step) < 1e-12):
            break
    return np.asarray(t, np.float64)


def _log_gamma(values: Floats) -> Floats:
    return np.array([math.lgamma(value) for value in values.ravel().tolist()], np.float64).reshape(values.shape)


def _beta_fraction(a: Floats, b: Floats, x: Floats) -> Floats:
    """The continued fraction of the incomplete beta function, by the method of Lentz (Applied Optics 15, 1976)."""
    c, d = np.ones_like(a), 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    value = d
    for m in range(1, _ITERATIONS):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        d, c = 1.0 / (1.0 + even * d), 1.0 + even / c
        value = value * (c * d)
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        d, c = 1.0 / (1.0 + odd * d), 1.0 + odd / c
        value = value * (c * d)
        if np.all(np.abs(c * d - 1.0) < 1e-14):
            break
    return value
