"""The tables of wavelengths that kernels read (kernels/spectral/wavelengths.h and color.h)."""

from __future__ import annotations

from functools import cache
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.matrices import interpolated, total
from clrender.spectra.film import film_table, integral
from clrender.spectra.lifting import lifting_table

__all__ = ["kernel_table", "wavelength_distribution"]

_Floats: TypeAlias = NDArray[np.float64]
_FLOOR: Final = 0.04
"""Share of the wavelengths that is drawn evenly: lights may shine where the film sees little of daylight."""
_FINE: Final = 20
"""Points of a line over which the distribution is summed up."""


@cache
def wavelength_distribution() -> _Floats:
    """Wavelengths that evenly spaced random numbers stand for: the inverse of their distribution.

    Returns
    -------
    (SPECTRA_SEGMENTS + 1, 2) float64
        In lines from the first of `table_wavelengths` on, ascending; and the derivative, which is linear in between:
        one over the density. That is about the length of the color that the film sees of daylight, and never 0.
    """
    table = film_table()
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


@cache
def kernel_table() -> NDArray[np.float32]:
    """All tables that are the same for every scene, (SPECTRA_GIVEN,) float32."""
    table = np.zeros(layout.SPECTRA_GIVEN, np.float32)
    table[: 2 * layout.SPECTRA_SEGMENTS + 2] = wavelength_distribution().ravel()
    film = film_table().astype(np.float32)
    table[layout.SPECTRA_FILM : layout.SPECTRA_LIFTING] = np.concatenate([film, film[-1:]]).ravel()
    table[layout.SPECTRA_LIFTING :] = lifting_table().ravel()
    table.setflags(write=False)
    return table
