"""Pearson's chi-squared test of counts against probabilities, without a statistics library."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["Fit", "goodness_of_fit", "survival"]

_FEWEST: Final = 5.0
"""Fewest expected events per cell: below it the statistic does not follow the chi-squared distribution."""
_TERMS: Final = 10_000


@dataclass(frozen=True)
class Fit:
    """Result of the test of counts against probabilities.

    Attributes
    ----------
    statistic : float
        Pearson's statistic.
    freedom : int
        Its degrees of freedom; 0 if there is only one cell, so that there is nothing to test.
    p : float
        Probability of a statistic at least as large if the probabilities are right.
    """

    statistic: float
    freedom: int
    p: float


def survival(x: float, freedom: int) -> float:
    """Probability that χ² with `freedom` degrees of freedom exceeds `x`: Q(freedom / 2, x / 2).

    Q is the regularised upper incomplete gamma function: one minus its series (DLMF 8.11.4) below the mean, its
    continued fraction (DLMF 8.9.2, by the method of Lentz) above.

    Parameters
    ----------
    x : float
    freedom : int
        At least 1.
    """
    if x <= 0.0:
        return 1.0
    if not math.isfinite(x):
        return 0.0
    a, y = freedom / 2.0, x / 2.0
    front = a * math.log(y) - y - math.lgamma(a)
    if y < a + 1.0:
        term = total = 1.0 / a
        for n in range(1, _TERMS):
            term *= y / (a + n)
            total += term
            if term < total * 1e-16:
                break
        return max(1.0 - total * math.exp(front), 0.0)
    b = y + 1.0 - a
    c, d = math.inf, 1.0 / b
    value = d
    for n in range(1, _TERMS):
        step = -n * (n - a)
        b += 2.0
        d = 1.0 / (b + step * d)
        c = b + step / c
        value *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return min(value * math.exp(front), 1.0) if front > -740.0 else 0.0


def goodness_of_fit(counts: npt.ArrayLike, chances: npt.ArrayLike) -> Fit:
    """Pearson's test; cells in which fewer than 5 events are expected are merged.

    Parameters
    ----------
    counts : (k,) int
        Independent events in each cell.
    chances : (k,) float
        Probability of each cell. They are not normalized, so that the test also covers that their sum is 1.
    """
    seen, expected = np.asarray(counts, np.float64), np.asarray(chances, np.float64) * np.sum(counts)
    order = np.argsort(expected)
    seen, expected = seen[order], expected[order]
    few = int(np.count_nonzero(expected < _FEWEST))
    if few:
        # Add the smallest remaining cells until the merged cell is large enough
        few = max(few, 1 + int(np.searchsorted(np.cumsum(expected), _FEWEST)))
        seen = np.append(seen[few:], seen[:few].sum())
        expected = np.append(expected[few:], expected[:few].sum())
    if len(expected) < 2:
        return Fit(0.0, 0, 1.0)
    statistic = float((np.square(seen - expected) / np.maximum(expected, 1e-300)).sum())
    return Fit(statistic, len(expected) - 1, survival(statistic, len(expected) - 1))
