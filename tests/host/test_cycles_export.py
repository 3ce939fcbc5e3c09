"""The exporter to Cycles: the program for Blender, units, conventions and nodes of its scene, and what is left out."""

from __future__ import annotations

import ast
import json
import math
import sys
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from cases import for_each
from export_support import BALL, CAMERA, GREY, QUAD, described, near
from PIL import Image

import clrender
from clrender.cli import main
from clrender.errors import SceneError
from clrender.exporters import exported_to_cycles, write_cycles
from clrender.image.files import read_image


def parsed(program: bytes) -> dict[str, Any]:
    """The description of the scene at the end of a program."""
    last: Any = ast.parse(program).body[-1]
    assert last.value.func.id == "run"
    made: dict[str, Any] = json.loads(ast.literal_eval(last.value.args[0]))
    return made


def exported(folder: Path, **parts: Any) -> tuple[dict[str, Any], tuple[str, ...]]:
    export = exported_to_cycles(described(**parts).placed("test", folder), "files")
    return parsed(export.text), export.notes


def written(folder: Path, **parts: Any) -> dict[str, Any]:
    write_cycles(described(**parts).placed("test", folder), folder / "out.py")
    return parsed((folder / "out.py").read_bytes())


class Nodes:
    """A tree of nodes, followed from its end."""

    def __init__(self, tree: dict[str, Any]) -> None:
        self._nodes = tree["nodes"]
        self.end = tree["Surface"]
        self.volume = tree["Volume"]

    def kind(self, socket: Any) -> str:
        return str(self._nodes[socket[0]][0])

    def attributes(self, socket: Any) -> Any:
        return self._nodes[socket[0]][1]

    def input(self, socket: Any, name: str | int) -> Any:
        """The value of an input, or where it comes from."""
        return next(value for key, value, _ in self._nodes[socket[0]][2] if key == name)


def surface(folder: Path, material: Any, **shape: Any) -> tuple[Nodes, tuple[str, ...]]:
    shapes = [{**QUAD, "material": "m", **shape}]
    found, notes = exported(folder, materials={"m": material}, shapes=shapes)
    (tree,) = found["materials"].values()
    return Nodes(tree), notes


# --- lights


@for_each(
    ("light", "kind", "values", "forward"),
    [
        (
            {"type": "point", "position": [1.0, 2.0, 3.0], "intensity": [4.0, 2.0, 1.0]},
            "POINT", {"energy": 16.0 * math.pi, "color": [1.0, 0.5, 0.25], "shadow_soft_size": 0.0}, [0, -1, 0],
        ),
        (
            {"type": "directional", "direction": [0.0, -2.0, 1.5], "irradiance": [4.0, 2.0, 1.0]},
            "SUN", {"energy": 4.0, "color": [1.0, 0.5, 0.25], "angle": 0.0}, [0.0, -0.8, 0.6],
        ),
        (
            {"type": "spot", "position": [0.0, 1.0, 0.0], "direction": [3.0, 0.0, 0.0], "intensity": [4.0, 2.0, 1.0],
             "cone_degrees": 60.0, "blend": 0.5},
            "SPOT", {"energy": 16.0 * math.pi, "spot_size": math.pi / 3.0, "spot_blend": 0.5}, [1, 0, 0],
        ),
    ],
)  # fmt: skip
def test_lights(tmp_path: Path, light: Any, kind: str, values: dict[str, Any], forward: Any) -> None:
    (found,) = exported(tmp_path, lights=[light])[0]["lights"]
    assert found["kind"] == kind
    matrix = np.array(found["matrix"])
    assert near(-matrix[:3, 2], forward) and near(np.linalg.det(matrix), 1.0)
    assert near(matrix[:3, 3], light.get("position", [0.0, 0.0, 0.0]))
    for name, value in values.items():
        assert near(found["values"][name], value), name


