"""Groups that are the same in the next scene keep their trees, which have the bits of new ones."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
import pytest

import clrender
from clrender.device import Device, bvh
from clrender.device.scene_arrays import SceneArrays
from clrender.flatten.flat_scene import flatten
from clrender.scene import Scene

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from clrender.device.scene_trees import SceneTrees

_Table = dict[str, Any]

CAMERA = {"position": [0.0, 0.5, 6.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 40.0}
MATERIALS = {
    "grey": {"type": "lambert", "reflectance": [0.5] * 3},
    "net": {"type": "lambert", "reflectance": [0.7] * 3, "opacity": 0.5},
}
GRID = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), 2).reshape(-1, 2)
GROUPS: dict[str, list[_Table]] = {
    "hill": [
        {
            "type": "mesh",
            "vertices": [[x / 8.0 - 0.5, 0.1 * ((3 * x + 5 * y) % 4), y / 8.0 - 0.5] for x, y in GRID.tolist()],
            "faces": [
                face
                for i in range(8)
                for j in range(8)
                for a in [9 * i + j]
                for face in ([a, a + 1, a + 9], [a + 1, a + 10, a + 9])
            ],
            "material": "grey",
        }
    ],
    "block": [{"type": "box", "size": [0.5, 0.3, 0.4], "material": "grey"}],
    "balls": [
        {"type": "sphere", "center": [0.3 * k, 0.0, 0.1 * k], "radius": 0.2, "material": "grey"} for k in range(3)
    ],
    "mixed": [
        {"type": "box", "size": [0.3, 0.5, 0.4], "material": "net"},
        {"type": "disk", "center": [0.0, 0.5, 0.0], "normal": [0.0, 1.0, 0.0], "radius": 0.3, "material": "net"},
        {"type": "sphere", "center": [0.0, -0.4, 0.0], "radius": 0.2, "material": "grey"},
    ],
}
LAMP = {"type": "quad", "origin": [-1, 3, -1], "edge_u": [2, 0, 0], "edge_v": [0, 0, 2], "emission": [4.0, 4.0, 4.0]}
FLOOR = {"type": "box", "center": [0.0, -1.1, 0.0], "size": [6.0, 0.2, 6.0], "material": "grey"}


def scene_of(*placed: str, own: int = 1, turn: float = 0.0, **groups: list[_Table]) -> Scene:
    """Groups in this order, each in a place of its own; and a floor, cut in so many."""
    instances = [
        {
            "type": "instance",
            "group": name,
            "transform": {
                "rotate_degrees": [0.0, turn + 20.0 * at, 0.0],
                "translate": [1.2 * at - 2.0, 0.2 * turn / 90.0, 0.0],
            },
        }
        for at, name in enumerate(placed)
    ]
    floors = [{**FLOOR, "center": [0.0, -1.1 - 0.3 * n, 0.0]} for n in range(own)]
    tables = {name: {"shapes": shapes} for name, shapes in {**GROUPS, **groups}.items()}
    return Scene.model_validate(
        {"camera": CAMERA, "materials": MATERIALS, "groups": tables, "shapes": [*floors, LAMP, *instances]}
    )


@contextmanager
def on(device: Device, scene: Scene, earlier: SceneTrees | None = None) -> Iterator[SceneArrays]:
    arrays = SceneArrays(device, flatten(scene, 32, 24), earlier=earlier)
    yield arrays
    arrays.release()


def told(device: Device, arrays: SceneArrays) -> list[bytes]:
    """All that traversal reads, without what lies behind the last packs."""
    found = []
    for tree in (arrays.tree, arrays.masked_tree):
        if tree is None:
            continue
        widths = (bvh.NODE_WORDS, bvh.TRIANGLE_BLOCK_WORDS, bvh.ANALYTIC_BLOCK_WORDS)
        for buffer, width, count in zip(tree.buffers, widths, tree.counts, strict=True):
            words = np.empty(max(width * count, 1), np.uint32)
            if count:
                device.read(buffer, words)
            found.append(words[: width * count].tobytes())
        found.append(repr((tree.counts, tree.levels, tree.ranges)).encode())
    rows = np.empty_like(arrays._scene.instances.rows)
    device.read(arrays.buffers["instance_rows"], rows)
    return [*found, rows.tobytes()]


FIRST = ("hill", "block", "balls", "mixed")


@pytest.mark.parametrize(
    ("second", "kept"),
    [
        pytest.param(scene_of(*FIRST, turn=35.0), 4, id="moved"),
        pytest.param(scene_of("mixed", "balls", "block", "hill"), 4, id="in another order"),
        pytest.param(scene_of("block", "mixed", own=3), 2, id="fewer, and more shapes before them"),
        pytest.param(scene_of("hill", "hill", "hill", *FIRST, own=0), 4, id="more often, and nothing before them"),
        pytest.param(
            scene_of(*FIRST, block=[{"type": "box", "size": [0.5, 0.3, 0.41], "material": "grey"}]), 3, id="size"
        ),
        pytest.param(scene_of("hill", "mixed", mixed=[{**GROUPS["mixed"][0], "material": "grey"}]), 1, id="not masked"),
        pytest.param(
            scene_of("hill", hill=[{**GROUPS["hill"][0], "transform": {"scale": 2.0}}]), None, id="all others"
        ),
        pytest.param(scene_of(), None, id="none"),
    ],
)
def test_groups_keep_trees_of_the_same_bits(device: Device, second: Scene, kept: int | None) -> None:
    with on(device, second) as arrays:
        anew = told(device, arrays)
    held = device.buffers
    with on(device, scene_of(*FIRST)) as first:
        trees = first.trees_for(flatten(second, 32, 24))
    assert (trees is None) == (kept is None)
    if trees is None or kept is None:
        assert device.buffers == held
        return
    with patch.object(bvh, "build_over", wraps=bvh.build_over) as build, on(device, second, trees) as arrays:
        assert told(device, arrays) == anew
        built = [call.args for call in build.call_args_list if len(call.args) < 5 or call.args[4] is None]
        columns = 1 if arrays.masked_tree is None else 2
        groups = {instance.group for _, instance in second.instances()}
        assert len({args[2].tobytes() + args[3].tobytes() for args in built}) >= len(groups) - kept
        assert len(built) <= columns * (len(groups) - kept)
    trees.release()
    assert device.buffers == held, "all memory is given back"


NEST: _Table = {"type": "box", "size": [0.5, 0.5, 0.5], "material": "grey"}
INSIDE: _Table = {"type": "box", "size": [0.2, 0.2, 0.2], "material": "grey"}
BALL: _Table = {"type": "sphere", "center": [1.5, -0.5, 1.0], "radius": 0.3, "material": "grey"}


@pytest.mark.parametrize(
    ("first", "second", "built"),
    [
        (scene_of(), scene_of().changed({"materials.grey.reflectance": [0.1, 0.2, 0.3]}), 0),
        (scene_of(*FIRST), scene_of(*FIRST).changed({"materials.grey.reflectance": [0.1, 0.2, 0.3]}), 0),
        (scene_of(), scene_of(own=2), 1),
        (scene_of(), scene_of().changed({("shapes", 0, "center"): [0.0, -1.2, 0.0]}), 1),
        # The ball's number is other where a group has more triangles; its box is the same
        (
            scene_of("nest", nest=[NEST]).changed({"shapes": [BALL, *scene_of("nest", nest=[NEST]).shapes]}),
            scene_of("nest", nest=[NEST, INSIDE]).changed({"shapes": [BALL, *scene_of("nest", nest=[NEST]).shapes]}),
            1,
        ),
    ],
    ids=["a material", "a material, with groups", "more shapes", "moved", "more in a group"],
)
def test_shapes_outside_of_groups_keep_their_tree(device: Device, first: Scene, second: Scene, built: int) -> None:
    """With the bits of a new one, where these shapes and the places of instances are the same."""
    with on(device, second) as arrays:
        anew = told(device, arrays)
    held = device.buffers
    with on(device, first) as arrays:
        trees = arrays.trees_for(flatten(second, 32, 24))
    with patch.object(bvh, "build_over", wraps=bvh.build_over) as build, on(device, second, trees) as arrays:
        assert told(device, arrays) == anew
    assert build.call_count == built
    if trees is not None:
        trees.release()
    assert device.buffers == held, "all memory is given back"


def test_large_arrays_stay_on_the_device(device: Device) -> None:
    """Only lights differ: what is large is not uploaded again, and the image is that of a new session."""
    grid = np.stack(np.meshgrid(np.arange(50.0), [0.0], np.arange(50.0)), -1).reshape(-1, 3) / 25.0 - 1.0
    grid[:, 1] = np.random.default_rng(2).uniform(-0.1, 0.1, len(grid)) - 0.9
    corner = np.arange(2500).reshape(50, 50)
    a, b, c, d = (corner[i : i + 49, j : j + 49].reshape(-1) for i in (0, 1) for j in (0, 1))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    textured = {"type": "lambert", "reflectance": {"texture": "t.png"}}
    mesh = {"type": "mesh", "file": "m.ply", "material": "m"}
    scene = scene_of("block").changed({"materials": {**MATERIALS, "m": textured}})
    scene = scene.changed({"shapes": [mesh, *scene.shapes]})
    picture = np.random.default_rng(4).integers(0, 255, (200, 200, 3), np.uint8)

    def with_arrays(other: Scene, vertices: NDArray[np.float64], texels: NDArray[np.uint8]) -> Scene:
        meshes = {"m.ply": {"vertices": vertices, "faces": faces, "uvs": grid[:, [0, 2]]}}
        return other.with_arrays(meshes=meshes, textures={"t.png": texels})

    other, scene = scene, with_arrays(scene, grid, picture)
    lamps = [{"type": "point", "position": [0.0, 1.0, 2.0 + x], "intensity": [9.0] * 3} for x in range(3)]
    scenes = [scene.changed({"lights": [lamp]}) for lamp in lamps]
    apart = [image_of(each, device) for each in scenes]
    held = device.buffers
    kept = []
    with clrender.Session(device) as session:
        found = []
        for each in scenes:
            found.append(session.render(each, size=(48, 32), spp=2).stats["image_sha256"])
            kept.append({id(buffer) for buffer in device.buffers if buffer.nbytes >= 1 << 16})
    assert found == apart and len(set(found)) == 3
    assert len(kept[0] & kept[1] & kept[2]) >= 3, "rows of primitives, attributes and texels"
    assert device.buffers == held
    # What differs, even in its last numbers, is not taken over
    lower = grid.copy()
    lower[-60:, 1] -= 0.3
    dark = {**scene.materials, "m": {"type": "lambert", "reflectance": [0.1, 0.2, 0.3]}}
    changed = [with_arrays(other, lower, picture), with_arrays(other, grid, 255 - picture)]
    changed.append(scene.changed({"materials": dark}))
    for each in changed:
        with clrender.Session(device) as session:
            session.render(scene, size=(48, 32), spp=2)
            then = session.render(each, size=(48, 32), spp=2).stats["image_sha256"]
        assert then == image_of(each, device)


def test_sessions_keep_them(device: Device) -> None:
    scenes = [scene_of(*FIRST, turn=10.0 * k, own=1 + k % 2) for k in range(3)]
    with clrender.Session(device) as session:
        apart = [image_of(each, device) for each in scenes]
        with patch.object(bvh, "build_over", wraps=bvh.build_over) as build:
            several = [session.render(each, size=(48, 32), spp=2).stats["image_sha256"] for each in scenes]
    assert several == apart and len(set(apart)) == 3
    assert build.call_count == 2 + 5 + 2 + 2  # over the whole, opaque and masked; and once over each part of a group


def image_of(scene: Scene, device: Device) -> str:
    with clrender.Session(device) as session:
        return str(session.render(scene, size=(48, 32), spp=2).stats["image_sha256"])


def test_trees_that_were_refitted_are_not_kept(device: Device) -> None:
    first, second = scene_of(*FIRST), scene_of(*FIRST, turn=35.0)
    with on(device, first) as arrays:
        assert arrays.refit(flatten(second, 32, 24))
        assert arrays.trees_for(flatten(first, 32, 24)) is None
