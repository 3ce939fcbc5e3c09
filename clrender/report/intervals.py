"""The little statistics that the report needs: t-intervals of means, of ratios and of slopes."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

__all__ = ["Interval", "mean_interval", "power_law", "ratio_interval", "scaled"]

_T_TABLE: Final = (
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120,
    2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
)  # fmt: skip
"""Student's t, 97.5 %, for 1 to 30 degrees of freedom; beyond, the last one: a little too wide."""


@dataclass(frozen=True)
class Interval:
    """An estimate and its 95 % interval; the bounds are infinite where one run alone was made."""

    value: float
    low: float
    high: float

    @property
    def known(self) -> bool:
        """Whether there are bounds."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def above(self, limit: float) -> bool:
        """All of it is above."""
        return self.low > limit

    def below(self, limit: float) -> bool:
        """All of it is below."""
        return self.high < limit

    def holds(self, number: float) -> bool:
        """The number is in it."""
        return self.low <= number <= self.high


def scaled(interval: Interval, factor: Callable[[float], float]) -> Interval:
    """Estimate and bounds, each through the same rising or falling function."""
    low, high = sorted((factor(interval.low), factor(interval.high)))
    return Interval(factor(interval.value), low, high)


def mean_interval(values: Sequence[float]) -> Interval:
    """Mean of independent values and its t-interval, which takes their mean to be normally distributed."""
    mean = statistics.fmean(values)
    if len(values) < 2:
        return Interval(mean, -math.inf, math.inf)
    half = _t(len(values) - 1) * statistics.stdev(values) / math.sqrt(len(values))
    return Interval(mean, mean - half, mean + half)


def ratio_interval(above: Sequence[float], below: Sequence[float]) -> Interval:
    """Ratio of geometric means of two independent sets of positive numbers, by Welch's interval of their logarithms."""
    a, b = [math.log(x) for x in above], [math.log(x) for x in below]
    ratio = statistics.fmean(a) - statistics.fmean(b)
    if min(len(a), len(b)) < 2:
        return Interval(math.exp(ratio), 0.0, math.inf)
    parts = [statistics.variance(x) / len(x) for x in (a, b)]
    total = sum(parts)
    if total == 0.0:
        return Interval(math.exp(ratio), math.exp(ratio), math.exp(ratio))
    # Welch and Satterthwaite: the degrees of freedom that fit two unequal variances.
    freedom = total**2 / sum(part**2 / (len(x) - 1) for part, x in zip(parts, (a, b), strict=True))
    half = _t(int(freedom)) * math.sqrt(total)
    return Interval(math.exp(ratio), math.exp(ratio - half), math.exp(ratio + half))


def power_law(points: Sequence[tuple[float, float]]) -> Interval:
    """Exponent p of y = c x^p by least squares of the logarithms; its interval holds the misfit to a power law too.

    Parameters
    ----------
    points : sequence of (x, y)
        Positive; at least three, at two places at least.
    """
    x, y = [math.log(point[0]) for point in points], [math.log(point[1]) for point in points]
    slope, intercept = statistics.linear_regression(x, y)
    if len(points) < 3:
        return Interval(slope, -math.inf, math.inf)
    middle = statistics.fmean(x)
    rest = sum((b - intercept - slope * a) ** 2 for a, b in zip(x, y, strict=True))
    error = math.sqrt(rest / (len(points) - 2) / sum((a - middle) ** 2 for a in x))
    half = _t(len(points) - 2) * error
    return Interval(slope, slope - half, slope + half)


def _t(freedom: int) -> float:
    return _T_TABLE[min(max(freedom, 1), len(_T_TABLE)) - 1]
