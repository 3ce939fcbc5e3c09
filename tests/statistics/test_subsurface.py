"""Subsurface materials: albedos of flat pieces, furnaces, light from all sides of the surface, bits and bad input."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from exact import half_space_albedo
from render_support import Studio, hashes_by_lanes_and_cuts, lambert, quad, scene, sphere
from stats_support import Evidence

import clrender
from clrender import layout
from clrender.flatten.flat_scene import flatten
from clrender.flatten.subsurface import single_scattering
from clrender.scene.materials import MOST_G

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

SLOW = pytest.mark.slow
SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in what a `Studio` measures."""
STRAIGHT = {"type": "orthographic", "position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "height": 0.5}
BESIDE = {"position": [0.0, 1.0, 5.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 40.0}
TABLE = 2e-4
"""Relative error of the table of albedos."""


def skin(albedo: Any = 1.0, radius: Any = 0.2, **more: Any) -> dict[str, Any]:
    return {"type": "subsurface", "albedo": albedo, "radius": radius, **more}


def slab(**more: Any) -> Scene:
    """A flat piece so thick and wide that nothing comes through, or from its sides."""
    block = {"type": "box", "size": [4.0, 4.0, 1.0], "material": "skin"}
    return scene([block], [SKY], STRAIGHT, skin=skin(**more))


def batches(studio: Studio, what: Scene, **settings: Any) -> Any:
    """(8,) means of renders with seeds of their own."""
    return [studio.pixels(what, 32, seed=seed, **settings).mean() for seed in range(8)]


@pytest.mark.long
@pytest.mark.parametrize("g", [0.0, pytest.param(0.8, marks=SLOW), -0.6])
@pytest.mark.parametrize("precise", [False, pytest.param(True, marks=SLOW)], ids=["", "precise"])
def test_albedo_of_a_flat_piece(evidence: Evidence, studio: Studio, g: float, precise: bool) -> None:
    """It is the one asked for, by colour: the mean noise is 0.05 % where it is to be precise."""
    what = slab(albedo=[0.05, 0.5, 0.85], radius=0.02 * (1.0 - max(g, 0.0)), g=g)
    exact = float([0.05, 0.5, 0.85] @ WEIGHTS)
    evidence.mean_is("albedo", batches(studio, what, spp=512 if precise else 4), exact, rounding=TABLE)


@pytest.mark.parametrize("alpha", [0.01, 0.2, 0.7, 0.95, 0.999])
def test_the_table_inverts_the_h_function(alpha: float) -> None:
    """Of isotropic scattering, for which Chandrasekhar's function gives the albedo of a half-space exactly."""
    albedo = half_space_albedo(alpha)
    assert 1.0 - single_scattering(albedo, 0.0) == pytest.approx(1.0 - alpha, rel=5e-4)
    assert single_scattering(albedo, 0.0) == pytest.approx(alpha, rel=3e-4)


@pytest.mark.parametrize("g", [-MOST_G, -0.4, 0.0, 0.5, MOST_G])
def test_the_ends_of_the_table(g: float) -> None:
    assert single_scattering(0.0, g) == 0.0 and single_scattering(1.0, g) == 1.0
    rising = [single_scattering(a, g) for a in np.linspace(0.0, 1.0, 200)]
    assert (np.diff(rising) > 0.0).all()


COLORED = [0.1, 0.2, 0.4]
FURNACES: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]] = {
    "forwards": ([sphere([0, 0, 0], 1.0, material="skin")], {"skin": skin(g=0.9)}),
    "backwards, coloured": ([sphere([0, 0, 0], 1.0, material="skin")], {"skin": skin(radius=COLORED, g=-0.5)}),
    "below glass": ([sphere([0, 0, 0], 1.0, material="skin")], {"skin": skin(g=0.5, ior=1.4)}),
    "below rough glass": ([sphere([0, 0, 0], 1.0, material="skin")], {"skin": skin(ior=1.4, roughness=0.5)}),
    "a box": ([{"type": "box", "size": [1.5, 1.5, 1.5], "material": "skin"}], {"skin": skin(radius=0.4)}),
    "around a ball": (
        [sphere([0, 0, 0], 1.0, material="skin"), sphere([0.2, 0, 0.5], 0.3, material="matt")],
        {"skin": skin(), "matt": lambert(1.0)},
    ),
    "with an eye": (
        [sphere([0, 0, 0], 1.0, material="skin"), sphere([0.2, 0, 0.8], 0.4, material="eye")],
        {"skin": skin(priority=1), "eye": {"type": "dielectric", "ior": 1.4, "priority": 2}},
    ),
    "two kinds": (
        [sphere([-0.4, 0, 0], 0.8, material="skin"), sphere([0.5, 0, 0], 0.7, material="wax")],
        {"skin": skin(), "wax": skin(radius=0.1)},
    ),
    "two kinds by priority": (
        [sphere([-0.4, 0, 0], 0.8, material="skin"), sphere([0.5, 0, 0], 0.7, material="wax")],
        {"skin": skin(priority=1), "wax": skin(radius=0.1, priority=2)},
    ),
    "touching": (
        [sphere([-0.7, 0, 0], 0.7, material="skin"), sphere([0.7, 0, 0], 0.7, material="skin")],
        {"skin": skin(priority=1)},
    ),
    "in a cloud": (
        [sphere([0, 0, 0], 1.0, interior="white"), sphere([0, 0, 0], 0.5, material="skin")],
        {"skin": skin()},
    ),
    "from inside": ([sphere([0, 0, 0], 9.0, material="skin")], {"skin": skin(radius=2.0)}),
}


