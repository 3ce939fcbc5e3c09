"""A tree that is made to fit what has moved: sound, watertight, and the same where nothing has."""

from __future__ import annotations

from collections import Counter
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from kernel_support import Rays, Tree, finds_what_leaves_hold, flat_scene, trace, tree_on
from meshes import CLOSED, aimed, inside
from test_tree import NAMES, scene_named, through
from tree_reference import check, download

import clrender
from clrender import layout
from clrender.device import Device, bvh
from clrender.device.scene_arrays import SceneArrays
from clrender.errors import ClrenderError, RenderError, UsageError
from clrender.flatten.flat_scene import flatten

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from clrender.flatten.flat_scene import FlatScene

Points = npt.NDArray[np.float64]


@contextmanager
def refitted(device: Device, before: FlatScene, after: FlatScene) -> Iterator[Tree]:
    """The tree over a scene, made to fit another."""
    arrays = {name: device.upload(after.arrays[name]) for name in bvh.SOURCE_NAMES}
    source = bvh.SourceArrays.of(arrays, after.triangle_count, after.analytic_count)
    with tree_on(device, before) as tree:
        bvh.refit(device, source, tree.bvh, np.zeros((0, 6), np.float32))
        for buffer in arrays.values():
            device.release(buffer)
        yield tree


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=() if each == "mixed" else pytest.mark.long) for each in NAMES]
)
def test_where_nothing_moves_the_tree_stays(device: Device, name: str) -> None:
    scene = scene_named(name)
    with tree_on(device, scene) as built, refitted(device, scene, scene) as fitted:
        ours, theirs = download(fitted), download(built)
        for a, b in ((ours.nodes, theirs.nodes), (ours.triangle_packs, theirs.triangle_packs)):
            np.testing.assert_array_equal(a.view(np.uint32), b.view(np.uint32))
        np.testing.assert_array_equal(ours.analytic_packs.view(np.uint32), theirs.analytic_packs.view(np.uint32))
        assert bvh.cost(device, fitted.bvh) == bvh.cost(device, built.bvh)


def deformed(points: Points, amount: float) -> Points:
    """Bent, turned and swollen, differently everywhere; what is near the middle stays near it."""
    x, y, z = points.T
    moved = np.stack(
        [x + amount * np.sin(3.0 * y), y + amount * np.cos(2.0 * z) - amount, z + amount * np.sin(2.0 * x)], 1
    )
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    return np.asarray(moved @ turn * (1.0 + amount))


def moved(name: str, amount: float) -> tuple[FlatScene, FlatScene, Points, npt.NDArray[Any]]:
    points, faces = CLOSED[name]
    after = deformed(points, amount).astype(np.float32)
    return flat_scene(points.astype(np.float32), faces), flat_scene(after, faces), after.astype(np.float64), faces


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=() if each == "bumpy" else pytest.mark.long) for each in CLOSED]
)
def test_a_refitted_tree_is_sound(device: Device, name: str) -> None:
    """And both traversals find in it what every leaf holds."""
    before, after, _, _ = moved(name, 0.1)
    with tree_on(device, before) as tree:
        paired = download(tree).triangle_packs[:, -1].copy().view(np.uint32)
    if ((paired & 0xC0000000) == 0xC0000000).any() or name == "box":
        pytest.skip("its parallelograms are none any more")
    with refitted(device, before, after) as tree:
        check(download(tree), after)
        assert finds_what_leaves_hold(tree, through(after, 512))


