"""Sun and sky as light: irradiance, the disc as it is seen, its shadows, and that all ways to find it agree.

The sky is the picture that the host makes, which tests/host/test_sky.py compares with the model.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from environment_support import irradiance, radiance
from lamp_support import LAMPS
from render_support import Studio, lambert, quad, scene, sphere
from stats_support import Evidence

from clrender.flatten.sky import sky_picture
from clrender.flatten.sky_model import SUN_DEGREES, SunDisc, sun_disc
from clrender.scene import SunSkyLight

if TYPE_CHECKING:
    from clrender.scene import Scene

Floats = npt.NDArray[np.float64]

WEIGHTS = np.array([0.5, 0.3, 0.2])
"""Of the channels in `Studio.pixels`."""
SLOW_NORMALS = [pytest.param(normal, marks=pytest.mark.slow) for normal in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0))]
SINE = math.sin(math.radians(SUN_DEGREES))
SOLID_ANGLE = 2.0 * math.pi * (1.0 - math.cos(math.radians(SUN_DEGREES)))
SIDEWAYS = (0.6, 0.48, 0.64)
"""Where the sun stands in most tests, a unit vector."""


def sun_sky(direction: tuple[float, ...] = SIDEWAYS, **more: Any) -> dict[str, Any]:
    return {"type": "sun_sky", "sun_direction": list(direction), **more}


def sun_alone(direction: tuple[float, ...] = SIDEWAYS, **more: Any) -> dict[str, Any]:
    return sun_sky(direction, sky_scale=0.0, ground=False, **more)


def disc_of(light: dict[str, Any]) -> SunDisc:
    model = SunSkyLight.model_validate(light)
    return sun_disc(model.sun_elevation, model.turbidity)


def sky_irradiance(light: dict[str, Any], normal: tuple[float, ...]) -> Floats:
    model = SunSkyLight.model_validate(light)
    picture = sky_picture(model)
    assert picture is not None
    return irradiance(picture.pixels.astype(np.float64), normal, model.sun_turn, fine=1)


def plane(normal: tuple[float, ...], light: dict[str, Any], *more: dict[str, Any], **material: Any) -> Scene:
    """A plane with this normal, of which all pixels see the middle from straight above."""
    n = np.array(normal)
    a = np.cross(n, [0.36, -0.48, 0.8])
    a /= np.linalg.norm(a)
    b = np.cross(n, a)
    camera = {"position": (n * 0.5).tolist(), "target": [0, 0, 0], "up": a.tolist(), "vertical_fov": 0.01}
    floor = quad((-5.0 * (a + b)).tolist(), (10.0 * a).tolist(), (10.0 * b).tolist(), material="white")
    return scene([floor, *more], [light], camera, white=material or lambert(1.0))


@pytest.mark.parametrize("normal", [(0.8, 0.0, 0.6), *SLOW_NORMALS], ids=str)
def test_irradiance(evidence: Evidence, studio: Studio, normal: tuple[float, ...]) -> None:
    """Up, aside and down to the ground: each with the disc, if it is not behind."""
    light = sun_sky(turbidity=2.5, ground_albedo=[0.5, 0.3, 0.2])
    sky = sky_irradiance(light, normal)
    sun = np.array(disc_of(light).mean) * math.pi * SINE**2 * max(float(np.dot(normal, SIDEWAYS)), 0.0)
    for sampling in ("mis", "light"):
        seen = studio.pixels(plane(normal, light), spp=64, sampling=sampling)
        evidence.mean_is(sampling, seen, (sky + sun) @ WEIGHTS / math.pi, rounding=1e-4)
    seen = studio.pixels(plane(normal, {**light, "sky_scale": 0.5, "sun_scale": 0.0}), spp=64, sampling="bsdf")
    half = {**light, "sky_scale": 0.5, "sun_scale": 0.0}
    evidence.mean_is("bsdf", seen, sky_irradiance(half, normal) @ WEIGHTS / math.pi, rounding=1e-4)


def test_a_turned_sky_is_the_same(evidence: Evidence, studio: Studio) -> None:
    c, s = math.cos(math.radians(70.0)), math.sin(math.radians(70.0))
    x, y, z = SIDEWAYS
    light = sun_sky((x * c - z * s, y, z * c + x * s), rotate_degrees=70.0)
    normal = (0.8, 0.0, 0.6)
    sun = np.array(disc_of(light).mean) * math.pi * SINE**2 * float(np.dot(normal, SIDEWAYS))
    exact = sky_irradiance(sun_sky(), normal) + sun
    evidence.mean_is("turned", studio.pixels(plane(normal, light), spp=64), exact @ WEIGHTS / math.pi, rounding=1e-4)


LOOKS = {"middle": 0.0, "half way": 0.5, "near the limb": 0.9, "just outside": 1.02}
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("reuse", "photon")]


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", "direct", "whitted", *SLOW])
def test_the_disc_as_it_is_seen(studio: Studio, integrator: str) -> None:
    """By a camera, straight and in a mirror."""
    light = sun_sky(turbidity=3.0)
    picture, disc = sky_picture(SunSkyLight.model_validate(light)), disc_of(light)
    assert picture is not None
    axis = np.array(SIDEWAYS)
    aside = np.cross(axis, [0.0, 1.0, 0.0])
    aside /= np.linalg.norm(aside)
    for name, part in LOOKS.items():
        angle = math.radians(SUN_DEGREES * part)
        look = axis * math.cos(angle) + aside * math.sin(angle)
        sky = radiance(picture.pixels.astype(np.float64), look[None], math.degrees(math.atan2(0.6, 0.64)))[0]
        cosine = math.sqrt(max(1.0 - (math.sin(angle) / SINE) ** 2, 0.0))
        sun = np.polynomial.polynomial.polyval(cosine, disc.darkening.T) if part < 1.0 else 0.0
        wanted = float((sky + sun) @ WEIGHTS)
        camera = {"position": [0, 0, 0], "target": look.tolist(), "vertical_fov": 1e-4}
        # A direction is known to about 1e-7, of a radius of 5e-3; near the limb the radiance falls fast
        seen = studio.pixels(scene([], [light], camera), 4, spp=1, integrator=integrator)
        np.testing.assert_allclose(seen, wanted, rtol=5e-4, err_msg=name)
        below = {"position": [0, 0, 0], "target": (look * [1, -1, 1]).tolist(), "vertical_fov": 1e-4}
        mirror = quad([-50.0, -1.0, 50.0], [100.0, 0.0, 0.0], [0.0, 0.0, -100.0], material="shiny")
        what = scene([mirror], [light], below, shiny={"type": "mirror", "reflectance": [0.5, 0.5, 0.5]})
        seen = studio.pixels(what, 4, spp=1, integrator=integrator)
        np.testing.assert_allclose(seen, 0.5 * wanted, rtol=5e-4, err_msg=f"{name}, in a mirror")


@pytest.mark.long
def test_the_horizon_cuts_the_disc(evidence: Evidence, studio: Studio) -> None:
    elevation = 0.1
    e = math.radians(elevation)
    light = sun_alone((0.0, math.sin(e), math.cos(e)), turbidity=2.0)
    disc = disc_of(light)
    at = (np.arange(1000) + 0.5) / 500 - 1.0
    x, y = np.meshgrid(at, at)
    inside = x * x + y * y < 1.0
    cosine = np.sqrt(np.where(inside, 1.0 - x * x - y * y, 0.0))
    up = np.where(inside & (y > -elevation / SUN_DEGREES), 1.0, 0.0)[..., None]
    seen = np.polynomial.polynomial.polyval(cosine, disc.darkening.T).transpose(1, 2, 0)
    exact = (seen * up).sum(axis=(0, 1)) * 4e-6 * SINE**2
    # The sum over a grid is right to 1e-4
    found = studio.pixels(plane((0.0, 0.0, 1.0), light), spp=64, sampling="light")
    evidence.mean_is("light", found, exact @ WEIGHTS / math.pi, rounding=2e-4)


@pytest.mark.long
def test_half_a_sun(evidence: Evidence, studio: Studio) -> None:
    """In the middle of the penumbra of an edge."""
    light = sun_alone((0.0, 1.0, 0.0))
    cover = quad([0.0, 1.0, -20.0], [0.0, 0.0, 40.0], [20.0, 0.0, 0.0])
    exact = np.array(disc_of(light).mean) * SINE**2 * 0.5
    for sampling in ("mis", "light"):
        seen = studio.pixels(plane((0.0, 1.0, 0.0), light, cover), spp=64, sampling=sampling)
        evidence.mean_is(sampling, seen, exact @ WEIGHTS, rounding=1e-4)


def test_whitted_takes_the_sun_at_its_middle(studio: Studio) -> None:
    light = sun_sky()
    seen = studio.pixels(plane((0.0, 1.0, 0.0), light), 4, spp=1, integrator="whitted")
    exact = np.array(disc_of(light).mean) * SOLID_ANGLE * SIDEWAYS[1] / math.pi
    np.testing.assert_allclose(seen, exact @ WEIGHTS, rtol=1e-5)


@pytest.mark.parametrize(
    "light_sampler", ["power", *(pytest.param(name, marks=pytest.mark.slow) for name in ("uniform", "bvh"))]
)
def test_beside_another_light(evidence: Evidence, studio: Studio, light_sampler: str) -> None:
    light = sun_sky()
    lamp = {"type": "point", "position": [0.3, 0.4, 0.0], "intensity": [20.0, 20.0, 20.0]}
    ground = plane((0.0, 1.0, 0.0), light)
    both = ground.model_copy(update={"lights": (*ground.lights, *scene([], [lamp]).lights)})
    sun = np.array(disc_of(light).mean) * math.pi * SINE**2 * SIDEWAYS[1]
    exact = (sky_irradiance(light, (0.0, 1.0, 0.0)) + sun) @ WEIGHTS + 20.0 * 0.4 / 0.5**3
    for sampling in ("mis", "light"):
        seen = studio.pixels(both, spp=256, sampling=sampling, light_sampler=light_sampler)
        evidence.mean_is(sampling, seen, exact / math.pi, rounding=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["path", pytest.param("photon", marks=pytest.mark.slow)])
def test_beside_a_lamp_of_an_ies_file(evidence: Evidence, studio: Studio, tmp_path: Path, integrator: str) -> None:
    """Both keep tables in one array, and no lane reads a table that is not its light's."""
    file = str(tmp_path / LAMPS["halves"].write(tmp_path))
    ground = plane((0.0, 1.0, 0.0), sun_alone(scale=1e-3)).placed("here", Path("/"))
    lamp = scene([], [{"type": "ies", "position": [0.3, 0.4, 0.0], "file": file}]).lights
    given = {"spp": 64, "integrator": integrator, **({"photons": 4096} if integrator == "photon" else {})}
    sun, alone, both = (
        studio.pixels(ground.model_copy(update={"lights": lights}), 16, **given)
        for lights in (ground.lights, lamp, (*ground.lights, *lamp))
    )
    evidence.equal("sum", both, sun + alone, rounding=1e-5)


