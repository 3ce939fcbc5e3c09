#!/usr/bin/env python3
"""Make `clrender/flatten/albedo_tables.npz`: how much light the lobes of rough materials reflect, from each direction.

Rows go over √alpha from 0 to 1, columns over √(μ (1 + alpha) / (μ + alpha)) from 0 to 1, of the cosine μ. Integrals
over visible normals are means over a grid in the sampler's square (Dupuy and Benyoub, CGF 42(8), 2023), in double
precision; the tables keep sixteen bits. An average is that of the table as it is interpolated, weighted by the cosine.

    ggx         (R, C) uint16        share E that mirror-like facets reflect at first
    schlick     (R, C) uint16        (B / E)^(1/5), where B is E weighted by (1 - c)^5 of the cosine c at the facet, for
                                     Schlick's Fresnel term; columns over √μ
    ggx_lost    (4R - 3,) float32    (1 - E_avg) / alpha^(3/2), which varies little
    ggx_schlick (R,) float32         B_avg
    turned      (R, A, Q, C) uint16  E of anisotropic facets, by the larger √alpha_x; by how far √alpha_y is from it
                                     towards the least one, from 0 to 1; by the logarithm of the alpha that a direction
                                     sees, √(alpha_x² cos²φ + alpha_y² sin²φ), from alpha_y (0) to alpha_x (1);
                                     columns over that alpha. In the last two E is nearly linear
    turned_lost (R, A) float32       (1 - E_avg) / alpha^(3/2) of the mean alpha
    glass       (2, L, R, C) uint16  share E that rough glass reflects and transmits at first: seen from the thinner
                                     medium and from the denser; layers: glass_index; columns: glass_column
    glass_lost  (2, L, 8R - 7) float32  (1 - E_avg) / alpha
    turned_glass (2, L, R, A, Q, C) uint16  E of anisotropic glass, as ``turned`` and ``glass``: turned_glass_turn,
                                     turned_glass_column
    turned_glass_lost (2, L, 3R - 2, 2A - 1) float32  (1 - E_avg) over the mean alpha
    sheen       (R, C) uint16        share that sheen reflects, times sheen_scale; columns over √μ
    sheen_scale (R,) float32         by which sheen is scaled, so that it reflects no more light than arrives
    sheen_mean  (R,) float32         average of the table
    covered     (2, L, R, C) uint16  four times what a white metal below a coat (0) or white sheen (1) loses of light
                                     along μ where the lesser of what the cover leaves of both directions passes: by
                                     √alpha of the cover, √alpha of the metal and √μ
    covered_mean (2, L, R) float32   average of the table, without that factor
    slants      (3, S) uint32        how E and B of GGX and the albedo of sheen vary over μ: two components of sixteen
                                     bits for each √alpha, (component + 0.05) / 0.2, along functions b and c that are
                                     orthonormal with weight 2 μ, have average 0 and come as near as two can
    slant_numbers (17,) float32      averages of b³ and b² c; with Q what EON at roughness 1 does more than Lambert,
                                     over its A, of b Qb, b Qc and c Qc; polynomials in μ of Qb (7) and Qc (5)

The first eight are of GGX; ``beckmann_ggx`` to ``beckmann_glass_lost`` are the same of Beckmann's distribution, and
``beckmann_slants`` (2, S) are the slants of its E and B along the same functions.

`--check` compares with the file in place of writing it.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender import layout

FILE = Path(__file__).resolve().parent.parent / "clrender" / "flatten" / "albedo_tables.npz"
LEAST_ALPHA = 1e-5
LEAST_TURNED = 1e-3  # the smallest alpha that is not a delta: LAYERING_SMOOTH of kernels/material/layering.h

_Floats = NDArray[np.float64]


def facets(wo: _Floats, alpha: _Floats, grid: int) -> _Floats:
    """Equally likely visible normals (3, grid, grid) for a direction."""
    u = (np.arange(grid) + 0.5) / grid
    turn, v = np.meshgrid(u, u, indexing="ij")
    stretched = alpha * wo
    stretched /= np.linalg.norm(stretched)
    z = (1.0 - v) * (1.0 + stretched[2]) - stretched[2]
    r = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    # Both halves of the azimuth are alike if the direction is along x and alpha is isotropic
    around = (np.pi if wo[1] == 0.0 and alpha[0] == alpha[1] else 2.0 * np.pi) * turn
    x, y = r * np.cos(around) + stretched[0], r * np.sin(around) + stretched[1]
    normal = np.array([alpha[0] * x, alpha[1] * y, np.maximum(z + stretched[2], 0.0)])
    normal /= np.sqrt((normal**2).sum(axis=0))
    return normal


def alike(alpha: float) -> _Floats:
    """Isotropic roughness."""
    return np.array([alpha, alpha, 1.0])


def seen_at(cosine: float, along_x: float = 1.0) -> _Floats:
    """A direction with this cosine, and this squared cosine of its azimuth from x."""
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    return np.array([sine * np.sqrt(along_x), sine * np.sqrt(1.0 - along_x), cosine])


def smith(slope2: _Floats) -> _Floats:
    """Λ of GGX, by the square of alpha times the tangent of a direction."""
    of: _Floats = (np.sqrt(1.0 + slope2) - 1.0) / 2.0
    return of


def smith_beckmann(slope2: _Floats) -> _Floats:
    """Λ of Beckmann's distribution: the fit of Walter et al. (EGSR 2007), as in kernels/material/beckmann.h."""
    a = np.minimum(1.0 / np.sqrt(np.maximum(slope2, 1e-24)), 1.6)
    of: _Floats = np.where(a < 1.6, (1.0 - 1.259 * a + 0.396 * a * a) / (3.535 * a + 2.181 * a * a), 0.0)
    return of


