"""Mean Fresnel reflectance of smooth boundaries between dielectrics."""

from __future__ import annotations

import math

import numpy as np

__all__ = ["external_reflectance", "internal_reflectance"]

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
