"""Media that scatter: transmittance, single scattering and furnaces in closed form; ways to find light, compared."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, down, hashes_by_lanes_and_cuts, lambert, quad, sphere
from scipy import integrate
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in what a `Studio` measures."""
SMOKE: dict[str, Any] = {"absorption": [0.2, 0.1, 0.05], "scattering": [2.0, 1.0, 3.0], "g": 0.6}
STRAIGHT = {"type": "orthographic", "position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "height": 0.5}
BESIDE = {"position": [0.0, 1.0, 5.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 40.0}


def described(shapes: list[dict[str, Any]], lights: list[dict[str, Any]], camera: dict[str, Any], **more: Any) -> Scene:
    """A scene; `more`: media, fog and materials."""
    return clrender.Scene(camera=camera, shapes=tuple(shapes), lights=tuple(lights), **more)


def slab(thickness: float, **more: Any) -> dict[str, Any]:
    """So wide that nothing of what is seen comes from its sides."""
    return {"type": "box", "size": [4000.0, 4000.0, thickness], "interior": "smoke", **more}


def batches(studio: Studio, what: Scene, **settings: Any) -> Any:
    """(8,) means of renders with seeds of their own."""
    return [studio.pixels(what, 32, seed=seed, **settings).mean() for seed in range(8)]


@pytest.mark.long
@pytest.mark.parametrize("thickness", [0.01, 0.5, 3.0])
def test_light_that_nothing_scatters(evidence: Evidence, studio: Studio, thickness: float) -> None:
    """Through a slab comes e^(-(absorption + scattering) d)."""
    what = described([slab(thickness)], [SKY], STRAIGHT, media={"smoke": SMOKE})
    left = np.exp(-np.add(SMOKE["absorption"], SMOKE["scattering"]) * thickness)
    evidence.mean_is("transmittance", batches(studio, what, spp=256, max_depth=0), float(left @ WEIGHTS))


@pytest.mark.long
@pytest.mark.parametrize("ball", [False, True], ids=["alone", "beside a ball"])
def test_fog_that_only_absorbs(evidence: Evidence, studio: Studio, ball: bool) -> None:
    """Also where no path is in anything else: a lamp 5 m away, of which each channel keeps e^(-5 absorption)."""
    lamp = quad([-1.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], emission=[1.0, 1.0, 1.0])
    fog = {"smoke": {"absorption": [0.1, 0.2, 0.4]}}
    shapes = [lamp, sphere([3.0, 0.0, 0.0], 0.1, interior="smoke")] if ball else [lamp]
    left = float(np.exp([-0.5, -1.0, -2.0]) @ WEIGHTS)
    what = described(shapes, [], STRAIGHT, media=fog, fog="smoke")
    evidence.mean_is("lamp", batches(studio, what, spp=4), left)


_slow = pytest.mark.slow


@pytest.mark.parametrize(
    ("toward", "g"),
    [
        ((0.0, 0.0, -1.0), 0.6),
        ((0.6, 0.3, -0.5), -0.4),
        pytest.param((0.0, 0.0, -1.0), 0.0, marks=_slow),
        pytest.param((0.0, 0.0, -1.0), -0.4, marks=_slow),
        pytest.param((0.6, 0.3, -0.5), 0.0, marks=_slow),
        pytest.param((0.6, 0.3, -0.5), 0.6, marks=_slow),
    ],
)
def test_light_scattered_once(evidence: Evidence, studio: Studio, toward: tuple[float, ...], g: float) -> None:
    """Parallel light on a slab, seen from before it: σs p E (1 - e^(-σ d (1 + 1/μ))) / (σ (1 + 1/μ))."""
    light = {"type": "directional", "direction": list(toward), "irradiance": [2.0, 2.0, 2.0]}
    what = described([slab(0.7)], [light], STRAIGHT, media={"smoke": {**SMOKE, "g": g}})
    unit = np.asarray(toward) / np.linalg.norm(toward)
    cosine, longer = unit[2], 1.0 - 1.0 / unit[2]
    phase = (1.0 - g * g) / (4.0 * math.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)
    extinction = np.add(SMOKE["absorption"], SMOKE["scattering"])
    once = (
        np.asarray(SMOKE["scattering"])
        * phase
        * 2.0
        * (1.0 - np.exp(-extinction * 0.7 * longer))
        / (extinction * longer)
    )
    for settings in ({"integrator": "direct"}, {"max_depth": 1}):
        evidence.mean_is(str(settings), batches(studio, what, spp=64, **settings), float(once @ WEIGHTS))


@pytest.mark.long
@pytest.mark.parametrize("end", [-2.0, None], ids=["wall", "endless"])
@pytest.mark.parametrize(
    ("height", "density"), [(0.05, 1.0), pytest.param(0.8, 0.1, marks=_slow), pytest.param(3.0, 0.3, marks=_slow)]
)
def test_fog_around_a_lamp(
    evidence: Evidence, studio: Studio, height: float, density: float, end: float | None
) -> None:
    """A lamp beside the line of sight, `height` away: ∫ σs p I e^(-σ (t + d)) / d² dt, in all the ways to sample t.

    Nothing but the fog is seen, which a black wall ends or nothing does.
    """
    fog: dict[str, Any] = {"scattering": [2.0 * density, density, 3.0 * density], "absorption": 0.2 * density, "g": 0.6}
    extinction = np.add(fog["scattering"], fog["absorption"])

    def from_distance(t: float) -> Any:
        away = math.hypot(height, t - 4.0)
        cosine = (4.0 - t) / away
        phase = (1.0 - 0.36) / (4.0 * math.pi * (1.36 - 1.2 * cosine) ** 1.5)
        return WEIGHTS @ (fog["scattering"] * np.exp(-extinction * (t + away)) * phase * 5.0 / away**2)

    last = 60.0 / density if end is None else 5.0 - end
    seen, _ = integrate.quad(from_distance, 0.0, last, points=[4.0 - height, 4.0, 4.0 + height], limit=1000)
    wall = [] if end is None else [quad([-9.0, -9.0, end], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0])]
    lamp = {"type": "point", "position": [height, 0.0, 1.0], "intensity": [5.0, 5.0, 5.0]}
    camera = {**STRAIGHT, "height": 1e-3 * height}
    what = described(wall, [lamp], camera, media={"smoke": fog}, fog="smoke")
    for settings in ({"integrator": "direct"}, {"max_depth": 1}):
        evidence.mean_is(str(settings), batches(studio, what, spp=256, **settings), seen, rounding=1e-5)


GLASS = {"type": "dielectric", "ior": 1.5}
FURNACES: dict[str, list[dict[str, Any]]] = {
    "sphere": [sphere([0.0, 0.0, 0.0], 1.0, interior="white")],
    "below glass": [sphere([0.0, 0.0, 0.0], 1.0, material="glass", interior="white")],
    "below rough glass": [sphere([0.0, 0.0, 0.0], 1.0, material="rough", interior="white")],
    "one in the other": [
        sphere([0.0, 0.0, 0.1 * i], 1.0 - 0.3 * i, interior=m) for i, m in enumerate(("white", "thin"))
    ],
    "around a ball": [sphere([0.0, 0.0, 0.0], 1.0, interior="white"), sphere([0.2, 0.0, 0.0], 0.4, material="matt")],
    "by priority": [
        sphere([0.0, 0.0, 0.0], 1.0, material="first", interior="white"),
        sphere([0.5, 0.0, 0.5], 0.8, material="second", interior="thin"),
    ],
}


@pytest.mark.long
@pytest.mark.parametrize("name", FURNACES)
def test_what_absorbs_nothing_is_invisible(evidence: Evidence, studio: Studio, name: str) -> None:
    """In a white environment, however it scatters."""
    shapes = FURNACES[name]
    media = {
        "white": {"scattering": [4.0, 1.0, 8.0], "g": 0.4},
        "thin": {"scattering": 1.0, "g": -0.7},
    }
    materials = {
        "glass": GLASS,
        "rough": {**GLASS, "roughness": 0.5},
        "matt": lambert(1.0),
        "first": {**GLASS, "priority": 1},
        "second": {**GLASS, "ior": 1.3, "priority": 2},
    }
    used = {shape["material"] for shape in shapes if "material" in shape}
    what = described(shapes, [SKY], BESIDE, media=media, materials={n: m for n, m in materials.items() if n in used})
    evidence.mean_is("furnace", batches(studio, what, spp=32, roulette="none"), 1.0, rounding=1e-5)


def in_smoke(lamp: bool, fog: bool = False) -> Scene:
    """A cloud above a floor, or all in fog, with a lamp or a point light over it."""
    floor = quad([-3, -1, 3], [6, 0, 0], [0, 0, -6], material="matt")
    shapes = [floor] if fog else [floor, sphere([0.0, 0.0, 0.0], 0.9, interior="smoke")]
    if lamp:
        shapes.append(quad([-0.5, 2.0, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], emission=[8.0, 8.0, 8.0]))
    point = {"type": "point", "position": [1.0, 2.0, 1.0], "intensity": [5.0, 5.0, 5.0]}
    media = {"smoke": {**SMOKE, "scattering": [0.2, 0.1, 0.3]} if fog else SMOKE}
    more = {"fog": "smoke"} if fog else {}
    return described(shapes, [] if lamp else [point], BESIDE, media=media, materials={"matt": lambert(0.7)}, **more)


@pytest.mark.long
@pytest.mark.parametrize("fog", [False, True], ids=["cloud", "fog"])
def test_lights_are_found_alike(evidence: Evidence, studio: Studio, fog: bool) -> None:
    """By samples of lights, which pass the cloud's surface, of the phase function, and of both."""
    what = in_smoke(lamp=True, fog=fog)
    by = {
        s: studio.tiles(what, range(100 * i, 100 * i + 8), spp=64, sampling=s)
        for i, s in enumerate(("mis", "light", "bsdf"))
    }
    evidence.equal("lights", by["mis"], by["light"])
    evidence.equal("phase function", by["mis"], by["bsdf"])


@pytest.mark.long
def test_paths_that_split_in_a_cloud(evidence: Evidence, studio: Studio) -> None:
    """All rays that leave the first point where light scatters leave that point: behind the cloud it is dark."""
    light = {"type": "point", "position": [1.0, 2.0, 4.0], "intensity": [20.0, 20.0, 20.0]}
    ball = sphere([0.0, 0.0, 0.0], 0.9, interior="smoke")
    what = described([ball], [light], BESIDE, media={"smoke": {"scattering": 10.0}})
    whole, several = (studio.tiles(what, range(100 * n, 100 * n + 8), spp=32, indirect_rays=n) for n in (1, 4))
    evidence.equal("tiles", whole, several)


@pytest.mark.long
def test_a_cloud_is_as_bright_cut_in_two(evidence: Evidence, studio: Studio) -> None:
    """Surfaces inside of a medium that are no boundaries change nothing, lit by a point, however many there are."""
    whole, cut = in_smoke(lamp=False), in_smoke(lamp=False)
    inner = [sphere([0.1 * i, 0.0, 0.0], 0.6 - 0.1 * i, interior="smoke") for i in range(4)]
    cut = cut.model_copy(update={"shapes": (*cut.shapes, *described(inner, [], BESIDE, media={"smoke": SMOKE}).shapes)})
    evidence.equal("tiles", studio.tiles(whole, range(8), spp=64), studio.tiles(cut, range(100, 108), spp=64))


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", pytest.param("photon", marks=pytest.mark.slow)])
def test_light_passes_a_box_of_index_one(evidence: Evidence, studio: Studio, integrator: str) -> None:
    """Shadow rays of a point light go straight through, and photons do not bring that light again."""
    settings: dict[str, Any] = {"integrator": integrator, "spp": 4}
    materials = {
        "matt": lambert(0.7),
        "air": {"type": "dielectric", "ior": 1.0, "priority": 3},
        "wall": {"type": "dielectric", "ior": 1.5, "priority": 1},
    }
    floor = quad([-3, -1, 3], [6, 0, 0], [0, 0, -6], material="matt")
    light = {"type": "point", "position": [1.0, 2.0, 1.0], "intensity": [5.0, 5.0, 5.0]}
    away = sphere([0.0, 5.0, 0.0], 0.1, material="wall")
    block = {"type": "box", "center": [0.3, 0.2, 0.3], "size": [1.0, 1.0, 1.0], "material": "air"}
    there = described([floor, away, block], [light], BESIDE, materials=materials)
    without = described([floor, away], [light], BESIDE, materials=materials)
    settings |= {"photons": 2000} if integrator == "photon" else {}
    evidence.equal("tiles", studio.tiles(there, range(8), **settings), studio.tiles(without, range(8), **settings))


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [[1], [4, 8, 16]], ids=str)
def test_bits_do_not_depend_on_lanes_and_cuts(device: Device, lanes: list[int]) -> None:
    """Beside textures and rough materials, whose paths are sorted."""
    what = in_smoke(lamp=True)
    ball = sphere([1.4, -0.5, 0.5], 0.5, material="gold")
    gold = {"type": "conductor", "metal": "Au", "roughness": 0.4}
    both = described([ball], [SKY], BESIDE, materials={"gold": gold})
    what = what.model_copy(
        update={
            "shapes": (*what.shapes, *both.shapes),
            "lights": both.lights,
            "materials": {**what.materials, **both.materials},
        }
    )
    assert len(hashes_by_lanes_and_cuts(device, what, lanes)) == 1


