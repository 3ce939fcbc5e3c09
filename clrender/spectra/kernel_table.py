"""The tables of wavelengths that kernels read (kernels/spectral/wavelengths.h and color.h)."""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.matrices import interpolated, total
from clrender.spectra.colors import table_wavelengths
from clrender.spectra.film import film_table, integral
from clrender.spectra.lifting import lifting_table

__all__ = ["band_distribution", "band_edges", "kernel_table", "wavelength_distribution"]

_Floats: TypeAlias = NDArray[np.float64]
_FLOOR: Final = 0.04
"""Share of the wavelengths that is drawn evenly: lights may shine where the film sees little of daylight."""
_FINE: Final = 20
"""Points of a line over which the distribution is summed up."""


def wavelength_distribution(film: _Floats | None = None) -> _Floats:
    """Wavelengths that evenly spaced random numbers stand for: the inverse of their distribution.

    Parameters
    ----------
    film : (95, 4) float64, optional
        What the film sees; default: `clrender.spectra.film.film_table`.

    Returns
    -------
    (SPECTRA_SEGMENTS + 1, 2) float64
        In lines from the first of `table_wavelengths` on, ascending; and the derivative, which is linear in between:
        one over the density. That is about the length of the color that the film sees of daylight, and never 0.
    """
    table = film_table() if film is None else film
    lines = layout.SPECTRA_LINES - 1
    seen = np.sqrt(total((table[:, :3] * table[:, 3:]).T ** 2))
    fine = np.linspace(0.0, lines, lines * _FINE + 1)
    density = interpolated(fine, np.arange(lines + 1.0), seen)
    density = (1.0 - _FLOOR) * density / integral(seen, np.ones(len(seen))) + _FLOOR / lines
    steps = (density[1:] + density[:-1]) / 2.0
    shares = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.arange(layout.SPECTRA_SEGMENTS + 1.0) / layout.SPECTRA_SEGMENTS
    spread = 1.0 / interpolated(interpolated(wanted, shares / shares[-1], fine), fine, density)
    places = np.concatenate([[0.0], np.cumsum((spread[1:] + spread[:-1]) / 2.0)]) / layout.SPECTRA_SEGMENTS
    return np.asarray(np.stack([places, spread], axis=1) * (lines / places[-1]), np.float64)


def band_edges(count: int) -> _Floats:
    """Edges of bands of equal width, nanometres, (count + 1,) float64."""
    at = table_wavelengths()
    return np.asarray(at[0] + (at[-1] - at[0]) * np.arange(count + 1.0) / count, np.float64)


def band_distribution(first: int, count: int) -> _Floats:
    """Like `wavelength_distribution`, of wavelengths that are spread evenly over three bands.

    Parameters
    ----------
    first : int
        The first of the three.
    count : int
        Number of all bands; see `band_edges`.
    """
    lines, width = layout.SPECTRA_LINES - 1, 3.0 / count
    shares = np.arange(layout.SPECTRA_SEGMENTS + 1.0) / layout.SPECTRA_SEGMENTS
    places = lines * (first / count + width * shares)
    return np.stack([places, np.full(len(places), lines * width)], axis=1)


def kernel_table(bands: tuple[int, int] | None = None, film: _Floats | None = None) -> NDArray[np.float32]:
    """All tables that are the same for every scene.

    Parameters
    ----------
    bands : (int, int), optional
        The film's colours are three bands: `band_distribution`.
    film : (95, 4) float64, optional
        What the film sees; default: `clrender.spectra.film.film_table`.

    Returns
    -------
    (SPECTRA_GIVEN,) float32
    """
    table = np.zeros(layout.SPECTRA_GIVEN, np.float32)
    drawn = wavelength_distribution(film) if bands is None else band_distribution(*bands)
    table[: 2 * layout.SPECTRA_SEGMENTS + 2] = drawn.ravel()
    seen = (film_table() if film is None else film).astype(np.float32)
    table[layout.SPECTRA_FILM : layout.SPECTRA_LIFTING] = np.concatenate([seen, seen[-1:]]).ravel()
    table[layout.SPECTRA_LIFTING :] = lifting_table().ravel()
    table.setflags(write=False)
    return table
