"""Spectra of other formats as scenes say them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

__all__ = ["ILLUMINANTS", "coefficient_table", "light_table", "reflectance_table"]

_MOST: Final = 4096
"""Most wavelengths of a table in a scene, less two for its ends."""
_VISIBLE: Final = (360.0, 830.0)
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
    if not _sound(wavelengths, values) or not 0.0 <= scale <= 1e12:
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
    if not _sound(wavelengths, values) or not 0.0 <= scale <= 1e12 or max(values) * scale > 1e12:
        return None
    places, shares = list(wavelengths), list(values)
    if places[0] > _VISIBLE[0]:
        places, shares = [places[0] - _EDGE, *places], [0.0, *shares]
    if places[-1] < _VISIBLE[1]:
        places, shares = [*places, places[-1] + _EDGE], [*shares, 0.0]
    made: dict[str, Any] = {"wavelengths": places, "values": shares}
    return made if scale == 1.0 else {**made, "scale": scale}


def _sound(wavelengths: Sequence[float], values: Sequence[float]) -> bool:
    if not 2 <= len(wavelengths) <= _MOST - 2 or len(wavelengths) != len(values):
        return False
    ascend = all(b > a for a, b in pairwise(wavelengths))
    return ascend and wavelengths[0] > _EDGE and wavelengths[-1] < 1e5 and all(0.0 <= x <= 1e12 for x in values)
