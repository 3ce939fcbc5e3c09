"""Position of the sun at a place and time."""

from __future__ import annotations

from datetime import datetime, timezone
from functools import lru_cache
from typing import Final

from clrender.errors import SceneError

__all__ = ["parsed_time", "sun_position"]

_YEARS: Final = (1901, 2099)
"""Years for which the formulas are accurate to about 0.01 degrees."""
_DIGITS: Final = 4
"""Decimal places of degrees: the last bits of sines differ between machines."""


def parsed_time(text: str) -> datetime:
    """Parse an ISO 8601 date and time with offset from UTC, such as ``2026-06-21T18:30:00+02:00``.

    Raises
    ------
    ValueError
        The message continues after the name of the key.
    """
    cure = "give a date and time with its offset from UTC, such as 2026-06-21T18:30:00+02:00"
    try:
        time = datetime.fromisoformat(text[:-1] + "+00:00" if text[-1:] in ("Z", "z") else text)
    except ValueError:
        raise ValueError(f"is no date and time of ISO 8601; {cure}") from None
    if time.tzinfo is None:
        raise ValueError(f"has no offset from UTC; {cure}")
    if not _YEARS[0] <= time.year <= _YEARS[1]:
        raise ValueError(f"is in the year {time.year}; the sun's place is known from {_YEARS[0]} to {_YEARS[1]}")
    return time


@lru_cache(maxsize=256)
def sun_position(latitude: float, longitude: float, time: str) -> tuple[float, float]:
    """Elevation of the sun's centre above the horizon, and its azimuth from north towards east.

    Uses the formulas of NOAA's solar calculator (Meeus, "Astronomical Algorithms"), as implemented by `astral`, with
    refraction of a mean atmosphere; rounded to 0.0001 degrees.

    Parameters
    ----------
    latitude, longitude : float
        Degrees, to the north and to the east.
    time : str
        See `parsed_time`.

    Returns
    -------
    elevation, azimuth : float
        Degrees.

    Raises
    ------
    SceneError
        If `astral` is not installed.
    """
    try:
        from astral import Observer
        from astral.sun import zenith_and_azimuth
    except ImportError:
        raise SceneError(
            "the sun's place at a time needs the package astral; install it with `pip install astral`, or give "
            "sun_direction instead"
        ) from None
    zenith, azimuth = zenith_and_azimuth(Observer(latitude, longitude, 0.0), parsed_time(time).astimezone(timezone.utc))
    return round(90.0 - zenith, _DIGITS), round(azimuth % 360.0, _DIGITS)
