"""Turns a scene into the contiguous arrays that the kernels read, one array per kernel argument."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import UsageError
from clrender.flatten.assembly import assemble
from clrender.flatten.camera_row import camera_row, other_shape, surrounded
from clrender.flatten.features import Features
from clrender.flatten.grids import flat_grids
from clrender.flatten.holes import hole_rows
from clrender.flatten.instances import FlatInstances, flat_instances
from clrender.flatten.interiors import media_with_lights, open_media
from clrender.flatten.lamps import lamp_tables
from clrender.flatten.lights import FlatLights, flat_environment, flat_lights
from clrender.flatten.material_rows import flat_materials
from clrender.flatten.measured import flat_measured
from clrender.flatten.media import Media, Solid, scene_media, solid_of
from clrender.flatten.microfacets import albedo_tables
from clrender.flatten.motion import camera_knots, knot_rows
from clrender.flatten.plugin_lights import Emitted
from clrender.flatten.plugin_rows import used_plugins
from clrender.flatten.spectral import SpectralPlace, disperses
from clrender.flatten.surfaces import flat_surfaces
from clrender.flatten.texture_rows import FlatTextures, flat_textures
from clrender.flatten.thin_films import thin_film_rows
from clrender.flatten.touching import KnownMoves
from clrender.scene.description import (
    Camera,
    DirectionalLight,
    EnvironmentLight,
    IesLight,
    PluginLight,
    PointLight,
    ProjectorLight,
    Scene,
    SpotLight,
    SunSkyLight,
)
from clrender.scene.materials import Conductor, Dielectric, Material, Mirror, Subsurface
from clrender.scene.medium import Density
from clrender.scene.time_reversal import reversed_about
from clrender.scene.values import Vector, length

__all__ = ["FlatScene", "flatten", "moving_from", "scene_origin", "seen_by", "view_of"]

_Rows: TypeAlias = NDArray[np.void]
_WHITE: Final = 0.9999
"""Albedo from which on a medium counts as one that absorbs nothing."""

_OF_GRIDS: Final = ("grid_rows", "grid_words")
"""Arrays that do not count in scenes without grids, whose hashes are older than these; and likewise:"""
_OF_MEASURED: Final = ("measured_rows", "measured_words")
_RARE: Final = ("curve_rows", "thin_film_rows")


@dataclass(frozen=True)
class FlatScene:
    """A scene as arrays for the kernels. No array is empty: the counts say how many rows are valid.

    Attributes
    ----------
    arrays : mapping of str to ndarray
        ``vertices`` (V, 3) float32, world space, metres; ``normals`` (V, 3) float32, unit or zero where the shape is
        not smooth, or (1, 3) zeros when none is; ``triangles`` (T, 3) uint32; ``analytic_shapes`` (R,) `AnalyticShape`;
        ``curve_rows`` (R, 16) float32, of the curves among these, one row if there are none;
        ``primitive_shape`` (T + R,) uint32, triangles first; ``shapes`` (S,) `Shape`; ``materials`` (M,) `Material`;
        ``material_rows`` (2 M, 16) float32, and ``albedo_tables`` (N,) float32, one zero where no material has rows;
        ``media_rows`` (N, 16) float32, zero if paths need not track the media that they are inside;
        ``grid_rows`` and ``grid_words``: see `clrender.flatten.grids.flat_grids`;
        ``measured_rows`` and ``measured_words``: see `clrender.flatten.measured.MeasuredArrays`; ``thin_film_rows``:
        see `clrender.flatten.thin_films.thin_film_rows`;
        ``attribute_rows`` (T + R, 16) float32, or one row where no shape is textured; ``texture_rows``,
        ``texture_slots``, ``texel_values`` and ``texels``: see `clrender.flatten.texture_rows.FlatTextures`;
        ``hole_rows`` (N, 64) uint32, see `clrender.flatten.holes`, one row if no opacity is textured; ``lights`` (L,)
        `Light`, see `clrender.flatten.lights.FlatLights`; ``light_nodes`` (N, 16) float32 and ``light_order`` (N,)
        uint32, the light BVH, and ``light_cones`` (N, 8) float32 if there are lamps, else one row; ``lamp_tables`` (N,)
        float32, of IES files, or one zero; ``environment_map`` (N,) float32, one zero if the environment has no image;
        ``instance_rows``, ``instance_guides``, ``motion_rows`` and ``instance_motions``: see `instances`. Shapes are in
        the order of `clrender.flatten.assembly`: those of groups come last, in the space of their group. Little-endian,
        C-contiguous.
    camera : (1,) `Camera`
        All camera parameters; nothing else but `origin` and `camera_knots` depends on the camera, and where something
        moves on its interval.
    camera_knots : (K, 16) float32
        Knots of its motion; one row of zeros if it rests.
    environment : int
        Index of the environment light, or `layout.NONE`.
    triangle_count, analytic_count : int
    light_count : int
        Number of lights that light sampling chooses from.
    light_levels : int
        Levels of the light BVH; 0: there is none.
    features : Features
        What kernels are compiled for.
    instances : FlatInstances
        Instances of groups of shapes; their primitives are numbered from ``triangle_count + analytic_count`` on.
    arrays_sha256 : str
        Hash of all of the above except the camera.
    notes : tuple of str
        One sentence for each thing that reading the scene file left out or changed.
    warnings : tuple of str
        One sentence for each shape left out or changed, and for the whole scene.
    lost_light : str
        Which light only some integrators find, or over mirrors and through glass only one; empty if all find it.
    lost_in_fog : bool
        Whether a warning says that fog keeps out the light of a light.
    origin : (3,) float
        World space, metres: the origin of all coordinates in the arrays and the camera. `scene_origin` chooses it. It
        changes only when the camera moves far; until then the arrays stay the same.
    light_groups : tuple of str
        Of each row of ``lights``, its light group; empty for none.
    camera_free : float
        Up to this `clrender.flatten.touching.camera_reach` the arrays do not depend on it.
    spectral : tuple of SpectralPlace
        Numbers of the arrays that are spectra where wavelengths are rendered.
    film : (95, 4) float64 or None
        What the camera sees of wavelengths, if not what the film does: `clrender.spectra.film.sensor_table`.
    """

    arrays: Mapping[str, NDArray[Any]]
    camera: _Rows
    camera_knots: NDArray[np.float32]
    environment: int
    triangle_count: int
    analytic_count: int
    light_count: int
    light_levels: int
    features: Features
    instances: FlatInstances
    arrays_sha256: str
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    lost_light: str = ""
    lost_in_fog: bool = False
    origin: Vector = (0.0, 0.0, 0.0)
    light_groups: tuple[str, ...] = ()
    camera_free: float = math.inf
    spectral: tuple[SpectralPlace, ...] = ()
    film: NDArray[np.float64] | None = None

    @property
    def sha256(self) -> str:
        """Hash of all scene data that the kernels read, including the camera."""
        film = b"" if self.film is None else self.film.tobytes()
        return hashlib.sha256(
            self.arrays_sha256.encode() + self.camera.tobytes() + self.camera_knots.tobytes() + film
        ).hexdigest()

    @property
    def messages(self) -> list[str]:
        """All notes and warnings, each as the line that users see, whatever the integrator."""
        return self.messages_with(self._lost_by_most)

    def lost_by(self, integrator: str, specular_chains: bool) -> str:
        """What is to be said of light that an integrator does not find; empty: nothing.

        Parameters
        ----------
        integrator : str
        specular_chains : bool
            Whether it solves for chains of mirrors and glass.
        """
        if not self.lost_light or integrator == "photon" or specular_chains:
            return ""
        if integrator == "bdpt":
            return (
                f"{self.lost_light}: the integrator bdpt finds it on what the camera sees directly; what is seen in "
                "mirrors or through glass lacks it without specular_chains on, or the integrator photon"
            )
        return self._lost_by_most

    def messages_with(self, lost: str) -> list[str]:
        """All notes and warnings, each as the line that users see, with this one of light that is not found."""
        warnings = [*self.warnings, lost] if lost else self.warnings
        return [f"note: {each}" for each in self.notes] + [f"warning: {each}" for each in warnings]

    @property
    def _lost_by_most(self) -> str:
        return self.lost_light and (
            f"{self.lost_light}: only the integrators bdpt and photon find it, and path with specular_chains on, whose "
            "variance there has no bound at the edges of caustics; elsewhere it is missing"
        )

    @property
    def moves(self) -> bool:
        """Whether anything but the camera moves while the shutter is open."""
        return self.instances.moves or self.features.moving_lights

    @property
    def primitive_total(self) -> int:
        """Number of triangles, spheres and disks that rays may hit, counted for every instance."""
        return self.instances.own_triangles + self.instances.own_analytic + self.instances.primitive_count

    @property
    def curve_count(self) -> int:
        """Number of curves among `analytic_shapes`; a strand is one or more."""
        facing: NDArray[np.float32] = self.arrays["analytic_shapes"]["normal"][:, 3]
        return int(np.count_nonzero(facing >= layout.ANALYTIC_SHAPE_CURVE))

    @property
    def deforming_shapes(self) -> NDArray[np.bool_]:
        """(S,) whether each shape changes its form."""
        found = np.zeros(len(self.arrays["shapes"]), bool)
        for group in self.instances.poses:
            first = self.instances.groups[group].first_triangle
            found[self.arrays["primitive_shape"][first]] = True
        return found

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays together, without the BVH that is built on the device."""
        return sum(array.nbytes for array in self.arrays.values()) + self.camera.nbytes


