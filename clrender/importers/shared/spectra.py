"""Spectra of other formats as scenes say them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import interpolated
from clrender.spectra.colors import Color, table_wavelengths
from clrender.spectra.lifting import reflectance_spectra, unbounded_spectra

__all__ = ["ILLUMINANTS", "coefficient_table", "light_table", "reflectance_table", "split_by_albedo"]

_MOST: Final = 4096
"""Most wavelengths of a table in a scene, less two for its ends."""
_VISIBLE: Final = (360.0, 830.0)
_MARGIN: Final = 5.0
"""How far from the visible range a spectrum counts, as of each line its surroundings are seen, nanometres."""
_MOST_VALUE: Final = 1e12
"""Largest value of a spectrum, and of its scale."""
_EDGE: Final = 0.01
"""Width of the edge beyond which a reflectance is 0, nanometres."""

ILLUMINANTS: Final[Mapping[str, str]] = {
    "stdillum-A": "A",
    "stdillum-D50": "D50",
    **{f"stdillum-F{number}": f"FL{number}" for number in range(1, 13)},
}
"""Illuminants by pbrt's names."""


def light_table(wavelengths: Sequence[float], values: Sequence[float], scale: float = 1.0) -> dict[str, Any] | None:
    """A spectrum of light; None if scenes cannot have it.

    Parameters
    ----------
    wavelengths : sequence of float
        Nanometres.
    values : sequence of float
    scale : float
        Factor of it.
    """
    if not _sound(wavelengths, values) or not 0.0 <= scale <= _MOST_VALUE:
        return None
    made: dict[str, Any] = {"wavelengths": list(wavelengths), "values": list(values)}
    return made if scale == 1.0 else {**made, "scale": scale}


def reflectance_table(wavelengths: Sequence[float], values: Sequence[float]) -> dict[str, Any] | None:
    """A spectrum of a reflectance that is 0 beyond its ends; None if scenes cannot have it."""
    return None if max(values, default=0.0) > 1.0 else coefficient_table(wavelengths, values)


def coefficient_table(
    wavelengths: Sequence[float], values: Sequence[float], scale: float = 1.0
) -> dict[str, Any] | None:
    """A spectrum of what is no light, such as a coefficient, and is 0 beyond its ends; None if scenes cannot have it.

    Parameters
    ----------
    wavelengths : sequence of float
        Nanometres.
    values : sequence of float
    scale : float
        Factor of it.
    """
    if not _sound(wavelengths, values) or not 0.0 <= scale <= _MOST_VALUE or max(values) * scale > _MOST_VALUE:
        return None
    places, shares = list(wavelengths), list(values)
    if places[0] > _VISIBLE[0]:
        places, shares = [places[0] - _EDGE, *places], [0.0, *shares]
    if places[-1] < _VISIBLE[1]:
        places, shares = [*places, places[-1] + _EDGE], [*shares, 0.0]
    made: dict[str, Any] = {"wavelengths": places, "values": shares}
    return made if scale == 1.0 else {**made, "scale": scale}


def split_by_albedo(
    extinction: dict[str, Any] | Color,
    albedo: dict[str, Any] | Color,
    scale: float,
    colors: Mapping[str, Sequence[float]],
) -> dict[str, Any]:
    """Absorption and scattering of a medium as spectra, by our keys; none if neither of what they follow from is one.

    Where both depend on the wavelength, red, green and blue are the product of their colours, as in the program that
    the scene is from: the colour of the product may be 0 in a channel that absorbs.

    What is left out, such as what is beyond the range of scenes, is a colour.

    Parameters
    ----------
    extinction : dict, or three floats
        Coefficient, per unit of length: a `coefficient_table`, or of red, green and blue.
    albedo : dict, or three floats
        Share of it that scatters, likewise.
    scale : float
        Factor of the extinction.
    colors : dict of str to three floats
        What both are in red, green and blue, by our keys, with the scale.
    """
    if not (isinstance(extinction, dict) or isinstance(albedo, dict)):
        return {}
    found = {}
    for key, color in colors.items():
        said = _part(extinction, albedo, key == "scattering", scale)
        some = said is not None and max(said["values"]) > 0.0
        if said is None or not (some or max(color) > 0.0):
            continue
        known = some and max(color) > 0.0 and _varies(extinction) and _varies(albedo)
        found[key] = {**said, "color": list(color)} if known else said
    return found


def _varies(said: dict[str, Any] | Color) -> bool:
    return isinstance(said, dict) or min(said) < max(said)


def _part(
    extinction: dict[str, Any] | Color, albedo: dict[str, Any] | Color, scatters: bool, scale: float
) -> dict[str, Any] | None:
    if isinstance(extinction, dict) and not isinstance(albedo, dict) and not _varies(albedo):
        factor = scale * max(albedo[0] if scatters else 1.0 - albedo[0], 0.0)
        return coefficient_table(extinction["wavelengths"], extinction["values"], factor)  # as the file has it
    whole, shares = _table(extinction), _table(albedo)
    lines = table_wavelengths()
    low, high = lines[0] - _MARGIN, lines[-1] + _MARGIN
    # Between two of these the product is nearly linear, as lines are 5 nm apart
    at = np.unique(np.concatenate([lines, *(waves[(waves > low) & (waves < high)] for waves, _ in (whole, shares))]))
    if len(at) > _MOST - 4:
        at = lines
    elif len(at) > len(lines):
        at = np.concatenate([[low], at, [high]])
    thinned, turned = (interpolated(at, *table) for table in (whole, shares))
    values = thinned * (turned if scatters else np.maximum(1.0 - turned, 0.0))
    return coefficient_table(at.tolist(), values.tolist(), scale)


def _table(said: dict[str, Any] | Color) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Wavelengths and values of a spectrum; colours become spectra as they are rendered."""
    if isinstance(said, dict):
        return np.array(said["wavelengths"]), np.array(said["values"])
    color = np.clip(said, 0.0, _MOST_VALUE)
    return table_wavelengths(), reflectance_spectra(color) if max(color) <= 1.0 else unbounded_spectra(color)


def _sound(wavelengths: Sequence[float], values: Sequence[float]) -> bool:
    if not 2 <= len(wavelengths) <= _MOST - 2 or len(wavelengths) != len(values):
        return False
    ascend = all(b > a for a, b in pairwise(wavelengths))
    return ascend and wavelengths[0] > _EDGE and wavelengths[-1] < 1e5 and all(0.0 <= x <= _MOST_VALUE for x in values)
