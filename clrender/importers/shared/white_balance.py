"""White balance: the colour matrix that makes light of a temperature white."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import inverse, product, times
from clrender.spectra.colors import TO_REC709, blackbody_xyz

__all__ = ["daylight_xyz", "white_balance"]

_Floats = NDArray[np.float64]
_CONES: Final = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""Responses of sharpened cones to XYZ (Lam, "Metamerism and Colour Constancy", Bradford 1985)."""
_C2_RATIO: Final = 1.4388 / 1.4380
"""The formulas of daylight are of 1964, with another value of the radiation constant hc / k."""
_LEAST_DAYLIGHT: Final = 4000.0
"""Lowest colour temperature for which daylight is defined, kelvin."""


def daylight_xyz(kelvin: float) -> _Floats:
    """XYZ of daylight of luminance 1 (CIE 15, illuminants D); of a black body below 4000 K, as in pbrt.

    Parameters
    ----------
    kelvin : float
        Colour temperature, up to 25000.

    Returns
    -------
    (3,) float64
    """
    t = kelvin * _C2_RATIO
    if t < _LEAST_DAYLIGHT:
        xyz = blackbody_xyz(t)
        return np.asarray(xyz / xyz[1])
    if t <= 7000.0:
        x = 0.244063 + 0.09911e3 / t + 2.9678e6 / (t * t) - 4.6070e9 / (t * t * t)
    else:
        x = 0.237040 + 0.24748e3 / t + 1.9018e6 / (t * t) - 2.0064e9 / (t * t * t)
    y = -3.0 * x * x + 2.870 * x - 0.275
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def white_balance(kelvin: float) -> _Floats:
    """Matrix on linear Rec. 709 that makes daylight of a temperature white, by von Kries' rule (PBR 4ed, 5.4.2).

    Parameters
    ----------
    kelvin : float
        See `daylight_xyz`.

    Returns
    -------
    (3, 3) float64
    """
    from_rec709 = inverse(TO_REC709)
    white = times(from_rec709, np.ones(3))
    gains = times(_CONES, white) / times(_CONES, daylight_xyz(kelvin))
    adapted = product(inverse(_CONES), product(np.diag(gains), _CONES))
    return product(TO_REC709, product(adapted, from_rec709))
