"""The exporter to LuxCore: units, conventions and names of its properties, its meshes, and what is left out."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from export_support import BALL, CAMERA, GREY, MIRRORED_MAPS, QUAD, described, near, texels
from PIL import Image

import clrender
from clrender.cli import main
from clrender.errors import SceneError, UsageError
from clrender.exporters import exported_to_luxcore, write_luxcore
from clrender.exporters.triangles import sphere_mesh
from clrender.image.files import read_image
from clrender.meshes.read import read_mesh
from clrender.scene import Sphere

SENSOR = {"wavelengths": [400.0, 700.0], "red": [0.1, 1.0], "green": [1.0, 1.0], "blue": [1.0, 0.1]}


def parsed(text: bytes) -> dict[str, Any]:
    """Properties by name: a string, or a list of numbers."""
    made: dict[str, Any] = {}
    for line in text.decode("utf-8").splitlines():
        name, value = line.split(" = ")
        assert name not in made, name
        made[name] = value[1:-1] if value.startswith('"') else [float(word) for word in value.split()]
    return made


def exported(folder: Path, **parts: Any) -> tuple[dict[str, Any], tuple[str, ...]]:
    export = exported_to_luxcore(described(**parts).placed("test", folder), "files")
    return parsed(export.text), export.notes


def written(folder: Path, **parts: Any) -> dict[str, Any]:
    write_luxcore(described(**parts).placed("test", folder), folder / "out.scn")
    return parsed((folder / "out.scn").read_bytes())


def mesh(folder: Path, properties: dict[str, Any], name: str) -> Any:
    return read_mesh(properties[f"scene.shapes.{name}.ply"], folder, [], "test")


def normal(one: Any, triangle: int = 0) -> Any:
    a, b, c = one.vertices[one.triangles[triangle]].astype(np.float64)
    return np.cross(b - a, c - a)


# --- lights


@for_each(
    ("light", "expected"),
    [
        (
            {"type": "point", "position": [1.0, 2.0, 3.0], "intensity": [3.0, 2.0, 1.0]},
            {"position": [1, 2, 3], "color": [3, 2, 1], "gain": [4.0 * math.pi] * 3},
        ),
        (
            {"type": "directional", "direction": [0.0, -2.0, 1.0], "irradiance": [3.0, 2.0, 1.0]},
            {"direction": [0, -2, 1], "color": [3, 2, 1], "gain": [1, 1, 1]},
        ),
        (
            {"type": "spot", "position": [0.0, 1.0, 0.0], "direction": [0.0, -3.0, 0.0], "intensity": [3.0, 2.0, 1.0],
             "cone_degrees": 60.0, "blend": 0.5},
            {"target": [0, 0, 0], "coneangle": 30.0, "color": [3, 2, 1],
             "conedeltaangle": 30.0 - math.degrees(math.acos(0.5 + 0.5 * math.cos(math.pi / 6.0)))},
        ),
        (
            {"type": "environment", "radiance": [3.0, 2.0, 1.0], "scale": 2.0},
            {"color": [6, 4, 2], "gain": [1, 1, 1]},
        ),
    ],
)  # fmt: skip
def test_lights(tmp_path: Path, light: Any, expected: dict[str, Any]) -> None:
    found, _ = exported(tmp_path, lights=[light])
    kind = next(value for name, value in found.items() if name.startswith("scene.lights.") and name.endswith(".type"))
    for key, value in {"power": 0.0, "efficency": 0.0, **expected}.items():
        assert near(found[f"scene.lights.{kind}.{key}"], value), key


def test_environments_are_turned(tmp_path: Path) -> None:
    """The middle of LuxCore's maps is at -x, and their upper edge at +z."""
    pixels = np.random.default_rng(1).random((4, 8, 3)).astype(np.float32)
    clrender.image.files.write_image(tmp_path / "sky.exr", pixels)
    light = {"type": "environment", "file": "sky.exr", "rotate_degrees": 90.0, "scale": [1.0, 2.0, 3.0]}
    found = written(tmp_path, lights=[light])
    matrix = np.reshape(found["scene.lights.infinite.transformation"], (4, 4)).T
    assert near(matrix @ [-1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]), "+z, turned towards +x"
    assert near(matrix @ [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0])
    assert near(matrix @ [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]), "+x, turned towards -z"
    assert near(found["scene.lights.infinite.gain"], [1, 2, 3])
    assert np.array_equal(read_image(tmp_path / found["scene.lights.infinite.file"]), pixels)