def slope(w: _Floats, alpha: _Floats) -> _Floats:
    """The square of alpha times the tangent of directions (3, …)."""
    of: _Floats = ((alpha[0] * w[0]) ** 2 + (alpha[1] * w[1]) ** 2) / np.maximum(np.abs(w[2]), 1e-12) ** 2
    return of


def slope_even(cosine: _Floats, alpha: float) -> _Floats:
    """The same of isotropic roughness, by the cosine."""
    cosine2 = np.clip(cosine * cosine, 1e-24, 1.0)
    of: _Floats = alpha * alpha * (1.0 - cosine2) / cosine2
    return of


def passed_on(normal: _Floats, alpha: _Floats, out: _Floats, into: _Floats, beckmann: bool) -> _Floats:
    """Share of light that visible normals (3, …) of GGX pass on, between directions with such slopes.

    Of Beckmann's distribution, times the ratio of its density to that of GGX.
    """
    if not beckmann:
        here = 1.0 + smith(out)
        ggx: _Floats = here / (here + smith(into))
        return ggx
    steep = slope(normal, 1.0 / alpha)
    ratio = np.exp(-steep) * (1.0 + steep) ** 2
    of: _Floats = ratio * (1.0 + smith(out)) / (1.0 + smith_beckmann(out) + smith_beckmann(into))
    return of


def albedo(wo: _Floats, alpha: _Floats, grid: int = 384, beckmann: bool = False) -> tuple[float, float]:
    """Albedo of mirror-like facets, and the same weighted by (1 - c)^5."""
    m = facets(wo, alpha, grid)
    wo = wo[:, None, None]
    at = (m * wo).sum(axis=0)
    wi = 2.0 * at * m - wo
    seen = passed_on(m, alpha, slope(wo, alpha), slope(wi, alpha), beckmann)
    reflected = np.where(wi[2] > 0.0, seen, 0.0)
    return float(reflected.mean()), float((reflected * np.maximum(1.0 - at, 0.0) ** 5).mean())


def spread(count: int) -> tuple[_Floats, _Floats]:
    """Points (n,) of the unit square: a Fibonacci lattice."""
    last, size = 1, 1
    for _ in range(count):
        last, size = size, last + size
    turns: _Floats = np.mod(np.arange(size) * last, size) / size
    return turns, (np.arange(size) + 0.5) / size


def turned_albedo(wo: _Floats, alpha: _Floats, count: int = 19, beckmann: bool = False) -> _Floats:
    """Albedo of mirror-like facets that are rougher along x, for directions (3, n)."""
    turn, v = spread(count)
    stretched = alpha[:, None] * wo
    stretched = (stretched / np.linalg.norm(stretched, axis=0))[..., None]
    wo = wo[..., None]
    z = (1.0 - v) * (1.0 + stretched[2]) - stretched[2]
    r = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    x = alpha[0] * (r * np.cos(2.0 * np.pi * turn) + stretched[0])
    y = alpha[1] * (r * np.sin(2.0 * np.pi * turn) + stretched[1])
    z = np.maximum(z + stretched[2], 0.0)
    # wi = 2 (wo · m) m - wo for a facet m that is not yet normalised
    both = 2.0 * (wo[0] * x + wo[1] * y + wo[2] * z) / (x * x + y * y + z * z)
    wi = np.array([both * x - wo[0], both * y - wo[1], both * z - wo[2]])
    seen = passed_on(np.array([x, y, z]), alpha, slope(wo, alpha), slope(wi, alpha), beckmann)
    of: _Floats = np.where(wi[2] > 0.0, seen, 0.0).mean(axis=1)
    return of


def fitted(table: _Floats) -> _Floats:
    """Values at the nodes that halve the error of linear interpolation.

    The error has the sign of the curvature and is largest in the middle: all nodes are shifted by half of it.
    """
    of = table.copy()
    for axis in range(of.ndim):
        line = np.moveaxis(of, axis, 0)
        line[1:-1] -= (line[2:] - 2.0 * line[1:-1] + line[:-2]) / 14.0
    return np.minimum(of, 1.0)


