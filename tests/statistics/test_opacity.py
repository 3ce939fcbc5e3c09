"""Surfaces that rays may pass by: transmittance in closed form, and holes against geometry that is cut out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, disk, lambert, quad, sphere
from stats_support import Evidence

import clrender
from clrender.flatten import holes

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in what a `Studio` measures."""
STRAIGHT = {"type": "orthographic", "position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "height": 0.5}
BEHIND = quad([-9.0, -9.0, -3.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], emission=[1.0, 1.0, 1.0])

_slow = pytest.mark.slow
INTEGRATORS = ["path", *(pytest.param(name, marks=_slow) for name in ("direct", "whitted", "photon", "reuse"))]


def described(materials: dict[str, Any], shapes: list[dict[str, Any]], camera: dict[str, Any], *lights: Any) -> Scene:
    return clrender.Scene(camera=camera, materials=materials, shapes=tuple(shapes), lights=tuple(lights))


def black(opacity: Any, **more: Any) -> dict[str, Any]:
    return {**lambert(0.0), "opacity": opacity, **more}


def sheet(z: float, material: str = "sheet") -> dict[str, Any]:
    return quad([-2.0, -2.0, z], [4.0, 0.0, 0.1], [0.0, 4.0, 0.0], material=material)


# --- transmittance ----------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("opacity", [0.0, 0.1, 0.5, 1.0])
def test_what_is_seen_through_sheets(evidence: Evidence, studio: Studio, opacity: float) -> None:
    """Of a lamp behind three of them (1 - opacity)^3; the lamp is sampled by what is seen alone."""
    what = described({"sheet": black(opacity)}, [BEHIND, *(sheet(0.2 * i) for i in range(3))], STRAIGHT)
    evidence.mean_is("lamp", studio.pixels(what, 32, spp=64), (1.0 - opacity) ** 3)


@pytest.mark.long
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_shadow_of_sixty_four_sheets(evidence: Evidence, studio: Studio, integrator: str) -> None:
    """Nothing is left to chance: each takes its share of what a light sends through."""
    materials = {"white": lambert(1.0), "sheet": black(0.05), "whole": black(1.0)}
    floor = quad([-2.0, -2.0, -1.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], material="white")
    sun = {"type": "directional", "direction": [0.5, 0.0, -1.0], "irradiance": [1.0, 1.0, 1.0]}
    camera = {**STRAIGHT, "position": [0.0, 0.0, 0.5]}
    slanted = [
        quad([-60.0, -60.0, 1.0 + 0.01 * i], [90.0, 0.0, 0.0], [0.0, 90.0, 0.0], material="sheet") for i in range(64)
    ]
    bare = studio.pixels(described(materials, [floor], camera, sun), 8, spp=4, integrator=integrator, max_depth=1)
    seen = studio.pixels(
        described(materials, [floor, *slanted], camera, sun), 8, spp=4, integrator=integrator, max_depth=1
    )
    np.testing.assert_allclose(seen, bare * 0.95**64, rtol=2e-5)


@pytest.mark.long
def test_spheres_and_disks_are_passed_twice_and_once(evidence: Evidence, studio: Studio) -> None:
    """A ray meets a sphere at its front and at its back, each with a chance of its own; light, too."""
    for shape, times in (
        (sphere([0.0, 0.0, 0.0], 1.0, material="sheet"), 2),
        (disk([0, 0, 0], [0, 0, 1], 1.0, material="sheet"), 1),
    ):
        what = described({"sheet": black(0.4)}, [BEHIND, shape], STRAIGHT)
        evidence.mean_is(f"{shape['type']} seen", studio.pixels(what, 32, spp=64), 0.6**times)
        floor = quad([-2.0, -2.0, -2.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], material="white")
        light = {"type": "point", "position": [0.0, 0.0, 3.0], "intensity": [1.0, 1.0, 1.0]}
        camera = {**STRAIGHT, "position": [0.0, 0.0, -1.5], "target": [0.0, 0.0, -2.0], "height": 0.1}
        materials = {"sheet": black(0.4), "white": lambert(1.0)}
        bare = studio.pixels(described(materials, [floor], camera, light), 8, spp=4, max_depth=1)
        seen = studio.pixels(described(materials, [floor, shape], camera, light), 8, spp=4, max_depth=1)
        np.testing.assert_allclose(seen, bare * 0.6**times, rtol=1e-5)


def test_sheets_in_the_same_place_count_each(evidence: Evidence, studio: Studio) -> None:
    """Hits at one distance are told apart by their primitives."""
    what = described({"sheet": black(0.5)}, [BEHIND, sheet(0.0), sheet(0.0), sheet(0.0)], STRAIGHT)
    evidence.mean_is("lamp", studio.pixels(what, 32, spp=64), 0.125)


def test_a_furnace_stays_white(evidence: Evidence, studio: Studio) -> None:
    """Whatever passes or is reflected by white sheets: there is as much light on all sides."""
    white = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
    materials = {
        "half": {**lambert(1.0), "opacity": 0.5},
        "holes": {**lambert(1.0), "opacity": {"checker": [0.2, 1.0]}},
    }
    shapes = [sheet(0.0, "half"), sheet(-0.3, "holes"), sphere([0.1, 0.0, -1.0], 0.8, material="half")]
    for settings in ({}, {"sampling": "light"}, {"sampling": "bsdf"}):
        pixels = studio.pixels(
            described(materials, shapes, STRAIGHT, white), 32, spp=16, roulette="none", max_depth=200, **settings
        )
        evidence.mean_is(f"{settings}", pixels.reshape(32, 32).mean(axis=0), 1.0, rounding=2e-5)


@pytest.mark.slow
def test_paths_that_split_see_the_same_surfaces(evidence: Evidence, studio: Studio) -> None:
    """Those that go back to a surface do not pass by it: else what lies behind counts once, what is there often."""
    white = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
    what = described({"half": {**lambert(1.0), "opacity": 0.5}}, [sheet(0.0, "half")], STRAIGHT, white)
    pixels = studio.pixels(what, 32, spp=64, indirect_rays=4, roulette="none", max_depth=50)
    evidence.mean_is("furnace", pixels.reshape(32, 32).mean(axis=0), 1.0, rounding=2e-5)
    below = described({"half": {**lambert(0.5), "opacity": 0.5}}, [sheet(0.0, "half")], STRAIGHT, white)
    pixels = studio.pixels(below, 32, spp=64, indirect_rays=4)
    evidence.mean_is("grey", pixels.reshape(32, 32).mean(axis=0), 0.75, rounding=2e-5)


# --- holes against geometry -------------------------------------------------------------------------------------------


def parquet(cut: bool, **more: Any) -> list[dict[str, Any]]:
    """A sloping checker of 4 by 4 fields of which every second is there."""
    if not cut:
        return [quad([-1.0, 1.0, -1.0], [2.0, 0.0, 0.0], [0.0, 0.4, 2.0], material="mask", **more)]
    fields = [(i, j) for i in range(4) for j in range(4) if (i + j) % 2 == 0]
    return [
        quad([-1 + 0.5 * i, 1 + 0.1 * j, -1 + 0.5 * j], [0.5, 0, 0], [0, 0.1, 0.5], material="red", **more)
        for i, j in fields
    ]


def under_a_canopy(cut: bool, **more: Any) -> Scene:
    materials = {
        "white": lambert(0.7),
        "red": lambert([0.8, 0.3, 0.2]),
        "mask": {**lambert([0.8, 0.3, 0.2]), "opacity": {"checker": [1.0, 0.0], "size": 0.25}},
    }
    floor = quad([-2.0, 0.0, -2.0], [0.0, 0.0, 4.0], [4.0, 0.0, 0.0], material="white")
    back = quad([-2.0, 0.0, 2.0], [0.0, 4.0, 0.0], [4.0, 0.0, 0.0], material="white")
    lamp = quad([-1.0, 3.5, -1.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0], emission=[4.0, 4.0, 4.0])
    camera = {"position": [0.0, 2.0, -5.0], "target": [0.0, 1.0, 0.0], "vertical_fov": 45.0}
    return described(materials, [floor, back, lamp, *parquet(cut, **more)], camera)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_holes_are_as_if_cut_out(evidence: Evidence, studio: Studio, integrator: str) -> None:
    settings: dict[str, Any] = {"spp": 16, "integrator": integrator, "size": 32, "tiles": 4, "seeds": range(8)}
    masked, cut = studio.tiles(under_a_canopy(False), **settings), studio.tiles(under_a_canopy(True), **settings)
    evidence.equal("tiles", masked, cut, rounding=3e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "spp"), [("path", 256), ("photon", 64), ("reuse", 256)])
