"""Textures in images: exact means of a pixel's footprint, flat and tilted normal maps, no black rims."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image
from render_support import Studio, quad, sphere
from stats_support import Evidence

import clrender
from clrender.image.files import write_image
from clrender.scene import Scene

if TYPE_CHECKING:
    from clrender.device import Device

ACROSS = {"position": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 90.0}
"""Sees the square from -1 to 1 in the plane z = 0 and no more."""
SQUARE = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], material="m")
SUN = {"type": "directional", "direction": [0, 0, -1], "irradiance": [math.pi] * 3}
"""Of which a diffuse surface that faces it sends back its reflectance."""


def scene(
    shapes: list[dict[str, Any]], material: dict[str, Any], folder: Path, camera: dict[str, Any] = ACROSS, **more: Any
) -> Scene:
    materials = {"m": material, **more.pop("materials", {})}
    return Scene(camera=camera, shapes=shapes, materials=materials, **more).placed("here", folder)


def lambert(reflectance: Any, **more: Any) -> dict[str, Any]:
    return {"type": "lambert", "reflectance": reflectance, **more}


@pytest.mark.long
@pytest.mark.parametrize(
    "integrator",
    ["path", "whitted", *(pytest.param(name, marks=pytest.mark.slow) for name in ("direct", "reuse", "photon"))],
)
def test_a_pixel_shows_the_mean_of_its_footprint(studio: Studio, tmp_path: Path, integrator: str) -> None:
    """A checker of half a pixel and a ramp, which a stratified sample of 64 points gives the mean of."""
    more: dict[str, Any] = {"integrator": integrator, "spp": 64}
    if integrator == "photon":
        more["photons"] = 16
    dark, light, size = [0.2, 0.4, 0.1], [0.9, 0.5, 0.3], 8
    checker = lambert({"checker": [dark, light], "size": 0.5 / size})
    image = studio.image(scene([SQUARE], checker, tmp_path, lights=[SUN]), size, **more)
    np.testing.assert_allclose(image, np.broadcast_to((np.array(dark) + light) / 2, image.shape), rtol=2e-6)
    large = lambert({"checker": [dark, light], "size": 1.0 / size})
    image = studio.image(scene([SQUARE], large, tmp_path, lights=[SUN]), size, **more)
    # The first square is the lower left one, and images begin above
    odd = (np.arange(size)[None, :] + np.arange(size)[::-1, None]) % 2 == 1
    np.testing.assert_allclose(image, np.where(odd[..., None], light, dark), rtol=2e-6)
    image = studio.image(scene([SQUARE], lambert({"ramp": [dark, light]}), tmp_path, lights=[SUN]), size, **more)
    share = (np.arange(size) + 0.5)[None, :, None] / size
    expected = np.broadcast_to((1 - share) * np.array(dark) + share * np.array(light), image.shape)
    # 64 points stratified along x: the mean of a linear function to a fraction of a cell, 1/64 of a pixel
    np.testing.assert_allclose(image, expected, atol=0.7 / size / 64)


@pytest.mark.parametrize("integrator", ["path", pytest.param("whitted", marks=pytest.mark.long)])
def test_a_texture_of_one_colour_is_that_colour_to_the_bit(device: Device, tmp_path: Path, integrator: str) -> None:
    """And a flat normal map, or bump map, changes none, on flat and on round shapes."""
    write_image(tmp_path / "one.exr", np.tile(np.array([0.25, 0.5, 0.75], np.float32), (3, 5, 1)))
    Image.fromarray(np.full((4, 4, 3), (128, 128, 255), np.uint8)).save(tmp_path / "flat.png")
    Image.fromarray(np.full((4, 4), 77, np.uint8)).save(tmp_path / "even.png")
    shapes = [
        SQUARE,
        sphere([-0.4, 0.3, 0.2], 0.2, material="m"),
        {"type": "disk", "center": [0.4, 0.3, 0.2], "normal": [0.2, 0.1, 1], "radius": 0.3, "material": "m"},
        {"type": "box", "center": [0.0, -0.4, 0.2], "size": [0.3] * 3, "material": "m"},
        quad([-0.2, 0.5, 0.8], [0, -0.4, 0], [0.4, 0, 0], emission=3.0),
    ]
    lights = [{"type": "environment", "radiance": [0.5] * 3}, {**SUN, "direction": [0.3, 0.2, -1]}]
    flat = {"normal_map": {"texture": "flat.png", "scale": 2.0}, "bump_map": {"texture": "even.png"}}
    texture = {"texture": "one.exr", "transform": {"scale": 3.0}}
    hashes = set()
    for material in (
        {"reflectance": [0.25, 0.5, 0.75]},
        {"reflectance": texture},
        {"reflectance": [0.25, 0.5, 0.75], **flat},
        {"reflectance": texture, **flat},
    ):
        what = scene(shapes, {"type": "lambert", **material}, tmp_path, lights=lights)
        image = clrender.render(what, device=device, size=(40, 40), spp=4, integrator=integrator)
        hashes.add(image.stats["image_sha256"])
    assert len(hashes) == 1


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("map_kind", ["normal_map", "bump_map"])
def test_a_tilted_map_is_tilted_geometry(
    evidence: Evidence, studio: Studio, tmp_path: Path, map_kind: str, flip: bool
) -> None:
    """A square whose map tilts it, and one that is tilted, under an area light; from the front and from the back."""
    tilt_u, tilt_v = math.radians(20.0), math.radians(-12.0)
    normal = np.array([-math.tan(tilt_u), -math.tan(tilt_v), 1.0])
    normal /= np.linalg.norm(normal)
    if map_kind == "normal_map":
        write_image(tmp_path / "tilt.exr", np.tile(((normal + 1) / 2).astype(np.float32), (2, 2, 1)))
        mapped: dict[str, Any] = {"texture": "tilt.exr"}
    else:
        # Heights of an inclined plane over 2 metres, between the centres of the first texel and the last
        x, y = np.meshgrid((np.arange(64) + 0.5) / 64, 1 - (np.arange(64) + 0.5) / 64)
        heights = 2 * (x * math.tan(tilt_u) + y * math.tan(tilt_v))
        write_image(tmp_path / "tilt.exr", np.repeat(heights[..., None], 3, axis=2))
        mapped = {"texture": "tilt.exr", "wrap": "clamp"}
    camera = {"position": [0.1, 0.05, 1.0], "target": [0.0, 0.0, 0.0], "vertical_fov": 0.01}
    light = quad([0.5, -0.3, 0.9], [-0.3, 0, 0.3], [0, 0.6, 0], emission=5.0)
    # Heights and normals point out of the front, which a flipped square turns to its back
    sign = -1.0 if flip else 1.0
    u, v = np.array([2.0, 0.0, sign * 2 * math.tan(tilt_u)]), np.array([0.0, 2.0, sign * 2 * math.tan(tilt_v)])
    inclined = quad((-(u + v) / 2).tolist(), u.tolist(), v.tolist(), material="m", flip_normals=flip)
    level = {**SQUARE, "flip_normals": flip}
    grey = lambert([0.5, 0.6, 0.7])
    with_map = studio.pixels(scene([level, light], {**grey, map_kind: mapped}, tmp_path, camera), spp=16)
    tilted = studio.pixels(scene([inclined, light], grey, tmp_path, camera), spp=16, seed=1)
    flat = studio.pixels(scene([level, light], grey, tmp_path, camera), spp=16)
    assert abs(flat.mean() / tilted.mean() - 1.0) > 0.03  # the means' errors are below 0.003
    evidence.equal(f"{map_kind}, flip {flip}", with_map, tilted)


@pytest.mark.long
def test_no_black_rims_and_no_light_from_below(studio: Studio, tmp_path: Path) -> None:
    """A mirror with a wild normal map sees nothing but its white surroundings; from below nothing shines through."""
    rng = np.random.default_rng(720)
    Image.fromarray(rng.integers(0, 256, (32, 32, 3), np.uint8)).save(tmp_path / "wild.png")
    wild = {"texture": "wild.png", "scale": 3.0}
    mirror = {"type": "mirror", "reflectance": [1.0] * 3, "normal_map": wild}
    ball = [sphere([0, 0, 0], 1, material="m")]
    camera = {"position": [0, 0, 4], "target": [0, 0, 0], "vertical_fov": 30.0}
    sky = [{"type": "environment", "radiance": [1.0] * 3}]
    image = studio.image(scene(ball, mirror, tmp_path, camera, lights=sky), 64, spp=8)
    np.testing.assert_allclose(image, 1.0, atol=1e-6)
    below = [{**SUN, "direction": [0, 0, 1]}]
    for material in (lambert([0.8] * 3, normal_map=wild), {**mirror, "type": "oren_nayar"}):
        image = studio.image(scene([SQUARE], material, tmp_path, lights=below), 32, spp=8)
        assert image.max() == 0.0
    image = studio.image(scene(ball, lambert([1.0] * 3, normal_map=wild), tmp_path, camera, lights=sky), 64, spp=64)
    assert image.max() < 2.5 and image[20:44, 20:44].min() > 0.2


def test_random_texels_have_the_mean_of_linear_interpolation(
    evidence: Evidence, studio: Studio, tmp_path: Path
) -> None:
    """`path` chooses one of four texels, `whitted` reads all: the same image in the mean, by tiles."""
    rng = np.random.default_rng(721)
    Image.fromarray(rng.integers(0, 256, (5, 7, 3), np.uint8)).save(tmp_path / "a.png")
    material = lambert({"texture": "a.png", "wrap": "mirror", "transform": {"rotate_degrees": 30.0, "scale": 1.3}})
    what = scene([SQUARE], material, tmp_path, lights=[SUN])
    at_random = studio.tiles(what, range(16), 32, 4, spp=16)
    exact = studio.tiles(what, range(16), 32, 4, spp=16, integrator="whitted")
    evidence.equal("tiles", at_random, exact)


def test_layers_show_textures(device: Device, tmp_path: Path) -> None:
    dark, light = [0.2, 0.4, 0.1], [0.9, 0.5, 0.3]
    checker = lambert({"checker": [dark, light], "size": 1.0 / 8})
    what = scene([SQUARE], checker, tmp_path, lights=[SUN])
    image = clrender.render(what, device=device, size=(8, 8), spp=4, aov=["albedo"])
    odd = (np.arange(8)[None, :] + np.arange(8)[::-1, None]) % 2 == 1
    np.testing.assert_allclose(image.aovs["albedo"], np.where(odd[..., None], light, dark), rtol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("each", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_parameter_may_be_a_texture(device: Device, tmp_path: Path, each: bool) -> None:
    """Ramps of one value give the bits of the constant, and other textures do not; also below mixtures."""
    principled: dict[str, Any] = {
        "base_color": [0.75, 0.5, 0.25],
        "metallic": 0.25,
        "roughness": 0.375,
        "specular": 0.5,
        "specular_color": [1.0, 0.75, 0.5],
        "transmission": 0.25,
        "diffuse_roughness": 0.5,
        "coat": 0.75,
        "coat_roughness": 0.25,
        "sheen_color": [0.25, 0.25, 0.5],
        "sheen_roughness": 0.5,
        "anisotropy": 0.5,
    }
    others: dict[str, dict[str, Any]] = {
        "n": {"type": "conductor", "f0": [0.75, 0.5, 0.25], "roughness": 0.25, "anisotropy": 0.25},
        "o": {"type": "oren_nayar", "reflectance": [0.5, 0.25, 0.75], "roughness": 0.5},
        "p": {"type": "dielectric", "ior": 1.5, "roughness": 0.5},
        "q": {"type": "mirror", "reflectance": [0.5, 0.75, 0.25]},
        "r": {"type": "mix", "materials": ["o", "n"], "weight": 0.25},
    }
    shapes = [sphere([i % 3 - 1, 0.5 - i // 3, 0], 0.45, material=name) for i, name in enumerate("mnopqr")]
    sky = [{"type": "environment", "radiance": [1.0, 0.75, 0.5]}, {**SUN, "direction": [0.3, -1, -1]}]
    camera = {"position": [0, 0, 5], "target": [0, 0, 0], "vertical_fov": 28.0}

    def ramp(value: Any) -> dict[str, Any]:
        return {"ramp": [value, value]}

    def shown(changed: Any, keys: set[str]) -> str:
        def of(material: dict[str, Any]) -> dict[str, Any]:
            fixed = {"type", "ior", "materials"}
            return {key: changed(value) if key in keys - fixed else value for key, value in material.items()}

        materials = {name: of(other) for name, other in others.items()}
        what = scene(
            shapes, of({"type": "principled", **principled}), tmp_path, camera, lights=sky, materials=materials
        )
        image = clrender.render(what, device=device, size=(48, 32), spp=4)
        assert image.stats["nonfinite_samples"] == 0
        return str(image.stats["image_sha256"])

    keys = {*principled, "reflectance", "f0", "weight"}
    constant = shown(lambda value: value, keys)
    assert shown(ramp, keys) == constant
    if not each:
        return
    apart = {key: shown(lambda value: {"checker": [0.0, 1.0], "size": 0.1}, {key}) for key in keys}
    assert len({constant, *apart.values()}) == len(keys) + 1
