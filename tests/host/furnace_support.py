"""Materials in NumPy in the place of those on a device, right and wrong, to see what the furnace says of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from clrender.furnace.directions import Floats
from clrender.furnace.surfaces import Samples, Surfaces

__all__ = ["Diffuse", "material"]


@dataclass
class Diffuse:
    """A diffuse surface that reflects a part of the light and lets another part through, with faults to choose.

    Attributes
    ----------
    energy : float
        Share of the light that leaves it.
    through : float
        Part of it that crosses, times the relative index: a diffuse boundary is reciprocal when the shares of both
        sides are as the squares of their indices.
    eta : float
        Index behind the front side over the index before it.
    uneven : float
        f depends on `wo` and not on `wi`: not reciprocal.
    nan_share, negative_share : float
        Shares of samples whose weight is no number, or below 0.
    crooked : float
        Directions are sampled with cosine to another power than the density says.
    """

    energy: float = 1.0
    through: float = 0.0
    eta: float = 1.0
    uneven: float = 0.0
    nan_share: float = 0.0
    negative_share: float = 0.0
    crooked: float = 0.0

    def sample(self, name: str, wo: Floats, numbers: Floats) -> Samples:
        """As `Surfaces.sample`."""
        through = self.through * (self.eta if wo[2] > 0.0 else 1.0 / self.eta)
        u, v = numbers
        crosses = u < through
        u = np.where(crosses, u / max(through, 1e-9), (u - through) / (1.0 - through))
        cosine = np.clip(u, 1e-12, 1.0) ** (1.0 / (2.0 + self.crooked))
        sine, turn = np.sqrt(1.0 - cosine**2), 2.0 * math.pi * v
        z = np.where(crosses, -cosine, cosine) * math.copysign(1.0, wo[2])
        wi = np.stack([sine * np.cos(turn), sine * np.sin(turn), z], axis=1)
        values, pdf = self.evaluate(name, wo, wi)
        weights = values / pdf[:, None]
        row = np.arange(len(u)) / len(u)
        weights[row < self.nan_share] = np.nan
        weights[row > 1.0 - self.negative_share] *= -1.0
        return Samples(wi, weights, pdf, values, pdf)

    def evaluate(self, name: str, wo: Floats, wi: Floats) -> tuple[Floats, Floats]:
        """As `Surfaces.evaluate`."""
        o, i = np.broadcast_to(wo, wi.shape)[:, 2], wi[:, 2]
        relative = np.where(o > 0.0, self.eta, 1.0 / self.eta)
        crosses, density = o * i < 0.0, np.abs(i) / math.pi
        share = np.where(crosses, self.through * relative, 1.0 - self.through * relative)
        radiance = self.energy * share / np.where(crosses, relative**2, 1.0)
        f = radiance * density * (1.0 + self.uneven * np.abs(o))
        return np.repeat(f[:, None], 3, axis=1), share * density


def material(**of: Any) -> Surfaces:
    """A `Diffuse` that measurements take for surfaces on a device."""
    return cast(Surfaces, Diffuse(**of))
