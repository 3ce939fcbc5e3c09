"""Thin films: what they reflect against Airy's formula, the energy of what lies below, textures, and all strategies."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from render_support import Studio, hashes_by_lanes_and_cuts
from stats_support import Evidence

import clrender
from clrender.furnace import findings, measure, subjects_of
from clrender.scene import Scene
from clrender.spectra.colors import table_wavelengths
from clrender.spectra.film import film_table

if TYPE_CHECKING:
    from clrender.device import Device

Floats = npt.NDArray[np.float64]
SKY = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
GOLD = {"type": "conductor", "eta": [0.2, 0.4, 1.4], "k": [3.9, 2.4, 1.8], "roughness": 0.0}
COPPER = {"type": "conductor", "f0": [0.95, 0.6, 0.5], "roughness": 0.0}
GLASS = {"type": "dielectric", "ior": 1.5}


def film(ior: float, thickness: Any) -> dict[str, Any]:
    return {"iridescence": 1.0, "iridescence_ior": ior, "iridescence_thickness": thickness}


def airy(cosine: float, ior: float, thickness: float, below: complex, wavelengths: Floats) -> Floats:
    """Share of unpolarised light that a film reflects, by complex amplitudes; ways to and fro are summed up."""
    sine2 = 1.0 - cosine * cosine
    here, within, beyond = cosine + 0j, np.sqrt(ior * ior - sine2 + 0j), np.sqrt(below * below - sine2)
    phase = np.exp(4j * math.pi * thickness * within / wavelengths)
    shares = []
    for n, m, k in ((1.0, 1.0, 1.0), (1.0, ior * ior, below * below)):
        outer = (m * here - n * within) / (m * here + n * within)
        inner = (k * within - m * beyond) / (k * within + m * beyond)
        shares.append(np.abs((outer + inner * phase) / (1.0 + outer * inner * phase)) ** 2)
    return np.asarray(0.5 * (shares[0] + shares[1]), np.float64)


def colors(cosine: float, ior: float, thickness: float, below: list[complex]) -> Floats:
    """The same as a colour in daylight; of what lies below, the index of each of red, green and blue."""
    lines = table_wavelengths()
    fine = np.linspace(lines[0], lines[-1], 4701)
    table, light = film_table(), np.interp(fine, lines, film_table()[:, 3])
    weights = [np.interp(fine, lines, table[:, channel]) * light for channel in range(3)]
    seen = [airy(cosine, ior, thickness, index, fine) @ w / w.sum() for index, w in zip(below, weights, strict=True)]
    return np.asarray(np.clip(np.array(seen), 0.0, 1.0), np.float64)


def index_of(f0: float) -> complex:
    return complex((1.0 + math.sqrt(f0)) / (1.0 - math.sqrt(f0)))


def tilted(material: dict[str, Any], degrees: float, **more: Any) -> Scene:
    """A quad that is seen at this angle from its normal, and fills the image."""
    angle = math.radians(degrees)
    across = [9.0, 0.0, 0.0]
    up = [0.0, 40.0 * math.cos(angle), 40.0 * math.sin(angle)]
    quad = {"type": "quad", "origin": [-4.5, -0.5 * up[1], -0.5 * up[2]], "edge_u": up, "edge_v": across}
    camera = {"type": "orthographic", "position": [0.0, 0.0, -60.0], "target": [0.0, 0.0, 0.0], "height": 0.5}
    return Scene(camera=camera, materials={"m": material}, shapes=[{**quad, "material": "m"}], lights=[SKY], **more)


@pytest.mark.parametrize(
    ("base", "below"),
    [
        pytest.param(GOLD, [0.2 + 3.9j, 0.4 + 2.4j, 1.4 + 1.8j], id="index"),
        pytest.param(COPPER, [index_of(0.95), index_of(0.6), index_of(0.5)], id="color"),
    ],
)
def test_metals_reflect_what_airy_says(studio: Studio, base: dict[str, Any], below: list[complex]) -> None:
    for ior, thickness in ((1.3, 150.0), (1.5, 420.0), (2.2, 900.0)):
        for degrees in (0.0, 35.0, 60.0, 78.0):
            scene = tilted(base | film(ior, thickness), degrees)
            seen = studio.image(scene, 4, spp=1).mean(axis=(0, 1))
            wanted = colors(math.cos(math.radians(degrees)), ior, thickness, below)
            # Means over wavelengths are summed up to the eighth order, and red, green and blue are cut off at 0 and 1
            assert seen == pytest.approx(wanted, abs=0.003 + 0.01 * (ior > 2.0)), (ior, thickness, degrees)


@pytest.mark.long
def test_wavelengths_reflect_what_airy_says(studio: Studio) -> None:
    for degrees in (0.0, 60.0):
        scene = tilted({"type": "conductor", "f0": [0.5] * 3, "roughness": 0.0} | film(1.8, 500.0), degrees)
        seen = studio.image(scene, 8, spp=256, spectral=True).mean(axis=(0, 1))
        wanted = colors(math.cos(math.radians(degrees)), 1.8, 500.0, [index_of(0.5)] * 3)
        assert seen == pytest.approx(wanted, abs=2e-3)


def test_glass_reflects_what_airy_says(studio: Studio) -> None:
    """What passes a ball's surface is absorbed by another one below it."""
    black = {"type": "lambert", "reflectance": [0.0, 0.0, 0.0]}
    balls = [{"type": "sphere", "radius": radius, "material": name} for radius, name in ((1.0, "m"), (0.9999, "black"))]
    camera = {"type": "orthographic", "position": [0.0, 0.0, -5.0], "target": [0.0, 0.0, 0.0], "height": 0.02}
    for thickness in (90.0, 250.0, 600.0):
        materials = {"m": GLASS | film(1.38, thickness), "black": black}
        scene = Scene(camera=camera, materials=materials, shapes=balls, lights=[SKY])
        seen = studio.image(scene, 16, spp=1024).mean(axis=(0, 1))
        assert seen == pytest.approx(colors(1.0, 1.38, thickness, [1.5 + 0j] * 3), abs=1.5e-3)