PROGRAMS = ("below rough glass", "two kinds by priority", "in a cloud")
"""Those that need a program of their own, compiled for them alone."""


@pytest.mark.long
@pytest.mark.parametrize("name", [pytest.param(n, marks=[SLOW] if n in PROGRAMS else []) for n in FURNACES])
def test_what_absorbs_nothing_is_invisible(evidence: Evidence, studio: Studio, name: str) -> None:
    """In a white environment, whatever it looks like elsewhere."""
    shapes, materials = FURNACES[name]
    media = {"white": {"scattering": 2.0}} if name == "in a cloud" else {}
    what = clrender.Scene(camera=BESIDE, shapes=shapes, lights=[SKY], materials=materials, media=media)
    evidence.mean_is("furnace", batches(studio, what, spp=8, roulette="none"), 1.0, rounding=2e-5)


@pytest.mark.long
def test_walks_that_absorb_nothing_have_no_noise(studio: Studio) -> None:
    """Roulette ends none of them; each brings the radiance of the sky, but for roundings."""
    what = scene([sphere([0, 0, 0], 1.0, material="skin")], [SKY], BESIDE, skin=skin(g=0.5))
    np.testing.assert_allclose(studio.pixels(what, 16, spp=4), 1.0, rtol=1e-4)


LIQUID = {"type": "box", "center": [0.0, -1.5, 0.0], "size": [4.0, 3.0, 4.0], "material": "liquid"}
LIQUIDS: dict[str, dict[str, Any]] = {
    "without an index": skin(priority=2),
    "that loses to the liquid": skin(priority=0),
    "of another index": skin(ior=1.3, priority=2),
    "rough": skin(ior=1.3, roughness=0.4, priority=2),
    "glass": {"type": "dielectric", "ior": 1.8, "priority": 2},
    "rough glass": {"type": "dielectric", "ior": 1.8, "roughness": 0.3, "priority": 2},
}
IN_LIQUID = pytest.mark.parametrize("height", [2.0, -1.2], ids=["from above", "through the liquid"])