def test_environments_are_turned(tmp_path: Path) -> None:
    """From directions of Blender, whose maps have +x in the middle, and +y a quarter of their width before it."""
    pixels = np.random.default_rng(1).random((4, 8, 3)).astype(np.float32)
    clrender.image.files.write_image(tmp_path / "sky.exr", pixels)
    light = {"type": "environment", "file": "sky.exr", "rotate_degrees": 30.0, "scale": [1.0, 2.0, 3.0]}
    world = Nodes(written(tmp_path, lights=[light])["world"])
    picture = world.input(world.end, "Color")
    assert world.kind(picture) == "TexEnvironment"
    turned = world.input(picture, "Vector")
    assert world.kind(world.input(turned, "Vector")) == "TexCoord"
    # Our middle, +z turned by 30 degrees towards +x, is there at an angle of -90 + 30 degrees from +x
    assert near(world.input(turned, "Rotation"), [0.0, 0.0, math.radians(60.0)])
    assert near(read_image(tmp_path / world.attributes(picture)["image"]), pixels * [1.0, 2.0, 3.0])


@for_each("light", [{"type": "environment", "radiance": [3.0, 2.0, 1.0], "scale": 2.0}, None])
def test_backgrounds(tmp_path: Path, light: Any) -> None:
    world = Nodes(exported(tmp_path, lights=[light] if light else [])[0]["world"])
    color = np.array(world.input(world.end, "Color")) * (world.input(world.end, "Strength") if light else 1.0)
    assert near(color, [6.0, 4.0, 2.0] if light else [0.0, 0.0, 0.0])


def test_what_the_camera_does_not_see(tmp_path: Path) -> None:
    lights = [{"type": "environment", "radiance": [1.0, 1.0, 1.0], "visible_to_camera": False}]
    shapes = [{**QUAD, "material": "m", "visible_to_camera": False}, {**BALL, "material": "m"}]
    shapes += [{**QUAD, "material": "m", "shadow_catcher": True}, {**QUAD, "material": "m"}]
    found, notes = exported(tmp_path, lights=lights, shapes=shapes)
    said = [(each[3]["visible_camera"], each[3]["is_shadow_catcher"]) for each in found["objects"]]
    assert not found["world_visible"] and sorted(said) == [(False, False), (True, False), (True, False), (True, True)]
    assert not any("camera does not see" in note for note in notes)


# --- camera and settings


def test_a_camera_with_a_lens(tmp_path: Path) -> None:
    camera = {**CAMERA, "vertical_fov": 40.0, "aperture_radius": 0.1, "focus_distance": 2.5}
    found = exported(tmp_path, camera=camera, image={"width": 40, "height": 20})[0]["camera"]
    values, matrix = found["values"], np.array(found["matrix"])
    lens = 12.0 / math.tan(math.radians(20.0))
    assert (values["sensor_fit"], values["sensor_height"]) == ("VERTICAL", 24.0) and near(values["lens"], lens)
    assert near(values["dof.aperture_fstop"], 1e-3 * lens / 0.2) and values["dof.focus_distance"] == 2.5
    assert near(matrix[:3, 3], CAMERA["position"])
    assert near(-matrix[:3, 2], -np.array(CAMERA["position"]) / np.linalg.norm(CAMERA["position"]))
    assert matrix[1, 1] > 0.9


def test_a_camera_that_blender_has_not(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="camera is of type fisheye, which Blender has not"):
        exported(tmp_path, camera={**CAMERA, "type": "fisheye"})


@for_each(
    ("render", "values", "words"),
    [
        (
            {"max_depth": 13, "roulette": "none", "spp": 9},
            {"max_bounces": 12, "min_light_bounces": 1024, "samples": 9},
            "",
        ),
        ({"integrator": "direct"}, {"max_bounces": 0, "min_light_bounces": 0}, ""),
        ({"max_depth": 3000}, {"max_bounces": 1024}, "scattering events beyond 1024"),
        ({"filter": "box"}, {"pixel_filter_type": "BOX", "filter_width": 1.0}, ""),
        ({"filter": "gaussian", "filter_radius": 1.5}, {"pixel_filter_type": "GAUSSIAN", "filter_width": 6.0}, ""),
        ({"filter": "mitchell"}, {"pixel_filter_type": "GAUSSIAN"}, "pixel filter mitchell"),
    ],
)
def test_settings(tmp_path: Path, render: Any, values: dict[str, Any], words: str) -> None:
    found, notes = exported(tmp_path, render=render)
    for name, value in values.items():
        assert found["settings"][f"cycles.{name}"] == value, name
    assert any(words in note for note in notes) == bool(words)