def test_a_film_without_thickness_is_none(studio: Studio) -> None:
    for base in (GOLD, GLASS):
        plain, filmed = (studio.image(tilted(material, 30.0), 8, spp=16) for material in (base, base | film(1.4, 0.0)))
        assert np.array_equal(plain, filmed)


def test_an_image_says_how_thick_the_film_is(studio: Studio) -> None:
    """Half of a checker's share, and of a picture of 0 and 1 each end of the range."""
    quads = [
        {"type": "quad", "origin": [-1.0, -1.0, 0.0], "edge_u": [2.0, 0.0, 0.0], "edge_v": [0.0, 2.0, 0.0]},
    ]
    camera = {"type": "orthographic", "position": [0.0, 0.0, -5.0], "target": [0.0, 0.0, 0.0], "height": 2.0}

    def image(**more: Any) -> Floats:
        shapes = [{**quad, "material": "m"} for quad in quads]
        return studio.image(Scene(camera=camera, materials={"m": COPPER | more}, shapes=shapes, lights=[SKY]), 8, spp=1)

    share = {"checker": [0.0, 1.0], "size": 0.5}
    mixed = image(**(film(1.6, 300.0) | {"iridescence": share}))
    both = [tuple(image(**more).mean(axis=(0, 1))) for more in ({}, film(1.6, 300.0))]
    for pixel in mixed.reshape(-1, 3):
        assert min(np.abs(pixel - known).max() for known in both) < 1e-6
    assert len(np.unique(mixed.round(4).reshape(-1, 3), axis=0)) == 2


def test_an_image_of_thickness(studio: Studio, tmp_path: Any) -> None:
    from PIL import Image

    Image.fromarray(np.array([[0, 255]], np.uint8)).save(tmp_path / "t.png")
    camera = {"type": "orthographic", "position": [0.0, 0.0, -5.0], "target": [0.0, 0.0, 0.0], "height": 2.0}
    quad = {"type": "quad", "origin": [-1.0, -1.0, 0.0], "edge_u": [2.0, 0.0, 0.0], "edge_v": [0.0, 2.0, 0.0]}

    def image(thickness: Any) -> Floats:
        materials = {"m": COPPER | film(1.6, thickness)}
        scene = Scene(camera=camera, materials=materials, shapes=[{**quad, "material": "m"}], lights=[SKY])
        return studio.image(scene.placed("test", tmp_path, ()), 8, spp=1)

    seen = image({"texture": "t.png", "range": [200.0, 500.0], "filter": "nearest"})
    ends = [image(thickness).mean(axis=(0, 1)) for thickness in (200.0, 500.0)]
    halves = {tuple(pixel) for pixel in seen.reshape(-1, 3).round(5)}
    assert halves == {tuple(end.round(5)) for end in ends}


@pytest.mark.parametrize(
    ("material", "least", "most"),
    [
        pytest.param(
            {"type": "conductor", "metal": "Al", "roughness": 0.4} | film(1.8, 400.0),
            *(0.998, 1.002),
            id="metal",
            marks=pytest.mark.long,
        ),
        pytest.param(
            {"type": "principled", "base_color": [1.0] * 3, "roughness": 0.4} | film(1.3, 400.0),
            *(0.997, 1.016),
            id="plastic",
        ),
        pytest.param(
            {"type": "principled", "base_color": [1.0] * 3, "metallic": 0.5} | film(1.8, 550.0),
            *(0.998, 1.008),
            id="half",
            marks=pytest.mark.long,
        ),
        pytest.param(
            {"type": "dielectric", "ior": 1.5, "roughness": 0.4} | film(1.8, 550.0),
            *(0.99, 1.01),
            id="glass",
            marks=pytest.mark.long,
        ),
    ],
)
def test_what_lies_below_a_film_keeps_light(
    device: Device, material: dict[str, Any], least: float, most: float
) -> None:
    (found,) = measure(subjects_of(inline(material)), device, side=32)
    shares = np.concatenate([energy.sampled.ravel() for energy in found.white])
    assert least < shares.min() and shares.max() < most
    faults = [each.sentence for each in findings(found, 3) if each.fault]
    assert all("density" not in sentence and "reciprocal" not in sentence for sentence in faults)


