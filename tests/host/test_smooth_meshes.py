"""Vertex normals by the angles between faces: which corners share one, and what becomes of such meshes in scenes."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError
from clrender.exporters.own import exported, scene_text
from clrender.flatten.flat_scene import flatten
from clrender.meshes.data import MeshData
from clrender.meshes.smooth import smoothed
from clrender.scene.portable import scene_from_portable, scene_to_portable

CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE = np.array([corners for a, b, c, d in QUADS for corners in ((a, b, c), (a, c, d))], np.uint32)
CAMERA = {"position": [0.0, 1.0, 5.0], "target": [0.0, 0.0, 0.0]}


def shared(mesh: MeshData, angle: float) -> int:
    """How many vertices there are with normals of their own."""
    made = smoothed(mesh, angle)
    assert made.normals is not None and not made.normals.any()
    np.testing.assert_array_equal(made.vertices[made.triangles], mesh.vertices[mesh.triangles])
    assert smoothed(made, angle).sha256() == made.sha256(), "once is enough"
    return len(made.vertices)


@pytest.mark.parametrize(("angle", "count"), [(30.0, 24), (89.99, 24), (90.0, 8), (180.0, 8)])
@pytest.mark.parametrize("soup", [False, True])
def test_edges_of_a_cube_are_sharp_below_a_right_angle(angle: float, count: int, soup: bool) -> None:
    """The two halves of each side join, whether the file lists corners once or for each triangle."""
    mesh = MeshData(CORNERS, CUBE)
    if soup:
        mesh = MeshData(CORNERS[CUBE].reshape(-1, 3), np.arange(36, dtype=np.uint32).reshape(-1, 3))
    assert shared(mesh, angle) == count


def test_a_cone_is_smooth_around_and_sharp_at_its_base() -> None:
    turn = 2.0 * np.pi * np.arange(24) / 24
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(24)], axis=1)
    next_ = (np.arange(24) + 1) % 24
    side = np.stack([np.full(24, 24), np.arange(24), next_], axis=1)
    base = np.stack([np.full(24, 25), next_, np.arange(24)], axis=1)
    points = np.concatenate([ring, [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]])
    mesh = MeshData(points, np.concatenate([side, base]).astype(np.uint32))
    # The ring twice, the tip and the middle
    assert shared(mesh, 60.0) == 24 * 2 + 2
    assert shared(mesh, 5.0) == 24 * 3 + 25, "the sides are 10 degrees apart, and the base is flat"


def test_edges_that_are_no_surface_are_sharp() -> None:
    points = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0.1, 0], [-1, -0.1, 0]], float)
    three = np.array([[0, 1, 2], [1, 0, 3], [1, 0, 4]], np.uint32)
    assert shared(MeshData(points, three), 180.0) == 9, "three triangles have one edge"
    turned = np.array([[0, 1, 2], [0, 1, 3]], np.uint32)
    assert shared(MeshData(points, turned), 180.0) == 6, "one shows its front, the other its back"
    assert shared(MeshData(points, three[:2]), 180.0) == 4


def test_corners_keep_what_they_have() -> None:
    uvs = np.random.default_rng(1).random((12, 3, 2)).astype(np.float32)
    made = smoothed(MeshData(CORNERS, CUBE, uvs=uvs, normals=np.ones((8, 3))), 30.0)
    assert made.uvs is uvs
    assert made.normals is not None and not made.normals.any(), "those of the file are replaced"


def scene_of(**more: Any) -> clrender.Scene:
    turn = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    rings = [
        np.stack([np.sin(a) * np.cos(turn), np.cos(a) + 0 * turn, -np.sin(a) * np.sin(turn)], 1)
        for a in (0.6, 1.2, 1.8)
    ]
    ids = np.arange(96).reshape(3, 32)
    after = np.roll(ids, -1, axis=1)
    faces = np.concatenate(
        [np.stack([ids[k], ids[k + 1], after[k + 1]], 1) for k in (0, 1)]
        + [np.stack([ids[k], after[k + 1], after[k]], 1) for k in (0, 1)]
    )
    shape = {"type": "mesh", "file": "ball", "material": "grey", **more}
    grey = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}
    scene = clrender.Scene(camera=CAMERA, shapes=[shape], materials={"grey": grey})
    return scene.with_arrays(meshes={"ball": {"vertices": np.concatenate(rings), "faces": faces}})


def test_a_coarse_ball_has_the_normals_of_a_ball() -> None:
    flat = flatten(scene_of(smooth_angle=40.0), 8, 8)
    points, normals = flat.arrays["vertices"], flat.arrays["normals"]
    inside = np.abs(points[:, 1] - np.cos(1.2)) < 1e-3  # not at the rims, where triangles lie on one side only
    assert np.count_nonzero(inside) == 32
    assert (np.einsum("ij,ij->i", points[inside], normals[inside]) > 0.995).all()
    assert len(flatten(scene_of(), 8, 8).arrays["normals"]) == 1, "without the key there are none"
    assert len({scene_of(**each).sha256() for each in ({}, {"smooth_angle": 40.0}, {"smooth_angle": 1.0})}) == 3


def test_it_is_computed_once_for_scenes_of_the_same_mesh() -> None:
    scene = scene_of(smooth_angle=40.0)
    red = scene.changed({"materials.grey.reflectance": (0.5, 0.1, 0.1)})
    assert red.mesh(0) is scene.mesh(0)
    other = scene.with_arrays(meshes={"ball": {"vertices": scene_of().mesh(0).vertices * 2.0}})
    assert other.mesh(0) is not scene.mesh(0) and scene_of().mesh(0).normals is None
    np.testing.assert_array_equal(other.mesh(0).vertices, scene.mesh(0).vertices * 2.0)


def test_it_is_exported_with_its_hash(tmp_path: Path) -> None:
    scene = scene_of(smooth_angle=40.0)
    export = exported(scene, "files")
    with export.written(tmp_path / "scene.json"):
        (tmp_path / "scene.json").write_bytes(scene_text(export.description, ".json", "scene"))
    assert clrender.load(tmp_path / "scene.json").sha256() == scene.sha256()
    description, assets = scene_to_portable(scene)
    there = scene_from_portable(description, assets)
    assert there.sha256() == scene.sha256()
    assert flatten(there, 8, 8).sha256 == flatten(scene, 8, 8).sha256


@pytest.mark.parametrize("angle", [0.0, 181.0, float("nan")])
def test_angles_are_checked(angle: float) -> None:
    with pytest.raises(SceneError, match=r"shapes\[0\].smooth_angle"):
        scene_of(smooth_angle=angle)


def test_meshes_that_change_their_form_are_refused() -> None:
    poses = [{"time": 0.0, "file": "a"}, {"time": 1.0, "file": "b"}]
    with pytest.raises(SceneError, match=r"smooth_angle is for meshes that keep their form"):
        scene_of(smooth_angle=40.0, poses=poses)