# --- shapes


def test_meshes_are_arrays(tmp_path: Path) -> None:
    shapes = [{**QUAD, "material": "m", "flip_normals": True}, {**BALL, "material": "m"}]
    found = written(tmp_path, shapes=shapes)
    quad, ball = (np.load(tmp_path / found["meshes"][each[1]][0]) for each in found["objects"])
    a, b, c = quad["points"][quad["triangles"][0]].astype(np.float64)
    front = np.cross(QUAD["edge_u"], QUAD["edge_v"])
    assert np.dot(np.cross(b - a, c - a), front) < 0.0 and "normals" not in quad
    assert near(np.linalg.norm(ball["points"] - BALL["center"], axis=1), 1.0) and "normals" in ball
    assert "uvs" not in quad, "without a texture"


def test_instances_share_a_mesh(tmp_path: Path) -> None:
    groups = {"g": {"shapes": [{**QUAD, "material": "m"}]}}
    places = [{"translate": [x, 0.0, 0.0]} for x in (1.0, 2.0)] + [{"scale": [-1.0, 1.0, 1.0]}]
    shapes = [{"type": "instance", "group": "g", "transform": each} for each in places]
    found, _ = exported(tmp_path, groups=groups, shapes=shapes)
    matrices = [np.array(matrix) for _, _, matrix, _ in found["objects"]]
    assert sorted(matrix[0, 3] for matrix in matrices) == [0.0, 1.0, 2.0]
    assert all(np.linalg.det(matrix) > 0.0 for matrix in matrices), "what is mirrored has a mesh of its own"
    assert len(found["meshes"]) == 2


@for_each(
    ("matrix", "material", "shared"),
    [
        ([[2, 0, 0], [0, 2, 0], [0, 0, 2]], {}, True),
        ([[1, 0, 0], [0, 2, 0], [0, 0, 3]], {}, True),
        ([[1, 0, 0], [0, 2, 0], [0, 0, 3]], {"normal_map": {"texture": "a.png"}}, False),
        ([[1, 0.8, 0], [0, 1, 0.3], [0, 0, 1]], {}, False),
    ],
)
def test_instances_that_blender_has_not_are_written_out(
    tmp_path: Path, matrix: Any, material: dict[str, Any], shared: bool
) -> None:
    Image.new("RGB", (2, 2), (128, 128, 255)).save(tmp_path / "a.png")
    place = [[*row, 0.0] for row in matrix] + [[0, 0, 0, 1]]
    shapes = [{"type": "instance", "group": "g", "transform": {"matrix": place}}]
    groups = {"g": {"shapes": [{**QUAD, "material": "m"}]}}
    found = written(tmp_path, materials={"m": {**GREY, **material}}, groups=groups, shapes=shapes)
    ((_, mesh, whole, _),) = found["objects"]
    assert near(whole, place if shared else np.eye(4))
    points = np.load(tmp_path / found["meshes"][mesh][0])["points"] @ np.array(whole)[:3, :3].T
    assert near(points[0], [0, 0, 0]) and near(points[1], np.array(matrix) @ QUAD["edge_u"])


def test_normals_are_on_the_front(tmp_path: Path) -> None:
    """A mesh whose vertex normals are against its triangles, as many files have them."""
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0.6 -0.8\nf 1//1 2//1 3//1\n")
    found = written(tmp_path, shapes=[{"type": "mesh", "file": "m.obj", "material": "m"}])
    mesh = np.load(tmp_path / found["meshes"][found["objects"][0][1]][0])
    assert near(mesh["normals"], np.broadcast_to([0.0, -0.6, 0.8], (1, 3, 3)))


