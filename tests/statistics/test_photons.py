"""Photon mapping against known powers and against path tracing, and how fast it converges."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from photon_support import ALBEDO, PHOTONS, photon_map
from render_support import Studio, disk, lambert, quad, room, scene, sphere
from stats_support import Evidence

import clrender
from clrender.device import Device
from clrender.photon.maps import _shrunk, radius_of_pass
from clrender.scene import Scene

# A light of each kind in the middle of a closed diffuse box, and its power in watts, per channel.
LIGHTS: dict[str, tuple[dict[str, Any], float]] = {
    "quad": ({"shapes": [quad((-0.3, 0.5, -0.2), (0.6, 0, 0), (0, 0, 0.4), emission=2.0)]}, math.pi * 0.24 * 2.0),
    "sphere": ({"shapes": [sphere((0.1, 0.2, 0.3), 0.25, emission=3.0)]}, math.pi * 4 * math.pi * 0.0625 * 3.0),
    "disk": ({"shapes": [disk((0.1, 0.2, 0.3), (0, 1, 0), 0.5, emission=1.5)]}, math.pi * math.pi * 0.25 * 1.5),
    "point": ({"lights": [{"type": "point", "position": [0.1, 0, 0], "intensity": [2, 2, 2]}]}, 4 * math.pi * 2.0),
}


@pytest.mark.long
@pytest.mark.parametrize("name", LIGHTS)
def test_deposits_carry_the_power_of_the_light(evidence: Evidence, device: Device, name: str) -> None:
    """A photon of power P arrives P albedo**k after k events; those with none are not kept. The light is black."""
    more, power = LIGHTS[name]
    box = room([4.0, 3.0, 5.0], material="wall")
    black = [{**shape, "material": "black"} for shape in more.get("shapes", [])]
    what = scene([box, *black], more.get("lights", ()), wall=lambert(ALBEDO), black=lambert(0.0))
    totals = []
    for number in range(8):
        deposits = photon_map(device, what, number)
        on_wall = (np.abs(np.abs(deposits[:3]) - np.array([[2.0], [1.5], [2.5]])) < 1e-5).any(axis=0)
        assert deposits[9].min() >= 1.0
        totals.append(deposits[6, on_wall].sum(dtype=np.float64) / PHOTONS)
    if name == "point":  # nothing else is hit
        evidence.mean_is("power", np.array(totals), power * ALBEDO / (1.0 - ALBEDO))
    else:  # what comes back to the light is lost there
        assert np.mean(totals) < power * ALBEDO / (1.0 - ALBEDO) * 1.01


@pytest.mark.long
def test_an_inward_sphere_keeps_all_its_power(evidence: Evidence, device: Device) -> None:
    shell = sphere((0.0, 0.0, 0.0), 1.0, emission=1.0, flip_normals=True, material="wall")
    what = scene([shell], wall=lambert(ALBEDO))
    totals = [photon_map(device, what, number)[6].sum(dtype=np.float64) / PHOTONS for number in range(8)]
    evidence.mean_is("power", np.array(totals), math.pi * 4.0 * math.pi * ALBEDO / (1.0 - ALBEDO))


@pytest.mark.long
def test_first_deposits_spread_as_the_cosine_says(evidence: Evidence, device: Device) -> None:
    """Inside a diffuse sphere every point sends the same to every other: all octants are alike."""
    shell = sphere((0.0, 0.0, 0.0), 1.0, emission=1.0, flip_normals=True, material="wall")
    deposits = photon_map(device, scene([shell], wall=lambert(0.5)), 0)
    first = deposits[:3, deposits[9] == 1.0]
    octant = (first > 0.0).astype(int).T @ np.array([1, 2, 4])
    evidence.histogram("octants", np.bincount(octant, minlength=8), np.full(8, 0.125))


@pytest.mark.long
def test_no_photon_gains_from_a_grazing_direction(device: Device) -> None:
    """Between walls that all reflect the same every photon keeps its power, in ten million scattering events too."""
    more, power = LIGHTS["point"]
    box = room([4.0, 3.0, 5.0], material="wall")
    what = scene([box], more["lights"], wall=lambert(0.95))
    for number in range(2):
        deposits = photon_map(device, what, number, 1 << 18)
        kept = deposits[6, deposits[9] <= 8.0]
        np.testing.assert_allclose(kept[kept < 1.01 * power], power, rtol=1e-5)
        # A photon of n deposits stands for n / 8 of them, and after 16 events fewer carry more: n is in the hundreds
        assert deposits[6].max() < 200.0 * power


def furnace(camera: dict[str, Any]) -> Scene:
    """Everything sends out 1 and reflects 0.6, so everything is as bright as 2.5: edges, corners, and what touches."""
    same: dict[str, Any] = {"material": "wall", "emission": [1.0, 1.0, 1.0]}
    feet = [[-0.9, -1, 0.2], [-0.1, -1, 0.3], [-0.5, -1, -0.4], [-0.4, -0.2, 0]]
    shapes = [
        room([2.0, 2.0, 2.0], **same),
        {"type": "box", "center": [0.4, -0.75, 0.3], "size": [0.6, 0.5, 0.6], **same},
        {"type": "tetrahedron", "vertices": feet, **same},
        sphere([0.5, -0.7, -0.5], 0.3, **same),
    ]
    return scene(shapes, camera=camera, wall=lambert(0.6))


VIEWS = {
    "all": {"position": [0.05, 0.7, 0.95], "target": [0.0, -0.7, -0.1], "vertical_fov": 80.0},
    "where a box stands": {"position": [0.4, -0.5, 0.95], "target": [0.4, -1.0, 0.65], "vertical_fov": 40.0},
}


@pytest.mark.parametrize("view", VIEWS)
def test_edges_and_corners_are_as_bright_as_the_rest(evidence: Evidence, studio: Studio, view: str) -> None:
    """However large the radius: the share of a disk that is surface is counted without bias.

    With the same seed `direct` draws the same shadow rays: what differs, 2.5 - 1 - 0.6, is the photons'.
    """
    settings: dict[str, Any] = {"size": 48, "tiles": 12, "spp": 2, "light_sampler": "power"}
    photons: dict[str, Any] = {"integrator": "photon", "photons": 4096, "photon_radius": 0.12}
    what = furnace(VIEWS[view])
    direct = studio.tiles(what, range(16), integrator="direct", **settings)
    evidence.mean_is("tiles", studio.tiles(what, range(16), **settings, **photons) - direct, 0.9, rounding=1e-4)


def test_radius_shrinks_as_knaus_and_zwicker_say() -> None:
    """The product of their equation 15 in closed form; n**(-1/3) in the limit."""
    exact = math.exp(math.lgamma(1000 + 5 / 3) - math.lgamma(5 / 3) - math.lgamma(1002))
    assert radius_of_pass(0.5, 0) == 0.5
    assert radius_of_pass(0.5, 1000) == pytest.approx(0.5 * math.sqrt(exact), rel=1e-12)
    before = _shrunk.cache_info().misses
    for number in range(1 << 15):
        radius_of_pass(0.5, number)
    assert _shrunk.cache_info().misses - before <= 16, "the maps before are not gone through again for each"


def outside() -> Scene:
    """A diffuse corner under a sky and a sun, seen through nothing: lights that are infinitely far."""
    walls = [
        quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), material="wall"),
        quad((-2, 0, -2), (4, 0, 0), (0, 3, 0), material="wall"),
        quad((-2, 0, 2), (0, 0, -4), (0, 3, 0), material="wall"),
    ]
    lights = [
        {"type": "environment", "radiance": [0.5, 0.6, 0.8]},
        {"type": "directional", "direction": [-1, -2, -0.7], "irradiance": [2, 1.8, 1.5]},
    ]
    camera = {"position": [3, 2, 4], "target": [-0.5, 0.6, -0.5], "vertical_fov": 45.0}
    return scene(walls, lights, camera, wall=lambert(0.7))


# The rows of an image below the Cornell box's light: what its edge does to so few pixels is not the question.
BELOW = 10


def means(studio: Studio, what: Scene, **settings: Any) -> npt.NDArray[np.float64]:
    """(3,) mean of an image's lower rows."""
    mean: npt.NDArray[np.float64] = studio.image(what, 32, **settings)[BELOW:].mean(axis=(0, 1))
    return mean