# --- camera and settings


def test_the_window_of_the_camera_is_one_pixel_lower(tmp_path: Path) -> None:
    camera = {**CAMERA, "vertical_fov": 40.0, "aperture_radius": 0.1, "focus_distance": 2.5}
    found, notes = exported(tmp_path, camera=camera, image={"width": 40, "height": 20})
    assert near(found["scene.camera.screenwindow"], [-2.0, 2.0, -1.1, 0.9]) and notes == ()
    for key, value in {"fieldofview": 40.0, "lensradius": 0.1, "focaldistance": 2.5}.items():
        assert found[f"scene.camera.{key}"] == [value]
    mirrored, _ = exported(tmp_path, camera={**CAMERA, "mirrored": True}, image={"width": 20, "height": 20})
    assert near(mirrored["scene.camera.screenwindow"], [1.0, -1.0, -1.1, 0.9])
    parallel = {**CAMERA, "type": "orthographic", "height": 3.0}
    found, _ = exported(tmp_path, camera=parallel, image={"width": 40, "height": 20})
    assert near(found["scene.camera.screenwindow"], [-3.0, 3.0, -1.65, 1.35])
    shifted, _ = exported(tmp_path, camera={**CAMERA, "lens_shift": [0.25, 0.1]}, image={"width": 40, "height": 20})
    assert near(shifted["scene.camera.screenwindow"], [-1.0, 3.0, -0.9, 1.1])
    with pytest.raises(SceneError, match="camera is of type fisheye, which LuxCore has not"):
        exported(tmp_path, camera={**CAMERA, "type": "fisheye", "vertical_fov": 180.0})


def test_settings(tmp_path: Path) -> None:
    render = {"max_depth": 7, "roulette": "none", "spp": 5, "filter": "box"}
    found, notes = exported(tmp_path, render=render, image={"width": 40, "height": 20})
    assert found["film.width"] == [40] and found["film.filter.type"] == "NONE" and notes == ()
    assert found["path.pathdepth.total"] == found["path.pathdepth.specular"] == [7]
    assert found["batch.haltspp"] == [5] and found["path.russianroulette.depth"] == [10**6]
    found, notes = exported(tmp_path, render={"filter": "tent"})
    assert found["path.pathdepth.total"] == [1000] and "path.russianroulette.depth" not in found
    assert "tent" in notes[0] and found["film.filter.type"] == "GAUSSIAN"


# --- shapes


def test_meshes_are_in_world_space_with_the_front_in_front(tmp_path: Path) -> None:
    shapes = [
        {**QUAD, "name": "plain", "material": "m"},
        {**QUAD, "name": "flipped", "flip_normals": True, "material": "m"},
        {**QUAD, "name": "mirrored", "transform": {"scale": [-1.0, 1.0, 1.0]}, "material": "m"},
    ]
    found = written(tmp_path, shapes=shapes)
    plain, flipped, mirrored = (mesh(tmp_path, found, f"mesh-{each['name']}") for each in shapes)
    up = np.cross(QUAD["edge_u"], QUAD["edge_v"])
    assert near(normal(plain), up) and near(normal(flipped), -up)
    assert near(normal(mirrored), up * [-1.0, 1.0, 1.0])
    assert near(mirrored.vertices[1], [-1.0, 0.0, 0.0])
    assert found["scene.objects.plain.material"] == "m"


def test_spheres_are_meshes_with_normals_and_coordinates() -> None:
    one = sphere_mesh(Sphere(type="sphere", center=(1.0, 2.0, 3.0), radius=2.0))
    assert one.normals is not None and one.uvs is not None
    assert near(one.vertices, np.array([1.0, 2.0, 3.0]) + 2.0 * one.normals)
    middle = one.vertices[one.triangles].mean(axis=1) - [1.0, 2.0, 3.0]
    a, b, c = (one.vertices[one.triangles[:, i]] for i in range(3))
    assert ((np.cross(b - a, c - a) * middle).sum(axis=1) > 0.0).all()
    assert 0.999 < np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 / (16.0 * math.pi) < 1.0
    # u is 0 at -z and grows to the right seen from outside, v grows from -y to +y
    u, v = one.uvs.reshape(-1, 2).astype(np.float64).T
    x, y, z = one.normals[one.triangles].reshape(-1, 3).T
    assert near(y, -np.cos(math.pi * v)) and near(x, -np.sin(math.pi * v) * np.sin(2.0 * math.pi * u))
    assert near(z, -np.sin(math.pi * v) * np.cos(2.0 * math.pi * u))


