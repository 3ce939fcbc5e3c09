"""glTF models seen: each feature against a number that the specification, or simple optics, says."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from assets import ASSETS, needs_assets
from gltf_files import Model

import clrender
from clrender.device import Device
from clrender.flatten.surfaces import flat_surfaces
from clrender.image.files import write_image
from clrender.scene import Camera, EnvironmentLight, Principled, Scene

Colors = npt.NDArray[np.float64]
SIZE = 32
RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)


def lens(half: float) -> dict[str, Any]:
    """A camera that sees so far to all sides of its middle, without perspective."""
    flat = {"xmag": half, "ymag": half, "znear": 0.01, "zfar": 99.0}
    return {"type": "orthographic", "orthographic": flat}


def seen(folder: Path, device: Device, model: Model, half: float = 1.0, spp: int = 4, **more: Any) -> Colors:
    """The image of a model from +z, (32, 32, 3) radiance; without lights of its own in a radiance of 1 all around."""
    model.node(camera=model.add("cameras", lens(half)), translation=[0, 0, 9])
    lit = "KHR_lights_punctual" in model.root.get("extensions", {})
    scene = clrender.load(model.write(folder / "m.glb"), environment=None if lit else 1.0)
    image = clrender.render(scene, device=device.info.index, size=(SIZE, SIZE), spp=spp, **more)
    return np.asarray(image.linear, np.float64)


def unlit(model: Model, **base: Any) -> int:
    """A material that shows its colour as it is."""
    if "KHR_materials_unlit" not in model.root.get("extensionsUsed", []):
        model.extend("KHR_materials_unlit")
    return model.add("materials", {"pbrMetallicRoughness": base, "extensions": {"KHR_materials_unlit": {}}})


def quarters(image: Colors) -> Colors:
    """Colours in the middles of the four quarters, from the upper left by rows."""
    a, b = SIZE // 4, 3 * SIZE // 4
    return np.array([image[a, a], image[a, b], image[b, a], image[b, b]])


@pytest.mark.long
def test_pictures_stand_upright_and_unlit_shows_their_colours(device: Device, tmp_path: Path) -> None:
    model = Model()
    texture = model.texture([[RED, GREEN], [BLUE, WHITE]], {"magFilter": 9728})
    model.node(mesh=model.quad(unlit(model, baseColorTexture={"index": texture})))
    np.testing.assert_allclose(quarters(seen(tmp_path, device, model)) * 255.0, [RED, GREEN, BLUE, WHITE], atol=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ({"offset": [0.5, 0.0]}, [GREEN, RED, WHITE, BLUE]),
        ({"offset": [0.0, 0.5]}, [BLUE, WHITE, RED, GREEN]),
        # u' = v, v' = 1 - u: the coordinates turn counter-clockwise, and the picture clockwise
        ({"rotation": math.pi / 2, "offset": [0.0, 1.0]}, [BLUE, RED, WHITE, GREEN]),
        ({"scale": [0.5, 0.5], "offset": [0.5, 0.5]}, [WHITE] * 4),
        ({"scale": [1.0, 0.75], "rotation": math.pi / 2, "offset": [0.0, 1.0]}, [BLUE, RED, WHITE, GREEN]),
        ({"scale": [0.5, 1.0], "rotation": math.pi / 2, "offset": [0.0, 0.5]}, [RED, RED, GREEN, GREEN]),
    ],
)
def test_transforms_of_textures(
    device: Device, tmp_path: Path, transform: dict[str, Any], expected: list[tuple[int, ...]]
) -> None:
    model = Model()
    model.extend("KHR_texture_transform")
    texture = model.texture([[RED, GREEN], [BLUE, WHITE]], {"magFilter": 9728})
    info = {"index": texture, "extensions": {"KHR_texture_transform": transform}}
    model.node(mesh=model.quad(unlit(model, baseColorTexture=info)))
    np.testing.assert_allclose(quarters(seen(tmp_path, device, model)) * 255.0, expected, atol=1e-3)


@pytest.mark.parametrize(
    ("sampler", "expected"),
    [
        ({}, [RED, RED, RED, RED]),
        ({"wrapS": 33071}, [RED, GREEN, RED, GREEN]),
        ({"wrapS": 33648}, [RED, GREEN, RED, GREEN]),
        ({"wrapT": 33071}, [RED, RED, BLUE, BLUE]),
    ],
)
def test_wraps_beyond_the_picture(
    device: Device, tmp_path: Path, sampler: dict[str, int], expected: list[tuple[int, ...]]
) -> None:
    """Coordinates 0 to 2: in the middles of quarters 0.5 and 1.5, minus a quarter to stay off the texels' edges."""
    model = Model()
    texture = model.texture([[RED, GREEN], [BLUE, WHITE]], {"magFilter": 9728, **sampler})
    at = [(-0.25, 1.75), (1.75, 1.75), (1.75, -0.25), (-0.25, -0.25)]
    model.node(mesh=model.quad(unlit(model, baseColorTexture={"index": texture}), TEXCOORD_0=at))
    np.testing.assert_allclose(quarters(seen(tmp_path, device, model)) * 255.0, expected, atol=1e-3)


