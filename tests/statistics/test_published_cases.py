"""Scenes with a known answer that other renderers publish and test themselves with; the numbers are restated here.

Sources: nori (wjakob/nori, scenes/pa4 and pa5/tests), pbrt (mmp/pbrt-v4, cpu/integrators_test.cpp; mmp/pbrt-v3,
tests/analytic_scenes.cpp), Photon v2 (TzuChieh/Photon-v2-Resource, RenderTest), and Khodulev and Kopylov, "Physically
Accurate Lighting Simulation in Computer Graphics Software", GraphiCon 1996.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from exact import polygon_irradiance
from render_support import Studio, lambert, quad, scene, sphere, triangle
from stats_support import Evidence

Floats = npt.NDArray[np.float64]

# Three triangles over a floor that reflects 0.5; radiance of the floor at (0, 0, 0).
NORI = {
    "polylum1": (
        0.08983925851739034,
        [[-0.443432, 0.596366, 0.495985], [-0.320397, 0.0677699, -0.229359], [0.0341197, 0.11415, -0.343049]],
    ),
    "polylum2": (
        0.02292004042001066,
        [[0.461963, 0.397843, 0.412747], [-0.0381582, 0.851323, -0.156872], [0.195443, 0.891957, -0.260672]],
    ),
    "polylum3": (
        0.05341954023396608,
        [[0.100871, 0.289075, -0.422609], [-0.308386, 0.629587, 0.423966], [-0.373132, 0.237287, 0.351592]],
    ),
}
FLOOR = quad([-10.0, 0.0, 10.0], [20.0, 0.0, 0.0], [0.0, 0.0, -20.0], material="floor")


@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf"])
@pytest.mark.parametrize("name", NORI)
def test_nori_triangle_over_a_floor(evidence: Evidence, studio: Studio, name: str, sampling: str) -> None:
    exact, vertices = NORI[name]
    assert abs(polygon_irradiance(vertices) * 0.5 / math.pi - exact) < 1e-9
    a, b, c = np.asarray(vertices)
    away = bool(np.cross(b - a, c - a) @ a > 0.0)
    camera = {"position": [0.0, 0.01, 0.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 0.0, 1.0], "vertical_fov": 0.01}
    what = scene([FLOOR, triangle(vertices, emission=1.0, flip_normals=away)], camera=camera, floor=lambert(0.5))
    evidence.mean_is("radiance", studio.pixels(what, spp=128, sampling=sampling), exact)


@pytest.mark.parametrize("depth, exact", [(1, 1.5), (80, 2.0)])
def test_nori_furnace(evidence: Evidence, studio: Studio, depth: int, exact: float) -> None:
    box = {"type": "box", "size": [1.0, 1.0, 1.0], "emission": [1.0] * 3, "material": "wall", "flip_normals": True}
    camera = {"position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, 1.0], "vertical_fov": 10.0}
    what = scene([box], camera=camera, wall=lambert(0.5))
    evidence.mean_is("radiance", studio.pixels(what, spp=64, max_depth=depth, roulette="none"), exact)


PBRT_CAMERA = {"position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, 1.0], "vertical_fov": 45.0}
PBRT_SPHERE = sphere([0.0, 0.0, 0.0], 1.0, flip_normals=True, material="m")


@pytest.mark.parametrize("depth, exact", [(8, 0.99609375), (60, 1.0)])
def test_pbrt_point_light_in_a_sphere(evidence: Evidence, studio: Studio, depth: int, exact: float) -> None:
    light = {"type": "point", "position": [0.0, 0.0, 0.0], "intensity": [math.pi] * 3}
    what = scene([PBRT_SPHERE], [light], PBRT_CAMERA, m=lambert(0.5))
    evidence.mean_is("radiance", studio.pixels(what, 10, spp=256, max_depth=depth, roulette="none"), exact)


@pytest.mark.parametrize("depth, exact", [(8, 0.998046875), (60, 1.0)])
def test_pbrt_emissive_sphere_from_inside(evidence: Evidence, studio: Studio, depth: int, exact: float) -> None:
    what = scene([{**PBRT_SPHERE, "emission": [0.5] * 3}], camera=PBRT_CAMERA, m=lambert(0.5))
    evidence.mean_is("radiance", studio.pixels(what, 10, spp=256, max_depth=depth, roulette="none"), exact)


# Radiance, and how well it is known: a numerical radiosity solution, checked with another path tracer.
CUBE = {
    "A": ([0.0, 0.0, 0.0], [0.0, 0.0, -5.0], 892.85, 0.3),
    "B": ([2.25, 0.0, 0.0], [2.5, 0.0, -5.0], 768.8, 0.3),
    "C": ([4.5, 0.0, 0.0], [4.999, 0.0, -5.0], 565.9, 0.6),
    "D": ([2.25, 2.25, 0.0], [2.5, 2.5, -5.0], 686.8, 0.3),
    "E": ([4.5, 2.25, 0.0], [4.999, 2.5, -5.0], 523.3, 0.6),
    "F": ([4.5, 4.5, 0.0], [4.999, 4.999, -5.0], 390.4, 1.5),
}


def cube(camera: dict[str, Any]) -> Any:
    """Cube of side 10 with a lamp of 50000 cd in its middle, walls that reflect 2/3."""
    box = {"type": "box", "size": [10.0, 10.0, 10.0], "material": "wall", "flip_normals": True}
    light = {"type": "point", "position": [0.0, 0.0, 0.0], "intensity": [50000.0] * 3}
    return scene([box], [light], camera, wall=lambert(2.0 / 3.0))


@pytest.mark.parametrize("point", CUBE)
def test_khodulev_cube(evidence: Evidence, studio: Studio, point: str) -> None:
    position, target, exact, known = CUBE[point]
    what = cube({"position": position, "target": target, "vertical_fov": 0.001})
    pixels = studio.pixels(what, spp=128, roulette="none", max_depth=40)
    evidence.mean_is("radiance", pixels, exact, rounding=known / exact)


def test_khodulev_cube_on_average(evidence: Evidence, studio: Studio) -> None:
    # Exact: flux / area * reflectance / (pi (1 - reflectance)). A view of 90 degrees is one wall, evenly.
    what = cube({"position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, -5.0], "vertical_fov": 90.0})
    settings: dict[str, Any] = {"spp": 32, "roulette": "none", "max_depth": 40}
    means = [float(studio.gray(what, 32, seed=seed, **settings).mean()) for seed in range(16)]
    evidence.mean_is("wall", means, 4.0 * math.pi * 50000.0 / 600.0 * (2.0 / 3.0) / (math.pi / 3.0))


# Photon's ground, 10 x 5 m, reflects 0.5, half a metre below the camera. 64 x 48 pixels, 60 degrees wide.
GROUND = quad([-5.0, -0.5, -0.5], [10.0, 0.0, 0.0], [0.0, 0.0, -5.0], material="ground")
SIZE = (64, 48)
PHOTON_CAMERA = {
    "position": [0.0, 0.0, 0.0],
    "target": [0.0, 0.0, -1.0],
    "vertical_fov": math.degrees(2.0 * math.atan(math.tan(math.radians(30.0)) * 0.75)),
}


def tiles(picture: Floats) -> Floats:
    """Means of the 6 x 8 tiles of 8 x 8 pixels."""
    means: Floats = picture.reshape(6, 8, 8, 8).mean(axis=(1, 3))
    return means.ravel()


def ground_tiles(irradiance: Any, across: int = 8, down: int = 256) -> Floats:
    """Tile means of the ground's radiance under that irradiance, a function of (x, z), by a fine grid of rays.

    Finer down the picture than across it: its far edge is a horizontal line somewhere in a row of pixels.
    """
    half = math.tan(math.radians(30.0))
    x = ((np.arange(SIZE[0] * across) + 0.5) / (SIZE[0] * across) * 2.0 - 1.0) * half
    y = (1.0 - (np.arange(SIZE[1] * down) + 0.5) / (SIZE[1] * down) * 2.0) * half * 0.75
    far = np.where(y < 0.0, -0.5 / np.where(y < 0.0, y, -1.0), np.inf)[:, None]
    place_x, place_z = np.where(np.isfinite(far), far, 0.0) * x[None, :], -far
    on_ground = (np.abs(place_x) <= 5.0) & (place_z <= -0.5) & (place_z >= -5.5)
    value = np.where(on_ground, irradiance(place_x, np.where(on_ground, place_z, 0.0)), 0.0) * 0.5 / math.pi
    return tiles(value.reshape(SIZE[1], down, SIZE[0], across).mean(axis=(1, 3)))


def photon_batches(studio: Studio, what: Any, size: tuple[int, int], **settings: Any) -> list[Floats]:
    """Tile means for 16 seeds."""
    pictures = [studio.gray(what, size, seed=seed, **settings) for seed in range(16)]
    across = size[0] // 64
    return [tiles(p.reshape(48, across, 64, across).mean(axis=(1, 3))) for p in pictures]


def test_photon_point_light(evidence: Evidence, studio: Studio) -> None:
    power = 100.0 / (4.0 * math.pi)
    exact = ground_tiles(lambda x, z: power * 2.0 / (4.0 + x * x + (z + 3.0) ** 2) ** 1.5)
    assert abs(exact.mean() - 0.0685630738735199) < 5e-5  # Photon's own picture, 65536 samples a pixel
    light = {"type": "point", "position": [0.0, 1.5, -3.0], "intensity": [power] * 3}
    what = scene([GROUND], [light], PHOTON_CAMERA, ground=lambert(0.5))
    # The grid of rays has its own error where the ground's edge crosses it.
    evidence.mean_is("tiles", photon_batches(studio, what, SIZE, spp=32), exact, scale=exact.max(), rounding=2e-4)


def test_photon_tiny_light(evidence: Evidence, studio: Studio) -> None:
    # A square of 5 mm that sends out 100 W downwards: at this distance as good as a point with I = Phi cos / pi.
    radiance = 1273239.5447351628
    area = 0.005**2
    exact = ground_tiles(lambda x, z: radiance * area * 4.0 / (4.0 + x * x + (z + 3.0) ** 2) ** 2)
    assert abs(exact.mean() - 0.22941766679286957) < 2e-4
    light = quad([-0.0025, 1.5, -3.0025], [0.005, 0.0, 0.0], [0.0, 0.0, 0.005], emission=radiance)
    what = scene([GROUND, light], camera=PHOTON_CAMERA, ground=lambert(0.5))
    evidence.mean_is("tiles", photon_batches(studio, what, SIZE, spp=32), exact, scale=exact.max(), rounding=2e-4)


# Tile means of Photon's picture at 131072 samples a pixel: a diffuse ball on a diffuse ground beside a large light.
BALL = [
    [2.746, 3.173, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [2.746, 5.9943, 0.1563, 0.24742, 0.014855, 0.00018411, 0.0, 0.0],
    [2.7459, 5.9942, 1.1185, 0.30171, 0.024489, 0.0061893, 0.0, 0.0],
    [2.7463, 5.9944, 1.1355, 0.36445, 0.073883, 0.020462, 0.0036775, 0.0024615],
    [2.7463, 4.8776, 1.3478, 0.68547, 0.11284, 0.044981, 0.025987, 0.015109],
    [0.68819, 0.80457, 0.65845, 0.46315, 0.27813, 0.16859, 0.1087, 0.074132],
]


def test_photon_ball_beside_a_light(evidence: Evidence, studio: Studio) -> None:
    shapes = [
        quad([-20.0, 0.0, 10.0], [40.0, 0.0, 0.0], [0.0, 0.0, -20.0], material="m"),
        quad([-3.0, 0.0, 2.5], [0.0, 0.0, -5.0], [0.0, 5.0, 0.0], emission=6.366197723675813),
        sphere([0.0, 2.0, 0.0], 2.0, material="m"),
    ]
    half = math.degrees(2.0 * math.atan(math.tan(math.radians(25.0)) * 0.75))
    camera = {"position": [0.0, 2.0, 10.0], "target": [0.0, 2.0, 9.0], "vertical_fov": half}
    what = scene(shapes, camera=camera, m=lambert(0.7))
    batches = photon_batches(studio, what, (128, 96), spp=8)
    # The reference is a picture of another renderer: the tolerances are those published with it.
    evidence.mean_is("mean", np.mean(batches, axis=1), 1.0148017406463623, rounding=0.003)
    exact = np.ravel(BALL)
    evidence.mean_is("tiles", batches, exact, scale=np.maximum(exact, 0.01), rounding=0.02)


@pytest.mark.parametrize("material", [lambert(1.0), {"type": "dielectric", "ior": 1.5}], ids=["diffuse", "glass"])
def test_photon_ball_in_a_furnace(evidence: Evidence, studio: Studio, material: dict[str, Any]) -> None:
    # Six glowing squares that do not quite touch each other stand around a ball that loses nothing: 0.5 everywhere,
    # but for the slits, which are a part in 1e3 wide, so here the box is closed.
    box = {"type": "box", "size": [1800.0] * 3, "emission": [0.5] * 3, "flip_normals": True}
    half = math.degrees(2.0 * math.atan(math.tan(math.radians(40.0))))
    camera = {"position": [0.0, 0.0, 16.0], "target": [0.0, 0.0, 15.0], "vertical_fov": half}
    what = scene([box, sphere([0.0, 0.0, 0.0], 9.0, material="it")], camera=camera, it=material)
    evidence.mean_is("patches", studio.patches(what, spp=64, roulette="none", max_depth=1000), 0.5)


def nori(name: str) -> tuple[Any, float]:
    """The scene of a triangle over a floor, and the floor's radiance."""
    exact, vertices = NORI[name]
    a, b, c = np.asarray(vertices)
    away = bool(np.cross(b - a, c - a) @ a > 0.0)
    camera = {"position": [0.0, 0.01, 0.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 0.0, 1.0], "vertical_fov": 1e-4}
    return scene([FLOOR, triangle(vertices, emission=1.0, flip_normals=away)], camera=camera, floor=lambert(0.5)), exact