def test_instances(tmp_path: Path) -> None:
    """They share a mesh; those that mirror have meshes of their own, as LuxCore would show their backs."""
    group = {"g": {"shapes": [{**QUAD, "name": "q", "material": "m", "emission": [1.0, 2.0, 3.0]}]}}
    places = [{"translate": [1.0, 2.0, 3.0]}, {"translate": [4.0, 0.0, 0.0]}, {"scale": [-1.0, 1.0, 1.0]}]
    found = written(
        tmp_path, groups=group, shapes=[{"type": "instance", "group": "g", "transform": each} for each in places]
    )
    placed = [name for name in found if name.endswith(".transformation")]
    assert len(placed) == 2 and near(found[placed[0]][12:], [1.0, 2.0, 3.0, 1.0])
    objects = {value for name, value in found.items() if name.startswith("scene.objects.") and name.endswith(".shape")}
    assert len(objects) == 2
    turned = mesh(tmp_path, found, "mesh-q")
    assert near(normal(turned), np.cross(QUAD["edge_u"], QUAD["edge_v"]) * [-1.0, 1.0, 1.0])


def test_names_have_neither_dots_nor_blanks(tmp_path: Path) -> None:
    shapes = [{**QUAD, "name": "a b.c", "material": "x.y"}, {**QUAD, "name": "abc", "material": "xy"}]
    found, _ = exported(tmp_path, materials={"x.y": GREY, "xy": GREY}, shapes=shapes)
    assert {found["scene.objects.abc.material"], found["scene.objects.abc-2.material"]} == {"xy", "xy-2"}


# --- materials


METAL: dict[str, Any] = {"type": "conductor", "eta": [0.2, 0.4, 1.4], "k": [4.0, 2.4, 1.6], "roughness": 0.5}


@for_each(
    ("material", "expected"),
    [
        (GREY, {"type": "matte", "kd": [0.5] * 3}),
        ({"type": "mirror", "reflectance": [0.9] * 3}, {"type": "mirror", "kr": [0.9] * 3}),
        (METAL, {"type": "metal2", "fresnel": "fresnel", "uroughness": [0.25], "vroughness": [0.25]}),
        (
            {"type": "dielectric", "ior": 1.5, "exterior_ior": 1.2},
            {"type": "glass", "interiorior": [1.5], "exteriorior": [1.2], "volume.interior": "empty"},
        ),
        ({"type": "dielectric", "ior": 1.5, "roughness": 0.5}, {"type": "roughglass", "uroughness": [0.25]}),
        ({"type": "dielectric", "ior": 1.5, "thin": True}, {"type": "archglass", "kt": [1.0] * 3}),
        (
            {"type": "principled", "base_color": [0.2, 0.3, 0.4], "roughness": 0.5, "specular": 0.5},
            {"type": "glossy2", "kd": [0.2, 0.3, 0.4], "ks": [0.5] * 3, "index": [1.5], "uroughness": [0.25]},
        ),
        (
            {"type": "principled", "metallic": 0.25},
            {"type": "mix", "material1": "m-part", "material2": "m-part-2", "amount": [0.25]},
        ),
        ({"type": "principled", "coat": 0.5}, {"type": "glossycoating", "base": "m-base", "ks": [0.5] * 3}),
        (
            {"type": "principled", "base_color": [0.5] * 3, "thin": True, "diffuse_transmission": 0.4},
            {"type": "mattetranslucent", "kr": [0.3] * 3, "kt": [0.4 / 0.7] * 3},
        ),
        ({**GREY, "opacity": 0.25}, {"type": "matte", "transparency": [0.25]}),
        ({**GREY, "two_sided": False}, {"type": "twosided", "frontmaterial": "m", "backmaterial": "back"}),
    ],
)  # fmt: skip
def test_materials(tmp_path: Path, material: Any, expected: dict[str, Any]) -> None:
    found, _ = exported(tmp_path, materials={"m": material}, shapes=[{**QUAD, "name": "q", "material": "m"}])
    name = found["scene.objects.q.material"]
    for key, value in expected.items():
        each = found[f"scene.materials.{name}.{key}"]
        assert each == value if isinstance(value, str) else near(each, value), key


