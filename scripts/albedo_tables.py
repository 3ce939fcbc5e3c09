#!/usr/bin/env python3
"""Make `clrender/scene/albedo_tables.npz`: how much light the lobes of rough materials reflect, from each direction.

All tables have rows of √alpha from 0 to 1 and columns of √(μ (1 + alpha) / (μ + alpha)) from 0 to 1, of the cosine μ.
Integrals over visible normals are means over a grid in the sampler's square (Dupuy and Benyoub, CGF 42(8), 2023), in
double precision; the tables keep sixteen bits. What is an average is the average of the table as it is interpolated.

    ggx            (48, 48, 2) uint16  share that mirror-like facets reflect at first; the same weighted by (1 - c)^5,
                                       c the cosine at the facet (for Schlick's Fresnel term)
    ggx_average    (48, 2) float32     1 minus the cosine-weighted average of the first; average of the second
    glass          (2, 16, 32, 32) uint16  share that rough glass reflects and transmits at first: seen from the thinner
                                       medium and from the denser; by t = (n - 1) / (n + 1) of its index n, from 0 to 1
    glass_average  (2, 16, 32) float32 1 minus the average
    sheen          (32, 32) uint16     share that sheen reflects, times sheen_scale
    sheen_scale    (32,) float32       by which sheen is scaled, so that it reflects no more light than arrives

`--check` compares with the file in place of writing it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender.layout import GGX_TABLE_SIZE, GLASS_TABLE_LAYERS, GLASS_TABLE_SIZE

FILE = Path(__file__).resolve().parent.parent / "clrender" / "scene" / "albedo_tables.npz"
LEAST_ALPHA = 1e-5

_Floats = NDArray[np.float64]


def facets(cosine: float, alpha: float, grid: int) -> tuple[_Floats, _Floats]:
    """Direction (3, 1, 1) at that cosine, and the normals (3, grid, grid) that are seen along it, equally likely."""
    u = (np.arange(grid) + 0.5) / grid
    turn, v = np.meshgrid(u, u, indexing="ij")
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    stretched = np.array([alpha * sine, 0.0, cosine])
    stretched /= np.linalg.norm(stretched)
    z = (1.0 - v) * (1.0 + stretched[2]) - stretched[2]
    r = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    # Both halves of the turn are alike
    x, y = r * np.cos(np.pi * turn) + stretched[0], r * np.sin(np.pi * turn)
    normal = np.array([alpha * x, alpha * y, np.maximum(z + stretched[2], 0.0)])
    normal /= np.sqrt((normal**2).sum(axis=0))
    return np.array([sine, 0.0, cosine])[:, None, None], normal


def smith(w: _Floats, alpha: float) -> _Floats:
    """Λ of GGX."""
    slope2 = alpha * alpha * (w[0] ** 2 + w[1] ** 2) / np.maximum(np.abs(w[2]), 1e-12) ** 2
    of: _Floats = (np.sqrt(1.0 + slope2) - 1.0) / 2.0
    return of


def albedo(cosine: float, alpha: float, grid: int = 512) -> tuple[float, float]:
    """Of mirror-like facets, and weighted by (1 - c)^5."""
    wo, m = facets(cosine, alpha, grid)
    at = (m * wo).sum(axis=0)
    wi = 2.0 * at * m - wo
    seen = (1.0 + smith(wo, alpha)) / (1.0 + smith(wo, alpha) + smith(wi, alpha))
    reflected = np.where(wi[2] > 0.0, seen, 0.0)
    return float(reflected.mean()), float((reflected * np.maximum(1.0 - at, 0.0) ** 5).mean())


def glass_albedo(cosine: float, alpha: float, eta: float, grid: int = 96) -> float:
    """Of facets of glass: `eta` is the index beyond over the index on this side."""
    wo, m = facets(cosine, alpha, grid)
    at = (m * wo).sum(axis=0)
    sine2 = np.maximum(1.0 - at * at, 0.0) / (eta * eta)
    beyond = np.sqrt(np.maximum(1.0 - sine2, 0.0))
    parallel = (eta * at - beyond) / np.maximum(eta * at + beyond, 1e-30)
    perpendicular = (at - eta * beyond) / np.maximum(at + eta * beyond, 1e-30)
    fresnel = np.where(sine2 >= 1.0, 1.0, (parallel**2 + perpendicular**2) / 2.0)
    back, through = 2.0 * at * m - wo, (at / eta - beyond) * m - wo / eta
    here = 1.0 + smith(wo, alpha)
    reflected = np.where(back[2] > 0.0, here / (here + smith(back, alpha)), 0.0)
    passed = np.where(through[2] < 0.0, here / (here + smith(through, alpha)), 0.0)
    return float((fresnel * reflected + (1.0 - fresnel) * passed).mean())


def sheen_lambda(cosine: Any, alpha: float) -> Any:
    """Λ of sheen, a fit (Estevez and Kulla, "Production friendly microfacet sheen BRDF", 2017)."""
    weight = (1.0 - alpha) ** 2
    smooth = np.array([25.3245, 3.32435, 0.16801, -1.27393, -4.85967])
    rough = np.array([21.5473, 3.82987, 0.19823, -1.97760, -4.32054])
    a, b, c, d, e = weight * smooth + (1.0 - weight) * rough

    def log_of(x: Any) -> Any:
        return a / (1.0 + b * x**c) + d * x + e

    return np.exp(np.where(cosine < 0.5, log_of(cosine), 2.0 * log_of(0.5) - log_of(1.0 - cosine)))


def sheen_albedo(cosine: float, alpha: float, grid: int = 256) -> float:
    """Of the sheen of that roughness before it is scaled."""
    u = (np.arange(grid) + 0.5) / grid
    # Denser towards the horizon
    up, turn = np.meshgrid(u * u, u, indexing="ij")
    weight = 2.0 * np.sqrt(up)
    sine, out = np.sqrt(1.0 - up * up), np.sqrt(max(1.0 - cosine * cosine, 0.0))
    x, y, z = sine * np.cos(np.pi * turn) + out, sine * np.sin(np.pi * turn), up + cosine
    sine_half = np.sqrt((x * x + y * y) / (x * x + y * y + z * z))
    density = (2.0 + 1.0 / alpha) * sine_half ** (1.0 / alpha) / (2.0 * np.pi)
    seen = 1.0 / (1.0 + sheen_lambda(cosine, alpha) + sheen_lambda(up, alpha))
    return float((density * seen / (4.0 * cosine) * weight).mean() * 2.0 * np.pi)


def cosines(alpha: float, size: int) -> _Floats:
    """Of the columns of a row."""
    grid2 = (np.arange(size) / (size - 1)) ** 2
    of: _Floats = np.clip(alpha * grid2 / (1.0 + alpha - grid2), 1e-7, 1.0)
    return of


def alphas(size: int) -> _Floats:
    """Of the rows."""
    of: _Floats = np.maximum((np.arange(size) / (size - 1)) ** 2, LEAST_ALPHA)
    return of


def average(row: _Floats, alpha: float) -> float:
    """2 ∫ E(μ) μ dμ of a row as the kernels interpolate it, over the column's coordinate."""
    steps = 1 << 14
    at = (np.arange(steps) + 0.5) / steps
    cosine = alpha * at**2 / (1.0 + alpha - at**2)
    slope = 2.0 * at * alpha * (1.0 + alpha) / (1.0 + alpha - at**2) ** 2
    value = np.interp(at * (len(row) - 1), np.arange(len(row)), row)
    return float(2.0 * (value * cosine * slope).mean())


