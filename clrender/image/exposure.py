"""Photographic exposure: converts f-stop, shutter time and film speed to stops of the display image.

By the saturation-based speed of ISO 12232 a sensor of speed S saturates at the exposure 78 / S lux seconds; with the
part q = 0.65 of the light that lenses let through (Lagarde and de Rousiers, "Moving Frostbite to physically based
rendering", SIGGRAPH 2014 course notes) this corresponds to the luminance

    L = 78 N^2 / (q S t) = 120 N^2 / (S t)  cd/m2

for the f-number N and the time t. This luminance maps to 1, display white, before tone mapping. The luminance of a
colour is 683 lm/W times the luminance of its linear Rec. 709 values in W/(sr m2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from clrender.errors import UsageError
from clrender.limits import NotAllowed, Range

__all__ = ["LUMENS_PER_WATT", "PHOTOGRAPHIC", "SPEED", "camera_exposure", "photographic_shutter", "photographic_stops"]

PHOTOGRAPHIC: Final[Mapping[str, Range]] = {
    "f_stop": Range(0.1, 1000.0),
    "shutter": Range(1e-6, 1e6),
    "iso": Range(0.1, 1e7),
}
"""The parameters of an exposure: f-number, shutter time in seconds, film speed."""
SPEED: Final = 100.0
"""Default film speed if only f-stop and shutter are given."""

LUMENS_PER_WATT: Final = 683.0
"""Luminous efficacy of light of 540 THz, near the eye's peak sensitivity, by the definition of the candela."""
_SATURATION: Final = 78.0 / 0.65
"""Saturation luminance times S t / N^2."""


def photographic_stops(f_stop: float | None = None, shutter: float | None = None, iso: float | None = None) -> float:
    """The exposure, in stops, that is applied to radiance; 0 if nothing is given.

    Parameters
    ----------
    f_stop : float, optional
        F-number N: focal length over the diameter of the diaphragm.
    shutter : float, optional
        Time, seconds.
    iso : float, optional
        Film speed S; default if the others are given: 100.

    Raises
    ------
    UsageError
        When a value is not allowed, or f-stop or shutter is missing although another is given.
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
            blur = ", and for motion blur two times, such as 0:1/48" if "shutter" in given else ""
            raise UsageError(
                f"{' and '.join(given)} {'makes' if len(given) == 1 else 'make'} no exposure without {missing}; give "
                f"f_stop and shutter, or only exposure{blur}"
            )
    if not given:
        return 0.0
    light = math.log2(given["shutter"]) + math.log2(given.get("iso", SPEED)) - 2.0 * math.log2(given["f_stop"])
    return light + math.log2(LUMENS_PER_WATT / _SATURATION)


def photographic_shutter(stops: int, f_stop: float) -> float:
    """The shutter time, seconds, for which `photographic_stops` of an f-number and the default film speed is `stops`.

    It is limited to times that are allowed.
    """
    allowed = PHOTOGRAPHIC["shutter"]
    return min(
        max(math.ldexp(f_stop * f_stop * _SATURATION / (LUMENS_PER_WATT * SPEED), stops), allowed.low), allowed.high
    )


def camera_exposure(provenance: Mapping[str, Any] | None, given: Mapping[str, float | None]) -> dict[str, float]:
    """The exposure parameters of an image: those given, else those of the camera in its provenance.

    Parameters
    ----------
    provenance : mapping or None
        Statistics of a render, in which the key ``camera_exposure`` is read.
    given : mapping
        Some of `PHOTOGRAPHIC`; None for parameters that are not given.

    Returns
    -------
    dict
        Arguments of `photographic_stops`.
    """
    noted = (provenance or {}).get("camera_exposure")
    noted = noted if isinstance(noted, Mapping) else {}
    values = {**noted, **{name: value for name, value in given.items() if value is not None}}
    return {name: values[name] for name in PHOTOGRAPHIC if values.get(name) is not None}
