#!/usr/bin/env python3
"""Make `clrender/scene/albedo_tables.npz`: how much light the lobes of rough materials reflect, from each direction.

Rows go over √alpha from 0 to 1, columns over √(μ (1 + alpha) / (μ + alpha)) from 0 to 1, of the cosine μ. Integrals
over visible normals are means over a grid in the sampler's square (Dupuy and Benyoub, CGF 42(8), 2023), in double
precision; the tables keep sixteen bits. An average is that of the table as it is interpolated, weighted by the cosine.

    ggx         (R, C) uint16        share E that mirror-like facets reflect at first
    schlick     (R, C) uint16        (B / E)^(1/5), where B is E weighted by (1 - c)^5 of the cosine c at the facet, for
                                     Schlick's Fresnel term; columns over √μ
    ggx_lost    (R,) float32         1 - E_avg
    ggx_schlick (R,) float32         B_avg
    turned      (A, R, Q, C) uint16  E of anisotropic facets: by the strength s of anisotropy from 0 to 1, where
                                     alpha_x = alpha_y + (1 - alpha_y) s²; √alpha_y; the square of the cosine between x
                                     and the direction in the plane; columns over their mean alpha
    turned_lost (A, R) float32       1 - E_avg
    glass       (2, L, R, C) uint16  share E that rough glass reflects and transmits at first: seen from the thinner
                                     medium and from the denser; by √((n - 1) / (n + 1)) of its index n, from 0 to 1;
                                     columns over the mean of √μ and of that above
    glass_lost  (2, L, R) float32    1 - E_avg
    sheen       (R, C) uint16        share that sheen reflects, times sheen_scale
    sheen_scale (R,) float32         by which sheen is scaled, so that it reflects no more light than arrives
    sheen_mean  (R,) float32         average of the table

`--check` compares with the file in place of writing it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender import layout

FILE = Path(__file__).resolve().parent.parent / "clrender" / "scene" / "albedo_tables.npz"
LEAST_ALPHA = 1e-5

_Floats = NDArray[np.float64]


def facets(wo: _Floats, alpha: _Floats, grid: int) -> _Floats:
    """Normals (3, grid, grid) that are seen along a direction, equally likely."""
    u = (np.arange(grid) + 0.5) / grid
    turn, v = np.meshgrid(u, u, indexing="ij")
    stretched = alpha * wo
    stretched /= np.linalg.norm(stretched)
    z = (1.0 - v) * (1.0 + stretched[2]) - stretched[2]
    r = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    # Both halves of the turn are alike where the direction is along x and alpha is the same on all sides
    around = (np.pi if wo[1] == 0.0 and alpha[0] == alpha[1] else 2.0 * np.pi) * turn
    x, y = r * np.cos(around) + stretched[0], r * np.sin(around) + stretched[1]
    normal = np.array([alpha[0] * x, alpha[1] * y, np.maximum(z + stretched[2], 0.0)])
    normal /= np.sqrt((normal**2).sum(axis=0))
    return normal


def alike(alpha: float) -> _Floats:
    """The same roughness on all sides."""
    return np.array([alpha, alpha, 1.0])


def seen_at(cosine: float, along_x: float = 1.0) -> _Floats:
    """A direction of that cosine, and of that square of the cosine of its angle to x in the plane."""
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    return np.array([sine * np.sqrt(along_x), sine * np.sqrt(1.0 - along_x), cosine])


def smith(w: _Floats, alpha: _Floats) -> _Floats:
    """Λ of GGX."""
    slope2 = ((alpha[0] * w[0]) ** 2 + (alpha[1] * w[1]) ** 2) / np.maximum(np.abs(w[2]), 1e-12) ** 2
    of: _Floats = (np.sqrt(1.0 + slope2) - 1.0) / 2.0
    return of


def albedo(wo: _Floats, alpha: _Floats, grid: int = 384) -> tuple[float, float]:
    """Of mirror-like facets, and weighted by (1 - c)^5."""
    m = facets(wo, alpha, grid)
    wo = wo[:, None, None]
    at = (m * wo).sum(axis=0)
    wi = 2.0 * at * m - wo
    seen = (1.0 + smith(wo, alpha)) / (1.0 + smith(wo, alpha) + smith(wi, alpha))
    reflected = np.where(wi[2] > 0.0, seen, 0.0)
    return float(reflected.mean()), float((reflected * np.maximum(1.0 - at, 0.0) ** 5).mean())


def glass_albedo(cosine: float, alpha: _Floats, eta: float, grid: int = 96) -> float:
    """Of facets of glass: `eta` is the index beyond over the index on this side."""
    m = facets(seen_at(cosine), alpha, grid)
    wo = seen_at(cosine)[:, None, None]
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


def mixed_column(alpha: float, cosine: _Floats) -> _Floats:
    """The column's coordinate for glass."""
    of: _Floats = 0.5 * (np.sqrt(cosine) + np.sqrt(cosine * (1.0 + alpha) / (cosine + alpha)))
    return of


def mixed_cosines(alpha: float, size: int) -> _Floats:
    """Of the columns of a row of glass."""
    cosine = np.linspace(0.0, 1.0, 1 << 16) ** 4
    of: _Floats = np.maximum(np.interp(np.arange(size) / (size - 1), mixed_column(alpha, cosine), cosine), 1e-7)
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


def mixed_average(row: _Floats, alpha: float) -> float:
    """The same of glass, over the fourth root of the cosine."""
    at = (np.arange(1 << 13) + 0.5) / (1 << 13)
    value = np.interp(mixed_column(alpha, at**4) * (len(row) - 1), np.arange(len(row)), row)
    return float(2.0 * (value * at**4 * 4.0 * at**3).mean())