def escaped(device: Device, amount: float, count: int, seed: int) -> int:
    """Rays that escape from a closed mesh whose tree was refitted, of a third each at random, at edges, at vertices."""
    rng, lost = np.random.default_rng(seed), 0
    before, after, points, faces = moved("bumpy", amount)
    with refitted(device, before, after) as tree:
        for kind in ("random", "edges", "vertices"):
            origins = (0.5 * inside(count // 3, rng)).astype(np.float32)
            hits = trace(tree, Rays.of(origins, aimed(points, faces, origins.astype(np.float64), kind, rng)))
            lost += int((hits.primitives == layout.NONE).sum() + (~hits.occluded).sum())
    return lost


@pytest.mark.parametrize("millions", [pytest.param(0.1), pytest.param(10, marks=pytest.mark.slow)])
def test_nothing_escapes_from_a_refitted_tree(device: Device, millions: float) -> None:
    for number, amount in enumerate((0.02, 0.05, 0.1, 0.15, 0.2)):
        for part in range(max(1, round(millions))):
            assert escaped(device, amount, round(2e5 * min(millions, 1.0)), 50 + 100 * number + part) == 0, amount


def wave(phase: float, side: int = 24, shift: float | None = None) -> clrender.Scene:
    """A cloth in waves below a lamp and a ball of glass, and two times a ball and a box in instances."""
    shift = 0.1 * phase if shift is None else shift
    x, z = np.meshgrid(np.linspace(-2.0, 2.0, side), np.linspace(-2.0, 2.0, side + 3))
    y = 0.3 * np.sin(3.0 * x + phase) * np.cos(2.1 * z + phase)
    corner = np.arange(x.size).reshape(x.shape)
    quads = [corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, :-1], corner[1:, 1:], corner[:-1, 1:]]
    cloth = {
        "type": "mesh",
        "vertices": np.stack([x, y, z], -1).reshape(-1, 3).tolist(),
        "faces": np.stack(quads, -1).reshape(-1, 3).tolist(),
        "material": "grey",
    }
    ball = {"type": "sphere", "center": [0, 0, 0], "radius": 0.2, "material": "glass"}
    box = {"type": "box", "center": [0.0, 0.4, 0.0], "size": [0.2, 0.2, 0.2], "material": "grey"}
    instances = [
        {"type": "instance", "group": "toys", "transform": {"translate": [at + shift, 0.7, at]}} for at in (-1.0, 1.0)
    ]
    return clrender.Scene(
        camera={"position": [0.0, 2.5, 5.0], "target": [0.0, 0.0, 0.0]},
        materials={
            "grey": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]},
            "glass": {"type": "dielectric", "ior": 1.5},
        },
        groups={"toys": {"shapes": [ball, box]}},
        shapes=[
            cloth,
            *instances,
            {"type": "quad", "origin": [-1, 3, -1], "edge_u": [2, 0, 0], "edge_v": [0, 0, 2], "emission": [5, 5, 5]},
            {"type": "sphere", "center": [0.5 * phase, 1.0, 0.0], "radius": 0.3, "material": "glass"},
        ],
    )