def test_names_of_many_objects_take_no_time_to_find(tmp_path: Path) -> None:
    """Each kind has its own."""
    places = [{"translate": [float(x), 0.0, 0.0]} for x in range(3)]
    shapes = [{"type": "instance", "group": "g", "transform": each} for each in places]
    found, _ = exported(tmp_path, groups={"g": {"shapes": [{**QUAD, "material": "m"}]}}, shapes=shapes)
    assert [each[0] for each in found["objects"]] == ["m", "m.2", "m.3"]
    assert list(found["meshes"]) == list(found["materials"]) == ["m"]


# --- materials


@for_each(
    ("material", "kind", "inputs", "attributes"),
    [
        (GREY, "BsdfDiffuse", {"Color": [0.5, 0.5, 0.5], "Roughness": 0.0}, {}),
        ({"type": "mirror", "reflectance": [0.9, 0.8, 0.7]}, "BsdfAnisotropic",
         {"Color": [0.9, 0.8, 0.7], "Roughness": 0.0}, {}),
        ({"type": "oren_nayar", "reflectance": [0.5, 0.4, 0.3], "roughness": 0.7}, "BsdfPrincipled",
         {"Base Color": [0.5, 0.4, 0.3], "Diffuse Roughness": 0.7, "IOR": 1.0}, {}),
        ({"type": "conductor", "eta": [0.2, 0.9, 1.1], "k": [3.0, 2.4, 2.0], "roughness": 0.3}, "BsdfMetallic",
         {"IOR": [0.2, 0.9, 1.1], "Extinction": [3.0, 2.4, 2.0], "Roughness": 0.3},
         {"fresnel_type": "PHYSICAL_CONDUCTOR", "distribution": "MULTI_GGX"}),
        ({"type": "conductor", "f0": [0.9, 0.6, 0.3], "multiple_scattering": False}, "BsdfMetallic",
         {"Base Color": [0.9, 0.6, 0.3], "Edge Tint": [1.0, 1.0, 1.0]}, {"fresnel_type": "F82", "distribution": "GGX"}),
        ({"type": "principled", "base_color": [0.5, 0.4, 0.3], "specular": 0.5, "coat": 0.25}, "BsdfPrincipled",
         {"Base Color": [0.5, 0.4, 0.3], "Specular IOR Level": 0.25, "IOR": 1.5, "Coat Weight": 0.25}, {}),
        ({"type": "principled", "specular": 0.0}, "BsdfPrincipled", {"IOR": 1.0}, {}),
    ],
)  # fmt: skip
def test_materials(
    tmp_path: Path, material: Any, kind: str, inputs: dict[str, Any], attributes: dict[str, Any]
) -> None:
    nodes, _ = surface(tmp_path, material)
    assert nodes.kind(nodes.end) == kind and nodes.volume is None
    for name, value in inputs.items():
        assert near(nodes.input(nodes.end, name), value), name
    assert attributes.items() <= nodes.attributes(nodes.end).items()


def test_glass_absorbs(tmp_path: Path) -> None:
    glass = {"type": "dielectric", "ior": 1.5, "exterior_ior": 1.2, "attenuation_color": [0.5, 0.25, 1.0],
             "attenuation_distance": 2.0}  # fmt: skip
    found, _ = exported(tmp_path, materials={"m": glass}, shapes=[{**BALL, "material": "m"}])
    nodes = Nodes(next(iter(found["materials"].values())))
    assert nodes.kind(nodes.end) == "BsdfGlass" and near(nodes.input(nodes.end, "IOR"), 1.25)
    assert nodes.kind(nodes.volume) == "VolumeAbsorption"
    density, color = nodes.input(nodes.volume, "Density"), np.array(nodes.input(nodes.volume, "Color"))
    assert near(density * (1.0 - color), [math.log(2.0) / 2.0, math.log(4.0) / 2.0, 0.0])


