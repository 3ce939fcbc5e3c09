"""Measures lights of plugins: what their formulas give, and whether their directions follow their density."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.device.formulas import Formula
from clrender.errors import UsageError
from clrender.flatten.plugin_lights import light_grid, light_spread
from clrender.furnace.findings import ALARM, INTEGRAL, Finding, corrected
from clrender.statistics.chi_squared import Fit, goodness_of_fit

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.plugins import Plugin

    _Floats = npt.NDArray[np.float64]

__all__ = ["MeasuredLight", "light_findings", "light_json", "light_summary", "measure_light", "named_light"]

_RINGS: Final = 24
_SECTORS: Final = 8
"""Cells of the test: rings that are denser near the axis, as the grid's, and sectors of each."""
_FINE: Final = (8, 16, 32, 64)
"""Steps of the midpoint rule along each side of a cell, refined until precise enough."""
_QUADRATURE: Final = 0.05
"""Largest effect of integration errors on the statistic, in its standard deviations; as for materials."""
_LANES: Final = 8
_UNSENT: Final = 1e-3
"""Share of the power that may lie in directions whose density is 0."""


@dataclass(frozen=True)
class MeasuredLight:
    """Measurements of a plugin's light with some parameters.

    Attributes
    ----------
    title : str
        Its name, and the parameter that is not the default.
    parameters : mapping of str to float
        That parameter; empty for the defaults.
    power : (3,) float64
        Integral of the intensity over solid angle, by colour, watts.
    peak : float
        Largest intensity found, W/sr.
    negative, nonfinite : int
        Directions in which an intensity is negative, and in which one is not finite.
    fit : Fit
        The chi-squared test of sampled directions.
    integral : float
        Of the density over all directions.
    integrated : bool
        Whether the density could be integrated precisely enough; else `fit` is meaningless.
    unsent : float
        Share of the power in directions that are never sampled.
    same_with_one_lane : bool or None
        Whether one lane gives the same bits as several; None: not known.
    """

    title: str
    parameters: Mapping[str, float]
    power: _Floats
    peak: float
    negative: int
    nonfinite: int
    fit: Fit
    integral: float
    integrated: bool
    unsent: float
    same_with_one_lane: bool | None


def named_light(text: str, plugins: Sequence[Plugin], others: bool) -> Plugin | None:
    """The light that a user's text names, if it is one of these plugins.

    Parameters
    ----------
    text : str
    plugins : sequence of Plugin
    others : bool
        Whether something was asked for that only materials have.

    Raises
    ------
    UsageError
        Something of materials was asked for.
    """
    found = next((each for each in plugins if each.name == text and each.kind == "light"), None)
    if found is not None and others:
        raise UsageError(
            f"{text} is a light, which has no --material, no --uv and no page of --output; leave them out, and take "
            "--json for its numbers"
        )
    return found


def measure_light(
    plugin: Plugin, device: Device, *, seed: int = 0, count: int = 1 << 17, step: Callable[[str], None] | None = None
) -> list[MeasuredLight]:
    """Measure a light with its defaults, and with the bounds of each of its numbers.

    Parameters
    ----------
    plugin : Plugin
    device : Device
    seed : int
        Of the random numbers.
    count : int
        Samples of directions.
    step : callable, optional
        Called with the title before each measurement.

    Raises
    ------
    RenderError, DeviceError
        If the driver fails.
    """
    variants: list[dict[str, float]] = [{}]
    for each in plugin.parameters:
        bounds = dict.fromkeys((each.min, each.max)) if each.type == "number" else ()
        variants += [{each.name: value} for value in bounds]
    found = []
    for number, given in enumerate(variants):
        title = ", ".join([plugin.name, *(f"{name} {value:g}" for name, value in given.items())])
        if step is not None:
            step(title)
        numbers = [
            x for each in plugin.parameters for x in ((given[each.name],) if each.name in given else each.default)
        ]
        rng = np.random.default_rng([seed, number])
        found.append(_measured(plugin, device, title, given, numbers, rng.random((count, 2), np.float32)))
    return found


def _measured(
    plugin: Plugin, device: Device, title: str, given: Mapping[str, float], numbers: Sequence[float],
    random: npt.NDArray[np.float32],
) -> MeasuredLight:  # fmt: skip
    spread = light_spread(plugin)
    formula = Formula(device, (plugin,), 1, numbers)
    chances, integrated = _chances(formula, spread, len(random))
    grid = light_grid(spread, _RINGS * _FINE[1], _SECTORS * _FINE[1])
    said, density = formula.intensities(grid.directions), formula.densities(spread, grid.directions)
    finite = np.isfinite(said)
    light = np.where(finite, np.maximum(said, 0.0), 0.0).astype(np.float64) * grid.solid_angles[:, None]
    power = light.sum(axis=0)
    sampled = formula.samples(spread, random)
    cells, inside = _cells(spread, sampled)
    lost = len(random) - np.count_nonzero(inside)
    counts = np.append(np.bincount(cells[inside], minlength=_RINGS * _SECTORS), lost)
    integral = float(chances.sum())
    fit = goodness_of_fit(counts, np.append(chances, max(1.0 - integral, 0.0)))
    same = None
    if device.is_cpu:
        other = Formula(device, (plugin,), 1, numbers, _LANES)
        pairs = [(said, other.intensities(grid.directions)), (density, other.densities(spread, grid.directions))]
        pairs.append((sampled, other.samples(spread, random)))
        same = all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
    total = float(power.sum())
    return MeasuredLight(
        title=title,
        parameters=given,
        power=power,
        peak=float(said[finite].max(initial=0.0)),
        negative=int(np.count_nonzero((said < 0.0).any(axis=1))),
        nonfinite=int(np.count_nonzero(~finite.all(axis=1))),
        fit=fit,
        integral=integral,
        integrated=integrated,
        unsent=float(light[density <= 0.0].sum()) / total if total > 0.0 else 0.0,
        same_with_one_lane=same,
    )


