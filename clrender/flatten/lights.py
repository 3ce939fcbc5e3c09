"""The lights of a scene as arrays: a row for each light, and the table or tree that samples them."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.angles import root
from clrender.exact.matrices import determinant, lengths, times
from clrender.flatten.alias import alias_table
from clrender.flatten.emission import Emission, shape_emission
from clrender.flatten.emission_means import EmissionMeans
from clrender.flatten.environment import EnvironmentTable, environment_table
from clrender.flatten.instances import FlatInstances, box_of
from clrender.flatten.lamp_tables import LampTables
from clrender.flatten.lamps import AT_POINT, LAMP_KINDS, POINT_KINDS, Lamp, given_lamp, lamp_at
from clrender.flatten.light_tree import Emitters, LightTree, light_tree
from clrender.flatten.motion import Knots, knots_of, light_knot_rows, swept_boxes
from clrender.flatten.sky import Sun, sky_picture
from clrender.flatten.spectral import SpectralPlace
from clrender.flatten.surface_arrays import FlatSurfaces
from clrender.flatten.surfaces import triangle_areas
from clrender.flatten.texture_rows import FlatTextures
from clrender.scene.description import DirectionalLight, IesLight, PluginLight, Scene, SunSkyLight
from clrender.scene.groups import ShapeOrInstance
from clrender.scene.light_kinds import MOVING_LIGHTS, Light
from clrender.scene.motion import Track, matrices_of
from clrender.scene.shapes import Disk, Sphere
from clrender.scene.spectra import SpectralColor
from clrender.scene.values import POWER_LIMIT, Color, length
from clrender.wording import counted, place

__all__ = ["FlatLights", "flat_environment", "flat_lights"]

_Rows: TypeAlias = NDArray[np.void]
_LIGHT_LIMIT: Final = 2**24
_TOO_BRIGHT: Final = f"makes a radiance of {{:g}}; at most {POWER_LIMIT:g} is known; make its scale smaller"
_TREE_FROM: Final = 5
"""Number of lights from which the light tree pays off."""
_SUN_LIGHT: Final = next(at for name, at, _, _ in layout.ROWS["SUN"] if name == "LIGHT")
_LEAST_SHARE: Final = 1e-3
"""Fraction of an emission texture's mean: parts of a light never count as darker, as their means are estimates."""


@dataclass(frozen=True)
class FlatLights:
    """Lights as kernels read them.

    Attributes
    ----------
    rows : (L,) `Light`
        Black lights are omitted. May be empty.
    count : int
        Number of first rows that light sampling chooses from; each has a probability above 0. After them there may be
        an environment that only BSDF sampling finds.
    environment : int
        Row of the environment light, or `layout.NONE`.
    tree : LightTree or None
        If it is used instead of the alias table.
    groups : tuple of str
        Light group of each row; empty for none.
    spectral : tuple of SpectralPlace
        Rows whose light is a spectrum.
    knots : (K, 16) float32
        Rows of the motions of lights that are no surfaces.
    """

    rows: _Rows
    count: int
    environment: int
    tree: LightTree | None
    groups: tuple[str, ...] = ()
    spectral: tuple[SpectralPlace, ...] = ()
    knots: NDArray[np.float32] = dataclasses.field(default_factory=lambda: np.zeros((0, 16), np.float32))

    def with_knots(self, others: NDArray[np.float32]) -> NDArray[np.float32]:
        """(K, 16) rows of the motions of instances, and then those of its own, which its rows refer to."""
        return np.concatenate([others, self.knots]) if len(self.knots) else others


def flat_environment(scene: Scene, compensated: bool = False) -> EnvironmentTable:
    """The scene's environment as kernels read it; black if there is none.

    Parameters
    ----------
    scene : Scene
    compensated : bool
        See `environment_table`.

    Raises
    ------
    SceneError
        If its environment map cannot be read, or is too bright for single precision.
    """
    if scene.sky is not None:
        return _sky_environment(scene, scene.sky, compensated)
    light, picture = scene.environment, scene.environment_picture()
    if light is None or picture is None:
        return EnvironmentTable.even(light.constant if light else (0.0, 0.0, 0.0), compensated)
    brightest = max(float(picture.pixels[..., i].max()) * light.scale[i] for i in range(3))
    if brightest > POWER_LIMIT:
        place = f"{scene.source}: lights[{scene.lights.index(light)}].scale"
        raise SceneError(f"{place}: makes a radiance of {brightest:g}; at most {POWER_LIMIT:g} is known")
    return environment_table(picture, light.rotate_degrees % 360.0 / 360.0, light.scale, compensated)