ENDLESS: dict[str, dict[str, Any]] = {
    "environment": SKY,
    "directional": {"type": "directional", "direction": [0.0, -1.0, 0.0], "irradiance": [1.0, 1.0, 1.0]},
    "sun_sky": {"type": "sun_sky", "sun_direction": [0.0, 1.0, 0.2], "scale": 1e-4},
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("light", "scatters"),
    [
        pytest.param("environment", True, marks=pytest.mark.slow),
        ("directional", True),
        ("sun_sky", True),
        ("environment", False),
    ],
)
def test_light_from_infinity_in_fog(evidence: Evidence, studio: Studio, light: str, scatters: bool) -> None:
    """None arrives of the channels that the fog absorbs or scatters, and all of the one that it does not.

    On a floor, in the open sky, and in a layer, by every way to sample light.
    """
    fog = {"absorption": [0.5, 0.0, 0.3], "scattering": [0.5, 0.0, 0.1] if scatters else 0.0}
    floor = quad([-50.0, 0.0, 50.0], [100.0, 0.0, 0.0], [0.0, 0.0, -100.0], material="white")
    cameras = {"floor": {**down(height=1.0, degrees=20.0)}, "sky": {**down(height=1.0), "target": [0.0, 2.0, 0.0]}}
    within = {"media": {"smoke": fog}, "materials": {"white": lambert(0.8)}}
    for place, camera in cameras.items():
        foggy = described([floor], [ENDLESS[light]], camera, **within, fog="smoke")
        seen = {way: studio.image(foggy, 8, spp=64, sampling=way) for way in ("mis", "light", "bsdf")}
        for way, image in seen.items():
            assert not image[..., [0, 2]].any(), (place, way)
        clear = studio.image(described([floor], [ENDLESS[light]], camera, **within), 8, spp=64)[..., 1]
        for way in ("mis", "light") if light == "sun_sky" else seen:
            evidence.equal(f"{place} {way}", seen[way][..., 1].ravel(), clear.ravel())
    albedo = studio.layer(foggy, 8, "albedo")
    assert not albedo[..., [0, 2]].any()
    assert bool(albedo[..., 1].any()) == (light != "directional")