def half_in_liquid(height: float, lights: list[dict[str, Any]], *more: dict[str, Any], **material: Any) -> Scene:
    """A ball, the lower half of which is in a liquid of index 1.5, seen from that height."""
    camera = {"position": [0.0, height, 6.0], "target": [0.0, -0.2, 0.0], "vertical_fov": 9.0}
    liquid = {"type": "dielectric", "ior": 1.5, "priority": 1}
    ball = sphere([0, 0, 0], 0.9, material="ball")
    return scene([ball, LIQUID, *more], lights, camera, ball=material, liquid=liquid)


@IN_LIQUID
@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n == "without an index" else [SLOW]) for n in LIQUIDS])
def test_what_is_partly_in_a_liquid_is_invisible(evidence: Evidence, studio: Studio, name: str, height: float) -> None:
    """Radiance over the squared index is the same everywhere, whichever surfaces are between the indices."""
    pixels = studio.pixels(half_in_liquid(height, [SKY], **LIQUIDS[name]), 12, spp=16)
    evidence.mean_is("furnace", pixels, 1.0, rounding=2e-5)


def test_lamps_in_a_liquid_are_found_in_every_way(evidence: Evidence, studio: Studio) -> None:
    """From both sides of the surface between them: it reflects what cannot pass to the lower index."""
    lamp = sphere([1.2, -1.2, 1.2], 0.3, emission=5.0)
    what = half_in_liquid(-1.2, [], lamp, **LIQUIDS["without an index"])
    by_mis = studio.tiles(what, range(8), 16, spp=64, sampling="mis")
    evidence.equal("tiles", by_mis, studio.tiles(what, range(50, 58), 16, spp=64, sampling="bsdf"))


def test_paths_that_leave_a_white_body_through_a_hole_end(studio: Studio) -> None:
    """Its medium has no end there. The body is a plate, so light that passes beside it never meets anything again."""
    plate = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], material="skin")
    what = scene([plate], [SKY], {**BESIDE, "vertical_fov": 10.0}, skin=skin(radius=0.05))
    (warning,) = flatten(what, 8, 8).warnings
    assert "skin: light scatters in it without being absorbed, and its surface has a hole" in warning
    closed = scene([sphere([0, 0, 0], 1.0, material="skin")], [SKY], BESIDE, skin=skin())
    assert not flatten(closed, 8, 8).warnings
    assert not flatten(scene([plate], [SKY], BESIDE, skin=skin(albedo=0.9)), 8, 8).warnings
    pixels = studio.pixels(what, 16, spp=16)
    assert 0.7 < pixels.mean() < 1.1


def lit(light: str, **material: Any) -> Scene:
    """A block above a floor."""
    shapes = [
        {"type": "box", "size": [3.0, 0.4, 3.0], "material": "block"},
        quad([-3, 0.2, -0.5], [6, 0, 0], [0, 2, -1], material="wall"),
    ]
    lights: list[dict[str, Any]] = []
    if light == "lamp":
        shapes.append(quad([-0.5, 1.2, 0.2], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], emission=8.0))
    if light == "point":
        lights.append({"type": "point", "position": [0.5, 1.0, 0.5], "intensity": [1.0, 2.0, 1.0]})
    if light == "sky":
        lights.append(SKY)
    camera = {"position": [0.0, 3.0, 1.5], "target": [0.0, 0.2, 0.4], "vertical_fov": 25.0}
    return scene(shapes, lights, camera, block=material, wall=lambert(0.6))


ALBEDO = (0.3, 0.6, 0.8)


@pytest.mark.parametrize("light", ["lamp", "point", "sky"])
def test_with_short_ways_it_is_lambert(evidence: Evidence, studio: Studio, light: str) -> None:
    """Where light leaves a flat piece next to where it entered, from all kinds of light."""
    short = studio.tiles(lit(light, **skin(list(ALBEDO), 2e-4)), range(8), spp=16)
    plain = studio.tiles(lit(light, **lambert(ALBEDO)), range(100, 108), spp=16)
    evidence.equal("tiles", short, plain)