def flat_lights(
    scene: Scene,
    surfaces: FlatSurfaces,
    instances: FlatInstances,
    textures: FlatTextures,
    around: EnvironmentTable,
    tables: LampTables,
    choice: str = "auto",
) -> FlatLights:
    """Rows of all lights that are not black: shapes in order, then the lights of the file in order.

    Parameters
    ----------
    scene : Scene
    surfaces : FlatSurfaces
        Surfaces of this scene; `first_light` of its shapes is written.
    instances : FlatInstances
        Instances of this scene; none of their shapes emits light.
    textures : FlatTextures
        Textures of this scene.
    around : EnvironmentTable
        Table of the environment light.
    tables : LampTables
        Tables of this scene's IES files.
    choice : str
        A light sampler of `clrender.settings`.

    Raises
    ------
    SceneError
        If more than 2**24 triangles emit light, a texture is not a valid radiance, or an IES file is too bright.
    """
    collector = _LightCollector(scene, surfaces, instances, textures, around, tables)
    for index in range(len(scene.shapes)):
        collector.add_shape(index)
    for index, light in enumerate(scene.lights):
        collector.add_light(index, light)
    return collector.lights(choice)


class _LightCollector:
    """Collects rows of lights, and what their sampler wants to know of them; for the parameters see `flat_lights`."""

    def __init__(
        self,
        scene: Scene,
        surfaces: FlatSurfaces,
        instances: FlatInstances,
        textures: FlatTextures,
        around: EnvironmentTable,
        tables: LampTables,
    ) -> None:
        self._scene, self._surfaces, self._instances = scene, surfaces, instances
        self._textures, self._around, self._tables = textures, around, tables
        self._radius = _bounding_radius(surfaces, instances)
        self._rows: list[_Rows] = []
        self._groups: list[NDArray[np.str_]] = []
        self._powers: list[NDArray[np.float64]] = []
        self._spectral: list[SpectralPlace] = []
        self._total, self._environment = 0, layout.NONE
        self._unsampled: tuple[_Rows, object, Color, NDArray[np.str_]] | None = None
        self._ways: list[tuple[slice, Knots]] = []
        self._carried: list[tuple[int, Knots]] = []
        self._lamps: dict[int, Lamp] = {}
        self._darkest: dict[int, float] = {}
        self._means: dict[int, NDArray[np.float64]] = {}

    def _add(self, part: ShapeOrInstance | Light, rows: _Rows, powers: NDArray[np.float64]) -> slice:
        """Add rows; returns where they are."""
        where = slice(self._total, self._total + len(rows))
        self._rows.append(rows)
        self._groups.append(_group(part, len(rows)))
        self._powers.append(powers)
        self._total += len(rows)
        return where

    def add_shape(self, index: int) -> None:
        """Add the triangles, or the surface, of a shape that shines."""
        scene, surfaces = self._scene, self._surfaces
        emission = shape_emission(scene, index)
        if emission is None:
            return
        texture = self._textures.emission.get(index)
        if self._least(emission, texture) == 0.0:
            return
        count = int(surfaces.count[index])
        if self._total + count > _LIGHT_LIMIT:
            at = place((*scene.place_of(index), "emission"))
            raise SceneError(
                f"{scene.source}: {at}: more than {counted(_LIGHT_LIMIT, 'triangle')} would shine; use fewer, or an "
                "environment"
            )
        some, areas = _area_lights(scene, surfaces, index)
        moving = self._instances.moving_light(int(surfaces.first[index]), len(surfaces.triangles))
        if moving is not None:
            some["offset"], areas = moving[1], areas * _grown(moving[0])
        if texture is None:
            some["radiance"][:, :3] = emission.constant
            luminances: Any = _luminance(emission.constant)
        else:
            if index not in self._means:
                self._means |= _means(scene, surfaces, self._textures, texture)
            some["radiance"][:, :3] = self._means[index]
            some["texture"] = texture + 1
            luminances = np.maximum(_luminances(some["radiance"]), self._darkest[texture])
        where = self._add(scene.shapes[index], some, math.pi * areas * luminances)
        surfaces.shapes["first_light"][index] = where.start
        if texture is None:
            self._spectral += _spectral(where, emission.color, emission.constant)
        if moving is not None:
            self._ways.append((where, moving[0]))

    def _least(self, emission: Emission, texture: int | None) -> float:
        """The least luminance that a shape's light is taken for; 0 if it is black."""
        if texture is None:
            return _luminance(emission.constant)
        if texture not in self._darkest:
            luminance = _texture_luminance(self._scene, emission, EmissionMeans(self._textures, texture))
            self._darkest[texture] = _LEAST_SHARE * luminance
        return self._darkest[texture]

    def add_light(self, index: int, light: Light) -> None:
        """Add a light of the file, unless it is black."""
        row = np.zeros(1, dtype=layout.dtype("Light"))
        row["primitive"] = layout.NONE
        row["alias_threshold"], row["place"] = 1.0, layout.NONE
        knots = None
        if isinstance(light, MOVING_LIGHTS) and light.motion:
            knots = knots_of(Track(light.motion), self._scene, index, "lights")
        if isinstance(light, AT_POINT):
            where = self._add_lamp(index, light, row, knots)
        elif isinstance(light, DirectionalLight):
            size = length(light.direction)
            row["position"][0, :3] = [x / size for x in light.direction]
            row["kind"] = layout.LIGHT_DIRECTIONAL
            factor = math.pi * self._radius * self._radius
            where = self._add_colored(light, row, light.irradiance, factor, light.irradiance)
        else:
            where = self._add_environment(light, row)
        if knots is not None and where is not None:
            self._carried.append((where.start, knots))
            if row["kind"][0] != layout.LIGHT_DIRECTIONAL:
                self._ways.append((where, knots))

    def _add_colored(self, light: Light, row: _Rows, color: Color, factor: float, said: object) -> slice | None:
        """Add a light of a colour whose power is the factor times its luminance; None if it is black."""
        if _luminance(color) == 0.0:
            return None
        row["radiance"][0, :3] = color
        where = self._add(light, row, np.array([factor * _luminance(color)]))
        self._spectral += _spectral(where, said, color)
        return where

    def _add_lamp(self, index: int, light: Any, row: _Rows, knots: Knots | None) -> slice | None:
        """Add a light that shines from one point; None if it is black."""
        scene, tables = self._scene, self._tables
        # Its motion leads to world space, and has the origin in its own offsets
        origin = self._surfaces.origin if knots is None else (0.0, 0.0, 0.0)
        if isinstance(light, PluginLight):
            lamp = given_lamp(scene, index, tables, knots)
        else:
            lamp = lamp_at(light, tables, knots)
        if max(lamp.intensity) > POWER_LIMIT:
            bright = f"makes an intensity of {max(lamp.intensity):g} W/sr; at most {POWER_LIMIT:g} is known"
            raise SceneError(f"{scene.source}: lights[{index}].scale: {bright}")
        row["kind"] = lamp.kind
        row["position"][0, :3] = [x - o for x, o in zip(light.position, origin, strict=True)]
        row["axis"], row["zero"], row["table"] = lamp.axis, lamp.zero, lamp.table
        said = light.scale if isinstance(light, IesLight | PluginLight) else getattr(light, "intensity", None)
        where = self._add_colored(light, row, lamp.intensity, lamp.flux, said)
        if where is not None:
            self._lamps[where.start] = lamp
        return where

    def _add_environment(self, light: Light, row: _Rows) -> slice | None:
        """Add the sun, which is a light of its own, and the environment; None if that is not sampled."""
        around, tables, radius = self._around, self._tables, self._radius
        if isinstance(light, SunSkyLight) and tables.sun is not None:
            solid_angle = 2.0 * math.pi * tables.sun.spread
            power = math.pi * radius * radius * solid_angle * _luminance(tables.sun.mean)
            where = self._add(light, _sun_row(self._scene, light, tables.sun), np.array([power]))
            tables.words[_SUN_LIGHT : _SUN_LIGHT + 1].view(np.uint32)[0] = where.start
        row["kind"] = layout.LIGHT_ENVIRONMENT
        said = getattr(light, "radiance", None)
        if around.sampled == 0.0:
            if _luminance(around.radiance) != 0.0:
                row["radiance"][0, :3] = around.radiance
                self._unsampled = row, said, around.radiance, _group(light, 1)
            return None
        factor = 4.0 * math.pi * math.pi * radius * radius * around.sampled
        at = self._add_colored(light, row, around.radiance, factor, said)
        if at is not None:
            self._environment = at.start
        return at

    def lights(self, choice: str) -> FlatLights:
        """What was collected, with a sampler of this name; an environment that is not sampled comes last."""
        total, rows = self._total, self._rows
        if self._unsampled is not None:
            row, said, color, group = self._unsampled
            self._environment = total
            rows.append(row)
            self._groups.append(group)
            self._spectral += _spectral(slice(total, total + 1), said, color)
        lights = np.concatenate([np.zeros(0, dtype=layout.dtype("Light")), *rows])
        knot_rows, firsts = light_knot_rows([knots for _, knots in self._carried], self._surfaces.origin)
        lights["primitive"][[number for number, _ in self._carried]] = len(self._instances.motion_rows) + firsts
        tree = self._sampler(lights[:total], choice) if total else None
        groups = tuple(np.concatenate([np.zeros(0, "U1"), *self._groups]).tolist())
        return FlatLights(lights, total, self._environment, tree, groups, tuple(self._spectral), knot_rows)

    def _sampler(self, sampled: _Rows, choice: str) -> LightTree | None:
        """Write down with what probability each light is chosen, or make the tree that chooses one."""
        power = np.concatenate(self._powers)
        shares = np.ones(len(sampled)) if choice == "uniform" else power
        sampled["probability"], sampled["alias_threshold"], sampled["alias"] = alias_table(shares)
        sampled["place"] = layout.NONE
        few = choice == "auto" and len(sampled) < _TREE_FROM
        if len(sampled) < 2 or choice in ("power", "uniform") or few:
            return None
        emitters = _emitters(sampled, power, self._radius, self._surfaces, self._lamps, self._ways)
        tree = light_tree(emitters)
        sampled["place"] = tree.place
        return tree