def test_subsurface_without_an_index_lets_light_in_as_if_diffuse(tmp_path: Path) -> None:
    wax = {"type": "subsurface", "albedo": [0.9, 0.5, 0.2], "radius": [0.01, 0.02, 0.04], "g": 0.3}
    found, notes = exported(tmp_path, materials={"m": wax}, shapes=[{**BALL, "material": "m"}])
    nodes = Nodes(next(iter(found["materials"].values())))
    assert nodes.kind(nodes.end) == "BsdfTranslucent" and nodes.kind(nodes.volume) == "AddShader"
    lost, turned = (nodes.input(nodes.volume, i) for i in (0, 1))
    assert nodes.kind(lost) == "VolumeAbsorption" and nodes.kind(turned) == "VolumeScatter"
    absorption = nodes.input(lost, "Density") * (1.0 - np.array(nodes.input(lost, "Color")))
    scattering = nodes.input(turned, "Density") * np.array(nodes.input(turned, "Color"))
    assert near(absorption + scattering, [100.0, 50.0, 25.0]) and nodes.input(turned, "Anisotropy") == 0.3
    assert all("roundness" in note for note in notes)


def test_fog_and_what_has_only_an_inside(tmp_path: Path) -> None:
    media = {"smoke": {"scattering": [1.0, 2.0, 4.0]}}
    found, _ = exported(tmp_path, media=media, fog="smoke", shapes=[{**BALL, "interior": "smoke"}])
    trees = Nodes(found["world"]), Nodes(next(iter(found["materials"].values())))
    for tree in trees:
        assert tree.kind(tree.volume) == "VolumeScatter" and tree.input(tree.volume, "Density") == 4.0
    assert trees[1].kind(trees[1].end) == "BsdfTransparent"


def test_lamps_shine_on_one_side(tmp_path: Path) -> None:
    found, _ = exported(tmp_path, shapes=[{**QUAD, "emission": [3.0, 2.0, 1.0]}])
    (tree,) = found["materials"].values()
    nodes = Nodes(tree)
    assert tree["front_shines"] and nodes.kind(nodes.end) == "Emission"
    assert near(nodes.input(nodes.end, "Color"), [3.0, 2.0, 1.0])
    strength = nodes.input(nodes.end, "Strength")
    assert nodes.attributes(strength) == {"operation": "SUBTRACT"} and nodes.input(strength, 0) == 1.0
    assert nodes.kind(nodes.input(strength, 1)) == "NewGeometry"


@for_each(
    ("changes", "order"),
    [
        ({"opacity": 0.25}, ["BsdfTransparent", "BsdfDiffuse"]),
        ({"two_sided": False}, ["BsdfDiffuse", "BsdfDiffuse"]),
        ({"opacity": 0.25, "two_sided": False}, ["BsdfTransparent", "MixShader"]),
    ],
)
def test_holes_and_black_backs(tmp_path: Path, changes: dict[str, Any], order: list[str]) -> None:
    nodes, _ = surface(tmp_path, {**GREY, **changes})
    assert nodes.kind(nodes.end) == "MixShader"
    assert [nodes.kind(nodes.input(nodes.end, i)) for i in (1, 2)] == order
    amount = nodes.input(nodes.end, 0)
    assert amount == 0.25 if "opacity" in changes else nodes.kind(amount) == "NewGeometry"


def test_parts_of_a_mixture_have_black_backs(tmp_path: Path) -> None:
    parts = {"a": {**GREY, "two_sided": False}, "b": {"type": "mirror"}, "m": {"type": "mix", "materials": ["a", "b"]}}
    found, _ = exported(tmp_path, materials=parts, shapes=[{**QUAD, "material": "m"}])
    nodes = Nodes(next(iter(found["materials"].values())))
    first, second = (nodes.input(nodes.end, i) for i in (1, 2))
    assert (nodes.kind(first), nodes.kind(second)) == ("MixShader", "BsdfAnisotropic")
    assert near(nodes.input(nodes.input(first, 2), "Color"), [0.0, 0.0, 0.0])


def test_a_cutoff_is_after_the_interpolation(picture: Path) -> None:
    leaf = {**GREY, "opacity": {"texture": "a.png"}, "opacity_cutoff": 0.4}
    nodes, notes = surface(picture, leaf)
    present = nodes.input(nodes.end, 0)
    assert nodes.attributes(present) == {"operation": "SUBTRACT"} and nodes.input(present, 0) == 1.0
    below = nodes.input(present, 1)
    assert nodes.attributes(below) == {"operation": "LESS_THAN"} and nodes.input(below, 1) == 0.4
    assert nodes.kind(nodes.input(below, 0)) == "TexImage" and notes == ()


