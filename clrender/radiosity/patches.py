"""A scene divided into patches: small triangles of constant radiosity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.exact.matrices import inner
from clrender.flatten.assembly import written_out
from clrender.flatten.flat_scene import FlatScene, flatten, scene_origin
from clrender.flatten.lamps import AT_POINT
from clrender.flatten.supported import check_materials
from clrender.flatten.surfaces import flat_surfaces
from clrender.meshes.data import MeshData
from clrender.radiosity.tessellate import disk_triangles, sphere_triangles
from clrender.radiosity.textured import patch_coordinates, patch_reflectance, textured_shapes
from clrender.scene.description import EnvironmentLight, Lambert, Light, Scene
from clrender.scene.shapes import Disk, Sphere
from clrender.scene.values import Vector
from clrender.wording import counted, grouped

__all__ = ["Patches", "cut_into_patches"]

_SLACK: Final = 1.5
"""A patch may be larger than wanted by this factor."""
_ROUNDS: Final = 5
_LIGHTS_SHARE: Final = 0.25
"""If more than this fraction of all area emits, form factors estimate its light better than shadow rays."""
_CARRIED: Final = (
    "areas", "normals", "textured", "coordinates", "reflectance", "emission", "shadow_rays_find_emission",
)  # fmt: skip
"""Cached properties that stay valid when a shape moves."""
_ORIGIN: Final = (0.0, 0.0, 0.0)
"""Origin of scenes made of patches: their coordinates are already relative to `scene_origin`."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Patches:
    """The patches of a scene; their sides are numbered 2 i (front) and 2 i + 1 (back).

    Attributes
    ----------
    scene : Scene
        Scene of the shapes, in coordinates relative to its `scene_origin`.
    corners : (n, 3, 3) float64
        Relative to that origin, metres, counter-clockwise seen from the front; exact in float32 apart from bisection.
    shape : (n,) int64
        Shape index, ascending.
    primitive : (n,) int64
        Triangle, sphere or disk, as numbered by `clrender.flatten.surfaces`.
    """

    scene: Scene
    corners: _Floats
    shape: NDArray[np.int64]
    primitive: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.corners)

    @cached_property
    def areas(self) -> _Floats:
        """(n,) float64, square metres."""
        x, y, z = self._across
        areas: _Floats = np.sqrt((x * x + y * y) + z * z) / 2.0
        return areas

    @cached_property
    def normals(self) -> _Floats:
        """(n, 3) float64, unit, on the front side."""
        return np.stack(self._across, axis=1) / (2.0 * self.areas)[:, None]

    @cached_property
    def _across(self) -> tuple[_Floats, _Floats, _Floats]:
        a = self.corners[:, 0]
        (ux, uy, uz), (vx, vy, vz) = (self.corners[:, 1] - a).T, (self.corners[:, 2] - a).T
        return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx

    @cached_property
    def centers(self) -> _Floats:
        """(n, 3) float64."""
        centers: _Floats = ((self.corners[:, 0] + self.corners[:, 1]) + self.corners[:, 2]) / 3.0
        return centers

    @cached_property
    def boxes(self) -> tuple[_Floats, _Floats]:
        """Low and high corners of the bounding boxes of all shapes: (s, 3) float64 each."""
        a, b, c = (self.corners[:, k] for k in range(3))
        firsts = np.searchsorted(self.shape, np.arange(len(self.scene.shapes)))
        lows: _Floats = np.minimum.reduceat(np.minimum(np.minimum(a, b), c), firsts)
        highs: _Floats = np.maximum.reduceat(np.maximum(np.maximum(a, b), c), firsts)
        return lows, highs

    @cached_property
    def reflectance(self) -> _Floats:
        """(n, 3) float64, of both sides; for a texture the mean over the patch."""
        rows = [(0.0, 0.0, 0.0) if s.material is None else self._lambert(s.material) for s in self.scene.shapes]
        colors: _Floats = np.array(rows, np.float64).reshape(-1, 3)[self.shape]
        return (
            patch_reflectance(self.scene, self.shape, self.coordinates, colors, self.textured)
            if self.textured.any()
            else colors
        )

    def _lambert(self, name: str) -> tuple[float, float, float]:
        material = self.scene.materials[name]
        assert isinstance(material, Lambert)
        return material.reflectance if isinstance(material.reflectance, tuple) else (0.0, 0.0, 0.0)

    @cached_property
    def textured(self) -> NDArray[np.bool_]:
        """(n,) bool: patches whose reflectance is a texture."""
        return textured_shapes(self.scene)[self.shape]

    @cached_property
    def textured_sides(self) -> NDArray[np.bool_]:
        """(2 n + 1,) bool: their sides."""
        return np.append(np.repeat(self.textured, 2), False)

    @cached_property
    def coordinates(self) -> _Floats:
        """(2, n, 3, 2) float64: texture coordinates of the corners, both sets; zero without a texture."""
        return patch_coordinates(self.scene, self.corners, self.shape, self.primitive)

    @cached_property
    def emission(self) -> _Floats:
        """(n, 3) float64, radiance of the front, W/(sr m²)."""
        rows: _Floats = np.array([s.emission or (0.0, 0.0, 0.0) for s in self.scene.shapes], np.float64)
        return rows.reshape(-1, 3)[self.shape]

    @cached_property
    def environment(self) -> _Floats:
        """(3,) float64, radiance of the environment."""
        light = self.scene.environment
        return np.array(light.constant if light else (0.0, 0.0, 0.0), np.float64)

    @cached_property
    def shadow_rays_find_emission(self) -> bool:
        """Whether the light of emitting shapes is sampled by shadow rays; else form factors carry it."""
        shining = self.emission.any(axis=1)
        return bool(self.areas[shining].sum() < _LIGHTS_SHARE * self.areas.sum())

    def sides_of(self, shape: int) -> tuple[int, int]:
        """First side of a shape and the one after its last."""
        first, end = np.searchsorted(self.shape, [shape, shape + 1])
        return 2 * int(first), 2 * int(end)

    def flat(self, width: int, height: int, light_sampler: str = "auto") -> FlatScene:
        """The patches as kernels read them: triangle i is patch i, without the lights whose light form factors carry.

        Raises
        ------
        SceneError
            If a patch is too small for single precision.
        """
        scene = self.scene.remeshed(self._meshes(), self._lights, self.shadow_rays_find_emission)
        flat = flatten(scene, width, height, light_sampler, _ORIGIN)
        if flat.triangle_count != len(self):
            lost = len(self) - flat.triangle_count
            raise SceneError(
                f"{self.scene.source}: {grouped(lost)} of {counted(len(self), 'patch has', 'patches have')} no area "
                "in single precision; "
                "ask for fewer with --patches"
            )
        return flat

    def whole(self, width: int, height: int, light_sampler: str = "auto") -> FlatScene:
        """The scene before it was divided into patches, with the same lights as `flat`."""
        shapes = self.scene.shapes
        if not self.shadow_rays_find_emission:
            shapes = tuple(shape.with_checked(emission=None) for shape in shapes)
        scene = self.scene.with_checked(shapes=shapes, lights=self._lights)
        return flatten(scene, width, height, light_sampler, _ORIGIN)

    @property
    def _lights(self) -> tuple[Light, ...]:
        return tuple(light for light in self.scene.lights if not isinstance(light, EnvironmentLight))

    def _meshes(self) -> list[MeshData]:
        points = self.corners.reshape(-1, 3)
        meshes = [MeshData(points[corners], triangles) for corners, triangles in self._welded]
        for shape in np.flatnonzero(textured_shapes(self.scene)).tolist():
            first, end = (side // 2 for side in self.sides_of(shape))
            uvs = self.coordinates[:, first:end].astype(np.float32)
            meshes[shape] = replace(meshes[shape], uvs=uvs[0], uvs_1=uvs[1])
        return meshes

    @cached_property
    def _welded(self) -> list[tuple[NDArray[np.int64], NDArray[np.uint32]]]:
        """For each shape: an index of a corner for each of its vertices, and its triangles."""
        welded = []
        for shape in range(len(self.scene.shapes)):
            first, end = (side // 2 for side in self.sides_of(shape))
            points = self.corners[first:end].reshape(-1, 3)
            _, corner, vertex = np.unique(points, axis=0, return_index=True, return_inverse=True)
            welded.append((3 * first + corner, vertex.reshape(-1, 3).astype(np.uint32)))
        return welded

    def bisected(self, which: NDArray[np.bool_]) -> Patches:
        """Subdivide some patches at the middle of their longest edge; the halves have consecutive indices.

        Parameters
        ----------
        which : (n,) bool
        """
        edges = self.corners - np.roll(self.corners, -1, axis=1)
        squares = inner(edges, edges)
        longest = squares.argmax(axis=1)
        rows = np.arange(len(self))
        a, b, c = (self.corners[rows, (longest + k) % 3] for k in range(3))
        middle = (a + b) / 2.0
        both = np.stack([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)], axis=1)
        places = np.repeat(rows, np.where(which, 2, 1))
        second = np.diff(places, prepend=-1) == 0
        corners = np.where(which[places, None, None], both[places, second.astype(np.int64)], self.corners[places])
        finer = Patches(self.scene, corners, self.shape[places], self.primitive[places])
        if "reflectance" in self.__dict__ and self.textured.any():
            new = which[places] & finer.textured
            finer.__dict__["reflectance"] = patch_reflectance(
                finer.scene, finer.shape, finer.coordinates, self.reflectance[places], new
            )
        return finer

    def moved(self, shape: int, by: tuple[float, float, float]) -> Patches:
        """The patches with one shape moved, also in the scene's description.

        Parameters
        ----------
        shape : int
        by : three floats
            Metres.
        """
        first, end = (side // 2 for side in self.sides_of(shape))
        corners = self.corners.copy()
        corners[first:end] += np.array(by)
        shapes = list(self.scene.shapes)
        shapes[shape] = shapes[shape].with_checked(transform=shapes[shape].transform.moved(by))
        scene = self.scene.with_checked(shapes=tuple(shapes))
        return self._again(replace(self, scene=scene, corners=corners), *_CARRIED)

    def _again(self, other: Patches, *same: str) -> Patches:
        """Other patches that keep the cached properties of these."""
        for name in ("_welded", *same):
            other.__dict__[name] = getattr(self, name)
        return other


def cut_into_patches(scene: Scene, count: int) -> Patches:
    """Divide the surfaces of a scene into about `count` patches of about equal area.

    Parameters
    ----------
    scene : Scene
        Must have only diffuse surfaces.
    count : int
        Desired number; shapes that need more for their form get them.

    Raises
    ------
    SceneError
        If a shape is not diffuse, or the scene is empty.
    """
    scene = written_out(scene)
    check_materials(scene, "radiosity")
    scene = _relative(scene)
    whole, is_round = _coarse(scene, np.inf)
    if not len(whole):
        raise SceneError(f"{scene.source}: has no shapes, and radiosity needs surfaces; use --integrator path")
    total, size = float(whole.areas.sum()), float(whole.areas.sum()) / count
    best: Patches | None = None
    for _ in range(_ROUNDS):
        patches, is_round = _coarse(scene, size)
        while True:
            large = (patches.areas > _SLACK * size) & ~is_round[patches.shape]
            if not large.any() or len(patches) > 4 * count:
                break
            patches = patches.bisected(large)
        if best is None or abs(len(patches) - count) < abs(len(best) - count):
            best = patches
        size = min(max(size * len(patches) / count, total / count / 16.0), total / count * 16.0)
    assert best is not None
    return best


def _relative(scene: Scene) -> Scene:
    """The scene in coordinates relative to its `scene_origin`, where single precision suffices."""
    origin = scene_origin(scene.camera)
    if origin == _ORIGIN:
        return scene
    x, y, z = origin

    def moved(place: Vector) -> Vector:
        return (place[0] - x, place[1] - y, place[2] - z)

    camera = {name: moved(getattr(scene.camera, name)) for name in ("position", "target")}
    lights = (
        light.with_checked(position=moved(light.position)) if isinstance(light, AT_POINT) else light
        for light in scene.lights
    )
    shapes = (shape.with_checked(transform=shape.transform.moved((-x, -y, -z))) for shape in scene.shapes)
    parts = {"camera": scene.camera.with_checked(**camera), "lights": tuple(lights), "shapes": tuple(shapes)}
    return scene.with_checked(**parts)


def _coarse(scene: Scene, size: float) -> tuple[Patches, NDArray[np.bool_]]:
    """The scene's triangles, and spheres and disks as triangles of about `size`; which shapes are spheres."""
    surfaces = flat_surfaces(scene)
    corners = surfaces.vertices[surfaces.triangles].astype(np.float64)
    parts: list[_Floats] = []
    primitive: list[NDArray[np.int64]] = []
    is_round = np.zeros(len(scene.shapes), bool)
    for index, shape in enumerate(scene.shapes):
        first, count = int(surfaces.first[index]), int(surfaces.count[index])
        if not isinstance(shape, Sphere | Disk):
            parts.append(corners[first : first + count])
            primitive.append(np.arange(first, first + count))
            continue
        row = surfaces.analytic_shapes[first - len(corners)]
        center, normal = row["center_radius"].astype(np.float64), row["normal"].astype(np.float64)
        if isinstance(shape, Sphere):
            is_round[index] = True
            part = sphere_triangles(center[:3], float(center[3]), bool(normal[3] < 0.0), size)
        else:
            part = disk_triangles(center[:3], float(center[3]), normal[:3], size)
        parts.append(part.astype(np.float32).astype(np.float64))
        primitive.append(np.full(len(part), first))
    lengths = [len(part) for part in parts]
    every = np.concatenate(parts) if parts else np.zeros((0, 3, 3))
    of = np.concatenate(primitive) if primitive else np.zeros(0, np.int64)
    return Patches(scene, every, np.repeat(np.arange(len(parts)), lengths), of), is_round
