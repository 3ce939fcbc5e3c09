"""Which of the founding report's conclusions hold, decided by the measured numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

from clrender.report.founding import CLAIMS
from clrender.report.intervals import Interval, mean_interval, power_law, ratio_interval, scaled
from clrender.report.results import Results, Row
from clrender.report.termination import expected_deepest
from clrender.report.wording import bounds, factor, percent

__all__ = ["FAILS", "HOLDS", "OPEN", "Verdict", "verdicts"]

HOLDS: Final = "holds"
FAILS: Final = "does not hold"
OPEN: Final = "undecided"

_SAMPLES: Final = ("samples-16", "samples-64", "samples-256")
_OWN_SAMPLES: Final = ("own-samples-1", "own-samples-4", "own-samples-16", "own-samples-64", "own-samples-256")
_SMALL: Final = 1.25
"""Errors that differ by less than this factor count as a small difference; so do times."""

_BUSY: Final = 0.05
"""Part of the processor that other programs may take while elapsed times are compared."""


@dataclass(frozen=True)
class Verdict:
    """A conclusion of the report, the measurement that tests it, and the outcome.

    Attributes
    ----------
    name : str
        Key of `clrender.report.founding.CLAIMS`.
    claim, measured : str
    outcome : str
        ``holds``, ``does not hold`` or ``undecided``.
    """

    name: str
    claim: str
    measured: str
    outcome: str


def verdicts(results: Results) -> list[Verdict]:
    """All verdicts, in the order of the report, except those whose rows are missing."""
    judges: dict[str, Callable[[Results], tuple[str, str] | None]] = {
        "time": _time,
        "noise": _noise,
        "important": _important,
        "shadow": _shadow,
        "light": _light,
        "bounces": _bounces,
        "deepest": _deepest,
        "roulette": _roulette,
        "limit": _limit,
        "indirect": _indirect,
        "cores": _cores,
        "more-cores": _more_cores,
    }
    found = []
    for name, judge in judges.items():
        told = judge(results)
        if told is not None:
            found.append(Verdict(name, CLAIMS[name], *told))
    return found


def _decided(holds: bool, fails: bool) -> str:
    return HOLDS if holds else FAILS if fails else OPEN


def _time(results: Results) -> tuple[str, str]:
    power = power_law([(row.samples, run.cost) for row in results.each(_SAMPLES) for run in row.runs])
    # The report's own table: 256 samples against 16.
    theirs = math.log((44 * 60 + 59) / (2 * 60 + 56)) / math.log(16)
    text = (
        f"Time grows as samples to the power of {bounds(power)}; the report's own times give {theirs:.2f}. A power of "
        "1 is linear growth; exponential growth would follow no power."
    )
    return text, _decided(power.above(1.25), power.below(1.25))


def _noise(results: Results) -> tuple[str, str]:
    power = power_law([(row.samples, run.noise) for row in results.each(_OWN_SAMPLES) for run in row.runs])
    text = (
        f"relMSE changes as samples to the power of {bounds(power)} from 1 to 256 samples (clrender's roulette): "
        f"four times the samples divide the variance by {4.0**-power.value:.1f} and the standard deviation by "
        f"{2.0**-power.value:.1f}. "
    )
    text += (
        "That is faster than the 1/N of independent samples, as expected of stratified ones."
        if power.below(-1.02)
        else "Independent samples give -1."
    )
    return text, _decided(power.below(-0.8), power.above(-0.8))


def _important(results: Results) -> tuple[str, str]:
    rows = results.rows
    times = {
        "samples 16 → 256": _cost_ratio(rows["samples-256"], rows["samples-16"]).value,
        "shadow rays 1 → 4": _cost_ratio(rows["shadow-4"], rows["base"]).value,
        "depth 5 → 14": _cost_ratio(rows["base"], rows["depth-5"]).value,
    }
    errors = {
        "samples 16 → 256": _display_error_ratio(rows["samples-16"], rows["samples-256"]).value,
        "shadow rays 1 → 4": _display_error_ratio(rows["base"], rows["shadow-4"]).value,
        "depth 5 → 14": _display_error_ratio(rows["depth-5"], rows["base"]).value,
    }
    listed = "; ".join(f"{name}: time {factor(times[name])}, display error ÷ {errors[name]:.2f}" for name in times)
    first = [max(table, key=table.__getitem__) == "samples 16 → 256" for table in (times, errors)]
    return f"Over the report's ranges: {listed}.", _decided(all(first), not any(first))


def _shadow(results: Results) -> tuple[str, str]:
    rows = results.rows
    one = rows["own-base"]
    gains, parts = [], []
    for name, number in (("own-samples-16", "two"), ("own-shadow-4", "four")):
        noise = ratio_interval(rows[name].values(lambda run: run.noise), one.values(lambda run: run.noise))
        gain = ratio_interval(rows[name].values(lambda run: run.efficiency), one.values(lambda run: run.efficiency))
        gains.append(gain)
        cost = _cost_ratio(rows[name], one)
        parts.append(
            f"{number}: relMSE {factor(noise.value)}, time {factor(cost.value)}, efficiency {bounds(gain, '×')}"
        )
    display_error = _display_error_ratio(rows["base"], rows["shadow-4"])
    text = (
        f"Against one shadow ray (clrender's roulette), {'; '.join(parts)}. Above ×1, more shadow rays give less "
        "noise in the same time. With the report's roulette the display error of one ray is "
        f"{bounds(display_error, '×')} that of four. "
    )
    pays, fails = [gain.above(1.0) for gain in gains], [gain.below(1.0) for gain in gains]
    outcome = "pays" if pays[0] else "does not pay" if fails[0] else "makes no significant difference"
    text += f"A second shadow ray {outcome}."
    return text, _decided(not any(pays) and all(fails), any(pays))


def _light(results: Results) -> tuple[str, str]:
    deep, flat = results.rows["base"], results.rows["depth-5"]
    display_error = _display_error_ratio(flat, deep)
    light = scaled(_mean(flat), results.beside_reference)
    text = (
        "The roulette divides surviving paths by their probability, which preserves the mean "
        f"(measured with a deepest path of {_span(flat)}: {bounds(light, percent=True)}). But the median pixel then "
        f"has {percent(_median_ratio(flat))} of the reference, and rare pixels far too much; with {_span(deep)} it has "
        f"{percent(_median_ratio(deep))}. The display error of the former is {bounds(display_error, '×')} that of the "
        "latter."
    )
    return text, _decided(display_error.below(_SMALL), display_error.above(_SMALL))


def _bounces(results: Results) -> tuple[str, str]:
    rows = results.rows
    depth = _cost_ratio(rows["base"], rows["depth-5"])
    others = {
        "shadow rays 1 → 4": _cost_ratio(rows["shadow-4"], rows["base"]),
        "samples 16 → 64": _cost_ratio(rows["samples-64"], rows["samples-16"]),
    }
    rays = sum(run.rays for run in rows["base"].runs) / len(rows["base"].runs)
    flat_rays = sum(run.rays for run in rows["depth-5"].runs) / len(rows["depth-5"].runs)
    listed = ", ".join(f"{name} {factor(ratio.value)}" for name, ratio in others.items())
    text = (
        f"From a deepest path of {_span(rows['depth-5'])} to {_span(rows['base'])}, time {bounds(depth, '×')} (the "
        f"report: ×{103 / 91:.2f}), rays {factor(rays / flat_rays)}; for comparison {listed}."
    )
    least = min(others.values(), key=lambda ratio: ratio.value)
    return text, _decided(depth.high < least.low, depth.low > least.high)


def _deepest(results: Results) -> tuple[str, str]:
    rows = results.rows
    depths = [_span(row) for row in results.each(_SAMPLES)]
    run = rows["samples-16"].runs[0]
    survival = 1.0 - run.paths / run.rays
    expected = [expected_deepest(survival, run.paths * times) for times in (1, 4, 16)]
    few, many = (
        mean_interval(rows[name].values(lambda run: float(run.deepest))) for name in (_SAMPLES[0], _SAMPLES[2])
    )
    text = (
        f"Deepest path of 16, 64 and 256 samples: {', '.join(depths)}. Geometrically distributed lengths predict "
        f"about {', '.join(f'{x:.1f}' for x in expected)}: {math.log(16) / -math.log(survival):.1f} more for 16 "
        "times the paths. A deepest path that does not grow with the number of paths contradicts the roulette "
        "described."
    )
    grows = many.low > few.high or min(rows[_SAMPLES[2]].deepest) > max(rows[_SAMPLES[0]].deepest)
    return text, _decided(many.value <= few.value, grows)


def _roulette(results: Results) -> tuple[str, str]:
    own = scaled(_mean(results.rows["own-samples-16"]), results.beside_reference)
    theirs = scaled(_mean(results.rows["base"]), results.beside_reference)
    row = results.rows["base"]
    text = (
        f"Light on surfaces, relative to the reference: {bounds(own, percent=True)} with clrender's roulette, "
        f"{bounds(theirs, percent=True)} with the report's. "
    )
    if not row.bounded:
        text += (
            f"But its probability of {row.termination} multiplies the mean square of a path's weight by up to "
            f"{row.growth:.2f} per bounce: the variance may be unbounded and convergence slower than 1/N."
        )
    return text, _decided(own.holds(0.0) and theirs.holds(0.0), not own.holds(0.0) and abs(own.value) > 0.005)


def _limit(results: Results) -> tuple[str, str]:
    bias = scaled(mean_interval(results.limited), results.beside_reference)
    change = bounds(bias, percent=True)
    text = f"Paths of at most {results.limit} scattering events change the light on surfaces by {change}."
    return text, _decided(bias.below(0.0), bias.holds(0.0))


def _indirect(results: Results) -> tuple[str, str]:
    share = -results.beside_reference(results.direct_mean)
    return f"{percent(share)} of the light on surfaces is indirect, averaged over the image.", _decided(
        share > 0.05, share < 0.01
    )


def _cores(results: Results) -> tuple[str, str] | None:
    if "one-core" not in results.rows:
        return None
    gain = _speedup(results, "one-core", "base")
    same = all(
        {run.seed: run.sha256 for run in results.rows["base"].runs}[run.seed] == run.sha256
        for run in results.rows["one-core"].runs
    )
    text = (
        f"{results.cores} cores are {bounds(gain, '×')} as fast as one (the report: ×{307 / 103:.2f}, on an unstated "
        f"number of cores); the images are {'the same, bit for bit' if same else 'NOT the same'}."
    )
    if disturbed := _disturbed(results, [gain]):
        return f"{text} {disturbed}", OPEN
    return text, _decided(gain.above(_SMALL), gain.below(_SMALL))


def _more_cores(results: Results) -> tuple[str, str] | None:
    if "one-core-64" not in results.rows or "one-core-4" not in results.rows:
        return None
    names = {4: ("one-core-4", "cores-4"), 16: ("one-core", "base"), 64: ("one-core-64", "cores-64")}
    gains = {samples: _speedup(results, *pair) for samples, pair in names.items()}
    text = "; ".join(f"{samples} samples: {bounds(gain, '×')}" for samples, gain in gains.items())
    text = f"Speed-up by all cores at {text}."
    if disturbed := _disturbed(results, gains.values()):
        return f"{text} {disturbed}", OPEN
    # It fails where even the largest plausible gain is small against the smallest plausible one of few samples.
    return text, _decided(gains[64].low > gains[4].high, gains[64].high < gains[4].low * _SMALL)


def _disturbed(results: Results, gains: Iterable[Interval]) -> str:
    """Why elapsed times decide nothing; empty if they do."""
    if results.others > _BUSY:
        return f"Other programs took {percent(results.others)} of the processor meanwhile, so this decides nothing."
    if not all(gain.known for gain in gains):
        return "Single runs decide nothing."
    return ""


def _speedup(results: Results, alone: str, together: str) -> Interval:
    """Ratio of elapsed times, using only the same turns."""
    one = results.rows[alone].runs
    seeds = {run.seed for run in one}
    beside = [run.seconds for run in results.rows[together].runs if run.seed in seeds]
    return ratio_interval([run.seconds for run in one], beside)


def _cost_ratio(above: Row, below: Row) -> Interval:
    return ratio_interval(above.values(lambda run: run.cost), below.values(lambda run: run.cost))


def _display_error_ratio(above: Row, below: Row) -> Interval:
    return ratio_interval(above.values(lambda run: run.display_error), below.values(lambda run: run.display_error))


def _mean(row: Row) -> Interval:
    return mean_interval(row.values(lambda run: run.mean))


def _median_ratio(row: Row) -> float:
    return mean_interval(row.values(lambda run: run.median_ratio)).value


def _span(row: Row) -> str:
    low, high = row.deepest
    return str(low) if low == high else f"{low}–{high}"
