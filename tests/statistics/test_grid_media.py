"""Media whose density is a grid, against homogeneous ones and integrals of transmittance and single scattering."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mixed_files import written
from mixed_scenes import Mixed, mixed_scene
from render_support import Studio, hashes_by_lanes_and_cuts, lambert, quad, sphere
from scipy import integrate
from stats_support import Evidence

import clrender

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in what a `Studio` measures."""
STRAIGHT = {"type": "orthographic", "position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "height": 0.5}
BESIDE = {"position": [0.3, 0.8, 4.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 40.0}
GREY: dict[str, Any] = {"absorption": 0.5, "scattering": 3.0, "g": 0.4}
COLORED: dict[str, Any] = {"absorption": [0.2, 0.6, 1.0], "scattering": [3.0, 1.0, 0.3], "g": -0.3}
ONE_CHANNEL: dict[str, Any] = {"absorption": [0.2, 0.0, 1.0], "scattering": [3.0, 0.0, 0.3]}
DARK: dict[str, Any] = {"absorption": [1.0, 0.3, 2.0]}


def filled(medium: dict[str, Any], values: Any, camera: dict[str, Any], lights: list[Any], **density: Any) -> Scene:
    """A box of 2 m about the origin, full of a medium with a grid; None: with none."""
    given = {} if values is None else {"density": {"file": "grid", "box": [[-1.0] * 3, [1.0] * 3], **density}}
    scene = clrender.Scene(
        camera=camera,
        shapes=({"type": "box", "size": [2.0, 2.0, 2.0], "interior": "smoke"},),
        lights=tuple(lights),
        media={"smoke": {**medium, **given}},
    )
    return scene if values is None else scene.with_arrays(grids={"grid": values})


_long = pytest.mark.long


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("integrator", "medium"),
    [
        pytest.param("path", GREY, id="path, grey"),
        pytest.param("path", COLORED, id="path, colored"),
        pytest.param("path", ONE_CHANNEL, id="path, one channel"),
        pytest.param("path", DARK, id="path, dark", marks=_long),
        pytest.param("bdpt", COLORED, id="bdpt, colored", marks=_long),
        pytest.param("bdpt", GREY, id="bdpt, grey", marks=_long),
        pytest.param("bdpt", ONE_CHANNEL, id="bdpt, one channel", marks=_long),
        pytest.param("bdpt", DARK, id="bdpt, dark", marks=_long),
    ],
)
def test_a_constant_grid_is_a_homogeneous_medium(
    evidence: Evidence, studio: Studio, integrator: str, medium: dict[str, Any]
) -> None:
    lamp = {"type": "point", "position": [2.0, 3.0, 2.0], "intensity": [30.0, 28.0, 25.0]}
    made = [filled(medium, values, BESIDE, [SKY, lamp]) for values in (np.full((5, 9, 7), 1.0, np.float32), None)]
    settings: dict[str, Any] = {"spp": 32, "integrator": integrator, "size": 24}
    first, second = (studio.tiles(each, range(n, n + 12), **settings) for each, n in zip(made, (0, 100), strict=True))
    evidence.equal("radiance", first, second)


@pytest.mark.slow
def test_constant_grids_in_mixed_scenes(evidence: Evidence, studio: Studio, tmp_path: Path) -> None:
    """Of twenty random scenes, all media but the fog: once as they are, and once with a grid of ones."""
    folder = written(tmp_path)
    np.save(folder / "ones.npy", np.ones((3, 4, 2), np.float32))
    ones = {"file": "ones.npy", "box": [[-90.0] * 3, [90.0] * 3]}
    found, of_grids = 0, ("density", "albedo", "emission_grid", "temperature")
    for number in range(200):
        mixed = mixed_scene("light", number)
        media = {
            name: {k: v for k, v in each.items() if k not in of_grids}
            for name, each in mixed.content.get("media", {}).items()
        }
        filled = {shape.get("interior") for shape in mixed.content["shapes"]} & media.keys() - {
            mixed.content.get("fog")
        }
        if not filled or found == 20:
            continue
        found += 1
        grids = {name: {**each, **({"density": ones} if name in filled else {})} for name, each in media.items()}
        first, second = (
            studio.tiles(
                Mixed(mixed.name, {**mixed.content, "media": each}).scene(folder), range(n, n + 10), 16, spp=64
            )
            for each, n in ((media, 0), (grids, 50))
        )
        evidence.equal(mixed.name, first, second)
    assert found == 20


def ramp(z: Any, edges: str) -> Any:
    """Density along z of a grid of 0, 1, 3, 2 in the box from -1 to 1, by its definition."""
    middles = np.array([-1.25, -0.75, -0.25, 0.25, 0.75, 1.25])
    numbers = np.array([0.0, 0.0, 1.0, 3.0, 2.0, 2.0 if edges == "keep" else 0.0])
    return np.interp(z, middles, numbers)


@pytest.mark.parametrize("edges", ["keep", "fall"])
@pytest.mark.parametrize("scatters", [False, True], ids=["absorbed", "scattered"])
def test_transmittance_of_a_ramp(evidence: Evidence, studio: Studio, scatters: bool, edges: str) -> None:
    """Light that comes straight through: e^(-σ ∫ density)."""
    sigma = np.array([0.2, 0.5, 1.1])
    medium: dict[str, Any] = {"scattering" if scatters else "absorption": sigma.tolist()}
    values = np.tile(np.array([0.0, 1.0, 3.0, 2.0], np.float32)[:, None, None], (1, 3, 2))
    depth, _ = integrate.quad(ramp, -1.0, 1.0, args=(edges,), points=[-0.75, -0.25, 0.25, 0.75])
    what = filled(medium, values, STRAIGHT, [SKY], edges=edges)
    made = [studio.pixels(what, 32, spp=64, max_depth=0, seed=seed).mean() for seed in range(8)]
    evidence.mean_is("transmittance", made, float(np.exp(-sigma * depth) @ WEIGHTS))


def test_a_shadow_of_a_ramp(evidence: Evidence, studio: Studio) -> None:
    """Parallel light through the box on a floor, which is ratio tracking."""
    sigma = np.array([0.2, 0.5, 1.1])
    values = np.array([0.0, 1.0, 3.0, 2.0], np.float32).reshape(1, 4, 1)
    depth, _ = integrate.quad(ramp, -1.0, 1.0, args=("keep",), points=[-0.75, -0.25, 0.25, 0.75])
    sun = {"type": "directional", "direction": [0.0, -1.0, 0.0], "irradiance": [np.pi] * 3}
    scene = filled({"absorption": sigma.tolist()}, values, BESIDE, [sun])
    camera = {"position": [2.2, -1.5, 0.0], "target": [0.0, -2.0, 0.0], "vertical_fov": 0.01}
    floor = quad([-9.0, -2.0, 9.0], [18.0, 0.0, 0.0], [0.0, 0.0, -18.0], material="floor")
    what = scene.changed(camera=camera, shapes=[*scene.shapes, floor], materials={"floor": lambert(1.0)})
    made = [studio.pixels(what, 32, spp=16, seed=seed).mean() for seed in range(8)]
    evidence.mean_is("shadow", made, float(np.exp(-sigma * depth) @ WEIGHTS))


def test_light_scattered_once_in_a_ramp(evidence: Evidence, studio: Studio) -> None:
    """Parallel light along the view, both along the ramp: ∫ σs density p E e^(-2 σ depth) dz."""
    sigma_s, sigma = np.array([0.5, 1.0, 0.2]), np.array([0.9, 1.0, 1.4])
    values = np.array([0.0, 1.0, 3.0, 2.0], np.float32).reshape(4, 1, 1)
    sun = {"type": "directional", "direction": [0.0, 0.0, -1.0], "irradiance": [4.0 * np.pi] * 3}
    what = filled({"absorption": (sigma - sigma_s).tolist(), "scattering": sigma_s.tolist()}, values, STRAIGHT, [sun])
    z = np.linspace(-1.0, 1.0, 200001)
    density = ramp(z, "keep")
    before = integrate.cumulative_trapezoid(density[::-1], dx=z[1] - z[0], initial=0.0)[::-1]
    wanted = [
        integrate.trapezoid(s * density * np.exp(-2.0 * t * before), z) for s, t in zip(sigma_s, sigma, strict=True)
    ]
    made = [studio.pixels(what, 32, spp=64, max_depth=1, seed=seed).mean() for seed in range(8)]
    evidence.mean_is("once", made, float(np.array(wanted) @ WEIGHTS))


def cloud() -> Any:
    random = np.random.RandomState(5)
    return random.uniform(-0.6, 2.0, (11, 9, 13)).clip(0.0).astype(np.float32)


def test_a_cloud_in_a_white_furnace(evidence: Evidence, studio: Studio) -> None:
    what = filled({"scattering": [4.0, 1.0, 2.0], "g": 0.5}, cloud(), BESIDE, [SKY])
    tiles = studio.tiles(what, range(12), size=24, spp=16)
    evidence.mean_is("furnace", tiles, 1.0)


@pytest.mark.thorough
@pytest.mark.parametrize(("integrator", "bias"), [("bdpt", 0.0), pytest.param("photon", 0.02, marks=_long)])
def test_integrators_agree_about_a_cloud(evidence: Evidence, studio: Studio, integrator: str, bias: float) -> None:
    """With a ball inside of it; photons are gathered in balls, over whose size the light of a cloud varies."""
    lamp = {"type": "point", "position": [1.5, 2.0, 2.0], "intensity": [20.0, 20.0, 20.0]}
    scene = filled(COLORED, cloud(), BESIDE, [lamp, {**SKY, "radiance": [0.3, 0.3, 0.3]}], transform={"scale": 0.9})
    what = scene.changed(
        shapes=[*scene.shapes, sphere([0.1, -0.2, 0.0], 0.3, material="g")], materials={"g": lambert(0.6)}
    )
    first = studio.tiles(what, range(12), size=24, spp=48)
    second = studio.tiles(what, range(50, 62), size=24, spp=24, integrator=integrator)
    evidence.equal("radiance", first, second, rounding=bias or 1e-6)


GLOWING: dict[str, Any] = {"absorption": [0.5, 1.0, 2.0], "scattering": [1.0, 4.0, 0.0], "emission": [0.5, 1.0, 2.0]}
"""Its emission over its absorption is 1: among light of radiance 1 it cannot be seen."""


@pytest.mark.thorough
@pytest.mark.parametrize("even", [False, pytest.param(True, marks=_long)], ids=["cloud", "even"])
@pytest.mark.parametrize("integrator", ["path", pytest.param("bdpt", marks=_long)])
def test_what_shines_as_much_as_it_absorbs(evidence: Evidence, studio: Studio, integrator: str, even: bool) -> None:
    what = filled({**GLOWING, "g": 0.4}, None if even else cloud(), BESIDE, [SKY])
    tiles = studio.tiles(what, range(12), size=24, spp=16, integrator=integrator)
    evidence.mean_is("equilibrium", tiles, 1.0)


@pytest.mark.parametrize("scatters", [False, True], ids=["absorbs", "scatters"])
def test_light_of_a_ramp(evidence: Evidence, studio: Studio, scatters: bool) -> None:
    """What comes straight: ε / σ (1 - e^(-σ ∫ density))."""
    sigma, emission = np.array([0.2, 0.5, 1.1]), np.array([1.0, 0.0, 3.0])
    medium: dict[str, Any] = {"scattering" if scatters else "absorption": sigma.tolist(), "emission": emission.tolist()}
    values = np.tile(np.array([0.0, 1.0, 3.0, 2.0], np.float32)[:, None, None], (1, 3, 2))
    depth, _ = integrate.quad(ramp, -1.0, 1.0, args=("keep",), points=[-0.75, -0.25, 0.25, 0.75])
    what = filled(medium, values, STRAIGHT, [])
    made = [studio.pixels(what, 32, spp=64, max_depth=0, seed=seed).mean() for seed in range(8)]
    evidence.mean_is("glow", made, float(emission / sigma * -np.expm1(-sigma * depth) @ WEIGHTS))


def test_glowing_fog(evidence: Evidence, studio: Studio) -> None:
    """Without end it has the radiance emission / absorption."""
    fog = {"absorption": [0.5, 1.0, 2.0], "scattering": [1.0, 0.5, 0.0], "emission": [0.5, 0.5, 0.5]}
    what = clrender.Scene(camera=BESIDE, shapes=(sphere([0.0, 0.0, -50.0], 0.1),), media={"fog": fog}, fog="fog")
    made = studio.tiles(what, range(8), size=16, spp=16)
    evidence.mean_is("fog", made, float(np.array([1.0, 0.5, 0.25]) @ WEIGHTS))


def test_a_fire_lights_a_floor_and_is_a_light_without_a_group(studio: Studio) -> None:
    fire = filled({"absorption": 0.5, "emission": [3.0, 1.0, 0.1]}, cloud(), BESIDE, [{**SKY, "light_group": "sky"}])
    floor = quad([-9.0, -1.2, 9.0], [18.0, 0.0, 0.0], [0.0, 0.0, -18.0], material="floor")
    what = fire.changed(shapes=[*fire.shapes, floor], materials={"floor": lambert(0.5)})
    image = clrender.render(what, size=(24, 24), spp=16, light_groups=True)
    assert set(image.light_groups) == {"sky", "others"}
    total = np.add(image.light_groups["sky"], image.light_groups["others"], dtype=np.float32)
    assert np.array_equal(total, image.linear)
    assert image.light_groups["others"][-3:].mean(axis=(0, 1)).min() > 0.01


def test_photons_are_not_sent_by_media() -> None:
    what = filled(GLOWING, None, BESIDE, [SKY])
    with pytest.raises(clrender.SceneError, match=r"media\.smoke\.emission: media that shine .* integrator photon"):
        clrender.render(what, size=(8, 8), spp=1, integrator="photon")


def test_a_grid_goes_with_its_group(evidence: Evidence, studio: Studio) -> None:
    """Instances of a cloud are clouds in other places."""
    box = {"type": "box", "size": [2.0, 2.0, 2.0], "interior": "smoke"}
    density = {"file": "grid", "box": [[-1.0] * 3, [1.0] * 3]}
    turned = {"translate": [0.6, 0.2, 0.0], "rotate_degrees": [0.0, 40.0, 0.0], "scale": 0.5}
    small = {"translate": [-0.7, 0.0, 0.3], "scale": 0.4}
    common: dict[str, Any] = {"camera": BESIDE, "lights": (SKY,)}
    placed = clrender.Scene(
        **common,
        shapes=tuple({"type": "instance", "group": "cloud", "transform": each} for each in (turned, small)),
        groups={"cloud": {"shapes": [box]}},
        media={"smoke": {**COLORED, "density": density}},
    )
    names = {"first": turned, "second": small}
    written = clrender.Scene(
        **common,
        shapes=tuple({**box, "interior": name, "transform": each} for name, each in names.items()),
        media={name: {**COLORED, "density": {**density, "transform": each}} for name, each in names.items()},
    )
    first, second = (
        studio.tiles(each.with_arrays(grids={"grid": cloud()}), range(n, n + 10), size=24, spp=32)
        for each, n in ((placed, 0), (written, 50))
    )
    evidence.equal("radiance", first, second)


@pytest.mark.parametrize("medium", [pytest.param(COLORED, marks=_long), GLOWING], ids=["dark", "glows"])
def test_a_grid_has_the_same_bits_however_it_is_traced(device: Device, medium: dict[str, Any]) -> None:
    what = filled(
        medium, cloud(), BESIDE, [SKY, {"type": "point", "position": [2.0, 3.0, 2.0], "intensity": [9.0] * 3}]
    )
    lanes = (1, 4, 8, 16) if device.is_cpu else (1,)
    assert len(hashes_by_lanes_and_cuts(device, what, lanes)) == 1