def glossy(light: dict[str, Any]) -> Scene:
    """A rough metal in which the sun is seen about its middle."""
    normal = np.array(SIDEWAYS) + np.array([0.0, 0.0, 1.0])
    normal /= np.linalg.norm(normal)
    a = np.cross(normal, [0.0, 1.0, 0.0])
    b = np.cross(normal, a)
    camera = {"position": [0.004, 0.0, 0.5], "target": [0, 0, 0], "vertical_fov": 0.01}
    metal = quad((-a - b).tolist(), (2.0 * a).tolist(), (2.0 * b).tolist(), material="metal")
    return scene([metal], [light], camera, metal={"type": "conductor", "metal": "Al", "roughness": 0.12})


@pytest.mark.long
def test_samples_of_light_and_bsdf_find_the_same_sun(evidence: Evidence, studio: Studio) -> None:
    what = glossy(sun_sky())
    seen = {name: studio.pixels(what, spp=64, sampling=name) for name in ("mis", "light", "bsdf")}
    evidence.equal("light", seen["mis"], seen["light"])
    evidence.equal("bsdf", seen["mis"], seen["bsdf"])


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["photon", "reuse"])
def test_integrators_agree(evidence: Evidence, studio: Studio, integrator: str) -> None:
    floor = quad([-3.0, 0.0, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], material="white")
    ball = sphere([0.0, 1.0, 0.0], 1.0, material="white")
    camera = {"position": [0.0, 2.5, 6.0], "target": [0, 0.6, 0], "vertical_fov": 30.0}
    what = scene([floor, ball], [sun_sky()], camera, white=lambert(0.6))
    more: dict[str, Any] = {"photons": 20000, "photon_radius": 0.03} if integrator == "photon" else {}
    paths = studio.tiles(what, size=32, tiles=2, spp=64)
    other = studio.tiles(what, range(100, 116), size=32, tiles=2, spp=32, integrator=integrator, **more)
    # A photon map is blurred by its radius
    evidence.equal("tiles", paths, other, rounding=5e-3 if integrator == "photon" else 1e-5)
