"""Cameras without perspective, of all directions, of wide angles, and lenses with corners: what each pixel sees."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from environment_support import PICTURES, radiance, under
from exact import Floats
from render_support import Studio, lambert, quad, scene, sphere
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.device import Device

WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in `Studio.gray`."""
FRAME = {"position": [0.3, -0.2, 0.1], "target": [1.3, 0.6, -0.9], "up": [0.1, 1.0, 0.2]}
CAMERAS: dict[str, dict[str, Any]] = {
    "perspective": {"vertical_fov": 60.0},
    "orthographic": {"type": "orthographic", "height": 3.0},
    "panoramic": {"type": "panoramic"},
    "fisheye": {"type": "fisheye", "vertical_fov": 220.0},
}


def frame() -> Floats:
    """(3, 3): image right, up and forward of `FRAME`, as rows."""
    forward = np.subtract(FRAME["target"], FRAME["position"])
    right = np.cross(forward, FRAME["up"])
    right, forward = right / np.linalg.norm(right), forward / np.linalg.norm(forward)
    return np.array([right, np.cross(right, forward), forward])


def film_place(kind: str, point: Floats, aspect: float) -> tuple[float, float]:
    """Where a camera sees a point: from the upper left corner, in widths and heights of the image."""
    x, y, z = frame() @ (point - FRAME["position"])
    if kind == "panoramic":
        return 0.5 + math.atan2(x, z) / (2.0 * math.pi), math.acos(y / math.sqrt(x * x + y * y + z * z)) / math.pi
    if kind == "fisheye":
        away = math.atan2(math.hypot(x, y), z) / math.radians(110.0) / math.hypot(x, y)
        x, y = x * away, y * away
    elif kind == "orthographic":
        x, y = x / 1.5, y / 1.5
    else:
        x, y = x / z / math.tan(math.radians(30.0)), y / z / math.tan(math.radians(30.0))
    return 0.5 + x / aspect / 2.0, 0.5 - y / 2.0


@pytest.mark.long
@pytest.mark.parametrize("kind", CAMERAS)
def test_small_lights_are_seen_where_they_should_be(studio: Studio, kind: str) -> None:
    width, height = 480, 320
    rng = np.random.default_rng(3)
    for _ in range(6):
        wide = {"panoramic": 3.0, "fisheye": 1.5}.get(kind, 0.5)
        x, y = rng.uniform(-wide, wide, 2)
        z = rng.uniform(-2.0, 2.0) if kind == "panoramic" else rng.uniform(0.3 if kind == "fisheye" else 1.5, 2.5)
        point = FRAME["position"] + np.array([x, y, z]) @ frame()
        what = scene(
            [sphere(point.tolist(), 0.03 if wide > 1.0 else 0.01, emission=1000.0)], camera={**FRAME, **CAMERAS[kind]}
        )
        picture = studio.gray(what, (width, height), spp=16)
        assert picture.sum() > 0.0
        seen = [
            picture.sum(axis=axis) @ (np.arange(n) + 0.5) / picture.sum() / n for axis, n in ((0, width), (1, height))
        ]
        # The ball is some pixels wide
        np.testing.assert_allclose(seen, film_place(kind, point, width / height), atol=0.2 / height)


@pytest.mark.long
@pytest.mark.parametrize("name", ["wild", "sunny"])
def test_a_panorama_of_an_environment_is_that_environment(studio: Studio, name: str) -> None:
    pixels = PICTURES[name]
    height, width, _ = pixels.shape
    camera = {"position": [1.0, 2.0, 3.0], "target": [1.0, 2.0, 4.0], "type": "panoramic"}
    picture = studio.gray(
        under(pixels, scene([], [{"type": "environment", "file": "sky"}], camera)), (width, height), spp=256
    )
    # Each pixel's mean over its angles
    fine = 32
    theta = (np.arange(height * fine) + 0.5) / (height * fine) * math.pi
    phi = ((np.arange(width * fine) + 0.5) / (width * fine) - 0.5) * 2.0 * math.pi
    across = np.sin(theta)[:, None]
    directions = np.stack(
        np.broadcast_arrays(-across * np.sin(phi), np.cos(theta)[:, None], across * np.cos(phi)), axis=-1
    )
    sky = radiance(pixels, directions.reshape(-1, 3)).reshape(*directions.shape)
    exact = sky.reshape(height, fine, width, fine, 3).mean(axis=(1, 3)) @ WEIGHTS
    # The noise of 256 samples, where neighbouring pixels differ
    contrast = np.max([np.roll(exact, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)], axis=0)
    np.testing.assert_allclose(picture / contrast, exact / contrast, atol=2e-3)


