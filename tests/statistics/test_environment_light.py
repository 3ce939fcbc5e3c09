"""Pictures of the environment: where they look, how they are sampled, and the light that they give.

The reference interpolates in float64, by formulas of environment_support.py.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from environment_support import PICTURES, DevicePicture, brighter, cells, irradiance, luminance, radiance, under
from exact import polygon_irradiance
from render_support import Studio, lambert, quad, scene
from scipy.stats import qmc
from stats_support import Evidence

from clrender.errors import SceneError

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

Floats = npt.NDArray[np.float64]

COUNT = 1 << 17
NORMALS = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in `Studio.pixels`."""


def sphere_directions(count: int, seed: int) -> Floats:
    """Random ones, the axes, and some so near to the poles and to the seam that single precision is strained."""
    rng = np.random.default_rng(seed)
    near = rng.normal(size=(200, 3)) * [1e-4, 1.0, 1e-4]
    seam = rng.normal(size=(200, 3)) * [1e-6, 1.0, 1.0]
    directions: Floats = np.concatenate([rng.normal(size=(count, 3)), near, seam, NORMALS]).astype(np.float32)
    return directions.astype(np.float64)


def plane(normal: tuple[float, ...], light: dict[str, Any], *more: dict[str, Any]) -> Scene:
    """A white plane with this normal, of which all pixels see the middle, and nothing else."""
    n = np.array(normal)
    a = np.roll(n, 1)
    b = np.cross(n, a)
    camera = {"position": (n * 0.5).tolist(), "target": [0, 0, 0], "up": a.tolist(), "vertical_fov": 0.01}
    floor = quad((-5.0 * (a + b)).tolist(), (10.0 * a).tolist(), (10.0 * b).tolist(), material="white")
    return scene([floor, *more], [light], camera, white=lambert(1.0))