def rows_of(device: Device, arrays: SceneArrays) -> dict[str, npt.NDArray[np.uint32]]:
    """All that kernels read of a scene without smooth shapes, but the trees and the references to them."""
    found = {}
    for name, buffer in arrays.buffers.items():
        if (
            ("node" in name and "light" not in name)
            or "pack" in name
            or name in ("chain_table", "camera", "normal_rows")
        ):
            continue
        words = np.empty(buffer.nbytes // 4, np.uint32)
        device.read(buffer, words)
        if name == "instance_rows":
            words.reshape(-1, 16)[::2, [layout.columns("INSTANCE")[each] for each in ("ROOT", "MASKED_ROOT")]] = 0
        found[name] = words
    return found


def test_arrays_become_those_of_the_other_scene(device: Device) -> None:
    first, second = (flatten(wave(phase), 32, 24) for phase in (0.2, 0.5))
    before = device.buffers
    arrays, other = SceneArrays(device, first), SceneArrays(device, second)
    fitted = arrays.refit(second)
    if not fitted:  # some two triangles of the cloth were a parallelogram by chance
        apart = arrays.apart
        assert apart.any() and not apart.all()
        arrays.release()
        arrays = SceneArrays(device, first, apart=apart)
        assert arrays.refit(second)
    ours, theirs = rows_of(device, arrays), rows_of(device, other)
    assert ours.keys() == theirs.keys()
    for name, words in ours.items():
        np.testing.assert_array_equal(words, theirs[name], name)
    arrays.release()
    other.release()
    assert device.buffers == before


def test_pairs_that_break_are_told_from_then_on(device: Device) -> None:
    flat = [flatten(wave(phase, side=3), 32, 24) for phase in (0.0, 0.0, 0.4)]
    bent = flat[1].arrays["vertices"].copy()
    flat[1].arrays["vertices"][:] = np.where(np.arange(len(bent))[:, None] < 18, [1.0, 0.0, 1.0] * bent, bent)  # flat
    arrays = SceneArrays(device, flat[1])
    assert not arrays.refit(flat[2]) and arrays.apart.tolist()[0] and not arrays.apart.all()
    apart = arrays.apart
    arrays.release()
    arrays = SceneArrays(device, flat[1], apart=apart)
    assert arrays.refit(flat[2]) and arrays.refit(flat[1]) and arrays.refit(flat[0])
    arrays.release()


def test_what_is_no_movement_is_built(device: Device) -> None:
    flat = flatten(wave(0.2), 32, 24)
    arrays = SceneArrays(device, flat)
    assert not arrays.refit(flatten(wave(0.2, side=25), 32, 24)), "more triangles"
    assert not arrays.refit(flatten(clrender.load("room"), 32, 24)), "another scene"
    arrays.release()


def test_a_tree_that_becomes_much_worse_is_built(device: Device) -> None:
    rng = np.random.default_rng(74)
    faces = np.arange(3 * 4000).reshape(-1, 3)
    small = rng.normal(size=(4000, 1, 3)) + 0.01 * rng.normal(size=(4000, 3, 3))
    there, mixed = (
        flat_scene(each.reshape(-1, 3).astype(np.float32), faces) for each in (small, rng.permutation(small))
    )
    with tree_on(device, there) as tree:
        built = bvh.cost(device, tree.bvh)
    with refitted(device, there, mixed) as tree:
        check(download(tree), mixed)
        assert bvh.cost(device, tree.bvh) > 3.0 * built


def test_a_session_refits(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """The images of a moving scene are those of sessions of their own, but for roundings of distances."""
    launched: Counter[str] = Counter()
    launch = Device.launch

    def counting(self: Device, program: Any, kernel: str, *more: Any) -> None:
        launched[kernel] += 1
        launch(self, program, kernel, *more)

    monkeypatch.setattr(Device, "launch", counting)
    how: dict[str, Any] = {"size": (64, 48), "spp": 16, "code": "fast"}
    with clrender.Session(device, refit=True) as session:
        for number, phase in enumerate((0.2, 0.5, 0.8, 1.1)):
            scene = wave(phase)
            image = session.render(scene, **how)
            fresh = clrender.render(scene, device=device, **how)
            different = (image.linear != fresh.linear).any(axis=2).mean()
            print(f"phase {phase}: {different:.3%} of the pixels differ")
            assert different < 0.05
            assert image.film.request == {**fresh.film.request, "refit": True}
            if number == 1:
                launched.clear()
        assert launched["refit_nodes"] > 0
        own = launched["build_merge"]
        launched.clear()
        clrender.render(wave(0.8), device=device, **how)
        clrender.render(wave(1.1), device=device, **how)
        assert launched["build_merge"] == own, "of the session's two last images none built a tree"


def test_such_images_are_not_verified_or_merged(device: Device, tmp_path: Path) -> None:
    with clrender.Session(device, refit=True) as session:
        image = session.render(wave(0.3), size=(16, 12), spp=2, samples=(0, 1))
    for name in ("image.film", "image.exr", "image.png"):
        image.save(tmp_path / name)
        with pytest.raises(UsageError, match="session that refits BVHs"):
            clrender.verify(tmp_path / name)
    other = clrender.render(wave(0.3), device=device, size=(16, 12), spp=2, samples=(1, 2))
    with pytest.raises(UsageError, match="differ in refit"):
        image.film.merge(other.film)


def test_instances_that_move_far_are_found(device: Device) -> None:
    how: dict[str, Any] = {"size": (96, 72), "spp": 4, "code": "fast"}
    with clrender.Session(device, refit=True) as session:
        still = session.render(wave(0.3, shift=-0.9), **how)
        image = session.render(wave(0.3, shift=0.6), **how)
    fresh = clrender.render(wave(0.3, shift=0.6), device=device, **how)
    assert (image.linear != still.linear).any(axis=2).mean() > 0.05
    assert (image.linear != fresh.linear).any(axis=2).mean() < 0.005


def test_a_scene_that_becomes_much_worse_is_built(device: Device) -> None:
    rng = np.random.default_rng(75)
    small = rng.normal(size=(600, 1, 3)) + 0.01 * rng.normal(size=(600, 3, 3))
    mesh = {"type": "mesh", "faces": np.arange(1800).reshape(-1, 3).tolist()}
    there, near, mixed = (
        flatten(wave(0.1).changed({("shapes", 0): {**mesh, "vertices": each.reshape(-1, 3).tolist()}}), 8, 8)
        for each in (small, small * 1.01, rng.permutation(small))
    )
    arrays = SceneArrays(device, there)
    assert arrays.refit(near) and not arrays.refit(mixed)
    arrays.release()


def test_several_devices_do_not_refit(device: Device) -> None:
    with clrender.Session([device, "pocl"], refit=True) as session, pytest.raises(UsageError, match="for one device"):
        session.render(wave(0.1), size=(8, 8), spp=1)


def test_a_refit_that_fails_leaves_nothing_behind(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    how: dict[str, Any] = {"size": (16, 12), "spp": 1, "code": "fast"}
    with clrender.Session(device, refit=True) as session:
        right = session.render(wave(0.4, shift=0.0), **how).stats["image_sha256"]
        held = sum(buffer.nbytes for buffer in device.buffers)
        with monkeypatch.context() as patched, pytest.raises(ClrenderError, match="is lost"):

            def lost(*_: Any) -> None:
                raise RenderError("the device is lost")

            patched.setattr(bvh, "refit", lost)
            session.render(wave(0.4, shift=0.5), **how)
        assert sum(buffer.nbytes for buffer in device.buffers) < held
        assert session.render(wave(0.4, shift=0.0), **how).stats["image_sha256"] == right