def square() -> tuple[Any, float]:
    """A white plate one metre below the middle of a square light of one metre and radiance 10."""
    light = quad([-0.5, 1.0, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], emission=10.0)
    plate = quad([-5.0, 0.0, 5.0], [10.0, 0.0, 0.0], [0.0, 0.0, -10.0], material="plate")
    camera = {"position": [0.3, 0.2, 0.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 0.0, 1.0], "vertical_fov": 1e-3}
    irradiance = 40.0 * math.atan(1.0 / math.sqrt(5.0)) / math.sqrt(5.0)
    return scene([plate, light], camera=camera, plate=lambert(1.0)), irradiance / math.pi


def furnace_box(albedo: float) -> Any:
    box = {"type": "box", "size": [1.0] * 3, "emission": [1.0] * 3, "material": "wall", "flip_normals": True}
    camera = {"position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, 1.0], "vertical_fov": 10.0}
    return scene([box], camera=camera, wall=lambert(albedo))


def glowing_ball(sides: dict[str, Any]) -> Any:
    half = math.degrees(2.0 * math.atan(math.tan(math.radians(40.0))))
    box = {"type": "box", "size": [1800.0] * 3, "emission": [0.5] * 3, "flip_normals": True}
    camera = {"position": [0.0, 0.0, 16.0], "target": [0.0, 0.0, 15.0], "vertical_fov": half}
    return scene([box, sphere([0.0, 0.0, 0.0], 9.0, material="it")], camera=camera, it=sides)


POINT = {"type": "point", "position": [0.0, 0.0, 0.0], "intensity": [math.pi] * 3}
LONG: dict[str, Any] = {"roulette": "none", "max_depth": 60}
KNOWN: dict[str, tuple[Any, float, dict[str, Any]]] = {
    **{name: (*nori(name), {}) for name in NORI},
    "square": (*square(), {"max_depth": 1}),
    "furnace": (furnace_box(0.5), 2.0, LONG),
    "furnace, one bounce": (furnace_box(0.5), 1.5, {"roulette": "none", "max_depth": 1}),
    "sphere, point light": (scene([PBRT_SPHERE], [POINT], PBRT_CAMERA, m=lambert(0.5)), 1.0, LONG),
    "sphere, emissive": (
        scene([{**PBRT_SPHERE, "emission": [0.5] * 3}], camera=PBRT_CAMERA, m=lambert(0.5)),
        1.0,
        LONG,
    ),
    "diffuse ball": (glowing_ball(lambert(1.0)), 0.5, {"roulette": "none", "max_depth": 1000}),
    "glass ball": (glowing_ball({"type": "dielectric", "ior": 1.5}), 0.5, {"roulette": "none", "max_depth": 1000}),
}
"""Scene, exact mean, and how to render it. A point light is found by light samples alone."""


@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf"])
def test_a_plate_below_a_square_light(evidence: Evidence, studio: Studio, sampling: str) -> None:
    """One metre below the middle of a square of one metre."""
    what, exact = square()
    assert abs(exact - 2.394564704607735) < 1e-12
    evidence.mean_is("radiance", studio.pixels(what, spp=64, sampling=sampling, max_depth=1), exact)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sampling"),
    # No sample of a BSDF meets a point
    [
        (name, sampling)
        for name in KNOWN
        for sampling in ("mis", "light", "bsdf")
        if (name, sampling) != ("sphere, point light", "bsdf")
    ],
)
def test_a_million_and_ten_million_paths(studio: Studio, name: str, sampling: str) -> None:
    """Within 3.5 standard errors and 1e-4 by a million paths; within 0.1 % by ten million.

    But lights alone have no finite variance in the corners of a glowing box: there 0.1 % is no promise.
    """
    corners = sampling == "light" and name.startswith("furnace")
    what, exact, settings = KNOWN[name]
    for spp in (100, 1000):
        pixels = studio.gray(what, 100, spp=spp, sampling=sampling, **settings).ravel()
        mean, error = float(pixels.mean()) / exact, float(pixels.std()) / exact / math.sqrt(len(pixels))
        print(f"{name}, {sampling}, {spp * len(pixels):.0e} paths: {mean - 1.0:+.2e} +- {error:.1e}")
        assert abs(mean - 1.0) <= (3.5 * error + 1e-4 if spp == 100 or corners else 1e-3)
