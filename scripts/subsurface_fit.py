#!/usr/bin/env python3
"""Make the table of `clrender/flatten/subsurface.py`, which maps reflectance to single-scattering albedo.

The reflectance of a half-space, for cosine-distributed incident light, by discrete ordinates (Chandrasekhar, Radiative
Transfer, 1960): Gauss points in each hemisphere, the phase function as a Legendre series, and the solutions that decay
with depth. The fit is to van de Hulst's s = √((1 - α) / (1 - α g)), as (1 - A) (1 + A q) with q a Chebyshev series in
g / MOST_G and 2 √A - 1.

Prints the table; `--check` compares with it instead.
"""

from __future__ import annotations

import sys
from functools import lru_cache
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.flatten.subsurface import SERIES, single_scattering
from clrender.scene.materials import MOST_G

_Floats: TypeAlias = npt.NDArray[np.float64]
POINTS = 64
ORDERS = (14, 10)  # in g, and in √A


@lru_cache(maxsize=64)
def kernel(g: float) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Cosines, weights, and the scattering matrices of the even and odd parts of the radiance, times √weights."""
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    cosines, weights = (nodes + 1.0) / 2.0, weights / 2.0
    orders = np.arange(2 * POINTS)
    polynomials = np.polynomial.legendre.legvander(cosines, 2 * POINTS - 1) * np.sqrt(weights)[:, None]
    moments = (2 * orders + 1) * np.power(g, orders)
    moments[np.abs(moments) < 1e-30] = 0.0
    even, odd = ((polynomials[:, k::2] * moments[k::2]) @ polynomials[:, k::2].T for k in (0, 1))
    return cosines, weights, even, odd


def half_space(alpha: float, g: float) -> float:
    """Reflectance of a half-space; `alpha`, below 1, is the single-scattering albedo."""
    cosines, weights, even, odd = kernel(g)
    sums, differences = np.eye(POINTS) - alpha * even, np.eye(POINTS) - alpha * odd
    lower = np.linalg.cholesky(sums)
    symmetric = lower.T @ (differences / cosines[:, None] / cosines) @ lower
    rates, modes = np.linalg.eigh((symmetric + symmetric.T) / 2.0)
    both = np.linalg.solve(lower.T, modes)
    apart = -(sums @ both) / cosines[:, None] / np.sqrt(rates)
    shares = np.linalg.solve((both - apart) / 2.0, np.sqrt(weights))
    return float(2.0 * (np.sqrt(weights) * cosines) @ ((both + apart) / 2.0 @ shares))


def solved(albedo: float, g: float) -> float:
    """s for a reflectance, by bisection."""
    low, high = 0.0, 1.0
    while high - low > 1e-13:
        middle = (low + high) / 2.0
        square = middle * middle
        if half_space((1.0 - square) / (1.0 - g * square), g) > albedo:
            low = middle
        else:
            high = middle
    return (low + high) / 2.0


def series() -> _Floats:
    """The table: Chebyshev coefficients of q."""
    in_g, in_root = (np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in ORDERS)
    albedos = ((in_root + 1.0) / 2.0) ** 2
    q = np.array([[(solved(a, g * MOST_G) / (1.0 - a) - 1.0) / a for a in albedos] for g in in_g])
    left, right = (np.polynomial.chebyshev.chebvander(x, n - 1) for x, n in zip((in_g, in_root), ORDERS, strict=True))
    return np.asarray(np.linalg.solve(left, q) @ np.linalg.inv(right).T)


def main() -> int:
    """Print the table, or check it."""
    made = series()
    if "--check" in sys.argv[1:]:
        apart = float(np.abs(made - np.array(SERIES)).max())
        albedos, gs = (0.001, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.995), np.linspace(-MOST_G, MOST_G, 15)
        error = max(abs(half_space(single_scattering(a, g), g) / a - 1.0) for a in albedos for g in gs.tolist())
        print(f"coefficients differ by {apart:.1e}; albedos are off by {100.0 * error:.3f} % at most")
        return int(apart > 2e-6 or error > 5e-4)
    for row in made:
        print(f"    ({', '.join(f'{x:.6f}' for x in row)}),")
    return 0


if __name__ == "__main__":
    sys.exit(main())