@pytest.mark.long
@pytest.mark.parametrize("name", ["cornell", "outside"])
def test_mean_is_that_of_path_tracing(studio: Studio, name: str) -> None:
    what = outside() if name == "outside" else clrender.load(name)
    path = means(studio, what, spp=1024)
    np.testing.assert_allclose(means(studio, what, spp=64, integrator="photon", photons=32768), path, rtol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cornell", "room-glass"])
def test_mean_after_ten_million_photons(studio: Studio, name: str) -> None:
    what = clrender.load(name)
    path = studio.image(what, 64, spp=8192).mean(axis=(0, 1))
    photon = studio.image(what, 64, spp=77, integrator="photon").mean(axis=(0, 1))
    np.testing.assert_allclose(photon, path, rtol=0.01)


@pytest.mark.slow
def test_error_falls_as_it_should(studio: Studio) -> None:
    """Over five doublings the squared error falls with the number of maps to -2/3 (Knaus and Zwicker 2011, 4.1)."""
    what = clrender.load("cornell")
    reference = studio.image(what, 32, spp=65536)[BELOW:]
    counts, errors = [8, 16, 32, 64, 128, 256], []
    for spp in counts:
        settings: dict[str, Any] = {"spp": spp, "integrator": "photon", "photons": 8192}
        images = [studio.image(what, 32, seed=seed, **settings)[BELOW:] for seed in range(4)]
        errors.append(float(np.mean([(image - reference) ** 2 for image in images])))
    slope = float(np.polyfit(np.log(counts), np.log(errors), 1)[0])
    print(f"errors {errors}, slope {slope:.3f}")
    assert -1.0 < slope < -0.5


@pytest.mark.long
def test_depth_counts_events_of_path_and_photon_together(studio: Studio) -> None:
    what = clrender.load("cornell")
    for depth in (1, 2, 3):
        path = means(studio, what, spp=256, max_depth=depth)
        # Single seeds spread by 0.4 %
        photons = [
            means(studio, what, spp=64, integrator="photon", photons=16384, max_depth=depth, seed=seed)
            for seed in range(3)
        ]
        np.testing.assert_allclose(np.mean(photons, axis=0), path, rtol=0.01)


def test_a_mirror_before_the_photons_counts_as_an_event(studio: Studio) -> None:
    """Of depth 2 one event is the mirror's, and only direct light is left for what it shows."""
    walls = room([4.0, 4.0, 4.0], material="wall", emission=1.0)
    mirror = quad((-1.5, -1.5, -1.5), (3, 0, 0), (0, 3, 0), material="mirror")
    camera = {"position": [0, 0, 0], "target": [0.1, 0.1, -1], "vertical_fov": 20.0}
    materials: dict[str, Any] = {"wall": lambert(ALBEDO), "mirror": {"type": "mirror", "reflectance": [0.9, 0.9, 0.9]}}
    what = scene([walls, mirror], camera=camera, **materials)
    path = studio.image(what, 16, spp=256, max_depth=2).mean()
    photon = studio.image(what, 16, spp=32, integrator="photon", photons=16384, max_depth=2).mean()
    assert photon == pytest.approx(path, rel=0.02)


DARK = 0.1
"""So little is reflected that light between treads is a hundredth."""


def mirrored_light(floor: list[dict[str, Any]], degrees: float = 4.0) -> Scene:
    """Light from the side that a mirror sends straight down: a caustic, of irradiance 1 on what is level."""
    mirror = quad((-0.5, 1.5, 0.5), (1.0, -1.0, 0.0), (0.0, 0.0, -1.0), material="mirror")
    view = {"position": [0.0, 0.3, 0.0], "target": [0.0, -1.0, 0.0], "up": [0.0, 0.0, -1.0], "vertical_fov": degrees}
    beam = {"type": "directional", "direction": [1.0, 0.0, 0.0], "irradiance": [1.0, 1.0, 1.0]}
    return scene(
        [mirror, *floor], [beam], view, white=lambert(DARK), mirror={"type": "mirror", "reflectance": [1.0, 1.0, 1.0]}
    )


def treads(rise: float) -> list[dict[str, Any]]:
    """Stripes five centimetres wide, every other one lower: an edge is in every disk, and light reaches all of them."""
    return [
        quad((k * 0.05, -1.0 - k % 2 * rise, 0.5), (0.05, 0, 0), (0, 0, -1.0), material="white") for k in range(-10, 10)
    ]


@pytest.mark.parametrize("rise", [0.0, 0.02])
def test_caustics_on_stepped_floors_are_not_too_bright(evidence: Evidence, studio: Studio, rise: float) -> None:
    """A caustic's photons count within 5.5 cm, and 1.4 cm above or below; so does the surface that they fall on."""
    settings: dict[str, Any] = {"integrator": "photon", "photons": 1 << 14, "photon_radius": 0.11, "spp": 4}
    what = mirrored_light(treads(rise))
    means = np.array([studio.gray(what, 16, seed=seed, **settings).mean() for seed in range(12)])
    evidence.mean_is("radiance", means, DARK / math.pi, rounding=0.01)


def test_caustics_on_curved_floors_are_not_too_bright(evidence: Evidence, studio: Studio) -> None:
    """At the top of a ball on which photons within the disk's radius lie up to two centimetres below its plane.

    Those in the cap above the lowest height that counts are taken, each with the cosine between its normal and the
    disk's; on the part of the disk that is over the cap their mean is what is seen.
    """
    radius, photon_radius = 0.07, 0.11
    settings: dict[str, Any] = {"integrator": "photon", "photons": 1 << 17, "photon_radius": photon_radius, "spp": 1}
    what = mirrored_light([sphere((0.0, -1.0 - radius, 0.0), radius, material="white")], degrees=0.01)
    means = np.array([studio.gray(what, 16, seed=seed, **settings).mean() for seed in range(16)])
    lowest = 1.0 - 0.25 * (0.5 * photon_radius) / radius  # cosine at the cap's rim
    cosine = 2.0 / 3.0 * (1.0 - lowest**3) / (1.0 - lowest**2)
    # In a tenth of a millimetre's view straight light from the side is below a thousandth of that.
    evidence.mean_is("radiance", means, cosine * DARK / math.pi, rounding=1e-3)


@pytest.mark.parametrize("degrees", [pytest.param(0.0, marks=pytest.mark.long), 50.0])
def test_the_floor_of_a_pool(evidence: Evidence, studio: Studio, degrees: float) -> None:
    """Sunlight through flat water that absorbs, by Snell, Fresnel, Beer and Lambert.

    Of depth 3 there is no light that the floor has had before: light enters, the floor scatters it, and it leaves.
    """
    index, left, depth = 1.33, np.array([0.5, 0.7, 0.9]), 1.0
    sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    within = math.sqrt(1.0 - (sine / index) ** 2)

    def enters(above: float, below: float) -> float:
        across = (above - index * below) / (above + index * below)
        along = (index * above - below) / (index * above + below)
        return 1.0 - 0.5 * (across * across + along * along)

    water = {"type": "dielectric", "ior": index, "priority": 1}
    water |= {"attenuation_color": left.tolist(), "attenuation_distance": depth}
    pool = {"type": "box", "center": [0.0, -0.6, 0.0], "size": [6.0, 1.2, 6.0], "material": "water"}
    floor = quad((-2.9, -depth, 2.9), (5.8, 0.0, 0.0), (0.0, 0.0, -5.8), material="floor")
    sun = {"type": "directional", "direction": [sine, -cosine, 0.0], "irradiance": [1.0, 1.0, 1.0]}
    view = {"position": [0.0, 1.0, 0.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 0.0, -1.0], "vertical_fov": 10.0}
    what = scene([pool, floor], [sun], view, floor=lambert(DARK), water=water)
    settings: dict[str, Any] = {"integrator": "photon", "photons": 1 << 14, "spp": 8, "max_depth": 3}
    images = [studio.image(what, 16, seed=seed, **settings).mean((0, 1)) for seed in range(8)]
    arrives = cosine * enters(cosine, within) * left ** (1.0 / within)
    wanted = DARK / math.pi * arrives * left * enters(1.0, 1.0) / index**2
    for channel, name in enumerate("rgb"):
        evidence.mean_is(name, np.array(images)[:, channel], wanted[channel], rounding=0.005)
