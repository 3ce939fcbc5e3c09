"""Rays per second of the traversal kernels and of Embree, on the same frozen rays of a scene.

Rays are those of diffuse paths: from the camera in the order in which kernels trace them, from bounces at the first
three vertices, and to lights. Each library finds nearest hits, of shadow rays any hit. Embree (3.13, ``libembree3-3``
of Debian) gets streams of rays: as packets, with its flag for coherent rays, and ray by ray. Both are measured in
turns, by processor time, and the share of rays is told of which they find something else.

Examples: ``python scripts/ray_bench.py S1-tess S4``, ``python scripts/ray_bench.py scene.xml --rays 100000``.
"""

from __future__ import annotations

import argparse
import ctypes
import ctypes.util
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

import clrender
from clrender import layout
from clrender.bench import SCENES, write_scene
from clrender.device import bvh
from clrender.device.kernel_build import lanes_of
from clrender.drivers import select
from clrender.flatten.flat_scene import FlatScene, flatten

if TYPE_CHECKING:
    from clrender.device import Device

__all__: list[str] = []

Floats = npt.NDArray[np.float32]
Uints = npt.NDArray[np.uint32]

_KERNELS: Final = Path(__file__).with_suffix(".cl")
_SIZE: Final = (512, 384)
"""Pixels of the image whose camera rays are frozen, in blocks of four by four."""
_BOUNCES: Final = 3
_GROUP: Final = 4
_PACKETS: Final = 8
_NEAR_BYTES: Final = 3 << 19
"""See `clrender.device.kernel_build`."""
_FAR: Final = 3.0e38
"""FAR of kernels/core."""
_COHERENT: Final = 1
"""Embree's RTC_INTERSECT_CONTEXT_FLAG_COHERENT."""
_INVALID: Final = 0xFFFFFFFF

RAY: Final = np.dtype(
    {
        "names": ["origin", "near", "direction", "time", "far", "mask", "id", "flags"],
        "formats": ["3f4", "f4", "3f4", "f4", "f4", "u4", "u4", "u4"],
        "itemsize": 48,
    }
)
"""Embree's RTCRay."""
RAY_HIT: Final = np.dtype(
    {
        "names": [*(RAY.names or ()), "normal", "u", "v", "primitive", "geometry", "instance"],
        "formats": [*(RAY[name] for name in RAY.names or ()), "3f4", "f4", "f4", "u4", "u4", "u4"],
        "itemsize": 80,
    }
)
"""Embree's RTCRayHit."""


