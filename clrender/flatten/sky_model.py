"""Radiance of the sky and of the sun on a clear day, by the Hošek-Wilkie model.

The sky is that of Hošek and Wilkie, "An Analytic Model for Full Spectral Sky-Dome Radiance" (ACM TOG 31(4), 2012), in
its data set for linear Rec. 709; the sun that of "Adding a Solar-Radiance Function to the Hošek-Wilkie Skylight Model"
(IEEE CG&A 33(3), 2013), which is spectral. Both were fitted to a simulation of the atmosphere by the authors; their
data are `hosek_wilkie.npz`, with the licence beside it.

Radiance is in clrender's units: luminance over 683 lm/W. The channels are Rec. 709, from the integrals of spectral
radiance times the CIE 1931 colour matching functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.elementary import arctangent, exponential
from clrender.scene.values import Color

__all__ = ["SUN_DEGREES", "SunDisc", "sky_radiance", "spectrum_of_the_sun", "sun_disc"]

SUN_DEGREES: Final = 0.2666
"""Angular radius of the sun: 959.6 seconds of arc from the mean distance of the earth."""
_ELEVATIONS: Final = 45
"""Number of pieces of the sun's radiance polynomials."""
_CHANNELS: Final = np.array(
    [
        (0.00000, 0.00000, 0.00000),
        (0.02061, -0.01756, 0.12292),
        (1.53656, -1.38663, 10.16501),
        (5.07430, -5.85808, 59.37861),
        (-12.27413, 9.75254, 36.80553),
        (-28.19678, 45.62793, 0.22350),
        (19.57972, 47.28342, -5.95274),
        (84.42454, 10.20197, -2.96010),
        (50.01222, -3.39197, -0.58903),
        (7.98857, -0.82247, -0.05932),
        (0.49563, -0.05375, -0.00334),
    ]
)
"""Weights of spectral radiance at 320, 360 ... 720 nm for red, green and blue, nm: integrals of the CIE 1931 colour
matching functions, converted to Rec. 709, times hat functions centred at these wavelengths."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SunDisc:
    """Radiance of the sun's disc.

    Attributes
    ----------
    darkening : (3, 6) float64
        Limb darkening of each channel: coefficients of the radiance, W/(sr m2), as a polynomial in the cosine of the
        angle between ray and surface normal, the constant first.
    mean : (3,) float
        Mean over the disc, by solid angle.
    """

    darkening: _Floats
    mean: Color


def sky_radiance(elevation: float, turbidity: float, albedo: Color, up: _Floats, apart: _Floats) -> _Floats:
    """Radiance of the sky without the sun's disc, (3, ...), W/(sr m2).

    Parameters
    ----------
    elevation : float
        Elevation of the sun, degrees, 0 to 90.
    turbidity : float
        1 to 10.
    albedo : (3,) float
        Albedo of the ground.
    up : ndarray of float64
        Cosine of the angle between a direction and the zenith, at least 0.
    apart : ndarray of float64
        Squared distance between the unit vectors of the direction and of the sun, 0 to 4.
    """
    data = _data()
    controls = _at_turbidity(data["sky_parameters"], turbidity), _at_turbidity(data["sky_radiance"], turbidity)
    weights = _bernstein(_cube_root(elevation / 90.0))
    angle = 4.0 * arctangent(np.sqrt(apart) / (2.0 + np.sqrt(4.0 - apart)))
    cosine, root = 1.0 - 0.5 * apart, np.sqrt(up)
    square = cosine * cosine
    channels = []
    for channel, share in enumerate(albedo):
        # The control points for the ground's albedo, and the curve at the sun's elevation
        parameters, mean = (
            _sum(weights, (1.0 - share) * each[0, :, channel] + share * each[1, :, channel]) for each in controls
        )
        a, b, c, d, e, f, g, h, i = parameters.tolist()
        mie = (1.0 + i * i) - 2.0 * i * cosine
        phase = (1.0 + square) / (mie * np.sqrt(mie))
        around_sun = c + d * exponential(e * angle) + f * square + g * phase + h * root
        horizon = 1.0 + a * exponential(b / (up + 0.01))
        channels.append(np.maximum(float(mean) * horizon * around_sun, 0.0))
    return np.stack(channels)


def sun_disc(elevation: float, turbidity: float) -> SunDisc:
    """The sun's disc with the brightness of its centre's elevation all over, apart from limb darkening.

    Parameters
    ----------
    elevation : float
        Degrees, 0 to 90.
    turbidity : float
        1 to 10.
    """
    spectrum, dark = spectrum_of_the_sun(elevation, turbidity)
    darkening = np.stack([_sum(spectrum * of, dark) for of in _CHANNELS.T])
    # The squared cosine is uniformly distributed over the disc
    mean = _sum(2.0 / (np.arange(6.0) + 2.0), darkening.T)
    darkening[mean <= 0.0] = 0.0  # the reddest suns are outside the Rec. 709 gamut
    red, green, blue = np.maximum(mean, 0.0).tolist()
    return SunDisc(darkening, (red, green, blue))


def spectrum_of_the_sun(elevation: float, turbidity: float) -> tuple[_Floats, _Floats]:
    """Radiance of the disc's centre at 320, 360 ... 720 nm, W/(sr m2 nm), and limb darkening, (11, 6).

    Parameters
    ----------
    elevation, turbidity : float
        See `sun_disc`.
    """
    data = _data()
    piece = min(int(_cube_root(elevation / 90.0) * _ELEVATIONS), _ELEVATIONS - 1)
    begin = piece / _ELEVATIONS
    x = math.pi * (elevation / 180.0 - 0.5 * (begin * begin * begin))
    powers = np.array([1.0, x, x * x, x * x * x])
    spectrum = np.maximum(_sum(powers, _at_turbidity(data["sun_radiance"], turbidity)[piece].T), 0.0)
    return spectrum, data["sun_darkening"]


@cache
def _data() -> dict[str, _Floats]:
    with np.load(Path(__file__).with_name("hosek_wilkie.npz"), allow_pickle=False) as archive:
        return {name: archive[name].astype(np.float64) for name in archive.files}


def _at_turbidity(data: _Floats, turbidity: float) -> _Floats:
    """Interpolated between integer turbidities."""
    below = min(int(turbidity), 9)
    share = turbidity - below
    between: _Floats = (1.0 - share) * data[below - 1] + share * data[below]
    return between


def _bernstein(t: float) -> _Floats:
    """Weights of the six control points of a quintic Bézier curve."""
    s = 1.0 - t
    t2, s2 = t * t, s * s
    powers = s2 * s2 * s, t * s2 * s2, t2 * s2 * s, t2 * t * s2, t2 * t2 * s, t2 * t2 * t
    return np.array([factor * each for factor, each in zip((1, 5, 10, 10, 5, 1), powers, strict=True)])


def _cube_root(x: float) -> float:
    """Cube root of a number from 0 to 1, by Newton's method."""
    if x == 0.0:
        return 0.0
    root = 1.0
    for _ in range(200):
        better = root - (root - x / (root * root)) / 3.0
        if better >= root:
            break
        root = better
    return root


def _sum(weights: _Floats, values: Any) -> Any:
    """Weighted sum along the first axis, in order."""
    total = weights[0] * values[0]
    for weight, each in zip(weights[1:], values[1:], strict=True):
        total = total + weight * each
    return total