def glass_albedo(cosine: _Floats, alpha: float, eta: float, count: int = 20, beckmann: bool = False) -> _Floats:
    """Albedo of glass facets, for directions with cosines (n,): `eta` is the index beyond relative to this side.

    Uses a lattice: regular grids have errors of 0.3 % if all facets beyond one angle reflect totally.
    """
    turn, v = spread(count)
    mu = cosine[:, None]
    sine = np.sqrt(np.maximum(1.0 - mu * mu, 0.0))
    length = np.sqrt((alpha * sine) ** 2 + mu * mu)
    x, z = alpha * sine / length, mu / length
    up = (1.0 - v) * (1.0 + z) - z
    r = np.sqrt(np.maximum(1.0 - up * up, 0.0))
    normal = np.array([alpha * (r * np.cos(2.0 * np.pi * turn) + x), alpha * r * np.sin(2.0 * np.pi * turn), up + z])
    normal[2] = np.maximum(normal[2], 0.0)
    normal /= np.sqrt((normal**2).sum(axis=0))
    at = np.minimum(normal[0] * sine + normal[2] * mu, 1.0)
    sine2 = (1.0 - at * at) / (eta * eta)
    beyond = np.sqrt(np.maximum(1.0 - sine2, 0.0))
    parallel = (eta * at - beyond) / np.maximum(eta * at + beyond, 1e-30)
    perpendicular = (at - eta * beyond) / np.maximum(at + eta * beyond, 1e-30)
    fresnel = np.where(sine2 >= 1.0, 1.0, (parallel**2 + perpendicular**2) / 2.0)
    back, through = 2.0 * at * normal[2] - mu, (at / eta - beyond) * normal[2] - mu / eta

    def seen(cosine: _Floats) -> _Floats:
        return passed_on(normal, alike(alpha), slope_even(mu, alpha), slope_even(cosine, alpha), beckmann)

    reflected, passed = np.where(back > 0.0, seen(back), 0.0), np.where(through < 0.0, seen(through), 0.0)
    of: _Floats = (fresnel * reflected + (1.0 - fresnel) * passed).mean(axis=1)
    return of


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
    """Albedo of sheen before scaling."""
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
    """Cosines of the columns of a row."""
    grid2 = (np.arange(size) / (size - 1)) ** 2
    of: _Floats = np.clip(alpha * grid2 / (1.0 + alpha - grid2), 1e-7, 1.0)
    return of


def glass_column(alpha: float, cosine: _Floats, ior: float, denser: bool) -> _Floats:
    """Column coordinate for glass of an index, seen from the denser medium or the thinner one.

    Columns are dense around a cosine of alpha and, within the denser medium, around the critical angle, where E bends
    within a few alphas. All layers have the bend in nearly the same column, and so has the interpolation between them.
    """
    by_slope = np.sqrt(cosine * (1.0 + alpha) / (cosine + alpha))
    if not denser:
        thinner: _Floats = 0.93 * by_slope + 0.07 * cosine**4
        return thinner
    critical = np.sqrt(1.0 - 1.0 / ior**2)

    def bend(mu: Any) -> Any:
        return (mu - critical) / (np.abs(mu - critical) + 3.0 * alpha)

    of: _Floats = 0.7 * by_slope + 0.07 * cosine**4 + 0.23 * (bend(cosine) - bend(0.0)) / (bend(1.0) - bend(0.0))
    return of


def glass_cosines(alpha: float, ior: float, denser: bool, size: int) -> _Floats:
    """Cosines of the columns of a row of glass."""
    even = np.linspace(0.0, 1.0, 1 << 13)
    around = np.sqrt(1.0 - 1.0 / ior**2) + alpha * np.sinh(np.linspace(-9.0, 9.0, 1 << 12))
    cosine = np.unique(np.concatenate([even, even**4, np.clip(around, 0.0, 1.0)]))
    column = glass_column(alpha, cosine, ior, denser)
    of: _Floats = np.maximum(np.interp(np.arange(size) / (size - 1), column, cosine), 1e-7)
    return of


def glass_index(layer: int, layers: int = layout.GLASS_LAYERS) -> float:
    """The index n of a layer of glass: uniform in 1.3 t / (t + 0.3), where t² is (n - 1) / (n + 1).

    Near n = 1, only the ratio of alpha and t matters, so layers there are nearly as dense as for a logarithm.
    """
    at = layer / (layers - 1)
    ratio = min((0.3 * at / (1.3 - at)) ** 2, 1.0 - 1e-7)
    return (1.0 + ratio) / (1.0 - ratio)


def glass_layer(ior: float) -> float:
    """The layer of an index."""
    t = np.sqrt((ior - 1.0) / (ior + 1.0))
    return float(1.3 * t / (t + 0.3) * (layout.GLASS_LAYERS - 1))