def test_holes_are_as_if_cut_out_at_length(evidence: Evidence, studio: Studio, integrator: str, spp: int) -> None:
    """Many samples, with seeds of their own."""
    settings: dict[str, Any] = {"spp": spp, "integrator": integrator, "size": 64, "tiles": 8}
    masked = studio.tiles(under_a_canopy(False), seeds=range(16), **settings)
    cut = studio.tiles(under_a_canopy(True), seeds=range(16, 32), **settings)
    evidence.equal("tiles", masked, cut, rounding=3e-5)


@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf"])
def test_holes_in_a_lamp(evidence: Evidence, studio: Studio, sampling: str) -> None:
    """Seen by light samples, and by rays that find it."""
    settings: dict[str, Any] = {"spp": 64, "sampling": sampling, "tiles": 4, "seeds": range(8), "max_depth": 1}
    glow = {"emission": [9.0, 5.0, 2.0], "flip_normals": False}
    masked = studio.tiles(under_a_canopy(False, **glow), **settings)
    evidence.equal("tiles", masked, studio.tiles(under_a_canopy(True, **glow), **settings), rounding=3e-5)


@pytest.mark.long
def test_half_a_lamp_shines_half(evidence: Evidence, studio: Studio) -> None:
    """Opacity scales what a surface sends out: spheres and disks, too."""
    floor = quad([-9.0, -9.0, -2.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], material="white")
    for lamp in (sphere([0, 0, 2], 0.5), disk([0, 0, 2], [0, 0, -1], 0.5), quad([-1, -1, 2], [0, 2, 0], [2, 0, 0])):
        shining = {**lamp, "material": "glass", "emission": [5.0, 5.0, 5.0]}
        for sampling in ("mis", "bsdf"):
            camera = {**STRAIGHT, "position": [0.0, 0.0, 1.0]}
            two = [
                described({"white": lambert(0.5), "glass": black(opacity)}, [floor, shining], camera)
                for opacity in (1.0, 0.25)
            ]
            whole, quarter = (
                studio.tiles(each, spp=64, max_depth=1, sampling=sampling, seeds=range(8)) for each in two
            )
            evidence.equal(f"{lamp['type']} {sampling}", whole * 0.25, quarter)