def packed(table: _Floats) -> NDArray[np.uint16]:
    """In sixteen bits."""
    return np.rint(np.clip(table, 0.0, 1.0) * 65535.0).astype("<u2")


def averages(table: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Of the rows of a table; the numbers of a row are its last axis."""
    size = table.shape[-1]
    rows = (table / 65535.0).reshape(-1, size)
    of = [average(row, alphas(size)[i % size]) for i, row in enumerate(rows)]
    return np.array(of, dtype="<f4").reshape(table.shape[:-1])


def ggx_tables() -> dict[str, NDArray[Any]]:
    """``ggx`` and ``ggx_average``."""
    size = GGX_TABLE_SIZE
    table = packed(np.array([[albedo(c, a) for c in cosines(a, size)] for a in alphas(size)]))
    lost = averages(65535 - table[..., 0])
    return {"ggx": table, "ggx_average": np.stack([lost, averages(table[..., 1])], axis=1)}


def glass_tables() -> dict[str, NDArray[Any]]:
    """``glass`` and ``glass_average``."""
    size = GLASS_TABLE_SIZE
    sides = []
    for denser in (False, True):
        for layer in range(GLASS_TABLE_LAYERS):
            t = min(max(layer / (GLASS_TABLE_LAYERS - 1), 1e-4), 1.0 - 1e-7)
            eta = (1.0 + t) / (1.0 - t)
            at = 1.0 / eta if denser else eta
            sides.append([[glass_albedo(c, a, at) for c in cosines(a, size)] for a in alphas(size)])
    table = packed(np.array(sides).reshape(2, GLASS_TABLE_LAYERS, size, size))
    return {"glass": table, "glass_average": averages(65535 - table)}


def sheen_tables() -> dict[str, NDArray[Any]]:
    """``sheen`` and ``sheen_scale``."""
    size = GLASS_TABLE_SIZE
    rows = [np.maximum(alphas(size), 0.0025)[i] for i in range(size)]
    table = np.array([[sheen_albedo(c, a) for c in np.maximum(cosines(a, size), 1e-3)] for a in rows])
    scale = 1.0 / np.maximum(table.max(axis=1) * 1.005, 1.0)
    return {"sheen": packed(table * scale[:, None]), "sheen_scale": scale.astype("<f4")}


def tables() -> dict[str, NDArray[Any]]:
    """All of them, by the names in the file."""
    return {**ggx_tables(), **glass_tables(), **sheen_tables()}


if __name__ == "__main__":
    made = tables()
    if "--check" not in sys.argv:
        np.savez_compressed(FILE, **made)  # type: ignore[arg-type]
    else:
        kept = np.load(FILE)
        for name, array in made.items():
            quantum = 1.0 if array.dtype == np.uint16 else 1e-6
            if np.abs(kept[name].astype(float) - array.astype(float)).max() > quantum:
                sys.exit(f"{name} in {FILE} is not what {Path(__file__).name} makes")
