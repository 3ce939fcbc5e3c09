"""What a GPU's rays cost: nodes and packs that one lane looks into on the way to its nearest hit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pytest
from kernel_support import FOLDER, Rays, Tree, flat_scene, trace, trace_every_leaf, tree_on

import clrender
from clrender.bench import write_scene
from clrender.device.bvh import STACK
from clrender.flatten.flat_scene import flatten

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.flatten.flat_scene import FlatScene

COUNT = 1 << 15

Points = npt.NDArray[np.float64]


def unit(vectors: Points) -> Points:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def steps(tree: Tree, rays: Rays) -> tuple[float, float]:
    """Mean steps of a ray with the children of nodes in order, and as they lie there; both find the same distances.

    Parameters
    ----------
    tree : Tree
    rays : Rays
        A multiple of 16 of them.
    """
    assert tree.bvh.stack_entries <= STACK
    device, count = tree.device, len(rays)
    numbers = np.concatenate([rays.origins.T, rays.directions.T, rays.limits[None]])
    buffers = [device.upload(np.ascontiguousarray(numbers)), device.empty(8 * count), device.empty(8 * count)]
    program = device.program(FOLDER / "count_steps.cl", {"LANES": 1, "BVH_COUNT_STEPS": 1})
    device.launch(program, "count_steps", count, 16, [*tree.buffers, buffers[0], np.uint32(count), *buffers[1:]])
    taken, distances = np.empty((2, count), np.uint32), np.empty((2, count), np.float32)
    device.read(buffers[1], taken)
    device.read(buffers[2], distances)
    for buffer in buffers:
        device.release(buffer)
    assert distances[0].tobytes() == distances[1].tobytes()
    return float(taken[0].mean()), float(taken[1].mean())


def mesh_in_a_room(folder: Path) -> FlatScene:
    """The benchmark's room with its mesh of 100,820 triangles."""
    return flatten(clrender.load(str(write_scene("S3-100k", folder))), 64, 64)


def loose_triangles(rng: np.random.Generator) -> FlatScene:
    """Ten thousand in a cube, of a fortieth of its side, that cross each other: boxes overlap, nothing is in order."""
    corners = rng.uniform(-1, 1, (10_000, 1, 3)) + rng.normal(size=(10_000, 3, 3)) * 0.05
    return flat_scene(corners.reshape(-1, 3), np.arange(30_000).reshape(-1, 3))


def paths(tree: Tree, rng: np.random.Generator, eye: tuple[float, float, float], bounces: int) -> list[Rays]:
    """Rays of a camera in a room, and how they go on in any direction from where they end."""
    half = np.tan(np.pi / 8)
    origins = np.tile(np.array(eye), (COUNT, 1))
    directions = unit(np.concatenate([rng.uniform(-half, half, (COUNT, 2)), -np.ones((COUNT, 1))], axis=1))
    found = [Rays.of(origins, directions)]
    for _ in range(bounces):
        hits = trace(tree, found[-1], 1)
        assert (hits.distances < 100).all()  # the room is closed
        origins = np.clip(origins + directions * (hits.distances[:, None] * (1 - 1e-3)), [-2, 0, -2], [2, 4, 6])
        directions = unit(rng.normal(size=(COUNT, 3)))
        # Back into the room from its walls
        outward = ((origins < [-1.99, 0.01, -1.99]) & (directions < 0)) | (
            (origins > [1.99, 3.99, 5.99]) & (directions > 0)
        )
        directions = np.where(outward, -directions, directions)
        found.append(Rays.of(origins, directions))
    return found


def test_a_mesh_takes_few_steps(device: Device, tmp_path: Path) -> None:
    """Camera rays, and three bounces through the room."""
    with tree_on(device, mesh_in_a_room(tmp_path)) as tree:
        counted = [steps(tree, rays) for rays in paths(tree, np.random.default_rng(70), (0.0, 2.0, 5.6), 3)]
    print("100,820 triangles in a room, ordered and not:", *(f"{a:.2f} {b:.2f};" for a, b in counted))
    ordered, unordered = (float(np.mean(column)) for column in zip(*counted, strict=True))
    assert ordered <= 4.9
    assert ordered < 0.92 * unordered


def test_loose_triangles_take_half_the_steps(device: Device) -> None:
    """Rays from outside, all of which hit something soon."""
    rng = np.random.default_rng(71)
    origins = unit(rng.normal(size=(COUNT, 3))) * 3
    aims = unit(rng.normal(size=(COUNT, 3))) * np.sqrt(rng.uniform(0, 1, (COUNT, 1)))
    with tree_on(device, loose_triangles(rng)) as tree:
        ordered, unordered = steps(tree, Rays.of(origins, unit(aims - origins)))
    print(f"loose triangles, ordered and not: {ordered:.2f} {unordered:.2f}")
    assert ordered <= 17.0
    assert ordered < 0.55 * unordered


@pytest.mark.parametrize("levels", [1, 2, 20])
def test_a_deep_tree_has_room(device: Device, levels: int) -> None:
    """Each level of the tree is one entry of the stack, whatever the order: the definition's hits, to the bit."""
    rng = np.random.default_rng(72)
    size = 2.0 ** -np.arange(8 * levels)[:, None, None]
    corners = rng.uniform(0.5, 1, (8 * levels, 3, 3)) * size * 1e6
    scene = flat_scene(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    aims = corners[rng.integers(len(corners), size=1024)].mean(axis=1)
    origins = np.tile([-1e6, -2e6, -1.5e6], (1024, 1)) * rng.uniform(0.5, 1.5, (1024, 3))
    with tree_on(device, scene) as tree:
        rays = Rays.of(origins, unit(aims - origins))
        found, defined = trace(tree, rays, 1), trace_every_leaf(tree, rays)
    assert found.distances.tobytes() == defined.distances.tobytes()
    assert np.array_equal(found.primitives, defined.primitives)
