"""Logarithmic axes of plots: few ticks, labelled with plain numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["log_axis", "log_ticks", "plain_number"]

_MOST: Final = 7
"""Labels of an axis, at most: as many as are legible side by side."""
_FEWEST: Final = 3
_SUBDIVISIONS: Final = ((1, 2, 3, 4, 5, 6, 7, 8, 9), (1, 2, 5), (1,), (1, 3))
"""Ticks of a decade, in the order in which they are tried."""
_MARGIN: Final = 0.06
"""Space beyond the data at each end, as a fraction of the axis."""
_PLAIN: Final = 1e-6
"""Smaller numbers have too many zeros to count and are written with an exponent."""
_SUPERSCRIPTS: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def log_ticks(low: float, high: float) -> list[float]:
    """Ticks of a logarithmic axis: 1, 2, 5 and so on in each decade, or every n-th power of ten.

    Parameters
    ----------
    low, high : float
        Ends of the axis, above 0.

    Returns
    -------
    list of float
        Ascending, at most seven. If less than a decade holds fewer than three of them, they are evenly spaced.
    """
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in _SUBDIVISIONS:
        ticks = _within(low, high, [step * _power(decade) for decade in decades for step in steps])
        if _FEWEST <= len(ticks) <= _MOST:
            return ticks
    if len(ticks) < _FEWEST or high < 10.0 * low:
        return _even_ticks(low, high)
    every = len(decades) // _MOST + 1
    return _within(low, high, [_power(decade) for decade in decades if decade % every == 0])


def plain_number(value: float, percent: bool = False) -> str:
    """A number for a label, as 1,000 or 0.05, never as 5e-02.

    Parameters
    ----------
    value : float
    percent : bool
        Write it as a percentage: 0.001 as 0.1 %.
    """
    unit = " %" if percent else ""
    value = float(f"{100.0 * value if percent else value:.10g}")
    if value == 0.0 or abs(value) >= _PLAIN:
        digits = 0 if value == 0.0 else max(0, 10 - math.floor(math.log10(abs(value))))
        text = f"{value:,.{digits}f}"
        return (text.rstrip("0").rstrip(".") if "." in text else text) + unit
    mantissa, exponent = f"{value:.9e}".split("e")
    return f"{float(mantissa):g} × 10{str(int(exponent)).translate(_SUPERSCRIPTS)}{unit}"


def log_axis(axes: Axes, which: Literal["x", "y"], values: Sequence[float], percent: bool = False) -> None:
    """Make an axis logarithmic, with its ends a little beyond the values.

    Parameters
    ----------
    axes : matplotlib Axes
    which : {"x", "y"}
    values : sequence of float
        What it has to show; numbers above 0.
    percent : bool
        Label it with percentages.
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    spread = max(math.log(max(values) / min(values)), 0.1)
    low, high = (
        math.exp(math.log(end) + sign * _MARGIN * spread) for end, sign in ((min(values), -1.0), (max(values), 1.0))
    )
    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)
    axis.set_major_locator(FixedLocator(log_ticks(low, high)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value, percent)))


def _within(low: float, high: float, ticks: Sequence[float]) -> list[float]:
    return [tick for tick in ticks if low <= tick <= high]


def _even_ticks(low: float, high: float) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten."""
    unit = _power(math.floor(math.log10((high - low) / _MOST)))
    for factor in (1, 2, 5, 10):
        step = factor * unit
        first, last = math.ceil(low / step), math.floor(high / step)
        if last - first < _MOST:
            break
    return [float(f"{step * number:.10g}") for number in range(first, last + 1)]


def _power(decade: int) -> float:
    return float(f"1e{decade}")