@for_each(
    ("changes", "kinds"),
    [
        ({"transmission": 1.0}, ["BsdfPrincipled"]),
        ({"transmission": 0.25}, ["MixShader", "BsdfPrincipled", "BsdfPrincipled"]),
        ({"transmission": 1.0, "metallic": 0.5}, ["MixShader", "BsdfPrincipled", "BsdfPrincipled"]),
    ],
)
def test_what_passes_principled_has_its_colour(tmp_path: Path, changes: dict[str, float], kinds: list[str]) -> None:
    """Of which Cycles takes the root."""
    material = {"type": "principled", "base_color": [0.5, 0.25, 1.0], **changes}
    found, _ = exported(tmp_path, materials={"m": material}, shapes=[{**BALL, "material": "m"}])
    nodes = Nodes(next(iter(found["materials"].values())))
    parts = [nodes.input(nodes.end, i) for i in (1, 2)] if len(kinds) > 1 else []
    assert [nodes.kind(each) for each in (nodes.end, *parts)] == kinds
    glass = {"transmission": 1, "metallic": 0}["metallic" if "metallic" in changes else "transmission"]
    passes = parts[glass] if parts else nodes.end
    assert near(nodes.input(passes, "Base Color"), [0.25, 0.0625, 1.0])
    assert nodes.input(passes, "Transmission Weight") == 1.0
    if parts:
        assert near(nodes.input(parts[1 - glass], "Base Color"), [0.5, 0.25, 1.0])


def test_an_index_of_one_is_nothing(tmp_path: Path) -> None:
    nodes, _ = surface(tmp_path, {"type": "dielectric", "ior": 1.3, "exterior_ior": 1.3})
    assert nodes.kind(nodes.end) == "BsdfTransparent"


def test_an_inside_that_shines(tmp_path: Path) -> None:
    media = {"smoke": {"scattering": [1.0, 2.0, 4.0]}}
    shapes = [{**BALL, "interior": "smoke", "emission": [1.0, 1.0, 1.0]}]
    nodes = Nodes(next(iter(exported(tmp_path, media=media, shapes=shapes)[0]["materials"].values())))
    assert nodes.kind(nodes.end) == "AddShader"
    assert [nodes.kind(nodes.input(nodes.end, i)) for i in (0, 1)] == ["BsdfTransparent", "Emission"]


def test_sheets_let_light_through(tmp_path: Path) -> None:
    sheet = {"type": "principled", "base_color": [0.8, 0.6, 0.4], "diffuse_transmission": 0.25,
             "diffuse_transmission_color": [0.5, 1.0, 0.1]}  # fmt: skip
    nodes, notes = surface(tmp_path, sheet)
    kept, passed = (nodes.input(nodes.end, i) for i in (0, 1))
    assert near(nodes.input(kept, "Color"), [0.6, 0.45, 0.3])
    assert nodes.kind(passed) == "BsdfTranslucent" and near(nodes.input(passed, "Color"), [0.125, 0.25, 0.025])
    assert any("gloss and metal of sheets" in note for note in notes)


# --- textures


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    Image.fromarray(np.full((2, 2, 3), 188, np.uint8)).save(tmp_path / "a.png")
    return tmp_path


def test_pictures_are_linear_and_placed(picture: Path) -> None:
    """v of Blender's pictures is 0 at their lower edge, as here."""
    place = {"scale": [2.0, 3.0], "rotate_degrees": 30.0, "offset": [0.1, 0.2]}
    texture = {"texture": "a.png", "transform": place, "wrap": "mirror", "filter": "nearest"}
    found = written(picture, materials={"m": {**GREY, "reflectance": texture}}, shapes=[{**QUAD, "material": "m"}])
    nodes = Nodes(next(iter(found["materials"].values())))
    image = nodes.input(nodes.end, "Color")
    attributes = nodes.attributes(image)
    assert (attributes["interpolation"], attributes["extension"]) == ("Closest", "MIRROR")
    assert near(read_image(picture / attributes["image"]), ((188 / 255 + 0.055) / 1.055) ** 2.4, 1e-5)
    mapping = nodes.input(image, "Vector")
    assert near(nodes.input(mapping, "Scale"), [2.0, 3.0, 1.0]) and near(
        nodes.input(mapping, "Location"), [0.1, 0.2, 0]
    )
    assert near(nodes.input(mapping, "Rotation"), [0.0, 0.0, math.radians(30.0)])
    mesh = np.load(picture / found["meshes"][found["objects"][0][1]][0])
    assert mesh["uvs"].shape == (2, 3, 2)


