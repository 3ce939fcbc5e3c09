"""Tests whether directions are sampled with the density that the material reports, by Pearson's chi-squared test.

Cells are uniform in the azimuth around the direction of reflection, or of refraction, and in the logarithm of the angle
from it, which resolves narrow lobes. The density is integrated over each cell by the midpoint rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.furnace.directions import NARROWEST, Floats, around, incident, mirrored, polar, refracted
from clrender.statistics.chi_squared import Fit, goodness_of_fit

if TYPE_CHECKING:
    from clrender.furnace.energy import Tally
    from clrender.furnace.surfaces import Surfaces

__all__ = ["TEST_ANGLES", "SamplingTest", "measure_sampling"]

TEST_ANGLES: Final = (0.0, 30.0, 60.0, 80.0)
"""Degrees from the normal at which directions are tested."""
_RINGS: Final = 30
_SECTORS: Final = 12
_SPAN: Final = math.log(math.pi / NARROWEST)
_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
_FINE: Final = (12, 24, 48, 96)
"""Steps of the midpoint rule along each side of a cell, refined until precise enough."""
_QUADRATURE: Final = 0.05
"""Largest effect of integration errors on the statistic, in its standard deviations."""


@dataclass(frozen=True)
class SamplingTest:
    """Result of the test at one angle.

    Attributes
    ----------
    angle : float, degrees from the normal
    below : bool
        Seen from the back.
    fit : Fit
    integral : float
        Integral of the density over all directions: 1 minus the probability of deltas and of samples without light.
    delta_share : float
        Fraction of samples that are deltas.
    integrated : bool
        Whether the density could be integrated precisely enough; else `fit` is meaningless.
    """

    angle: float
    below: bool
    fit: Fit
    integral: float
    delta_share: float
    integrated: bool

    @property
    def tested(self) -> bool:
        """Whether the test is meaningful: there are not only deltas, and the density could be integrated."""
        return self.integrated and self.fit.freedom > 0


def measure_sampling(
    surfaces: Surfaces,
    name: str,
    eta: float,
    angle: float,
    rng: np.random.Generator,
    tally: Tally,
    *,
    below: bool = False,
    count: int = 1 << 17,
) -> SamplingTest:
    """Test the directions that a material samples.

    Parameters
    ----------
    surfaces : Surfaces
    name : str
    eta : float
        Index behind the front side, relative to the index in front.
    angle : float
        Degrees from the normal.
    rng : Generator
    tally : Tally
        Counts the samples.
    below : bool
        Whether to measure from the back.
    count : int
        Samples.
    """
    wo = incident(angle, below)
    poles = (mirrored(wo), refracted(wo, 1.0 / eta if below else eta))
    samples = surfaces.sample(name, wo, rng.random((2, count)))
    tally.count(samples)
    chances, integrated = _chances(surfaces, name, wo, poles, count)
    # Deltas, and samples that end the path, form the last cell: the density does not include them
    dense = (samples.density > 0.0) & (samples.pdf > 0.0) & ~samples.lost & np.isfinite(samples.directions).all(axis=1)
    cells = _cells(wo, poles, samples.directions[dense])
    counts = np.append(np.bincount(cells, minlength=len(chances)), count - np.count_nonzero(dense))
    integral = float(chances.sum())
    fit = goodness_of_fit(counts, np.append(chances, max(1.0 - integral, 0.0)))
    return SamplingTest(angle, below, fit, integral, float(samples.delta.mean()), integrated)


def _cells(wo: Floats, poles: tuple[Floats, Floats], directions: Floats) -> npt.NDArray[np.int64]:
    """Index of the cell that contains each direction."""
    crossing = directions[:, 2] * wo[2] < 0.0
    numbers = np.zeros(len(directions), np.int64)
    for across, pole in zip((False, True), poles, strict=True):
        there = crossing == across
        angle, turn = polar(pole, directions[there])
        ring = np.log(np.maximum(angle, NARROWEST) / NARROWEST) / _SPAN * _RINGS
        sector = turn / (2.0 * math.pi) * _SECTORS
        place = np.minimum(ring.astype(np.int64), _RINGS - 1) * _SECTORS
        numbers[there] = place + np.minimum(sector.astype(np.int64), _SECTORS - 1) + across * _RINGS * _SECTORS
    return numbers


def _chances(
    surfaces: Surfaces, name: str, wo: Floats, poles: tuple[Floats, Floats], count: int
) -> tuple[Floats, bool]:
    """Probability of each cell, and whether integration is precise enough for this number of samples.

    Halving the steps at least halves the error, so the change bounds the remaining error. If the true probabilities
    are p and those tested p + e, the statistic grows by count · Σ e²/p on average.
    """
    allowed = _QUADRATURE * math.sqrt(2.0 * 2 * _RINGS * _SECTORS)
    before = None
    for fine in _FINE:
        parts = [_integrals(surfaces, name, wo, pole, bool(across), fine) for across, pole in enumerate(poles)]
        chances: Floats = np.concatenate(parts)
        if before is not None:
            rest = np.maximum(1.0 - np.array([chances.sum(), before.sum()]), 0.0)
            error = np.append(chances - before, rest[0] - rest[1])
            if float((count * error**2 / np.maximum(np.append(chances, rest[0]), 5.0 / count)).sum()) <= allowed:
                return chances, True
        before = chances
    return chances, False


def _integrals(surfaces: Surfaces, name: str, wo: Floats, pole: Floats, across: bool, fine: int) -> Floats:
    """Integral of the density over the cells around one pole, on the pole's side of the surface."""
    rings, sectors = _RINGS * fine, _SECTORS * fine
    # The steps of each column are offset, so that the density's edge at the horizon does not align with them
    begin = np.mod((np.arange(sectors) + 0.5) * _GOLDEN, 1.0)
    angle = NARROWEST * np.exp(_SPAN * (np.arange(rings)[:, None] + begin) / rings)
    turn = 2.0 * math.pi * (np.arange(sectors) + 0.5) / sectors
    # dω = sin ψ dψ dφ = ψ sin ψ d(ln ψ) dφ
    area = angle * np.sin(angle) * (_SPAN / rings) * (2.0 * math.pi / sectors)
    wi = around(pole, angle, np.broadcast_to(turn, angle.shape)).reshape(-1, 3)
    there = (wi[:, 2] * wo[2] < 0.0) == across
    pdf = np.zeros(len(wi))
    _, pdf[there] = surfaces.evaluate(name, wo, wi[there])
    parts = np.where(np.isfinite(pdf), pdf, 0.0).reshape(rings, sectors) * area
    sums: Floats = parts.reshape(_RINGS, fine, _SECTORS, fine).sum(axis=(1, 3)).ravel()
    return sums
