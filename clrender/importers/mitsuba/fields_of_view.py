"""Fields of view of Mitsuba's sensors and projectors."""

from __future__ import annotations

import math
from typing import Final

from clrender.exact.angles import angle_of
from clrender.importers.mitsuba.plugins import Plugin
from clrender.importers.shared.cameras import vertical_angle
from clrender.wording import quoted

__all__ = ["vertical_field"]

_FILM_DIAGONAL: Final = math.sqrt(36.0 * 36.0 + 24.0 * 24.0)
"""Diagonal of the film that focal lengths refer to, millimetres."""


def vertical_field(plugin: Plugin, width: int, height: int) -> float:
    """Vertical field of view of a sensor or projector, degrees.

    Parameters
    ----------
    plugin : Plugin
    width, height : int
        Pixels of its picture.

    Raises
    ------
    SceneError
        What it says about its field of view is of no use.
    """
    axis = plugin.text("fov_axis", "x")
    if axis not in ("x", "y", "diagonal", "smaller", "larger"):
        raise plugin.fault(f'"fov_axis" is {quoted(axis)}, but must be x, y, diagonal, smaller or larger')
    degrees = plugin.number("fov", 0.0)
    if not plugin.has("fov"):
        text = plugin.text("focal_length", "50mm").removesuffix("mm").strip()
        try:
            focal = float(text)
        except ValueError:
            focal = 0.0
        if not 0.0 < focal < math.inf:
            raise plugin.fault(f'"focal_length" is {quoted(text)}, but must be such as 50mm')
        axis, degrees = "diagonal", math.degrees(2.0 * angle_of(_FILM_DIAGONAL / (2.0 * focal), 1.0))
    if not 0.0 < degrees < 180.0:
        raise plugin.fault(f'"fov" is {degrees:g}, but must be above 0 and below 180 degrees')
    return vertical_angle(degrees, axis, width, height)
