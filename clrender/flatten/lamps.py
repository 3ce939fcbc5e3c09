"""Point-like lights, as the light arrays and the light tree need them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.angles import sin_cos_degrees
from clrender.flatten.lamp_tables import LampTables
from clrender.image.exposure import LUMENS_PER_WATT
from clrender.scene.light_kinds import IesLight, PointLight, SpotLight
from clrender.scene.values import Color, Vector, cross, length

__all__ = ["AT_POINT", "Lamp", "lamp_at", "lamp_directions"]

AT_POINT: Final = (PointLight, SpotLight, IesLight)
_STEEPEST: Final = 1e30
"""Slope of the edge of a spotlight without blend."""


@dataclass(frozen=True)
class Lamp:
    """A point-like light.

    Attributes
    ----------
    kind : int
        `layout.LIGHT_*`
    intensity : (3,) float
        The largest intensity, W/sr.
    flux : float
        Integral of intensity / largest intensity over solid angle, steradians.
    axis, zero : (4,) float
        See the struct `Light`.
    table : int
        See the struct `Light`.
    mean : (3,) float64
        Approximate mean direction of its light; zero if it is isotropic.
    cone_axis, cone_cosine : (3,) float64, float
        A cone that bounds its emission: axis, and cosine of the half angle.
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
    """Parameters of a point-like light for the kernels.

    Parameters
    ----------
    light : PointLight, SpotLight or IesLight
    tables : LampTables
        Tables of its scene.
    """
    if isinstance(light, PointLight):
        return Lamp(layout.LIGHT_POINT, light.intensity, 4.0 * math.pi)
    return _spot(light) if isinstance(light, SpotLight) else _ies(light, tables)


def _spot(light: SpotLight) -> Lamp:
    """Smoothstep falloff, between the cosine of the edge and the value `blend` of the way from there to 1."""
    sine = sin_cos_degrees(light.cone_degrees / 4.0)[0]
    spread = 2.0 * (sine * sine)
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
    # The narrower of the cones about straight down and straight up
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
    """Unit vectors of the file's vertical angle 0, and of its horizontal angles 0 and 90."""
    axis = _unit(light.direction)
    side = _unit(cross(_unit(light.zero), axis))
    return axis, _unit(cross(axis, side)), side


def _unit(vector: Vector) -> Vector:
    size = length(vector)
    x, y, z = (each / size for each in vector)
    return (x, y, z)


def _tilt(axis: Vector) -> float:
    """Angle of a unit vector from straight down, -y, degrees; by bisection, for the same bits on every machine."""
    if abs(axis[1]) == 1.0:
        return 90.0 + 90.0 * axis[1]
    low, high = 0.0, 180.0
    for _ in range(40):
        middle = (low + high) / 2.0
        low, high = (middle, high) if sin_cos_degrees(middle)[1] > -axis[1] else (low, middle)
    return low