def test_an_orthographic_image_has_the_form_factor_of_two_squares(evidence: Evidence, studio: Studio) -> None:
    """Of a white square, the camera between it and a light of the same size, 1 m above: 0.1998 (Howell, C-11)."""
    x, root = 1.0, math.sqrt(2.0)
    factor = 2.0 / math.pi * (math.log(math.sqrt(4.0 / 3.0)) + 2.0 * root * math.atan(x / root) - 2.0 * math.atan(x))
    floor = quad([-0.5, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], material="white")
    light = quad([-0.5, 1.0, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], emission=1.0)
    camera = {"type": "orthographic", "position": [0.0, 0.5, 0.0], "target": [0, 0, 0], "up": [0, 0, 1], "height": 1.0}
    what = scene([floor, light], camera=camera, white=lambert(1.0))
    for sampling in ("mis", "light", "bsdf"):
        means = [studio.gray(what, 16, spp=64, sampling=sampling, max_depth=1, seed=seed).mean() for seed in range(16)]
        evidence.mean_is(sampling, np.array(means), factor)


@pytest.mark.parametrize("integrator", ["path", "whitted", pytest.param("radiosity", marks=pytest.mark.long)])
def test_a_fisheye_is_dark_beyond_its_angle(device: Device, studio: Studio, integrator: str) -> None:
    camera = {**FRAME, "type": "fisheye", "vertical_fov": 180.0}
    around = [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}]
    what = scene([sphere([9, 9, 9], 0.1, material="m")], around, camera, m=lambert(0.0))
    side = 32
    place = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    away = np.hypot(*np.meshgrid(place, place))
    for display in ("smooth", "gather") if integrator == "radiosity" else (None,):
        more = {"radiosity_display": display} if display else {}
        picture = studio.gray(what, side, spp=4, integrator=integrator, **more)
        assert (picture[away > 1.0 + 0.05] == 0.0).all()
        np.testing.assert_allclose(picture[away < 1.0 - 0.05], 1.0, rtol=1e-5)
    with clrender.Session([device]) as session:
        layers = session.render(what, size=(side, side), spp=2, aov=["albedo", "depth"], integrator=integrator).aovs
    assert (layers["albedo"][0, 0] == 0.0).all() and layers["depth"][0, 0] == np.inf


NEARER = pytest.param(1.5, 5, 90.0, marks=pytest.mark.slow)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    "distance, blades, rotation", [(6.0, 3, 0.0), (6.0, 5, 90.0), (6.0, 6, -17.0), (6.0, 0, 0.0), NEARER]
)
def test_lights_out_of_focus_have_the_shape_of_the_diaphragm(
    evidence: Evidence, studio: Studio, kind: str, distance: float, blades: int, rotation: float
) -> None:
    """Light of a tiny ball comes through all of the lens evenly: each point of it by way of another pixel."""
    aperture, focus, radius, size = 0.3, 3.0, 0.02, 64
    k = distance / focus
    view = {"vertical_fov": 20.0} if kind == "perspective" else {"type": kind, "height": 1.0}
    half = math.tan(math.radians(10.0)) * focus if kind == "perspective" else 0.5
    camera = {"position": [0, 0, 0], "target": [0, 0, -1], "aperture_radius": aperture, "focus_distance": focus, **view}
    lens = {"blades": blades, "blade_rotation_degrees": rotation}
    what = scene([sphere([0.0, 0.0, -distance], radius, emission=1.0)], camera={**camera, **lens})
    picture = np.sum([studio.gray(what, size, spp=512, seed=seed) for seed in range(4)], axis=0)
    # From l of the lens by way of f in focus a ray comes to l (1 - k) + f k, without perspective to l (1 - k) + f
    place = ((np.arange(size) + 0.5) / size * 2.0 - 1.0) * half
    x, y = np.meshgrid(place, -place)
    scale = (k - 1.0) / k if kind == "perspective" else k - 1.0
    inner = _inside(x / scale / aperture, y / scale / aperture, blades, rotation)
    slack = (radius / k / abs(scale) + 2.0 * half / size) / abs(scale) / aperture
    assert not np.any(picture[inner < -slack])
    hits = picture[inner > slack] * 512.0
    area = blades / 2.0 * math.sin(2.0 * math.pi / blades) if blades else math.pi
    wide = radius / abs(k - 1.0)
    evidence.share("hits", round(float(hits.sum())), 4 * 512 * hits.size, math.pi * wide**2 / (area * aperture**2))


def _inside(x: Floats, y: Floats, corners: int, degrees: float) -> Floats:
    """How far points are inside of a regular polygon whose corners are 1 away, or of the unit disk."""
    if corners == 0:
        disk: Floats = 1.0 - np.hypot(x, y)
        return disk
    middles = math.radians(degrees) + (np.arange(corners) + 0.5) * 2.0 * math.pi / corners
    sides = [math.cos(math.pi / corners) - (x * math.cos(a) + y * math.sin(a)) for a in middles]
    nearest: Floats = np.min(sides, axis=0)
    return nearest
