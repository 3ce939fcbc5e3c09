"""Energy in a white furnace: the share of uniform light that a material sends to the viewer, found in two ways.

By sampling it is the mean weight of `bsdf_sample`. By evaluation it is ∫ f |cosθ| dω of `bsdf_eval`, over directions
that are chosen here, so that the material's own density has no part in it. A wrong density or weight sets the two
apart.
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
"""Independent estimates, whose spread gives the standard error: each is stratified within itself."""
_PRECISE: Final = 4e-4
"""Standard error at which an energy is measured well enough ..."""
_MOST: Final = 4
"""... or the squares of samples have sides so many times as long."""


@dataclass
class Tally:
    """What is wrong with single samples.

    Attributes
    ----------
    samples : int
    nonfinite, negative : int
        Samples with a weight, a value or a density that is no number or below 0.
    unseen : int
        Samples that carry light, of no delta, in a direction to which `bsdf_eval` gives a density of 0.
    weight_off, pdf_off : list of float
        One of each measurement: median over its samples of weight · pdf over f |cosθ|, and of the density of
        `bsdf_sample` over that of `bsdf_eval`, less 1.
    """

    samples: int = 0
    nonfinite: int = 0
    negative: int = 0
    unseen: int = 0
    weight_off: list[float] = field(default_factory=list)
    pdf_off: list[float] = field(default_factory=list)

    def count(self, samples: Samples) -> None:
        """Count a set of samples in."""
        shares = [*samples.weights.T, *samples.values.T, samples.pdf, samples.density]
        # A sum with any of them in it is no number either; none of them is so large that finite ones overflow
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
    """Share of light sent to the viewer from one side of a surface, by angle and colour.

    Light that comes through the surface counts as flux: radiance times the square of the relative index.

    Attributes
    ----------
    below : bool
        Seen from the back.
    angles : (a,) float64, degrees from the normal
    sampled, sampled_error : (a, 3) float64
        Mean and its standard error.
    evaluated, evaluated_error : (a, 3) float64
        The same by evaluation, without deltas.
    delta, through : (a, 3) float64
        Parts of `sampled`: what deltas carry, and what comes through the surface.
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
        """Part of `sampled` that no delta carries: what `evaluated` measures, too."""
        return self.sampled - self.delta

    @property
    def transmits(self) -> bool:
        """Whether any light comes through."""
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
        Index behind the front side over the index before it.
    rng : Generator
    tally : Tally
        Counts the samples.
    below : bool
        From the back.
    angles : sequence of float
        Degrees from the normal.
    side : int
        Each of `COPIES` estimates takes its square of samples, and more where they are noisy.
    evaluate : bool
        Else by sampling only, and zero for what evaluation would give.
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
    """Mean weight, its error, and the parts of deltas and of light that comes through; each (3,)."""
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

    Directions are distributed around the normal of either side by their cosine, and around the directions of mirror
    and refraction so that the logarithm of the angle is uniform, which finds lobes of any width. All count by the sum
    of the densities (the balance heuristic: Veach and Guibas, SIGGRAPH 1995).
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
        # Rounding takes some directions nearer to the pole than they were to be
        angle = np.maximum(polar(pole, wi)[0], NARROWEST)
        density += 1.0 / (2.0 * math.pi * span * angle * np.maximum(np.sin(angle), 1e-12))
    values, _ = surfaces.evaluate(name, wo, wi.reshape(-1, 3))
    values = np.where(np.isfinite(values), values, 0.0).reshape(*wi.shape)
    values *= np.where(wi[..., 2] * wo[2] < 0.0, relative * relative, 1.0)[..., None]
    estimates: Floats = (values / density[..., None]).sum(axis=1) / (side * side)
    return estimates