def test_the_second_set_of_coordinates(device: Device, tmp_path: Path) -> None:
    model = Model()
    texture = model.texture([[RED, GREEN], [BLUE, WHITE]], {"magFilter": 9728})
    material = unlit(model, baseColorTexture={"index": texture, "texCoord": 1})
    model.node(mesh=model.quad(material, TEXCOORD_1=((1, 1), (0, 1), (0, 0), (1, 0))))  # mirrored
    found = quarters(seen(tmp_path, device, model)) * 255.0
    np.testing.assert_allclose(found, [GREEN, RED, WHITE, BLUE], atol=1e-3)


@pytest.mark.long
def test_colours_of_vertices_multiply_the_base_colour(device: Device, tmp_path: Path) -> None:
    """In light from all around a matt surface shows its albedo; between vertices it is interpolated linearly."""
    model = Model()
    base = {"baseColorFactor": [0.5, 1.0, 1.0, 1.0], "metallicFactor": 0.0}
    specular = {"KHR_materials_specular": {"specularFactor": 0.0}}
    model.extend("KHR_materials_specular")
    material = model.add("materials", {"pbrMetallicRoughness": base, "extensions": specular})
    model.node(mesh=model.quad(material, COLOR_0=((0, 0, 0.5), (1, 0, 0.5), (1, 1, 0.5), (0, 1, 0.5))))
    image = seen(tmp_path, device, model, spp=256)
    x = (np.arange(SIZE) + 0.5) / SIZE
    np.testing.assert_allclose(image.mean(axis=0)[:, 0], 0.5 * x, atol=0.02)
    np.testing.assert_allclose(image.mean(axis=1)[:, 1], 1.0 - x, atol=0.02)
    np.testing.assert_allclose(image[..., 2].mean(), 0.5, atol=0.01)