def scene_origin(camera: Camera) -> Vector:
    """The origin of coordinates on the device: near the camera, so that single precision resolves the visible scene.

    It is the point nearest to the camera of a cubic grid whose spacing is 64 to 1024 times the distance from the camera
    to its target. So it is the world origin for a camera near it, and most camera moves do not change it.

    Returns
    -------
    (3,) float
        World space, metres.
    """
    camera = camera.opened
    _, exponent = math.frexp(64.0 * length(_difference(camera.target, camera.position)))
    side = math.ldexp(1.0, -(-exponent // 4) * 4)
    x, y, z = (round(p / side) * side for p in camera.position)
    return (x, y, z)


def flatten(
    scene: Scene,
    width: int,
    height: int,
    light_sampler: str = "auto",
    origin: Vector | None = None,
    compensated: bool = False,
    known: KnownMoves | None = None,
    emitted: Mapping[int, Emitted] | None = None,
) -> FlatScene:
    """Convert a scene to arrays, for an image of `width` by `height` pixels.

    Parameters
    ----------
    scene : Scene
    width, height : int
        Pixels.
    light_sampler : str
        A light sampler of `clrender.settings`.
    origin : (3,) float, optional
        World space, metres: origin of the coordinates on the device; default: `scene_origin`.
    compensated : bool
        MIS compensation: light sampling of the environment leaves the parts darker than its mean to BSDF sampling; see
        `clrender.flatten.environment.environment_table`.
    known : KnownMoves, optional
        What touched in the scene before, which is not looked for again if shapes are where they were.
    emitted : mapping of int to Emitted, optional
        What lights of plugins give, by their index: `clrender.flatten.plugin_lights.measured_lights`, which needs a
        device. Light sampling alone depends on it; default: as if their formulas were 1.

    Raises
    ------
    SceneError
        If a shape is degenerate or too large or small for single precision, or a mesh file cannot be read.
    UsageError
        If width or height is not positive.
    """
    if width < 1 or height < 1:
        raise UsageError(f"an image of {width}x{height} pixels cannot be rendered; give positive numbers")
    origin = scene_origin(scene.camera) if origin is None else origin
    scene, camera, knots = _seen(scene, width, height, origin)
    assembly = assemble(scene)
    scene = assembly.scene
    surfaces = flat_surfaces(scene, origin, assembly.own_shapes, assembly, known=known)
    instances = flat_instances(assembly, surfaces)
    media = scene_media(scene)
    around = flat_environment(scene, compensated)
    textures = flat_textures(scene)
    holes = hole_rows(scene, surfaces, textures)
    lamps = lamp_tables(scene, emitted)
    lights = flat_lights(scene, surfaces, instances, textures, around, lamps, light_sampler)
    tree = lights.tree
    triangle_count, analytic_count = len(surfaces.triangles), len(surfaces.analytic_shapes)
    measured = flat_measured(scene)
    materials = flat_materials(scene, media.of_solid, measured)
    grid_rows, grid_words = flat_grids(scene, media.grids, origin)
    arrays = {
        "vertices": _padded(surfaces.vertices),
        "normals": _padded(surfaces.normals),
        "triangles": _padded(surfaces.triangles),
        "analytic_shapes": _padded(surfaces.analytic_shapes),
        "curve_rows": surfaces.curve_rows,
        "primitive_shape": _padded(surfaces.primitive_shape),
        "shapes": _padded(surfaces.shapes),
        "materials": _padded(materials.materials),
        "material_rows": materials.rows,
        "albedo_tables": albedo_tables(materials.beckmann, materials.turned_glass)
        if materials.by_row
        else np.zeros(1, np.float32),
        "media_rows": media.rows,
        "grid_rows": grid_rows,
        "grid_words": grid_words,
        "measured_rows": measured.rows,
        "measured_words": measured.words,
        "thin_film_rows": thin_film_rows(scene, textures.films),
        "attribute_rows": _padded(surfaces.attributes),
        "texture_rows": textures.rows,
        "texture_slots": textures.slots,
        "texel_values": textures.values,
        "hole_rows": holes,
        "texels": textures.texels,
        "lights": _padded(lights.rows),
        "light_nodes": tree.rows if tree else np.zeros((1, 16), np.float32),
        "light_order": tree.order if tree else np.zeros(1, np.uint32),
        "light_cones": np.zeros((1, 8), np.float32) if tree is None or tree.cones is None else tree.cones,
        "lamp_tables": lamps.words,
        "environment_map": around.words,
        "instance_rows": instances.rows,
        "instance_guides": instances.guides,
        "instance_motions": instances.motion_places,
        "motion_rows": lights.with_knots(instances.motion_rows),
    }
    moves = instances.moves or len(lights.knots) > 0
    if media.subsurface and not moves:  # lights may come to be inside
        _darken(arrays, triangle_count, lights.count, instances)
    in_fog = _lost_in_fog(scene)
    unbounded = _mark_open(arrays, triangle_count, media) if media.scatters else []
    around_lights = (scene.environment, scene.sky)
    hidden = any(light is not None and not light.visible_to_camera for light in around_lights)
    hidden = hidden or scene.has_shadow_catchers
    spectral = (*materials.spectral, *media.spectral, *lights.spectral)
    plugins = used_plugins(scene)
    digest = hashlib.sha256(f"{lights.environment} {triangle_count} {analytic_count} {lights.count}".encode())
    left_out = (*(() if media.grids else _OF_GRIDS), *(() if measured.head_of else _OF_MEASURED))
    _add_arrays(digest, scene, {name: arrays[name] for name in arrays if name not in left_out}, media, textures)
    if hidden:
        digest.update(b"hidden environment")
    for place in spectral:
        digest.update(f"spectrum {place.array} {place.rows} {place.column}".encode() + place.values.tobytes())
    for each in plugins:
        digest.update(f"plugin {each.name} {each.sha256}".encode())
    camera = surrounded(camera, arrays, triangle_count, instances, scene.camera, origin, (width, height))
    return FlatScene(
        arrays=arrays,
        camera=camera,
        camera_knots=knots,
        environment=lights.environment,
        triangle_count=triangle_count,
        analytic_count=analytic_count,
        light_count=lights.count,
        light_levels=tree.levels if tree else 0,
        features=dataclasses.replace(
            Features.of(arrays, camera, media, instances, hidden, plugins), dispersion=disperses(spectral)
        ),
        instances=instances,
        arrays_sha256=digest.hexdigest(),
        notes=scene.notes,
        warnings=(
            *surfaces.warnings,
            *other_shape(scene, width, height),
            *(() if media.glows else _no_light(scene, lights)),
            *in_fog,
            *_endless(scene, arrays, media, unbounded),
        ),
        lost_light=_lost_light(scene, media.no_boundary),
        lost_in_fog=bool(in_fog),
        origin=origin,
        light_groups=lights.groups,
        film=scene.camera.film,
        camera_free=surfaces.camera_free,
        spectral=spectral,
    )


def _add_arrays(
    digest: hashlib._Hash, scene: Scene, arrays: Mapping[str, NDArray[Any]], media: Media, textures: FlatTextures
) -> None:
    """Add arrays to a hash; what is large and has a hash already counts by that."""
    for name, array in arrays.items():
        if name in _RARE and not array.any():
            continue
        digest.update(f"{name} {array.shape}".encode())
        if name == "texels":
            digest.update(textures.sha256.encode())
        elif name == "grid_words":
            for medium, grids in media.grids:
                for key, grid in grids.given():
                    more = grid.edges if isinstance(grid, Density) else key
                    digest.update(f"{scene.grid(medium, key, grid).sha256()} {more}".encode())
        elif name == "measured_words":
            for material, its in scene.measured_materials():
                digest.update(scene.measured(material, its).sha256().encode())
        else:
            digest.update(array.reshape(-1).view(np.uint8).data)


def seen_by(flat: FlatScene, scene: Scene, width: int, height: int) -> FlatScene:
    """The same arrays with the camera of `scene`; all other parts of the scene must be the same.

    The camera's `scene_origin` must be that of the arrays, and so must its `camera_reach`, unless
    both are at most `camera_free`.

    Raises
    ------
    SceneError, UsageError
        See `flatten`.
    """
    row, knots = view_of(flat, scene, width, height)
    features = flat.features.seen_by(row, flat.moves)
    return dataclasses.replace(flat, camera=row, camera_knots=knots, features=features, film=scene.camera.film)


def view_of(flat: FlatScene, scene: Scene, width: int, height: int) -> tuple[_Rows, NDArray[np.float32]]:
    """The row of a scene's camera and the knots of its motion; see `seen_by`.

    Returns
    -------
    row : (1,) `Camera`
    knots : (n, words) float32
    """
    scene, camera, knots = _seen(scene, width, height, flat.origin)
    size = (width, height)
    return (
        surrounded(camera, flat.arrays, flat.triangle_count, flat.instances, scene.camera, flat.origin, size),
        knots,
    )


def moving_from(flat: FlatScene, scene: Scene, size: tuple[int, int]) -> FlatScene:
    """The scene for layers of what moves from the time of the image on, or back: all rays have that time.

    Parameters
    ----------
    flat : FlatScene
        The arrays of its image; they are used again, if they are the same.
    scene : Scene
    size : (int, int)
        Of the image, pixels.

    Raises
    ------
    SceneError, UsageError
        See `flatten`.
    """
    camera, step = scene.camera, scene.camera.flow_step
    if step is not None:
        if step < 0.0:
            scene, step = reversed_about(scene, camera.interval[0]), -step
            camera = scene.camera
        opening = {"time": camera.interval[0], "shutter": (0.0, step), "rolling_shutter": 0.0}
        camera = camera.with_checked(**opening)
        scene = scene.with_checked(camera=camera)
        moves = scene.has_motion
        flat = flatten(scene, *size, "uniform", flat.origin) if moves else seen_by(flat, scene, *size)
    rows = flat.camera.copy()
    rows["open"] = rows["readout"] = 0.0
    return dataclasses.replace(flat, camera=rows)


def _seen(scene: Scene, width: int, height: int, origin: Vector) -> tuple[Scene, _Rows, NDArray[np.float32]]:
    """The scene with its camera where it is when the shutter opens, the camera's row, and the knots of its motion."""
    motion = camera_knots(scene.camera, scene.source)
    scene = scene if scene.camera.opened is scene.camera else scene.with_checked(camera=scene.camera.opened)
    knots, places = knot_rows([] if motion is None else [motion], origin)
    row = camera_row(scene, width, height, origin)
    if motion is not None:
        row["segments"] = places[0, 1]
    return scene, row, knots


def _darken(
    arrays: Mapping[str, NDArray[Any]], triangle_count: int, light_count: int, instances: FlatInstances
) -> None:
    """Set the flag of subsurface media without lights inside, in which paths then take no light samples."""
    flags = arrays["media_rows"][:, 15].view(np.uint32)
    flags[(flags & layout.MEDIUM_FLAG_SUBSURFACE) != 0] |= np.uint32(layout.MEDIUM_FLAG_DARK)
    for medium in media_with_lights(arrays, triangle_count, light_count, instances):
        flags[medium] &= np.uint32(~layout.MEDIUM_FLAG_DARK & 0xFFFFFFFF)


def _mark_open(arrays: Mapping[str, NDArray[Any]], triangle_count: int, media: Media) -> list[int]:
    """Set the flag of media that have no end, and return those of shapes: there paths that get lost end early."""
    found = open_media(arrays, triangle_count)
    flags = arrays["media_rows"][:, 15].view(np.uint32)
    flags[[*found, *([0] if media.fog else [])]] |= np.uint32(layout.MEDIUM_FLAG_OPEN)
    return found


def _endless(scene: Scene, arrays: Mapping[str, NDArray[Any]], media: Media, unbounded: list[int]) -> list[str]:
    """Warn of media that absorb nothing and have a surface with a hole: cost and variance cannot both be finite."""
    rows = arrays["media_rows"].astype(np.float64)
    extinction, scattering = rows[unbounded, 5:8], rows[unbounded, 8:11]
    white: NDArray[np.bool_] = np.any((scattering > 0.0) & (scattering >= _WHITE * extinction), axis=1)
    grid = (
        arrays["media_rows"][unbounded, 15].view(np.uint32) & layout.MEDIUM_FLAG_GRID
    ) != 0  # which end with their boxes
    endless = set(np.array(unbounded, np.int64)[white & ~grid].tolist())
    names = sorted({solid[1] or solid[0] or "" for solid, number in media.of_solid.items() if number in endless})
    return [
        f"{scene.source}: {name}: light scatters in it without being absorbed, and its surface has a hole, so that the "
        "variance of the image has no bound; close the surface, or let it absorb a little"
        for name in names
    ]


def _no_light(scene: Scene, lights: FlatLights) -> list[str]:
    """Warn of a scene that emits no light at all."""
    if len(lights.rows):
        return []
    return [
        f"{scene.source}: nothing in it emits light, so its image is black; add `[[lights]]`, or `emission` to a shape"
    ]


def _lost_light(scene: Scene, no_boundary: frozenset[Solid]) -> str:
    """The light of delta lights over mirrors and through glass, which paths from the camera cannot find, if any."""
    used = {name for name, _ in {solid_of(shape) for _, shape in scene.all_shapes()} - no_boundary if name is not None}
    glass = {name for name in used if _is_glass(scene.materials[name])}
    mirrors = {name for name in used if _is_mirror(scene.materials[name])}
    kinds: dict[type, str] = {
        DirectionalLight: "directional",
        PointLight: "point",
        SpotLight: "spot",
        IesLight: "ies",
        ProjectorLight: "projector",
        PluginLight: "plugin",
    }
    shining = [name for kind, name in kinds.items() if any(isinstance(light, kind) for light in scene.lights)]
    if not (glass or mirrors) or not shining:
        return ""
    through = [f"through the dielectric {min(glass)!r}"] if glass else []
    over = [f"reflected by the mirror {min(mirrors)!r}"] if mirrors else []
    which = f"{' and '.join(shining)} lights, {' and '.join([*through, *over])}"
    return f"{scene.source}: light of {which}"


def _lost_in_fog(scene: Scene) -> list[str]:
    """Warn of light from infinity in fog, which extends as far."""
    if scene.fog is None or not all(a + s > 0.0 for a, s in zip(*scene.media[scene.fog].numbers[:2], strict=True)):
        return []
    endless = (DirectionalLight, EnvironmentLight, SunSkyLight)
    found = sorted({light.type for light in scene.lights if isinstance(light, endless)})
    if not found:
        return []
    text = f"the medium {scene.fog!r} extends to infinity, and no light of {' and '.join(found)} lights passes it"
    return [f"{scene.source}: fog: {text}; for haze below a sky, give a large box an `interior` instead"]


def _is_glass(material: Material) -> bool:
    """Whether the material refracts light, as far as this is known without the surrounding medium."""
    if isinstance(material, Subsurface):
        return material.ior is not None and not material.rough
    return isinstance(material, Dielectric) and material.ior != material.exterior_ior


def _is_mirror(material: Material) -> bool:
    """Whether the material reflects in one direction alone."""
    return isinstance(material, Mirror) or (isinstance(material, Conductor) and material.roughness == 0.0)


def _padded(array: NDArray[Any]) -> NDArray[Any]:
    """The array, or one row of zeros if it is empty: OpenCL has no empty buffers."""
    return np.ascontiguousarray(array) if len(array) else np.zeros((1, *array.shape[1:]), dtype=array.dtype)


def _difference(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
