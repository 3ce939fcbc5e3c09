"""White furnace test: the fraction of uniform light that a material sends to the viewer, estimated in two ways.

By sampling, it is the mean weight of `bsdf_sample`. By evaluation, it is ∫ f |cosθ| dω of `bsdf_eval`, over directions
chosen here, independent of the material's own density. A wrong density or weight makes the two differ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from clrender.furnace.directions import NARROWEST, Floats, around, incident, jittered, mirrored, polar, refracted

if TYPE_CHECKING:
    from clrender.furnace.surfaces import Samples, Surfaces

__all__ = ["ANGLES", "COPIES", "Energy", "Tally", "measure_energy"]

ANGLES: Final = (0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 85.0, 88.0, 89.0)
"""Degrees from the normal."""
COPIES: Final = 16
"""Number of independent, stratified estimates; their spread gives the standard error."""
_PRECISE: Final = 4e-4
"""Standard error at which a measurement of energy is precise enough ..."""
_MOST: Final = 4
"""... unless the squares of samples have reached this many times their side length."""


@dataclass
class Tally:
    """Counts of faults of individual samples.

    Attributes
    ----------
    samples : int
    nonfinite, negative : int
        Samples with a weight, a value or a density that is not finite, or is negative.
    unseen : int
        Non-delta samples that carry light in a direction for which `bsdf_eval` returns a density of 0.
    weight_off, pdf_off : list of float
        For each measurement, the median over its samples of weight · pdf / (f |cosθ|) - 1, and of the density of
        `bsdf_sample` over that of `bsdf_eval`, minus 1.
    """

    samples: int = 0
    nonfinite: int = 0
    negative: int = 0
    unseen: int = 0
    weight_off: list[float] = field(default_factory=list)
    pdf_off: list[float] = field(default_factory=list)

    def count(self, samples: Samples) -> None:
        """Add a set of samples."""
        shares = [*samples.weights.T, *samples.values.T, samples.pdf, samples.density]
        # A sum that contains a non-finite one is not finite; finite ones are too small to overflow
        total = sum([*shares, *samples.directions.T])
        self.samples += len(samples.pdf)
        self.nonfinite += int(np.count_nonzero(~np.isfinite(total)))
        self.negative += int(np.count_nonzero(np.any([share < 0.0 for share in shares], axis=0)))
        lit = (samples.weights > 0.0).any(axis=1) & (samples.pdf > 0.0)
        self.unseen += int(np.count_nonzero(lit & (samples.density == 0.0)))
        both = lit & (samples.density > 0.0)
        if np.count_nonzero(both) >= 1000:
            again = samples.weights[both] * samples.pdf[both, None]
            values = samples.values[both]
            bright = values > 0.0
            if bright.any():
                self.weight_off.append(float(np.median(again[bright] / values[bright])) - 1.0)
            self.pdf_off.append(float(np.median(samples.pdf[both] / samples.density[both])) - 1.0)


@dataclass(frozen=True)
class Energy:
    """Fraction of light sent to the viewer from one side of a surface, by angle and colour.

    Transmitted light counts as flux: radiance times the square of the relative index.

    Attributes
    ----------
    below : bool
        Seen from the back.
    angles : (a,) float64, degrees from the normal
    sampled, sampled_error : (a, 3) float64
        Mean and its standard error.
    evaluated, evaluated_error : (a, 3) float64
        Likewise by evaluation, without deltas.
    delta, through : (a, 3) float64
        Parts of `sampled`: of deltas, and of transmitted light.
    """

    below: bool
    angles: Floats
    sampled: Floats
    sampled_error: Floats
    evaluated: Floats
    evaluated_error: Floats
    delta: Floats
    through: Floats

    @property
    def smooth(self) -> Floats:
        """Non-delta part of `sampled`, comparable with `evaluated`."""
        return self.sampled - self.delta

    @property
    def transmits(self) -> bool:
        """Whether any light is transmitted."""
        return bool((self.through > 0.0).any())


def measure_energy(
    surfaces: Surfaces,
    name: str,
    eta: float,
    rng: np.random.Generator,
    tally: Tally,
    *,
    below: bool = False,
    angles: Sequence[float] = ANGLES,
    side: int = 64,
    evaluate: bool = True,
) -> Energy:
    """Measure the energy of a material at several angles.

    Parameters
    ----------
    surfaces : Surfaces
    name : str
    eta : float
        Index behind the front side, relative to the index in front.
    rng : Generator
    tally : Tally
        Counts the samples.
    below : bool
        Whether to measure from the back.
    angles : sequence of float
        Degrees from the normal.
    side : int
        Each of `COPIES` estimates takes side² samples, and more if they are noisy.
    evaluate : bool
        Whether to evaluate; else only sample, and set the evaluated results to zero.
    """
    relative = 1.0 / eta if below else eta
    rows = []
    for angle in angles:
        wo = incident(angle, below)
        fine = side
        sampled = _sampled(surfaces, name, wo, relative, rng, tally, fine)
        while float(sampled[1].max()) > _PRECISE and fine < _MOST * side:
            fine *= 2
            sampled = _sampled(surfaces, name, wo, relative, rng, tally, fine)
        evaluated = _evaluated(surfaces, name, wo, relative, rng, side) if evaluate else np.zeros((COPIES, 3))
        rows.append((*sampled[:2], *_mean(evaluated), *sampled[2:]))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Energy(below, np.array(angles), *columns)


def _sampled(
    surfaces: Surfaces, name: str, wo: Floats, relative: float, rng: np.random.Generator, tally: Tally, side: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean weight, its error, and the parts of deltas and of transmitted light; each (3,)."""
    samples = surfaces.sample(name, wo, jittered(rng, COPIES, side).reshape(2, -1))
    tally.count(samples)
    weights = np.where(np.isfinite(samples.weights), samples.weights, 0.0)
    crossing = samples.directions[:, 2] * wo[2] < 0.0
    flux = weights * np.where(crossing, relative * relative, 1.0)[:, None]
    delta, through = ((flux * part[:, None]).mean(axis=0) for part in (samples.delta, crossing))
    return *_mean(flux.reshape(COPIES, -1, 3).mean(axis=1)), delta, through