def alphas(size: int) -> _Floats:
    """Alphas of the rows."""
    of: _Floats = np.maximum((np.arange(size) / (size - 1)) ** 2, LEAST_ALPHA)
    return of


def average(row: _Floats, alpha: float) -> float:
    """2 ∫ E(μ) μ dμ of a row as interpolated by the kernels, over the column coordinate."""
    steps = 1 << 14
    at = (np.arange(steps) + 0.5) / steps
    cosine = alpha * at**2 / (1.0 + alpha - at**2)
    slope = 2.0 * at * alpha * (1.0 + alpha) / (1.0 + alpha - at**2) ** 2
    value = np.interp(at * (len(row) - 1), np.arange(len(row)), row)
    return float(2.0 * (value * cosine * slope).mean())


def glass_average(table: NDArray[np.uint16], alpha: float, ior: float, denser: bool) -> float:
    """1 - E_avg of a layer (R, C) of glass as interpolated by the kernels, over the fourth root of the cosine."""
    at = (np.arange(1 << 11) + 0.5) / (1 << 11)
    value = interpolated(table, np.sqrt(alpha), np.clip(glass_column(alpha, at**4, ior, denser), 0.0, 1.0))
    return float(2.0 * ((1.0 - value) * at**4 * 4.0 * at**3).mean())


def packed(table: Any) -> NDArray[np.uint16]:
    """Quantise to sixteen bits."""
    of: NDArray[np.uint16] = np.rint(np.clip(np.asarray(table), 0.0, 1.0) * 65535.0).astype("<u2")
    return of


