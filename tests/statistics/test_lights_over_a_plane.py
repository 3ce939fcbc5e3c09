"""Light of every kind on a diffuse plane, against closed forms: a camera just above the plane sees one point of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from cases import for_each
from exact import disk_irradiance, mirrored, polygon_irradiance, sphere_irradiance
from render_support import Studio, disk, down, lambert, quad, scene, sphere, triangle
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.scene import Scene

SAMPLING = ("mis", "light", "bsdf")
SHARE = 0.6
FLOOR = quad([-50.0, 0.0, 50.0], [100.0, 0.0, 0.0], [0.0, 0.0, -100.0], material="floor")


def lit(shapes: list[dict[str, Any]], lights: list[dict[str, Any]] | None = None, **more: Any) -> Scene:
    """The plane y = 0 and what is given, seen at (0, 0, 0)."""
    return scene([FLOOR, *shapes], lights or [], floor=lambert(SHARE), **more)


def judge(evidence: Evidence, studio: Studio, what: Scene, irradiance: float, sampling: str, spp: int = 64) -> None:
    """All pixels see the same point, so they are the batches; radiance is reflectance times irradiance over pi."""
    pixels = studio.pixels(what, spp=spp, sampling=sampling)
    evidence.mean_is("radiance", pixels, SHARE * irradiance / math.pi, scale=max(irradiance, 1e-6))


def corners(light: dict[str, Any]) -> list[list[float]]:
    """Vertices of a quad or triangle."""
    if light["type"] == "triangle":
        return [list(v) for v in light["vertices"]]
    o, u, v = (np.asarray(light[key]) for key in ("origin", "edge_u", "edge_v"))
    return [[float(x) for x in p] for p in (o, o + u, o + u + v, o + v)]


def facing(light: dict[str, Any], emission: float, front: bool = True) -> dict[str, Any]:
    """The polygon as a light that shows its front, or its back, to (0, 0, 0)."""
    a, b, *_, c = np.asarray(corners(light))
    away = float(np.cross(b - a, c - a) @ a) > 0.0
    return {**light, "emission": [emission] * 3, "flip_normals": away == front}


POLYGONS = {
    "square above": quad([-0.5, 1.0, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    "square aside": quad([1.5, 1.0, 0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    "far and large": quad([20.0, 30.0, -10.0], [0.0, 0.0, 20.0], [-15.0, 15.0, 0.0]),
    "long and thin": quad([-3.0, 0.4, 0.3], [6.0, 0.0, 0.0], [0.0, 0.0, 0.01]),
    "parallelogram": quad([-0.3, 0.7, -0.6], [0.9, 0.2, 0.0], [0.3, 0.0, 0.8]),
    "tilted": quad([0.4, 0.2, -0.5], [0.3, 0.6, 0.0], [0.0, 0.0, 1.0]),
    "upright, half below": quad([0.8, -1.0, -1.0], [0.0, 0.0, 2.0], [0.0, 2.0, 0.0]),
    "tilted, mostly below": quad([0.5, -2.0, -0.5], [0.2, 2.4, 0.1], [0.0, 0.1, 1.0]),
    "triangle": triangle([[-0.4, 0.6, 0.5], [-0.3, 0.07, -0.2], [0.03, 0.11, -0.34]]),
    "sliver": triangle([[-2.0, 0.5, 0.1], [2.0, 0.52, 0.1], [0.5, 0.51, 0.105]]),
    "triangle, one corner above": triangle([[1.0, 0.8, 0.0], [0.9, -0.7, 0.5], [1.1, -0.6, -0.4]]),
}


@pytest.mark.parametrize("sampling", SAMPLING)
@pytest.mark.parametrize("name", POLYGONS)
def test_polygon(evidence: Evidence, studio: Studio, name: str, sampling: str) -> None:
    light = POLYGONS[name]
    # Found by chance alone a small light needs more samples before means of a pixel are near to normally distributed.
    irradiance = 2.0 * polygon_irradiance(corners(light))
    judge(evidence, studio, lit([facing(light, 2.0)]), irradiance, sampling, 128)


@for_each("sampling", SAMPLING)
@for_each("name", ["square above", "tilted", "triangle"])
def test_polygon_from_behind_is_dark(studio: Studio, name: str, sampling: str) -> None:
    what = lit([facing(POLYGONS[name], 2.0, front=False)])
    assert not studio.pixels(what, 16, spp=16, sampling=sampling).any()


SPHERES = {
    "above": ([0.0, 2.0, 0.0], 0.4),
    "aside": ([1.2, 0.8, -0.5], 0.5),
    "near": ([0.1, 1.05, 0.05], 0.79),
    "far and small": ([300.0, 400.0, 0.0], 1.0),
    "half below": ([1.0, 0.0, 0.0], 0.5),
    "mostly below": ([1.0, -0.3, 0.2], 0.6),
}


@pytest.mark.parametrize("sampling", SAMPLING)
@pytest.mark.parametrize("name", SPHERES)
def test_sphere(evidence: Evidence, studio: Studio, name: str, sampling: str) -> None:
    center, radius = SPHERES[name]
    if name == "far and small" and sampling == "bsdf":
        # One ray in a hundred thousand meets it: what is bright is few, so it is counted instead.
        hits, seen = 0, 0
        chance = sphere_irradiance(center, radius) / math.pi
        for seed in range(2):
            picture = studio.pixels(lit([sphere(center, radius, emission=1.0)]), spp=1024, seed=seed, sampling=sampling)
            hits += round(float(picture.sum()) * 1024 / SHARE)
            seen += 1024 * 1024
        evidence.share("hits", hits, seen, chance)
        return
    what = lit([sphere(center, radius, emission=2.0)])
    judge(evidence, studio, what, 2.0 * sphere_irradiance(center, radius), sampling)


DISKS = {
    "above": ([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], 0.5),
    "aside": ([0.8, 0.7, 0.4], [0.0, -1.0, 0.0], 0.6),
    "tilted": ([0.8, 0.9, 0.4], [-0.6, -0.6, -0.2], 0.6),
    "upright, half below": ([0.9, 0.1, 0.0], [-1.0, 0.0, 0.0], 0.7),
}


@pytest.mark.parametrize("sampling", SAMPLING)
@pytest.mark.parametrize("name", DISKS)
def test_disk(evidence: Evidence, studio: Studio, name: str, sampling: str) -> None:
    what = lit([disk(*DISKS[name], emission=2.0)])
    judge(evidence, studio, what, 2.0 * disk_irradiance(*DISKS[name]), sampling)


def test_disk_formulas_agree() -> None:
    # On the axis pi r^2 / (r^2 + h^2); beside it F = (1 - (1 + H^2 - R^2) / sqrt((1 + H^2 + R^2)^2 - 4 R^2)) / 2 with
    # H = h/a, R = r/a (Howell's catalogue, B-13).
    assert abs(disk_irradiance([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], 0.5) - math.pi * 0.25 / 1.25) < 1e-9
    a, h, r = 0.8, 0.7, 0.6
    form = (1 + (h / a) ** 2 - (r / a) ** 2) / math.sqrt((1 + (h / a) ** 2 + (r / a) ** 2) ** 2 - 4 * (r / a) ** 2)
    assert abs(disk_irradiance([a, h, 0.0], [0.0, -1.0, 0.0], r) - math.pi * (1.0 - form) / 2.0) < 1e-9


@pytest.mark.parametrize("place", [(0.0, 2.0, 0.0), (1.0, 0.5, -3.0), (40.0, 0.5, 0.0), (0.0, -1.0, 0.2)])
def test_point_light(evidence: Evidence, studio: Studio, place: tuple[float, float, float]) -> None:
    # I cos / d^2, and nothing from below the plane. Nothing is left to chance, so every pixel is exact.
    distance = math.hypot(*place)
    irradiance = 10.0 * max(place[1], 0.0) / distance**3
    light = {"type": "point", "position": list(place), "intensity": [10.0] * 3}
    judge(evidence, studio, lit([], [light]), irradiance, "mis", 4)


def test_point_light_all_over_a_plane(evidence: Evidence, studio: Studio) -> None:
    # scenes/point-plane.toml, 0.5 * 10 h / (pi (h^2 + r^2)^(3/2)), averaged over each pixel by a fine grid.
    size, fine = 32, 16
    what = clrender.load("point-plane")
    half = 4.0 * math.tan(math.radians(20.0))
    place = ((np.arange(size * fine) + 0.5) / (size * fine) * 2.0 - 1.0) * half
    radiance = 0.5 * 10.0 * 2.0 / math.pi / (4.0 + place[:, None] ** 2 + place[None, :] ** 2) ** 1.5
    exact = radiance.reshape(size, fine, size, fine).mean(axis=(1, 3)).ravel()
    pixels = [studio.pixels(what, size, spp=16, seed=seed) for seed in range(12)]
    evidence.mean_is("pixels", pixels, exact, rounding=1e-5)  # the grid's own error


@pytest.mark.parametrize("direction", [(0.0, -1.0, 0.0), (1.0, -2.0, 0.0), (30.0, -1.0, 5.0), (0.1, 1.0, 0.0)])
def test_directional_light(evidence: Evidence, studio: Studio, direction: tuple[float, float, float]) -> None:
    irradiance = 3.0 * max(-direction[1], 0.0) / math.hypot(*direction)
    light = {"type": "directional", "direction": list(direction), "irradiance": [3.0] * 3}
    judge(evidence, studio, lit([], [light]), irradiance, "mis", 4)


@pytest.mark.parametrize("sampling", SAMPLING)
def test_environment(evidence: Evidence, studio: Studio, sampling: str) -> None:
    light = {"type": "environment", "radiance": [0.7] * 3}
    judge(evidence, studio, lit([], [light]), 0.7 * math.pi, sampling)


@pytest.mark.parametrize("sampling", SAMPLING)
def test_many_lights_of_all_kinds_add_up(evidence: Evidence, studio: Studio, sampling: str) -> None:
    # Powers far apart, and no light before another. The third is seen from behind and gives nothing.
    place, radius = [0.6, 3.0, -3.0], 0.2
    shapes = [
        facing(POLYGONS["square above"], 1.0),
        facing(POLYGONS["tilted, mostly below"], 0.2),
        facing(POLYGONS["upright, half below"], 50.0, front=False),
        sphere(place, radius, emission=30.0),
        disk([-3.0, 1.0, 0.0], [3.0, -1.0, 0.0], 0.3, emission=5.0),
    ]
    lights = [
        {"type": "point", "position": [-1.0, 0.3, -1.0], "intensity": [0.2] * 3},
        {"type": "directional", "direction": [0.3, -1.0, 2.0], "irradiance": [0.001] * 3},
    ]
    irradiance = (
        polygon_irradiance(corners(POLYGONS["square above"]))
        + 0.2 * polygon_irradiance(corners(POLYGONS["tilted, mostly below"]))
        + 30.0 * sphere_irradiance(place, radius)
        + 5.0 * disk_irradiance([-3.0, 1.0, 0.0], [3.0, -1.0, 0.0], 0.3)
        + 0.2 * 0.3 / (2.09**1.5)
        + 0.001 / math.sqrt(5.09)
    )
    judge(evidence, studio, lit(shapes, lights), irradiance, sampling, 256)


@pytest.mark.parametrize("sampling", ["mis", "bsdf", "light"])
def test_mirror_image_of_a_light(evidence: Evidence, studio: Studio, sampling: str) -> None:
    # A mirror wall (reflectance r) at x = -1 shows the light once more: E + r E(mirrored light); the wall is large
    # enough for the whole image. No way but a sampled direction finds it, so it counts in full with any strategy.
    wall = quad([-1.0, -5.0, 5.0], [0.0, 10.0, 0.0], [0.0, 0.0, -10.0], material="wall")
    light = POLYGONS["parallelogram"]
    points = corners(light)
    irradiance = 2.0 * (polygon_irradiance(points) + 0.8 * polygon_irradiance(mirrored(points, 0, -1.0)))
    what = lit([wall, facing(light, 2.0)], wall={"type": "mirror", "reflectance": [0.8] * 3})
    judge(evidence, studio, what, irradiance, sampling, 256)


def test_light_seen_in_a_mirror(evidence: Evidence, studio: Studio) -> None:
    evidence.mean_is("pixels", studio.pixels(clrender.load("mirror-light"), spp=4), 4.0)


FORM_FACTORS = {
    # Exact, between squares of side 1 (Howell's catalogue, C-11 and C-14).
    "parallel at distance 1": (0.199824895698, [-0.5, 1.0, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    "at right angles, sharing an edge": (0.200043776075, [-0.5, 0.0, -0.5], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
}


@pytest.mark.parametrize("sampling", ["mis", "bsdf"])
@pytest.mark.parametrize("name", FORM_FACTORS)
def test_form_factor_of_unit_squares(evidence: Evidence, studio: Studio, name: str, sampling: str) -> None:
    # A camera that looks straight at a plane sees it evenly: its view of 90 degrees at height 1/2 is the unit square.
    exact, origin, edge_u, edge_v = FORM_FACTORS[name]
    shapes = [
        quad([-0.5, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], material="white"),
        quad(origin, edge_u, edge_v, emission=1.0, flip_normals="sharing" in name),
    ]
    camera = {**down(), "position": [0.0, 0.5, 0.0], "vertical_fov": 90.0}
    what = scene(shapes, camera=camera, white=lambert(1.0))
    means = [float(studio.gray(what, 32, spp=64, seed=s, sampling=sampling).mean()) for s in range(16)]
    evidence.mean_is("form factor", means, exact)