@pytest.mark.long
def test_a_shade_with_holes_that_shines_inwards(evidence: Evidence, studio: Studio) -> None:
    """From outside its far side is seen through its near side, which takes its share of the light."""
    shade = sphere([0.0, 0.0, 0.5], 1.0, material="shade", emission=[1.0, 1.0, 1.0])
    floor = quad([-4.0, -4.0, -1.0], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0], material="white")
    camera = {"position": [0.0, -6.0, 2.0], "target": [0.0, 0.0, 0.5], "vertical_fov": 45.0}
    materials = {"white": lambert(0.7), "shade": {**lambert(0.8), "opacity": 0.5}}
    what = described(materials, [floor, {**shade, "flip_normals": True}], camera)
    found = studio.tiles(what, spp=64, sampling="bsdf")
    ways: tuple[dict[str, Any], ...] = (
        {},
        {"sampling": "light"},
        *({"integrator": name} for name in ("bdpt", "photon", "reuse")),
    )
    for way in ways:
        evidence.equal(f"{way}", studio.tiles(what, spp=64, **way), found)


# --- what is known of holes without a look at the texture -------------------------------------------------------------


def soup(cutoff: float | None, count: int = 300) -> Scene:
    """Triangles with a ramp, of which most cells are known, and parallelograms with squares."""
    rng = np.random.default_rng(3)
    more = {} if cutoff is None else {"opacity_cutoff": cutoff}
    materials = {
        "ramp": {**lambert([0.2, 0.6, 0.1]), "opacity": {"ramp": [0.0] * 16 + [1.0] * 16 + [0.3] * 8}, **more},
        "squares": {**lambert([0.7, 0.4, 0.1]), "opacity": {"checker": [0.0, 1.0], "size": [0.3, 0.21]}, **more},
        "floor": lambert(0.5),
    }
    corners = rng.uniform(-1.0, 1.0, (count, 1, 3)) + rng.uniform(-0.3, 0.3, (count, 3, 3))
    corners[::4, 0] += 2.0 * (corners[::4, 0] - corners[::4, 1])
    corners[::4, 2] = corners[::4, 1] + 0.3 * (corners[::4, 2] - corners[::4, 1])  # slender: the BVH turns them
    squares = np.stack(
        [corners[:, 0], corners[:, 1], corners[:, 1] + corners[:, 2] - corners[:, 0], corners[:, 2]], axis=1
    )
    uvs = rng.uniform(-1.2, 1.2, (count * 4, 2))
    faces = np.arange(count)[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])
    shapes: list[dict[str, Any]] = [
        {
            "type": "mesh",
            "vertices": squares.reshape(-1, 3).tolist(),
            "faces": faces.reshape(-1, 3).tolist(),
            "uvs": uvs.tolist(),
            "material": "squares",
        },
        {
            "type": "mesh",
            "vertices": corners.reshape(-1, 3).tolist(),
            "faces": np.arange(count * 3).reshape(-1, 3).tolist(),
            "uvs": uvs[: count * 3].tolist(),
            "material": "ramp",
        },
        quad([-3.0, -1.5, -3.0], [0.0, 0.0, 6.0], [6.0, 0.0, 0.0], material="floor"),
    ]
    camera = {"position": [0.0, 0.5, 4.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 40.0}
    sun = {"type": "directional", "direction": [-0.3, -1.0, -0.2], "irradiance": [3.0, 3.0, 3.0]}
    return described(materials, shapes, camera, sun, {"type": "environment", "radiance": [0.4, 0.5, 0.7]})


@pytest.mark.long
@pytest.mark.parametrize("cutoff", [None, pytest.param(0.5, marks=_slow)])
def test_what_is_known_of_holes_changes_no_bit(
    device: Device, monkeypatch: pytest.MonkeyPatch, cutoff: float | None
) -> None:
    """In sessions of their own, as one would keep its arrays."""
    images = []
    for most in (holes._MOST_ROWS, 1):
        monkeypatch.setattr(holes, "_MOST_ROWS", most)
        with clrender.Session([device]) as session:
            images.append(Studio(session).image(soup(cutoff), 48, spp=8))
    assert np.array_equal(images[0], images[1])