def test_the_middle_of_the_picture_is_at_z_and_its_left_quarter_at_x(device: Device) -> None:
    pixels = np.arange(8.0 * 4 * 3).reshape(4, 8, 3)
    table = DevicePicture(device, pixels)
    found = table.looks(np.array(NORMALS))[:3].T
    rows = pixels[1:3].mean(axis=0)  # on the horizon
    middles = {0: rows[1:3], 1: rows[5:7], 4: rows[3:5], 5: rows[[7, 0]]}
    for index, two in middles.items():
        np.testing.assert_allclose(found[index], two.mean(axis=0), rtol=1e-6)
    # A pole has the row beside it, at the angle that (0, 0) stands for
    np.testing.assert_allclose(found[2], pixels[0, [7, 0]].mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(found[3], pixels[3, [7, 0]].mean(axis=0), rtol=1e-6)


def test_a_quarter_turn_brings_what_was_at_z_to_x(device: Device) -> None:
    pixels = PICTURES["wild"]
    before, after = DevicePicture(device, pixels), DevicePicture(device, pixels, rotate_degrees=90.0)
    x, y, z = np.random.default_rng(5).normal(size=(3, 1000))
    still, turned = before.looks(np.stack([x, y, z], 1)), after.looks(np.stack([z, y, -x], 1))
    np.testing.assert_allclose(turned[:3], still[:3], atol=1e-4)


@for_each("name", PICTURES)
@for_each("degrees", [0.0, -1234.5])
def test_radiance_is_interpolated(device: Device, name: str, degrees: float) -> None:
    pixels = PICTURES[name]
    directions = sphere_directions(4000, 6)
    found = DevicePicture(device, pixels, rotate_degrees=degrees, scale=[1.0, 2.0, 0.25]).looks(directions)
    wanted = radiance(pixels, directions, degrees) * [1.0, 2.0, 0.25]
    # Rounding moves a direction by about 1e-7 of a turn; between two pixels radiance may change by the largest.
    np.testing.assert_allclose(found[:3].T, wanted, rtol=1e-5, atol=1e-6 * max(pixels.shape) * wanted.max())
    turn = np.arctan2(directions[:, 0], -directions[:, 2]) / (2.0 * math.pi) % 1.0
    wide = (np.abs(directions[:, [0, 2]]) > 1e-20).any(axis=1)
    assert np.abs((found[3] - turn + 0.5) % 1.0 - 0.5)[wide].max() < 8e-8


UNEVEN = [name for name, pixels in PICTURES.items() if np.ptp(pixels) > 0.0]


@pytest.mark.parametrize("name, compensated", [*((n, False) for n in PICTURES), *((n, True) for n in UNEVEN)])
def test_directions_are_sampled_by_their_light(
    evidence: Evidence, device: Device, name: str, compensated: bool
) -> None:
    pixels = PICTURES[name]
    u, v = np.random.default_rng(7).random((2, COUNT))
    out = DevicePicture(device, pixels, compensated).samples(u, v)
    directions, found, pdf = out[:3].T, out[3:6].T, out[6]
    assert np.abs(np.linalg.norm(directions, axis=1) - 1.0).max() < 5e-7
    wanted = radiance(pixels, directions)
    slack = 1e-6 * max(pixels.shape) * pixels.max()
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=slack)
    np.testing.assert_allclose(out[7:10].T, wanted, rtol=1e-5, atol=slack)
    # The density is the luminance over its integral, or what of it is above the mean, whichever way it is asked for
    sampled = brighter(pixels) if compensated else pixels
    edges, shares, total = cells(sampled)
    assert (pdf > 0.0).all()
    if compensated:
        for density in (pdf, out[10]):
            np.testing.assert_allclose(
                density, radiance(sampled, directions)[:, 0] / total, rtol=1e-5, atol=slack / total
            )
    else:
        np.testing.assert_allclose(pdf, luminance(found) / total, rtol=1e-5)
        np.testing.assert_allclose(out[10], luminance(out[7:10].T) / total, rtol=1e-5)
    row = np.clip(np.searchsorted(-edges, -directions[:, 1], side="right") - 1, 0, len(edges) - 2)
    width = shares.shape[1]
    turn = (np.arctan2(directions[:, 0], -directions[:, 2]) / (2.0 * math.pi) - 1.0 / width) % 1.0
    column = np.minimum((turn * width).astype(np.int64), width - 1)
    counts = np.bincount(row * width + column, minlength=shares.size).reshape(shares.shape)
    # A direction at the rim of what is bright may round to beyond it
    assert counts[shares == 0.0].sum() <= 2
    evidence.histogram(name, np.where(shares > 0.0, counts, 0), shares)


def test_neighbouring_numbers_give_neighbouring_directions(device: Device) -> None:
    """Down with the first; with the second round along one of two rows, then along the other: nets stay nets."""
    table, steps = DevicePicture(device, PICTURES["wild"]), (np.arange(4096) + 0.5) / 4096
    down = table.samples(steps, np.full(4096, 0.3))
    assert (np.diff(down[1]) <= 2e-7).all()
    across = table.samples(np.full(4096, 0.4), steps)
    turn = (np.arctan2(across[0], -across[2]) / (2.0 * math.pi) - 0.5 / 31) % 1.0
    steps_ahead = (np.diff(turn) + 2e-7) % 1.0
    assert 1.0 < steps_ahead.sum() < 2.001
    assert np.ptp(across[1]) < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf"])
def test_an_even_picture_is_a_constant_environment(evidence: Evidence, studio: Studio, sampling: str) -> None:
    for name in ("constant 3 x 2", "one pixel"):
        pixels = PICTURES[name]
        what = under(pixels, plane((0.0, 1.0, 0.0), {"type": "environment", "file": "sky", "scale": 0.25}))
        evidence.mean_is(name, studio.pixels(what, spp=16, sampling=sampling), 0.25 * pixels[0, 0, 0])