def lost(table: NDArray[np.uint16]) -> NDArray[np.float32]:
    """(1 - E_avg) / alpha^(3/2) of a table of (…, rows, columns).

    For small alpha, 1 - E_avg changes too fast between rows for interpolation. So there are four times as many rows,
    each computed from the interpolated table.
    """
    rows, columns = table.shape[-2:]
    fine = 4 * (rows - 1) + 1
    of = []
    for block in (65535.0 - table.reshape(-1, rows, columns)) / 65535.0:
        for i, alpha in enumerate(alphas(fine)):
            row = min(i // 4, rows - 2)
            of.append(average(block[row] + (i / 4 - row) * (block[row + 1] - block[row]), alpha) / alpha**1.5)
    ratios = np.array(of).reshape(*table.shape[:-2], fine)
    # Alphas that small are deltas
    ratios[..., 0] = ratios[..., 1]
    return ratios.astype("<f4")


def even_tables(beckmann: bool) -> dict[str, NDArray[Any]]:
    """``ggx``, ``schlick`` and their averages."""
    rows, columns, size, cells = layout.GGX_ROWS, layout.GGX_COLUMNS, layout.SCHLICK_ROWS, layout.SCHLICK_COLUMNS

    def shares(cosine: float, alpha: float) -> tuple[float, float]:
        return albedo(seen_at(cosine), alike(alpha), beckmann=beckmann)

    table = packed([[shares(c, a)[0] for c in cosines(a, columns)] for a in alphas(rows)])
    mus = np.maximum((np.arange(cells) / (cells - 1)) ** 2, 1e-7)
    both = np.array([[shares(c, a) for c in mus] for a in alphas(size)])
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
    return {
        "ggx": table,
        "schlick": schlick,
        "ggx_lost": lost(table),
        "ggx_schlick": np.array(means, dtype="<f4"),
    }


def turned_facets(row: float, across: float) -> tuple[float, float]:
    """alpha_x and alpha_y from a row, 0 to 1, and from their distance."""
    most = max(row * row, LEAST_TURNED)
    least = (np.sqrt(most) + (np.sqrt(LEAST_TURNED) - np.sqrt(most)) * across) ** 2
    return most, float(least)


def turned_seen(most: float, least: float, seen: _Floats) -> _Floats:
    """Squared cosine of the azimuth from x at which the effective alpha is `seen`."""
    if most < least * (1.0 + 1e-9):
        return np.linspace(0.0, 1.0, len(seen))
    of: _Floats = np.clip((seen**2 - least**2) / (most**2 - least**2), 0.0, 1.0)
    return of


def turned_average(table: _Floats, most: float, least: float) -> float:
    """1 - E_avg of the (Q, C) part of the table for these facets, as interpolated by the kernels."""
    turns = len(table)
    angles = (np.arange(64) + 0.5) / 64 * np.pi / 2.0
    seen = np.sqrt((most * np.cos(angles)) ** 2 + (least * np.sin(angles)) ** 2)
    at = np.log(seen / least) / np.log(most / least) if most > least * (1.0 + 1e-9) else np.zeros_like(seen)
    means = []
    for x, alpha in zip(at * (turns - 1), seen, strict=True):
        lower = min(int(x), turns - 2)
        means.append(average(1.0 - table[lower] - (x - lower) * (table[lower + 1] - table[lower]), float(alpha)))
    return float(np.mean(means))


def turned_tables(beckmann: bool) -> dict[str, NDArray[Any]]:
    """``turned`` and ``turned_lost``."""
    rows, apart, turns, columns = layout.TURNED_ROWS, layout.TURNED_APART, layout.TURNED_TURNS, layout.TURNED_COLUMNS
    table = np.zeros((rows, apart, turns, columns))
    steps = [(i, j, *turned_facets(i / (rows - 1), j / (apart - 1))) for i in range(rows) for j in range(apart)]
    for i, j, most, least in steps:
        seen = least * (most / least) ** (np.arange(turns) / (turns - 1))
        for k, (alpha, along_x) in enumerate(zip(seen, turned_seen(most, least, seen), strict=True)):
            cosine = cosines(alpha, columns)
            sine = np.sqrt(1.0 - cosine**2)
            wo = np.array([sine * np.sqrt(along_x), sine * np.sqrt(1.0 - along_x), cosine])
            table[i, j, k] = turned_albedo(wo, np.array([most, least, 1.0]), beckmann=beckmann)
    kept = packed(fitted(table))
    averages = np.zeros((rows, apart))
    for i, j, most, least in steps:
        averages[i, j] = turned_average(kept[i, j] / 65535.0, most, least) / ((most + least) / 2.0) ** 1.5
    return {"turned": kept, "turned_lost": averages.astype("<f4")}


def glass_tables(beckmann: bool) -> dict[str, NDArray[Any]]:
    """``glass`` and ``glass_lost``."""
    layers, rows, columns = layout.GLASS_LAYERS, layout.GLASS_ROWS, layout.GLASS_COLUMNS
    sides = [(denser, glass_index(layer)) for denser in (False, True) for layer in range(layers)]
    table = [
        [
            glass_albedo(glass_cosines(a, n, denser, columns), a, 1.0 / n if denser else n, beckmann=beckmann)
            for a in alphas(rows)
        ]
        for denser, n in sides
    ]
    kept = packed(fitted(np.array(table).reshape(2, layers, rows, columns)))
    fine = alphas(layout.GLASS_LOST_ROWS)
    blocks = zip(sides, kept.reshape(-1, rows, columns), strict=True)
    averages = np.array([[glass_average(block, a, n, denser) / a for a in fine] for (denser, n), block in blocks])
    # Alphas that small are deltas
    averages[:, 0] = averages[:, 1]
    return {"glass": kept, "glass_lost": averages.reshape(2, layers, -1).astype("<f4")}


def turned_glass_turn(most: _Floats, least: _Floats, along_x: _Floats) -> _Floats:
    """Coordinate, 0 to 1, of the squared cosine of the azimuth from x."""
    seen2 = along_x * most**2 + (1.0 - along_x) * least**2
    ratio = np.log(np.maximum(most / least, 1.0 + 1e-6))
    of: _Floats = 0.4 * np.clip(0.5 * np.log(seen2 / least**2) / ratio, 0.0, 1.0) + 0.6 * along_x
    return of


def turned_glass_column(mu: _Floats, seen: _Floats, most: _Floats, ior: _Floats, denser: bool) -> _Floats:
    """Coordinate, 0 to 1, of the cosine `mu`."""
    by_seen, by_most = (np.sqrt(mu * (1.0 + alpha) / (mu + alpha)) for alpha in (seen, most))
    if not denser:
        thinner: _Floats = 0.5 * (by_seen + by_most)
        return thinner
    critical, wide = np.sqrt(1.0 - 1.0 / ior**2), 3.0 * seen + 0.6 * most

    def bend(apart: Any) -> Any:
        return apart / (np.abs(apart) + wide)

    low, high = bend(-critical), bend(1.0 - critical)
    of: _Floats = 0.4 * (by_seen + by_most) + 0.2 * (bend(mu - critical) - low) / (high - low)
    return of


def inverse(function: Any, values: _Floats) -> _Floats:
    """Where a function that grows from 0 to 1 has values, by bisection."""
    low, high = np.zeros_like(values), np.ones_like(values)
    for _ in range(50):
        middle = (low + high) / 2.0
        less = function(middle) < values
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    of: _Floats = (low + high) / 2.0
    return of


def turned_glass_nodes(layer: int, row: int, denser: bool) -> tuple[_Floats, _Floats, float]:
    """alpha_x and alpha_y, directions (3, …), and the index beyond over this side's, of a row's part (A, Q, C)."""
    shape = (layout.TURNED_GLASS_APART, layout.TURNED_GLASS_TURNS, layout.TURNED_GLASS_COLUMNS)
    apart, turn, column = np.meshgrid(*(np.arange(size) / (size - 1) for size in shape), indexing="ij")
    most, least = turned_glass_facets(np.full(shape, row / (layout.TURNED_GLASS_ROWS - 1)), apart)
    along_x = inverse(lambda x: turned_glass_turn(most, least, x), turn)
    seen = np.sqrt(along_x * most**2 + (1.0 - along_x) * least**2)
    ior = glass_index(layer, layout.TURNED_GLASS_LAYERS)
    mu = np.maximum(inverse(lambda x: turned_glass_column(x, seen, most, np.array(ior), denser), column), 1e-6)
    sine = np.sqrt(1.0 - mu**2)
    wo = np.array([sine * np.sqrt(along_x), sine * np.sqrt(1.0 - along_x), mu])
    return np.array([most, least]), wo, 1.0 / ior if denser else ior


def turned_glass_facets(row: _Floats, across: _Floats) -> tuple[_Floats, _Floats]:
    """As turned_facets, of arrays."""
    most = np.maximum(row * row, LEAST_TURNED)
    least = (np.sqrt(most) + (np.sqrt(LEAST_TURNED) - np.sqrt(most)) * across) ** 2
    return most, least


def turned_glass_albedo(wo: _Floats, alpha: _Floats, eta: float, count: int = 18) -> _Floats:
    """Albedo of glass facets with alphas (2, n), for directions (3, n)."""
    turn, v = spread(count)
    alpha = np.array([*alpha, np.ones(alpha.shape[1])])[..., None]
    stretched = alpha[..., 0] * wo
    stretched = (stretched / np.linalg.norm(stretched, axis=0))[..., None]
    wo = wo[..., None]
    z = (1.0 - v) * (1.0 + stretched[2]) - stretched[2]
    r = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    x, y = r * np.cos(2.0 * np.pi * turn) + stretched[0], r * np.sin(2.0 * np.pi * turn) + stretched[1]
    m = np.array([alpha[0] * x, alpha[1] * y, np.maximum(z + stretched[2], 0.0)])
    m /= np.sqrt((m**2).sum(axis=0))
    at = np.clip((m * wo).sum(axis=0), 0.0, 1.0)
    sine2 = (1.0 - at * at) / (eta * eta)
    beyond = np.sqrt(np.maximum(1.0 - sine2, 0.0))
    parallel = (eta * at - beyond) / np.maximum(eta * at + beyond, 1e-30)
    perpendicular = (at - eta * beyond) / np.maximum(at + eta * beyond, 1e-30)
    fresnel = np.where(sine2 >= 1.0, 1.0, (parallel**2 + perpendicular**2) / 2.0)
    back, through = 2.0 * at * m - wo, (at / eta - beyond) * m - wo / eta
    here = 1.0 + smith(slope(wo, alpha))
    reflected = np.where(back[2] > 0.0, here / (here + smith(slope(back, alpha))), 0.0)
    passed = np.where(through[2] < 0.0, here / (here + smith(slope(through, alpha))), 0.0)
    of: _Floats = (fresnel * reflected + (1.0 - fresnel) * passed).mean(axis=1)
    return of


def turned_glass_at(table: NDArray[np.uint16], denser: bool, at: tuple[Any, ...]) -> _Floats:
    """The table as interpolated by the kernels, at a layer, alphas, an index, an azimuth and a cosine."""
    layer, most, least, ior, along_x, mu = np.broadcast_arrays(*at)
    seen = np.sqrt(along_x * most**2 + (1.0 - along_x) * least**2)
    across = np.sqrt(most) - np.sqrt(least)
    spans = np.maximum(np.sqrt(most) - np.sqrt(LEAST_TURNED), 1e-9)
    turn = turned_glass_turn(most, least, along_x)
    column = turned_glass_column(mu, seen, most, ior, denser)
    lower, parts = [], []
    for place, size in zip((layer, np.sqrt(most), across / spans, turn, column), table.shape[1:], strict=True):
        y = np.clip(place, 0.0, 1.0) * (size - 1)
        lower.append(np.minimum(y.astype(int), size - 2))
        parts.append(y - lower[-1])
    total = np.zeros(mu.shape)
    for corner in np.ndindex(2, 2, 2, 2, 2):
        weights = [part if up else 1.0 - part for up, part in zip(corner, parts, strict=True)]
        index = tuple(low + up for low, up in zip(lower, corner, strict=True))
        total += np.prod(weights, axis=0) * table[int(denser)][index] / 65535.0
    return total


def turned_glass_tables() -> dict[str, NDArray[Any]]:
    """``turned_glass`` and ``turned_glass_lost``."""
    layers, rows = layout.TURNED_GLASS_LAYERS, layout.TURNED_GLASS_ROWS
    shape = (layout.TURNED_GLASS_APART, layout.TURNED_GLASS_TURNS, layout.TURNED_GLASS_COLUMNS)
    table = np.zeros((2, layers, rows, *shape))
    for side, layer, row, apart in np.ndindex(2, layers, rows, shape[0]):
        alpha, wo, eta = turned_glass_nodes(layer, row, side == 1)
        part = turned_glass_albedo(wo[:, apart].reshape(3, -1), alpha[:, apart].reshape(2, -1), eta)
        table[side, layer, row, apart] = part.reshape(shape[1:])
    kept = packed(np.stack([fitted(half) for half in table]))
    return {"turned_glass": kept, "turned_glass_lost": turned_glass_lost(kept)}


def turned_glass_lost(kept: NDArray[np.uint16]) -> NDArray[np.float32]:
    """(1 - E_avg) over the mean alpha."""
    layers, rows = layout.TURNED_GLASS_LAYERS, layout.TURNED_GLASS_LOST_ROWS
    apart = layout.TURNED_GLASS_LOST_APART
    steps = (np.arange(48) + 0.5) / 48
    mu = steps[:, None] ** 3
    weight = 2.0 * mu * 3.0 * steps[:, None] ** 2
    along_x = np.cos((np.arange(12) + 0.5) / 12 * np.pi / 2.0) ** 2
    of = np.zeros((2, layers, rows, apart))
    for side, layer, row in np.ndindex(2, layers, rows):
        facets = turned_glass_facets(np.full(apart, row / (rows - 1)), np.arange(apart) / (apart - 1))
        most, least = (each[:, None, None] for each in facets)
        at = (layer / (layers - 1), most, least, glass_index(layer, layers), along_x, mu)
        lost = (weight * (1.0 - turned_glass_at(kept, side == 1, at))).mean(axis=(1, 2))
        of[side, layer, row] = lost / ((most + least) / 2.0)[:, 0, 0]
    return of.astype("<f4")


def facet_tables(beckmann: bool) -> dict[str, NDArray[Any]]:
    """Those of one distribution of facets."""
    return {**even_tables(beckmann), **turned_tables(beckmann), **glass_tables(beckmann)}


def sheen_tables() -> dict[str, NDArray[Any]]:
    """``sheen``, ``sheen_scale`` and ``sheen_mean``."""
    rows, columns = layout.SHEEN_ROWS, layout.SHEEN_COLUMNS
    at = np.arange(columns) / (columns - 1)
    table = np.array([[sheen_albedo(max(x * x, 1e-3), max(a, 0.0025)) for x in at] for a in alphas(rows)])
    scale = 1.0 / np.maximum(table.max(axis=1) * 1.005, 1.0)
    kept = packed(table * scale[:, None])
    steps = (np.arange(1 << 13) + 0.5) / (1 << 13)
    means = np.array([(np.interp(steps, at, row / 65535.0) * 4.0 * steps**3).mean() for row in kept])
    return {"sheen": kept, "sheen_scale": scale.astype("<f4"), "sheen_mean": means.astype("<f4")}


def interpolated(table: NDArray[np.uint16], row: float, columns: _Floats) -> _Floats:
    """A line of a table at a row from 0 to 1 and columns from 0 to 1, as interpolated by the kernels."""
    y = row * (len(table) - 1)
    lower = min(int(y), len(table) - 2)
    line = (table[lower] * (lower + 1.0 - y) + table[lower + 1] * (y - lower)) / 65535.0
    of: _Floats = np.interp(columns * (table.shape[1] - 1), np.arange(table.shape[1]), line)
    return of


def slant_tables(of: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """``slants``, ``slant_numbers`` and ``beckmann_slants``, from the other tables."""
    nodes, weights = np.polynomial.legendre.leggauss(600)
    mu = ((nodes + 1.0) / 2.0) ** 2
    weight = weights * (nodes + 1.0) * mu  # for 2 ∫ … μ dμ
    rows = np.maximum(np.arange(layout.SLANT_ROWS) / (layout.SLANT_ROWS - 1), np.sqrt(LEAST_TURNED))
    lines = []
    for row in rows:
        for facets in ("", "beckmann_"):
            e = interpolated(of[f"{facets}ggx"], row, np.sqrt(mu * (1.0 + row**2) / (mu + row**2)))
            lines += [e, e * interpolated(of[f"{facets}schlick"], row, np.sqrt(mu)) ** 5]
        lines.append(interpolated(of["sheen"], max(row, 0.1), np.sqrt(mu)))
    whole = np.array([line - (line * weight).sum() for line in lines]).reshape(-1, 5, len(mu))
    varying = whole[:, [0, 1, 4]]
    # Layers of metal alone have no diffuse surface below
    _, _, axes = np.linalg.svd(varying[:, 1:].reshape(-1, len(mu)) * np.sqrt(weight), full_matrices=False)
    b, c = (axis * np.sign(axis.sum()) / np.sqrt(weight) for axis in axes[:2])
    components = np.stack([(whole * axis * weight).sum(axis=2) for axis in (b, c)], axis=-1)
    words = np.rint(np.clip((components + 0.05) / 0.2, 0.0, 1.0) * 65535.0).astype(np.uint32)
    # EON (kernels/material/eon.h), over all azimuths, in white: 1 + r A Q
    sine, g = np.sqrt(1.0 - mu * mu), 1.0 - mu
    albedo_fit = g * (0.0571085289 + g * (0.491881867 + g * (-0.332181442 + g * 0.0714429953)))
    c1, c2 = 0.5 - 2.0 / (3.0 * np.pi), 2.0 / 3.0 - 28.0 / (15.0 * np.pi)
    missing = np.maximum(c1 - albedo_fit, 0.0)
    once = sine[:, None] * sine / np.pi * (1.0 / np.maximum(mu[:, None], mu) - 1.0) - c1
    eon = (once + missing[:, None] * missing / (c1 - c2)) * weight
    along_b, along_c = eon @ b, eon @ c
    averages = [(x * weight).sum() for x in (b**3, b * b * c, b * along_b, b * along_c, c * along_c)]
    fits = [np.polynomial.polynomial.polyfit(mu, y, n, w=np.sqrt(weight)) for y, n in ((along_b, 6), (along_c, 4))]
    numbers = np.concatenate([averages, *fits])
    slants = (words[..., 0] | words[..., 1] << 16).T.astype("<u4")
    of_ggx, of_beckmann = slants[[0, 1, 4]], slants[2:4]
    return {"slants": of_ggx, "slant_numbers": numbers.astype("<f4"), "beckmann_slants": of_beckmann}


def covered_tables(of: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """``covered`` and ``covered_mean``, from the other tables."""
    layers, rows, columns = layout.COVERED_LAYERS, layout.COVERED_ROWS, layout.COVERED_COLUMNS
    mus = np.maximum((np.arange(columns) / (columns - 1)) ** 2, 1e-4)
    turn, v = spread(16)
    even = (np.arange(512) + 0.5) / 512

    def metal(row: float, mu: _Floats) -> _Floats:
        return interpolated(of["ggx"], row, np.sqrt(mu * (1.0 + row**2) / (mu + row**2)))

    def cover(which: int, layer: float, mu: _Floats) -> _Floats:
        if which == 1:
            return interpolated(of["sheen"], layer, np.sqrt(mu))
        part = 0.04 + 0.96 * interpolated(of["schlick"], layer, np.sqrt(mu)) ** 5
        return metal(layer, mu) * part

    table = np.zeros((2, layers, rows, columns))
    for j in range(rows):
        row = max(j / (rows - 1), np.sqrt(LEAST_TURNED))
        average_lost = float((2.0 * even * (1.0 - metal(row, even))).mean())
        for k, mu in enumerate(mus):
            wo, alpha = seen_at(mu), alike(row**2)
            stretched = alpha * wo / np.linalg.norm(alpha * wo)
            z = (1.0 - v) * (1.0 + stretched[2]) - stretched[2]
            r = np.sqrt(np.maximum(1.0 - z * z, 0.0))
            m = np.array([r * np.cos(2.0 * np.pi * turn), r * np.sin(2.0 * np.pi * turn), z]) + stretched[:, None]
            m = alpha[:, None] * m
            m /= np.linalg.norm(m, axis=0)
            wi = 2.0 * (wo @ m) * m - wo[:, None]
            seen = passed_on(m, alpha, slope(wo, alpha), slope(wi, alpha), beckmann=False)
            seen = np.where(wi[2] > 0.0, seen, 0.0)
            beyond = np.clip(wi[2], 1e-6, 1.0)
            # Multiple scattering goes to μ with density 2 μ (1 - E(μ)) / (1 - E_avg)
            often = (1.0 - float(metal(row, mus[k : k + 1])[0])) * 2.0 * even * (1.0 - metal(row, even)) / average_lost
            for which in (0, 1):
                for i in range(layers):
                    layer = max(i / (layers - 1), 0.1 if which else np.sqrt(LEAST_TURNED))
                    here = cover(which, layer, mus[k : k + 1])[0]
                    once = seen * np.maximum(cover(which, layer, beyond) - here, 0.0)
                    again = often * np.maximum(cover(which, layer, even) - here, 0.0)
                    table[which, i, j, k] = once.mean() + again.mean()
    kept = packed(table * 4.0)
    at = np.arange(columns) / (columns - 1)
    steps = (np.arange(4096) + 0.5) / 4096
    flat = kept.reshape(-1, columns) / 262140.0
    means = [(np.interp(steps, at, line) * 4.0 * steps**3).mean() for line in flat]
    return {"covered": kept, "covered_mean": np.array(means).reshape(2, layers, rows).astype("<f4")}


def tables() -> dict[str, NDArray[Any]]:
    """All tables, by their names in the file."""
    made = {**facet_tables(beckmann=False), **turned_glass_tables(), **sheen_tables()}
    made |= {f"beckmann_{name}": table for name, table in facet_tables(beckmann=True).items()}
    return made | {**slant_tables(made), **covered_tables(made)}


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
