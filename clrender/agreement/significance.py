"""Significance tests for many quantities at once: Welch's t-test, Holm's correction, Grubbs' outlier test."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.statistics.student_t import SMALLEST, p_value

__all__ = ["Welch", "has_outlier", "holm", "welch"]

Floats = npt.NDArray[np.float64]

_NORMAL: Final = NormalDist()


@dataclass(frozen=True)
class Welch:
    """Welch's t-tests of k quantities, each attribute (k,) float64.

    Attributes
    ----------
    error : standard error of the difference of the means, first minus second
    df : degrees of freedom, by Welch and Satterthwaite
    p : two-sided p-value
    z : the standard normal deviate of that p-value, with the sign of the difference; within ±37.1
    """

    error: Floats
    df: Floats
    p: Floats
    z: Floats


def welch(
    first: npt.ArrayLike,
    second: npt.ArrayLike,
    rounding: npt.ArrayLike = 0.0,
    variance_floor: tuple[npt.ArrayLike, npt.ArrayLike] = (0.0, 0.0),
) -> Welch:
    """Welch's t-test of equal means, column by column; the variances may differ (Welch, Biometrika 34, 1947).

    Parameters
    ----------
    first, second : (n, k) and (m, k) float
        Rows: independent batches, at least two each. Columns: quantities.
    rounding : float or (k,) float
        Largest absolute difference due to rounding; it is subtracted before the test.
    variance_floor : pair of float or (k,) float
        Lower bounds of the variance of one batch, of the first and of the second.
    """
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    difference = a.mean(axis=0) - b.mean(axis=0)
    # Squared standard errors. Those of equal numbers are 0 apart from the rounding of their mean.
    u = np.maximum(a.var(axis=0, ddof=1), variance_floor[0]) / len(a)
    v = np.maximum(b.var(axis=0, ddof=1), variance_floor[1]) / len(b)
    error = np.sqrt(u + v)
    below = u * u / (len(a) - 1) + v * v / (len(b) - 1)
    df = np.full_like(error, float(min(len(a), len(b)) - 1))
    np.divide((u + v) ** 2, below, out=df, where=below > 0.0)
    beyond = np.maximum(np.abs(difference) - np.asarray(rounding, np.float64), 0.0)
    t = np.where(beyond > 0.0, np.inf, 0.0)
    np.divide(beyond, error, out=t, where=error > 0.0)
    p = p_value(t, df)
    return Welch(error, df, p, np.copysign(_normal_deviate(p), difference))


def holm(p_values: npt.ArrayLike, level: float) -> npt.NDArray[np.bool_]:
    """Which of many hypotheses to reject, with a probability of at most `level` to reject any that is true.

    Valid for any dependence between the tests (Holm, Scandinavian Journal of Statistics 6, 1979).

    Parameters
    ----------
    p_values : (k,) float
        Uncorrected p-value of each test.
    level : float
    """
    p = np.asarray(p_values, np.float64)
    order = np.argsort(p)
    kept = p[order] > level / (len(p) - np.arange(len(p)))
    rejected = np.zeros(len(p), bool)
    rejected[order[: int(kept.argmax()) if kept.any() else len(p)]] = True
    return rejected


def has_outlier(batches: npt.ArrayLike, level: float) -> npt.NDArray[np.bool_]:
    """Columns in which one batch is too far from the others for a normal distribution: Grubbs' test.

    (Grubbs, Annals of Mathematical Statistics 21, 1950.)

    Parameters
    ----------
    batches : (n, k) float
        At least three rows.
    level : float
        Probability that a column of normal numbers is marked.
    """
    rows = np.asarray(batches, np.float64)
    n = len(rows)
    deviation, spread = np.abs(rows - rows.mean(axis=0)).max(axis=0), rows.std(axis=0, ddof=1)
    square = np.divide(deviation, spread, out=np.zeros_like(spread), where=spread > 0.0) ** 2
    rest = (n - 1.0) ** 2 - n * square
    # The whole spread is due to one batch: t is infinite apart from rounding.
    t = np.sqrt(n * (n - 2.0) * square / np.maximum(rest, 1e-12))
    return np.asarray(n * p_value(t, np.full_like(t, n - 2.0)) < level, np.bool_)


def _normal_deviate(p: Floats) -> Floats:
    """Standard normal deviate with these two-sided p-values."""
    return np.array([-_NORMAL.inv_cdf(max(each, SMALLEST) / 2.0) for each in p.ravel().tolist()]).reshape(p.shape)
