"""Reflectance spectra of colours, by three numbers each (Jakob and Hanika, EG 2019), and their table for kernels."""

from __future__ import annotations

from functools import cache
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.spectra.film import reflectance_film_weights

__all__ = [
    "HIGHEST",
    "LOWEST",
    "lifted",
    "lifting_table",
    "reflectance_spectra",
    "sigmoid_spectrum",
    "spread",
    "unbounded_spectra",
]

_Floats: TypeAlias = NDArray[np.float64]

LOWEST: Final = 1.0 / 32.0
"""Of the lightness's parameter, where the table begins; the spectra of darker colours are multiples of that one."""
HIGHEST: Final = 1.0 - 1.0 / 128.0
"""And where it ends: a largest channel of 0.9999."""
_CONVERGED: Final = 1e-7
"""Error from which one more step, which is quadratic, leaves none."""
_MOST_STEPS: Final = 40
_STEEPEST: Final = 400.0
"""Largest coefficient: colours that no reflectance has, such as a blue of full strength, would have infinite ones."""


def sigmoid_spectrum(coefficients: _Floats, places: _Floats) -> _Floats:
    """Values of a reflectance spectrum.

    Parameters
    ----------
    coefficients : (3, ...) float64
        Of the polynomial: quadratic, linear, constant.
    places : float64
        Wavelengths from 360 to 830 nm as 0 to 1; broadcast with those.
    """
    at = (coefficients[0] * places + coefficients[1]) * places + coefficients[2]
    return np.asarray(0.5 + at / (2.0 * np.sqrt(1.0 + at * at)), np.float64)


def lifted(colors: _Floats, start: _Floats | None = None) -> _Floats:
    """Coefficients of the reflectance spectra of colours: under illuminant D65 the spectra have these colours.

    Gauss-Newton in linear Rec. 709 rather than in CIE Lab as in the paper: where a spectrum of this form has the
    colour, both find the same one, and cube roots differ from machine to machine.

    Parameters
    ----------
    colors : (3, n) float64
        Linear Rec. 709, each above 0 and below 1.
    start : (3, n) float64, optional
        Coefficients of similar colours; by default those of 0.5 at all wavelengths.

    Returns
    -------
    (3, n) float64
        See `sigmoid_spectrum`.
    """
    places = (np.arange(layout.SPECTRA_LINES) / (layout.SPECTRA_LINES - 1.0)).tolist()
    weights = reflectance_film_weights()
    found = np.zeros_like(colors) if start is None else start.copy()
    left = np.arange(colors.shape[1])
    for _ in range(_MOST_STEPS):
        found[:, left], error = _step(colors[:, left], found[:, left], weights, places)
        left = left[error > _CONVERGED]
        if not len(left):
            break
    return found


def _step(wanted: _Floats, coefficients: _Floats, weights: _Floats, places: list[float]) -> tuple[_Floats, _Floats]:
    """One step; returns the new coefficients, and by how much the old ones missed the colour."""
    missed, slopes = -wanted, np.zeros((3, *wanted.shape))
    for place, weight in zip(places, weights[:, :, None], strict=True):
        at = (coefficients[0] * place + coefficients[1]) * place + coefficients[2]
        inverse = 1.0 / np.sqrt(1.0 + at * at)
        missed += weight * (0.5 + 0.5 * at * inverse)
        by_constant = weight * (0.5 * inverse * inverse * inverse)
        slopes[2] += by_constant
        slopes[1] += by_constant * place
        slopes[0] += by_constant * (place * place)
    normal = [[_inner(slopes[i], slopes[j]) for j in range(3)] for i in range(3)]
    towards = [_inner(slopes[i], missed) for i in range(3)]
    for i in range(3):
        normal[i][i] = normal[i][i] * (1.0 + 1e-9) + 1e-14
    step = _solved(normal, towards)
    new = coefficients - step
    largest = np.max(np.abs(new), axis=0)
    new = new * np.where(largest > _STEEPEST, _STEEPEST / np.maximum(largest, _STEEPEST), 1.0)
    return new, np.max(np.abs(missed), axis=0)


