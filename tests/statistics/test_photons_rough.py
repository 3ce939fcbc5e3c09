"""Photon mapping among rough and textured materials against path tracing, and where the answer is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from render_support import Studio, lambert, quad, scene, sphere
from stats_support import Evidence

MATERIALS: dict[str, dict[str, Any]] = {
    "metal": {"type": "conductor", "metal": "Au", "roughness": 0.4},
    "plastic": {"type": "principled", "base_color": [0.7, 0.3, 0.2], "roughness": 0.5, "coat": 1.0},
    "clay": {"type": "oren_nayar", "reflectance": [0.8, 0.6, 0.5], "roughness": 0.7},
    "mixed": {"type": "mix", "materials": ["floor", "mirror"], "weight": 0.5},
}
CAMERA = {"position": [0.0, 0.1, 0.95], "target": [0.0, -0.4, -0.2], "vertical_fov": 70.0}


@pytest.mark.parametrize(
    "name", [name if name == "plastic" else pytest.param(name, marks=pytest.mark.slow) for name in MATERIALS]
)
def test_mean_is_that_of_path_tracing(studio: Studio, name: str) -> None:
    """A ball in a closed room with a textured floor: light goes from the lamp over the ball to the floor, and back."""
    shapes: list[dict[str, Any]] = [
        {"type": "box", "size": [2.0, 2.0, 2.0], "flip_normals": True, "material": "wall"},
        quad((-1, -0.99, 1), (2, 0, 0), (0, 0, -2), material="floor"),
        quad((-0.4, 0.98, -0.4), (0.8, 0, 0), (0, 0, 0.8), emission=4.0),
        sphere((0.0, -0.45, -0.1), 0.5, material="ball"),
    ]
    rest: dict[str, Any] = {
        "floor": {"type": "lambert", "reflectance": {"checker": [0.2, 0.9], "size": 0.25}},
        "mirror": {"type": "mirror"},
        "wall": lambert(0.6),
        "ball": MATERIALS[name],
    }
    what = scene(shapes, (), CAMERA, **rest)
    path = studio.image(what, 32, spp=512).reshape(4, 8, 4, 8, 3).mean(axis=(1, 3))
    photons: dict[str, Any] = {"integrator": "photon", "photons": 16384, "photon_radius": 0.03}
    photon = studio.image(what, 32, spp=64, **photons).reshape(4, 8, 4, 8, 3).mean(axis=(1, 3))
    print(name, np.abs(photon / path - 1.0).max(), photon.mean() / path.mean())
    np.testing.assert_allclose(photon, path, rtol=0.06)
    assert photon.mean() == pytest.approx(path.mean(), rel=0.01)


def test_a_furnace_with_a_white_metal(evidence: Evidence, studio: Studio) -> None:
    """Everything lambert sends out 1 and reflects 0.6: as bright as 2.5, and so is what a white rough metal shows."""
    box = {"type": "box", "size": [2.0, 2.0, 2.0], "flip_normals": True, "material": "wall", "emission": [1.0] * 3}
    white = {"type": "conductor", "f0": [1.0, 1.0, 1.0], "roughness": 0.6}
    what = scene([box, sphere((0, -0.3, 0), 0.4, material="white")], camera=CAMERA, wall=lambert(0.6), white=white)
    photons: dict[str, Any] = {"integrator": "photon", "photons": 4096, "photon_radius": 0.12, "spp": 2}
    evidence.mean_is("tiles", studio.tiles(what, range(16), **photons), 2.5, rounding=5e-3)
