"""Converts spectra to linear Rec. 709: those of lights directly, reflectances under illuminant D65."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import exponential_minus_one
from clrender.exact.matrices import interpolated, times, total

__all__ = [
    "LUMINANCE",
    "TO_REC709",
    "Color",
    "blackbody_color",
    "blackbody_xyz",
    "daylight",
    "light_color",
    "luminance",
    "observer",
    "reflectance_color",
    "reflectance_weights",
    "table_wavelengths",
    "value_at",
]

Color: TypeAlias = tuple[float, float, float]
_Floats: TypeAlias = NDArray[np.float64]
TO_REC709: Final = np.array(
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]]
)
"""Matrix from XYZ, for the white point D65 (ITU-R BT.709)."""
_STEP: Final = 5.0
_HC_OVER_K: Final = 0.014387768775
"""h c / k, metre kelvin, CODATA 2018."""
_TWO_HC2: Final = 1.191042972e-16
"""2 h c², watt square metre per steradian, CODATA 2018."""
LUMINANCE: Final = (0.212671, 0.715160, 0.072169)
"""Luminance of linear Rec. 709."""


@cache
def _table() -> tuple[_Floats, _Floats, _Floats]:
    """Wavelengths, colour matching functions (n, 3) and the illuminant D65."""
    text = resources.files(__package__).joinpath("cie_1931.txt").read_text(encoding="ascii")
    rows = np.array([line.split() for line in text.splitlines() if not line.startswith("#")], np.float64)
    return rows[:, 0], rows[:, 1:4], rows[:, 4]


def table_wavelengths() -> _Floats:
    """Wavelengths of the table of colour matching functions, 360 to 830 nm in steps of 5, (95,) float64."""
    return _table()[0]


def observer() -> _Floats:
    """Colour matching functions of the CIE 1931 standard observer at these wavelengths, (95, 3) float64."""
    return _table()[1]


def daylight() -> _Floats:
    """Relative radiance of the illuminant D65 at these wavelengths, (95,) float64."""
    return _table()[2]


def luminance(color: Color) -> float:
    """Y of a linear Rec. 709 colour."""
    return sum(weight * value for weight, value in zip(LUMINANCE, color, strict=True))


@np.errstate(over="ignore", invalid="ignore")  # a colour that is not finite is refused where it is used
def light_color(wavelengths: Sequence[float], values: Sequence[float]) -> Color:
    """The colour of light with a spectrum, normalised so that an equal-energy spectrum of 1 has luminance 1.

    Parameters
    ----------
    wavelengths : (n,) floats, nanometres, ascending
    values : (n,) floats
        Interpolated linearly; zero outside.

    Returns
    -------
    three floats
        Not negative: colours outside the Rec. 709 gamut are clipped.
    """
    return _color(_xyz(wavelengths, values))


def _xyz(wavelengths: Sequence[float], values: Sequence[float]) -> _Floats:
    _, observer, _ = _table()
    return _weighted(_sampled(wavelengths, values), observer)


@np.errstate(over="ignore", invalid="ignore")
def reflectance_color(wavelengths: Sequence[float], values: Sequence[float]) -> Color:
    """The colour of a reflectance, or another fraction, under illuminant D65; a constant stays the same.

    For the parameters and the result see `light_color`.
    """
    _, observer, daylight = _table()
    weights = observer * daylight[:, None]
    sampled = _sampled(wavelengths, values)
    return _color(_weighted(sampled, weights))


def reflectance_weights(wavelengths: Sequence[float]) -> _Floats:
    """What each value of a reflectance spectrum adds to its colour, as `reflectance_color` has it before clipping.

    Beyond its ends the spectrum has the values of those. A constant has its own colour, exactly.

    Parameters
    ----------
    wavelengths : (n,) floats, nanometres, ascending

    Returns
    -------
    (n, 3) float64
        Of linear Rec. 709. Each column adds up to 1.
    """
    at, observer, daylight = _table()
    places = np.asarray(wavelengths, np.float64)
    fine = np.linspace(at[0], at[-1], round(at[-1] - at[0]) + 1)
    weights = np.stack([interpolated(fine, at, observer[:, channel] * daylight) for channel in range(3)], axis=1)
    sums = np.zeros((len(places), 3))
    after = np.searchsorted(places, fine, side="right")
    for light, place, index in zip(weights, fine.tolist(), after.tolist(), strict=True):
        low, high = max(index - 1, 0), min(index, len(places) - 1)
        share = 0.0 if low == high else (place - places[low]) / (places[high] - places[low])
        sums[low] += (1.0 - share) * light
        sums[high] += share * light
    colors = times(TO_REC709, sums)
    return np.asarray(colors / total(colors), np.float64)


def blackbody_color(kelvin: float) -> Color:
    """The radiance of a black body by Planck's law, W/(m2 sr nm), converted by `light_color`.

    Parameters
    ----------
    kelvin : float
        Above 0.
    """
    return _color(blackbody_xyz(kelvin))


def blackbody_xyz(kelvin: float) -> _Floats:
    """Like `blackbody_color`, as XYZ, (3,) float64."""
    nanometres, _, _ = _table()
    metres = nanometres * 1e-9
    growth = np.array([exponential_minus_one(x) for x in (_HC_OVER_K / (metres * kelvin)).tolist()])
    values = _TWO_HC2 * 1e-9 / (metres * metres * metres * metres * metres * growth)
    return _xyz(nanometres.tolist(), values.tolist())


@np.errstate(over="ignore", invalid="ignore")
def value_at(wavelengths: Sequence[float], values: Sequence[float], nanometres: float) -> float:
    """Value of a spectrum at a wavelength: interpolated linearly, constant outside."""
    return float(interpolated(nanometres, wavelengths, values))


def _weighted(sampled: _Floats, weights: _Floats) -> _Floats:
    """Sums over the wavelengths, relative to that of the luminance of a spectrum of ones."""
    return total(sampled[:, None] * weights) / total(weights[:, 1])


def _sampled(wavelengths: Sequence[float], values: Sequence[float]) -> _Floats:
    """Means of a spectrum around the table's wavelengths, so that no peak is missed."""
    at, _, _ = _table()
    given, shares = np.asarray(wavelengths, np.float64), np.asarray(values, np.float64)
    if len(given) == 1:
        return np.where(np.abs(at - given[0]) <= _STEP / 2.0, shares[0], 0.0)
    fine = np.linspace(at[0] - _STEP / 2.0, at[-1] + _STEP / 2.0, 10 * len(at) + 1)
    middle = (fine[1:] + fine[:-1]) / 2.0
    return np.asarray(total(interpolated(middle, given, shares, 0.0).reshape(len(at), 10).T) / 10.0)


def _color(xyz: _Floats) -> Color:
    red, green, blue = (max(0.0, float(x)) if math.isfinite(x) else math.inf for x in times(TO_REC709, xyz))
    return red, green, blue
