"""Numbers as text: intervals, factors, percentages."""

from __future__ import annotations

import math

from clrender.report.intervals import Interval

__all__ = ["bounds", "factor", "percent", "significant"]


def significant(value: float, digits: int = 3) -> str:
    """A number with this many significant digits, without an exponent if that is readable."""
    if value == 0.0 or not math.isfinite(value):
        return "0" if value == 0.0 else "–"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    if places > 6:
        return f"{value:.{digits - 1}e}"
    return f"{round(value, places):,.{max(places, 0)}f}".replace(",", " ")


def factor(value: float) -> str:
    """A factor, such as ×1.71."""
    return f"×{significant(value)}"


def percent(value: float) -> str:
    """A fraction as a percentage, such as 12.3 %."""
    return f"{100.0 * value:.1f} %"


def bounds(interval: Interval, sign: str = "", *, percent: bool = False) -> str:
    """An estimate with its interval, such as ×1.08 (1.05 to 1.11)."""
    if percent:
        told = f"{100.0 * interval.value:+.2f} %"
        return told + (f" ({100.0 * interval.low:+.2f} to {100.0 * interval.high:+.2f})" if interval.known else "")
    told = f"{sign}{interval.value:.2f}"
    # A ratio of single runs has the bounds 0 and infinity, that is, none.
    return told + (f" ({interval.low:.2f} to {interval.high:.2f})" if interval.known else "")
