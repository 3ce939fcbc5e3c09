"""What the kernel tests share: flat scenes made from arrays, rays, and the traversals run on a device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.device.bvh import SOURCE_NAMES, STACK, Bvh, SourceArrays, build
from clrender.flatten.features import Features
from clrender.flatten.flat_scene import FlatScene
from clrender.flatten.instances import FlatInstances

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.device import Buffer

__all__ = [
    "FOLDER",
    "Hits",
    "Rays",
    "Tree",
    "analytic_rows",
    "flat_scene",
    "trace",
    "trace_by_reference",
    "trace_every_leaf",
    "tree_on",
]

FOLDER = Path(__file__).resolve().parent
WORK_GROUP = 16
FAR = np.float32(3.0e38)

Floats = npt.NDArray[np.float32]
Uints = npt.NDArray[np.uint32]


@dataclass(frozen=True)
class Rays:
    """Rays in single precision.

    Attributes
    ----------
    origins, directions : (n, 3) float32
    limits : (n,) float32
        Below zero: the ray is not traced.
    starts, ends : (n,) uint32
        The primitive each leaves and the one it is aimed at, or `layout.NONE`.
    """

    origins: Floats
    directions: Floats
    limits: Floats
    starts: Uints
    ends: Uints

    @classmethod
    def of(cls, origins: npt.ArrayLike, directions: npt.ArrayLike, limits: npt.ArrayLike = FAR) -> Rays:
        """Rays that leave nothing and are aimed at nothing; the arguments are broadcast and rounded."""
        o, d = np.broadcast_arrays(np.asarray(origins, np.float32), np.asarray(directions, np.float32))
        none = np.full(len(o), layout.NONE, np.uint32)
        limit = np.broadcast_to(np.asarray(limits, np.float32), len(o))
        return cls(np.ascontiguousarray(o), np.ascontiguousarray(d), np.ascontiguousarray(limit), none, none)

    def __len__(self) -> int:
        return len(self.origins)


@dataclass(frozen=True)
class Hits:
    """What was found.

    Attributes
    ----------
    distances : (n,) float32
        In multiples of the direction; the limit where nothing was hit.
    primitives : (n,) uint32
    occluded : (n,) bool
        Whether anything but `Rays.ends` is in the way.
    """

    distances: Floats
    primitives: Uints
    occluded: npt.NDArray[np.bool_]


def analytic_rows(
    centers: npt.ArrayLike, radii: npt.ArrayLike, normals: npt.ArrayLike = (0.0, 0.0, 0.0)
) -> npt.NDArray[np.void]:
    """Rows of spheres, or with unit normals of disks."""
    places = np.atleast_2d(np.asarray(centers, np.float64))
    rows = np.zeros(len(places), layout.dtype("AnalyticShape"))
    rows["center_radius"][:, :3] = places
    rows["center_radius"][:, 3] = radii
    rows["normal"][:, :3] = normals
    rows["normal"][:, 3] = np.where(np.any(rows["normal"][:, :3] != 0, axis=1), 0.0, 1.0)
    return rows


def flat_scene(
    vertices: npt.ArrayLike = (), triangles: npt.ArrayLike = (), analytic_shapes: npt.NDArray[np.void] | None = None
) -> FlatScene:
    """A scene of one shape for the triangles and one for all spheres and disks, in exactly these numbers.

    Unlike one that comes from a file it may hold degenerate triangles, or nothing at all.

    Parameters
    ----------
    vertices : (v, 3) float
    triangles : (t, 3) int
    analytic_shapes : (r,) `AnalyticShape`, optional
    """
    analytic_shapes = np.zeros(0, layout.dtype("AnalyticShape")) if analytic_shapes is None else analytic_shapes
    points = np.asarray(vertices, np.float32).reshape(-1, 3)
    corners = np.asarray(triangles, np.uint32).reshape(-1, 3)
    shapes = np.zeros(2, layout.dtype("Shape"))
    shapes["first_primitive"] = 0, len(corners)
    shapes["first_light"] = layout.NONE
    arrays: Mapping[str, npt.NDArray[Any]] = {
        "vertices": points,
        "normals": np.zeros((1, 3), np.float32),
        "triangles": corners,
        "analytic_shapes": analytic_shapes,
        "primitive_shape": np.repeat(np.array([0, 1], np.uint32), [len(corners), len(analytic_shapes)]),
        "shapes": shapes,
        "materials": np.zeros(1, layout.dtype("Material")),
        "lights": np.zeros(1, layout.dtype("Light")),
        "light_nodes": np.zeros((1, 16), np.float32),
        "material_rows": np.zeros((1, 16), np.float32),
        "albedo_tables": np.zeros(1, np.float32),
        "media_rows": np.zeros((1, 16), np.float32),
        "curve_rows": np.zeros((1, 16), np.float32),
        "grid_rows": np.zeros((1, 16), np.float32),
        "grid_words": np.zeros(1, np.float32),
        "measured_rows": np.zeros((1, 16), np.float32),
        "measured_words": np.zeros(1, np.float32),
        "thin_film_rows": np.zeros((1, 8), np.float32),
        "hole_rows": np.zeros((1, 64), np.uint32),
        "attribute_rows": np.zeros((1, 16), np.float32),
        "texture_rows": np.zeros((1, 16), np.float32),
        "texture_slots": np.zeros((1, 16), np.float32),
        "texel_values": np.zeros(1, np.float32),
        "texels": np.zeros((1, 64), np.uint8),
        "light_order": np.zeros(1, np.uint32),
        "light_cones": np.zeros((1, 8), np.float32),
        "lamp_tables": np.zeros(1, np.float32),
        "environment_map": np.zeros(1, np.float32),
        "instance_rows": np.zeros((2, 16), np.float32),
        "instance_guides": np.array([layout.NONE, 0, 0, 0], np.uint32),
        "instance_motions": np.zeros((1, 2), np.uint32),
        "motion_rows": np.zeros((1, 16), np.float32),
    }
    padded = {k: np.ascontiguousarray(a) if len(a) else np.zeros((1, *a.shape[1:]), a.dtype) for k, a in arrays.items()}
    camera = np.zeros(1, layout.dtype("Camera"))
    count = len(corners), len(analytic_shapes)
    return FlatScene(
        arrays=padded,
        camera=camera,
        camera_knots=np.zeros((1, 16), np.float32),
        environment=layout.NONE,
        triangle_count=count[0],
        analytic_count=count[1],
        light_count=0,
        light_levels=0,
        features=Features(),
        instances=FlatInstances.none(*count, len(points), np.arange(2)),
        arrays_sha256="",
    )


@dataclass(frozen=True)
class Tree:
    """A tree on a device, and what the traversals need to know of it."""

    device: Device
    bvh: Bvh
    curve_rows: Buffer
    defines: Mapping[str, int]

    @property
    def buffers(self) -> list[Buffer]:
        return [self.bvh.nodes, self.bvh.triangle_packs, self.bvh.analytic_packs]


@contextmanager
def tree_on(device: Device, scene: FlatScene) -> Iterator[Tree]:
    """Build a scene's tree, and give its memory back at the end."""
    arrays = {name: device.upload(scene.arrays[name]) for name in SOURCE_NAMES}
    source = SourceArrays.of(arrays, scene.triangle_count, scene.analytic_count)
    bvh = build(device, source)
    try:
        yield Tree(device, bvh, arrays["curve_rows"], {"CURVES": 1} if scene.features.curves else {})
    finally:
        for buffer in (*arrays.values(), bvh.nodes, bvh.triangle_packs, bvh.analytic_packs):
            device.release(buffer)