@pytest.mark.long
def test_light_from_infinity_in_a_cloud_without_an_end(evidence: Evidence, studio: Studio) -> None:
    """A shape that is not closed: by no way to sample light does any come through its medium from infinity."""
    smoke = {"smoke": {"scattering": 2.0, "absorption": 3.0}}
    front = quad([-50.0, -50.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0], interior="smoke")
    behind = {**ENDLESS["directional"], "direction": [0.0, 0.0, 1.0]}
    assert not studio.image(described([front], [behind], STRAIGHT, media=smoke), 8, spp=16).any()
    around = described([front], [SKY], STRAIGHT, media=smoke)
    by_bsdf = studio.pixels(around, 16, spp=64, max_depth=1, sampling="bsdf")
    for way in ("mis", "light"):
        evidence.equal(way, studio.pixels(around, 16, spp=64, max_depth=1, sampling=way), by_bsdf)


@pytest.mark.parametrize("integrator", ["whitted", "reuse", "radiosity"])
@pytest.mark.parametrize("fog", [False, True], ids=["shape", "fog"])
def test_integrators_refuse_media(device: Device, integrator: str, fog: bool) -> None:
    place = "fog" if fog else r"shapes\[1\].interior"
    with pytest.raises(clrender.SceneError, match=rf"^Scene: {place} is a medium, which the integrator {integrator}"):
        clrender.render(in_smoke(False, fog), device=device.info.index, size=(8, 8), spp=1, integrator=integrator)
