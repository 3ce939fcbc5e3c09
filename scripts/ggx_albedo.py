#!/usr/bin/env python3
"""Make `clrender/scene/ggx_albedo.npy`: the share of light that GGX microfacets reflect after one bounce.

Facets are perfect mirrors. The integral over visible normals is a mean of G2/G1 over a grid in the sampler's square
(Dupuy and Benyoub 2023), in double precision. `--check` compares with the file in place of writing it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clrender.layout import GGX_TABLE_SIZE

FILE = Path(__file__).resolve().parent.parent / "clrender" / "scene" / "ggx_albedo.npy"
GRID = 512


def albedo(cosine: float, alpha: float) -> float:
    """E(μ, alpha)."""
    u = (np.arange(GRID) + 0.5) / GRID
    turn, v = np.meshgrid(u, u, indexing="ij")
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    stretched = np.array([alpha * sine, 0.0, cosine])
    stretched /= np.linalg.norm(stretched)
    z = (1.0 - v) * (1.0 + stretched[2]) - stretched[2]
    r = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    # Both halves of the turn are alike
    x, y = r * np.cos(np.pi * turn) + stretched[0], r * np.sin(np.pi * turn)
    facet = np.array([alpha * x, alpha * y, np.maximum(z + stretched[2], 0.0)])
    facet /= np.sqrt((facet**2).sum(axis=0))
    wo = np.array([sine, 0.0, cosine])[:, None, None]
    wi = 2.0 * (facet * wo).sum(axis=0) * facet - wo
    seen = (1.0 + _lambda(wo, alpha)) / (1.0 + _lambda(wo, alpha) + _lambda(wi, alpha))
    return float(np.where(wi[2] > 0.0, seen, 0.0).mean())


def _lambda(w: NDArray[np.float64], alpha: float) -> NDArray[np.float64]:
    slope2: NDArray[np.float64] = alpha * alpha * (w[0] ** 2 + w[1] ** 2) / np.maximum(w[2], 1e-12) ** 2
    return (np.sqrt(1.0 + slope2) - 1.0) / 2.0


def table() -> NDArray[np.float32]:
    """As `clrender.scene.microfacets.ggx_albedos` describes it."""
    grid = np.arange(GGX_TABLE_SIZE) / (GGX_TABLE_SIZE - 1)
    rows = []
    for alpha in np.maximum(grid**2, 1e-5):
        cosines = np.clip(alpha * grid**2 / (1.0 + alpha - grid**2), 1e-7, 1.0)
        rows.append([albedo(cosine, alpha) for cosine in cosines])
    return np.array(rows, dtype="<f4")


if __name__ == "__main__":
    made = table()
    if "--check" not in sys.argv:
        np.save(FILE, made)
    elif np.abs(np.load(FILE) - made).max() > 1e-6:
        sys.exit(f"{FILE} is not what {Path(__file__).name} makes")
