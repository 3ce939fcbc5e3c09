"""Converts spectra to linear Rec. 709: those of lights directly, reflectances under illuminant D65."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["Color", "blackbody_color", "light_color", "luminance", "reflectance_color", "value_at"]

Color: TypeAlias = tuple[float, float, float]
_Floats: TypeAlias = NDArray[np.float64]
_TO_REC709: Final = np.array(
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]]
)
"""Matrix from XYZ, for the white point D65 (ITU-R BT.709)."""
_STEP: Final = 5.0
_HC_OVER_K: Final = 0.014387768775
"""h c / k, metre kelvin, CODATA 2018."""
_TWO_HC2: Final = 1.191042972e-16
"""2 h c², watt square metre per steradian, CODATA 2018."""
_LUMINANCE: Final = (0.212671, 0.715160, 0.072169)


@cache
def _table() -> tuple[_Floats, _Floats, _Floats]:
    """Wavelengths, colour matching functions (n, 3) and the illuminant D65."""
    text = resources.files(__package__).joinpath("cie_1931.txt").read_text(encoding="ascii")
    rows = np.array([line.split() for line in text.splitlines() if not line.startswith("#")], np.float64)
    return rows[:, 0], rows[:, 1:4], rows[:, 4]


def luminance(color: Color) -> float:
    """Y of a linear Rec. 709 colour."""
    return sum(weight * value for weight, value in zip(_LUMINANCE, color, strict=True))


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
    _, observer, _ = _table()
    sampled = _sampled(wavelengths, values)
    return _color(sampled @ observer / observer[:, 1].sum())


def reflectance_color(wavelengths: Sequence[float], values: Sequence[float]) -> Color:
    """The colour of a reflectance, or another fraction, under illuminant D65; a constant stays the same.

    For the parameters and the result see `light_color`.
    """
    _, observer, daylight = _table()
    weights = observer * daylight[:, None]
    sampled = _sampled(wavelengths, values)
    return _color(sampled @ weights / weights[:, 1].sum())


def blackbody_color(kelvin: float) -> Color:
    """The radiance of a black body by Planck's law, W/(m2 sr nm), converted by `light_color`.

    Parameters
    ----------
    kelvin : float
        Above 0.
    """
    nanometres, _, _ = _table()
    metres = nanometres * 1e-9
    with np.errstate(over="ignore"):
        values = _TWO_HC2 * 1e-9 / (metres**5 * np.expm1(_HC_OVER_K / (metres * kelvin)))
    return light_color(nanometres.tolist(), values.tolist())


def value_at(wavelengths: Sequence[float], values: Sequence[float], nanometres: float) -> float:
    """Value of a spectrum at a wavelength: interpolated linearly, constant outside."""
    return float(np.interp(nanometres, wavelengths, values))


def _sampled(wavelengths: Sequence[float], values: Sequence[float]) -> _Floats:
    """Means of a spectrum around the table's wavelengths, so that no peak is missed."""
    at, _, _ = _table()
    given, shares = np.asarray(wavelengths, np.float64), np.asarray(values, np.float64)
    if len(given) == 1:
        return np.where(np.abs(at - given[0]) <= _STEP / 2.0, shares[0], 0.0)
    fine = np.linspace(at[0] - _STEP / 2.0, at[-1] + _STEP / 2.0, 10 * len(at) + 1)
    middle = (fine[1:] + fine[:-1]) / 2.0
    return np.asarray(np.interp(middle, given, shares, left=0.0, right=0.0).reshape(len(at), 10).mean(axis=1))


def _color(xyz: _Floats) -> Color:
    red, green, blue = (max(0.0, float(x)) if math.isfinite(x) else math.inf for x in _TO_REC709 @ xyz)
    return red, green, blue
