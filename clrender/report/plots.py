"""The report's plots: time and noise against samples, noise at equal time against shadow rays."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from clrender.drawing.svg import BLUE, GREY, ORANGE, draw
from clrender.report.founding import GROUPS
from clrender.report.intervals import Interval, mean_interval
from clrender.report.results import Results, Row, Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Plot", "Series", "plot", "plots"]

_Point = tuple[float, float, float, float]


@dataclass(frozen=True)
class Plot:
    """A plot and its caption.

    Attributes
    ----------
    name : str
        Name of its file.
    caption : str
    svg : str
    """

    name: str
    caption: str
    svg: str


@dataclass(frozen=True)
class Series:
    """Points of one kind.

    Attributes
    ----------
    title : str
        For the legend.
    points : sequence of (x, y, low, high)
        `low` and `high` equal to y: no error bar.
    colour : str
    style : str
        Matplotlib style of marker and line: ``o-``, ``o``, ``--``.
    """

    title: str
    points: Sequence[_Point]
    colour: str
    style: str = "o-"


def plots(results: Results) -> list[Plot]:
    """All plots of the report."""
    return [_time(results), _noise(results), _shadow(results)]


def plot(
    name: str, caption: str, axes_titles: tuple[str, str], series: Sequence[Series], x_ticks: Sequence[float],
    logarithmic: bool = True,
) -> Plot:  # fmt: skip
    """Draw series of points.

    Parameters
    ----------
    name, caption : str
    axes_titles : (str, str)
        Titles of x and y.
    series : sequence of Series
    x_ticks : sequence of float
    logarithmic : bool
        Whether both axes are logarithmic; else both begin at 0.
    """

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel=axes_titles[0], ylabel=axes_titles[1])
        for each in series:
            x, y, low, high = zip(*each.points, strict=True)
            bars = [[b - a for a, b in zip(low, y, strict=True)], [b - a for a, b in zip(y, high, strict=True)]]
            known = bars if any(map(any, bars)) else None
            axes.errorbar(x, y, known, fmt=each.style, color=each.colour, label=each.title, capsize=4.0)
        if logarithmic:
            _logarithmic(axes, [y for each in series for _, y, _, _ in each.points if y > 0.0])
        else:
            axes.set_xlim(left=0.0, right=1.1 * max(x_ticks))
            axes.set_ylim(bottom=0.0)
        axes.set_xticks(list(x_ticks))
        axes.set_xticks([], minor=True)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:,.10g}")
        axes.grid()
        figure.legend(loc="outside upper left")

    return Plot(name, caption, draw(name, caption, (8.4, 5.2), paint))


def _logarithmic(axes: Axes, values: Sequence[float]) -> None:
    """Both axes logarithmic, with a label at each decade of y, or at more values if there are few decades."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.set_yscale("log")
    decades = math.log10(max(values) / min(values)) if values else 1.0
    subs = (1.0,) if decades > 2.5 else (1.0, 2.0, 5.0) if decades > 1.0 else (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
    axes.yaxis.set_major_locator(LogLocator(subs=subs))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _time(results: Results) -> Plot:
    theirs = [(float(row.samples), float(row.seconds)) for row in reversed(GROUPS[0].rows)]
    ours = _sampled(results, "samples-", _seconds)
    own = _sampled(results, "own-samples-", _seconds)
    first = next(point for point in ours if point[0] == theirs[0][0])
    ratio = [(n, first[1] * seconds / theirs[0][1]) for n, seconds in theirs]
    series = [
        Series("the report, on an unnamed processor", [_bare(*p) for p in theirs], GREY),
        Series("clrender, the report's settings", ours, BLUE),
        Series("clrender, its own roulette", own, ORANGE),
        Series("the report's ratios, from clrender's time at 16 samples", [_bare(*p) for p in ratio], GREY, "--"),
    ]
    caption = "Seconds against samples per pixel, two shadow rays; medians, bars: shortest and longest run"
    return plot("time", caption, ("samples per pixel", "seconds"), series, (1, 4, 16, 64, 256))


def _noise(results: Results) -> Plot:
    own = _sampled(results, "own-samples-", lambda row: row.noise)
    theirs = _sampled(results, "samples-", _spread)
    rate = [_bare(n, own[0][1] / n) for n in (1.0, 256.0)]
    series = [
        Series("the report's roulette; bars: smallest and largest of the runs", theirs, ORANGE, "o"),
        Series("clrender's roulette; bars: 95 % confidence intervals", own, BLUE, "o"),
        Series("1/N", rate, GREY, "--"),
    ]
    caption = "relMSE against samples per pixel, two shadow rays"
    return plot("noise", caption, ("samples per pixel", "relMSE"), series, (1, 4, 16, 64, 256))


def _shadow(results: Results) -> Plot:
    def at_equal_time(of: Callable[[Run], float]) -> Callable[[Row], Interval]:
        return lambda row: mean_interval(row.values(lambda run: of(run) * run.cost))

    def relative(names: tuple[str, ...], of: Callable[[Run], float]) -> list[_Point]:
        rows = results.each(names)
        base = at_equal_time(of)(rows[0]).value
        found = []
        for row in rows:
            interval = at_equal_time(of)(row)
            found.append(
                _point(row.shadow_rays, Interval(*(x / base for x in (interval.value, interval.low, interval.high))))
            )
        return found

    own = relative(("own-base", "own-samples-16", "own-shadow-4"), lambda run: run.noise)
    theirs = relative(("base", "samples-16", "shadow-4"), lambda run: run.display_error**2)
    series = [
        Series("clrender's roulette: relMSE × seconds", own, BLUE),
        Series("the report's roulette: display error² × seconds", theirs, ORANGE),
    ]
    caption = "Noise at equal time against shadow rays, one shadow ray = 1; lower is better"
    return plot("shadow", caption, ("shadow rays per hit", "noise at equal time"), series, (1, 2, 4), False)


def _sampled(results: Results, prefix: str, of: Callable[[Row], Interval]) -> list[_Point]:
    """A point for every number of samples."""
    rows = results.each([f"{prefix}{samples}" for samples in (1, 4, 16, 64, 256)])
    return [_point(row.samples, of(row)) for row in rows]


def _seconds(row: Row) -> Interval:
    values = row.values(lambda run: run.seconds)
    return Interval(row.seconds, min(values), max(values))


def _spread(row: Row) -> Interval:
    values = row.values(lambda run: run.noise)
    return Interval(mean_interval(values).value, min(values), max(values))


def _point(x: float, interval: Interval) -> _Point:
    if not interval.known:
        return _bare(x, interval.value)
    return float(x), interval.value, interval.low, interval.high


def _bare(x: float, y: float) -> _Point:
    return x, y, y, y
