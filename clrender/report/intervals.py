"""95 % confidence intervals of means, of ratios and of slopes."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from clrender.statistics.student_t import critical_value

__all__ = ["Interval", "mean_interval", "power_law", "ratio_interval", "scaled"]


@dataclass(frozen=True)
class Interval:
    """An estimate and its 95 % confidence interval; the bounds are infinite if there is only one run."""

    value: float
    low: float
    high: float

    @property
    def known(self) -> bool:
        """Whether the bounds are finite."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def above(self, limit: float) -> bool:
        """Whether the whole interval is above the limit."""
        return self.low > limit

    def below(self, limit: float) -> bool:
        """Whether the whole interval is below the limit."""
        return self.high < limit

    def holds(self, number: float) -> bool:
        """Whether it contains the number."""
        return self.low <= number <= self.high


def scaled(interval: Interval, factor: Callable[[float], float]) -> Interval:
    """Estimate and bounds, each mapped by the same monotonic function."""
    low, high = sorted((factor(interval.low), factor(interval.high)))
    return Interval(factor(interval.value), low, high)


def mean_interval(values: Sequence[float]) -> Interval:
    """Mean of independent values and its t-interval, which assumes that their mean is normally distributed."""
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
    # Degrees of freedom for unequal variances (Welch-Satterthwaite).
    df = total**2 / sum(part**2 / (len(x) - 1) for part, x in zip(parts, (a, b), strict=True))
    half = _t(df) * math.sqrt(total)
    return Interval(math.exp(ratio), math.exp(ratio - half), math.exp(ratio + half))


def power_law(points: Sequence[tuple[float, float]]) -> Interval:
    """Exponent p of y = c x^p by least squares of the logarithms; the interval includes the misfit to a power law.

    Parameters
    ----------
    points : sequence of (x, y)
        Positive; at least three points, with at least two different x.
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


def _t(df: float) -> float:
    return float(critical_value(0.05, max(df, 1.0)))
