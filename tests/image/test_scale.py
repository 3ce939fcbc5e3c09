"""Large and odd: millions of triangles, many spheres and lights, images of every shape, and their memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pytest
from image_support import render

import clrender
from clrender.device import Device
from clrender.image.files import image_sha256, read_image
from clrender.scene import Scene

ROOT = Path(__file__).resolve().parents[2]
GIB: Final = 2**30
CAMERA: Final = {"position": [0, 0, 4], "target": [0, 0, 0], "vertical_fov": 40.0}
WHITE: Final = {"type": "lambert", "reflectance": [1, 1, 1]}
GRAY: Final = {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}


def write_ball(path: Path, divisions: int) -> int:
    """A sphere of 12 `divisions`² triangles, the faces of a cube blown up, as a binary PLY file; their number."""
    n = divisions
    grid = np.tan(np.linspace(-1.0, 1.0, n + 1) * np.pi / 4)
    u, v = np.meshgrid(grid, grid, indexing="ij")
    one = np.ones_like(u)
    sides = [(one, u, v), (-one, v, u), (v, one, u), (u, -one, v), (u, v, one), (v, u, -one)]
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    upper = np.stack([corner, corner + n + 1, corner + n + 2], 1)
    lower = np.stack([corner, corner + n + 2, corner + 1], 1)
    vertices = np.concatenate([np.stack(side, -1).reshape(-1, 3) for side in sides])
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    faces = np.zeros(12 * n * n, [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = np.concatenate([np.concatenate([upper, lower]) + side * (n + 1) ** 2 for side in range(6)])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    with path.open("wb") as file:
        file.write("\n".join(header).encode() + b"\n")
        file.write(vertices.astype("<f4").tobytes())
        file.write(faces.tobytes())
    return len(faces)


def ball_scene(folder: Path, divisions: int) -> tuple[Path, int]:
    """A white ball of that many triangles in a white environment, where it cannot be seen."""
    triangles = write_ball(folder / "ball.ply", divisions)
    scene: dict[str, Any] = {"camera": CAMERA, "materials": {"white": WHITE}}
    scene["shapes"] = [{"type": "mesh", "file": "ball.ply", "material": "white"}]
    scene["lights"] = [{"type": "environment", "radiance": [1, 1, 1]}]
    (folder / "ball.json").write_text(json.dumps(scene))
    return folder / "ball.json", triangles


def assert_invisible(image: npt.NDArray[np.float32]) -> None:
    # A ray that leaves a facet of a convex body never comes back: every path ends in the environment. But one that
    # passes its outline by a few millionths of the distance may be taken for one that hits the far side from within.
    lost = 1.0 - image.astype(np.float64)
    assert lost.min() > -1e-5
    assert (lost > 1e-5).mean() < 1e-4
    assert lost.mean() < 1e-5


def peak_of(*arguments: str) -> int:
    """Run `clrender`; the most memory it held, bytes.

    A small process starts it: the system counts in what the one that starts a program holds.
    """
    measure = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True); "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    command = [sys.executable, "-c", measure, sys.executable, "-m", "clrender", *arguments, "--quiet"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    return int(done.stdout.split()[-1]) * 1024


@pytest.mark.long
def test_a_ball_of_ten_thousand_triangles(all_devices: list[Device], tmp_path: Path) -> None:
    scene, triangles = ball_scene(tmp_path, 30)
    assert triangles == 10800
    image = render(str(scene), all_devices[:1], size=(64, 64), spp=4, sampling="bsdf")
    assert_invisible(image.linear)
    assert image.stats["rays"] > image.stats["samples"], "some rays hit it"


@pytest.mark.slow
def test_four_million_triangles(all_devices: list[Device], tmp_path: Path) -> None:
    scene, triangles = ball_scene(tmp_path, 578)
    assert triangles == 4009008
    image = render(str(scene), all_devices[:1], size=(400, 400), spp=4, sampling="bsdf")
    assert_invisible(image.linear)
    assert image.stats["triangles"] == triangles
    assert image.stats["rays"] > 1.2 * image.stats["samples"], "it fills a good part of the image"
    assert image.stats["device_bytes"] < 2 * GIB
    # On one driver: the check of another may be due, in a process whose memory would count
    small = ("--spp", "1", "--size", "64x64", "-d", "pocl")
    assert peak_of("render", str(scene), "-o", str(tmp_path / "ball.exr"), *small) < 2 * GIB


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["png", "exr", "npy"])
def test_an_8192_image_takes_less_than_4_gib(ending: str, tmp_path: Path) -> None:
    output = tmp_path / f"large.{ending}"
    peak = peak_of("render", "room", "-o", str(output), "--spp", "1", "--size", "8192x8192", "-d", "pocl")
    assert output.stat().st_size > 8192 * 8192
    assert peak < 4 * GIB


@pytest.mark.parametrize("size", [(65536, 16), (16, 65536)], ids=str)
def test_long_images(all_devices: list[Device], size: tuple[int, int]) -> None:
    image = render("furnace-sphere", all_devices[:1], size=size, spp=1, sampling="bsdf")
    assert image.linear.shape == (size[1], size[0], 3)
    assert not image.interrupted and (image.film.counts == 1).all()
    np.testing.assert_allclose(image.linear, 1.0, atol=1e-5)


def test_one_pixel(all_devices: list[Device], tmp_path: Path) -> None:
    image = render("cornell", all_devices[:1], size=(1, 1), spp=1)
    assert image.film.samples == 1
    for ending in ("png", "jpg", "exr", "hdr", "npy", "film"):
        image.save(tmp_path / f"one.{ending}")
    assert image_sha256(read_image(tmp_path / "one.exr")) == image.stats["image_sha256"]


def built(**content: Any) -> Scene:
    return Scene.model_validate({"camera": CAMERA, **content})


@pytest.mark.long
@pytest.mark.parametrize("radiance", [None, 0.75])
@pytest.mark.parametrize("integrator", ["path", "whitted"])
def test_nothing_at_all(
    all_devices: list[Device], radiance: float | None, integrator: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No shape, and no light or only the environment: rays meet nothing, and no table holds anything."""
    lights = [] if radiance is None else [{"type": "environment", "radiance": [radiance] * 3}]
    monkeypatch.setattr(clrender, "load", lambda name: built(lights=lights))
    for lanes in (1, 16):
        image = render("", all_devices[:1], size=(20, 10), spp=2, lanes=lanes, integrator=integrator)
        assert (image.linear == (radiance or 0.0)).all()
        assert image.stats["rays"] == image.stats["samples"]


