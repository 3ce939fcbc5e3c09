"""Half-spaces that scatter light below a smooth boundary: what share of the light that enters leaves again."""

from __future__ import annotations

import math
from functools import cache
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import inner, total

__all__ = ["albedo_without_boundary", "h_function", "returned"]

_Floats: TypeAlias = NDArray[np.float64]
_POINTS: Final = 24
_CLOSE: Final = 1e-13
_MOST_STEPS: Final = 4000
_HALVINGS: Final = 32
_DIGITS: Final = 6
"""Decimals of results. Gauss points come from a solver of eigenvalues, whose last bits differ between processors."""


@cache
def _nodes(ior: float) -> tuple[_Floats, _Floats, _Floats]:
    """Cosines in (0, 1), their weights, and the reflectance of the boundary from inside, which is 1 below a cosine."""
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    critical = math.sqrt(max(1.0 - 1.0 / (ior * ior), 0.0))
    spans = [(low, high) for low, high in ((0.0, critical), (critical, 1.0)) if high > low]
    cosines = np.concatenate([low + (high - low) * (points + 1.0) / 2.0 for low, high in spans])
    shares = np.concatenate([(high - low) * weights / 2.0 for low, high in spans])
    outside = np.sqrt(np.maximum(1.0 - ior * ior * (1.0 - cosines * cosines), 0.0))
    s = (ior * cosines - outside) / (ior * cosines + outside)
    p = (cosines - ior * outside) / (cosines + ior * outside)
    return cosines, shares, np.where(cosines > critical, (s * s + p * p) / 2.0, 1.0)


def h_function(root: float, cosines: _Floats, weights: _Floats) -> _Floats:
    """Chandrasekhar's H function for isotropic scattering (Radiative Transfer, 1960, section 37).

    Parameters
    ----------
    root : float
        √(1 - α), where α is the single-scattering albedo.
    cosines, weights : (n,) float64
        Points of a quadrature on (0, 1), at which it is found.

    Returns
    -------
    (n,) float64
    """
    kernel = (1.0 - root * root) / 2.0 * (weights * cosines) / (cosines[:, None] + cosines)
    found = np.ones(len(cosines))
    for _ in range(_MOST_STEPS):
        better = (found + 1.0 / (root + inner(kernel, found))) / 2.0
        change = float(np.abs(better - found).max())
        found = better
        if change < _CLOSE:
            break
    return found


def returned(root: float, ior: float) -> tuple[float, float]:
    """Shares of diffuse light that an isotropically scattering half-space returns.

    Parameters
    ----------
    root : float
        √(1 - α), where α is the single-scattering albedo.
    ior : float
        Index of refraction of its boundary; at least 1.

    Returns
    -------
    plain : float
        Of incident light, if there were no boundary.
    entered : float
        Of the light that enters through the boundary, which reflects what comes from inside.
    """
    cosines, weights, mirrored = _nodes(ior)
    h = h_function(root, cosines, weights)
    plain = 1.0 - root * float(total(2.0 * weights * cosines * h))
    # From each direction inward to each outward, per flux
    scattered = (1.0 - root * root) / 2.0 * h[:, None] * (weights * cosines * h) / (cosines[:, None] + cosines)
    leaves = np.zeros(len(cosines))
    for _ in range(_MOST_STEPS):
        better = inner(scattered, 1.0 - mirrored + mirrored * leaves)
        change = float(np.abs(better - leaves).max())
        leaves = better
        if change < _CLOSE:
            break
    entering = weights * cosines * (1.0 - mirrored)
    return plain, float(total(entering * leaves)) / float(total(entering))


@cache
def albedo_without_boundary(share: float, ior: float) -> float:
    """The albedo of a half-space of which a given share of the light that enters leaves again.

    Parameters
    ----------
    share : float
        0 to 1, below a smooth boundary.
    ior : float
        Index of refraction of the boundary; at least 1.

    Returns
    -------
    float
        Share of cosine-distributed light that the half-space returns without the boundary.
    """
    if not 0.0 < share < 1.0:
        return share
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if returned(middle, ior)[1] > share else (low, middle)
    return round(returned((low + high) / 2.0, ior)[0], _DIGITS)