@pytest.mark.long
@pytest.mark.parametrize(("mode", "shown"), [("OPAQUE", [1.0, 1.0]), ("BLEND", [0.8, 0.2]), ("MASK", [1.0, 0.0])])
def test_alpha(device: Device, tmp_path: Path, mode: str, shown: list[float]) -> None:
    """A surface of radiance 3 before an environment of 1: alpha is 0.8 on the left and 0.2 on the right."""
    model = Model()
    model.extend("KHR_materials_emissive_strength")
    texture = model.texture([[(0, 0, 0, 204), (0, 0, 0, 51)]], {"magFilter": 9728})
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 3.0}}
    source = {"emissiveFactor": [1, 1, 1], "alphaMode": mode, "extensions": strength}
    base = {"baseColorTexture": {"index": texture}, "roughnessFactor": 1.0}
    material = model.add("materials", {"pbrMetallicRoughness": base, **source})
    model.node(mesh=model.quad(material))
    image = seen(tmp_path, device, model, spp=256)
    found = [image[:, : SIZE // 2, 1].mean(), image[:, SIZE // 2 :, 1].mean()]
    np.testing.assert_allclose(found, [3.0 * share + (1.0 - share) for share in shown], atol=0.03)


def test_a_negative_scale_shines_from_where_its_front_is_seen(device: Device, tmp_path: Path) -> None:
    """Two quads that shine to the front only: a mirrored one still shows its front, a turned one does not."""
    model = Model()
    material = model.add(
        "materials", {"emissiveFactor": [1, 1, 1], "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}}
    )
    mesh = model.quad(material)
    model.node(mesh=mesh, translation=[-0.5, 0, 0], scale=[-0.4, 0.4, 0.4])
    model.node(mesh=mesh, translation=[0.5, 0, 0], scale=[0.4, 0.4, 0.4], rotation=[0, 1, 0, 0])
    model.extend("KHR_lights_punctual")
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 0.0}]}}
    model.node(extensions={"KHR_lights_punctual": {"light": 0}})  # so that there is no environment
    image = seen(tmp_path, device, model)
    assert image[SIZE // 2, SIZE // 4, 0] == pytest.approx(1.0) and image[SIZE // 2, 3 * SIZE // 4, 0] == 0.0


def cube(model: Model, material: int) -> int:
    """A mesh from -1 to 1 with its fronts outward."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    order = np.array([(a, b, c, a, c, d) for a, b, c, d in faces]).ravel()
    primitive = {"attributes": {"POSITION": model.accessor(corners)}, "indices": model.accessor(order, "uint16")}
    return model.add("meshes", {"primitives": [{**primitive, "material": material}]})


def glass(model: Model, ior: float, **volume: Any) -> int:
    model.extend("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume")
    extensions: dict[str, Any] = {
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_ior": {"ior": ior},
    }
    if volume:
        extensions["KHR_materials_volume"] = {"thicknessFactor": 1.0, **volume}
    base = {"metallicFactor": 0.0, "roughnessFactor": 0.0}
    return model.add("materials", {"pbrMetallicRoughness": base, "extensions": extensions})


@pytest.mark.long
def test_attenuation_by_beers_law(device: Device, tmp_path: Path) -> None:
    """Straight through two units, of which one leaves (0.2, 0.5, 0.9): its square, scaled nodes included."""
    for scale, length in ((1.0, 2.0), (0.5, 1.0)):
        model = Model()
        material = glass(model, 1.0, attenuationDistance=1.0, attenuationColor=[0.2, 0.5, 0.9])
        model.node(mesh=cube(model, material), scale=[1, 1, scale])
        image = seen(tmp_path, device, model, half=0.9)
        np.testing.assert_allclose(image.mean(axis=(0, 1)), np.array([0.2, 0.5, 0.9]) ** length, rtol=1e-3)


def test_thin_glass_bends_nothing_and_reflects_what_two_boundaries_do(device: Device, tmp_path: Path) -> None:
    """Of index 1.5 straight on 4 % each: 2R / (1 + R) back; before black that is all that comes from around."""
    model = Model()
    model.node(mesh=model.quad(glass(model, 1.5)), scale=[2, 2, 2])
    black = model.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}})
    # A black metal reflects at grazing angles only (Schlick)
    model.node(mesh=model.quad(black), translation=[0, 0, -1], scale=[9, 9, 9])
    image = seen(tmp_path, device, model, spp=256)
    assert image.mean() == pytest.approx(2 * 0.04 / 1.04, abs=0.012)


def test_metals_and_plastics_in_even_light(device: Device, tmp_path: Path) -> None:
    """Seen straight on a metal returns its colour, a plastic 4 % of all light as well; the default is a white metal."""
    for metallic, expected in ((1.0, 0.5), (0.0, 0.04 + 0.96 * 0.5), (None, 1.0)):
        model = Model()
        base = {"baseColorFactor": [0.5, 0.5, 0.5, 1.0], "metallicFactor": metallic, "roughnessFactor": 0.3}
        material = None if metallic is None else model.add("materials", {"pbrMetallicRoughness": base})
        model.node(mesh=model.quad(material))
        assert seen(tmp_path, device, model, spp=64).mean() == pytest.approx(expected, abs=0.025)


@pytest.mark.long
def test_a_normal_map_turns_the_normal_as_geometry_does(device: Device, tmp_path: Path) -> None:
    """Green is up in the picture: a surface that leans up by 30 degrees, by map and by rotation, lit from above."""
    found = []
    for mapped in (True, False):
        model = Model()
        lean = math.radians(30.0)
        base = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        source: dict[str, Any] = {
            "pbrMetallicRoughness": base,
            "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}},
        }
        if mapped:
            texel = [round(127.5 + 127.5 * x) for x in (0.0, math.sin(lean), math.cos(lean))]
            source["normalTexture"] = {"index": model.texture([[texel]])}
        model.extend("KHR_lights_punctual", "KHR_materials_specular")
        sun = {"type": "directional", "intensity": 683.0}
        model.root["extensions"] = {"KHR_lights_punctual": {"lights": [sun]}}
        half = -math.radians(45.0) / 2.0  # shines down and to the back
        model.node(rotation=[math.sin(half), 0, 0, math.cos(half)], extensions={"KHR_lights_punctual": {"light": 0}})
        turn = [0, 0, 0, 1] if mapped else [math.sin(-lean / 2.0), 0, 0, math.cos(lean / 2.0)]
        model.node(mesh=model.quad(model.add("materials", source)), scale=[9, 9, 9], rotation=turn)
        found.append(float(seen(tmp_path, device, model, spp=16).mean()))
    assert found[1] == pytest.approx(math.cos(math.radians(15.0)) / math.pi, rel=1e-3)
    assert found[0] == pytest.approx(found[1], rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize(
    ("tangent", "texel", "scale"),
    [
        (None, (0, 1), (1, 1)),
        # Red upwards, so green, normal x tangent times w, to the left or to the right
        ((0, 1, 0, 1), (1, 0), (1, 1)),
        ((0, 1, 0, -1), (1, 0), (1, 1)),
        ((1, 0, 0, 1), (0, 1), (1, 1)),
        ((1, 0, 0, -1), (0, -1), (1, 1)),
        # Mirrored nodes mirror what is on them
        ((1, 0, 0, 1), (0, 1), (-1, 1)),
        ((1, 0, 0, 1), (0, -1), (1, -1)),
        ((0, 1, 0, 1), (-1, 0), (1, -1)),
        (None, (0, -1), (1, -1)),
    ],
)
def test_tangents_say_which_way_a_normal_map_leans(
    device: Device,
    tmp_path: Path,
    tangent: tuple[int, ...] | None,
    texel: tuple[int, int],
    scale: tuple[int, int],
) -> None:
    """However tangents lie, the surface leans up by 30 degrees, and light from 45 degrees above meets it at 15."""
    model = Model()
    model.extend("KHR_lights_punctual", "KHR_materials_specular")
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 683.0}]}}
    half = -math.radians(45.0) / 2.0
    model.node(rotation=[math.sin(half), 0, 0, math.cos(half)], extensions={"KHR_lights_punctual": {"light": 0}})
    red, green = (round(127.5 + 127.5 * math.sin(math.radians(30.0)) * share) for share in texel)
    texture = model.texture([[(red, green, round(127.5 + 127.5 * math.cos(math.radians(30.0))))]])
    rough = {"pbrMetallicRoughness": {"metallicFactor": 0.0}, "normalTexture": {"index": texture}}
    plain = {"extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}}
    more = {} if tangent is None else {"TANGENT": [tangent] * 4}
    mesh = model.quad(model.add("materials", {**rough, **plain}), NORMAL=[(0, 0, 1)] * 4, **more)
    model.node(mesh=mesh, scale=[9 * scale[0], 9 * scale[1], 9])
    found = float(seen(tmp_path, device, model, spp=4).mean())
    assert found == pytest.approx(math.cos(math.radians(15.0)) / math.pi, rel=0.01)


def dark(model: Model) -> None:
    """A light without power, so that there is no environment."""
    model.extend("KHR_lights_punctual")
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 0.0}]}}
    model.node(extensions={"KHR_lights_punctual": {"light": 0}})


def shining(model: Model, strength: float, **more: Any) -> int:
    """A black material that shines."""
    if "KHR_materials_emissive_strength" not in model.root.get("extensionsUsed", []):
        model.extend("KHR_materials_emissive_strength")
    extensions = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    base = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "extensions": extensions}
    return model.add("materials", {**base, "emissiveFactor": [1, 1, 1], **more})


@pytest.mark.parametrize("strength", [0.5, 1.0, 16.0])
def test_emissive_strength_multiplies_factor_and_texture(device: Device, tmp_path: Path, strength: float) -> None:
    """188 of 255 in sRGB is 0.5029 in linear light: times the factor, times the strength."""
    model = Model()
    dark(model)
    texture = {"index": model.texture([[(188, 188, 188)]])}
    model.node(mesh=model.quad(shining(model, strength, emissiveFactor=[1.0, 0.5, 0.0], emissiveTexture=texture)))
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    expected = strength * linear * np.array([1.0, 0.5, 0.0])
    np.testing.assert_allclose(seen(tmp_path, device, model).mean(axis=(0, 1)), expected, rtol=1e-4)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_transmission_shows_what_is_behind_in_the_base_colour(device: Device, tmp_path: Path, share: float) -> None:
    """Of a lamp of radiance 5 behind a pane of index 1.5 comes share * colour * (1 - R) / (1 + R), with R = 4 %."""
    model = Model()
    dark(model)
    model.extend("KHR_materials_transmission")
    color = [0.25, 0.5, 1.0]
    pane = {
        "pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.0},
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": share}},
    }
    model.node(mesh=model.quad(model.add("materials", pane)))
    model.node(mesh=model.quad(shining(model, 5.0)), translation=[0, 0, -1], scale=[3, 3, 1])
    image = seen(tmp_path, device, model, half=0.9, spp=64)
    expected = share * 5.0 * np.array(color) * (1.0 - 0.04) / (1.0 + 0.04)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), expected, rtol=0.02, atol=1e-3)


@pytest.mark.long
def test_anisotropy_turns_from_tangents(device: Device, tmp_path: Path) -> None:
    """A brushed metal in slanting light: tangents and rotations that mean the same direction show the same."""

    def shown(degrees: float, tangent: tuple[int, ...] | None, turned: bool = False) -> float:
        model = Model()
        model.extend("KHR_lights_punctual", "KHR_materials_anisotropy")
        model.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 683.0}]}}
        half, beside = -math.radians(50.0) / 2.0, math.radians(25.0)
        axis = [math.sin(half) * math.cos(beside), math.sin(half) * math.sin(beside), 0]
        model.node(rotation=[*axis, math.cos(half)], extensions={"KHR_lights_punctual": {"light": 0}})
        brushed = {"anisotropyStrength": 0.9, "anisotropyRotation": math.radians(degrees)}
        source = {"pbrMetallicRoughness": {"roughnessFactor": 0.5}}
        material = model.add("materials", {**source, "extensions": {"KHR_materials_anisotropy": brushed}})
        more = {} if tangent is None else {"NORMAL": [(0, 0, 1)] * 4, "TANGENT": [tangent] * 4}
        back = {"rotation": [0, 1, 0, 0]} if turned else {}
        model.node(mesh=model.quad(material, **more), scale=[9, 9, 9], **back)
        return float(seen(tmp_path, device, model).mean())

    along, across = shown(90.0, (1, 0, 0, 1)), shown(0.0, (1, 0, 0, 1))
    assert along > 1.5 * across  # it scatters into the plane of the light, which is nearer to y, what it is rough along
    slanting = shown(60.0, (1, 0, 0, 1))
    assert abs(slanting / shown(-60.0, (1, 0, 0, 1)) - 1.0) > 0.2  # the light comes from one side
    for degrees, tangent, turned, expected in (
        (0.0, None, False, across),  # around the y axis
        (0.0, (0, 1, 0, 1), False, along),
        (-30.0, (0, 1, 0, 1), False, slanting),
        (30.0, (0, 1, 0, -1), False, slanting),
        (-60.0, (-1, 0, 0, 1), True, slanting),  # from its back the other way round
    ):
        assert shown(degrees, tangent, turned) == pytest.approx(expected, rel=1e-3), (degrees, tangent)


# --- models of the Khronos Group that say by themselves what is right ------------------------------------------------


def asset(name: str) -> Scene:
    return clrender.load(next((ASSETS / "gltf" / name).glob(f"{name}.gl*")))


def boxes(device: Device, name: str, distance: float, at: list[tuple[int, int]]) -> Colors:
    """Mean colours, of pieces of an image in even light, of 24 x 24 pixels around these."""
    camera = Camera(position=(0.0, 0.0, distance), target=(0.0, 0.0, 0.0), vertical_fov=45.0)
    light = EnvironmentLight(type="environment", radiance=(1.0, 1.0, 1.0))
    scene = asset(name).model_copy(update={"camera": camera, "lights": (light,)})
    image = clrender.render(scene, device=device.info.index, size=(384, 384), spp=16).linear
    return np.array([image[y - 12 : y + 12, x - 12 : x + 12].mean(axis=(0, 1)) for x, y in at], np.float64)


@needs_assets
@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((ASSETS / "gltf").glob("*/*.gl*")), ids=lambda path: path.stem)
def test_all_models_render(device: Device, path: Path) -> None:
    image = clrender.render(clrender.load(path), device=device.info.index, size=(64, 48), spp=4)
    assert image.stats["nonfinite_samples"] == 0 and np.ptp(np.asarray(image.linear)) > 0.0


@needs_assets
@pytest.mark.slow
def test_the_texture_settings_test_passes_but_for_backs(device: Device) -> None:
    """Each row has a test beside a sample that it should look like; the first asks for backs that are not drawn."""
    rows = range(114, 340, 32)
    test, sample = (boxes(device, "TextureSettingsTest", 15.0, [(x, y) for y in rows]) for x in (206, 272))
    np.testing.assert_allclose(test[1:], sample[1:], atol=0.04)
    assert test[0, 0] > test[0, 1] + 0.05 and sample[0, 1] > sample[0, 0] + 0.05  # a red cross, a green tick


@needs_assets
@pytest.mark.slow
def test_the_vertex_color_test_passes(device: Device) -> None:
    """The ticks of the upper row are coloured by vertices, those of the lower by a picture."""
    test, sample = (boxes(device, "VertexColorTest", 4.0, [(x, y) for x in (128, 192, 262)]) for y in (153, 254))
    np.testing.assert_allclose(test, sample, atol=0.04)
    assert (test.argmax(axis=1) == [0, 1, 2]).all()


def looked_at(device: Device, scene: Scene, height: float, size: int = 256, spp: int = 16) -> Colors:
    """The image of a square from the front, `height` high, without perspective, about the origin."""
    camera = Camera(type="orthographic", position=(0.0, 0.0, 50.0), target=(0.0, 0.0, 0.0), height=height)
    scene = scene.model_copy(update={"camera": camera})
    return np.asarray(clrender.render(scene, device=device.info.index, size=(size, size), spp=spp).linear, np.float64)


def middles(scene: Scene) -> Colors:
    """Of all shapes in the world, (S, 3)."""
    flat = flat_surfaces(scene)
    corners = [
        flat.vertices[flat.triangles[a : a + n]].reshape(-1, 3) for a, n in zip(flat.first, flat.count, strict=True)
    ]
    return np.array([(each.min(axis=0) + each.max(axis=0)) / 2.0 for each in corners], np.float64)


def around(image: Colors, place: Colors, height: float, reach: int = 1) -> Colors:
    """Mean colour about a place of the world in an image of `looked_at`."""
    size = len(image)
    column, row = (int(size * (0.5 + sign * x / height)) for sign, x in ((1, place[0]), (-1, place[1])))
    part = image[row - reach : row + reach + 1, column - reach : column + reach + 1]
    return np.asarray(part.mean(axis=(0, 1)))


@needs_assets
@pytest.mark.slow
def test_metal_rough_spheres_in_even_light(device: Device) -> None:
    """Straight on in a radiance of 1 a metal returns its colour, however rough; a plastic also 4 % of the rest."""
    path = ASSETS / "gltf" / "MetalRoughSpheresNoTextures" / "MetalRoughSpheresNoTextures.glb"
    scene = clrender.load(path, environment=1.0)
    places = middles(scene)
    low, high = places.min(axis=0), places.max(axis=0)
    height = 1.2 * float((high - low)[:2].max())
    center = (low + high) / 2.0
    camera = Camera(
        type="orthographic", position=(center[0], center[1], high[2] + height), target=tuple(center), height=height
    )
    lone = scene.model_copy(update={"camera": camera})
    seen_ = {"metal": 0, "plastic": 0}
    for index, shape in enumerate(scene.shapes):
        material = scene.materials[shape.material or ""]
        assert isinstance(material, Principled)
        if not isinstance(material.roughness, float) or not isinstance(material.base_color, tuple):
            continue
        if material.metallic not in (0.0, 1.0) or material.roughness < 0.01 or len(scene.mesh(index).triangles) < 500:
            continue  # half-metals, and letters
        alone = lone.model_copy(update={"shapes": (shape,)})
        image = clrender.render(alone, device=device.info.index, size=(256, 256), spp=64).linear
        found = around(np.asarray(image, np.float64), places[index] - center, height)
        color, metal = np.array(material.base_color), material.metallic == 1.0
        expected, label = color if metal else 0.04 + 0.96 * color, f"{shape.material} {material.roughness}"
        if metal and material.roughness > 0.4:
            # Light meets several of its facets and is coloured by each; what leaves the first is 0.38 of it and more
            assert (found < color + 0.01).all() and (found > 0.38 * color).all(), label
        else:
            np.testing.assert_allclose(found, expected, atol=0.03, err_msg=label)
        seen_["metal" if metal else "plastic"] += 1
    assert min(seen_.values()) >= 8, seen_


@needs_assets
@pytest.mark.slow
def test_the_emissive_strength_test_shines_as_strongly_as_it_says(device: Device) -> None:
    path = ASSETS / "gltf" / "EmissiveStrengthTest" / "EmissiveStrengthTest.glb"
    scene = clrender.load(path, environment=0.0)
    places, height = middles(scene), 20.0
    image = looked_at(device, scene, height)
    strengths = []
    for shape, place in zip(scene.shapes, places, strict=True):
        material = scene.materials[shape.material or ""]
        assert isinstance(material, Principled)
        if material.shines and isinstance(material.emission, tuple):
            found = around(image, place, height, 0)
            np.testing.assert_allclose(
                found, material.emission_strength * np.array(material.emission), rtol=0.05, atol=0.1
            )
            strengths.append(material.emission_strength)
    assert sorted(strengths) == [1.0, 2.0, 4.0, 8.0, 16.0]


@needs_assets
@pytest.mark.slow
def test_the_unlit_test_shows_its_two_colours(device: Device) -> None:
    path = ASSETS / "gltf" / "UnlitTest" / "UnlitTest.glb"
    scene = clrender.load(path)
    image = looked_at(device, scene, 10.0)
    places = middles(scene)
    for shape, place in zip(scene.shapes, places, strict=True):
        color = scene.materials[shape.material or ""].model_dump()["emission"]
        np.testing.assert_allclose(around(image, place, 10.0), color, atol=1e-5)
    assert len(places) == 2


@needs_assets
@pytest.mark.slow
def test_the_normal_tangent_test_reflects_as_its_geometry_does(device: Device, tmp_path: Path) -> None:
    """Sky above, ground below, +x half as bright: each mapped ball shows the quarters that the ball beside it shows."""
    pixels = np.empty((64, 128, 3), np.float32)
    pixels[:32], pixels[32:] = (0.3, 0.5, 1.0), (0.25, 0.2, 0.05)
    pixels[:, :64] *= 0.5
    write_image(tmp_path / "sky.exr", pixels, {})
    path = ASSETS / "gltf" / "NormalTangentTest" / "NormalTangentTest.glb"
    image = looked_at(device, clrender.load(path, environment=tmp_path / "sky.exr"), 4.4, 800, 32)
    for row in (254, 327, 400, 473, 545):
        balls = []
        for column in (516, 574):
            # Further out the mapped balls, which are flat, mirror those that stand beside them
            at = [(row + 6 * down, column + 6 * across) for down in (-1, 1) for across in (-1, 1)]
            balls.append([image[y - 2 : y + 3, x - 2 : x + 3].mean(axis=(0, 1)) for y, x in at])
        geometry, mapped = np.array(balls)
        np.testing.assert_allclose(mapped, geometry, rtol=0.12, atol=0.01)
        assert geometry[0, 2] > 1.5 * geometry[1, 2] and geometry[0, 2] > 3.0 * geometry[2, 2]
