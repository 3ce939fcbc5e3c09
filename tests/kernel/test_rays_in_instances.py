"""Rays through instances: they meet what is there when all are written out, and lose nothing at edges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt
import pytest

from clrender import layout
from clrender.bench.shapes import geodesic
from clrender.device import Device
from clrender.device.launch import LaunchConfig
from clrender.device.worker import DeviceWorker
from clrender.flatten.assembly import written_out
from clrender.flatten.flat_scene import FlatScene, flatten
from clrender.scene import Scene
from clrender.scene.groups import Instance, TransformArray

_KERNEL: Final = Path(__file__).parent / "instances.cl"
_Floats: TypeAlias = npt.NDArray[np.float64]
_SIZE: Final = 8
_CAMERA: Final = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]}


def maps(count: int, seed: int, similar: bool = False) -> _Floats:
    """Places of instances: turned about any axis, of many sizes, every third one mirrored, some sheared."""
    random = np.random.default_rng(seed)
    turned, _ = np.linalg.qr(random.normal(size=(count, 3, 3)))
    size = 10.0 ** random.uniform(-1.5, 0.3, (count, 1, 1))
    linear = turned * size
    if not similar:
        linear = linear * random.uniform(0.5, 1.5, (count, 1, 3))
        linear[::2] = linear[::2] @ (np.eye(3) + np.triu(random.uniform(-0.5, 0.5, (3, 3)), 1))
    linear[::3] *= -1.0
    return np.concatenate([linear, random.uniform(-3.0, 3.0, (count, 3, 1))], axis=2)


def placed(shapes: list[dict[str, Any]], places: _Floats, more: tuple[dict[str, Any], ...] = ()) -> Scene:
    """A group, instances of it, and shapes of the scene's own."""
    instance = {"type": "instance", "group": "one", "transforms": "places.npy"}
    scene = Scene(camera=_CAMERA, groups={"one": {"shapes": shapes}}, shapes=(*more, instance))
    return scene.with_files(transforms={"places.npy": TransformArray.checked(places, "places")})


def ball(frequency: int = 12) -> dict[str, Any]:
    """A closed sphere of triangles that share their corners."""
    points, faces = geodesic(frequency)
    _, first, of = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    return {"type": "mesh", "vertices": points[first].tolist(), "faces": of.reshape(-1)[faces].tolist()}


@contextmanager
def worker_on(device: Device, flat: FlatScene, launch: LaunchConfig | None = None) -> Iterator[DeviceWorker]:
    settings = np.zeros(1, layout.dtype("Settings"))
    settings["width"], settings["height"], settings["tile"] = _SIZE, _SIZE, _SIZE
    worker = DeviceWorker(device, flat, settings, launch=launch or LaunchConfig(lanes=16))
    try:
        yield worker
    finally:
        worker.release()


def traced(worker: DeviceWorker, origins: _Floats, directions: _Floats) -> Mapping[str, npt.NDArray[Any]]:
    """Distances, primitives, and points, errors, normals and shading normals of surfaces, of (n, 3) rays."""
    device, count = worker.device, len(origins)
    assert count % 16 == 0
    rays = np.ascontiguousarray(np.concatenate([origins.T, directions.T]), np.float32)
    buffers = [device.upload(rays), device.empty(4 * count), device.empty(4 * count), device.empty(48 * count)]
    worker.launch_over(worker.program(str(_KERNEL)), "trace_scene", count, [buffers[0], np.uint32(count), *buffers[1:]])
    distances, primitives = np.empty(count, np.float32), np.empty(count, np.uint32)
    surfaces = np.empty((4, 3, count), np.float32)
    for buffer, array in zip(buffers[1:], (distances, primitives, surfaces), strict=True):
        device.read(buffer, array)
    for buffer in buffers:
        device.release(buffer)
    names = ("point", "error", "normal", "shading")
    vectors = {name: surfaces[k].T for k, name in enumerate(names)}
    return {"distance": distances, "primitive": primitives, **vectors}


def delicate(flat: FlatScene, count: int, seed: int) -> tuple[_Floats, _Floats]:
    """Rays at corners, edges and insides of triangles that face them, some from near or far.

    They face them so much that their neighbours do, too: at the outline of a body a rounding decides.
    """
    random = np.random.default_rng(seed)
    corners = flat.arrays["vertices"][flat.arrays["triangles"][: flat.triangle_count]].astype(np.float64)
    chosen = corners[random.integers(0, len(corners), count)]
    weights = random.dirichlet((1.0, 1.0, 1.0), count)
    kind = random.integers(0, 4, count)
    weights[kind == 0] = [1.0, 0.0, 0.0]
    on_edge = kind == 1
    weights[on_edge, 2], weights[on_edge, 0] = 0.0, 1.0 - weights[on_edge, 1]
    on_edge = kind == 2
    weights[on_edge] = [0.5, 0.5, 0.0]
    targets = (chosen * weights[:, :, None]).sum(axis=1)
    normal = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
    normal /= np.sqrt((normal * normal).sum(axis=1))[:, None]
    way = random.normal(size=(count, 3))
    way /= np.sqrt((way * way).sum(axis=1))[:, None]
    facing = (way * normal).sum(axis=1)
    way = np.where((facing < 0.0)[:, None], -way, way)
    way = np.where((np.abs(facing) < 0.6)[:, None], way + 2.0 * normal, way)
    origins = (targets + way * 10.0 ** random.uniform(-2.0, 1.0, (count, 1))).astype(np.float32).astype(np.float64)
    return origins, targets - origins


