"""Spots and lamps of IES files: intensities, flux, photons, and the tree that picks them, against formulas."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from lamp_launches import Lamps, around, hammersley
from lamp_support import LAMPS, LampFile, Slide, spot_share
from render_support import Studio, lambert, quad, room, scene, sphere, triangle
from sampling_support import LightTable
from stats_support import Evidence

from clrender.flatten.lamps import POINT_KINDS
from clrender.scene import IesLight, PointLight, ProjectorLight, SpotLight

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

Floats = npt.NDArray[np.float64]

SHARE = 0.6
FLOOR = quad([-50.0, 0.0, 50.0], [100.0, 0.0, 0.0], [0.0, 0.0, -100.0], material="white")
SLIDE = Slide(np.random.default_rng(53).uniform(0.1, 2.0, (3, 4, 3)).astype(np.float32))
AXIS, ZERO = (0.3, -1.0, 0.5), (0.2, 0.1, 1.0)


def spot(cone_degrees: float, blend: float, **more: Any) -> dict[str, Any]:
    light = {"type": "spot", "position": [0.0, 2.0, 0.0], "direction": [0.0, -1.0, 0.0], "intensity": [10.0] * 3}
    return {**light, "cone_degrees": cone_degrees, "blend": blend, **more}


def ies(folder: Path, lamp: LampFile, **more: Any) -> dict[str, Any]:
    light = {"type": "ies", "position": [0.0, 0.0, 0.0], "direction": list(AXIS), "horizontal_zero": list(ZERO)}
    return {**light, "file": str(folder / lamp.write(folder)), **more}


def lit(*lights: dict[str, Any], shapes: tuple[dict[str, Any], ...] = (), **more: Any) -> Scene:
    """Lights and what they shine on, in a scene that may read files from anywhere."""
    return scene(shapes, lights, white=lambert(SHARE), **more).placed("here", Path("/"))


# --- intensity -------------------------------------------------------------------------------------------------------

# Cone, blend, direction of the spot; where the plane is looked at. Inside, on the slope and outside.
SPOTS: dict[str, tuple[float, float, tuple[float, float, float], tuple[float, float, float]]] = {
    "in the middle": (40.0, 0.5, (0.0, -1.0, 0.0), (0.0, 0.0, 0.0)),
    "on the slope": (40.0, 0.9, (0.0, -1.0, 0.0), (0.45, 0.0, 0.3)),
    "aslant": (30.0, 1.0, (1.0, -1.0, 0.4), (1.7, 0.0, 0.9)),
    "sharp, just inside": (60.0, 0.0, (0.0, -1.0, 0.0), (1.15, 0.0, 0.0)),
    "sharp, just outside": (60.0, 0.0, (0.0, -1.0, 0.0), (1.16, 0.0, 0.0)),
    "narrow": (0.2, 1.0, (0.0, -1.0, 0.0), (0.001, 0.0, 0.001)),
    "wider than half of all directions": (300.0, 0.7, (0.0, 1.0, 0.0), (2.0, 0.0, 1.0)),
    "everywhere": (360.0, 1.0, (0.2, 1.0, 0.0), (0.5, 0.0, 0.0)),
    "from behind": (170.0, 0.1, (0.0, 1.0, 0.0), (0.5, 0.0, 0.0)),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", SPOTS)
def test_spot_over_a_plane(evidence: Evidence, studio: Studio, name: str) -> None:
    """Nothing is left to chance: radiance is that of I cos / d² at the place that all pixels see."""
    cone, blend, direction, place = SPOTS[name]
    position = np.array([0.0, 2.0, 0.0])
    away = np.array(place) - position
    distance = float(np.linalg.norm(away))
    cosine = away @ np.array(direction) / distance / np.linalg.norm(direction)
    exact = 10.0 * float(spot_share(cosine, cone, blend)) * 2.0 / distance**3 * SHARE / math.pi
    # A place on a large floor is known less well
    half = 0.01 if name == "narrow" else 4.0
    floor = quad([-half, 0.0, half], [2.0 * half, 0.0, 0.0], [0.0, 0.0, -2.0 * half], material="white")
    camera = {
        "position": [place[0], 1e-3, place[2]],
        "target": list(place),
        "up": [0.0, 0.0, -1.0],
        "vertical_fov": 0.01,
    }
    seen = studio.pixels(lit(spot(cone, blend, direction=list(direction)), shapes=(floor,), camera=camera), spp=4)
    evidence.mean_is("radiance", seen, exact, rounding=1e-5)
    assert (exact > 0.0) == (name not in ("sharp, just outside", "from behind"))


def test_spot_all_over_a_plane(evidence: Evidence, studio: Studio) -> None:
    size, fine = 32, 16
    camera = {"position": [0.0, 1.0, 0.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 0.0, -1.0], "vertical_fov": 90.0}
    what = lit(spot(50.0, 0.6, direction=[0.2, -1.0, 0.1]), shapes=(FLOOR,), camera=camera)
    at = (np.arange(size * fine) + 0.5) / (size * fine) * 2.0 - 1.0
    away = np.stack(np.broadcast_arrays(at[None, :], -2.0, at[:, None]), axis=-1)
    distance = np.linalg.norm(away, axis=-1)
    cosine = away @ np.array([0.2, -1.0, 0.1]) / distance / math.sqrt(1.05)
    exact = 10.0 * spot_share(cosine, 50.0, 0.6) * 2.0 / distance**3 * SHARE / math.pi
    tiles = exact.reshape(4, size * fine // 4, 4, size * fine // 4).mean(axis=(1, 3)).ravel()
    # The formula's own grid is off by what it changes within a step of it
    evidence.mean_is("tiles", studio.tiles(what, range(12), spp=64), tiles, rounding=2e-5)


@pytest.mark.parametrize("name", LAMPS)
def test_intensity_of_an_ies_file(device: Device, tmp_path: Path, name: str) -> None:
    """Bilinear in the angles of the file, with every symmetry that a file may leave something out by."""
    lamp, directions = LAMPS[name], around()
    seen = Lamps(device, lit(ies(tmp_path, lamp, scale=2.0))).launch(
        "lamp_looks", directions.T.astype(np.float32), 0, 1
    )[0]
    exact = 2.0 * lamp.intensity(directions, AXIS, ZERO)
    # An angle is known to a few 1e-6 degrees, and the steepest slope of the files is 1000 in one degree
    peak = 2.0 * float(lamp.candela.max()) * lamp.multiplier / 683.0
    np.testing.assert_allclose(seen, exact, rtol=1e-5, atol=2e-5 * peak)
    assert (exact > 0.0).mean() > 0.3


@pytest.mark.long
@pytest.mark.parametrize("name", LAMPS)
def test_flux_of_an_ies_file(studio: Studio, tmp_path: Path, name: str) -> None:
    """What arrives on a sphere about the lamp, all of it seen from its middle, is what the file says: within 0.2 %."""
    radius = 2.0
    camera = {"type": "panoramic", "position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, 1.0]}
    ball = sphere([0.0, 0.0, 0.0], radius, material="white", flip_normals=True)
    what = lit(ies(tmp_path, LAMPS[name]), shapes=(ball,), camera=camera)
    seen = studio.gray(what, (128, 64), spp=64, max_depth=1).mean(axis=1)
    edges = np.sin(math.pi / 2 - np.arange(65) / 64 * math.pi)
    irradiance = float(seen @ (edges[:-1] - edges[1:])) / 2.0 * math.pi / SHARE
    assert irradiance * 4.0 * math.pi * radius**2 == pytest.approx(LAMPS[name].flux(), rel=0.002)


# --- photons ---------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("name", [*LAMPS, "spot", "sharp spot", "wide spot"])
def test_photons_start_where_the_lamp_shines(device: Device, tmp_path: Path, name: str) -> None:
    """Intensity over density has the flux for its mean, and that of a direction, the flux that goes there."""
    spots = {"spot": (40.0, 0.5), "sharp spot": (60.0, 0.0), "wide spot": (300.0, 1.0)}
    if name in spots:
        cone, blend = spots[name]
        light = spot(cone, blend, direction=list(AXIS))
        flux = 20.0 * math.pi * (1.0 - math.cos(math.radians(cone / 2.0))) * (1.0 - blend / 2.0)
    else:
        light, flux = ies(tmp_path, LAMPS[name]), LAMPS[name].flux()
    x, y, z, pdf, intensity = Lamps(device, lit(light)).launch("lamp_samples", hammersley(20), 0, 5)
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, rtol=1e-6)
    assert (pdf > 0.0).all()
    weights = intensity / pdf
    assert weights.mean() == pytest.approx(flux, rel=2e-4)
    # And where it goes
    directions = around(512)
    if name in spots:
        axis = np.array(AXIS) / np.linalg.norm(AXIS)
        there = 10.0 * spot_share(directions @ axis, *spots[name])
    else:
        there = LAMPS[name].intensity(directions, AXIS, ZERO)
    for seen, formula in ((x, directions[:, 0]), (z, directions[:, 2]), (y * y, directions[:, 1] ** 2)):
        # The formula's grid of 524,288 directions errs at sharp edges
        exact = float((there * formula).mean()) * 4.0 * math.pi
        assert (weights * seen).mean() == pytest.approx(exact, abs=1e-3 * flux)


def lamps_in_a_room(folder: Path) -> Scene:
    """Some of all, before diffuse walls."""
    lights = [
        spot(70.0, 0.5, position=[-0.8, 0.9, -0.5], direction=[0.5, -1.0, 0.2], intensity=[3.0, 2.0, 1.0]),
        ies(folder, LAMPS["quadrants"], position=[0.6, 0.5, 0.4], scale=[4.0, 3.0, 5.0]),
        {"type": "point", "position": [0.0, -0.5, 0.3], "intensity": [0.2, 0.2, 0.3]},
        SLIDE.light(folder, position=[0.3, 0.8, 0.8], direction=[-0.4, -0.5, -1.0], scale=2.0),
    ]
    camera = {"position": [0.0, 0.0, 0.9], "target": [0.0, -0.2, -1.0], "vertical_fov": 80.0}
    return lit(*lights, shapes=(room([2.0, 2.0, 2.0], material="white"),), camera=camera)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["photon", "reuse"])
def test_integrators_agree_on_lamps(evidence: Evidence, studio: Studio, tmp_path: Path, integrator: str) -> None:
    what = lamps_in_a_room(tmp_path)
    plain = studio.tiles(what, range(12), spp=32, max_depth=3)
    more: dict[str, Any] = {"photons": 4000, "photon_radius": 0.05} if integrator == "photon" else {}
    other = studio.tiles(what, range(100, 112), spp=32, max_depth=3, integrator=integrator, **more)
    # A photon map is blurred by its radius
    evidence.equal("tiles", plain, other, rounding=0.003 if integrator == "photon" else 1e-5)


@pytest.mark.long
def test_whitted_is_direct_where_lights_are_lamps(studio: Studio, tmp_path: Path) -> None:
    # Light samples choose one of four lights, so that direct light has noise
    what = lamps_in_a_room(tmp_path)
    whitted = studio.tiles(what, range(1), spp=64, integrator="whitted")
    direct = studio.tiles(what, range(8), spp=64, integrator="direct", shadow_rays=16)
    assert direct.mean() == pytest.approx(whitted.mean(), rel=2e-3)


@pytest.mark.slow
def test_radiosity_takes_lamps(studio: Studio, tmp_path: Path) -> None:
    what = lamps_in_a_room(tmp_path)
    path = studio.image(what, 32, spp=64)
    solved = studio.image(what, 32, spp=16, integrator="radiosity", patches=3000)
    assert solved.mean() == pytest.approx(path.mean(), rel=0.02)


# --- the tree of lights ----------------------------------------------------------------------------------------------


def many_lamps(folder: Path, count: int = 60, floor: bool = False, alike: bool = False) -> Scene:
    """Narrow and wide spots, IES files that shine up or down only, projectors, triangles, points, and what is far.

    With `alike` only narrow spots, all of which shine about downwards, so that groups have a direction, and triangles.
    """
    rng = np.random.default_rng(51)
    names = [LAMPS[name].write(folder, f"{number}.ies") for number, name in enumerate(LAMPS)]
    lights: list[dict[str, Any]] = []
    for number in range(count):
        place, bright = rng.uniform(-2.0, 2.0, 3), float(10.0 ** rng.uniform(-1.0, 1.0))
        place[1] = rng.uniform(0.5, 3.0)
        aimed = rng.normal(size=3)
        aimed = np.array([0.0, -1.0, 0.0]) + 0.1 * aimed if alike else aimed
        at: dict[str, Any] = {"position": place.tolist(), "direction": aimed.tolist()}
        if alike:
            lights.append({**at, "type": "spot", "intensity": [bright] * 3, "cone_degrees": 25.0, "blend": 0.5})
        elif number % 4 == 0:
            lights.append({**at, "type": "ies", "file": str(folder / names[number // 4 % len(names)]), "scale": bright})
        elif number % 8 == 5:
            lights.append({**SLIDE.light(folder, f"{number}.exr"), **at, "scale": bright})
        elif number % 4 == 1:
            lights.append({"type": "point", "position": at["position"], "intensity": [bright] * 3})
        else:
            cone = float(rng.choice([1.0, 10.0, 40.0, 120.0, 250.0]))
            lights.append({**at, "type": "spot", "intensity": [10.0 * bright] * 3, "cone_degrees": cone, "blend": 0.5})
    lights.append({"type": "directional", "direction": [0.3, -1.0, 0.2], "irradiance": [0.1] * 3})
    centers = rng.uniform((-2.0, 0.0, -2.0), (2.0, 4.0, 2.0), (9, 1, 3))
    shapes = [triangle(corners, emission=1.0) for corners in (centers + rng.normal(0.0, 0.2, (9, 3, 3))).tolist()]
    ground = (quad((-3.0, 0.0, 3.0), (6.0, 0.0, 0.0), (0.0, 0.0, -6.0), material="white"),) if floor else ()
    camera = {"position": [0.0, 9.0, 0.01], "target": [0.0, 0.0, 0.0], "vertical_fov": 25.0}
    return lit(*lights, shapes=(*ground, *shapes), camera=camera)


def arriving(flat: Any, what: Scene, point: Floats, normal: Floats) -> Floats:
    """Irradiance from each of the spots and IES files; NaN of other lights."""
    lights = flat.arrays["lights"]
    found = np.full(flat.light_count, np.nan)
    lamps = [light for light in what.lights if isinstance(light, PointLight | SpotLight | IesLight | ProjectorLight)]
    rows = np.flatnonzero(np.isin(lights["kind"], POINT_KINDS))
    for row, light in zip(rows.tolist(), lamps, strict=True):
        if isinstance(light, PointLight):
            continue
        away = point - np.array(light.position)
        cosine = max(float(-away @ normal), 0.0) / np.linalg.norm(away) ** 3
        if isinstance(light, SpotLight):
            axis = np.array(light.direction) / np.linalg.norm(light.direction)
            share = float(spot_share(away @ axis / np.linalg.norm(away), light.cone_degrees, light.blend))
            found[row] = light.intensity[0] * share * cosine
        elif isinstance(light, ProjectorLight):
            found[row] = SLIDE.intensity(away, light.direction, light.up)[0] * light.scale[0] * cosine
        else:
            lamp = list(LAMPS.values())[int(Path(light.file).stem)]
            found[row] = float(lamp.intensity(away, light.direction, light.zero)) * light.scale[0] * cosine
    return found


@pytest.mark.long
@pytest.mark.parametrize("alike", [False, True], ids=["all ways", "downwards"])
def test_the_tree_leaves_out_no_lamp_that_shines(
    evidence: Evidence, device: Device, tmp_path: Path, alike: bool
) -> None:
    """At many points: it is chosen as often as it is said to be, and each lamp of which light arrives has a chance.

    With what is left to 1 the walk ends at a group of lamps of which none shines there.
    """
    what = many_lamps(tmp_path, alike=alike)
    table = LightTable(device, what)
    assert table.flat.light_levels > 0
    rng = np.random.default_rng(52)
    dark, lamps = 0, 0
    for number in range(12):
        point, normal = rng.uniform(-3.0, 3.0, 3), rng.normal(size=3)
        if alike:
            point, normal = rng.uniform(-1.5, 0.5, 3), np.array([0.0, 1.0, 0.0])
        normal /= np.linalg.norm(normal)
        chosen, likely, asked, shares = table.choose(tuple(point), tuple(normal))
        assert np.array_equal(likely, asked)
        found = float(shares.astype(np.float64).sum())
        assert 0.0 < found < 1.0 + 1e-5
        evidence.share(f"point {number}: some light", int((likely > 0.0).sum()), len(likely), min(found, 1.0))
        light = arriving(table.flat, what, point, normal)
        lit_by = light > 0.0
        evidence.holds(f"point {number}", lit_by & (shares == 0.0), "have light, but are never chosen")
        dark, lamps = dark + int((shares[~lit_by & ~np.isnan(light)] == 0.0).sum()), lamps + int((light == 0.0).sum())
        if number == 0:
            order = np.argsort(-shares)
            seen = np.bincount(chosen[likely > 0.0], minlength=len(shares))[order]
            evidence.histogram("lights", seen, shares[order] / found)
    assert dark > 0.7 * lamps, "most lamps of which no light arrives are not chosen"


@pytest.mark.long
@pytest.mark.parametrize("sampling", ["mis", "light"])
def test_the_tree_and_an_even_choice_agree(evidence: Evidence, studio: Studio, tmp_path: Path, sampling: str) -> None:
    """And the tree has far less noise."""
    what = many_lamps(tmp_path, floor=True)
    even = studio.tiles(what, range(16), spp=64, max_depth=2, light_sampler="uniform", sampling=sampling)
    tree = studio.tiles(what, range(100, 116), spp=64, max_depth=2, light_sampler="bvh", sampling=sampling)
    evidence.equal("tiles", even, tree)
    assert np.median(tree.var(axis=0) / even.var(axis=0)) < 0.25
