"""The benchmark: its scenes, its arithmetic, and peers that are not there or fail."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from cases import for_each
from PIL import Image

import clrender
from clrender.bench import SCENES, Peer, Run, measure, peer_from, summary, write_scene
from clrender.bench.foliage import LEAVES
from clrender.bench.measure import relative_error
from clrender.bench.peers import PEERS, SEGMENTS, Task
from clrender.bench.shapes import torus
from clrender.errors import RenderError, UsageError
from clrender.files.package_data import scenes_folder
from clrender.flatten.flat_scene import flatten
from clrender.image.files import read_image
from clrender.meshes.read import read_mesh

if TYPE_CHECKING:
    from clrender.device import Device

TRIANGLES = {"S1": 28, "S1-tess": 28 + 10240, "S2": 28, "S2-tess": 28 + 10240, "S3-10k": 16 + 9680, "S4": 24 + 1000}


@pytest.mark.parametrize("name", TRIANGLES)
def test_scenes_are_what_they_say(tmp_path: Path, name: str) -> None:
    scene = clrender.load(str(write_scene(name, tmp_path)))
    flat = flatten(scene, 8, 8)
    assert flat.triangle_count == TRIANGLES[name]
    assert flat.analytic_count == (0 if name.endswith("tess") else 2)
    assert flat.light_count == (1000 if name == "S4" else 4)
    assert flat.messages == []
    corners = flat.arrays["vertices"][flat.arrays["triangles"]]
    assert (corners.min((0, 1)) >= [-2.001, -0.001, -2.001]).all()
    assert (corners.max((0, 1)) <= [2.001, 4.001, 6.001]).all()


def test_the_tree_has_leaves_with_holes(tmp_path: Path) -> None:
    """All of them above the ground, of the same picture, which holds about as much leaf as hole."""
    described = json.loads(write_scene("S6", tmp_path).read_text(encoding="utf-8"))
    leaves = read_mesh("leaves.ply", tmp_path, [], "leaves")
    assert leaves.triangles.shape == (2 * LEAVES, 3) and leaves.vertices[:, 1].min() > 0.5
    assert leaves.uvs is not None
    assert np.array_equal(np.unique(leaves.uvs), [0.0, 1.0])
    alpha = np.array(Image.open(tmp_path / "leaf.png"))[..., 3]
    assert set(np.unique(alpha)) == {0, 255} and 0.4 < (alpha > 0).mean() < 0.7
    assert described["materials"]["leaf"]["opacity"]["texture"] == "leaf.png"
    sky = read_image(tmp_path / "sky.exr")
    assert sky.min() > 0.0 and sky.max() > 1e4


def test_the_body_is_closed(tmp_path: Path) -> None:
    """Every edge has a triangle on either side, by position: the faces of the icosahedron share no vertices."""
    flat = flatten(clrender.load(str(write_scene("S3-10k", tmp_path))), 8, 8)
    faces = flat.arrays["triangles"][flat.arrays["primitive_shape"][: flat.triangle_count] == 8]
    assert len(faces) == 9680
    places = np.unique(np.round(flat.arrays["vertices"], 5), axis=0, return_inverse=True)[1].reshape(-1)[faces]
    edges = np.concatenate([places[:, [0, 1]], places[:, [1, 2]], places[:, [2, 0]]])
    forward, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 1).all()
    assert np.array_equal(forward, np.unique(edges[:, ::-1], axis=0))


def test_a_torus_is_closed_and_its_normals_look_outward() -> None:
    points, faces, normals = torus(0.5, (0.03, 0.18), 192, 64)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    forward, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 1).all() and np.array_equal(forward, np.unique(edges[:, ::-1], axis=0))
    corners = points[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert (across[:, None] * normals[faces]).sum(axis=2).min() > 0.9
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    # By Pappus' theorem; of polygons inscribed in the ellipse and in the circle
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    ellipse, circle = (np.sin(2.0 * np.pi / n) / (2.0 * np.pi / n) for n in (64, 192))
    assert volume == pytest.approx(2.0 * np.pi * 0.5 * np.pi * 0.03 * 0.18 * ellipse * circle, rel=1e-3)


@pytest.mark.long
@for_each(("name", "hard"), [("S1", False), ("X1", True), ("X8", True), ("X9", True)])
def test_light_is_hard_to_find_there(device: Device, tmp_path: Path, name: str, hard: bool) -> None:
    """A path sample has more than twice its own mean squared as variance, and less than that in the plain room."""
    scene = clrender.load(str(write_scene(name, tmp_path)))
    assert flatten(scene, 8, 8).messages == []
    with clrender.Session(device) as session:
        images = np.array([session.render(scene, size=(32, 24), spp=16, seed=seed).linear for seed in range(8)])
    mean = images.mean(axis=0)
    relative = 16.0 * images.var(axis=0, ddof=1) / (mean**2 + (0.1 * mean.mean()) ** 2)
    assert mean.mean() > 0.0 and (relative.mean() > 2.0) == hard, relative.mean()


def test_every_scene_has_a_description_and_no_other_is_known(tmp_path: Path) -> None:
    assert all(SCENES.values())
    with pytest.raises(UsageError, match="no benchmark scene 'S9'"):
        write_scene("S9", tmp_path)
    with pytest.raises(UsageError, match="no benchmark scene and no file 'S9'; give a scene file or one of S1, "):
        measure(["S9"], [], Task(8, 8, 1), 1)


def test_a_scene_file_is_measured_beside_a_peer(device: Device, tmp_path: Path) -> None:
    """It is read where it lies, and written for the peer elsewhere."""
    here = tmp_path / "own"
    here.mkdir()
    path = here / "own.toml"
    path.write_text((scenes_folder() / "point-plane.toml").read_text())
    peer = tmp_path / "python"
    peer.write_text(
        '#!/bin/sh\ngrep -q "<scene" "$3" && echo \'{"wall_seconds": 2.0, "cpu_seconds": 2.0, "version": "1"}\'\n'
    )
    peer.chmod(0o755)
    runs = measure([str(path)], [Peer("mitsuba", str(peer))], Task(12, 8, 2), 1, str(device.info.index))
    assert [(run.scene, run.renderer, run.paths) for run in runs] == [
        (str(path), "clrender", 192),
        (str(path), "mitsuba", 192),
    ]
    assert runs[0].details["mean"] != [0.0, 0.0, 0.0]
    assert [file.name for file in here.iterdir()] == ["own.toml"]
    with pytest.raises(UsageError, match=r"embree reads only the scenes of this benchmark, not .*own.toml; leave it"):
        Peer("embree", str(peer)).run(path, Task(8, 8, 1), tmp_path / "image.npy")


def run(renderer: str, repeat: int, cpu: float) -> Run:
    return Run("S1", renderer, repeat, 2 * cpu, cpu, 1_000_000, {})


def test_the_summary_is_of_medians_turn_by_turn() -> None:
    # Turn 1 was slow for both, so the ratio of medians would be another than the median of ratios.
    runs = [run("clrender", 0, 1.0), run("mitsuba", 0, 2.0), run("clrender", 1, 4.0), run("mitsuba", 1, 12.0)]
    runs += [run("clrender", 2, 1.0), run("mitsuba", 2, 2.5)]
    own, peer = summary(runs)
    assert own["renderer"] == "clrender" and "ratio" not in own
    assert own["mpaths_per_second"] == round(runs[0].rate, 4)
    assert (peer["lowest"], peer["highest"]) == (round(runs[3].rate, 4), round(runs[1].rate, 4))
    assert peer["ratio"] == 2.5


def test_the_summary_tells_errors_and_rays() -> None:
    own = Run("S1", "clrender", 0, 1.0, 1.0, 1_000_000, {"rel_mse": 0.01, "rays": 20_000_000})
    peer = Run("S1", "mitsuba", 0, 2.0, 2.0, 1_000_000, {"rel_mse": 0.02})
    hits = Run("S1", "embree", 0, 1.0, 1.0, 20_000, {"rays": 10_000_000})
    first, second, third = summary([own, peer, hits])
    assert (first["rel_mse"], second["efficiency_ratio"]) == (0.01, 4.0)
    assert first["efficiency"] == pytest.approx(4.0 * second["efficiency"])
    assert third["ratio"] == 2.0 and "mpaths_per_second" not in third and "efficiency" not in third


def test_errors_are_relative() -> None:
    reference = np.full((3, 2, 3), 2.0)
    image = reference.copy()
    image[0] += 0.2
    assert relative_error(image, reference) == pytest.approx(0.04 / 4.01 / 3.0)


@pytest.mark.thorough
def test_a_scene_is_measured(tmp_path: Path) -> None:
    """With clrender alone; the line says what ran where."""
    seen: list[Run] = []
    runs = measure(["S1"], [], Task(16, 16, 1, errors=True), 1, done=seen.append)
    assert runs == seen and len(runs) == 1
    line = runs[0].line()
    assert line["rel_mse"] > 0.0 and line["efficiency"] > 0.0 and line["rays"] > 256
    assert {"commit", "driver", "device", "build_seconds", "device_bytes"} <= line.keys()


@pytest.mark.long
def test_lights_are_chosen_as_asked() -> None:
    """So that S4 can be compared with who picks each light alike."""
    lines = [measure(["S4"], [], Task(8, 8, 1, light_sampler=choice), 1)[0].line() for choice in ("bvh", "uniform")]
    assert [line["light_sampler"] for line in lines] == ["bvh", "uniform"]
    assert lines[0]["image_sha256"] != lines[1]["image_sha256"]


def test_peers_by_name() -> None:
    assert peer_from("mitsuba=/a/python") == Peer("mitsuba", "/a/python")
    for text in ("mitsuba", "mitsuba=", "blender=/a/python"):
        with pytest.raises(UsageError, match="NAME=PYTHON"):
            peer_from(text)
    assert all((Path(clrender.__file__).parent / "bench" / kind.script).is_file() for kind in PEERS.values())


def test_peers_that_are_not_there_or_fail(tmp_path: Path) -> None:
    scene = write_scene("S1", tmp_path)
    with pytest.raises(RenderError, match="cannot be started"):
        Peer("mitsuba", str(tmp_path / "python")).run(scene, Task(8, 8, 1), tmp_path / "image.npy")
    # This Python has no Mitsuba.
    with pytest.raises(RenderError, match="mitsuba failed with exit status 1: ModuleNotFoundError"):
        Peer("mitsuba", sys.executable).run(scene, Task(8, 8, 1), tmp_path / "image.npy")


def test_mitsuba_does_equal_work(tmp_path: Path) -> None:
    """It gets paths of as many segments, without roulette, and the walls and lights as few meshes."""
    peer = Peer("mitsuba", sys.executable)
    with pytest.raises(RenderError):
        peer.run(write_scene("S4", tmp_path), Task(24, 16, 3), tmp_path / "image.npy")
    scene = clrender.load(tmp_path / "scene.xml")
    assert (scene.render.max_depth, scene.render.filter, scene.render.spp) == (SEGMENTS - 1, "box", 3)
    assert (scene.image.width, scene.image.height) == (24, 16)
    assert '<integer name="rr_depth" value="100000" />' in (tmp_path / "scene.xml").read_text(encoding="utf-8")
    assert sorted(shape.type for shape in scene.shapes) == ["mesh"] * 5 + ["sphere"] * 2
    flat, own = flatten(scene, 8, 8), flatten(clrender.load(tmp_path / "scene.json"), 8, 8)
    assert flat.triangle_count == own.triangle_count and flat.light_count == own.light_count


def test_luxcore_does_equal_work(tmp_path: Path) -> None:
    peer = Peer("luxcore", sys.executable)
    with pytest.raises(RenderError, match="luxcore failed with exit status 1: ModuleNotFoundError"):
        peer.run(write_scene("S4", tmp_path, triangles=True), Task(24, 16, 3), tmp_path / "image.npy")
    lines = (tmp_path / "scene.scn").read_text(encoding="utf-8").splitlines()
    assert {"film.width = 24", "film.height = 16", "batch.haltspp = 3", 'film.filter.type = "NONE"'} <= set(lines)
    assert f"path.pathdepth.total = {SEGMENTS - 1}" in lines
    assert sum(line.endswith('.type = "mesh"') for line in lines) == 7, (
        "walls and lights are as few meshes as for Mitsuba"
    )


def test_a_run_is_a_line_of_json() -> None:
    line = json.loads(json.dumps(run("clrender", 0, 0.5).line()))
    assert line["paths"] == 1_000_000
    assert line["mpaths_per_second"] == pytest.approx(2.0 * line["processors"])
    assert line["mpaths_per_second_wall"] == pytest.approx(1.0)
