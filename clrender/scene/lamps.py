"""Lights at a point, as the arrays of lights and the tree of lights need them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exposure import LUMENS_PER_WATT
from clrender.scene.angles import sin_cos_degrees
from clrender.scene.lamp_tables import LampTables
from clrender.scene.light_kinds import IesLight, PointLight, SpotLight
from clrender.scene.values import Color, Vector, cross, length

__all__ = ["AT_POINT", "Lamp", "lamp_at", "lamp_directions"]

AT_POINT: Final = (PointLight, SpotLight, IesLight)
_STEEPEST: Final = 1e30
"""Of a spot with a sharp edge."""


@dataclass(frozen=True)
class Lamp:
    """A light at a point.

    Attributes
    ----------
    kind : int
        `layout.LIGHT_*`
    intensity : (3,) float
        The largest one, W/sr.
    flux : float
        Integral of the intensity by solid angle, over the largest one: steradians.
    axis, zero : (4,) float
        As of the struct `Light`.
    table : int
        Likewise.
    mean : (3,) float64
        About the mean direction of its light; zero where it shines alike in all.
    cone_axis, cone_cosine : (3,) float64, float
        A cone with all directions of its light: the middle, and the cosine of half its angle.
    """

    kind: int
    intensity: Color
    flux: float
    axis: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    zero: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    table: int = 0
    mean: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    cone_axis: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    cone_cosine: float = -1.0


def lamp_at(light: PointLight | SpotLight | IesLight, tables: LampTables) -> Lamp:
    """What a light at a point is to the kernels.

    Parameters
    ----------
    light : PointLight, SpotLight or IesLight
    tables : LampTables
        Of its scene.
    """
    if isinstance(light, PointLight):
        return Lamp(layout.LIGHT_POINT, light.intensity, 4.0 * math.pi)
    return _spot(light) if isinstance(light, SpotLight) else _ies(light, tables)


def _spot(light: SpotLight) -> Lamp:
    """Between the cosine of the edge, and what lies `blend` of the way from there to 1, a step that has no kink."""
    spread = 2.0 * sin_cos_degrees(light.cone_degrees / 4.0)[0] ** 2
    fall, edge = light.blend * spread, 1.0 - spread
    flux = 2.0 * math.pi * spread * (1.0 - light.blend / 2.0)
    inner = edge + fall
    # Integral of the cosine times the intensity over both parts
    along = (1.0 - inner * inner) / 2.0 + fall * edge / 2.0 + 0.35 * fall * fall
    axis = _unit(light.direction)
    steepness = min(1.0 / fall, _STEEPEST) if fall > 0.0 else _STEEPEST
    return Lamp(
        layout.LIGHT_SPOT,
        light.intensity,
        flux,
        axis=(*axis, spread),
        zero=(0.0, 0.0, 0.0, steepness),
        mean=np.array(axis) * (along * 2.0 * math.pi / flux),
        cone_axis=np.array(axis),
        cone_cosine=edge,
    )


def _ies(light: IesLight, tables: LampTables) -> Lamp:
    table, (axis, zero, side) = tables.table[light.file], lamp_directions(light)
    profile = tables.profile[light.file]
    tilted = profile.tilt_factor(_tilt(axis)) if profile.tilt.size else 1.0
    watts = table.peak * tilted / LUMENS_PER_WATT
    red, green, blue = (watts * s for s in light.scale)
    x, y, z = table.mean.tolist()
    # The narrower one of the cones about straight down and straight up
    down = table.most >= -table.least
    return Lamp(
        layout.LIGHT_IES,
        (red, green, blue),
        table.flux,
        axis=(*axis, 0.0),
        zero=(*zero, 0.0),
        table=tables.row[light.file],
        mean=np.array(zero) * x + np.array(side) * y + np.array(axis) * z,
        cone_axis=np.array(axis) * (1.0 if down else -1.0),
        cone_cosine=table.most if down else -table.least,
    )


def lamp_directions(light: IesLight) -> tuple[Vector, Vector, Vector]:
    """Unit vectors in which the file's vertical angle 0 lies, and horizontal ones of 0 and of 90.

    Parameters
    ----------
    light : IesLight
    """
    axis = _unit(light.direction)
    side = _unit(cross(_unit(light.zero), axis))
    return axis, _unit(cross(axis, side)), side


def _unit(vector: Vector) -> Vector:
    size = length(vector)
    x, y, z = (each / size for each in vector)
    return (x, y, z)


def _tilt(axis: Vector) -> float:
    """Degrees from straight down, -y, of a unit vector: by bisection, which is the same on every machine."""
    if abs(axis[1]) == 1.0:
        return 90.0 + 90.0 * axis[1]
    low, high = 0.0, 180.0
    for _ in range(40):
        middle = (low + high) / 2.0
        low, high = (middle, high) if sin_cos_degrees(middle)[1] > -axis[1] else (low, middle)
    return low
