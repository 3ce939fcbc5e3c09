"""Pixel filters: where samples lie, what they weigh, and what every kind of camera then shows, against the formulas."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from environment_support import PICTURES, radiance, under
from exact import Floats
from render_support import Studio, lambert, quad, room, scene
from sampling_support import random_bits
from stats_support import Evidence

import clrender
from clrender.settings import RenderSettings

if TYPE_CHECKING:
    from clrender.device import Device

WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in `Studio.gray`."""
RADIUS = {"tent": 1.0, "gaussian": 1.5, "blackman-harris": 1.5, "mitchell": 2.0}
STRETCHED = [*((name, None) for name in RADIUS), ("box", 1.0), ("tent", 2.0), ("mitchell", 0.75)]
"""Filters, and radii other than their own."""
ALLOWED = 1e-3
"""How far the chain of lines may be from the function, of its largest value (clrender/image/pixel_filter.py)."""
ONE_IS_ENOUGH = [pytest.param(name, marks=() if name == "mitchell" else pytest.mark.slow) for name in RADIUS]
"""Of the filters the one with signs; what the others do otherwise is in their tables alone."""
FINE = 32
"""Points along a pixel where integrals are computed."""


def profile(name: str, x: Floats, radius: float | None = None) -> Floats:
    """A filter's function of the distance along one axis, not normalised, as published; stretched to a radius."""
    x = np.abs(x) * (1.0 if radius is None else RADIUS.get(name, 0.5) / radius)
    if name == "box":
        value = np.ones_like(x)
    elif name == "tent":
        value = 1.0 - x
    elif name == "gaussian":
        value = np.exp(-(x**2) / (2 * 0.5**2)) - math.exp(-(1.5**2) / (2 * 0.5**2))
    elif name == "blackman-harris":
        turn = 2.0 * np.pi * (x / 3.0 + 0.5)
        value = 0.35875 - 0.48829 * np.cos(turn) + 0.14128 * np.cos(2 * turn) - 0.01168 * np.cos(3 * turn)
    else:
        b = c = 1.0 / 3.0
        near = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + 6 - 2 * b
        far = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + 8 * b + 24 * c
        value = np.where(x < 1.0, near, far) / 6.0
    return np.where(x < RADIUS.get(name, 0.5), value, 0.0)


def spread(name: str, pixels: int) -> Floats:
    """(pixels, (pixels + 4) FINE): what each point along one axis, from 2 pixels before the film on, is to a pixel."""
    points = (np.arange((pixels + 4) * FINE) + 0.5) / FINE - 2.0
    weights = profile(name, points - (np.arange(pixels) + 0.5)[:, None])
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def filtered(name: str, seen: Callable[[Floats, Floats], Floats], width: int, height: int) -> Floats:
    """(height, width): what the filter makes of what is seen at places of the film, and beyond it, in pixels."""
    x, y = ((np.arange((n + 4) * FINE) + 0.5) / FINE - 2.0 for n in (width, height))
    return np.asarray(spread(name, height) @ seen(x[None, :], y[:, None]) @ spread(name, width).T)


