"""Exposure of a model's first image, where its lights are much too dim or bright for a display.

The light that arrives at what the camera sees is estimated without shadows and interreflection, and surfaces count as
grey. That is wrong by a stop or two, so only exposures of several stops are chosen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.exact.matrices import inner, length
from clrender.image.tone_map import LUMINANCE
from clrender.importers.surface_points import Floats, SurfacePoints
from clrender.scene.light_kinds import DirectionalLight, Light, PointLight, SpotLight
from clrender.scene.values import Vector

__all__ = ["stops_needed"]

_ALBEDO: Final = 0.5
_BRIGHT: Final = 0.4
"""Radiance that surfaces in much light are to have in the image."""
_SHARE: Final = 0.75
"""Of what is seen, this share is darker."""
_LEAST_STOPS: Final = 3
_MOST_SEEN: Final = 4096
_MOST_EMITTERS: Final = 256


def stops_needed(points: SurfacePoints, seen: NDArray[np.bool_], lights: Iterable[Light]) -> int:
    """The number of stops by which an image is to be brightened; 0 if it is not much too dark or bright.

    Parameters
    ----------
    points : SurfacePoints
    seen : (N,) bool
        Those that the camera sees.
    lights : iterable of light
        Any that shines from everywhere is bright enough.

    Returns
    -------
    int
    """
    places = np.flatnonzero(seen & (points.emitted == 0.0))
    places = places[:: -(-len(places) // _MOST_SEEN) or 1]
    arriving = np.zeros(len(places))
    at, normals = points.positions[places], points.normals[places]
    for light in lights:
        if isinstance(light, DirectionalLight):
            arriving += _luminance(light.irradiance) * np.abs(
                inner(normals, np.array(light.direction) / length(light.direction))
            )
        elif isinstance(light, PointLight | SpotLight):
            arriving += _from_point(light, at, normals)
        else:
            return 0
    arriving += _from_surfaces(points, at, normals)
    if not len(places):
        return 0
    bright = float(np.sort(arriving)[int(_SHARE * (len(places) - 1))]) * _ALBEDO / math.pi
    if not 0.0 < bright < math.inf:
        return 0
    # Rounded by comparison, as logarithms are not the same on every processor
    mantissa, exponent = math.frexp(_BRIGHT / bright)
    stops = exponent if mantissa >= math.sqrt(0.5) else exponent - 1
    return stops if abs(stops) >= _LEAST_STOPS else 0


def _from_point(light: PointLight | SpotLight, at: Floats, normals: Floats) -> Floats:
    away = at - np.array(light.position)
    squared = np.maximum(inner(away, away), 1e-30)
    unit = away / np.sqrt(squared)[:, None]
    irradiance = _luminance(light.intensity) * np.abs(inner(unit, normals)) / squared
    if isinstance(light, SpotLight):
        _, least = sin_cos_degrees(light.cone_degrees / 2.0)
        irradiance = np.where(inner(unit, np.array(light.direction) / length(light.direction)) > least, irradiance, 0.0)
    return irradiance


def _from_surfaces(points: SurfacePoints, at: Floats, normals: Floats) -> Floats:
    arriving = np.zeros(len(at))
    emitters = np.flatnonzero(points.emitted > 0.0)
    some = emitters[:: -(-len(emitters) // _MOST_EMITTERS) or 1]
    area = points.area / max(1, len(points.emitted)) * (len(emitters) / max(1, len(some)))
    for each in some:
        away = at - points.positions[each]
        squared = np.maximum(inner(away, away), area)
        cosines = np.abs(inner(away, normals)) * np.maximum(inner(away, points.normals[each]), 0.0)
        arriving += points.emitted[each] * area * cosines / (squared * squared)
    return arriving


def _luminance(color: Vector) -> float:
    return sum(weight * part for weight, part in zip(LUMINANCE, color, strict=True))
