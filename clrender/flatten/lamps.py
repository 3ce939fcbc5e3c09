"""Point-like lights, as the light arrays and the light tree need them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.angles import sin_cos_degrees
from clrender.exact.matrices import inner, times
from clrender.flatten.lamp_tables import LAMP_ROW, Key, LampTable, LampTables, lamp_table, moved_words
from clrender.flatten.plugin_lights import Emitted, given_words, light_axes, light_spread
from clrender.flatten.plugin_rows import plugin_of
from clrender.flatten.projected import projector_table
from clrender.flatten.sky import scene_sun
from clrender.image.exposure import LUMENS_PER_WATT
from clrender.scene.ies import IesProfile
from clrender.scene.light_kinds import IesLight, PluginLight, PointLight, ProjectorLight, SpotLight
from clrender.scene.motion import matrices_of
from clrender.scene.values import POWER_LIMIT, Color, Vector, cross, length

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from clrender.flatten.motion import Knots
    from clrender.scene.description import Scene

__all__ = ["AT_POINT", "LAMP_KINDS", "POINT_KINDS", "Lamp", "given_lamp", "lamp_at", "lamp_directions", "lamp_tables"]

AT_POINT: Final = (PointLight, SpotLight, IesLight, ProjectorLight, PluginLight)
LAMP_KINDS: Final = (layout.LIGHT_SPOT, layout.LIGHT_IES, layout.LIGHT_PROJECTOR, layout.LIGHT_PLUGIN)
"""Of the lights at a point, those that do not shine alike in all directions."""
POINT_KINDS: Final = (layout.LIGHT_POINT, *LAMP_KINDS)
_WORD_LIMIT: Final = 2**28
_STEEPEST: Final = 1e30
"""Slope of the edge of a spotlight without blend."""
_SLACK: Final = 1.0001
"""By how much a cone with a hard edge is larger for the light BVH, which rounds otherwise than the light itself."""
_ALL_AROUND: Final = 1e-3
"""Length of the mean of unit vectors below which they point all around."""


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


def lamp_tables(scene: Scene, emitted: Mapping[int, Emitted] | None = None) -> LampTables:
    """The tables of all IES files and projectors that a scene names, of its lights of plugins, and of its sun.

    Parameters
    ----------
    scene : Scene
    emitted : mapping of int to Emitted, optional
        What lights of plugins give, by their index; default: as if their formulas were 1.

    Raises
    ------
    SceneError
        If a file cannot be read.
    """
    rows: dict[Key, int] = {}
    tables: dict[Key, LampTable] = {}
    profiles: dict[str, IesProfile] = {}
    sun = scene_sun(scene)
    parts: list[NDArray[np.float32]] = [] if sun is None else [sun.words]
    total = sum(len(words) for words in parts)
    given: dict[int, tuple[int, Emitted]] = {}
    for index, light in enumerate(scene.lights):
        if isinstance(light, PluginLight):
            even = Emitted.even(light_spread(plugin_of(scene, light)))
            given[index] = total // LAMP_ROW, (emitted or {}).get(index, even)
            parts.append(given_words(scene, light))
            total += len(parts[-1])
            continue
        if not isinstance(light, IesLight | ProjectorLight) or (key := _key(light)) in tables:
            continue
        if isinstance(light, IesLight):
            profiles[light.file] = scene.ies_profile(index)
            table = lamp_table(profiles[light.file])
        else:
            table = projector_table(scene.light_picture(index).pixels, light.vertical_fov, light.even)
        if total + len(table.words) > _WORD_LIMIT:
            text = "more intensities than fit; use smaller pictures, or fewer files"
            raise SceneError(f"{scene.source}: lights[{index}].file: {text}")
        tables[key], rows[key] = table, total // LAMP_ROW
        parts.append(moved_words(table.words, total))
        total += len(table.words)
    return LampTables(np.concatenate(parts) if parts else np.zeros(1, np.float32), sun, rows, tables, profiles, given)


def _key(light: IesLight | ProjectorLight) -> Key:
    return (light.file,) if isinstance(light, IesLight) else (light.file, light.vertical_fov, light.even)


def lamp_at(
    light: PointLight | SpotLight | IesLight | ProjectorLight, tables: LampTables, knots: Knots | None = None
) -> Lamp:
    """Parameters of a point-like light for the kernels.

    Parameters
    ----------
    light : PointLight, SpotLight, IesLight or ProjectorLight
    tables : LampTables
        Tables of its scene.
    knots : Knots, optional
        Of its motion: `axis` and `zero` are those before it, `mean` and the cone those of all of its way.
    """
    if isinstance(light, PointLight):
        return Lamp(layout.LIGHT_POINT, light.intensity, 4.0 * math.pi)
    turned = np.eye(3) if knots is None else matrices_of(knots.rotations[0])
    if isinstance(light, ProjectorLight):
        lamp = _projector(light, tables)
    else:
        lamp = _spot(light) if isinstance(light, SpotLight) else _ies(light, tables, turned)
    return lamp if knots is None else _on_its_way(lamp, knots)


def _on_its_way(lamp: Lamp, knots: Knots) -> Lamp:
    """The lamp with the mean direction of its light, and a cone about it, of all of its motion."""
    turns = matrices_of(knots.rotations)
    means, axes = inner(turns, lamp.mean), inner(turns, lamp.cone_axis)
    spans = np.diff(knots.shares)[:, None]
    mean = (0.5 * spans * (means[1:] + means[:-1])).sum(axis=0)
    middle = axes.sum(axis=0)
    size = length((float(middle[0]), float(middle[1]), float(middle[2])))
    if size <= _ALL_AROUND * len(axes):
        return replace(lamp, mean=mean, cone_axis=np.zeros(3), cone_cosine=-1.0)
    middle = middle / size
    # Between two knots a direction is from the nearer one by at most half the angle between both
    beside = np.abs(inner(knots.rotations[1:], knots.rotations[:-1])).min()
    cosine = _sum_of_angles(float(inner(middle, axes).min()), min(float(beside), 1.0))
    return replace(lamp, mean=mean, cone_axis=middle, cone_cosine=_sum_of_angles(cosine, lamp.cone_cosine))


def _sum_of_angles(first: float, second: float) -> float:
    """Cosine of the sum of two angles given by their cosines; -1 from half a turn on."""
    if first + second <= 0.0:
        return -1.0
    sines = (math.sqrt(max(1.0 - cosine * cosine, 0.0)) for cosine in (first, second))
    return first * second - next(sines) * next(sines)


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


def _ies(light: IesLight, tables: LampTables, turned: NDArray[np.float64]) -> Lamp:
    table, (axis, zero, side) = tables.table[_key(light)], lamp_directions(light)
    profile = tables.profile[light.file]
    # A lamp that turns keeps the flux of the moment when the shutter opens
    tilted = profile.tilt_factor(_tilt(times(turned, axis).tolist())) if profile.tilt.size else 1.0
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
        table=tables.row[_key(light)],
        mean=np.array(zero) * x + np.array(side) * y + np.array(axis) * z,
        cone_axis=np.array(axis) * (1.0 if down else -1.0),
        cone_cosine=table.most if down else -table.least,
    )


def _projector(light: ProjectorLight, tables: LampTables) -> Lamp:
    table = tables.table[_key(light)]
    axis = _unit(light.direction)
    right = _unit(cross(axis, _unit(light.up)))
    up = cross(right, axis)
    red, green, blue = (table.peak * s for s in light.scale)
    x, y, z = table.mean.tolist()
    return Lamp(
        layout.LIGHT_PROJECTOR,
        (red, green, blue),
        table.flux,
        axis=(*axis, 0.0),
        zero=(*right, 0.0),
        table=tables.row[_key(light)],
        mean=np.array(right) * x + np.array(up) * y + np.array(axis) * z,
        cone_axis=np.array(axis),
        cone_cosine=table.most,
    )


def given_lamp(scene: Scene, index: int, tables: LampTables, knots: Knots | None = None) -> Lamp:
    """Parameters of a plugin's light for the kernels.

    Parameters
    ----------
    scene : Scene
    index : int
        Of the light.
    tables : LampTables
        Tables of the scene.
    knots : Knots, optional
        See `lamp_at`.

    Raises
    ------
    SceneError
        Its intensity is too large.
    """
    light = scene.lights[index]
    assert isinstance(light, PluginLight)
    row, emitted = tables.given[index]
    spread = light_spread(plugin_of(scene, light))
    red, green, blue = light.scale
    brightest = emitted.peak * max(light.scale)
    if brightest > POWER_LIMIT:
        bright = f"makes an intensity of {brightest:g} W/sr; at most {POWER_LIMIT:g} is known"
        raise SceneError(f"{scene.source}: lights[{index}].scale: {bright}")
    shares = (0.2126 * red, 0.7152 * green, 0.0722 * blue)
    black = sum(shares) == 0.0
    x, y, z = np.zeros(3) if black else emitted.mean(shares)
    right, up, axis = (np.array(each) for each in light_axes(light))
    lamp = Lamp(
        layout.LIGHT_PLUGIN,
        light.scale,
        0.0 if black else emitted.flux(shares, spread),
        # The row is a number here, as only `light_at` knows of these lights
        axis=(float(row), 0.0, 0.0, 0.0),
        mean=right * x + up * y + axis * z,
        cone_axis=axis,
        cone_cosine=max(1.0 - _SLACK * spread, -1.0),
    )
    return lamp if knots is None else _on_its_way(lamp, knots)


def lamp_directions(light: IesLight) -> tuple[Vector, Vector, Vector]:
    """Unit vectors of the file's vertical angle 0, and of its horizontal angles 0 and 90."""
    axis = _unit(light.direction)
    side = _unit(cross(_unit(light.zero), axis))
    return axis, _unit(cross(axis, side)), side


def _unit(vector: Vector) -> Vector:
    size = length(vector)
    x, y, z = (each / size for each in vector)
    return (x, y, z)


def _tilt(axis: Sequence[float]) -> float:
    """Angle of a unit vector from straight down, -y, degrees; by bisection, for the same bits on every machine."""
    if abs(axis[1]) == 1.0:
        return 90.0 + 90.0 * axis[1]
    low, high = 0.0, 180.0
    for _ in range(40):
        middle = (low + high) / 2.0
        low, high = (middle, high) if sin_cos_degrees(middle)[1] > -axis[1] else (low, middle)
    return low
