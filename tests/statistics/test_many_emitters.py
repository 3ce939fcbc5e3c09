"""Ten thousand small textured panes that shine: the light BVH against a choice of all alike, and what it gains."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from render_support import Studio, lambert, quad, room, sphere
from stats_support import Evidence

import clrender
from clrender.flatten.flat_scene import flatten
from clrender.image.files import write_image

if TYPE_CHECKING:
    from clrender.scene import Scene

PANES = 10_000
ALONE = 500
"""Of them are shapes of their own; the others are parts of four meshes."""
SIDE = 16
"""Patterns along an edge of the picture, of four by four texels each."""


def panes(folder: Path, **more: Any) -> Scene:
    """A hall of 40 m with panes of 4 to 12 cm in its upper half, each with a pattern of its own; none is in view."""
    rng = np.random.default_rng(1810)
    level = 10.0 ** rng.uniform(-1.0, 1.0, (SIDE, 1, SIDE, 1, 1))
    picture = level * rng.uniform(0.0, 1.0, (SIDE, 4, SIDE, 4, 3))
    write_image(folder / "panes.exr", picture.reshape(4 * SIDE, 4 * SIDE, 3).astype(np.float32))
    center = rng.uniform([-20.0, 4.5, -20.0], [20.0, 7.9, 20.0], (PANES, 1, 3))
    edges = np.linalg.qr(rng.normal(size=(PANES, 3, 3)))[0][:, :2] * rng.uniform(0.02, 0.06, (PANES, 1, 1))
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = (center + signs @ edges).round(5)
    uvs = (rng.integers(0, SIDE, (PANES, 1, 2)) + 0.5 + 0.49 * signs) / SIDE
    emission = {"texture": "panes.exr", "filter": "nearest", "scale": 20.0}
    shapes = []
    for some in [slice(i, i + 1) for i in range(ALONE)] + [slice(i, PANES, 4) for i in range(ALONE, ALONE + 4)]:
        count = len(corners[some])
        faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(count)[:, None, None]
        mesh = {"vertices": corners[some].reshape(-1, 3).tolist(), "faces": faces.reshape(-1, 3).tolist()}
        shapes.append({"type": "mesh", **mesh, "uvs": uvs[some].reshape(-1, 2).tolist(), "emission": emission})
    shapes += [
        room([40.0, 8.0, 40.0], center=[0.0, 4.0, 0.0], material="wall"),
        sphere([-1.5, 1.0, 0.0], 1.0, material="metal"),
        sphere([1.2, 0.9, 1.0], 0.9, material="glass"),
        quad([-1.0, 0.8, -2.5], [1.5, 0.0, 0.0], [0.0, 1.0, 0.4], material="wall"),
    ]
    camera = {"position": [0.0, 3.5, 8.0], "target": [0.0, 0.5, 0.0], "vertical_fov": 36.0}
    materials = {
        "wall": lambert(0.6),
        "metal": {"type": "conductor", "metal": "Al", "roughness": 0.5},
        "glass": {"type": "dielectric", "ior": 1.4, "roughness": 0.5},
    }
    made = {"camera": camera, "shapes": shapes, "materials": materials, **more}
    return clrender.Scene.model_validate(made).placed("here", folder)


HAZE = {"media": {"haze": {"absorption": 0.005, "scattering": [0.05, 0.06, 0.08], "g": 0.5}}, "fog": "haze"}


@pytest.mark.slow
@pytest.mark.parametrize("more", [{}, HAZE], ids=["air", "haze"])
def test_the_choice_of_lights_is_unbiased(
    evidence: Evidence, studio: Studio, tmp_path: Path, more: dict[str, Any]
) -> None:
    """On walls, a rough metal and rough glass, and at points of haze: all three ways to choose have the same mean."""
    what = panes(tmp_path, **more)
    flat = flatten(what, 8, 8)
    assert flat.light_count == 2 * PANES and flat.light_levels == 15
    tiles = {
        sampler: studio.tiles(what, range(first, first + 16), light_sampler=sampler, spp=spp, max_depth=4)
        for first, sampler, spp in ((0, "bvh", 128), (16, "power", 256), (32, "uniform", 512))
    }
    for sampler in ("power", "uniform"):
        evidence.equal(sampler, tiles[sampler], tiles["bvh"])


@pytest.mark.slow
def test_the_light_bvh_is_worth_its_time(studio: Studio, tmp_path: Path) -> None:
    """1 / (variance x CPU time) with all bounces: 10 times that of a choice of all alike, of which 4 are asked for."""
    what = panes(tmp_path)
    seconds = {"uniform": 0.0, "bvh": 0.0}
    images: dict[str, list[npt.NDArray[np.float64]]] = {sampler: [] for sampler in seconds}
    for seed in range(9):
        for sampler in seconds:
            begin = time.process_time()
            image = studio.gray(what, spp=64, seed=seed, light_sampler=sampler, max_depth=13)
            if seed > 0:  # the first has the program compiled
                seconds[sampler] += time.process_time() - begin
                images[sampler].append(image)
    noise = {sampler: np.array(made).var(axis=0, ddof=1).mean() for sampler, made in images.items()}
    ratio = noise["uniform"] * seconds["uniform"] / (noise["bvh"] * seconds["bvh"])
    print(f"variance {noise}, CPU seconds {seconds}: {ratio:.1f} times as efficient")
    assert ratio > 4.0