@pytest.mark.parametrize(("name", "stretched"), STRETCHED)
def test_samples_lie_as_the_filter_says(evidence: Evidence, device: Device, name: str, stretched: float | None) -> None:
    bits, lanes = random_bits(7), 16
    count = bits.shape[1]
    table = RenderSettings(filter=name, filter_radius=stretched).struct(8)
    buffers = [device.upload(bits), device.upload(table), device.empty(12 * count)]
    program = device.program(Path(__file__).with_name("filter.cl"), {"LANES": lanes, "PIXEL_FILTER": 1})
    device.launch(program, "filter_places", count // lanes, 16, [*buffers[:2], np.uint32(count), buffers[2]])
    out = np.empty((3, count), np.float32)
    device.read(buffers[2], out)
    for buffer in buffers:
        device.release(buffer)
    places, negative = out[:2].astype(np.float64) - 0.5, out[2]
    radius, cells = stretched or RADIUS[name], 24
    assert np.abs(places).max() < radius + 1e-6

    # In proportion to its absolute value, and stratified as the numbers are: places rise with them
    points = (np.arange(cells * 1000) + 0.5) / (cells * 1000) * 2.0 * radius - radius
    chances = np.abs(profile(name, points, radius)).reshape(cells, 1000).sum(axis=1)
    chances /= chances.sum()
    at = np.clip(((places + radius) / (2.0 * radius) * cells).astype(np.int64), 0, cells - 1)
    counts = np.bincount(at[0] * cells + at[1], minlength=cells * cells).reshape(cells, cells)
    evidence.histogram(name, counts, np.outer(chances, chances))
    for axis in (0, 1):
        order = np.argsort(bits[axis] >> 8, kind="stable")
        assert (np.diff(out[axis][order]) >= -1e-6).all()

    # And with its sign
    across, down = (profile(name, each, radius) for each in places)
    clear = (np.abs(across) > 1e-4) & (np.abs(down) > 1e-4)
    np.testing.assert_array_equal(negative[clear], (across * down < 0.0)[clear])
    sizes = [float(np.abs(profile(name, points, radius)).sum()), float(profile(name, points, radius).sum())]
    assert table["filter_weight"][0] == pytest.approx((sizes[0] / sizes[1]) ** 2, rel=ALLOWED)


@pytest.mark.long
@pytest.mark.parametrize("place", [(4.25, 4.5), (-0.5, 9.25)], ids=["inside", "outside"])
@pytest.mark.parametrize("name", ["box", *ONE_IS_ENOUGH])
def test_the_image_of_a_small_light_is_the_filter(
    evidence: Evidence, studio: Studio, name: str, place: tuple[float, float]
) -> None:
    """Half a pixel wide, one unit of light in all; also where it is beyond the film's edge."""
    side, half = 9, 0.25
    x, y = place[0] - side / 2, side / 2 - place[1]
    light = quad([x - half, y - half, -1.0], [2 * half, 0.0, 0.0], [0.0, 2 * half, 0.0], emission=0.25 / half**2)
    camera = {"type": "orthographic", "position": [0, 0, 0], "target": [0, 0, -1], "height": float(side)}

    def seen(x: Floats, y: Floats) -> Floats:
        lit: Floats = np.where((np.abs(x - place[0]) < half) & (np.abs(y - place[1]) < half), 0.25 / half**2, 0.0)
        return lit

    what = scene([light], camera=camera)
    batches = [studio.gray(what, side, spp=2048, seed=seed, max_depth=0, filter=name).ravel() for seed in range(16)]
    exact = filtered(name, seen, side, side).ravel()
    evidence.mean_is(name, np.array(batches), exact, scale=np.ones(side * side), rounding=ALLOWED)
    assert name != "mitchell" or exact.min() < -0.001


def test_a_box_of_its_own_radius_is_no_filter_and_a_wider_one_is_the_mean_of_pixels(studio: Studio) -> None:
    """Of radius 1.5 of three times three, within the noise of their random numbers."""
    light = quad([-1.0, -1.5, -1.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], emission=1.0)
    camera = {"type": "orthographic", "position": [0, 0, 0], "target": [0, 0, -1], "height": 9.0}
    plain, same, wide = (
        studio.gray(scene([light], camera=camera), 9, spp=4096, max_depth=0, filter="box", filter_radius=radius)
        for radius in (None, 0.5, 1.5)
    )
    assert (plain == same).all()
    inner = np.mean([plain[y : y + 7, x : x + 7] for y in range(3) for x in range(3)], axis=0)
    assert np.abs(wide[1:-1, 1:-1] - inner).max() < 0.01
    assert inner.max() > 0.4


@pytest.mark.long
@pytest.mark.parametrize("name", RADIUS)
def test_what_is_even_stays_even(evidence: Evidence, studio: Studio, name: str) -> None:
    """To the bit where samples all count alike; else in the mean: the weights' mean is 1."""
    what = scene([], [{"type": "environment", "radiance": [1.0, 0.5, 0.25]}])
    picture = studio.image(what, 32, spp=16, max_depth=0, filter=name)
    if name == "mitchell":
        evidence.mean_is(name, picture[..., 0].ravel(), 1.0)
    else:
        np.testing.assert_array_equal(picture, np.broadcast_to([1.0, 0.5, 0.25], picture.shape))


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"roulette": "constant"},
        {"integrator": "reuse"},
        pytest.param({"indirect_rays": 3, "shadow_rays": 2}, marks=pytest.mark.slow),
        pytest.param({"integrator": "photon", "photons": 4096}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_signs_do_not_bias_paths(evidence: Evidence, studio: Studio, settings: dict[str, Any]) -> None:
    """A closed room that shines by itself: 5 everywhere, whatever roulette, splitting and other pixels do."""
    batches = studio.tiles(clrender.load("furnace-room"), spp=16, filter="mitchell", tiles=2, **settings)
    evidence.mean_is(str(settings), batches, 5.0)


@pytest.mark.long
def test_shared_light_has_the_sign_of_the_pixel_that_gets_it(evidence: Evidence, studio: Studio) -> None:
    """A black and a white wall side by side, half of whose light is reflected before: shared, or by paths alone."""
    walls = [quad([x, -1.0, -1.0], [1, 0, 0], [0, 2, 0], material=m) for x, m in ((-1.0, "black"), (0.0, "white"))]
    camera = {"type": "orthographic", "position": [0.06, 0.0, 0.0], "target": [0.06, 0, -1], "height": 0.8}
    around = room([4.0, 4.0, 4.0], emission=1.0, material="grey")
    what = scene([*walls, around], camera=camera, black=lambert(0.0), white=lambert(0.9), grey=lambert(0.5))
    shared, alone = (
        np.array([studio.gray(what, 8, spp=128, seed=n, filter="mitchell", **way).mean(axis=0) for n in range(16)])
        for way in ({"integrator": "reuse"}, {"integrator": "path"})
    )
    assert alone.mean(axis=0).min() < -0.01
    evidence.equal("reuse and path", shared, alone)


@pytest.mark.long
@pytest.mark.parametrize("name", ONE_IS_ENOUGH)
def test_a_panorama_goes_on_beyond_its_edges(evidence: Evidence, studio: Studio, name: str) -> None:
    """From the left edge to the right one, and over the poles to the other side."""
    pixels = PICTURES["wild"]
    camera = {"position": [1.0, 2.0, 3.0], "target": [1.0, 2.0, 4.0], "type": "panoramic"}
    what = under(pixels, scene([], [{"type": "environment", "file": "sky"}], camera))
    width, height = 8, 4

    def seen(x: Floats, y: Floats) -> Floats:
        turn, down = (x / width - 0.5) * 2.0 * np.pi, y / height * np.pi
        parts = np.broadcast_arrays(-np.sin(down) * np.sin(turn), np.cos(down), np.sin(down) * np.cos(turn))
        directions = np.stack(parts, axis=-1)
        return np.asarray(radiance(pixels, directions.reshape(-1, 3)).reshape(directions.shape) @ WEIGHTS)

    batches = [
        studio.gray(what, (width, height), spp=512, seed=seed, max_depth=0, filter=name).ravel() for seed in range(16)
    ]
    exact = filtered(name, seen, width, height).ravel()
    evidence.mean_is(name, np.array(batches), exact, scale=np.full(exact.shape, exact.max()), rounding=ALLOWED)


@pytest.mark.parametrize(
    "integrator", ["path", *(pytest.param(each, marks=pytest.mark.slow) for each in ("whitted", "radiosity"))]
)
def test_a_fisheye_fades_out_at_its_rim(evidence: Evidence, studio: Studio, integrator: str) -> None:
    camera = {"type": "fisheye", "vertical_fov": 180.0, "position": [0, 0, 0], "target": [0, 0, 1]}
    around = [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}]
    what = scene([quad([9, 9, 9], [0.01, 0, 0], [0, 0.01, 0], material="m")], around, camera, m=lambert(0.0))
    side = 8
    exact = filtered("mitchell", lambda x, y: np.where(np.hypot(x - 4, y - 4) < 4.0, 1.0, 0.0), side, side).ravel()
    more = {"integrator": integrator, "filter": "mitchell", "spp": 1024}
    batches = np.array([studio.gray(what, side, seed=seed, **more).ravel() for seed in range(16)])
    # The integral is one of cells of which the rim cuts some: about as many as it is long, each off by half at most
    evidence.mean_is(integrator, batches, exact, scale=np.ones(side * side), rounding=ALLOWED + 0.5 / FINE**1.5)
    assert exact.max() > 1.01 and exact.min() < -0.005


