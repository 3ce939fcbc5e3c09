"""What the host knows of rough metals: measured ones by name, and how much light roughness keeps between its facets."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.layout import GGX_TABLE_SIZE

__all__ = ["METALS", "SMOOTH_BELOW", "fresnel", "ggx_albedos", "multiple_scale"]

_Triple: TypeAlias = tuple[float, float, float]

METALS: Final[Mapping[str, tuple[_Triple, _Triple]]] = {
    "Ag": ((0.06, 0.06, 0.04), (4.152, 3.586, 2.657)),
    "Au": ((0.21, 0.43, 1.38), (3.272, 2.455, 1.914)),
    "Cu": ((0.30, 1.02, 1.24), (3.205, 2.577, 2.397)),
}
"""Symbol -> real and imaginary part of the index of refraction at 617, 549 and 451 nm (Johnson and Christy 1972)."""

SMOOTH_BELOW: Final = 1e-3
"""Values of alpha below it make a delta: single precision has no digits left for narrower lobes."""

_STEPS: Final = 256


@cache
def ggx_albedos() -> NDArray[np.float32]:
    """Share of light that GGX microfacets, perfect mirrors, reflect after one bounce.

    Returns
    -------
    (n, n) float32
        n is `clrender.layout.GGX_TABLE_SIZE`. Rows: √alpha from 0 to 1; columns: √(μ (1 + alpha) / (μ + alpha)) from 0
        to 1, of the cosine μ. Made by ``scripts/ggx_albedo.py``.
    """
    table: NDArray[np.float32] = np.load(Path(__file__).with_name("ggx_albedo.npy"))
    assert table.shape == (GGX_TABLE_SIZE, GGX_TABLE_SIZE)
    return table


def fresnel(cosine: float, eta: float, k: float) -> float:
    """Share of unpolarised light that a smooth metal reflects.

    Parameters
    ----------
    cosine : float
        Of the angle from the normal.
    eta, k : float
        Complex index of refraction, over that of the medium before it.
    """
    cosine2, sine2 = cosine * cosine, 1.0 - cosine * cosine
    t0 = eta * eta - k * k - sine2
    ab = math.sqrt(t0 * t0 + 4.0 * eta * eta * k * k)
    a = math.sqrt(max(0.5 * (ab + t0), 0.0))
    t1, t2 = ab + cosine2, 2.0 * a * cosine
    t3, t4 = cosine2 * ab + sine2 * sine2, t2 * sine2
    return 0.5 * (t1 - t2) / (t1 + t2) * (1.0 + (t3 - t4) / (t3 + t4))


def multiple_scale(eta: _Triple, k: _Triple, alpha: float) -> _Triple:
    """Scale of the lobe of light that is reflected more than once, by colour: F_ms / (π (1 - E_avg)).

    The lobe is this times (1 - E(μo)) (1 - E(μi)). With F_ms = F_avg² E_avg / (1 - F_avg (1 - E_avg)) a white metal
    reflects all light (Kulla and Conti, SIGGRAPH course 2017).
    """
    albedo = _cosine_mean(lambda cosine: _first_albedo(alpha, cosine))
    scales = []
    for one_eta, one_k in zip(eta, k, strict=True):
        average = _cosine_mean(lambda cosine, n=one_eta, m=one_k: fresnel(cosine, n, m))  # type: ignore[misc]
        multiple = average * average * albedo / (1.0 - average * (1.0 - albedo))
        scales.append(multiple / (math.pi * max(1.0 - albedo, 1e-6)))
    return (scales[0], scales[1], scales[2])


def _cosine_mean(of: Callable[[float], float]) -> float:
    """2 ∫ f(μ) μ dμ: the mean over directions as likely as their cosine."""
    middles = [(i + 0.5) / _STEPS for i in range(_STEPS)]
    return 2.0 * math.fsum(of(x) * x for x in middles) / _STEPS


def _first_albedo(alpha: float, cosine: float) -> float:
    """As `kernels/material/ggx.h`, `ggx_first_albedo`."""
    table, last = ggx_albedos(), GGX_TABLE_SIZE - 1
    y = math.sqrt(alpha) * last
    x = math.sqrt(cosine * (1.0 + alpha) / (cosine + alpha)) * last
    row, column = min(int(y), last - 1), min(int(x), last - 1)
    (a, b), (c, d) = table[row : row + 2, column : column + 2].tolist()
    upper, lower = a + (b - a) * (x - column), c + (d - c) * (x - column)
    return float(upper + (lower - upper) * (y - row))