def packed(table: Any) -> NDArray[np.uint16]:
    """In sixteen bits."""
    of: NDArray[np.uint16] = np.rint(np.clip(np.asarray(table), 0.0, 1.0) * 65535.0).astype("<u2")
    return of


def lost(table: NDArray[np.uint16], mixed: bool = False) -> NDArray[np.float32]:
    """1 - E_avg of the rows of a table of (…, rows, columns); `mixed`: whose columns are those of glass."""
    rows, columns = table.shape[-2:]
    flat = (65535.0 - table.reshape(-1, columns)) / 65535.0
    means = mixed_average if mixed else average
    of = [means(row, alphas(rows)[i % rows]) for i, row in enumerate(flat)]
    return np.array(of, dtype="<f4").reshape(table.shape[:-1])


def ggx_tables() -> dict[str, NDArray[Any]]:
    """``ggx``, ``schlick`` and their averages."""
    rows, columns, size, cells = layout.GGX_ROWS, layout.GGX_COLUMNS, layout.SCHLICK_ROWS, layout.SCHLICK_COLUMNS
    table = packed([[albedo(seen_at(c), alike(a))[0] for c in cosines(a, columns)] for a in alphas(rows)])
    mus = np.maximum((np.arange(cells) / (cells - 1)) ** 2, 1e-7)
    both = np.array([[albedo(seen_at(c), alike(a)) for c in mus] for a in alphas(size)])
    schlick = packed((both[..., 1] / both[..., 0]) ** 0.2)
    steps = (np.arange(1 << 12) + 0.5) / (1 << 12)
    means = []
    for y, alpha, row in zip(np.arange(rows) / (rows - 1), alphas(rows), table / 65535.0, strict=True):
        x = np.sqrt(steps * (1.0 + alpha) / (steps + alpha))
        e = np.interp(x * (columns - 1), np.arange(columns), row)
        lower = min(int(y * (size - 1)), size - 2)
        part = y * (size - 1) - lower
        ratio = (schlick[lower] * (1.0 - part) + schlick[lower + 1] * part) / 65535.0
        g = np.interp(np.sqrt(steps) * (cells - 1), np.arange(cells), ratio)
        means.append(2.0 * (e * g**5 * steps).mean())
    return {"ggx": table, "schlick": schlick, "ggx_lost": lost(table), "ggx_schlick": np.array(means, dtype="<f4")}


def turned_tables() -> dict[str, NDArray[Any]]:
    """``turned`` and ``turned_lost``."""
    strengths, rows, turns, columns = (
        layout.TURNED_STRENGTHS,
        layout.TURNED_ROWS,
        layout.TURNED_TURNS,
        layout.TURNED_COLUMNS,
    )
    table = np.zeros((strengths, rows, turns, columns))
    averages = np.zeros((strengths, rows))
    for i in range(strengths):
        for j, least in enumerate(np.maximum(alphas(rows), 1e-3)):
            most = least + (1.0 - least) * (i / (strengths - 1)) ** 2
            alpha, mean = np.array([most, least, 1.0]), (most + least) / 2.0
            for k in range(turns):
                along_x = k / (turns - 1)
                table[i, j, k] = [albedo(seen_at(c, along_x), alpha, 160)[0] for c in cosines(mean, columns)]
            # The mean over all turns: of the angle, not of its cosine's square
            angles = (np.arange(64) + 0.5) / 64 * np.pi / 2.0
            at = np.cos(angles) ** 2 * (turns - 1)
            kept = packed(table[i, j]) / 65535.0
            around = np.mean([[np.interp(x, np.arange(turns), kept[:, c]) for c in range(columns)] for x in at], axis=0)
            averages[i, j] = average(1.0 - around, mean)
    return {"turned": packed(table), "turned_lost": averages.astype("<f4")}


def glass_tables() -> dict[str, NDArray[Any]]:
    """``glass`` and ``glass_lost``."""
    layers, rows, columns = layout.GLASS_LAYERS, layout.GLASS_ROWS, layout.GLASS_COLUMNS
    sides = []
    for denser in (False, True):
        for layer in range(layers):
            t = min(max((layer / (layers - 1)) ** 2, 1e-4), 1.0 - 1e-7)
            eta = (1.0 - t) / (1.0 + t) if denser else (1.0 + t) / (1.0 - t)
            sides.append([[glass_albedo(c, alike(a), eta) for c in mixed_cosines(a, columns)] for a in alphas(rows)])
    table = packed(np.array(sides).reshape(2, layers, rows, columns))
    return {"glass": table, "glass_lost": lost(table, mixed=True)}


def sheen_tables() -> dict[str, NDArray[Any]]:
    """``sheen``, ``sheen_scale`` and ``sheen_mean``."""
    rows, columns = layout.SHEEN_ROWS, layout.SHEEN_COLUMNS
    table = np.array([[sheen_albedo(max(c, 1e-3), max(a, 0.0025)) for c in cosines(a, columns)] for a in alphas(rows)])
    scale = 1.0 / np.maximum(table.max(axis=1) * 1.005, 1.0)
    kept = packed(table * scale[:, None])
    return {"sheen": kept, "sheen_scale": scale.astype("<f4"), "sheen_mean": 1.0 - lost(kept)}


def tables() -> dict[str, NDArray[Any]]:
    """All of them, by the names in the file."""
    return {**ggx_tables(), **turned_tables(), **glass_tables(), **sheen_tables()}


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