@dataclass(frozen=True)
class Rays:
    """Frozen rays.

    Attributes
    ----------
    origins, directions : (n, 3) float32
        Coordinates of the device, metres; directions of any length.
    limits : (n,) float32
        In multiples of the direction.
    leaves : (n,) uint32
        Triangles that they leave, or NONE.
    """

    origins: Floats
    directions: Floats
    limits: Floats
    leaves: Uints

    def __len__(self) -> int:
        return len(self.origins)

    def first(self, count: int) -> Rays:
        """Evenly spread stretches of 128 rays, together about `count`."""
        stretch, total = 128, len(self)
        if total <= count:
            return self
        begins = np.linspace(0, total - stretch, max(count // stretch, 1)).astype(np.int64)
        kept = (begins[:, None] + np.arange(stretch)).ravel()
        return Rays(self.origins[kept], self.directions[kept], self.limits[kept], self.leaves[kept])


@dataclass(frozen=True)
class Rate:
    """What one way to trace some rays takes.

    Attributes
    ----------
    seconds : float
        Processor time.
    wall_seconds : float
    """

    seconds: float
    wall_seconds: float


class Tree:
    """The triangles of a scene as a BVH on a device; disks and spheres are left out, which Embree has not.

    Parameters
    ----------
    device : Device
    flat : FlatScene
    """

    def __init__(self, device: Device, flat: FlatScene) -> None:
        self.device = device
        arrays = {name: device.upload(flat.arrays[name]) for name in bvh.SOURCE_NAMES}
        self._arrays = list(arrays.values())
        source = bvh.SourceArrays.of(arrays, flat.triangle_count, 0)
        self.bvh = bvh.build(device, source)
        self.corners = flat.arrays["vertices"][flat.arrays["triangles"][: flat.triangle_count]]

    @property
    def nbytes(self) -> int:
        """Size of nodes and packs, bytes."""
        return self.bvh.nodes.nbytes + self.bvh.triangle_packs.nbytes

    def program(self, lanes: int, packets: int, **more: int) -> Any:
        macros: dict[str, int | str] = {"LANES": lanes, "PACKETS": packets, **more}
        if lanes > 1:
            macros["PREFETCH"] = 1
            if self.nbytes > _NEAR_BYTES:
                macros["BVH_PREFETCH"] = 1
        stack = bvh.STACK
        while stack < self.bvh.stack_entries:
            stack *= 2
        return self.device.program(_KERNELS, {**macros, "BVH_STACK": stack})

    def release(self) -> None:
        """Give the memory back."""
        for buffer in (*self._arrays, self.bvh.nodes, self.bvh.triangle_packs, self.bvh.analytic_packs):
            self.device.release(buffer)


class Kernels:
    """Frozen rays on a device.

    Parameters
    ----------
    tree : Tree
    rays : Rays
    any_hit : bool
        Ask only whether there is a hit.
    """

    def __init__(self, tree: Tree, rays: Rays, any_hit: bool) -> None:
        self._tree, self._count = tree, len(rays)
        self._kernel = "any" if any_hit else "nearest"
        self._lanes = lanes_of(tree.device)
        self._packets = _PACKETS * 16 // self._lanes if self._lanes > 1 else 1
        each = self._lanes * self._packets
        padded = -(-self._count // (each * _GROUP)) * each * _GROUP
        numbers = np.full((7, padded), -1.0, np.float32)
        numbers[:3, : self._count], numbers[3:6, : self._count] = rays.origins.T, rays.directions.T
        numbers[6, : self._count] = rays.limits
        leaves = np.full(padded, layout.NONE, np.uint32)
        leaves[: self._count] = rays.leaves
        device = tree.device
        self._items, self._padded = padded // each, padded
        self._buffers = [
            device.upload(numbers),
            device.upload(leaves),
            device.empty(4 * padded),
            device.empty(4 * padded),
        ]

    @property
    def _arguments(self) -> list[Any]:
        tree = self._tree.bvh
        head = [tree.nodes, tree.triangle_packs, tree.analytic_packs, *self._buffers[:2]]
        return [*head, np.uint32(self._padded), *self._buffers[2:]]

    def trace(self) -> Rate:
        """Trace all of them, and wait."""
        program = self._tree.program(self._lanes, self._packets)

        def launch() -> None:
            self._tree.device.launch(program, f"bench_{self._kernel}", self._items, _GROUP, self._arguments)
            self._tree.device.finish()

        return _timed(launch)

    def hits(self) -> tuple[Floats, Uints]:
        """Distances and primitives of the last time."""
        found = np.empty(self._padded, np.float32), np.empty(self._padded, np.uint32)
        for buffer, array in zip(self._buffers[2:], found, strict=True):
            self._tree.device.read(buffer, array)
        return found[0][: self._count], found[1][: self._count]

    def counted(self) -> tuple[float, float]:
        """Nodes and packs that a ray looks into, on average, by itself and in order."""
        device, program = self._tree.device, self._tree.program(1, 1, BVH_COUNT_STEPS=1)
        steps = device.empty(8 * self._padded)
        group = 16
        items = -(-self._padded // group) * group
        device.launch(program, f"bench_count_{self._kernel}", items, group, [*self._arguments[:-2], steps])
        found = np.empty((2, self._padded), np.uint32)
        device.read(steps, found)
        device.release(steps)
        nodes, packs = found[:, : self._count].mean(axis=1)
        return float(nodes), float(packs)

    def release(self) -> None:
        """Give the memory back."""
        for buffer in self._buffers:
            self._tree.device.release(buffer)


class _Context(ctypes.Structure):
    """Embree's RTCIntersectContext."""

    _fields_: ClassVar = [("flags", ctypes.c_uint), ("filter", ctypes.c_void_p), ("instance", ctypes.c_uint)]


class Embree:
    """Triangles as a scene of Embree.

    Parameters
    ----------
    corners : (T, 3, 3) float32

    Raises
    ------
    OSError
        When the library is not installed.
    """

    def __init__(self, corners: Floats) -> None:
        self._library = ctypes.CDLL(ctypes.util.find_library("embree3") or "libembree3.so.3")
        for name in ("rtcNewDevice", "rtcNewScene", "rtcNewGeometry", "rtcSetNewGeometryBuffer"):
            getattr(self._library, name).restype = ctypes.c_void_p
        device = ctypes.c_void_p(self._call("rtcNewDevice", b"threads=2"))
        self._scene = ctypes.c_void_p(self._call("rtcNewScene", device))
        geometry = ctypes.c_void_p(self._call("rtcNewGeometry", device, ctypes.c_int(0)))
        faces = np.arange(3 * len(corners), dtype=np.uint32)
        # Buffer types 0 and 1: indices and vertices; formats RTC_FORMAT_UINT3 and FLOAT3
        for kind, form, array, step in ((0, 0x5003, faces, 12), (1, 0x9003, corners.reshape(-1), 12)):
            count = array.nbytes // step
            arguments = (geometry, ctypes.c_int(kind), ctypes.c_uint(0), ctypes.c_int(form))
            place = self._call("rtcSetNewGeometryBuffer", *arguments, ctypes.c_size_t(step), ctypes.c_size_t(count))
            ctypes.memmove(place, np.ascontiguousarray(array).ctypes.data, array.nbytes)
        self._call("rtcCommitGeometry", geometry)
        self._call("rtcAttachGeometry", self._scene, geometry)
        self._call("rtcCommitScene", self._scene)

    def _call(self, name: str, *arguments: Any) -> Any:
        return getattr(self._library, name)(*arguments)

    def trace(self, rays: Rays, any_hit: bool, flag: int, stream: int = 4096) -> tuple[Rate, Any]:
        """Trace them, and return the time and the hits (`RAY_HIT`, or `RAY` if any hit counts)."""
        dtype = RAY if any_hit else RAY_HIT
        given = np.zeros(len(rays), dtype)
        given["origin"], given["direction"], given["far"], given["mask"] = (
            rays.origins,
            rays.directions,
            rays.limits,
            _INVALID,
        )
        if not any_hit:
            given["geometry"] = given["instance"] = _INVALID
        context = _Context(flag, None, _INVALID)
        name = "rtcOccluded1M" if any_hit else "rtcIntersect1M"
        address, step = given.ctypes.data, ctypes.c_size_t(dtype.itemsize)

        def work() -> None:
            for begin in range(0, len(rays), stream):
                count = ctypes.c_uint(min(stream, len(rays) - begin))
                place = ctypes.c_void_p(address + begin * dtype.itemsize)
                self._call(name, self._scene, ctypes.byref(context), place, count, step)

        return _timed(work), given


def _timed(work: Callable[[], None]) -> Rate:
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Rate(time.process_time() - cpu, time.perf_counter() - wall)


def camera_rays(flat: FlatScene) -> Rays:
    """A ray for each pixel, in blocks of four by four, at random places in them."""
    width, height = _SIZE
    camera, rng = flat.camera[0], np.random.default_rng(1)
    block = np.stack(np.meshgrid(np.arange(4), np.arange(4)), -1).reshape(1, -1, 2)
    corners = np.stack(np.meshgrid(np.arange(0, width, 4), np.arange(0, height, 4)), -1).reshape(-1, 1, 2)
    places = ((corners + block).reshape(-1, 2) + rng.random((width * height, 2))) / (width, height)
    right, down = camera["right"][:3], camera["down"][:3]
    directions = camera["corner"][:3] + places[:, :1] * right + places[:, 1:] * down
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    count = len(directions)
    return Rays(
        np.tile(camera["origin"][:3], (count, 1)).astype(np.float32),
        directions.astype(np.float32),
        np.full(count, _FAR, np.float32),
        np.full(count, layout.NONE, np.uint32),
    )


def frozen_rays(tree: Tree, flat: FlatScene) -> dict[str, tuple[Rays, bool]]:
    """Rays of each kind, and whether any hit counts."""
    rng = np.random.default_rng(2)
    lights = _light_points(flat, tree)
    rays = camera_rays(flat)
    kinds: dict[str, list[Rays]] = {"camera": [rays], "bounce": [], "shadow": []}
    for _ in range(_BOUNCES):
        distances, primitives = _found(tree, rays)
        hit = primitives != layout.NONE
        met = primitives[hit]
        corners = tree.corners[met].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        directions = rays.directions[hit].astype(np.float64)
        normals = np.where((normals * directions).sum(1, keepdims=True) > 0.0, -normals, normals)
        points = rays.origins[hit] + directions * distances[hit][:, None]
        points += normals * (1e-5 * np.maximum(np.abs(points).max(axis=1, keepdims=True), 1e-3))
        around = rng.normal(size=normals.shape)
        around = normals + around / np.linalg.norm(around, axis=1, keepdims=True)
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        origins, leaves = points.astype(np.float32), met.astype(np.uint32)
        full = np.full(len(origins), _FAR, np.float32)
        rays = Rays(origins, around.astype(np.float32), full, leaves)
        kinds["bounce"].append(rays)
        if len(lights):
            towards = lights[rng.integers(len(lights), size=len(points))] - points
            ends = np.full(len(origins), 1.0 - 1e-4, np.float32)
        else:  # to the sky
            towards, ends = around[rng.permutation(len(around))], full
            towards = np.where((towards * normals).sum(1, keepdims=True) < 0.0, -towards, towards)
        lit = (towards * normals).sum(1) > 0.0
        kinds["shadow"].append(Rays(origins[lit], towards[lit].astype(np.float32), ends[lit], leaves[lit]))
    return {kind: (_joined(parts), kind == "shadow") for kind, parts in kinds.items()}


def _joined(parts: Sequence[Rays]) -> Rays:
    names = ("origins", "directions", "limits", "leaves")
    return Rays(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _light_points(flat: FlatScene, tree: Tree) -> npt.NDArray[np.float64]:
    """Middles of triangles that shine."""
    shines = flat.arrays["shapes"]["first_light"] != layout.NONE
    which = shines[flat.arrays["primitive_shape"][: flat.triangle_count]]
    return np.asarray(tree.corners[which].mean(axis=1), np.float64)


def _found(tree: Tree, rays: Rays) -> tuple[Floats, Uints]:
    with _on_device(tree, rays, any_hit=False) as kernels:
        kernels.trace()
        return kernels.hits()


@contextmanager
def _on_device(tree: Tree, rays: Rays, *, any_hit: bool) -> Iterator[Kernels]:
    kernels = Kernels(tree, rays, any_hit)
    try:
        yield kernels
    finally:
        kernels.release()


def measured(tree: Tree, embree: Embree | None, rays: Rays, *, any_hit: bool, turns: int) -> dict[str, Any]:
    """Millions of rays per second of processor time, medians of the turns, and what a ray costs."""
    ways: dict[str, list[float]] = {"kernels": []}
    row: dict[str, Any] = {"rays": len(rays)}
    with _on_device(tree, rays, any_hit=any_hit) as kernels:
        kernels.trace()  # compiles
        row["nodes"], row["packs"] = kernels.counted()
        for _ in range(turns):
            ways["kernels"].append(kernels.trace().seconds)
            if embree is not None:
                for name, flag in (("embree packets", _COHERENT), ("embree single", 0)):
                    rate, found = embree.trace(rays, any_hit, flag)
                    ways.setdefault(name, []).append(rate.seconds)
        if embree is not None:
            row["other hits"] = _other_hits(kernels, found, any_hit)
    for name, seconds in ways.items():
        row[name] = len(rays) / statistics.median(seconds) / 1e6
    row["ns per step"] = 1e3 / row["kernels"] / (row["nodes"] + row["packs"])
    return row


def _other_hits(kernels: Kernels, found: Any, any_hit: bool) -> float:
    """The share of rays for which Embree says otherwise whether they hit anything, or clearly how far away."""
    distances, primitives = kernels.hits()
    if any_hit:
        return float(np.mean((distances < 0.0) != (found["far"] < 0.0)))
    hit = primitives != layout.NONE
    far = np.abs(distances - found["far"]) > 1e-3 * np.maximum(distances, 1e-3)
    return float(np.mean((hit != (found["geometry"] != _INVALID)) | (hit & far)))


def main() -> int:
    """Print a table, or with ``--json`` its rows; returns 0."""
    parser = argparse.ArgumentParser(prog="scripts/ray_bench.py", description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("scenes", nargs="*", default=["S1-tess", "S3-1M", "S4", "S6"], help="of `bench`, or files")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rays", type=int, default=200_000, help="of each kind, at most")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    device = select([options.device])[0]
    rows = []
    print("| scene | rays | nodes, packs a ray | kernels | Embree packets | Embree single | ns a step | other hits |")
    print("|---|---|---|---|---|---|---|---|")
    for name in options.scenes:
        with tempfile.TemporaryDirectory() as folder:
            where = write_scene(name, Path(folder)) if name in SCENES else Path(name)
            flat = flatten(clrender.load(str(where)), *_SIZE)
        if flat.instances.count:
            print(f"{name} has instances, which this benchmark does not know", file=sys.stderr)
            continue
        tree = Tree(device, flat)
        try:
            embree = Embree(tree.corners)
        except OSError as error:
            print(f"Embree is left out: {error}", file=sys.stderr)
            embree = None
        for kind, (rays, any_hit) in frozen_rays(tree, flat).items():
            row = measured(tree, embree, rays.first(options.rays), any_hit=any_hit, turns=options.turns)
            rows.append({"scene": name, "kind": kind, **row})
            rates = (f"{row[way]:.2f}" if way in row else "–" for way in ("kernels", "embree packets", "embree single"))
            steps, other = f"{row['nodes']:.1f}, {row['packs']:.1f}", f"{row.get('other hits', 0.0):.1e}"
            print(
                f"| {name} | {kind} | {steps} | {' | '.join(rates)} | {row['ns per step']:.1f} | {other} |", flush=True
            )
        tree.release()
    if options.json:
        print(json.dumps(rows, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