def test_any_affine_map_of_a_texture(picture: Path) -> None:
    """A rotation of squares of unequal sides is no rotation, scale and offset in this order."""
    checker = {"checker": [[0.1] * 3, [0.4] * 3], "size": [0.5, 0.25], "transform": {"rotate_degrees": 30.0}}
    nodes, notes = surface(picture, {**GREY, "reflectance": checker})
    uv = nodes.input(nodes.input(nodes.end, "Color"), "Vector")
    rows = [nodes.input(nodes.input(nodes.input(uv, axis), 0), 1) for axis in "XY"]
    sine, cosine = 0.5, math.sqrt(0.75)
    assert near(rows, [[2.0 * cosine, -2.0 * sine, 0.0], [4.0 * sine, 4.0 * cosine, 0.0]]) and notes == ()


def test_a_shifted_lens(tmp_path: Path) -> None:
    """In units of the image's height."""
    image = {"width": 40, "height": 20}
    values = exported(tmp_path, camera={**CAMERA, "lens_shift": [0.25, 0.1]}, image=image)[0]["camera"]["values"]
    assert near([values["shift_x"], values["shift_y"]], [0.5, 0.1])


def test_a_wide_camera_has_a_large_sensor(tmp_path: Path) -> None:
    """Blender has no lens below a millimetre."""
    values = exported(tmp_path, camera={**CAMERA, "vertical_fov": 175.0})[0]["camera"]["values"]
    assert near(values["lens"], 1.0) and near(values["sensor_height"], 2.0 * math.tan(math.radians(87.5)))


def test_checkers_and_normal_maps(picture: Path) -> None:
    checker = {"checker": [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], "size": 0.5}
    nodes, notes = surface(picture, {**GREY, "reflectance": checker, "normal_map": {"texture": "a.png", "scale": 0.5}})
    squares = nodes.input(nodes.end, "Color")
    assert nodes.kind(squares) == "TexChecker"
    assert near(nodes.input(squares, "Color2"), [0.1, 0.2, 0.3]) and near(
        nodes.input(squares, "Color1"), [0.4, 0.5, 0.6]
    )
    assert near(nodes.input(nodes.input(squares, "Vector"), "Scale"), [2.0, 2.0, 1.0])
    assert nodes.kind(nodes.input(nodes.end, "Normal")) == "NormalMap"
    assert any("balance of normal maps" in note for note in notes)


# --- what is left out


