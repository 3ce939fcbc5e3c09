"""What the film sees of wavelengths: the CIE 1931 standard observer, as linear Rec. 709 of white D65."""

from __future__ import annotations

from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import times, total
from clrender.spectra.colors import TO_REC709, daylight, observer

__all__ = ["film_color", "film_table", "integral", "reflectance_film_weights", "sensor_table"]

_Floats: TypeAlias = NDArray[np.float64]


@cache
def film_table() -> _Floats:
    """What the film makes of radiance, and the illuminant D65.

    Returns
    -------
    (95, 4) float64
        At `clrender.spectra.colors.table_wavelengths`, linear in between: linear Rec. 709 per line of 5 nm, and the
        radiance of D65 whose color is white. Of a radiance of 1 at all wavelengths the luminance is 1. The integral
        over what is linear between the lines is the sum over these by which the CIE defines colors (CIE 15:2018, 7.1).
    """
    matching = _whose_integrals_are_sums(observer())
    light = daylight()
    matching = matching / integral(matching[:, 1], np.ones(len(matching)))
    light = light / integral(matching[:, 1], light)
    colors = times(TO_REC709, matching)
    white = [integral(colors[:, channel], light) for channel in range(3)]
    return np.asarray(np.concatenate([colors / np.array(white), light[:, None]], axis=1), np.float64)


def sensor_table(sensitivities: _Floats, white: _Floats) -> _Floats:
    """Like `film_table`, of a sensor with other sensitivities.

    Parameters
    ----------
    sensitivities : (95, 3) float64
        At `clrender.spectra.colors.table_wavelengths`, in any unit, linear in between; no column is 0 everywhere.
    white : (95,) float64
        The light whose color is white.

    Returns
    -------
    (95, 4) float64
    """
    scale = np.array([integral(sensitivities[:, channel], white) for channel in range(3)])
    return np.asarray(np.concatenate([sensitivities / scale, film_table()[:, 3:]], axis=1), np.float64)


def film_color(values: _Floats) -> _Floats:
    """The color that the film sees of a spectrum of light, linear Rec. 709; also outside of its gamut.

    Parameters
    ----------
    values : (95,) float64
        Radiance at the lines, linear in between.
    """
    table = film_table()
    return np.array([integral(table[:, channel], values) for channel in range(3)])


@cache
def reflectance_film_weights() -> _Floats:
    """What each line of a reflectance adds to its color in daylight, (95, 3) float64; each column adds up to 1."""
    table = film_table()
    left, right = table[:-1], table[1:]
    middle = (left + right) / 2.0
    half = 4.0 * (middle[:, :3] * middle[:, 3:]) / 2.0
    weights = np.zeros((len(table), 3))
    weights[:-1] += (left[:, :3] * left[:, 3:] + half) / 6.0  # Simpson's rule, which is exact for cubics
    weights[1:] += (right[:, :3] * right[:, 3:] + half) / 6.0
    return np.asarray(weights / total(weights), np.float64)


def integral(a: _Floats, b: _Floats) -> float:
    """Integral, in lines, of the product of two functions that are linear between the lines."""
    first, second = a[:-1], a[1:]
    left, right = b[:-1], b[1:]
    return float(total((first * left + second * right) / 3.0 + (first * right + second * left) / 6.0))


def _whose_integrals_are_sums(values: _Floats) -> _Floats:
    """Functions whose `integral` with any other is the sum of the products of these and of that, (n, k) float64.

    Thomas's algorithm, for the matrix of the integrals of pairs of hat functions.
    """
    count = len(values)
    diagonal, beside = np.full(count, 2.0 / 3.0), 1.0 / 6.0
    diagonal[0] = diagonal[-1] = 1.0 / 3.0
    found = values.copy()
    for row in range(1, count):
        factor = beside / diagonal[row - 1]
        diagonal[row] -= factor * beside
        found[row] -= factor * found[row - 1]
    found[-1] /= diagonal[-1]
    for row in range(count - 2, -1, -1):
        found[row] = (found[row] - beside * found[row + 1]) / diagonal[row]
    return found
