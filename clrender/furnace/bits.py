"""Whether a plugin computes the same bits with one path a work-item, as on GPUs, as with several, as on CPUs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from clrender.furnace.directions import around

if TYPE_CHECKING:
    from clrender.furnace.directions import Floats
    from clrender.furnace.surfaces import Surfaces

__all__ = ["same_bits"]

_COUNT: Final = 4096
_VIEWS: Final = 4


def same_bits(one: Surfaces, other: Surfaces, name: str, rng: np.random.Generator, transmits: bool) -> bool:
    """Whether evaluations and samples of a material agree, bit for bit.

    Parameters
    ----------
    one, other : Surfaces
        The same materials, compiled for different numbers of lanes.
    name : str
    rng : Generator
    transmits : bool
        Whether directions below the surface count, too.
    """
    for _ in range(_VIEWS):
        wo = _directions(rng, 1, below=False)[0]
        wi = _directions(rng, _COUNT, transmits)
        numbers = rng.random((2, _COUNT))
        a, b = one.evaluate(name, wo, wi), other.evaluate(name, wo, wi)
        c, d = one.sample(name, wo, numbers), other.sample(name, wo, numbers)
        pairs = [*zip(a, b, strict=True), (c.directions, d.directions), (c.weights, d.weights), (c.pdf, d.pdf)]
        if not all(np.array_equal(x, y, equal_nan=True) for x, y in pairs):
            return False
    return True


def _directions(rng: np.random.Generator, count: int, below: bool) -> Floats:
    """Unit vectors, (count, 3) float64, uniform over the sphere or the upper hemisphere."""
    z = rng.uniform(-1.0 if below else 0.0, 1.0, count)
    return around(np.array([0.0, 0.0, 1.0]), np.arccos(z), rng.uniform(0.0, 2.0 * np.pi, count))
