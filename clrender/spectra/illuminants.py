"""Spectra of the illuminants of the CIE, and of black bodies, at the lines of tables of spectra."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import exponential_minus_one
from clrender.spectra.colors import daylight, table_wavelengths
from clrender.spectra.film import film_table, integral

__all__ = ["ILLUMINANTS", "blackbody_spectrum", "illuminant_spectrum", "of_luminance_one"]

_Floats: TypeAlias = NDArray[np.float64]
_DAYLIGHTS: Final = ("D50", "D55", "D65", "D75")
_LAMPS: Final = (
    *(f"FL{number}" for number in range(1, 13)),
    *(f"HP{number}" for number in range(1, 6)),
    *(f"LED-B{number}" for number in range(1, 6)),
    *("LED-BH1", "LED-RGB1", "LED-V1", "LED-V2"),
)
ILLUMINANTS: Final = ("A", *_DAYLIGHTS, "E", *_LAMPS)
"""Incandescent light, daylights, equal energy, fluorescent lamps, high-pressure lamps, and white LEDs."""
_OF_A: Final = 1.435e-2 / 2848.0
"""Second radiation constant over the temperature by which the CIE defines illuminant A, metres (ISO/CIE 11664-2)."""
_HC_OVER_K: Final = 0.014387768775
"""h c / k, metre kelvin, CODATA 2018."""


def illuminant_spectrum(name: str) -> _Floats:
    """Radiance of an illuminant of luminance 1, (95,) float64 at `clrender.spectra.colors.table_wavelengths`.

    Parameters
    ----------
    name : str
        One of `ILLUMINANTS`. Beyond 380 to 780 nm daylights stay as they are there, and lamps are dark.
    """
    if name == "A":
        return _planck(_OF_A)
    if name == "E":
        return of_luminance_one(np.ones(len(table_wavelengths())))
    return of_luminance_one(daylight() if name == "D65" else _tables()[name])


def blackbody_spectrum(kelvin: float) -> _Floats:
    """Radiance of a black body, scaled to luminance 1; see `illuminant_spectrum`."""
    return _planck(_HC_OVER_K / kelvin)


def of_luminance_one(values: _Floats) -> _Floats:
    """A spectrum of light, (95,) float64, scaled to luminance 1."""
    table = film_table()
    # The film's channels are scaled so that D65 is white, which is of luminance 1
    luminance = sum(
        weight * integral(table[:, channel], values) for channel, weight in enumerate((0.212671, 0.715160, 0.072169))
    )
    return values / luminance


def _planck(length: float) -> _Floats:
    """Planck's law for a temperature at which the exponent is 1 at this wavelength, metres; of luminance 1."""
    metres = table_wavelengths() * 1e-9
    relative = metres / 560e-9
    at_560 = exponential_minus_one(length / 560e-9)
    growth = np.array([exponential_minus_one(x) for x in (length / metres).tolist()])
    fifth = relative * relative * relative * relative * relative
    return of_luminance_one(at_560 / (fifth * growth))


@cache
def _tables() -> Mapping[str, _Floats]:
    """The spectra of ``cie_illuminants.txt`` at the lines."""
    text = resources.files(__package__).joinpath("cie_illuminants.txt").read_text(encoding="ascii")
    head, *lines = (line.split() for line in text.splitlines() if not line.startswith("#"))
    rows = np.array(lines, np.float64)
    at = table_wavelengths()
    before, after = int(np.searchsorted(at, rows[0, 0])), int(np.searchsorted(at, rows[-1, 0]))
    found = {}
    for column, name in enumerate(head[1:], 1):
        ends = (rows[0, column], rows[-1, column]) if name in _DAYLIGHTS else (0.0, 0.0)
        beyond = np.full(before, ends[0]), np.full(len(at) - after - 1, ends[1])
        found[name] = np.concatenate([beyond[0], rows[:, column], beyond[1]])
    return found
