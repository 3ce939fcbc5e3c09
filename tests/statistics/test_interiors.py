"""Volumes of dielectrics that overlap, touch and absorb: against merged interfaces, closed forms and furnaces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from drink_support import GLASS, ICE, WATER, by_priority, merged, on_a_table, rectangles, walls
from drink_support import floor as square
from render_support import Studio, disk, lambert, quad, scene, sphere
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
OUTSIDE = {"position": [1.5, 1.2, 3.0], "target": [0.0, 0.4, 0.0], "vertical_fov": 30.0}
WHITE = lambert(1.0)


def box(center: tuple[float, float, float], size: float, material: str, **more: Any) -> dict[str, Any]:
    """A cube."""
    return {"type": "box", "center": list(center), "size": [size] * 3, "material": material, **more}


def every_pixel(evidence: Evidence, studio: Studio, what: Scene, exact: float, **settings: Any) -> None:
    """Where nothing is left to chance every single pixel is `exact`, but for rounding."""
    evidence.mean_is("pixels", [studio.pixels(what, 16, spp=8, seed=seed, **settings) for seed in range(8)], exact)


def same(evidence: Evidence, studio: Studio, first: Scene, second: Scene, spp: int = 64, **settings: Any) -> None:
    """Two scenes have the same image, tile by tile, but for noise; of different seeds, so that noise is told apart."""
    a = studio.tiles(first, range(16), spp=spp, **settings)
    b = studio.tiles(second, range(100, 116), spp=spp, **settings)
    evidence.equal("tiles", a, b)


def drink() -> tuple[Scene, Scene]:
    """Water in a glass: by priority, and with merged interfaces."""
    shapes, materials = merged()
    return on_a_table(by_priority(), glass=GLASS, water=WATER), on_a_table(shapes, **materials)


@pytest.mark.long
@pytest.mark.parametrize(
    "integrator", ["path", *(pytest.param(i, marks=pytest.mark.slow) for i in ("whitted", "direct"))]
)
def test_water_in_a_glass_is_as_with_merged_interfaces(evidence: Evidence, studio: Studio, integrator: str) -> None:
    same(evidence, studio, *drink(), integrator=integrator)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{"indirect_rays": 3}, {"sampling": "bsdf"}, {"max_depth": 7}], ids=str)
def test_merged_interfaces_however_paths_go(evidence: Evidence, studio: Studio, settings: dict[str, Any]) -> None:
    same(evidence, studio, *drink(), **settings)


@pytest.mark.slow
def test_merged_interfaces_by_photons(evidence: Evidence, studio: Studio) -> None:
    # The same radius, so the same bias.
    same(evidence, studio, *drink(), spp=16, integrator="photon", photons=20000, photon_radius=0.05)


@pytest.mark.slow
def test_ice_floats_as_with_merged_interfaces(evidence: Evidence, studio: Studio) -> None:
    # A cube of ice half out of a cube of water: priorities cut the water out where the ice is.
    half = box((0.0, 0.7, 0.0), 0.4, "ice")
    low, high = walls(0.2, 0.5, 0.7, True), walls(0.2, 0.7, 0.9, True)
    ring = [
        ((-0.4, 0.7, 0.4), (0.8, 0.0, 0.0), (0.0, 0.0, -0.2)),
        ((-0.4, 0.7, -0.2), (0.8, 0.0, 0.0), (0.0, 0.0, -0.2)),
        ((-0.4, 0.7, 0.2), (0.2, 0.0, 0.0), (0.0, 0.0, -0.4)),
        ((0.2, 0.7, 0.2), (0.2, 0.0, 0.0), (0.0, 0.0, -0.4)),
    ]
    water = [*walls(0.4, 0.1, 0.7, True), square(0.4, 0.1, False)]
    cut = on_a_table([half, rectangles([*water, square(0.4, 0.7, True)], material="water")], water=WATER, ice=ICE)
    shapes = [
        rectangles([*water, *ring], material="wet"),
        rectangles([*low, square(0.2, 0.5, False)], material="cold"),
        rectangles([*high, square(0.2, 0.9, True)], material="dry"),
    ]
    whole = on_a_table(
        shapes,
        wet={"type": "dielectric", "ior": 1.33},
        cold={"type": "dielectric", "ior": 1.2, "exterior_ior": 1.33},
        dry={"type": "dielectric", "ior": 1.2},
    )
    same(evidence, studio, cut, whole)


LOSSLESS: Mapping[str, list[Mapping[str, Any]]] = {
    "drink": [*by_priority(), box((0.05, 0.7, 0.1), 0.3, "ice", transform={"rotate_degrees": [10, 20, 30]})],
    "white ball in the drink": [*by_priority(), sphere([0.0, 0.4, 0.0], 0.2, material="white")],
    "touching": [box((-0.2, 0.4, 0.0), 0.4, "glass"), box((0.2, 0.4, 0.0), 0.4, "water")],
    "coincident": [box((0.0, 0.4, 0.0), 0.4, "glass"), box((0.0, 0.4, 0.0), 0.4, "water")],
    "one in the other": [sphere([0.0, 0.4, 0.0], 0.6 - 0.1 * i, material=m) for i, m in enumerate(("water", "glass"))],
    "hole": [rectangles([*walls(0.4, 0.1, 0.7, True), square(0.4, 0.1, False)], material="glass")],
    "nine deep": [sphere([0.0, 0.4, 0.01 * i], 0.9 - 0.05 * i, material=f"m{i}") for i in range(11)],
}


@pytest.mark.parametrize("name", LOSSLESS)
def test_what_loses_nothing_is_invisible(evidence: Evidence, studio: Studio, name: str) -> None:
    # Also where the list of media is wrong: faces that coincide, of which one is found; more media than it holds.
    many = {
        f"m{i}": {"type": "dielectric", "ior": 1.1 + 0.05 * (i * 7 % 11), "priority": i * 3 % 11} for i in range(11)
    }
    what = scene(LOSSLESS[name], [SKY], OUTSIDE, glass=GLASS, water=WATER, ice=ICE, white=WHITE, **many)
    every_pixel(evidence, studio, what, 1.0, roulette="none", max_depth=1000, sampling="bsdf")


@pytest.mark.slow
def test_rough_interface_of_two_media(evidence: Evidence, studio: Studio) -> None:
    # The index of rough facets, and the table of what they scatter more than once, follow the list of media, too.
    shapes = [box((0.0, 0.4, 0.0), 0.7, "glass"), sphere([0.0, 0.4, 0.0], 0.3, material="liquid")]
    glass, liquid = {"type": "dielectric", "ior": 1.5}, {"type": "dielectric", "ior": 1.2, "roughness": 0.3}
    ranked = on_a_table(shapes, glass={**glass, "priority": 0}, liquid={**liquid, "priority": 1})
    same(evidence, studio, ranked, on_a_table(shapes, glass=glass, liquid={**liquid, "exterior_ior": 1.5}))


@pytest.mark.parametrize("inside, ior", [(["water"], 1.33), (["water", "ice"], 1.2), (["glass", "water", "ice"], 1.5)])
def test_camera_under_water(evidence: Evidence, studio: Studio, inside: list[str], ior: float) -> None:
    # Radiance 1 is n² in a medium of index n (PBR 4ed, 9.5.2), and nothing else is to be seen there. Near the middle of
    # balls no light is caught for ever.
    camera = {"position": [0.1, 0.2, 0.0], "target": [0.0, 1.0, 0.4], "vertical_fov": 90.0}
    shapes = [sphere([0.0, 0.01 * i, 0.0], 2.0 - 0.3 * i, material=name) for i, name in enumerate(inside)]
    what = scene(shapes, [SKY], camera, glass=GLASS, water=WATER, ice=ICE)
    every_pixel(evidence, studio, what, ior * ior, roulette="none", max_depth=1000)


SOLID = {"type": "principled", "transmission": 1.0, "roughness": 0.0}


MATCHED = {"type": "dielectric", "ior": 1.0, "attenuation_distance": 1.0}
NESTED: dict[str, Any] = {
    "a": {**MATCHED, "priority": 1, "attenuation_color": [0.1, 0.2, 0.4]},
    "b": {**MATCHED, "priority": 2, "attenuation_color": [0.5, 0.6, 0.7]},
}
NESTED_BOXES: list[dict[str, Any]] = [
    {"type": "box", "center": [-0.25, 0.0, 0.0], "size": [2.5, 9.0, 2.0], "material": "a"},
    {"type": "box", "center": [0.0, 0.0, 0.0], "size": [1.0, 9.0, 1.0], "material": "b"},
]


@pytest.mark.long
@pytest.mark.parametrize("at", [-2.0, 0.0, 1.0])
def test_a_film_that_cuts_nested_media(studio: Studio, at: float) -> None:
    """Each ray of an orthographic camera begins in the media around its own origin: in ten bands."""
    camera = {"type": "orthographic", "position": [at, 0.0, 0.0], "target": [at, 0.0, -1.0], "height": 5.0}
    image = studio.image(scene(NESTED_BOXES, [SKY], camera, **NESTED), 10, spp=4)
    outer, inner = (np.array(NESTED[name]["attenuation_color"]) for name in "ab")
    for column, x in enumerate(at + np.arange(-2.25, 2.5, 0.5)):
        left = np.sqrt(outer * inner) if abs(x) < 0.5 else outer if -1.5 < x < 1.0 else np.ones(3)
        assert image[:, column] == pytest.approx(np.tile(left, (10, 1)), rel=1e-5), x


@pytest.mark.long
def test_a_lens_that_cuts_a_medium(evidence: Evidence, studio: Studio) -> None:
    """Half of it is in the medium, and everything is in focus."""
    camera = {"position": [1.0, 0.0, 0.0], "target": [1.0, 0.0, -1e5], "vertical_fov": 1e-4, "aperture_radius": 0.2}
    what = scene(NESTED_BOXES, [SKY], camera, **NESTED)
    half = 0.5 + 0.5 * np.array(NESTED["a"]["attenuation_color"]) @ (0.5, 0.3, 0.2)
    evidence.mean_is("pixels", studio.pixels(what, 16, spp=16), half)


@pytest.mark.long
@pytest.mark.parametrize("more", [{}, {"priority": 0}, SOLID], ids=["plain", "priority", "principled"])
def test_absorbing_slab(evidence: Evidence, studio: Studio, more: dict[str, Any]) -> None:
    # t (1 - R)² / (1 - R² t²) of light that shines straight through: all reflections inside, each way with
    # t = color^(thickness / distance) left.
    color, thickness, distance, n = [0.9, 0.5, 0.1], 0.3, 0.4, 1.5
    tinted = {"type": "dielectric", "ior": n, "attenuation_color": color, "attenuation_distance": distance, **more}
    lamp = quad([-5.0, -1.0, 5.0], [10.0, 0.0, 0.0], [0.0, 0.0, -10.0], emission=1.0)
    slab = {"type": "box", "center": [0.0, -0.3, 0.0], "size": [10.0, thickness, 10.0], "material": "tinted"}
    picture = studio.image(scene([slab, lamp], tinted=tinted), 32, spp=256, roulette="none")
    reflected = ((n - 1.0) / (n + 1.0)) ** 2
    for channel, left in enumerate(color):
        t = left ** (thickness / distance)
        exact = t * (1.0 - reflected) ** 2 / (1.0 - (reflected * t) ** 2)
        evidence.mean_is(f"channel {channel}", picture[..., channel].ravel(), exact)


@pytest.mark.long
@pytest.mark.parametrize("roughness", [0.0, pytest.param(0.4, marks=pytest.mark.slow)])
def test_principled_glass_absorbs_as_a_dielectric_does(evidence: Evidence, studio: Studio, roughness: float) -> None:
    # A ball on a table, and a clear one of the other kind in it, which absorbs nothing.
    absorbs = {"attenuation_color": [0.9, 0.4, 0.2], "attenuation_distance": 0.3}
    glass = {"type": "dielectric", "ior": 1.5, "roughness": roughness}
    solid = {**SOLID, "ior": 1.5, "roughness": roughness}
    shapes = [sphere([0.0, 0.5, 0.0], 0.45, material="tinted"), sphere([0.0, 0.5, 0.0], 0.2, material="clear")]
    first = on_a_table(shapes, tinted={**glass, **absorbs}, clear=solid)
    same(evidence, studio, first, on_a_table(shapes, tinted={**solid, **absorbs}, clear=glass))
    same(evidence, studio, first, on_a_table(shapes, tinted={**glass, **absorbs}, clear=glass))


@pytest.mark.long
def test_principled_of_index_one_is_a_boundary(evidence: Evidence, studio: Studio) -> None:
    # e^(−2σr) through the middle of what is clear; half of it diffuse, nothing is seen without a scattering event.
    sigma, radius = 0.8, 0.5
    mist = {**SOLID, "ior": 1.0, "attenuation_color": [math.exp(-sigma)] * 3, "attenuation_distance": 1.0}
    camera = {"position": [0.0, 0.0, 3.0], "target": [0.0, 0.0, -1.0], "vertical_fov": 0.01}
    ball = sphere([0.0, 0.0, 0.0], radius, material="mist")
    what = scene([ball], [SKY], camera, mist=mist)
    evidence.mean_is("clear", studio.pixels(what, 32, spp=64), math.exp(-2.0 * sigma * radius), rounding=1e-5)
    half = scene([ball], [SKY], camera, mist={**mist, "transmission": 0.5})
    assert not studio.pixels(half, 16, spp=8, max_depth=0).any()


@pytest.mark.parametrize("integrator", ["path", pytest.param("whitted", marks=pytest.mark.long)])
def test_lamp_and_floor_under_water(evidence: Evidence, studio: Studio, integrator: str) -> None:
    # a / π · I / h² at the floor, and e^(−σ d) on both ways: from the lamp at height h and up to the camera at c.
    sigma, lamp, up, reflectance = 0.7, 1.2, 0.25, 0.6
    dirty = {**WATER, "attenuation_color": [math.exp(-sigma)] * 3, "attenuation_distance": 1.0}
    shapes = [box((0.0, 0.5, 0.0), 4.0, "water"), disk([0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0.01, material="floor")]
    light = {"type": "point", "position": [0.0, lamp, 0.0], "intensity": [2.0, 2.0, 2.0]}
    what = scene(shapes, [light], water=dirty, floor=lambert(reflectance))
    exact = reflectance / math.pi * 2.0 / lamp**2 * math.exp(-sigma * (lamp + up))
    every_pixel(evidence, studio, what, exact, integrator=integrator, max_depth=1)


@pytest.mark.long
def test_mist(evidence: Evidence, studio: Studio) -> None:
    # A ball of index 1 that absorbs does not bend light: e^(−σ r) to its middle, and twice as far through it.
    sigma, radius = 0.8, 0.5
    mist = {"type": "dielectric", "ior": 1.0, "attenuation_color": [math.exp(-sigma)] * 3, "attenuation_distance": 1.0}
    for position, way in (([0.0, 0.0, 0.0], radius), ([0.0, 0.0, 3.0], 2.0 * radius)):
        camera = {"position": position, "target": [0.0, 0.0, -1.0], "vertical_fov": 0.01}
        what = scene([sphere([0.0, 0.0, 0.0], radius, material="mist")], [SKY], camera, mist=mist)
        every_pixel(evidence, studio, what, math.exp(-sigma * way), max_depth=0)


@pytest.mark.slow
def test_index_one_is_invisible(evidence: Evidence, studio: Studio) -> None:
    # In air, and in glass that has the higher priority; it reaches from one to the other, over the table.
    nothing = {"type": "dielectric", "ior": 1.0, "priority": 2}
    shapes = [box((0.0, 0.4, 0.0), 0.5, "glass"), {**box((1.0, 0.4, 0.6), 0.2, "water")}]
    there = [*shapes, {"type": "box", "center": [0.3, 0.3, 0.3], "size": [0.9, 0.7, 0.8], "material": "nothing"}]
    without = on_a_table(shapes, glass=GLASS, water=WATER)
    same(evidence, studio, on_a_table(there, glass=GLASS, water=WATER, nothing=nothing), without)


@pytest.mark.slow
def test_index_one_is_invisible_to_photons(evidence: Evidence, studio: Studio) -> None:
    # Shadow rays do not pass it, so photons bring the light that comes straight from the lamp. The blur of photons may
    # change the mean by 1 %; that light is a large share of it.
    nothing = {"type": "dielectric", "ior": 1.0, "priority": 2}
    ball = [sphere([0.9, 0.3, 0.6], 0.1, material="water")]
    there = [*ball, {"type": "box", "center": [0.0, 0.3, 0.0], "size": [1.0, 0.4, 1.0], "material": "nothing"}]
    settings: dict[str, Any] = {"integrator": "photon", "photons": 100000, "photon_radius": 0.02}
    what = on_a_table(there, water=WATER, nothing=nothing)
    by_path = studio.tiles(what, range(16), spp=64)
    by_photons = studio.tiles(what, range(100, 116), spp=16, **settings)
    evidence.equal("tiles", by_photons.mean(axis=1), by_path.mean(axis=1), rounding=0.01)


@pytest.mark.long
def test_photons_from_a_lamp_inside(evidence: Evidence, studio: Studio) -> None:
    """Their flux is absorbed from where they start. The blur may change the mean by 1 %."""
    what = on_a_table([box((0.0, 0.5, 0.0), 1.0, "water"), sphere([0.0, 0.5, 0.0], 0.2, emission=4.0)], water=WATER)
    by_path = studio.tiles(what, range(16), spp=128)
    settings: dict[str, Any] = {"integrator": "photon", "photons": 100000, "photon_radius": 0.02}
    by_photons = studio.tiles(what, range(100, 116), spp=16, **settings)
    evidence.equal("tiles", by_photons.mean(axis=1), by_path.mean(axis=1), rounding=0.01)


@pytest.mark.long
def test_layers_see_through_what_is_no_boundary(device: Device) -> None:
    # A block of index 1 in air: its albedo, normals, places and numbers are those of what is behind it.
    ball, block = sphere([0.9, 0.3, 0.6], 0.1, material="water"), box((0.0, 0.4, 0.0), 0.6, "nothing")
    nothing = {"type": "dielectric", "ior": 1.0, "priority": 2}
    names = ("albedo", "normal", "depth", "position", "material")
    settings: dict[str, Any] = {"device": device.info.index, "size": (24, 24), "spp": 4, "aov": names}
    there = clrender.render(on_a_table([ball, block], water=WATER, nothing=nothing), **settings)
    without = clrender.render(on_a_table([ball], water=WATER, nothing=nothing), **settings)
    for name in names:
        np.testing.assert_allclose(there.aovs[name], without.aovs[name], rtol=1e-4, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("nothing", [{"priority": 0}, {}], ids=["lowest priority", "no priority"])
def test_index_one_changes_no_bit(device: Device, nothing: dict[str, Any]) -> None:
    # What loses to everything, or has the same index on both sides, is left out wherever it is.
    shapes = by_priority()
    more = [*shapes, box((0.3, 0.4, 0.2), 0.7, "nothing")]
    hashes = {
        clrender.render(what, device=device.info.index, size=(32, 32), spp=2).stats["image_sha256"]
        for what in (
            on_a_table(shapes, glass=GLASS, water=WATER),
            on_a_table(more, glass=GLASS, water=WATER, nothing={"type": "dielectric", "ior": 1.0, **nothing}),
        )
    }
    assert len(hashes) == 1
