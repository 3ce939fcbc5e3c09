"""What shines on one side only leaves everything on its other side exactly black, with every integrator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cases import for_each
from render_support import Studio, disk, lambert, quad, scene, sphere, triangle

from clrender.scene import Scene

FLOOR = quad((-2.0, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0), material="white")
ABOVE = {"position": [0.0, 0.9, 2.5], "target": [0.0, 0.3, 0.0], "vertical_fov": 50.0}
WITHIN = {"position": [0.0, 0.9, 1.0], "target": [0.0, 0.3, 0.0], "vertical_fov": 60.0}
INSIDE = quad((-0.3, 0.2, 0.3), (0.6, 0.0, 0.0), (0.0, 0.0, -0.6), material="white")

# Each shines with a radiance of 5, away from the camera and from the white surface.
EMITTERS: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "sphere from outside": (sphere((0, 0.7, 0), 0.5, emission=5.0, flip_normals=True), FLOOR, ABOVE),
    "sphere on the floor": (sphere((0, 0.5, 0), 0.5, emission=5.0, flip_normals=True), FLOOR, ABOVE),
    "sphere from inside": (sphere((0, 0.5, 0), 2.0, emission=5.0), INSIDE, WITHIN),
    "triangle": (triangle([(-0.5, 1.5, 0.5), (0.5, 1.5, 0.5), (0, 1.5, -0.5)], emission=5.0), FLOOR, ABOVE),
    "quad": (quad((-0.5, 1.5, 0.5), (1, 0, 0), (0, 0, -1), emission=5.0), FLOOR, ABOVE),
    "disk": (disk((0, 1.5, 0), (0, 1, 0), 0.5, emission=5.0), FLOOR, ABOVE),
    "box from outside": (
        {"type": "box", "center": [0, 0.7, 0], "size": [0.6] * 3, "emission": [5.0] * 3, "flip_normals": True},
        FLOOR,
        ABOVE,
    ),
    "box from inside": (
        {"type": "box", "center": [0, 0.5, 0], "size": [3.0] * 3, "emission": [5.0] * 3},
        INSIDE,
        WITHIN,
    ),
    "tetrahedron from outside": (
        {
            "type": "tetrahedron",
            "vertices": [[-0.4, 0.4, 0.4], [0.4, 0.4, 0.4], [0, 0.4, -0.4], [0, 1.1, 0]],
            "emission": [5.0] * 3,
            "flip_normals": True,
        },
        FLOOR,
        ABOVE,
    ),
}
WAYS: dict[str, dict[str, Any]] = {
    "path": {},
    "path by light sampling": {"sampling": "light"},
    "path by BSDF sampling": {"sampling": "bsdf"},
    "path by a light BVH": {"light_sampler": "bvh"},
    "path that splits": {"indirect_rays": 3, "shadow_rays": 2},
    "direct": {"integrator": "direct"},
    "whitted": {"integrator": "whitted"},
    "reuse": {"integrator": "reuse"},
    "photon": {"integrator": "photon", "photons": 4096, "spp": 2},
    "bdpt": {"integrator": "bdpt"},
    "radiosity": {"integrator": "radiosity", "patches": 400, "patch_rays": 64},
    "radiosity gathered": {
        "integrator": "radiosity",
        "patches": 400,
        "patch_rays": 64,
        "radiosity_display": "gather",
    },
}


def lit_by(name: str, flipped: bool = False) -> Scene:
    emitter, surface, camera = EMITTERS[name]
    if flipped:
        emitter = {**emitter, "flip_normals": not emitter.get("flip_normals", False)}
    return scene([surface, emitter], (), camera, white=lambert(0.8))


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
def test_dark_sides_are_black(studio: Studio, way: str) -> None:
    for name in EMITTERS:
        picture = studio.image(lit_by(name), 24, **{"spp": 16, **WAYS[way]})
        assert picture.max() == 0.0, f"{name}: {np.count_nonzero(picture.max(axis=2))} pixels are lit"


@for_each("name", EMITTERS)
def test_bright_sides_are_not(studio: Studio, name: str) -> None:
    """The same scenes with the emitter turned round: so there was something to find."""
    assert studio.image(lit_by(name, flipped=True), 24, spp=4).mean() > 0.05