@for_each(
    ("parts", "words"),
    [
        ({"shapes": [{**BALL, "material": "m"}]}, "the roundness of spheres"),
        ({"materials": {"m": {"type": "dielectric", "ior": 1.5, "priority": 1}}, "shapes": [{**BALL, "material": "m"}]},
         "priorities, where closed shapes overlap"),
        ({"materials": {"m": {"type": "conductor", "metal": "Au", "anisotropy": 0.5}},
          "shapes": [{**QUAD, "material": "m"}]}, "anisotropy"),
        ({"materials": {"m": {"type": "dielectric", "ior": 1.5}},
          "shapes": [{**BALL, "material": "m"}, {**BALL, "radius": 0.1, "emission": [1.0, 1.0, 1.0]}]},
         "so that lamps in glass are brighter"),
        ({"camera": {**CAMERA, "mirrored": True}}, "the mirroring of the image"),
        ({"materials": {"m": {"type": "principled", "sheen_color": [0.1, 0.1, 0.1]}},
          "shapes": [{**QUAD, "material": "m"}]}, "the balance of sheen"),
        ({"materials": {"m": {"type": "conductor", "metal": "Au", "iridescence": 1.0}},
          "shapes": [{**QUAD, "material": "m"}]}, "thin films"),
        ({"media": {"a": {"absorption": [1.0] * 3}}, "fog": "a", "shapes": [{**BALL, "interior": "a"}]},
         "that the innermost medium counts"),
        ({"media": {"a": {"absorption": [1.0] * 3}},
          "shapes": [{**BALL, "interior": "a"}, {**BALL, "radius": 0.5, "interior": "a"}]},
         "that the innermost medium counts"),
        ({"lights": [{"type": "spot", "position": [0.0, 1.0, 0.0], "direction": [0.0, -1.0, 0.0],
                      "intensity": [1.0] * 3, "cone_degrees": 0.5}]}, "cones below 1 degree"),
        ({"render": {"max_depth": 0}}, "that surfaces reflect nothing"),
    ],
)  # fmt: skip
def test_what_is_left_out_is_named_and_with_strict_refused(tmp_path: Path, parts: Any, words: str) -> None:
    _, notes = exported(tmp_path, **parts)
    assert any(words in note for note in notes), notes
    with pytest.raises(SceneError, match=f"Cycles cannot express all of it: .*{words}"):
        write_cycles(described(**parts).placed("test", tmp_path), tmp_path / "out.py", strict=True)
    assert not list(tmp_path.iterdir())


def test_media_beside_each_other_are_nothing_to_note(tmp_path: Path) -> None:
    media = {"a": {"absorption": [1.0] * 3}}
    boxes = [{"type": "box", "center": [x, 0.0, 0.0], "size": [1.0] * 3, "interior": "a"} for x in (0.0, 1.0, 3.0)]
    assert exported(tmp_path, media=media, shapes=boxes)[1] == ()
    _, notes = exported(tmp_path, media=media, shapes=[*boxes, {**boxes[0], "center": [2.6, 0.0, 0.0]}])
    assert [note.endswith("(shapes[3])") for note in notes] == [True]


def test_a_simple_scene_has_nothing_to_note(tmp_path: Path) -> None:
    materials = {"m": GREY, "glass": {"type": "dielectric", "ior": 1.5, "roughness": 0.0}}
    box = {"type": "box", "center": [0.0, 0.0, 0.0], "size": [1.0, 1.0, 1.0], "material": "glass"}
    lights = [{"type": "point", "position": [1.0, 2.0, 3.0], "intensity": [3.0, 2.0, 1.0]}]
    _, notes = exported(tmp_path, materials=materials, shapes=[box, {**QUAD, "material": "m"}], lights=lights)
    assert notes == ()


# --- the program


def test_the_program_builds_what_it_describes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With something that takes every call in the place of Blender."""
    bpy, mathutils = MagicMock(), MagicMock()
    monkeypatch.setitem(sys.modules, "bpy", bpy)
    monkeypatch.setitem(sys.modules, "mathutils", mathutils)
    write_cycles(clrender.load("textures"), tmp_path / "out.py")
    program = (tmp_path / "out.py").read_text(encoding="utf-8")
    exec(compile(program, "out.py", "exec"), {"__file__": str(tmp_path / "out.py"), "__name__": "out"})
    found, data = parsed(program.encode()), bpy.data
    assert data.materials.new.call_count == len(found["materials"]) == 5
    assert data.meshes.new.call_count == len(found["meshes"]) == 5
    assert data.objects.new.call_count == len(found["objects"]) + 1, "with the camera"
    loaded = {Path(call.args[0]) for call in data.images.load.call_args_list}
    assert loaded == {path for path in (tmp_path / "out-files").iterdir() if path.suffix != ".npz"}
    assert bpy.context.scene.render.engine == "CYCLES"


def test_the_command_converts_to_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["convert", "cornell", str(tmp_path / "a.py")], standalone_mode=False)
    assert capsys.readouterr().out.endswith(f"files in {tmp_path / 'a-files'}\n")
    found = parsed((tmp_path / "a.py").read_bytes())
    assert all((tmp_path / file).exists() for file, _ in found["meshes"].values())
