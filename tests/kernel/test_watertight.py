"""No ray escapes from a closed mesh, and none that leaves a surface meets it again by rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
import reference
from kernel_support import FOLDER, Rays, analytic_rows, flat_scene, trace, tree_on
from meshes import CLOSED, aimed, box, icosphere, inside

from clrender import layout
from clrender.device.scene_arrays import SceneArrays, scene_array_names

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.flatten.flat_scene import FlatScene

Points = npt.NDArray[np.float64]

# Scale, rotation or not, and how far from the origin, in sizes.
PLACES = {
    "as it is": (1.0, False, 0.0),
    "turned": (1.0, True, 0.0),
    "tiny": (1e-3, True, 0.0),
    "huge": (1e4, True, 0.0),
    "far": (1.0, True, 2e3),
}


def placed(points: Points, place: str, rng: np.random.Generator) -> tuple[Points, Points]:
    """Rotation and scale as one matrix, and the translation."""
    scale, turned, far = PLACES[place]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if turned else np.eye(3)
    turn *= np.sign(np.linalg.det(turn))
    return turn * scale, np.array([0.6, -0.64, 0.48]) * far * scale


def leaks(device: Device, name: str, place: str, count: int, seed: int) -> tuple[int, int]:
    """Rays that escape from a closed mesh, and rays sent: a third each at random, at its edges, at its vertices."""
    rng = np.random.default_rng(seed)
    points, faces = CLOSED[name]
    matrix, shift = placed(points, place, rng)
    world = (points @ matrix.T + shift).astype(np.float32)
    escaped = sent = 0
    with tree_on(device, flat_scene(world, faces)) as tree:
        for kind in ("random", "edges", "vertices"):
            origins = (inside(count // 3, rng) @ matrix.T + shift).astype(np.float32)
            directions = aimed(world.astype(np.float64), faces, origins.astype(np.float64), kind, rng)
            hits = trace(tree, Rays.of(origins, directions))
            escaped += int((hits.primitives == layout.NONE).sum() + (~hits.occluded).sum())
            sent += len(origins)
    return escaped, sent


@pytest.mark.thorough
@pytest.mark.parametrize("millions", [2, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", CLOSED)
def test_nothing_escapes_in_millions_of_rays(device: Device, name: str, millions: int) -> None:
    """In all bodies together. Without the slack of the triangle test a tenth of those in each escape."""
    total, count = 0, 30_000 * millions
    for number, place in enumerate(PLACES):
        escaped, sent = leaks(device, name, place, count, 90 + number)
        assert escaped == 0, f"{escaped} of {sent} rays escaped from {name}, {place}"
        total += sent
    assert total * len(CLOSED) >= 1e6 * millions


def left(
    device: Device, flat: FlatScene, origins: Points, directions: Points, leaving: Points, outwards: bool
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32], Rays]:
    """What rays hit, what rays from there hit, and these rays."""
    arrays = SceneArrays(device, flat)
    settings = np.zeros(1, layout.dtype("Settings"))
    settings["triangle_count"] = flat.triangle_count
    settings["primitive_count"] = flat.triangle_count + flat.analytic_count
    count = len(origins)
    assert count % 16 == 0
    rays = np.ascontiguousarray(np.concatenate([origins.T, directions.T]), np.float32)
    buffers = [device.upload(settings), device.upload(rays)]
    buffers += [
        device.upload(np.ascontiguousarray(leaving.T, np.float32)),
        device.empty(8 * count),
        device.empty(24 * count),
    ]
    named = {**arrays.buffers, "settings": buffers[0]}
    arguments: list[Any] = [named[name] for name in scene_array_names()]
    arguments += [buffers[1], buffers[2], np.uint32(outwards), np.uint32(count), *buffers[3:]]
    program = device.program(FOLDER / "leave.cl", {"LANES": 8})
    device.launch(program, "leave", -(-count // 128) * 16, 16, arguments)
    hits, seconds = np.empty((2, count), np.uint32), np.empty((6, count), np.float32)
    device.read(buffers[3], hits)
    device.read(buffers[4], seconds)
    for buffer in buffers:
        device.release(buffer)
    arrays.release()
    return hits[0], hits[1], Rays.of(seconds[:3].T, seconds[3:].T)


def around(count: int, rng: np.random.Generator) -> tuple[Points, Points, Points]:
    """Rays from outside and inside towards the middle of the unit sphere, and directions to leave what they hit.

    The directions are random, half of them almost along the surface of a sphere.
    """
    out = rng.normal(size=(count, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    start = np.where(rng.integers(0, 2, (count, 1)) == 0, out * 3, inside(count, rng) * 0.5)
    toward = np.where(np.linalg.norm(start, axis=1, keepdims=True) > 1, inside(count, rng) * 3 - start, out)
    leaving = rng.normal(size=(count, 3))
    flat = np.cross(out, leaving) + out * 10.0 ** rng.uniform(-9, -2, (count, 1))
    leaving = np.where(rng.integers(0, 2, (count, 1)) == 0, leaving, flat)
    return start, toward, leaving / np.linalg.norm(leaving, axis=1, keepdims=True)


def at_rim(rays: Rays, number: int, flat: FlatScene, triangle: int) -> bool:
    """Whether one of the rays passes beside that triangle, but near enough that it may be said to hit."""
    corners = flat.arrays["vertices"][flat.arrays["triangles"][triangle]]
    one = Rays.of(rays.origins[number][None], rays.directions[number][None])
    seen = reference.triangles(one, corners[None])
    return bool((seen.possible & seen.loose).all())


@pytest.mark.parametrize("place", [*PLACES])
@pytest.mark.parametrize("body", ["sphere", "icosphere", "box"])
def test_a_ray_leaves_a_convex_body_for_good_or_comes_to_its_other_side(device: Device, body: str, place: str) -> None:
    """Outwards nothing is hit, whatever the angle; inwards always something, and of a mesh another triangle.

    A few of the rays that almost lie in the surface may hit the rim of the next triangle, as far as its test lets a ray
    pass beside it: those are looked at in double precision. And where two sides meet at a right angle or a sharper one,
    and the point is as near to the edge as its rounding could be, a ray that begins a rounding inside of one side may
    begin outside of the other. Those few are left out.
    """
    rng = np.random.default_rng(50)
    count = 32000
    start, toward, leaving = around(count, rng)
    points, faces = {"sphere": box(), "icosphere": icosphere(2), "box": box((0.6, 0.5, 0.55))}[body]
    matrix, shift = placed(points, place, rng)
    if body == "sphere":
        flat = flat_scene(analytic_shapes=analytic_rows(shift, PLACES[place][0]))
    else:
        flat = flat_scene(points @ matrix.T + shift, faces)
    origins, directions, leaving = start @ matrix.T + shift, toward @ matrix.T, leaving @ matrix.T
    for outwards in (True, False):
        first, second, rays = left(device, flat, origins, directions, leaving, outwards)
        place_of = rays.origins.astype(np.float64)
        hit = first != layout.NONE
        assert hit.mean() > 0.9
        if body == "box":
            inner = (place_of - shift) @ np.linalg.inv(matrix).T
            to_edge = np.sort(np.abs(points).max(0) - np.abs(inner), axis=1)[:, 1]
            rounding = 16 * 2.0**-24 * np.abs(place_of).sum(1) / PLACES[place][0]
            assert (to_edge > rounding)[hit].mean() > 0.98
            hit &= to_edge > rounding
        again = second[hit] != layout.NONE
        if outwards and body != "sphere":
            beside = [at_rim(rays, i, flat, second[i]) for i in np.flatnonzero(hit)[again]]
            assert len(beside) < 1e-3 * len(again)
            again[again] = ~np.array(beside, bool)
        wrong = again if outwards else ~again
        side = "outwards" if outwards else "inwards"
        assert not wrong.any(), f"{wrong.sum()} of {hit.sum()} rays go wrong {side}"
        if body != "sphere":
            assert (second[hit] != first[hit]).all()


@pytest.mark.parametrize("place", [*PLACES])
def test_a_ray_leaves_a_flat_thing_on_both_sides(device: Device, place: str) -> None:
    """A square of two triangles, and a disk: from neither side do they hit themselves, nor one triangle the other."""
    rng = np.random.default_rng(51)
    count = 16000
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    target = np.c_[rng.uniform(-0.7, 0.7, (count, 2)), np.zeros(count)]
    target[: count // 2, 1] = target[: count // 2, 0] + rng.normal(size=count // 2) * 1e-4  # near the diagonal
    start = target + rng.normal(size=(count, 3))
    leaving = rng.normal(size=(count, 3))
    leaving[::2, 2] *= 10.0 ** rng.uniform(-9, -2, count // 2)
    matrix, shift = placed(corners, place, rng)
    normal = matrix[:, 2] / np.linalg.norm(matrix[:, 2])
    square = flat_scene(corners @ matrix.T + shift, [[0, 1, 2], [0, 2, 3]])
    disk = flat_scene(analytic_shapes=analytic_rows(shift, PLACES[place][0], normal))
    for flat in (square, disk):
        for outwards in (True, False):
            first, second, _ = left(
                device, flat, start @ matrix.T + shift, (target - start) @ matrix.T, leaving @ matrix.T, outwards
            )
            hit = first != layout.NONE
            assert hit.mean() > 0.9
            assert (second[hit] == layout.NONE).all(), f"{(second[hit] != layout.NONE).sum()} of {hit.sum()}"
