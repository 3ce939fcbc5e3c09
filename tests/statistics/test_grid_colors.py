"""Media whose albedo, emission or temperature is a grid, against homogeneous ones, integrals, and each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from render_support import Studio, hashes_by_lanes_and_cuts
from scipy import integrate
from stats_support import Evidence

import clrender
from clrender.flatten.grids import black_body_hue
from clrender.spectra.colors import light_color

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
LAMP = {"type": "point", "position": [2.0, 3.0, 2.0], "intensity": [30.0, 28.0, 25.0]}
WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in what a `Studio` measures."""
STRAIGHT = {"type": "orthographic", "position": [0.0, 0.0, 5.0], "target": [0.0, 0.0, 0.0], "height": 0.5}
BESIDE = {"position": [0.3, 0.8, 4.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 40.0}
COLORED: dict[str, Any] = {"absorption": [0.2, 0.6, 1.0], "scattering": [3.0, 1.0, 0.3], "g": -0.3}
BOX: dict[str, Any] = {"box": [[-1.0] * 3, [1.0] * 3]}
_long = pytest.mark.long


def filled(
    medium: dict[str, Any], grids: dict[str, Any], camera: dict[str, Any], lights: list[Any], **keys: dict[str, Any]
) -> Scene:
    """A box of 2 m about the origin, full of a medium with these grids, by key; `keys`: of some of them, more."""
    given = {key: {"file": key, **BOX, **keys.get(key, {})} for key in grids}
    scene = clrender.Scene(
        camera=camera,
        shapes=({"type": "box", "size": [2.0, 2.0, 2.0], "interior": "smoke"},),
        lights=tuple(lights),
        media={"smoke": {**medium, **given}},
    )
    return scene.with_arrays(grids=grids) if grids else scene


def ones(*more: int) -> Any:
    return np.ones((3, 4, 5, *more), np.float32)


def cloud(*more: int) -> Any:
    return np.random.RandomState(5).uniform(-0.6, 2.0, (11, 9, 13, *more)).clip(0.0).astype(np.float32)


def shares(*more: int) -> Any:
    """Shares that vary a lot, of which some are 0 and others 1."""
    return np.random.RandomState(6).uniform(-0.3, 1.3, (4, 5, 3, *more)).clip(0.0, 1.0).astype(np.float32)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("settings", "colored"),
    [
        ({}, True),
        pytest.param({}, False, marks=_long),
        *(
            pytest.param(each, True, marks=_long)
            for each in ({"integrator": "bdpt"}, {"integrator": "photon"}, {"guiding": "on"}, {"kernels": "staged"})
        ),
    ],
    ids=str,
)
def test_a_constant_albedo_is_that_of_a_homogeneous_medium(
    evidence: Evidence, studio: Studio, settings: dict[str, Any], colored: bool
) -> None:
    albedo = np.array([0.9, 0.5, 0.1]) if colored else np.full(3, 0.6)
    values = ones(3) * albedo.astype(np.float32) if colored else ones() * np.float32(0.6)
    scattering, absorption = np.array(COLORED["scattering"]), np.array(COLORED["absorption"])
    plain = {
        "scattering": (scattering * albedo).tolist(),
        "absorption": (absorption + scattering * (1.0 - albedo)).tolist(),
        "g": COLORED["g"],
    }
    made = (
        filled(COLORED, {"density": ones(), "albedo": values}, BESIDE, [SKY, LAMP]),
        filled(plain, {}, BESIDE, [SKY, LAMP]),
    )
    first, second = (
        studio.tiles(each, range(n, n + 12), size=24, spp=32, **settings) for each, n in zip(made, (0, 60), strict=True)
    )
    evidence.equal("radiance", first, second, rounding=2e-2 if settings.get("integrator") == "photon" else 1e-6)


@pytest.mark.long
@pytest.mark.parametrize(
    ("settings", "bias"),
    [
        ({"integrator": "bdpt"}, 0.0),
        ({"integrator": "photon"}, 0.03),
        ({"guiding": "on"}, 0.0),
        ({"sampling": "bsdf"}, 0.0),
    ],
    ids=["bdpt", "photon", "guided", "bsdf"],
)
def test_integrators_agree_about_a_cloud_of_many_colours(
    evidence: Evidence, studio: Studio, settings: dict[str, Any], bias: float
) -> None:
    lights = [SKY] if "sampling" in settings else [{**SKY, "radiance": [0.3, 0.3, 0.3]}, LAMP]
    grids = {"density": cloud(), "albedo": shares(3)}
    what = filled(COLORED, grids, BESIDE, lights, albedo={"transform": {"scale": 0.8}})
    first = studio.tiles(what, range(12), size=24, spp=48)
    second = studio.tiles(what, range(50, 62), size=24, spp=32, **settings)
    evidence.equal("radiance", first, second, rounding=bias or 1e-6)


def ramp(z: Any) -> Any:
    """A grid of 0, 1, 3, 2 along z in the box from -1 to 1, which goes on beyond the middles of its cells."""
    return np.interp(z, [-0.75, -0.25, 0.25, 0.75], [0.0, 1.0, 3.0, 2.0])


RAMP = np.tile(np.array([0.0, 1.0, 3.0, 2.0], np.float32)[:, None, None], (1, 3, 2))
FINE = np.linspace(-1.0, 1.0, 200001)