def test_shapes_of_one_material_share_it_but_for_emission_and_medium(tmp_path: Path) -> None:
    glass = {"type": "dielectric", "ior": 1.5}
    shapes = [
        {**QUAD, "name": "a", "material": "m"},
        {**QUAD, "name": "b", "material": "m"},
        {**QUAD, "name": "lamp", "material": "m", "emission": [1.0, 2.0, 3.0]},
        {**BALL, "name": "ball", "material": "g", "interior": "milk"},
        {**BALL, "name": "cloud", "interior": "milk"},
    ]
    media = {"milk": {"scattering": [1.0, 2.0, 3.0], "absorption": 0.5, "g": 0.25}}
    found, notes = exported(tmp_path, materials={"m": GREY, "g": glass}, media=media, shapes=shapes, fog="milk")
    names = {each: found[f"scene.objects.{each}.material"] for each in ("a", "b", "lamp", "ball", "cloud")}
    assert names["a"] == names["b"] != names["lamp"]
    assert near(found[f"scene.materials.{names['lamp']}.emission"], [1, 2, 3])
    assert found[f"scene.materials.{names['cloud']}.type"] == "null"
    volume = found["scene.world.volume.default"]
    for each in ("ball", "cloud"):
        assert found[f"scene.materials.{names[each]}.volume.interior"] == volume
    for key, value in {"scattering": [1, 2, 3], "absorption": [0.5] * 3, "asymmetry": [0.25] * 3}.items():
        assert near(found[f"scene.volumes.{volume}.{key}"], value), key
    assert any("scatters in glass" in note for note in notes)


def test_priorities_are_those_of_volumes(tmp_path: Path) -> None:
    water = {"type": "dielectric", "ior": 1.33, "priority": 3}
    water |= {"attenuation_color": [0.25] * 3, "attenuation_distance": 2.0}
    found, _ = exported(tmp_path, materials={"m": water}, shapes=[{**BALL, "name": "b", "material": "m"}])
    name = found["scene.objects.b.material"]
    assert f"scene.materials.{name}.interiorior" not in found
    volume = found[f"scene.materials.{name}.volume.interior"]
    assert found[f"scene.volumes.{volume}.ior"] == [1.33] and found[f"scene.volumes.{volume}.priority"] == [3]
    assert near(found[f"scene.volumes.{volume}.absorption"], [math.log(4.0) / 2.0] * 3)


# --- textures


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (4, 6, 3), np.uint8)).save(tmp_path / "a.png")
    return tmp_path