@pytest.mark.long
def test_layers_are_means_of_what_is_seen(device: Device) -> None:
    """A near black wall before a far white one: no distance beyond both, no albedo below 0, where light is below 0."""
    near = quad([-8.0, -4.0, -1.0], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0], material="black")
    far = quad([-8.0, -4.0, -2.0], [16.0, 0.0, 0.0], [0.0, 8.0, 0.0], material="white")
    camera = {"type": "orthographic", "position": [0.0, 0.0, 0.0], "target": [0, 0, -1], "height": 1.0}
    lamp = [{"type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}]
    what = scene([near, far], lamp, camera, black=lambert(0.0), white=lambert(0.8))
    with clrender.Session(device.info.index) as session:
        made = session.render(what, size=(8, 8), spp=256, filter="mitchell", aov=["depth", "albedo", "position"])
        means = session.render(what, size=(8, 8), spp=64, filter="gaussian", aov=["albedo"])
    assert made.linear.min() < -0.001
    assert made.aovs["albedo"].min() >= 0.0 and made.aovs["albedo"].max() <= 0.8 + 1e-6
    depths = -made.aovs["position"][..., 2]
    assert depths.min() >= 1.0 - 1e-6 and depths.max() <= 2.0 + 1e-6
    # Of filters that are positive everywhere they have the image's own weights
    light = means.linear[..., 0] * np.pi
    np.testing.assert_allclose(means.aovs["albedo"][..., 0], light, atol=1e-5)