def test_ways_to_find_light_agree(evidence: Evidence, studio: Studio) -> None:
    """Where it leaves, by samples of lights, of the surface, and of both."""
    what = lit("lamp", **skin(list(ALBEDO), 0.05))
    ways = ("mis", "light", "bsdf")
    mis, light, bsdf = (
        studio.tiles(what, range(100 * i, 100 * i + 8), spp=32, sampling=way) for i, way in enumerate(ways)
    )
    evidence.equal("lights", mis, light)
    evidence.equal("surface", mis, bsdf)


def lantern(ior: float | None = None) -> Scene:
    """A ball of wax with a lamp inside, or beside it."""
    wax = skin([0.9, 0.7, 0.4], 0.3, **({} if ior is None else {"ior": ior}))
    shapes = [sphere([0, 0, 0], 1.0, material="wax"), sphere([0.1, 0, 0], 0.3, emission=3.0)]
    return scene(shapes, [], BESIDE, wax=wax)


@pytest.mark.long
@pytest.mark.parametrize("ior", [None, 1.3])
def test_a_lamp_inside(evidence: Evidence, studio: Studio, ior: float | None) -> None:
    """Then light is sampled on walks, too."""
    mis, light, bsdf = (
        studio.tiles(lantern(ior), range(100 * i, 100 * i + 8), spp=32, sampling=way)
        for i, way in enumerate(("mis", "light", "bsdf"))
    )
    evidence.equal("surface", mis, bsdf)
    if ior is None:
        evidence.equal("lights", mis, light)


def test_direct_light_of_what_has_no_dents(evidence: Evidence, studio: Studio) -> None:
    """`direct` walks, too, and samples lights where light leaves; of a ball alone that is all light."""
    light = {"type": "directional", "direction": [1.0, -0.5, -0.5], "irradiance": [3.0, 3.0, 3.0]}
    what = scene([sphere([0, 0, 0], 1.0, material="skin")], [light], BESIDE, skin=skin([0.9, 0.6, 0.4], COLORED))
    path, direct = (studio.tiles(what, range(8), spp=16, integrator=name) for name in ("path", "direct"))
    evidence.equal("tiles", path, direct)


@SLOW
def test_paths_that_split_where_light_leaves(evidence: Evidence, studio: Studio) -> None:
    what = lit("lamp", **skin(list(ALBEDO), 0.05))
    whole, several = (studio.tiles(what, range(100 * n, 100 * n + 8), spp=16, indirect_rays=n) for n in (1, 3))
    evidence.equal("tiles", whole, several)


def test_walks_are_dark_unless_something_shines_inside(device: Device) -> None:
    """No shadow ray leaves a step of a walk; flags of the media say so."""
    fields = layout.ROWS["MEDIUM"]
    at = next(first for name, first, _, _ in fields if name == "FLAGS")
    dark = layout.MEDIUM_FLAG_DARK | layout.MEDIUM_FLAG_SUBSURFACE
    for what, expected in ((lit("lamp", **skin()), dark), (lantern(), layout.MEDIUM_FLAG_SUBSURFACE)):
        assert flatten(what, 8, 8).arrays["media_rows"][1:, at].view(np.uint32).tolist() == [expected]
    ball = scene([sphere([0, 0, 0], 1.0, material="skin")], [SKY], BESIDE, skin=skin([0.9] * 3, 0.05))
    light = {"type": "point", "position": [0.0, 3.0, 0.0], "intensity": [1.0] * 3}
    ball = ball.model_copy(update={"lights": scene([], [light]).lights})
    stats = clrender.render(ball, device=device.info.index, size=(16, 16), spp=16).stats
    # A path leaves a ball once
    assert stats["rays"] > 5 * stats["samples"] and 0 < stats["shadow_rays"] <= stats["samples"]


