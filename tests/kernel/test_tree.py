"""The builder: a sound tree for whatever distribution of primitives, the same on every driver, never too deep.

The order of a scene's primitives has a say in the tree only among primitives of one Morton code, which stay in their
order. In what rays hit it has no more say than a rounding: a distance is no less than where the leaf's box begins.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from kernel_support import Rays, analytic_rows, finds_what_leaves_hold, flat_scene, trace, tree_on
from meshes import box, bumpy, icosphere
from tree_reference import bounds_of, check, cost, download, median_cost, stack_needed, sweep_cost

import clrender
from clrender import layout
from clrender.device import Device, bvh, radix_sort
from clrender.device.bvh import STACK
from clrender.device.worker import DeviceWorker
from clrender.errors import RenderError
from clrender.flatten.flat_scene import flatten

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from clrender.device.device import Program
    from clrender.flatten.flat_scene import FlatScene

Points = npt.NDArray[np.float64]


def of_triangles(corners: Points) -> FlatScene:
    """A scene of (n, 3, 3) triangles that share no vertices."""
    return flat_scene(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def small_in_large() -> FlatScene:
    """A teapot in a stadium: 5120 triangles in a ten-millionth of a room of twelve."""
    points, faces = bumpy(4)
    room, sides = box((1000.0, 100.0, 2000.0))
    return flat_scene(np.vstack([room, points * 1e-4 + [3.0, -99.0, 7.0]]), np.vstack([sides, faces + len(room)]))


def slivers(rng: np.random.Generator) -> FlatScene:
    corners = rng.uniform(-1, 1, (4000, 1, 3)) + rng.normal(size=(4000, 3, 3)) * [[[1.0, 1e-3, 1e-6]]]
    corners[::2] = corners[::2, :, [1, 2, 0]]
    return of_triangles(corners)


def in_one_place(count: int) -> FlatScene:
    corners = np.array([[0.1, 0.2, 0.3], [1.3, 0.4, 0.2], [0.2, 1.1, 0.7]])
    return flat_scene(corners, np.tile([0, 1, 2], (count, 1)))


def around_one_center(rng: np.random.Generator) -> FlatScene:
    """Triangles whose boxes have one middle, and spheres and disks around it, from a thousandth to a thousand."""
    size = 10.0 ** rng.uniform(-3, 3, (3000, 1, 1))
    corners = size * np.array([[[-1, -1, -1], [1, 1, 1], [-1, 1, 0]]])
    radii = 10.0 ** rng.uniform(-3, 3, 2000)
    normals = rng.normal(size=(2000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[::2] = 0
    flat = of_triangles(corners)
    return flat_scene(
        flat.arrays["vertices"], flat.arrays["triangles"], analytic_rows(np.zeros((2000, 3)), radii, normals)
    )


def ever_smaller(count: int = 110) -> FlatScene:
    """Each triangle half as large as the one before and half as far from a corner: the deepest tree there can be."""
    rng = np.random.default_rng(60)
    size = 2.0 ** -np.arange(count)[:, None, None]
    return of_triangles((rng.uniform(0.5, 1, (count, 3, 3))) * size * 1e12)


def one_code(rng: np.random.Generator) -> FlatScene:
    """Thousands of triangles and spheres with the same Morton code, because two others are far away."""
    near = rng.uniform(-1e-4, 1e-4, (3000, 3, 3))
    far = np.array([[[1e4, 1e4, 1e4], [1e4, 1e4 + 1, 1e4], [1e4, 1e4, 1e4 + 1]]])
    flat = of_triangles(np.concatenate([near, far, -far]))
    return flat_scene(
        flat.arrays["vertices"], flat.arrays["triangles"], analytic_rows(rng.uniform(-1e-4, 1e-4, (500, 3)), 1e-5)
    )


def mixed(rng: np.random.Generator) -> FlatScene:
    points, faces = icosphere(3)
    normals = rng.normal(size=(700, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:300] = 0
    return flat_scene(
        points, faces, analytic_rows(rng.uniform(-2, 2, (700, 3)), 10.0 ** rng.uniform(-3, 0, 700), normals)
    )


def rectangles(rng: np.random.Generator) -> FlatScene:
    """Square to all axes, from all corners, wound both ways, of all sizes; and spheres and triangles between them."""
    corners = rng.uniform(-1, 1, (900, 6, 3))
    for i, quad in enumerate(corners):
        axis, first = i % 3, (i + 1 + i // 3 % 2) % 3
        a, c = quad[0].copy(), quad[0] + rng.uniform(-1, 1, 3) * 10.0 ** rng.uniform(-3, 0)
        if i % 10:
            c[axis] = a[axis]
        b = a.copy()
        b[first] = c[first]
        quad[:] = a, b, c, a, c, a + c - b
        quad[5, first] = a[first]
    points = rng.uniform(-1, 1, (400, 3))
    shape = of_triangles(corners.reshape(-1, 3, 3))
    return flat_scene(shape.arrays["vertices"], shape.arrays["triangles"], analytic_rows(points, 0.05))


def scene_named(name: str) -> FlatScene:
    rng = np.random.default_rng(61)
    scenes = {
        "nothing": flat_scene,
        "a triangle": lambda: in_one_place(1),
        "a sphere": lambda: flat_scene(analytic_shapes=analytic_rows([(1.0, 2.0, 3.0)], 0.5)),
        "a triangle and a sphere": lambda: flat_scene(np.eye(3), [[0, 1, 2]], analytic_rows([(1.0, 2.0, 3.0)], 0.5)),
        "eight": lambda: in_one_place(8),
        "nine": lambda: in_one_place(9),
        "small in large": small_in_large,
        "slivers": lambda: slivers(rng),
        "a hundred thousand in one place": lambda: in_one_place(100000),
        "around one centre": lambda: around_one_center(rng),
        "ever smaller": ever_smaller,
        "one Morton code": lambda: one_code(rng),
        "spheres": lambda: flat_scene(
            analytic_shapes=analytic_rows(rng.normal(size=(5000, 3)), 10.0 ** rng.uniform(-4, -0.5, 5000))
        ),
        "mixed": lambda: mixed(rng),
        "rectangles": lambda: rectangles(rng),
        "far away": lambda: of_triangles(rng.uniform(-1, 1, (1000, 3, 3)) * 0.01 + [1e5, -3e5, 2e5]),
    }
    return scenes[name]()  # type: ignore[no-untyped-call]


NAMES = (
    "nothing",
    "a triangle",
    "a sphere",
    "a triangle and a sphere",
    "eight",
    "nine",
    "small in large",
    "slivers",
    "a hundred thousand in one place",
    "around one centre",
    "ever smaller",
    "one Morton code",
    "spheres",
    "mixed",
    "rectangles",
    "far away",
)


def through(scene: FlatScene, count: int) -> Rays:
    """Rays at primitives, from near and far."""
    rng = np.random.default_rng(62)
    low, high = bounds_of(scene)
    pick = rng.integers(len(low), size=count)
    target = low[pick] + rng.uniform(size=(count, 3)) * (high - low)[pick]
    reach = np.linalg.norm(high.max(0) - low.min(0)) * 10.0 ** rng.uniform(-6, 0, (count, 1))
    direction = rng.normal(size=(count, 3))
    return Rays.of(target - direction * reach, direction)


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_the_tree_is_sound(device: Device, name: str) -> None:
    """And both traversals find in it what every leaf holds."""
    scene = scene_named(name)
    with tree_on(device, scene) as tree:
        words = download(tree)
        check(words, scene)
        need, levels = stack_needed(words)
        assert levels == tree.bvh.levels
        assert need <= tree.bvh.stack_entries
        if not scene.triangle_count + scene.analytic_count:
            return
        assert finds_what_leaves_hold(tree, through(scene, 512))
        print(f"{name}: {len(words.nodes)} nodes, {levels} levels, stack {need} of {tree.bvh.stack_entries}")


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["mixed", "rectangles", "ever smaller", "around one centre", "one Morton code", "nine"]
)
def test_the_tree_has_the_same_bits_on_every_driver(all_devices: list[Device], name: str) -> None:
    scene = scene_named(name)
    trees = []
    for device in all_devices:
        with tree_on(device, scene) as tree:
            words = download(tree)
            trees.append([array.tobytes() for array in (words.nodes, words.triangle_packs, words.analytic_packs)])
    assert all(each == trees[0] for each in trees)


@pytest.mark.parametrize("count", [1, 2, 70, 1024])
def test_few_are_built_by_one_work_item_as_by_many(device: Device, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """Also their order, which the host finds for few, and the numbers of tiny levels."""
    if not device.is_cpu and count > bvh.MERGE_CHUNK:
        pytest.skip("on other devices than CPUs one work-item joins fewer")
    rng = np.random.default_rng(62)
    corners = rng.uniform(-1, 1, (count, 1, 3)) + 0.1 * rng.normal(size=(count, 3, 3))
    corners[count // 2 :: 3] = corners[count // 2]  # Morton codes that are equal
    scene = of_triangles(corners)
    launched: Counter[str] = Counter()
    launch = Device.launch

    def counting(self: Device, program: Program, kernel: str, *more: Any) -> None:
        launched[kernel] += 1
        launch(self, program, kernel, *more)

    monkeypatch.setattr(Device, "launch", counting)
    with tree_on(device, scene) as tree:
        few = download(tree)
    assert set(launched) >= {"build_merge_few"} and {"build_merge", "build_sort_scatter"}.isdisjoint(launched)
    launched.clear()
    monkeypatch.setattr(bvh, "_FEW" if device.is_cpu else "_FEW_ELSEWHERE", 0)
    monkeypatch.setattr(radix_sort, "_FEW", 0)
    with tree_on(device, scene) as tree:
        many = download(tree)
    assert not launched["build_merge_few"]
    assert launched["build_sort_scatter"] == 8
    assert bool(launched["build_merge"]) == (count > 1)
    for name in ("nodes", "triangle_packs", "analytic_packs"):
        assert getattr(few, name).tobytes() == getattr(many, name).tobytes()


def test_a_tree_beyond_what_references_reach_is_refused(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bvh, "_MOST_BLOCKS", 1)
    with tree_on(device, scene_named("a triangle")):
        pass
    message = r"takes \d+ blocks and holds 1 of them: split the scene"
    with pytest.raises(RenderError, match=message), tree_on(device, scene_named("mixed")):
        pass


@pytest.mark.long
def test_a_renderer_has_the_stack_that_a_deep_tree_needs(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """`BVH_STACK` grows with the tree; for a usual one it stays as it is, or each scene would be compiled for."""
    asked: list[Mapping[str, int | str]] = []
    build = device.program

    def program(
        entry: str | Path, defines: Mapping[str, int | str] | None = None, samples: int | None = None
    ) -> Program:
        asked.append(defines or {})
        return build(entry, defines, samples)

    monkeypatch.setattr(device, "program", program)
    settings = np.zeros(1, layout.dtype("Settings"))
    for scene, deep in ((ever_smaller(), True), (scene_named("mixed"), False)):
        with tree_on(device, scene) as tree:
            wanted = tree.bvh.stack_entries
            assert (wanted > STACK) == deep
        asked.clear()
        DeviceWorker(device, scene, settings).release()
        stacks = [int(defines["BVH_STACK"]) for defines in asked if "BVH_STACK" in defines]
        assert len(stacks) == (1 if deep else 0)
        assert all(stack >= wanted for stack in stacks)


@pytest.mark.parametrize("crowded", [False, True])
def test_the_order_of_primitives_hardly_matters(device: Device, crowded: bool) -> None:
    """Where all Morton codes differ the tree is the same; else the hits are, but for a rounding of their distance."""
    rng = np.random.default_rng(63)
    corners = rng.uniform(-1, 1, (600, 3, 3))
    scene = of_triangles(np.concatenate([corners, np.eye(3)[None] * 1e8]) if crowded else corners)
    faces = scene.arrays["triangles"]
    order = rng.permutation(len(faces))
    start = rng.uniform(-2, 2, (20000, 3))
    rays = Rays.of(start, corners[rng.integers(600, size=20000)].mean(1) - start)
    with tree_on(device, scene) as tree:
        first, one = download(tree), trace(tree, rays)
    with tree_on(device, flat_scene(scene.arrays["vertices"], faces[order])) as tree:
        second, other = download(tree), trace(tree, rays)
    assert (first.nodes.tobytes() == second.nodes.tobytes()) != crowded
    hit = one.primitives != layout.NONE
    assert hit.mean() > 0.9
    assert np.array_equal(hit, other.primitives != layout.NONE)
    assert np.array_equal(one.primitives[hit], order[other.primitives[hit]])
    # reference.py: a hit's depth is within 24 EPS of the largest coordinate, here below 3 sqrt(3), whatever the box.
    depth = np.abs(rays.directions).max(1).astype(np.float64)
    difference = np.abs(one.distances.astype(np.float64) - other.distances)[hit] * depth[hit]
    assert difference.max() <= (2 * 24 * 2.0**-24 * 3 * 3**0.5 if crowded else 0.0)


@pytest.mark.parametrize("name", ["small in large", "slivers", "spheres", "mixed"])
def test_the_tree_is_better_than_one_split_in_the_middle(device: Device, name: str) -> None:
    """By the surface area heuristic, which is a number and no time; how near to a full sweep it is, is only printed."""
    scene = scene_named(name)
    with tree_on(device, scene) as tree:
        ours = cost(download(tree))
    low, high = bounds_of(scene)
    median, sweep = median_cost(low, high), sweep_cost(low, high)
    print(f"{name}: cost {ours:.2f}, by full sweeps {sweep:.2f}, by medians {median:.2f}")
    assert ours < median


def test_the_tree_of_a_mesh_is_as_good_as_one_by_full_sweeps(device: Device) -> None:
    """Within a tenth, by the surface area heuristic; the wide nodes count, so the way they are collapsed does too."""
    scene = flatten(clrender.load("bumpy"), 64, 64)
    with tree_on(device, scene) as tree:
        ours = cost(download(tree))
    sweep = sweep_cost(*bounds_of(scene))
    assert ours <= 1.1 * sweep, f"cost {ours:.2f}, by full sweeps {sweep:.2f}"
