"""Fresnel reflectance of smooth boundaries: its mean over directions between dielectrics, and that straight on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["below_coat", "conductor_reflectance", "external_reflectance", "immersed", "internal_reflectance"]

_POINTS = 4096


def external_reflectance(ior: float) -> float:
    """Fraction of diffuse light that a smooth boundary reflects on its outside.

    Parameters
    ----------
    ior : float
        Index of refraction inside relative to that outside; at least 1.

    Notes
    -----
    The integral of the Fresnel reflectance over the squared cosine, from 0 to 1, by the midpoint rule.
    """
    cosine = np.sqrt((np.arange(_POINTS) + 0.5) / _POINTS)
    inner = np.sqrt(1.0 - (1.0 - cosine * cosine) / (ior * ior))
    s = (cosine - ior * inner) / (cosine + ior * inner)
    p = (ior * cosine - inner) / (ior * cosine + inner)
    return math.fsum((s * s + p * p).tolist()) / (2.0 * _POINTS)


def internal_reflectance(ior: float) -> float:
    """Like `external_reflectance`, on the inside: 1 - (1 - external) / ior^2."""
    return 1.0 - (1.0 - external_reflectance(max(ior, 1.0))) / (max(ior, 1.0) * max(ior, 1.0))


def conductor_reflectance(eta: float, k: float) -> float:
    """Reflectance at normal incidence of an index of refraction eta + i k, relative to the medium outside."""
    return ((eta - 1.0) * (eta - 1.0) + k * k) / ((eta + 1.0) * (eta + 1.0) + k * k)


def immersed(reflectance: NDArray[np.floating], ior: float) -> NDArray[np.float64]:
    """Reflectance at normal incidence, in a medium, of metals that have a given one in vacuum.

    Parameters
    ----------
    reflectance : (...) floats
        0 to 1; metals of an index of 1 + i k, as in pbrt.
    ior : float
        Index of refraction of the medium.
    """
    # With k² = 4 r / (1 - r), and everything multiplied by (1 - r)
    x = np.asarray(reflectance, np.float64)
    dark, bright = 1.0 - x, 4.0 * x
    return np.asarray(
        ((ior - 1.0) * (ior - 1.0) * dark + bright) / ((ior + 1.0) * (ior + 1.0) * dark + bright), np.float64
    )


def below_coat(reflectance: NDArray[np.floating], ior: float) -> NDArray[np.float64]:
    """What a mirror below a smooth coat reflects of the light that enters it, at normal incidence.

    Parameters
    ----------
    reflectance : (...) floats
        Of the mirror, in the coat.
    ior : float
        Index of refraction of the coat.

    Notes
    -----
    The coat reflects the share f on either side, so that r (1 - f) (1 + r f + r² f² + …) leaves it again.
    """
    share = conductor_reflectance(ior, 0.0)
    x = np.asarray(reflectance, np.float64)
    return np.asarray(x * (1.0 - share) / (1.0 - x * share), np.float64)