def trace(tree: Tree, rays: Rays, lanes: int = 16, single: bool = False, parts: int | None = None) -> Hits:
    """Nearest hit and any hit of every ray, as the integrators ask for them.

    Parameters
    ----------
    tree : Tree
    rays : Rays
    lanes : int
    single : bool
        Each ray alone from the root on.
    parts : int, optional
        With so few lanes left, rays of a packet part; the kernels' own number when absent.
    """
    defines: dict[str, int | str] = {"LANES": lanes}
    if single:
        defines["TRAVERSAL_SINGLE"] = 1
    if parts is not None:
        defines["PACKET_PARTS"] = parts
    if tree.bvh.stack_entries > STACK:
        defines["BVH_STACK"] = tree.bvh.stack_entries
    return _launch(tree, rays, "trace", defines, [])


def trace_by_reference(tree: Tree, rays: Rays) -> Hits:
    """Nearest hit and any hit by the reference, `bvh_reference` of ``trace.cl``."""
    return _launch(tree, rays, "trace_by_reference", {"LANES": 1}, [])


def finds_what_leaves_hold(tree: Tree, rays: Rays) -> bool:
    """Whether both traversals give the nearest hits by their definition, to the bit."""
    every = trace_every_leaf(tree, rays)
    found = [trace(tree, rays, lanes, single) for lanes, single in ((16, False), (1, True))]
    return all(
        np.array_equal(hits.primitives, every.primitives) and np.array_equal(hits.distances, every.distances)
        for hits in found
    )


def trace_every_leaf(tree: Tree, rays: Rays) -> Hits:
    """The nearest hits by their definition: every leaf that the ray enters is looked into. No word of occlusion."""
    return _launch(tree, rays, "trace_every_leaf", {"LANES": 1}, [np.uint32(tree.bvh.node_count)])


def _launch(tree: Tree, rays: Rays, kernel: str, defines: Mapping[str, int | str], extra: list[np.generic]) -> Hits:
    device, lanes = tree.device, int(defines["LANES"])
    count = -(-max(len(rays), 1) // 16) * 16
    numbers = np.full((7, count), -1.0, np.float32)
    numbers[:3, : len(rays)] = rays.origins.T
    numbers[3:6, : len(rays)] = rays.directions.T
    numbers[6, : len(rays)] = rays.limits
    ends = np.full((2, count), layout.NONE, np.uint32)
    ends[0, : len(rays)], ends[1, : len(rays)] = rays.starts, rays.ends
    buffers = [device.upload(numbers), device.upload(ends), device.empty(4 * count), device.empty(8 * count)]
    program = device.program(FOLDER / "trace.cl", {**defines, **tree.defines})
    size = -(-count // lanes // WORK_GROUP) * WORK_GROUP
    arguments: list[Any] = [*tree.buffers, tree.curve_rows, *extra, *buffers[:2], np.uint32(count), *buffers[2:]]
    device.launch(program, kernel, size, WORK_GROUP, arguments)
    distances, hits = np.empty(count, np.float32), np.zeros((2, count), np.uint32)
    device.read(buffers[2], distances)
    device.read(buffers[3], hits)
    for buffer in buffers:
        device.release(buffer)
    n = len(rays)
    return Hits(distances[:n], hits[0, :n], hits[1, :n] != 0)
