"""Things that touch, and things closely behind others: what is hidden sends no light, what is not hidden does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, lambert, quad, room, scene, sphere

if TYPE_CHECKING:
    from clrender.scene import Scene

WAYS: dict[str, dict[str, Any]] = {
    "path": {},
    "light": {"sampling": "light"},
    "bsdf": {"sampling": "bsdf"},
    "reuse": {"integrator": "reuse"},
    "direct": {"integrator": "direct"},
    "whitted": {"integrator": "whitted"},
    "photon": {"integrator": "photon", "photons": 8192, "spp": 2},
}
WITHIN = {"position": [0.0, 0.0, -1.8], "target": [0.0, 0.6, 0.0], "vertical_fov": 70.0}


def above_a_ceiling(gap: float, size: float = 1.0, place: float = 0.0) -> Scene:
    """A dark room: a lamp shines down on the upper side of its ceiling. Lengths in units of `size`."""

    def at(*vector: float) -> list[float]:
        return [size * (x + place) for x in vector]

    walls = {"type": "box", "center": at(0, 0, 0), "size": [4 * size] * 3, "flip_normals": True, "material": "white"}
    lamp = quad(at(-0.5, 2 + gap, -0.5), (size, 0, 0), (0, 0, size), emission=15.0)
    camera = {"position": at(0.0, 0.0, -1.8), "target": at(0.0, 0.6, 0.0), "vertical_fov": 70.0}
    return scene([walls, lamp], camera=camera, white=lambert(0.7))


@pytest.mark.parametrize("way", WAYS)
def test_a_lamp_closely_behind_a_ceiling_is_hidden(studio: Studio, way: str) -> None:
    hidden = {
        "by a hundredth of a millimetre": above_a_ceiling(1e-5),
        "by a millimetre": above_a_ceiling(1e-3),
        "in a room of a kilometre": above_a_ceiling(1e-5, 250.0),
        "in a room of a millimetre": above_a_ceiling(1e-5, 2.5e-4),
        "far from the origin": above_a_ceiling(1e-3, place=1e4),
    }
    for name, what in hidden.items():
        picture = studio.image(what, 24, **{"spp": 16, **WAYS[way]})
        assert picture.max() == 0.0, f"{name}: {np.count_nonzero(picture.max(axis=2))} pixels are lit"


@pytest.mark.parametrize("what", ["lamp", "shade"])
def test_photons_behind_a_ceiling_stay_there(studio: Studio, what: str) -> None:
    """Neither photons on the lamp nor those on a white sheet that faces the ceiling's upper side count below it."""
    above = {
        "lamp": [sphere((0, 2.101, 0), 0.1, emission=15.0)],
        "shade": [
            quad((-1, 2.002, -1), (2, 0, 0), (0, 0, 2), material="white"),
            quad((-1, 2.0005, -1.1), (2, 0, 0), (0, 0.001, 0), emission=100.0),
        ],
    }
    dark = scene([room([4.0] * 3, material="white"), *above[what]], camera=WITHIN, white=lambert(0.7))
    picture = studio.image(dark, 32, integrator="photon", photons=32768, spp=4)
    assert picture.max() == 0.0


def a_lamp_of_many_triangles(distance: float, size: float, turn: float) -> Scene:
    """A surface that sees all of a flat lamp of 50 triangles in one plane, tilted so that no coordinate is alike."""
    across = np.array([math.cos(turn), 0.3 * math.sin(turn), math.sin(turn)])
    down = np.array([0.2, -1.0, 0.3])
    along = np.cross(down, across)
    across = np.cross(along, down)
    across, along = (size * v / np.sqrt((v * v).sum()) for v in (across, along))
    center = np.array([0.13, 1.0, -0.21]) * distance
    steps = np.linspace(-0.5, 0.5, 6)
    vertices = [(center + x * across + y * along).tolist() for y in steps for x in steps]
    faces = [face for i in range(5) for j in range(5) for face in _two(6 * i + j)]
    lamp = {"type": "mesh", "vertices": vertices, "faces": faces, "emission": [1.0, 1.0, 1.0]}
    floor = quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), material="white")
    return scene([floor, lamp], white=lambert(0.7))


def _two(a: int) -> list[list[int]]:
    """The square from this corner on, as triangles that face down."""
    return [[a, a + 1, a + 7], [a, a + 7, a + 6]]


def test_no_lamp_shades_itself(studio: Studio) -> None:
    """Every sample of light arrives: the triangles beside the one that is sampled are in no way."""
    for distance in (0.3, 3.0, 1000.0):
        for size in (0.01 * distance, distance):
            for turn in (0.1, 1.3):
                what = a_lamp_of_many_triangles(distance, size, turn)
                picture = studio.image(what, 40, integrator="direct", sampling="light", spp=1)
                assert picture.min() > 0.0, (
                    f"{distance} m, {size} m: {np.count_nonzero(picture[..., 0] == 0.0)} samples lost"
                )