@pytest.mark.slow
def test_a_hundred_thousand_spheres(all_devices: list[Device], monkeypatch: pytest.MonkeyPatch) -> None:
    """A slab of small mirrors: each ray ends in the environment sooner or later, so that everything is 1."""
    centers = np.random.default_rng(0).uniform(-1, 1, (100_000, 3)) * [2, 2, 0.2]
    mirror = {"type": "mirror", "reflectance": [1, 1, 1]}
    shapes = [{"type": "sphere", "center": list(c), "radius": 0.008, "material": "mirror"} for c in centers.tolist()]
    lights = [{"type": "environment", "radiance": [1, 1, 1]}]
    scene = built(materials={"mirror": mirror}, shapes=shapes, lights=lights)
    monkeypatch.setattr(clrender, "load", lambda name: scene)
    images = [
        render("", all_devices[:1], size=(200, 100), spp=4, roulette="none", traversal=traversal)
        for traversal in ("packet", "single")
    ]
    assert images[0].stats["image_sha256"] == images[1].stats["image_sha256"]
    np.testing.assert_allclose(images[0].linear, 1.0, atol=1e-4)
    assert images[0].stats["max_depth"] > 10, "they were hit"


def test_a_thousand_lights(all_devices: list[Device], monkeypatch: pytest.MonkeyPatch) -> None:
    """As bright as one light of their sum, to within rounding: all stand in one place."""
    floor = {"type": "quad", "origin": [-9, -1, -9], "edge_u": [0, 0, 18], "edge_v": [18, 0, 0], "material": "gray"}
    images = []
    for count in (1, 1000):
        lights = [{"type": "point", "position": [0, 1, 0], "intensity": [9 / count] * 3} for _ in range(count)]
        scene = built(materials={"gray": GRAY}, shapes=[floor], lights=lights)
        monkeypatch.setattr(clrender, "load", lambda name, scene=scene: scene)
        images.append(render("", all_devices[:1], size=(64, 64), spp=8))
    assert images[0].linear.max() > 0.1
    np.testing.assert_allclose(images[1].linear, images[0].linear, rtol=1e-4)