def textured(
    folder: Path, texture: Any, key: str = "reflectance", **more: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    """All properties, and those of the only texture."""
    found = written(folder, materials={"m": {**GREY, key: texture, **more}}, shapes=[{**QUAD, "material": "m"}])
    start = "scene.textures.picture."
    return found, {name.removeprefix(start): value for name, value in found.items() if name.startswith(start)}


def test_pictures(picture: Path) -> None:
    """LuxCore does not know sRGB; v of its pictures is 0 at their upper edge, and it turns clockwise."""
    transform = {"scale": [2.0, 3.0], "rotate_degrees": 30.0, "offset": [0.25, 0.5]}
    found, one = textured(picture, {"texture": "a.png", "transform": transform})
    assert found["scene.materials.m.kd"] == "picture" and one["gamma"] == [1.0] and one["file"].endswith(".exr")
    expected = (np.asarray(Image.open(picture / "a.png")) / 255.0) ** 2.2
    assert near(read_image(picture / one["file"]), expected, 0.02)
    assert near(one["mapping.uvscale"], [2.0, -3.0]) and near(one["mapping.uvdelta"], [0.25, 0.5])
    assert near(one["mapping.rotation"], [30.0])
    linear = {"texture": "a.png", "color_space": "linear", "filter": "nearest", "wrap": "clamp"}
    _, one = textured(picture, linear)
    assert (picture / one["file"]).read_bytes() == (picture / "a.png").read_bytes()
    assert (one["wrap"], one["filter"]) == ("clamp", "nearest")


def test_maps(picture: Path) -> None:
    found, _ = textured(picture, {"texture": "a.png"}, "normal_map")
    assert found["scene.materials.m.bumptex"] == "normals" and found["scene.textures.normals.texture"] == "picture"
    found, one = textured(picture, {"texture": "a.png", "scale": 0.5}, "bump_map")
    grey = np.asarray(Image.open(picture / "a.png"))[..., :1] / 255.0
    assert found["scene.materials.m.bumptex"] == "picture" and near(read_image(picture / one["file"]), 0.5 * grey)


@for_each(("shape", "turned"), MIRRORED_MAPS)
def test_green_of_normal_maps_is_where_luxcore_looks_for_it(picture: Path, shape: dict[str, Any], turned: bool) -> None:
    material = {**GREY, "normal_map": {"texture": "a.png"}}
    found = written(picture, materials={"m": material}, shapes=[{**shape, "material": "m"}])
    pixels = texels(picture / found["scene.textures.picture.file"])
    expected = np.array(texels(picture / "a.png"))
    expected[..., 1] = 1.0 - expected[..., 1] if turned else expected[..., 1]
    assert near(pixels, expected)


# --- what is left out


@for_each(
    ("words", "parts"),
    [
        ("the lamps of IES files", {}),
        ("the roundness of spheres", {"shapes": [BALL]}),
        ("the roundness of disks", {"shapes": [{"type": "disk", "normal": [0.0, 1.0, 0.0], "radius": 1.0}]}),
        ("oren_nayar", {"materials": {"m": {"type": "oren_nayar", "reflectance": [0.5] * 3}}}),
        ("sheen", {"materials": {"m": {"type": "principled", "sheen_color": [1.0] * 3}}}),
        (
            "most of the light that thin glass emits",
            {
                "materials": {"m": {"type": "dielectric", "ior": 1.5, "thin": True}},
                "shapes": [{**QUAD, "material": "m", "emission": [1.0] * 3}],
            },
        ),
        ("grazing angles", {"materials": {"m": METAL}}),
        ("thin films", {"materials": {"m": {**METAL, "iridescence": 1.0}}}),
        ("the exposure", {"camera": {**CAMERA, "f_stop": 8.0, "shutter": 0.01}}),
        ("the colours of the sensor", {"camera": {**CAMERA, "response": SENSOR}}),
        ("the integrator photon", {"render": {"integrator": "photon"}}),
        ("scattering events beyond 1000", {"render": {"max_depth": 1001}}),
        ("the balance of normal maps", {"materials": {"m": {**GREY, "normal_map": {"texture": "a.png"}}}}),
        ("the radius of the pixel filter", {"render": {"filter": "mitchell", "filter_radius": 1.0}}),
        ("the camera does not see it", {"shapes": [{**QUAD, "visible_to_camera": False}]}),
        ("it catches shadows", {"shapes": [{**QUAD, "shadow_catcher": True}]}),
        (
            "the mirroring of textures",
            {"materials": {"m": {**GREY, "reflectance": {"texture": "a.png", "wrap": "mirror"}}}},
        ),
    ],
)
def test_what_is_left_out_is_named(picture: Path, words: str, parts: dict[str, Any]) -> None:
    if not parts:
        export = exported_to_luxcore(clrender.load("lamps"), "files")
        assert any(words in note for note in export.notes)
        return
    scene = described(**{"shapes": [{**QUAD, "material": "m"}], **parts}).placed("test", picture)
    notes = exported_to_luxcore(scene, "files").notes
    assert sum(words in note for note in notes) == 1
    with pytest.raises(SceneError, match=f"LuxCore cannot express all of it: .*{words}"):
        write_luxcore(scene, picture / "out.scn", strict=True)
    assert not (picture / "out.scn").exists()


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "room.scn"
    main(["convert", "room", str(output)], standalone_mode=False)
    assert "note: left out: the roundness of spheres" in capsys.readouterr().err
    first = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    main(["convert", "room", str(output), "--force"], standalone_mode=False)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == first
    for name, value in parsed(output.read_bytes()).items():
        assert not name.endswith((".ply", ".file")) or (tmp_path / value).is_file()
    with pytest.raises(UsageError, match=r"'\.blend' is not that of a scene file; name a \.toml, \.json, \.xml"):
        main(["convert", "room", str(tmp_path / "room.blend")], standalone_mode=False)
