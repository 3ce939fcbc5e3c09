"""Rough materials on the host: Fresnel reflectance of metals, and albedos of microfacet lobes."""

from __future__ import annotations

import math
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout

__all__ = ["albedo_tables", "fresnel", "fresnel_average"]

_STEPS: Final = 256


@cache
def albedo_tables(beckmann: bool = False, turned_glass: bool = False) -> NDArray[np.float32]:
    """Albedo tables of rough lobes, made by ``scripts/albedo_tables.py``.

    Parameters
    ----------
    beckmann : bool
        Whether to include those of Beckmann's distribution.
    turned_glass : bool
        Whether to include these and those of anisotropic glass.

    Returns
    -------
    (n,) float32
        The tables, concatenated, from `clrender.layout.ALBEDO_GGX` on; n is `ALBEDO_END`,
        `ALBEDO_TURNED_GLASS` or `ALBEDO_TURNED_GLASS_END`. In 16-bit tables, each word contains two neighbours along a
        row.
    """
    facets = ("ggx", "schlick", "ggx_lost", "ggx_schlick", "turned", "turned_lost", "glass", "glass_lost")
    more = ("sheen", "sheen_scale", "sheen_mean", "slants", "slant_numbers", "covered", "covered_mean")
    names = [*facets, *more, *(f"beckmann_{name}" for name in (*facets, "slants") if beckmann or turned_glass)]
    names += ["turned_glass", "turned_glass_lost"] if turned_glass else []
    with np.load(Path(__file__).with_name("albedo_tables.npz")) as file:
        tables = np.concatenate([_words(file[name]) for name in names])
    ends = (layout.ALBEDO_END, layout.ALBEDO_TURNED_GLASS, layout.ALBEDO_TURNED_GLASS_END)
    assert len(tables) == ends[2 if turned_glass else beckmann]
    return tables


def _words(table: NDArray[Any]) -> NDArray[np.float32]:
    if table.dtype == np.uint16:
        low, high = (part.astype(np.uint32) for part in (table[..., :-1], table[..., 1:]))
        table = (low | high << np.uint32(16)).view(np.float32)
    if table.dtype == np.uint32:
        table = table.view(np.float32)
    return table.astype(np.float32, copy=False).reshape(-1)


def fresnel(cosine: float, eta: float, k: float) -> float:
    """Fresnel reflectance of a smooth metal for unpolarised light.

    Parameters
    ----------
    cosine : float
        Cosine of the angle of incidence.
    eta, k : float
        Complex index of refraction, relative to the medium in front of it.
    """
    cosine2, sine2 = cosine * cosine, 1.0 - cosine * cosine
    t0 = eta * eta - k * k - sine2
    ab = math.sqrt(t0 * t0 + 4.0 * eta * eta * k * k)
    a = math.sqrt(max(0.5 * (ab + t0), 0.0))
    t1, t2 = ab + cosine2, 2.0 * a * cosine
    t3, t4 = cosine2 * ab + sine2 * sine2, t2 * sine2
    return 0.5 * (t1 - t2) / (t1 + t2) * (1.0 + (t3 - t4) / (t3 + t4))


@lru_cache(4096)
def fresnel_average(eta: float, k: float) -> float:
    """The mean of `fresnel` over cosine-distributed directions; kept, as a metal has hundreds with wavelengths."""
    middles = [(i + 0.5) / _STEPS for i in range(_STEPS)]
    return 2.0 * math.fsum(fresnel(x, eta, k) * x for x in middles) / _STEPS