@pytest.mark.parametrize("colored", [False, True], ids=["numbers", "colours"])
def test_light_of_a_ramp_of_emission(evidence: Evidence, studio: Studio, colored: bool) -> None:
    """What comes straight: ∫ ε E(z) e^(-σ d(z)) dz, where d is the way from z to where the camera looks in."""
    sigma, emission = np.array([0.2, 0.5, 1.1]), np.array([1.0, 0.5, 3.0])
    hue = np.array([1.0, 0.2, 0.7]) if colored else np.ones(3)
    values = RAMP[..., None] * hue.astype(np.float32) if colored else RAMP
    medium = {"absorption": sigma.tolist(), "emission": emission.tolist()}
    what = filled(medium, {"density": ones(), "emission_grid": values}, STRAIGHT, [])
    wanted = [
        integrate.trapezoid(e * h * ramp(FINE) * np.exp(-s * (1.0 - FINE)), FINE)
        for e, h, s in zip(emission, hue, sigma, strict=True)
    ]
    made = [studio.pixels(what, 32, spp=64, max_depth=0, seed=seed).mean() for seed in range(8)]
    evidence.mean_is("glow", made, float(np.array(wanted) @ WEIGHTS))


def test_light_of_a_ramp_of_temperature(evidence: Evidence, studio: Studio) -> None:
    """The same, where the numbers are temperatures: 700 to 2200 K, but colder than 100 K on one side."""
    sigma, emission = np.array([0.2, 0.5, 1.1]), np.array([4.0, 5.0, 30.0])
    medium = {"absorption": sigma.tolist(), "emission": emission.tolist()}
    keys = {"scale": 1000.0, "offset": 0.8}
    what = filled(medium, {"density": ones(), "temperature": RAMP}, STRAIGHT, [], temperature=keys)
    z = np.linspace(-1.0, 1.0, 2001)
    hues = np.array([black_body_hue(max((each - 0.8) * 1000.0, 0.0)) for each in ramp(z).tolist()])
    wanted = [
        integrate.trapezoid(e * hues[:, k] * np.exp(-s * (1.0 - z)), z)
        for k, (e, s) in enumerate(zip(emission, sigma, strict=True))
    ]
    made = [studio.pixels(what, 32, spp=64, max_depth=0, seed=seed).mean() for seed in range(8)]
    evidence.mean_is("glow", made, float(np.array(wanted) @ WEIGHTS), rounding=1e-3)


def test_black_bodies_have_the_hue_of_pbrt() -> None:
    """Planck's law over its peak, integrated with the observer: by itself, with the constants of CODATA."""
    h, c, k = 6.62607015e-34, 299792458.0, 1.380649e-23
    nm = np.arange(360.0, 831.0)
    for kelvin in (1500.0, 3000.0, 6500.0):
        metres = nm * 1e-9
        planck = 2.0 * h * c * c / metres**5 / np.expm1(h * c / (metres * k * kelvin))
        peak_at = 2.897771955e-3 / kelvin
        peak = 2.0 * h * c * c / peak_at**5 / np.expm1(h * c / (peak_at * k * kelvin))
        wanted = light_color(nm.tolist(), (planck / peak).tolist())
        np.testing.assert_allclose(black_body_hue(kelvin), wanted, rtol=2e-3, atol=1e-5)
    assert black_body_hue(100.0) == (0.0, 0.0, 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize("integrator", ["path", pytest.param("bdpt", marks=_long)])
def test_what_shines_as_much_as_it_absorbs(evidence: Evidence, studio: Studio, integrator: str) -> None:
    """An albedo and an emission that go together: in light of radiance 1 the medium cannot be seen."""
    extinction, albedo = np.array([1.0, 2.0, 4.0]), shares(3)
    medium = {"scattering": extinction.tolist(), "emission": extinction.tolist(), "g": 0.4}
    grids = {"density": cloud(), "albedo": albedo, "emission_grid": 1.0 - albedo}
    tiles = studio.tiles(filled(medium, grids, BESIDE, [SKY]), range(12), size=24, spp=16, integrator=integrator)
    evidence.mean_is("equilibrium", tiles, 1.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_albedos_lie_where_their_box_is(studio: Studio, axis: int) -> None:
    """Black on one half of an axis, white on the other: in white light only one of them is dark."""
    shape = [1, 1, 1]
    shape[2 - axis] = 2
    albedo = np.array([0.0, 1.0], np.float32).reshape(shape)
    views = {0: [0.0, 0.0, 5.0], 1: [0.0, 0.0, 5.0], 2: [5.0, 0.0, 0.0]}
    camera = {"type": "orthographic", "position": views[axis], "target": [0.0, 0.0, 0.0], "height": 2.0}
    what = filled({"scattering": 20.0}, {"density": ones(), "albedo": albedo}, camera, [SKY])
    image = studio.gray(what, 16, spp=32)
    low, high = {0: (image[:, :3], image[:, -3:]), 1: (image[-3:], image[:3]), 2: (image[:, -3:], image[:, :3])}[axis]
    assert low.mean() < 0.1 and high.mean() > 0.6


@pytest.mark.parametrize("what", ["albedo", pytest.param("temperature", marks=_long)])
def test_the_bits_are_the_same_however_it_is_traced(device: Device, what: str) -> None:
    medium = {**COLORED, "emission": [2.0, 1.0, 0.5]}
    grids = {"density": cloud(), "albedo": shares(3), "temperature": cloud()}
    if what == "albedo":
        del grids["temperature"]
        grids["emission_grid"] = shares()
    scene = filled(medium, grids, BESIDE, [SKY, LAMP], temperature={"scale": 1500.0})
    lanes = (1, 4, 8, 16) if device.is_cpu else (1,)
    assert len(hashes_by_lanes_and_cuts(device, scene, lanes)) == 1