def _lost(device: Device, count: int, seed: int) -> None:
    places = maps(40, seed)
    scene = placed([ball()], places)
    flat, all_written = flatten(scene, _SIZE, _SIZE), flatten(written_out(scene), _SIZE, _SIZE)
    own = flat.triangle_count
    with worker_on(device, flat) as one, worker_on(device, all_written) as other:
        for begin in range(0, count, 2**18):
            origins, directions = delicate(all_written, min(2**18, count - begin), seed + begin)
            instanced, flattened = (traced(worker, origins, directions) for worker in (one, other))
            hit, missed = flattened["primitive"] != layout.NONE, instanced["primitive"] == layout.NONE
            assert hit.all(), "they were aimed at it"
            assert not missed.any(), f"{int(missed.sum())} rays pass {int(hit.sum())} that are hit"
            length = np.sqrt((directions * directions).sum(axis=1))
            apart = np.abs(instanced["distance"] - flattened["distance"]) * length
            # A ray at the edge of an overlapping instance may pass it in one and not in the other
            same = instanced["primitive"].astype(np.int64) - own == flattened["primitive"]
            neighbour = (instanced["primitive"].astype(np.int64) - own) // own == flattened["primitive"] // own
            assert neighbour.mean() > 0.9999 and same.mean() > 0.5
            # Along a surface that is only grazed, places of hits are far apart
            steep = np.abs((flattened["normal"] * directions).sum(axis=1)) > 0.5 * length
            assert apart[neighbour & steep].max() < 1e-4
            for name, most in (("point", 1e-4), ("normal", 1e-2)):
                difference = np.abs(instanced[name] - flattened[name]).max(axis=1)
                assert difference[same & steep].max() < most, name


@pytest.mark.long
def test_rays_at_edges_of_instances_hit_what_is_written_out(device: Device) -> None:
    _lost(device, 2**17, 5)


@pytest.mark.slow
def test_ten_million_rays_at_edges_of_instances(device: Device) -> None:
    for seed in range(20):
        _lost(device, 2**19, 100 + seed)


@pytest.mark.long
def test_all_ways_through_the_trees_are_one(device: Device) -> None:
    scene = placed(
        [ball(2), {"type": "box", "size": [2.5, 0.5, 0.5]}], maps(30, 1), ({"type": "sphere", "radius": 0.5},)
    )
    flat = flatten(scene, _SIZE, _SIZE)
    origins, directions = delicate(flatten(written_out(scene), _SIZE, _SIZE), 2**13, 3)
    found = []
    for launch in (
        LaunchConfig(lanes=16), LaunchConfig(lanes=16, traversal="single"), LaunchConfig(lanes=8), LaunchConfig(lanes=1)
    ):  # fmt: skip
        with worker_on(device, flat, launch) as worker:
            found.append(traced(worker, origins, directions))
    for other in found[1:]:
        for name, values in found[0].items():
            np.testing.assert_array_equal(values, other[name], err_msg=name)


@pytest.mark.long
def test_spheres_and_disks_of_instances(device: Device) -> None:
    shapes: list[dict[str, Any]] = [
        {"type": "sphere", "center": [0.4, 0.0, 0.0], "radius": 0.5},
        {"type": "disk", "center": [-0.5, 0.0, 0.0], "normal": [1.0, 2.0, 0.0], "radius": 0.6},
        {"type": "sphere", "center": [0.0, 1.0, 0.0], "radius": 0.3, "flip_normals": True},
    ]
    scene = placed(shapes, maps(20, 2, similar=True))
    random = np.random.default_rng(4)
    origins = random.uniform(-4.0, 4.0, (2**14, 3))
    directions = random.normal(size=origins.shape)
    with worker_on(device, flatten(scene, _SIZE, _SIZE)) as one:
        instanced = traced(one, origins, directions)
    with worker_on(device, flatten(written_out(scene), _SIZE, _SIZE)) as other:
        flattened = traced(other, origins, directions)
    hit = flattened["primitive"] != layout.NONE
    assert 0.1 < hit.mean() < 0.9
    same = (instanced["primitive"] != layout.NONE) == hit
    assert same.mean() > 0.9995
    near = hit & same & (np.abs(instanced["distance"] - flattened["distance"]) < 1e-3)
    assert near[hit].mean() > 0.999
    for name, most in (("point", 1e-4), ("normal", 2e-3)):
        assert np.abs(instanced[name][near] - flattened[name][near]).max() < most, name


@pytest.mark.long
@pytest.mark.parametrize("away", [0.0, 3000.0])
def test_a_ray_that_leaves_an_instance_does_not_meet_it_again(device: Device, away: float) -> None:
    """Its point is within its error of the surface that rays find: a ray from there, out along the normal, is free."""
    places = maps(1, 8)
    places[0, :, 3] = [40.0, -70.0, 55.0]  # far from the origin, where rounding is large
    there = {"translate": [away, 0.0, -away]}  # and maybe farther still from the group's own
    places[0, :, 3] -= places[0, :, :3] @ there["translate"]
    scene = placed([{**ball(), "transform": there}], places)
    flat, written = flatten(scene, _SIZE, _SIZE), flatten(written_out(scene), _SIZE, _SIZE)
    origins, directions = delicate(written, 2**15, 9)
    with worker_on(device, flat) as worker:
        met = traced(worker, origins, directions)
        out = np.where(((met["normal"] * directions).sum(axis=1) < 0.0)[:, None], met["normal"], -met["normal"])
        leave = (met["error"] * np.abs(out)).sum(axis=1)
        again = traced(worker, met["point"] + out * leave[:, None], out.astype(np.float64))
    assert (met["primitive"] != layout.NONE).all()
    assert (again["primitive"] == layout.NONE).all()


def test_a_place_of_its_own_is_told() -> None:
    instance = Instance(type="instance", group="a", transform={"translate": [1.0, 2.0, 3.0]})
    np.testing.assert_array_equal(TransformArray.of(instance).maps[0, :, 3], [1.0, 2.0, 3.0])
