"""Photon mapping among rough and textured materials against path tracing, and where the answer is known."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from photon_support import PHOTONS, photon_map
from render_support import Studio, lambert, quad, room, scene, sphere
from stats_support import Evidence

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

FROSTED: dict[str, Any] = {"type": "dielectric", "ior": 1.5, "roughness": 0.4}
MATERIALS: dict[str, dict[str, Any]] = {
    "metal": {"type": "conductor", "metal": "Au", "roughness": 0.4},
    "plastic": {"type": "principled", "base_color": [0.7, 0.3, 0.2], "roughness": 0.5, "coat": 1.0},
    "clay": {"type": "oren_nayar", "reflectance": [0.8, 0.6, 0.5], "roughness": 0.7},
    "frosted": FROSTED,
    "mixed": {"type": "mix", "materials": ["floor", "mirror"], "weight": 0.5},
}
CAMERA = {"position": [0.0, 0.1, 0.95], "target": [0.0, -0.4, -0.2], "vertical_fov": 70.0}

RADIUS = 0.03
BLUR = 0.005
"""Relative bias that a radius of 3 cm leaves: a disk's mean is off by r²/8 times the Laplacian of the irradiance.

About a ball of half a metre light from the ball changes by itself over some 15 cm: r²/8 · 4/0.15² = 2 % of that part of
the light, which is a quarter at most.
"""


def agree(evidence: Evidence, studio: Studio, what: Scene, seeds: int, spp: int, photon_spp: int) -> None:
    """Tiles of independent seeds by both: what is allowed is their noise, and the blur."""
    photons: dict[str, Any] = {"integrator": "photon", "photons": 16384, "photon_radius": RADIUS}
    path = studio.tiles(what, range(seeds), spp=spp)
    photon = studio.tiles(what, range(1000, 1000 + seeds), spp=photon_spp, **photons)
    evidence.equal("tiles", path, photon, rounding=BLUR)
    evidence.equal("mean", path.mean(axis=1), photon.mean(axis=1), rounding=BLUR)


@pytest.mark.slow
@pytest.mark.parametrize("name", MATERIALS)
def test_tiles_are_those_of_path_tracing(evidence: Evidence, studio: Studio, name: str) -> None:
    """A ball in a closed room with a textured floor: light goes from the lamp over the ball to the floor, and back."""
    shapes: list[dict[str, Any]] = [
        room([2.0, 2.0, 2.0], material="wall"),
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
    agree(evidence, studio, scene(shapes, (), CAMERA, **rest), 24, 512, 32)


@pytest.mark.slow
def test_tiles_inside_rough_glass_are_those_of_path_tracing(evidence: Evidence, studio: Studio) -> None:
    """A camera in a pool: below its surface radiance is n² times as much, and what photons carry is not."""
    shapes = [
        quad((-3, 0, 3), (6, 0, 0), (0, 0, -6), material="floor"),
        quad((-3, 0.6, 3), (6, 0, 0), (0, 0, -6), material="surface"),
        quad((-0.5, 1.4, -0.5), (1.0, 0, 0), (0, 0, 1.0), emission=4.0),
    ]
    camera = {"position": [0, 0.5, 0], "target": [0, 0, 0], "up": [0, 0, -1], "vertical_fov": 60.0}
    agree(evidence, studio, scene(shapes, (), camera, floor=lambert(0.5), surface=FROSTED), 12, 64, 4)


LOSSLESS: dict[str, dict[str, Any]] = {
    "frosted": FROSTED,
    "thin": {**FROSTED, "thin": True},
    "white metal": {"type": "conductor", "f0": [1.0, 1.0, 1.0], "roughness": 0.5},
}


@pytest.mark.long
@pytest.mark.parametrize("name", LOSSLESS)
def test_photons_keep_their_power(evidence: Evidence, device: Device, name: str) -> None:
    """A ball that absorbs nothing before a point light: all that meets it reaches the walls, and that alone is kept.

    Hardly a photon leaves the walls again; on black ones none would be kept.
    """
    distance, radius = 0.9, 0.7
    walls = room([4.0, 4.0, 4.0], material="wall")
    light = {"type": "point", "position": [0.0, distance, 0.0], "intensity": [1.0, 1.0, 1.0]}
    what = scene([walls, sphere((0, 0, 0), radius, material="ball")], [light], wall=lambert(1e-6), ball=LOSSLESS[name])
    totals = [photon_map(device, what, number)[6].sum(dtype=np.float64) / PHOTONS for number in range(8)]
    cap = 2.0 * math.pi * (1.0 - math.sqrt(1.0 - (radius / distance) ** 2))
    # To a thousandth is what materials promise (docs/furnace.md)
    evidence.mean_is("power", np.array(totals), cap, rounding=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", LOSSLESS)
def test_a_furnace_around_what_absorbs_nothing(evidence: Evidence, studio: Studio, name: str) -> None:
    """Everything lambert sends out 1 and reflects 0.6: as bright as 2.5, and so is what a white rough ball shows."""
    box = room([2.0, 2.0, 2.0], material="wall", emission=1.0)
    ball = sphere((0, -0.3, 0), 0.4, material="white")
    what = scene([box, ball], (), CAMERA, wall=lambert(0.6), white=LOSSLESS[name])
    photons: dict[str, Any] = {"integrator": "photon", "photons": 8192, "photon_radius": 0.12, "spp": 8}
    evidence.mean_is("tiles", studio.tiles(what, range(16), **photons), 2.5, rounding=1e-3)