@pytest.mark.parametrize("light", [{"radiance": [1.0, 1.0, 1.0]}, {"file": "sky", "scale": 0.5}], ids=str)
def test_light_samples_leave_an_even_environment_to_the_bsdf(studio: Studio, light: dict[str, Any]) -> None:
    """Whose samples of a diffuse plane have no noise."""
    what = under(PICTURES["constant 3 x 2"], plane((0.0, 1.0, 0.0), {"type": "environment", **light}))
    np.testing.assert_allclose(studio.pixels(what, spp=4), 1.0, rtol=1e-6)
    assert np.ptp(studio.pixels(what, spp=4, sampling="light")) > 0.1


@pytest.mark.parametrize("normal", NORMALS, ids=str)
@pytest.mark.parametrize("name", ["wild", pytest.param("sunny", marks=pytest.mark.slow)])
def test_irradiance(evidence: Evidence, studio: Studio, normal: tuple[float, ...], name: str) -> None:
    pixels, degrees = PICTURES[name], 100.0
    exact = irradiance(pixels, normal, degrees) @ WEIGHTS / math.pi
    light = {"type": "environment", "file": "sky", "rotate_degrees": degrees}
    for sampling in ("mis", "light") if name == "sunny" else ("mis", "light", "bsdf"):
        # The sum over parts of pixels is right to 1e-4.
        seen = studio.pixels(under(pixels, plane(normal, light)), spp=64, sampling=sampling)
        evidence.mean_is(sampling, seen, exact, rounding=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("light_sampler", ["power", "bvh"])
def test_beside_another_light(evidence: Evidence, studio: Studio, light_sampler: str) -> None:
    pixels = PICTURES["wild"] * 0.1
    lamp = quad([-0.5, 1.0, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], emission=2.0)
    corners = [[-0.5, 1.0, -0.5], [0.5, 1.0, -0.5], [0.5, 1.0, 0.5], [-0.5, 1.0, 0.5]]
    # What the lamp hides: its own solid angle, in which a second sky would shine that is 0 elsewhere
    what = under(pixels, plane((0.0, 1.0, 0.0), {"type": "environment", "file": "sky"}, lamp))
    sky, hidden = irradiance(pixels, (0.0, 1.0, 0.0)), _hidden(pixels, 0.5)
    exact = (sky - hidden) @ WEIGHTS + 2.0 * polygon_irradiance(corners)
    for sampling in ("mis", "light"):
        seen = studio.pixels(what, spp=256, sampling=sampling, light_sampler=light_sampler)
        evidence.mean_is(sampling, seen, exact / math.pi, rounding=1e-3)


@pytest.mark.parametrize("light_sampler", ["power", "bvh"])
def test_an_even_sky_beside_another_light(evidence: Evidence, studio: Studio, light_sampler: str) -> None:
    """By `mis` light samples choose the lamp alone; what it hides of the sky it has to replace."""
    lamp = quad([-0.5, 1.0, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], emission=2.0)
    corners = [[-0.5, 1.0, -0.5], [0.5, 1.0, -0.5], [0.5, 1.0, 0.5], [-0.5, 1.0, 0.5]]
    what = plane((0.0, 1.0, 0.0), {"type": "environment", "radiance": [0.5, 0.5, 0.5]}, lamp)
    exact = 0.5 + 1.5 * polygon_irradiance(corners) / math.pi
    for sampling in ("mis", "light", "bsdf"):
        seen = studio.pixels(what, spp=64, sampling=sampling, light_sampler=light_sampler)
        evidence.mean_is(sampling, seen, exact)


def _hidden(pixels: Floats, half: float) -> Floats:
    """(3,) irradiance through a square of this half size, 1 m above."""
    side = (np.arange(400) + 0.5) / 400 * 2.0 * half - half
    x, z = (each.ravel() for each in np.meshgrid(side, side))
    distance2 = x * x + z * z + 1.0
    weight = (side[1] - side[0]) ** 2 / distance2**2  # cosine at both ends, over the distance's square
    hidden: Floats = weight @ radiance(pixels, np.stack([x, np.ones_like(x), z], axis=1))
    return hidden


@pytest.mark.parametrize("normal", NORMALS, ids=str)
def test_variance_is_a_small_part_of_that_of_uniform_sampling(studio: Studio, normal: tuple[float, ...]) -> None:
    """Under a sun, 64 samples: at most 1/50; never more, where it does not shine. Both take scrambled Sobol points."""
    pixels, runs, spp = PICTURES["sunny"], 512, 64
    points = np.concatenate([qmc.Sobol(2, seed=run).random(spp) for run in range(runs)])
    across, turn = np.sqrt(np.maximum(1.0 - (1.0 - 2.0 * points[:, 0]) ** 2, 0.0)), 2.0 * math.pi * points[:, 1]
    directions = np.stack([across * np.cos(turn), 1.0 - 2.0 * points[:, 0], across * np.sin(turn)], axis=1)
    evenly = np.maximum(directions @ np.array(normal), 0.0) * (radiance(pixels, directions) @ WEIGHTS) * 4.0
    what = under(pixels, plane(normal, {"type": "environment", "file": "sky"}))
    found = studio.pixels(what, size=24, spp=spp)
    sun = np.unravel_index(int(np.argmax(luminance(pixels))), pixels.shape[:2])
    polar, azimuth = (sun[0] + 0.5) / pixels.shape[0] * math.pi, (sun[1] + 0.5) / pixels.shape[1] * 2.0 * math.pi
    to_sun = (math.sin(polar) * math.sin(azimuth), math.cos(polar), -math.sin(polar) * math.cos(azimuth))
    share = 50.0 if np.dot(to_sun, normal) > 0.0 else 1.0
    assert found.var() <= evenly.reshape(runs, spp).mean(axis=1).var() / share


@pytest.mark.slow
def test_photons_bring_as_much_as_paths(evidence: Evidence, studio: Studio) -> None:
    pixels = PICTURES["wild"]
    light = {"type": "environment", "file": "sky", "rotate_degrees": 30.0}
    ball = {"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0, "material": "white"}
    camera = {"position": [0.0, 0.5, 6.0], "target": [0, 0, 0], "vertical_fov": 15.0}
    what = under(pixels, scene([ball], [light], camera, white=lambert(0.5)))
    # Of a ball each tile sees another part of the sky. The radius blurs 0.1 of it
    paths = studio.tiles(what, size=16, tiles=2, spp=64)
    photons = studio.tiles(what, size=16, tiles=2, spp=16, integrator="photon", photons=20000, photon_radius=0.02)
    evidence.equal("tiles", paths, photons, rounding=5e-3)


def test_radiosity_refuses_it_by_name(studio: Studio) -> None:
    what = under(PICTURES["wild"], plane((0.0, 1.0, 0.0), {"type": "environment", "file": "sky"}))
    with pytest.raises(SceneError, match=r"lights\[0\].file: the integrator radiosity takes no picture"):
        studio.image(what, integrator="radiosity")


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("whitted", "reuse", "photon")]


@pytest.mark.parametrize("integrator", ["path", "direct", *SLOW])
def test_the_background_is_the_picture(studio: Studio, integrator: str) -> None:
    pixels = PICTURES["wild"]
    camera = {"position": [0, 0, 0], "target": [0.5, 0.3, 1.0], "vertical_fov": 1e-3}
    what = under(pixels, scene([], [{"type": "environment", "file": "sky"}], camera))
    wanted = radiance(pixels, np.array([[0.5, 0.3, 1.0]]))[0] @ WEIGHTS
    seen = studio.pixels(what, 4, spp=1, integrator=integrator)
    np.testing.assert_allclose(seen, wanted, rtol=1e-3)
