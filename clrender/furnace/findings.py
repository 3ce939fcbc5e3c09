"""Findings on a material, in sentences: what is wrong and by how much, and what holds.

The probability of any false fault in a run is at most `ALARM`. It is divided among the run's materials and the tests of
each: energy gained, energy lost in white, sampling against evaluation, and sampled directions against their density;
and each test's share among its angles and colours (Šidák). Besides noise, rounding and the fits of albedos are
tolerated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from clrender.furnace.energy import COPIES, Energy
from clrender.furnace.measure import Measured
from clrender.statistics.student_t import critical_value
from clrender.wording import counted, grouped

__all__ = ["ALARM", "ALLOWED", "RECIPROCAL", "Finding", "corrected", "findings"]

ALARM: Final = 0.01
"""Probability that a run reports any fault although all materials are correct."""
ALLOWED: Final = 1e-3
"""Tolerance of energies besides noise, as a fraction of the light: the accuracy of the fits of albedos."""
RECIPROCAL: Final = 1e-4
"""Relative difference of f(a, b) and f(b, a) that rounding may cause."""
INTEGRAL: Final = 0.01
"""By how much the integral of a density may exceed 1: what integration leaves uncertain where few samples are taken."""
_JUDGEMENTS: Final = 4
_COLORS: Final = ("red", "green", "blue")


@dataclass(frozen=True)
class Finding:
    """A finding on a material.

    Attributes
    ----------
    kind : str
        ``gain loss estimators weight density directions integral reciprocity nonfinite negative unseen lanes`` are
        faults;
        ``absorbs keeps loses transmits deltas sampled reciprocal unreciprocal integration bits`` are not.
    fault : bool
    amount : float
        A fraction of the light, a relative difference, a p-value or a number of samples.
    sentence : str
        Without the material's name.
    """

    kind: str
    fault: bool
    amount: float
    sentence: str


def corrected(level: float, count: int) -> float:
    """Significance level of each of `count` comparisons with a joint probability `level` of a false alarm (Šidák)."""
    return -math.expm1(math.log1p(-level) / max(count, 1))


def findings(measured: Measured, materials: int = 1) -> list[Finding]:
    """All findings on a material, faults first.

    Parameters
    ----------
    measured : Measured
    materials : int
        Number of materials in the run.
    """
    level = corrected(corrected(ALARM, materials), _JUDGEMENTS)
    found = [
        *_gains(measured, level),
        *_losses(measured, level),
        *_estimators(measured, level),
        *_directions(measured, level),
        *_reciprocity(measured),
        *_samples(measured),
        *_lanes(measured),
        *_absorbed(measured),
        *_shares(measured),
    ]
    return sorted(found, key=lambda each: not each.fault)


@dataclass(frozen=True)
class _Place:
    """An energy, and the angle and side of its measurement."""

    energy: Energy
    words: str


def _places(measured: Measured, white: bool) -> list[_Place]:
    energies = measured.white if white else measured.energies
    own = [_Place(each, " on the back" if each.below else "") for each in energies]
    return own + [_Place(row.white if white else row.energy, f", roughness {row.roughness:g}") for row in measured.rows]


def _worst(places: Sequence[_Place], level: float, sign: float) -> tuple[float, float, str] | None:
    """Largest significant excess over 1 (or deficit, with sign -1): amount, error, and place."""
    count = sum(each.energy.sampled.size for each in places)
    t = float(critical_value(corrected(level, count), np.array([COPIES - 1.0]))[0])
    worst = None
    for each in places:
        off = sign * (each.energy.sampled - 1.0)
        beyond = np.where(off > ALLOWED + t * each.energy.sampled_error, off, 0.0)
        angle, color = np.unravel_index(int(beyond.argmax()), beyond.shape)
        if beyond[angle, color] > 0.0 and (worst is None or beyond[angle, color] > worst[0]):
            place = f"{each.energy.angles[angle]:g}° from the normal{each.words} ({_COLORS[color]})"
            worst = float(beyond[angle, color]), float(each.energy.sampled_error[angle, color]), place
    return worst


def _gains(measured: Measured, level: float) -> Iterator[Finding]:
    for white, words in ((False, ""), (True, " in white")):
        worst = _worst(_places(measured, white), level / 2.0, 1.0)
        if worst:
            yield Finding(
                "gain", True, worst[0],
                f"gains energy{words}: {_percent(1.0 + worst[0], worst[1])} of the light leaves the surface at "
                f"{worst[2]}",
            )  # fmt: skip
            return


def _losses(measured: Measured, level: float) -> Iterator[Finding]:
    places = _places(measured, white=True)
    worst = _worst(places, level, -1.0)
    if worst and "lossless" not in measured.claims:
        yield Finding(
            "loses", False, worst[0],
            f"does not claim to keep all light: in white, {_percent(1.0 - worst[0], worst[1])} of it leaves the "
            f"surface at {worst[2]}",
        )  # fmt: skip
    elif worst:
        yield Finding(
            "loss", True, worst[0],
            f"loses energy beyond the absorption by its colour: in white, only {_percent(1.0 - worst[0], worst[1])} of "
            f"the light leaves the surface at {worst[2]}",
        )  # fmt: skip
    elif not any(each.kind == "gain" for each in _gains(measured, level)):
        rows = "every angle and roughness" if measured.rows else "every angle"
        worst_off = max(float(np.abs(each.energy.sampled - 1.0).max()) for each in places)
        yield Finding(
            "keeps", False, worst_off,
            "conserves energy, except for absorption by its colour: in white, 100 % leaves the surface at "
            f"{rows}, within {100 * ALLOWED:g} % and noise",
        )  # fmt: skip


def _estimators(measured: Measured, level: float) -> Iterator[Finding]:
    """Compare the two estimates of the same integral."""
    count = sum(each.sampled.size for each in measured.energies)
    t = float(critical_value(corrected(level, count), np.array([COPIES - 1.0]))[0])
    worst = None
    for each in measured.energies:
        apart = each.smooth - each.evaluated
        error = np.hypot(each.sampled_error, each.evaluated_error)
        beyond = np.abs(apart) / (ALLOWED * np.maximum(each.evaluated, 1.0) + t * error)
        angle, color = np.unravel_index(int(beyond.argmax()), beyond.shape)
        if beyond[angle, color] > 1.0 and (worst is None or beyond[angle, color] > worst[0]):
            worst = float(beyond[angle, color]), each, angle, color
    if worst:
        _, each, angle, color = worst
        sampled, evaluated = float(each.smooth[angle, color]), float(each.evaluated[angle, color])
        yield Finding(
            "estimators", True, sampled - evaluated,
            f"bsdf_sample and bsdf_eval disagree: sampling gives {100 * sampled:.2f} % of the light, evaluation "
            f"{100 * evaluated:.2f} % at {each.angles[angle]:g}° from the normal{' on the back' if each.below else ''} "
            f"({_COLORS[color]})",
        )  # fmt: skip


def _directions(measured: Measured, level: float) -> Iterator[Finding]:
    tested = [each for each in measured.tests if each.tested]
    if tested:
        worst = min(tested, key=lambda each: each.fit.p)
        where = f"{worst.angle:g}° from the normal{' on the back' if worst.below else ''}"
        together = -math.expm1(len(tested) * math.log1p(-worst.fit.p)) if worst.fit.p < 1.0 else 1.0
        if worst.fit.p < corrected(level, len(tested)):
            yield Finding(
                "directions", True, together,
                f"directions do not follow the density at {where}: χ² {worst.fit.statistic:.0f} with "
                f"{counted(worst.fit.freedom, 'degree of freedom', 'degrees of freedom')}, p = {together:.2g}; the "
                "density integrates to "
                f"{worst.integral:.4f}",
            )  # fmt: skip
        else:
            yield Finding(
                "sampled", False, together,
                f"directions follow the density: smallest p of {len(tested)} χ² tests {together:.2g}",
            )  # fmt: skip
        most = max(tested, key=lambda each: each.integral)
        if most.integral > 1.0 + INTEGRAL:
            yield Finding(
                "integral", True, most.integral - 1.0,
                f"the density integrates to {most.integral:.4f} at {most.angle:g}° from the normal"
                f"{' on the back' if most.below else ''}, and a probability is at most 1",
            )  # fmt: skip
    if any(not each.integrated for each in measured.tests):
        where = ", ".join(
            f"{each.angle:g}°{' on the back' if each.below else ''}" for each in measured.tests if not each.integrated
        )
        text = f"the density is too narrow or too irregular to integrate at {where}: no χ² test there"
        yield Finding("integration", False, 0.0, text)
    deltas = max(each.delta_share for each in measured.tests)
    if measured.only_deltas and deltas:
        yield Finding("deltas", False, 1.0, "is a delta distribution: there is no density and no reciprocity to test")
    elif deltas:
        yield Finding("deltas", False, deltas, f"up to {100 * deltas:.3g} % of its samples are deltas")


def _reciprocity(measured: Measured) -> Iterator[Finding]:
    found = measured.reciprocity
    if not found.compared:
        return
    if found.largest > RECIPROCAL and "reciprocal" not in measured.claims:
        sentence = f"does not claim to be reciprocal: f(a, b) and f(b, a) differ by up to {_share(found.largest)}"
        yield Finding("unreciprocal", False, found.largest, sentence)
    elif found.largest > RECIPROCAL:
        yield Finding(
            "reciprocity", True, found.largest,
            f"is not reciprocal: f(a, b) and f(b, a) differ by {_share(found.largest)} for directions "
            f"{found.angles[0]:.1f}° and {found.angles[1]:.1f}° from the normal",
        )  # fmt: skip
    else:
        yield Finding("reciprocal", False, found.largest, f"is reciprocal within {found.largest:.1g}")


def _samples(measured: Measured) -> Iterator[Finding]:
    tally = measured.tally
    if tally.nonfinite:
        yield Finding(
            "nonfinite",
            True,
            tally.nonfinite,
            f"{grouped(tally.nonfinite)} of {counted(tally.samples, 'sample is', 'samples are')} not finite",
        )
    if tally.negative:
        yield Finding(
            "negative",
            True,
            tally.negative,
            f"{grouped(tally.negative)} of {counted(tally.samples, 'sample is', 'samples are')} negative",
        )
    if tally.unseen > ALLOWED * tally.samples:
        yield Finding(
            "unseen", True, tally.unseen,
            f"{100 * tally.unseen / tally.samples:.2g} % of the samples carry light although bsdf_eval gives their "
            "direction a density of 0",
        )  # fmt: skip
    for kind, offs, text in (
        ("weight", tally.weight_off, "sample weights differ from f |cosθ| / pdf of bsdf_eval: half of them by"),
        (
            "density",
            tally.pdf_off,
            "bsdf_sample and bsdf_eval give different densities for the same direction: half of them differ by",
        ),
    ):
        worst = max(offs, key=abs, default=0.0)
        if abs(worst) > ALLOWED:
            yield Finding(kind, True, worst, f"{text} {100 * worst:+.2g} % or more")


def _lanes(measured: Measured) -> Iterator[Finding]:
    """Of plugins: whether bits depend on how many paths a work-item carries."""
    if measured.same_with_one_lane is None:
        return
    if measured.same_with_one_lane:
        yield Finding("bits", False, 0.0, "gives the same bits with one path a work-item as with several")
    else:
        yield Finding(
            "lanes", True, 1.0,
            "gives other bits with one path a work-item than with several: combine masks with & | and !, never by "
            "arithmetic, and choose by `mask ? a : b`",
        )  # fmt: skip


def _absorbed(measured: Measured) -> Iterator[Finding]:
    """Report the absorption: the energy that is less than in white."""
    lost = np.array([1.0 - each.sampled for each in measured.energies])
    own = np.array([1.0 - each.sampled for each in measured.white])
    absorbed = lost - np.maximum(own, 0.0)
    if absorbed.max() > ALLOWED:
        low, high = absorbed.min(axis=(0, 1)), absorbed.max(axis=(0, 1))
        words = [_range(low[i], high[i], color) for i, color in enumerate(_COLORS)]
        alike = len({word.split(" of ")[0] for word in words}) == 1
        text = _range(low[0], high[0], "the") + " light" if alike else ", ".join(words[:2]) + f" and {words[2]} light"
        yield Finding("absorbs", False, float(absorbed.max()), f"its colour absorbs {text}")


def _range(low: float, high: float, color: str) -> str:
    first, last = f"{max(100 * low, 0.0):.1f}", f"{max(100 * high, 0.0):.1f}"
    return f"{first if first == last else f'{first} to {last}'} % of {color}"


def _shares(measured: Measured) -> Iterator[Finding]:
    if measured.transmits:
        through = measured.energies[0].through
        low, high = 100 * float(through.min()), 100 * float(through.max())
        text = f"transmits {low:.1f} to {high:.1f} % of the light from the front"
        yield Finding("transmits", False, high / 100.0, text)


def _percent(share: float, error: float) -> str:
    return f"{100 * share:.2f} % ± {100 * error:.2g} %" if error > 1e-7 else f"{100 * share:.2f} %"


def _share(part: float) -> str:
    return f"{100 * part:.2g} %"