def inline(material: dict[str, Any]) -> str:
    """The material as an inline table."""
    return "{" + ", ".join(f"{key} = {json.dumps(value)}" for key, value in material.items()) + "}"


def lamp_room(material: dict[str, Any]) -> Scene:
    """A ball of the material in a room with a lamp, and another one that is diffuse."""
    camera = {"position": [0.0, 1.0, 4.0], "target": [0.0, 0.8, 0.0], "vertical_fov": 40.0}
    white = {"type": "lambert", "reflectance": [0.7, 0.7, 0.7]}
    shapes = [
        {"type": "quad", "origin": [-3, 0, -3], "edge_u": [0, 0, 6], "edge_v": [6, 0, 0], "material": "white"},
        {"type": "sphere", "center": [0.0, 0.8, 0.0], "radius": 0.8, "material": "m"},
        {"type": "sphere", "center": [1.2, 0.4, 0.4], "radius": 0.4, "material": "white"},
        {
            "type": "quad",
            "origin": [-1.5, 3.0, -1.0],
            "edge_u": [1.5, 0.0, 0.0],
            "edge_v": [0.0, 0.0, 1.5],
            "emission": [9.0, 8.0, 7.0],
        },
    ]
    return Scene(camera=camera, materials={"white": white, "m": material}, shapes=shapes, lights=[SKY])


PLASTIC = {"type": "principled", "base_color": [0.8, 0.3, 0.2], "roughness": 0.35} | film(1.8, 480.0)
KINDS = {
    "plastic": PLASTIC,
    "gold": GOLD | {"roughness": 0.4} | film(1.5, 400.0),
    "rough glass": GLASS | {"roughness": 0.4} | film(1.9, 350.0),
    "thin": GLASS | {"thin": True} | film(1.33, 500.0),
    "coated": PLASTIC | {"metallic": 0.5, "coat": 0.7, "sheen_color": [0.3, 0.3, 0.3], "transmission": 0.4},
}


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({"sampling": "bsdf"}, id="bsdf"),
        pytest.param({"integrator": "bdpt"}, id="bdpt"),
        pytest.param({"integrator": "photon", "photons": 40000, "photon_radius": 0.02}, id="photon"),
        pytest.param({"spectral": True}, id="spectral"),
    ],
)
def test_strategies_see_the_same(evidence: Evidence, studio: Studio, kind: str, settings: dict[str, Any]) -> None:
    scene = lamp_room(KINDS[kind])
    spectral = settings == {"spectral": True}
    first = studio.tiles(scene, range(10), size=16, tiles=2, spp=128, spectral=spectral)
    second = studio.tiles(scene, range(50, 60), size=16, tiles=2, spp=128, **settings)
    # Photons are gathered from disks, which do not end where a surface does
    evidence.equal("radiance", first, second, rounding=1e-2 if settings.get("integrator") == "photon" else 0.0)


@pytest.mark.long
def test_the_bits_are_the_same_however_they_are_rendered(device: Device) -> None:
    assert len(hashes_by_lanes_and_cuts(device, lamp_room(KINDS["coated"]))) == 1


@pytest.mark.thorough
@pytest.mark.parametrize(
    "material",
    [
        pytest.param(GLASS | {"roughness": 0.5, "thin": True, "iridescence_thickness": 400.0}, id="thin"),
        pytest.param(GLASS | {"roughness": 0.5, "iridescence_thickness": 400.0}, id="rough", marks=pytest.mark.long),
        *(pytest.param(KINDS[kind], id=kind, marks=pytest.mark.long) for kind in ("plastic", "coated", "gold")),
        pytest.param(GLASS, id="smooth", marks=pytest.mark.long),
    ],
)
def test_what_has_no_film_keeps_its_bits_beside_what_has_one(device: Device, material: dict[str, Any]) -> None:
    """In the same packet: how many lanes it has decides what is beside it."""
    spots = {"iridescence": {"checker": [0.0, 1.0], "size": 0.01}}
    assert len(hashes_by_lanes_and_cuts(device, lamp_room(material | spots))) == 1


def test_what_is_refused() -> None:
    for more, text in (
        ({"iridescence_ior": 1.4}, "does nothing without iridescence"),
        ({"iridescence": 1.0, "iridescence_ior": 0.5}, "iridescence_ior"),
        ({"iridescence": 1.0, "iridescence_thickness": -1.0}, "iridescence_thickness"),
        ({"iridescence": 1.0, "iridescence_thickness": {"texture": "t.png"}}, "range"),
        ({"iridescence": 2.0}, "iridescence"),
    ):
        with pytest.raises(clrender.SceneError, match=text):
            clrender.Scene(
                camera={"position": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0]},
                materials={"m": GOLD | more},
                shapes=[],
            )