def _mean(copies: Floats) -> tuple[Floats, Floats]:
    return copies.mean(axis=0), copies.std(axis=0, ddof=1) / math.sqrt(len(copies))


def _evaluated(
    surfaces: Surfaces, name: str, wo: Floats, relative: float, rng: np.random.Generator, side: int
) -> Floats:
    """(COPIES, 3) estimates of ∫ f |cosθ| dω.

    Directions are cosine-distributed around the normal of either side, and distributed around the directions of
    reflection and refraction with a uniform logarithm of the angle, which finds lobes of any width. They are combined
    with the balance heuristic (Veach and Guibas, SIGGRAPH 1995).
    """
    facing = np.array([0.0, 0.0, math.copysign(1.0, wo[2])])
    poles = [mirrored(wo), refracted(wo, relative)]
    span = math.log(math.pi / NARROWEST)
    parts = []
    for pole in (facing, -facing):
        u, v = jittered(rng, COPIES, side)
        parts.append(around(pole, np.arccos(np.sqrt(1.0 - u)), 2.0 * math.pi * v))
    for pole in poles:
        u, v = jittered(rng, COPIES, side)
        parts.append(around(pole, NARROWEST * np.exp(span * u), 2.0 * math.pi * v))
    wi = np.concatenate(parts, axis=1)
    density = np.abs(wi[..., 2]) / math.pi
    for pole in poles:
        # Rounding moves some directions closer to the pole than intended
        angle = np.maximum(polar(pole, wi)[0], NARROWEST)
        density += 1.0 / (2.0 * math.pi * span * angle * np.maximum(np.sin(angle), 1e-12))
    values, _ = surfaces.evaluate(name, wo, wi.reshape(-1, 3))
    values = np.where(np.isfinite(values), values, 0.0).reshape(*wi.shape)
    values *= np.where(wi[..., 2] * wo[2] < 0.0, relative * relative, 1.0)[..., None]
    estimates: Floats = (values / density[..., None]).sum(axis=1) / (side * side)
    return estimates