def _spectral(rows: slice, said: object, color: Color) -> list[SpectralPlace]:
    """Rows of lights of this colour, if a spectrum says it."""
    if not isinstance(said, SpectralColor) or max(said) == 0.0:
        return []
    factor = max(color) / max(said)
    return [SpectralPlace("lights", rows, "radiance", 3, said.values * factor)]


def _group(light: Any, count: int) -> NDArray[np.str_]:
    """The light group of rows of a shape or light; empty if it has none."""
    return np.full(count, light.light_group or "")


def _sky_environment(scene: Scene, light: SunSkyLight, compensated: bool) -> EnvironmentTable:
    """The sky's environment map, rotated to the sun's azimuth."""
    picture = sky_picture(light)
    if picture is None:
        return EnvironmentTable.even((0.0, 0.0, 0.0), compensated)
    if (brightest := float(picture.pixels.max())) > POWER_LIMIT:
        raise SceneError(f"{scene.source}: lights[{scene.lights.index(light)}]: {_TOO_BRIGHT.format(brightest)}")
    return environment_table(picture, light.sun_turn % 360.0 / 360.0, (1.0, 1.0, 1.0), compensated)


def _sun_row(scene: Scene, light: SunSkyLight, sun: Sun) -> _Rows:
    """Row of the sun's disc."""
    brightest = 2.0 * max(sun.mean)  # bound at the centre, as the limb is much darker
    if brightest > POWER_LIMIT:
        raise SceneError(f"{scene.source}: lights[{scene.lights.index(light)}]: {_TOO_BRIGHT.format(brightest)}")
    row = np.zeros(1, dtype=layout.dtype("Light"))
    row["kind"], row["primitive"], row["place"] = layout.LIGHT_SUN, layout.NONE, layout.NONE
    row["radiance"][0, :3], row["alias_threshold"] = sun.mean, 1.0
    row["position"][0, :3] = [-x for x in sun.axis]
    return row