@pytest.mark.long
@pytest.mark.parametrize("more", [{}, {"ior": 1.4}, pytest.param({"ior": 1.4, "roughness": 0.4}, marks=SLOW)], ids=str)
def test_the_layer_shows_the_albedo(device: Device, more: dict[str, Any]) -> None:
    camera = {**STRAIGHT, "height": 0.1}
    what = scene([sphere([0, 0, 0], 1.0, material="skin")], [SKY], camera, skin=skin(list(ALBEDO), 0.1, **more))
    layer = clrender.render(what, device=device.info.index, size=(4, 4), spp=1, aov=("albedo",)).aovs["albedo"]
    np.testing.assert_allclose(layer, np.broadcast_to(ALBEDO, layer.shape), rtol=1e-6)


def gathered() -> Scene:
    """Skin, wax below a rough surface, glass, metal and textures: paths are sorted by what they met."""
    shapes = [
        quad([-3, -1, 3], [6, 0, 0], [0, 0, -6], material="board"),
        sphere([-0.8, 0, 0], 0.8, material="skin"),
        sphere([0.9, 0, 0], 0.7, material="wax"),
        sphere([-0.4, -0.2, 0.7], 0.3, material="eye"),
        sphere([0.2, 1.2, -0.3], 0.4, material="gold"),
        quad([-0.5, 3.0, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], emission=12.0),
    ]
    return scene(
        shapes,
        [SKY],
        BESIDE,
        skin=skin([0.8, 0.5, 0.3], [0.1, 0.05, 0.02], priority=1),
        wax=skin([0.9, 0.7, 0.4], 0.1, g=0.6, ior=1.45, roughness=0.3),
        eye={"type": "dielectric", "ior": 1.34, "priority": 2},
        gold={"type": "conductor", "metal": "Au", "roughness": 0.4},
        board={"type": "lambert", "reflectance": {"checker": [0.2, 0.8]}},
    )


@SLOW
def test_bits_do_not_depend_on_lanes_and_cuts(device: Device) -> None:
    """Beside the scene `candles`, which is one of those of tests/image: with all that makes a program large."""
    what = gathered()
    assert len(hashes_by_lanes_and_cuts(device, what)) == 1


@pytest.mark.parametrize("integrator", ["whitted", "reuse", "radiosity"])
def test_integrators_refuse_it(integrator: str) -> None:
    message = rf"^Scene: shapes\[0\].material: 'skin' is of type subsurface, which the integrator {integrator} does not"
    with pytest.raises(clrender.SceneError, match=message):
        clrender.RenderJob.of(scene([sphere([0, 0, 0], 1.0, material="skin")], skin=skin()), integrator=integrator)


@pytest.mark.parametrize(
    ("shape", "materials", "message"),
    [
        ({}, {"skin": skin(albedo=[1.2, 0, 0])}, r"materials.skin.albedo\[0\]"),
        ({}, {"skin": skin(radius=0.0)}, r"materials.skin.radius\[0\]"),
        ({}, {"skin": skin(g=0.99)}, r"materials.skin.g "),
        ({}, {"skin": skin(ior=1.0)}, r"materials.skin.ior "),
        ({}, {"skin": skin(roughness=0.3)}, r"materials.skin.roughness is given without ior; name the index"),
        ({}, {"skin": {"type": "subsurface", "albedo": 0.5}}, r"materials.skin: the key `radius` is missing"),
        ({"interior": "smoke"}, {"skin": skin()}, r"shapes\[0\].interior is given, but .* \"skin\" is subsurface"),
        (
            {},
            {"skin": {"type": "mix", "materials": ["a", "b"]}, "a": lambert(0.5), "b": skin()},
            r"names \"b\", which is",
        ),
    ],
    ids=str,
)
def test_what_is_refused(shape: dict[str, Any], materials: dict[str, Any], message: str) -> None:
    media = {"smoke": {"scattering": 1.0}}
    ball = sphere([0, 0, 0], 1.0, material="skin", **shape)
    with pytest.raises(clrender.SceneError, match=message):
        clrender.Scene(camera=BESIDE, shapes=[ball], materials=materials, media=media)