def _inner(a: _Floats, b: _Floats) -> _Floats:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], np.float64)


def _solved(a: list[list[_Floats]], b: list[_Floats]) -> _Floats:
    """Solutions of linear equations in three unknowns, by elimination: the matrices are symmetric and positive."""
    u01, u02 = a[0][1] / a[0][0], a[0][2] / a[0][0]
    d1 = a[1][1] - a[0][1] * u01
    u12 = (a[1][2] - a[0][2] * u01) / d1
    d2 = a[2][2] - a[0][2] * u02 - d1 * u12 * u12
    y1 = b[1] - b[0] * u01
    z = (b[2] - b[0] * u02 - y1 * u12) / d2
    y = y1 / d1 - u12 * z
    return np.stack([b[0] / a[0][0] - u01 * y - u02 * z, y, z])


def spread(parameter: _Floats) -> _Floats:
    """What a parameter from 0 to 1 stands for, along each axis of the table: nodes are closer together at both ends.

    The largest channel is a lightness: there are black and white. The others are relative to it: there are grey and
    colours without one of red, green and blue.
    """
    low, high = 2.0 * parameter * parameter, 2.0 * (1.0 - parameter) * (1.0 - parameter)
    return np.asarray(np.where(parameter < 0.5, low, 1.0 - high), np.float64)


@cache
def lifting_table() -> NDArray[np.float32]:
    """Coefficients of colours on a grid, times p (1 - p) for the parameter p of their lightness, which has no pole.

    Returns
    -------
    (3, lightnesses, chromas, chromas, 4) float32
        By which channel is the largest one, its lightness, and the chromas of the channel after the next and of the
        next one, in a circle. The last number is 0.
    """
    side, steps = layout.LIFTING_CHROMAS, layout.LIFTING_LIGHTNESSES
    parameters = LOWEST + (HIGHEST - LOWEST) * np.arange(steps) / (steps - 1.0)
    others = spread(np.asarray(np.arange(side) / (side - 1.0), np.float64))
    relative = np.ones((3, side * side))
    relative[1], relative[2] = np.tile(others, side), np.repeat(others, side)
    chromas = np.concatenate([np.roll(relative, channel, axis=0) for channel in range(3)], axis=1)
    table = np.zeros((3, steps, side, side, 4), np.float32)
    # From the middle to both ends: the coefficients of one layer are near those of the next
    for layers in (range(steps // 2, steps), range(steps // 2 - 1, -1, -1)):
        found = lifted(0.5 * chromas)
        for layer in layers:
            at = parameters[layer]
            found = lifted(float(spread(at)) * chromas, found)
            table[:, layer, ..., :3] = (found * (at * (1.0 - at))).T.reshape(3, side, side, 3)
    table.setflags(write=False)
    return table


def reflectance_spectra(color: _Floats) -> _Floats:
    """The spectrum of a reflectance or another share, at `table_wavelengths`.

    Parameters
    ----------
    color : (3,) float64
        Linear Rec. 709, 0 to 1.

    Returns
    -------
    (95,) float64
    """
    if color[0] == color[1] == color[2]:
        return np.full(layout.SPECTRA_LINES, color[0])
    darkest = float(spread(np.array(LOWEST)))
    most = float(np.max(color))
    lightest = float(spread(np.array(HIGHEST)))
    scaled = color * (min(max(most, darkest), lightest) / most)
    places = np.arange(layout.SPECTRA_LINES) / (layout.SPECTRA_LINES - 1.0)
    return sigmoid_spectrum(lifted(np.maximum(scaled, 0.0)[:, None]), places) * min(most / darkest, 1.0)


def unbounded_spectra(color: _Floats) -> _Floats:
    """The spectrum of what has no bound, such as a coefficient; see `reflectance_spectra`."""
    most = 2.0 * float(np.max(color))
    return reflectance_spectra(color / most) * most if most > 0.0 else np.zeros(layout.SPECTRA_LINES)