def _grown(knots: Knots) -> float:
    """The factor by which a motion makes areas larger, about: that of its first knot."""
    linear = knots.linear[0]
    factor = root(determinant(linear), 3)
    return factor * factor


def _steady(knots: Knots) -> NDArray[np.float64] | None:
    """The rotation of a motion that does not turn and stretches evenly, (3, 3); None for others."""
    linear = knots.linear
    size = math.sqrt(float((linear[0] * linear[0]).sum()))
    even = np.abs(knots.stretches - knots.stretches[:, :1, :1] * np.eye(3)).max() <= 1e-9 * size
    turned = np.abs(knots.rotations - knots.rotations[0]).max() > 1e-9
    rotation: NDArray[np.float64] = matrices_of(knots.rotations[0])
    return rotation if even and not turned else None


def _emitters(
    lights: _Rows,
    power: NDArray[np.float64],
    radius: float,
    surfaces: FlatSurfaces,
    at_point: dict[int, Lamp],
    ways: list[tuple[slice, Knots]],
) -> Emitters:
    """Data for the light tree; `radius` is the scene's, which set the power of infinitely distant lights.

    `ways` has the lights that move, and their motions.
    """
    kind, primitive = lights["kind"], lights["primitive"]
    low, normal = np.zeros((len(lights), 3)), np.zeros((len(lights), 3))
    high = np.zeros((len(lights), 3))
    points = np.isin(kind, POINT_KINDS)
    low[points] = high[points] = lights["position"][points, :3]
    triangles = kind == layout.LIGHT_AREA_TRIANGLE
    corners = surfaces.vertices[surfaces.triangles[primitive[triangles]]].astype(np.float64)
    low[triangles], high[triangles] = corners.min(1), corners.max(1)
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal[triangles] = np.stack(
        [ab[:, i] * ac[:, j] - ab[:, j] * ac[:, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1
    )
    round_ = (kind == layout.LIGHT_AREA_SPHERE) | (kind == layout.LIGHT_AREA_DISK)
    shapes = surfaces.analytic_shapes[primitive[round_] - len(surfaces.triangles)]
    center = shapes["center_radius"].astype(np.float64)
    low[round_], high[round_] = center[:, :3] - center[:, 3:], center[:, :3] + center[:, 3:]
    normal[round_] = shapes["normal"][:, :3]
    length = lengths(normal)[:, None]
    infinite = np.isin(kind, (layout.LIGHT_DIRECTIONAL, layout.LIGHT_ENVIRONMENT, layout.LIGHT_SUN))
    # For finite lights, flux over π: what a flat light emits along its normal. Others emit in all directions, for which
    # the tree expects a quarter of that. For infinitely distant ones, the irradiance.
    flat = triangles | (kind == layout.LIGHT_AREA_DISK)
    for some, knots in ways:
        swept = swept_boxes(knots, low[some], high[some])
        low[some], high[some] = (corner - np.array(surfaces.origin) for corner in swept)
        rotation = _steady(knots)
        # Of one that turns nothing is known about where it shines
        flat[some] &= rotation is not None
        normal[some] = 0.0 if rotation is None else times(rotation, normal[some])
    per_power = np.where(infinite, 1.0 / (math.pi * radius * radius), 1.0 / math.pi)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)
    cone_axis, cone_cosine = normal.copy(), np.where(flat, 0.0, -1.0)
    lamps = np.flatnonzero(np.isin(kind, LAMP_KINDS))
    for number in lamps.tolist():
        lamp = at_point[number]
        normal[number], cone_axis[number], cone_cosine[number] = lamp.mean, lamp.cone_axis, lamp.cone_cosine
    return Emitters(
        low=low,
        high=high,
        normal=normal,
        power=np.maximum(power * per_power, 1e-200),
        infinite=infinite,
        radius=radius,
        cones=np.concatenate([cone_axis, cone_cosine[:, None]], axis=1) if len(lamps) else None,
    )


def _area_lights(scene: Scene, surfaces: FlatSurfaces, index: int) -> tuple[_Rows, NDArray[np.float64]]:
    """Rows of the primitives of one emissive shape, still black, and their areas in square metres."""
    shape = scene.shapes[index]
    first, count = int(surfaces.first[index]), int(surfaces.count[index])
    rows = np.zeros(count, dtype=layout.dtype("Light"))
    rows["primitive"] = np.arange(first, first + count)
    if isinstance(shape, Sphere | Disk):
        radius = float(surfaces.analytic_shapes[first - len(surfaces.triangles)]["center_radius"][3])
        rows["kind"] = layout.LIGHT_AREA_SPHERE if isinstance(shape, Sphere) else layout.LIGHT_AREA_DISK
        return rows, np.array([(4.0 if isinstance(shape, Sphere) else 1.0) * math.pi * radius * radius])
    rows["kind"] = layout.LIGHT_AREA_TRIANGLE
    return rows, triangle_areas(surfaces.vertices, surfaces.triangles[first : first + count])


def _means(scene: Scene, surfaces: FlatSurfaces, textures: FlatTextures, number: int) -> dict[int, NDArray[np.float64]]:
    """Mean radiance of the primitives of each shape with this emission texture, (n, 3) or (3,).

    Computed for all shapes at once: one at a time, it would dominate the time to load ten thousand shapes.
    """
    texture = EmissionMeans(textures, number)
    found: dict[int, NDArray[np.float64]] = {}
    indices = [index for index, other in textures.emission.items() if other == number]
    for kind, mean in ((Sphere, texture.sphere), (Disk, texture.disk)):
        some = [index for index in indices if isinstance(scene.shapes[index], kind)]
        if some:
            found |= dict.fromkeys(some, mean())
    flat = [index for index in indices if index not in found]
    if flat:
        counts = surfaces.count[flat].astype(np.int64)
        spans = [np.arange(first, first + n) for first, n in zip(surfaces.first[flat].tolist(), counts, strict=True)]
        at = 6 * texture.uv_set
        corners = surfaces.attributes[np.concatenate(spans), at : at + 6].reshape(-1, 3, 2)
        found |= dict(zip(flat, np.split(texture.triangles(corners), np.cumsum(counts)[:-1]), strict=True))
    return found


def _texture_luminance(scene: Scene, emission: Emission, texture: EmissionMeans) -> float:
    """Mean luminance of an emission texture."""
    mean, least, most = texture.whole()
    where = f"{scene.source}: {place(emission.place)}"
    if least < 0.0:
        raise SceneError(
            f"{where}: the picture holds {least:g}, but radiance is at least 0; export it without negatives"
        )
    if most > POWER_LIMIT:
        raise SceneError(
            f"{where}: makes a radiance of {most:g}; at most {POWER_LIMIT:g} is known; make its scale smaller"
        )
    return _luminance((float(mean[0]), float(mean[1]), float(mean[2])))


def _luminance(color: Color) -> float:
    """Rec. 709 luminance of a colour in single precision, as the kernels read it."""
    return float(_luminances(np.array([color], np.float32))[0])


def _luminances(colors: NDArray[np.float32]) -> NDArray[np.float64]:
    """Like `_luminance`, for an array (n, 3 or more)."""
    r, g, b = (colors[:, channel].astype(np.float64) for channel in range(3))
    return np.asarray((0.2126 * r + 0.7152 * g) + 0.0722 * b)


def _bounding_radius(surfaces: FlatSurfaces, instances: FlatInstances) -> float:
    """Radius of the scene's bounding sphere, metres; 1 for a scene without shapes."""
    vertices = surfaces.vertices[: instances.own_vertices]
    spheres = surfaces.analytic_shapes["center_radius"][: instances.own_analytic]
    low, high = box_of(vertices, spheres, instances.boxes)
    if not np.isfinite(low).all():
        return 1.0
    x, y, z = ((high - low) / 2.0).tolist()
    return max(length((x, y, z)), 1e-15)
