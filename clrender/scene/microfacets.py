"""Rough materials on the host: indices of measured metals, and albedos of microfacet lobes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout

__all__ = ["METALS", "SMOOTH_BELOW", "albedo_tables", "fresnel", "fresnel_average"]

_Triple: TypeAlias = tuple[float, float, float]

METALS: Final[Mapping[str, tuple[_Triple, _Triple]]] = {
    "Ag": ((0.06, 0.06, 0.04), (4.152, 3.586, 2.657)),
    "Al": ((1.35, 1.01, 0.64), (7.37, 6.61, 5.47)),
    "Au": ((0.21, 0.43, 1.38), (3.272, 2.455, 1.914)),
    "Co": ((2.19, 2.05, 1.74), (4.11, 3.82, 3.28)),
    "Cr": ((3.17, 3.18, 2.33), (3.30, 3.33, 3.14)),
    "Cu": ((0.30, 1.02, 1.24), (3.205, 2.577, 2.397)),
    "Fe": ((2.88, 2.95, 2.59), (3.05, 2.93, 2.77)),
    "Hg": ((1.89, 1.55, 1.06), (5.13, 4.64, 3.87)),
    "Mn": ((2.51, 2.39, 2.11), (3.54, 3.33, 2.98)),
    "Ni": ((1.99, 1.92, 1.73), (4.02, 3.61, 2.95)),
    "Pd": ((1.75, 1.64, 1.41), (4.21, 3.84, 3.26)),
    "Pt": ((2.27, 2.08, 1.85), (4.09, 3.71, 3.14)),
    "Ti": ((2.67, 2.54, 2.27), (3.72, 3.43, 3.04)),
    "V": ((3.54, 4.00, 3.59), (3.02, 3.04, 3.46)),
    "W": ((3.62, 3.50, 3.31), (2.79, 2.76, 2.61)),
}
"""Symbol -> real and imaginary part of the index of refraction at 617, 549 and 451 nm.

Ag, Au, Cu: Johnson and Christy, Phys. Rev. B 6 (1972). Co, Cr, Fe, Mn, Ni, Pd, Ti, V: the same, Phys. Rev. B 9 (1974).
Al: Rakić, Applied Optics 34 (1995). Hg, liquid: Inagaki, Arakawa and Williams, Phys. Rev. B 23 (1981). Pt, W: Rakić et
al., Applied Optics 37 (1998).
"""

SMOOTH_BELOW: Final = 1e-3
"""Below this alpha a lobe is a delta distribution: single precision cannot represent narrower lobes."""

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
    names = [*facets, *more, *(f"beckmann_{name}" for name in facets if beckmann or turned_glass)]
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


def fresnel_average(eta: float, k: float) -> float:
    """The mean of `fresnel` over cosine-distributed directions."""
    middles = [(i + 0.5) / _STEPS for i in range(_STEPS)]
    return 2.0 * math.fsum(fresnel(x, eta, k) * x for x in middles) / _STEPS
