"""The report's plots: time and noise against samples, noise at equal time against shadow rays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from clrender.report.founding import GROUPS
from clrender.report.intervals import Interval, mean_interval
from clrender.report.plot import Axis, Series, plot
from clrender.report.results import Results, Row, Run

__all__ = ["Plot", "plots"]

_Point = tuple[float, float, float, float]


@dataclass(frozen=True)
class Plot:
    """One, ready.

    Attributes
    ----------
    name : str
        Of its file.
    caption : str
    svg : str
    """

    name: str
    caption: str
    svg: str


def plots(results: Results) -> list[Plot]:
    """All of them.

    Parameters
    ----------
    results : Results
    """
    return [_time(results), _noise(results), _shadow(results)]


def _time(results: Results) -> Plot:
    theirs = [(float(row.samples), float(row.seconds)) for row in reversed(GROUPS[0].rows)]
    ours = _sampled(results, "samples-", _seconds)
    own = _sampled(results, "own-samples-", _seconds)
    first = next(point for point in ours if point[0] == theirs[0][0])
    ratio = [(n, first[1] * seconds / theirs[0][1]) for n, seconds in theirs]
    series = [
        Series("the report, on a processor it does not name", [_bare(*p) for p in theirs], "c"),
        Series("clrender, the report's settings", ours, "a"),
        Series("clrender, its own roulette", own, "b"),
        Series(
            "the report's ratios, from clrender's time at 16 samples",
            [_bare(*p) for p in ratio],
            "c",
            False,
            dashed=True,
        ),
    ]
    title = "Seconds against samples a pixel, two shadow rays; medians, bars: least and greatest run"
    ticks = (1, 4, 16, 64, 256)
    return Plot("time", title, plot(title, Axis("samples a pixel"), Axis("seconds"), series, ticks))


def _noise(results: Results) -> Plot:
    own = _sampled(results, "own-samples-", lambda row: row.noise)
    theirs = _sampled(results, "samples-", _spread)
    rate = [_bare(n, own[0][1] / n) for n in (1.0, 256.0)]
    series = [
        Series("the report's roulette; bars: least and greatest run", theirs, "b", line=False),
        Series("clrender's roulette; bars: 95 % intervals", own, "a", line=False),
        Series("1/N", rate, "c", False, dashed=True),
    ]
    title = "relMSE against samples a pixel, two shadow rays"
    ticks = (1, 4, 16, 64, 256)
    return Plot("noise", title, plot(title, Axis("samples a pixel"), Axis("relMSE"), series, ticks))


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
    theirs = relative(("base", "samples-16", "shadow-4"), lambda run: run.seen**2)
    series = [
        Series("clrender's roulette: relMSE × seconds", own, "a"),
        Series("the report's roulette: visible error² × seconds", theirs, "b"),
    ]
    title = "Noise at equal time against shadow rays, one shadow ray = 1; lower is better"
    return Plot(
        "shadow",
        title,
        plot(title, Axis("shadow rays a hit", True), Axis("noise at equal time", True), series, (1, 2, 4)),
    )


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
