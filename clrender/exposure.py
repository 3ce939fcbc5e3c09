"""Exposure as photographers say it: f-stop, shutter and film speed become stops of the display image.

By the saturation-based speed of ISO 12232 a sensor of speed S saturates at the exposure 78 / S lux seconds; with the
part q = 0.65 of the light that lenses let through (Lagarde and de Rousiers, "Moving Frostbite to physically based
rendering", SIGGRAPH 2014 course notes) that is at the luminance

    L = 78 N^2 / (q S t) = 120 N^2 / (S t)  cd/m2

for the f-number N and the time t. Such a surface becomes 1 before tone mapping: display white. The luminance of a
colour is 683 lm/W times that of its linear Rec. 709 numbers in W/(sr m2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from clrender.errors import UsageError
from clrender.limits import NotAllowed, Range

__all__ = ["LUMENS_PER_WATT", "PHOTOGRAPHIC", "SPEED", "camera_exposure", "photographic_stops"]

PHOTOGRAPHIC: Final[Mapping[str, Range]] = {
    "f_stop": Range(0.1, 1000.0),
    "shutter": Range(1e-6, 1e6),
    "iso": Range(0.1, 1e7),
}
"""What an exposure is made of: f-number, seconds, film speed."""
SPEED: Final = 100.0
"""The film speed where only f-stop and shutter are given."""

LUMENS_PER_WATT: Final = 683.0
"""By the definition of the candela: luminous efficacy of light of 540 THz, to which the eye is most sensitive."""
_SATURATION: Final = 78.0 / 0.65
"""Luminance that saturates, times S t / N^2."""


def photographic_stops(f_stop: float | None = None, shutter: float | None = None, iso: float | None = None) -> float:
    """Stops by which radiance is multiplied; 0 where nothing is given.

    Parameters
    ----------
    f_stop : float, optional
        F-number N: focal length over the diameter of the diaphragm.
    shutter : float, optional
        Time, seconds.
    iso : float, optional
        Film speed S; default, where the others are given: 100.

    Raises
    ------
    UsageError
        When one is not allowed, or f-stop or shutter is missing where another is given.
    """
    asked = {"f_stop": f_stop, "shutter": shutter, "iso": iso}
    given = {name: value for name, value in asked.items() if value is not None}
    for name, value in given.items():
        try:
            given[name] = PHOTOGRAPHIC[name].accept(value)
        except NotAllowed as error:
            raise UsageError(f"{name} {error}") from None
    for missing in ("f_stop", "shutter"):
        if given and missing not in given:
            raise UsageError(
                f"{' and '.join(given)} {'makes' if len(given) == 1 else 'make'} no exposure without {missing}; give "
                "f_stop and shutter, or only exposure"
            )
    if not given:
        return 0.0
    light = math.log2(given["shutter"]) + math.log2(given.get("iso", SPEED)) - 2.0 * math.log2(given["f_stop"])
    return light + math.log2(LUMENS_PER_WATT / _SATURATION)


def camera_exposure(provenance: Mapping[str, Any] | None, given: Mapping[str, float | None]) -> dict[str, float]:
    """The exposure of an image: what is given, else what its camera asked for by what is said of its making.

    Parameters
    ----------
    provenance : mapping or None
        A render's numbers; the key ``camera_exposure``.
    given : mapping
        Some of `PHOTOGRAPHIC`, or None for what is not given.

    Returns
    -------
    dict
        Arguments of `photographic_stops`.
    """
    noted = (provenance or {}).get("camera_exposure")
    noted = noted if isinstance(noted, Mapping) else {}
    values = {**noted, **{name: value for name, value in given.items() if value is not None}}
    return {name: values[name] for name in PHOTOGRAPHIC if values.get(name) is not None}
