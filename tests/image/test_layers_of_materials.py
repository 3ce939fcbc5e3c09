"""Layers of rough, layered and textured materials: known answers, and the share of light of a white sky."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.device import Device
from clrender.image.files import write_image
from clrender.scene import Scene

GREEN = [0.14, 0.45, 0.091]
CLEAR: dict[str, Any] = {"type": "principled", "base_color": [1.0, 1.0, 1.0], "transmission": 1.0, "roughness": 0.0}
VIEW = {"position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, -1.0], "vertical_fov": 60.0}


def scene(shapes: list[dict[str, Any]], view: dict[str, Any] | None = None, **materials: Any) -> Scene:
    """Shapes seen from the origin along -z, in a green room."""
    room = {"type": "box", "size": [19, 19, 19], "flip_normals": True, "material": "green"}
    green = {"type": "lambert", "reflectance": GREEN}
    more = {"camera": view or VIEW, "materials": {"green": green, **materials}}
    return Scene.model_validate({**more, "shapes": [*shapes, room]})


def wall(z: float, material: str = "m") -> dict[str, Any]:
    """A quad across the whole view, facing +z."""
    return {"type": "quad", "origin": [-8, -8, z], "edge_u": [16, 0, 0], "edge_v": [0, 16, 0], "material": material}


def layer(device: Device, what: Scene, name: str, spp: int = 64) -> npt.NDArray[np.float64]:
    with clrender.Session(device) as session:
        return session.render(what, size=(16, 12), aov=(name,), spp=spp).aovs[name].astype(np.float64)


@pytest.mark.long
def test_albedo_of_a_texture_is_that_of_its_points(device: Device) -> None:
    checker = {"type": "lambert", "reflectance": {"checker": [0.2, [0.9, 0.5, 0.1]], "size": 0.0625}}
    what = scene([wall(-2.0)], m=checker)
    x, y, _ = np.moveaxis(layer(device, what, "position", 1), -1, 0)
    second = (np.floor(x + 8.0) + np.floor(y + 8.0)) % 2 == 1
    expected = np.where(second[..., None], [0.9, 0.5, 0.1], [0.2, 0.2, 0.2]).astype(np.float32)
    assert 0.2 < second.mean() < 0.8
    np.testing.assert_array_equal(layer(device, what, "albedo", 1), expected)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["lambert", "conductor"])
def test_normal_is_that_of_the_map(device: Device, tmp_path: Path, kind: str) -> None:
    """Red along u is to the right, green along v upward; so near the middle no view bends it."""
    normal = np.array([0.36, -0.48, 0.8])
    write_image(tmp_path / "n.exr", np.full((2, 2, 3), normal * 0.5 + 0.5, np.float32))
    color = {"reflectance": [0.5] * 3} if kind == "lambert" else {"f0": [0.5] * 3, "roughness": 0.5}
    material = {"type": kind, **color, "normal_map": {"texture": "n.exr"}}
    what = scene([wall(-2.0)], {**VIEW, "vertical_fov": 10.0}, m=material).placed("here", tmp_path)
    seen = layer(device, what, "normal", 4)
    np.testing.assert_allclose(seen, np.broadcast_to(normal, seen.shape), atol=1e-5)


GOLD = {"type": "conductor", "metal": "Au", "roughness": 0.5}
CLAY = {"type": "oren_nayar", "reflectance": [0.8, 0.5, 0.2], "roughness": 0.7}
ROUGH: dict[str, dict[str, Any]] = {
    "gold": GOLD,
    "schlick": {"type": "conductor", "f0": [0.9, 0.5, 0.2], "roughness": 0.8},
    "brushed": {"type": "conductor", "metal": "Cu", "roughness": 0.3, "anisotropy": 0.8},
    "clay": CLAY,
    "mixed": {"type": "mix", "materials": ["gold", "clay"], "weight": 0.4},
    "thin": {"type": "dielectric", "ior": 1.5, "roughness": 0.3, "thin": True},
    "plastic": {"type": "principled", "base_color": [0.7, 0.3, 0.2], "roughness": 0.4},
    "coated": {"type": "principled", "base_color": [0.7, 0.3, 0.2], "roughness": 0.4, "coat": 1.0},
    "cloth": {"type": "principled", "base_color": [0.2, 0.3, 0.2], "roughness": 0.8, "sheen_color": [0.9, 0.5, 0.5]},
    "tinted": {**CLEAR, "base_color": [0.9, 0.5, 0.2], "roughness": 0.4, "thin": True},
}


@pytest.mark.long
@pytest.mark.parametrize("name", ROUGH)
def test_albedo_of_rough_materials_is_what_they_reflect_and_pass(device: Device, name: str) -> None:
    """Under a white sky a surface alone is as bright as that share.

    The layer goes by simple formulae (kernels/material/closure.h), which for EON leave out what is absorbed between its
    grooves: a twentieth is allowed.
    """
    materials = {"m": ROUGH[name], **({"gold": GOLD, "clay": CLAY} if name == "mixed" else {})}
    sky = {"type": "environment", "radiance": [1.0, 1.0, 1.0]}
    for place in ([0.0, 0.0, 3.0], [2.4, 0.0, 1.8]):
        view = {"position": place, "target": [0.0, 0.0, 0.0], "vertical_fov": 8.0}
        alone = {"camera": view, "materials": materials, "shapes": [wall(0.0)], "lights": [sky]}
        with clrender.Session(device) as session:
            image = session.render(Scene.model_validate(alone), size=(16, 16), spp=64, aov=("albedo",))
        seen, said = (each.mean(axis=(0, 1)) for each in (image.linear, image.aovs["albedo"]))
        np.testing.assert_allclose(said, seen, atol=0.05)


@pytest.mark.parametrize("thin", [True, False])
def test_clear_glass_of_gltf_is_looked_through(device: Device, thin: bool) -> None:
    """`principled` with transmission and no roughness is no delta, but as narrow as lobes can be."""
    ball = {"type": "sphere", "center": [0.0, 0.0, -3.0], "radius": 1.0, "material": "m"}
    what = scene([ball], m={**CLEAR, "thin": thin})
    albedo = layer(device, what, "albedo")
    np.testing.assert_allclose(albedo, np.broadcast_to(GREEN, albedo.shape), atol=0.02)
    np.testing.assert_allclose(albedo.mean(axis=(0, 1)), GREEN, rtol=0.01)
    frosted = layer(device, scene([ball], m={**CLEAR, "thin": thin, "roughness": 0.3}), "albedo")
    np.testing.assert_allclose(frosted[5:7, 7:9], 1.0, rtol=1e-6)


METALS: dict[str, dict[str, Any]] = {
    "delta": {"type": "conductor", "f0": [0.9, 0.5, 0.2], "roughness": 0.0},
    "principled": {"type": "principled", "base_color": [0.9, 0.5, 0.2], "metallic": 1.0, "roughness": 0.0},
}


@pytest.mark.parametrize("name", METALS)
def test_what_smooth_metal_shows_is_tinted_by_it(device: Device, name: str) -> None:
    """Seen straight on, where it reflects its colour."""
    albedo = layer(device, scene([wall(-2.0)], {**VIEW, "vertical_fov": 2.0}, m=METALS[name]), "albedo")
    expected = np.array(GREEN) * [0.9, 0.5, 0.2]
    np.testing.assert_allclose(albedo, np.broadcast_to(expected, albedo.shape), rtol=2e-3)


@pytest.mark.long
def test_what_absorbs_on_the_way_tints(device: Device) -> None:
    """A block of half a metre of a medium of index 1, of which a metre leaves this share."""
    left = [0.81, 0.49, 0.04]
    medium = {"type": "dielectric", "ior": 1.0, "attenuation_color": left, "attenuation_distance": 1.0}
    block = {"type": "box", "center": [0, 0, -2], "size": [9, 9, 0.5], "material": "m"}
    view = {**VIEW, "vertical_fov": 0.5}
    albedo = layer(device, scene([block], view, m=medium), "albedo", 4)
    np.testing.assert_allclose(albedo, np.broadcast_to(np.array(GREEN) * np.sqrt(left), albedo.shape), rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["surfaces", "drink"])
def test_the_same_bits_in_every_number_of_lanes(device: Device, name: str) -> None:
    what, made = clrender.load(name), set()
    for lanes in (1, 4, 8, 16):
        with clrender.Session(device) as session:
            image = session.render(what, size=(40, 24), spp=4, lanes=lanes, aov=("albedo", "normal"), max_depth=1)
        made.add(image.aovs["albedo"].tobytes() + image.aovs["normal"].tobytes())
    assert len(made) == 1