def _cells(spread: float, directions: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Number of the cell of each direction, and whether it is in any: finite, and within the cone."""
    finite: npt.NDArray[np.bool_] = np.asarray(np.isfinite(directions).all(axis=1))
    x, y, z = np.where(finite[:, None], directions, (0.0, 0.0, 1.0)).astype(np.float64).T
    across = x * x + y * y
    drop = np.where(z > 0.0, across / (1.0 + np.maximum(z, 0.0)), 1.0 - z)
    place = np.sqrt(np.sqrt(np.minimum(drop / spread, 1.0)))
    rings = np.minimum((place * _RINGS).astype(np.int64), _RINGS - 1)
    turns = np.mod(np.arctan2(y, x) / (2.0 * math.pi), 1.0)
    sectors = np.minimum((turns * _SECTORS).astype(np.int64), _SECTORS - 1)
    within = finite & ((drop <= spread * (1.0 + 1e-6)) | (spread >= 2.0))
    return rings * _SECTORS + sectors, within


def _chances(formula: Formula, spread: float, count: int) -> tuple[_Floats, bool]:
    """Probability of each cell, and whether that is precise enough for this number of samples."""
    allowed = _QUADRATURE * math.sqrt(2.0 * _RINGS * _SECTORS)
    before: _Floats | None = None
    for fine in _FINE:
        grid = light_grid(spread, _RINGS * fine, _SECTORS * fine)
        parts = formula.densities(spread, grid.directions).astype(np.float64) * grid.solid_angles
        chances: _Floats = parts.reshape(_RINGS, fine, _SECTORS, fine).sum(axis=(1, 3)).ravel()
        if before is not None:
            change = np.square(chances - before) / np.maximum(chances, 5.0 / count)
            if float(count * change.sum()) <= allowed:
                return chances, True
        before = chances
    assert before is not None
    return before, False


def light_findings(measured: MeasuredLight, lights: int = 1) -> list[Finding]:
    """All findings on a light, faults first.

    Parameters
    ----------
    measured : MeasuredLight
    lights : int
        Number of measurements in the run; the probability of any false fault in it is at most `ALARM`.
    """
    return sorted(_found(measured, corrected(ALARM, lights)), key=lambda each: not each.fault)


def _found(m: MeasuredLight, level: float) -> Iterator[Finding]:
    if m.nonfinite:
        yield Finding("nonfinite", True, m.nonfinite, f"its intensity is not finite in {m.nonfinite} directions")
    if m.negative:
        yield Finding("negative", True, m.negative, f"its intensity is negative in {m.negative} directions")
    if not m.integral <= 1.0 + INTEGRAL:
        text = f"its density integrates to {m.integral:.4g} over all directions, which is more than 1"
        yield Finding("integral", True, m.integral, text)
    elif not m.integrated:
        yield Finding("integration", False, m.integral, "its density is too uneven to be integrated; not tested")
    elif m.fit.p < level:
        text = f"its directions do not follow its density: χ² p = {m.fit.p:.2g}, and the density integrates to "
        yield Finding("directions", True, m.fit.p, f"{text}{m.integral:.4g}")
    else:
        yield Finding("sampled", False, m.fit.p, f"directions follow the density: χ² p {m.fit.p:.2g}")
    if m.unsent > _UNSENT:
        share = f"{100.0 * m.unsent:.2g} % of its light"
        text = f"{share} goes where its density is 0, so nothing that starts at the light gets there"
        yield Finding("unsent", True, m.unsent, text)
    if m.same_with_one_lane is False:
        text = "gives other bits with one path a work-item than with several: combine masks with & | and !, never by "
        yield Finding("lanes", True, 1.0, f"{text}arithmetic, and choose by `mask ? a : b`")
    elif m.same_with_one_lane:
        yield Finding("bits", False, 0.0, "gives the same bits with one path a work-item as with several")


def light_json(measured: MeasuredLight, found: Sequence[Finding]) -> dict[str, Any]:
    """All results, JSON-able.

    Parameters
    ----------
    measured : MeasuredLight
    found : sequence of Finding
    """
    return {
        "light": measured.title,
        "parameters": dict(measured.parameters),
        "power": measured.power.tolist(),
        "largest_intensity": measured.peak,
        "pdf_integral": measured.integral,
        "chi2_p": measured.fit.p if measured.integrated else None,
        "unsent": measured.unsent,
        "faults": sum(each.fault for each in found),
        "findings": [
            {"kind": each.kind, "fault": each.fault, "amount": each.amount, "sentence": each.sentence} for each in found
        ],
    }


def light_summary(numbers: Sequence[Mapping[str, Any]]) -> list[Sequence[str]]:
    """Rows of a table of results of `light_json`, its head first."""
    rows: list[Sequence[str]] = [("light", "power, W", "largest, W/sr", "density", "χ² p", "faults")]
    for each in numbers:
        power = sorted({f"{value:.4g}" for value in each["power"]}, key=float)
        words = power[0] if len(power) == 1 else f"{power[0]} to {power[-1]}"
        p = "–" if each["chi2_p"] is None else f"{each['chi2_p']:.2g}"
        rest = (f"{each['largest_intensity']:.4g}", f"{each['pdf_integral']:.4f}", p, f"{each['faults']}")
        rows.append((each["light"], words, *rest))
    return rows
