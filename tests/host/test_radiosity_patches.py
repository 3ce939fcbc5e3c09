"""Scenes cut into patches, without a device: sizes, areas, edges, and what is seen at corners."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import clrender
from clrender.flatten.surfaces import flat_surfaces
from clrender.radiosity.corners import Corners
from clrender.radiosity.factors import factors_of_hits
from clrender.radiosity.patches import Patches, cut_into_patches
from clrender.radiosity.sides import sealed_sides

CAMERA = {"position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0]}
GREY = {"grey": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}}


def scene(*shapes: dict[str, Any], **more: Any) -> clrender.Scene:
    painted = tuple({"material": "grey", **shape} for shape in shapes)
    return clrender.Scene(camera=CAMERA, materials=GREY, shapes=painted, **more)


SQUARE = {"type": "quad", "origin": [0, 0, 0], "edge_u": [2, 0, 0], "edge_v": [0, 1, 0]}
BALL = {"type": "sphere", "radius": 1.5}
DISK = {"type": "disk", "normal": [0, 1, 0], "radius": 2.0, "center": [0, 3, 0]}


@pytest.mark.parametrize("name", ["room-diffuse", "cornell", "inside-sphere", "bumpy"])
@pytest.mark.parametrize("count", [500, 3000])
def test_about_as_many_as_wanted_and_no_area_lost(name: str, count: int) -> None:
    what = clrender.load(name)
    if name == "bumpy":
        with pytest.raises(clrender.SceneError, match=r"of type (mirror|dielectric), which the integrator radiosity"):
            cut_into_patches(what, count)
        return
    patches = cut_into_patches(what, count)
    assert 0.4 * count < len(patches) < 2.1 * count
    coarse = cut_into_patches(what, 300)
    assert patches.areas.sum() == pytest.approx(coarse.areas.sum(), rel=1e-6)
    assert (np.diff(patches.shape) >= 0).all()
    flat = patches.flat(8, 8)
    assert flat.triangle_count == len(patches) and flat.analytic_count == 0


@pytest.mark.parametrize(("shape", "area"), [(SQUARE, 2.0), (BALL, 9.0 * math.pi), (DISK, 4.0 * math.pi)])
def test_round_things_keep_their_area(shape: dict[str, Any], area: float) -> None:
    patches = cut_into_patches(scene(shape), 1000)
    assert patches.areas.sum() == pytest.approx(area, rel=1e-6)
    assert patches.areas.max() < 6.0 * patches.areas.mean()


def test_fronts_stay_fronts() -> None:
    for flipped in (False, True):
        ball = cut_into_patches(scene({**BALL, "flip_normals": flipped}), 400)
        outward = (ball.normals * ball.centers).sum(axis=1)
        assert (outward < 0.0).all() if flipped else (outward > 0.0).all()
        disk = cut_into_patches(scene({**DISK, "flip_normals": flipped}), 400)
        np.testing.assert_allclose(disk.normals[:, 1], -1.0 if flipped else 1.0, atol=1e-9)


def test_halves_are_halves_and_stay_beside_each_other() -> None:
    patches = cut_into_patches(scene(SQUARE, BALL), 500)
    which = np.arange(len(patches)) % 3 == 0
    finer = patches.bisected(which)
    assert len(finer) == len(patches) + which.sum()
    parents = np.repeat(np.arange(len(patches)), np.where(which, 2, 1))
    np.testing.assert_allclose(np.bincount(parents, finer.areas), patches.areas, rtol=1e-12)
    np.testing.assert_allclose(finer.areas, patches.areas[parents] / np.where(which, 2, 1)[parents], rtol=1e-12)
    np.testing.assert_allclose(finer.normals, patches.normals[parents], atol=1e-9)


def test_what_moves_is_one_shape() -> None:
    patches = cut_into_patches(scene(SQUARE, BALL), 500)
    first, end = patches.sides_of(1)
    moved = patches.moved(1, (1.0, 2.0, 3.0))
    np.testing.assert_array_equal(moved.corners[: first // 2], patches.corners[: first // 2])
    assert end == 2 * len(patches)
    step = moved.corners[first // 2 :] - patches.corners[first // 2 :]
    np.testing.assert_allclose(step, np.broadcast_to([1.0, 2.0, 3.0], step.shape), rtol=1e-12)


def straight(patches: Patches) -> Any:
    return np.stack([patches.centers[:, 0], np.ones(len(patches)), patches.centers[:, 1]], axis=1)


def test_corners_of_an_evenly_bright_surface_are_as_bright() -> None:
    patches = cut_into_patches(scene(SQUARE, BALL), 500)
    corners = Corners(patches.bisected(np.arange(len(patches)) % 2 == 0))
    patches = patches.bisected(np.arange(len(patches)) % 2 == 0)
    used = np.ones(len(patches), bool)
    values = corners.values(straight(patches), used)
    np.testing.assert_allclose(values[:, :, 1], 1.0, rtol=1e-12)
    even = np.ones((len(patches), 3))
    np.testing.assert_allclose(corners.contrast(even, used), 0.0, atol=1e-12)
    assert corners.contrast(straight(patches), used).min() >= 0.0


def test_no_step_at_a_corner_in_the_middle_of_an_edge() -> None:
    """Two triangles of a square, one of them halved: along their common edge both are equally bright."""
    patches = cut_into_patches(scene({**SQUARE, "edge_u": [1, 0, 0]}), 2)
    assert len(patches) == 2
    finer = patches.bisected(np.array([True, False]))
    values = Corners(finer).values(straight(finer), np.ones(3, bool))
    middle = np.array([0.5, 0.5, 0.0])
    there = np.abs(finer.corners - middle).max(axis=2) < 1e-9
    ends = values[2][np.abs(finer.corners[2][:, 0] - finer.corners[2][:, 1]) < 1e-9]
    assert there.sum() == 2 and len(ends) == 2
    np.testing.assert_allclose(values[there], np.broadcast_to(ends.mean(axis=0), (2, 3)), rtol=1e-12)


def test_a_crease_is_not_smoothed_over() -> None:
    box = cut_into_patches(scene({"type": "box", "size": [1, 1, 1]}), 12)
    bright = np.where(box.normals[:, 1:2] > 0.5, 1.0, 0.0) * np.ones(3)
    values = Corners(box).values(bright, np.ones(len(box), bool))
    assert set(np.unique(values)) == {0.0, 1.0}


def test_the_inside_of_what_is_closed_is_sealed() -> None:
    outside = cut_into_patches(scene(SQUARE, BALL), 300)
    sealed = sealed_sides(outside)
    first, end = outside.sides_of(1)
    assert sealed[first + 1 : end : 2].all() and sealed.sum() == (end - first) // 2
    lamp = {"type": "point", "position": [0.5, 0.0, 0.0], "intensity": [1, 1, 1]}
    for open_ in (
        scene(SQUARE, {**BALL, "flip_normals": True}),
        scene(SQUARE, {**BALL, "center": [0, 0, 4.5]}),
        scene({**SQUARE, "emission": [1, 1, 1]}, BALL),
        scene(SQUARE, BALL, lights=(lamp,)),
    ):
        assert not sealed_sides(cut_into_patches(open_, 300)).any()


def test_rays_counted() -> None:
    hits = np.array([[3, 1, 3, 4], [0, 0, 0, 0]], np.uint32)
    factors = factors_of_hits(np.array([0, 2], np.uint32), hits, 5)
    assert factors.row.tolist() == [0, 0, 0, 1] and factors.column.tolist() == [1, 3, 4, 0]
    assert factors.value.tolist() == [0.25, 0.5, 0.25, 1.0]
    np.testing.assert_allclose(factors.row_sums(), [0.75, 1.0])
    sent = np.arange(10.0).reshape(5, 2)
    wanted = np.array([[0.25 * 2 + 0.5 * 6 + 0.25 * 8, 0.25 * 3 + 0.5 * 7 + 0.25 * 9], [0.0, 1.0]])
    np.testing.assert_allclose(factors.gathered(sent), wanted)


@pytest.mark.parametrize(
    "transform",
    [
        {"scale": 2.0, "rotate_degrees": [10, 20, 30], "translate": [1, 2, 3]},
        {"matrix": [[0, -2, 0, 1], [2, 0, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]]},
    ],
    ids=["steps", "matrix"],
)
@pytest.mark.parametrize("shape", [SQUARE, BALL, DISK], ids=["square", "ball", "disk"])
def test_what_moved_has_moved_in_the_scene_too(shape: dict[str, Any], transform: dict[str, Any]) -> None:
    by = (0.5, -0.25, 4.0)
    patches = cut_into_patches(scene(SQUARE, {**shape, "transform": transform}), 60)
    moved = patches.moved(1, by)
    whole, before = flat_surfaces(moved.scene), flat_surfaces(patches.scene)
    step = np.where(np.arange(len(whole.vertices))[:, None] < 4, 0.0, by)  # the first square stays
    np.testing.assert_allclose(whole.vertices, before.vertices + step, atol=1e-5)
    for now, old in zip(whole.analytic_shapes["center_radius"], before.analytic_shapes["center_radius"], strict=True):
        np.testing.assert_allclose(now, old + np.array([*by, 0.0]), atol=1e-5)
    np.testing.assert_allclose(moved.corners[moved.shape == 1], patches.corners[patches.shape == 1] + np.array(by))
    assert np.array_equal(moved.corners[moved.shape == 0], patches.corners[patches.shape == 0])
