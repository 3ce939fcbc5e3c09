"""Helmholtz reciprocity: f(a, b) against f(b, a).

For transmission, the square of the relative index is included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from clrender.furnace.directions import NARROWEST, Floats, around, mirrored, refracted

if TYPE_CHECKING:
    from clrender.furnace.surfaces import Surfaces

__all__ = ["Reciprocity", "measure_reciprocity"]

_DARK: Final = 1e-6
"""Values below it, 1/sr, are rounding errors in the tail of a lobe."""
_GRAZING: Final = 1e-3
"""Cosine below which f is dominated by rounding."""
_ROUNDINGS: Final = 4.0
"""Multiple of the effect of rounding both directions that is ignored: near the critical angle, this is percents."""


@dataclass(frozen=True)
class Reciprocity:
    """Relative difference of f(a, b) and f(b, a), beyond the effect of rounding a and b.

    Attributes
    ----------
    largest : float
        Largest relative difference over all pairs and colours.
    compared : int
        Number of pairs with light; 0: the material has only deltas.
    angles : (float, float)
        Degrees from the front's normal of the two directions that differ most.
    """

    largest: float
    compared: int
    angles: tuple[float, float]


def measure_reciprocity(
    surfaces: Surfaces, name: str, eta: float, rng: np.random.Generator, transmits: bool, groups: int = 64
) -> Reciprocity:
    """Compare random pairs of directions, many of them inside narrow lobes.

    Parameters
    ----------
    surfaces : Surfaces
    name : str
    eta : float
        Index behind the front side, relative to the index in front.
    rng : Generator
    transmits : bool
        Whether light is transmitted: then pairs on the back and across the surface are also compared.
    groups : int
        Number of view directions on each side, each with 192 light directions.
    """
    pairs = []
    for below in (False, True) if transmits else (False,):
        for _ in range(groups):
            wo = _anywhere(rng, 1)[0] * (1.0, 1.0, -1.0 if below else 1.0)
            relative = 1.0 / eta if below else eta
            wi = [_anywhere(rng, 64) * (1.0, 1.0, math.copysign(1.0, wo[2])), _near(mirrored(wo), rng)]
            if transmits:
                wi += [-wi[0], _near(refracted(wo, relative), rng)]
            pairs.append(np.broadcast_arrays(wo, np.concatenate(wi)))
    a, b = (np.concatenate([pair[which] for pair in pairs]) for which in (0, 1))
    # As the kernels receive them
    a, b = a.astype(np.float32).astype(np.float64), b.astype(np.float32).astype(np.float64)
    usable = np.minimum(np.abs(a[:, 2]), np.abs(b[:, 2])) > _GRAZING
    a, b = a[usable], b[usable]
    # f is for radiance, which scales with the square of the index it enters (PBR 4ed, 9.5.2)
    crosses = a[:, 2] * b[:, 2] < 0.0
    square = np.where(crosses, np.where(a[:, 2] > 0.0, eta, 1.0 / eta) ** 2, 1.0)[:, None]
    rounded = [_both(surfaces, name, *pair) for pair in ((a, b), *((_shaken(a, rng), _shaken(b, rng)) for _ in "12"))]
    (forth, back), others = (rounded[0][0] * square, rounded[0][1]), rounded[1:]
    noise = np.max([np.maximum(np.abs(f * square - forth), np.abs(g - back)) for f, g in others], axis=0)
    larger = np.maximum(np.abs(forth), np.abs(back))
    lit = (larger > _DARK) & np.isfinite(larger)
    if not lit.any():
        return Reciprocity(0.0, 0, (0.0, 0.0))
    beyond = np.maximum(np.abs(forth - back) - _ROUNDINGS * noise, 0.0)
    apart = np.where(lit, beyond / np.where(lit, larger, 1.0), 0.0)
    worst = int(apart.max(axis=1).argmax())
    angles = [math.degrees(math.acos(min(max(float(each[worst, 2]), -1.0), 1.0))) for each in (a, b)]
    return Reciprocity(float(apart.max()), int(lit.any(axis=1).sum()), (angles[0], angles[1]))


def _both(surfaces: Surfaces, name: str, a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """f(a, b) and f(b, a), without the cosine."""
    forth, back = surfaces.evaluate(name, a, b)[0], surfaces.evaluate(name, b, a)[0]
    return forth / np.abs(b[:, 2:]), back / np.abs(a[:, 2:])


def _shaken(directions: Floats, rng: np.random.Generator) -> Floats:
    """The directions, perturbed by one or two units in the last place of single precision."""
    return directions + rng.uniform(-(2.0**-23), 2.0**-23, directions.shape)


def _anywhere(rng: np.random.Generator, count: int) -> Floats:
    """Uniform directions on the front side."""
    vectors = rng.normal(size=(count, 3))
    vectors[:, 2] = np.abs(vectors[:, 2])
    unit: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def _near(pole: Floats, rng: np.random.Generator, count: int = 128) -> Floats:
    """Directions around a pole, at angles whose logarithm is uniform."""
    angle = NARROWEST * np.exp(math.log(math.pi / NARROWEST) * rng.random(count))
    return around(pole, angle, 2.0 * math.pi * rng.random(count))
