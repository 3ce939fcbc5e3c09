"""Whether two ways to measure the same thing have the same mean: Welch's t-test, and corrections for many tests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["Welch", "holm", "outlying", "student_limit", "student_tails", "welch"]

Floats = npt.NDArray[np.float64]

_LEAST: Final = 1e-300
"""Chances below it are not told apart: its normal score, 37, says enough."""
_ROUNDS: Final = 400
_NORMAL: Final = NormalDist()


@dataclass(frozen=True)
class Welch:
    """What a test says of many quantities at once, each (k,) float64.

    Attributes
    ----------
    difference : mean of the first minus mean of the second
    error : standard error of the difference
    freedom : degrees of freedom
    chance : of a difference as large as this, or larger, when the means are equal
    score : what a standard normal number of that chance would be, with the sign of the difference; within ±37.1
    """

    difference: Floats
    error: Floats
    freedom: Floats
    chance: Floats
    score: Floats


def welch(
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    rounding: npt.ArrayLike = 0.0,
    least: tuple[npt.ArrayLike, npt.ArrayLike] = (0.0, 0.0),
) -> Welch:
    """Welch's t-test of equal means, column by column; the variances may differ (Welch, Biometrika 34, 1947).

    Parameters
    ----------
    first, second : (n, k) and (m, k) float
        Rows: independent batches, at least two of each. Columns: quantities.
    rounding : float or (k,) float
        Absolute difference that is not noise but rounding; it is taken off before the test.
    least : pair of float or (k,) float
        Variances of a batch of the first and of the second that are known to be no smaller.
    """
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    difference = a.mean(axis=0) - b.mean(axis=0)
    # Squared standard errors. Those of equal numbers are 0 but for the rounding of their mean.
    u = np.maximum(a.var(axis=0, ddof=1), least[0]) / len(a)
    v = np.maximum(b.var(axis=0, ddof=1), least[1]) / len(b)
    error = np.sqrt(u + v)
    below = u * u / (len(a) - 1) + v * v / (len(b) - 1)
    freedom = np.full_like(error, float(min(len(a), len(b)) - 1))
    np.divide((u + v) ** 2, below, out=freedom, where=below > 0.0)
    beyond = np.maximum(np.abs(difference) - np.asarray(rounding, np.float64), 0.0)
    t = np.where(beyond > 0.0, np.inf, 0.0)
    np.divide(beyond, error, out=t, where=error > 0.0)
    chance = student_tails(t, freedom)
    return Welch(difference, error, freedom, chance, np.copysign(_normal_score(chance), difference))


def student_tails(t: npt.ArrayLike, freedom: npt.ArrayLike) -> Floats:
    """Chance that Student's t is as far from 0 as `t`, on either side.

    P(|T| >= t) = I_x(ν/2, 1/2) with x = ν / (ν + t²), I the regularised incomplete beta function (Abramowitz and
    Stegun 26.7.1), by its continued fraction (DLMF 8.17.22) where that converges fast, else by its complement.

    Parameters
    ----------
    t, freedom : float arrays of one shape, or broadcast to one
        `freedom` above 0.
    """
    t_, nu = np.broadcast_arrays(np.asarray(t, np.float64), np.asarray(freedom, np.float64))
    flat, nu = np.abs(t_.ravel()), nu.ravel()
    result = np.where(flat == 0.0, 1.0, 0.0)
    inner = (flat > 0.0) & np.isfinite(flat)
    square, nu = flat[inner] ** 2, nu[inner]
    x, y = nu / (nu + square), square / (nu + square)
    a, b = nu / 2.0, np.full_like(nu, 0.5)
    swap = x >= (a + 1.0) / (a + b + 2.0)
    p, q, z = np.where(swap, b, a), np.where(swap, a, b), np.where(swap, y, x)
    # x^a (1 - x)^b / (a B(a, b)) is the same for the complement, but for the a it is divided by.
    front = np.exp(_log_gamma(a + b) - _log_gamma(a) - _log_gamma(b) + a * np.log(x) + b * np.log(y))
    part = front / p * _beta_fraction(p, q, z)
    result[inner] = np.clip(np.where(swap, 1.0 - part, part), 0.0, 1.0)
    return result.reshape(t_.shape)


def student_limit(chance: float, freedom: npt.ArrayLike) -> Floats:
    """What |t| exceeds with this chance: `student_tails` inverted.

    By Newton's method for the logarithm of the chance over that of t, which is concave: it converges from anywhere.
    """
    nu = np.asarray(freedom, np.float64)
    t = np.full_like(nu, -_NORMAL.inv_cdf(chance / 2.0))
    scale = _log_gamma((nu + 1.0) / 2.0) - _log_gamma(nu / 2.0) - 0.5 * np.log(nu * math.pi)
    for _ in range(60):
        p = np.maximum(student_tails(t, nu), _LEAST)
        density = np.exp(scale - (nu + 1.0) / 2.0 * np.log1p(t * t / nu))
        step = np.log(p / chance) * p / (2.0 * density * t)
        t = t * np.exp(step)
        if np.all(np.abs(step) < 1e-12):
            break
    return np.asarray(t, np.float64)


def holm(chances: npt.ArrayLike, level: float) -> npt.NDArray[np.bool_]:
    """Which of many hypotheses to give up, with a chance of at most `level` to give up any that is true.

    Whatever the tests have to do with each other (Holm, Scandinavian Journal of Statistics 6, 1979).

    Parameters
    ----------
    chances : (k,) float
        Each test's own.
    level : float
    """
    p = np.asarray(chances, np.float64)
    order = np.argsort(p)
    kept = p[order] > level / (len(p) - np.arange(len(p)))
    rejected = np.zeros(len(p), bool)
    rejected[order[: int(kept.argmax()) if kept.any() else len(p)]] = True
    return rejected


def outlying(batches: npt.ArrayLike, level: float) -> npt.NDArray[np.bool_]:
    """Columns in which one batch lies so far from the others that they cannot be normal: Grubbs' test.

    (Grubbs, Annals of Mathematical Statistics 21, 1950.)

    Parameters
    ----------
    batches : (n, k) float
        At least three rows.
    level : float
        Chance that a column of normal numbers is named.
    """
    rows = np.asarray(batches, np.float64)
    n = len(rows)
    deviation, spread = np.abs(rows - rows.mean(axis=0)).max(axis=0), rows.std(axis=0, ddof=1)
    square = np.divide(deviation, spread, out=np.zeros_like(spread), where=spread > 0.0) ** 2
    rest = (n - 1.0) ** 2 - n * square
    # All of the spread is one batch's: t is infinite, but for rounding.
    t = np.sqrt(n * (n - 2.0) * square / np.maximum(rest, 1e-12))
    return np.asarray(n * student_tails(t, np.full_like(t, n - 2.0)) < level, np.bool_)


def _normal_score(chances: Floats) -> Floats:
    """Standard normal number that is exceeded, on either side, with these chances."""
    return np.array([-_NORMAL.inv_cdf(max(p, _LEAST) / 2.0) for p in chances.ravel().tolist()]).reshape(chances.shape)


def _log_gamma(values: Floats) -> Floats:
    return np.array([math.lgamma(value) for value in values.ravel().tolist()], np.float64).reshape(values.shape)


def _beta_fraction(a: Floats, b: Floats, x: Floats) -> Floats:
    """The continued fraction of the incomplete beta function, by the method of Lentz (Applied Optics 15, 1976)."""
    c, d = np.ones_like(a), 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    value = d
    for m in range(1, _ROUNDS):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        d, c = 1.0 / (1.0 + even * d), 1.0 + even / c
        value = value * (c * d)
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        d, c = 1.0 / (1.0 + odd * d), 1.0 + odd / c
        value = value * (c * d)
        if np.all(np.abs(c * d - 1.0) < 1e-14):
            break
    return value
