"""USD stages: what becomes of meshes, instances, materials and curves."""

from __future__ import annotations

import math
import random
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from usd_files import BOUND, QUAD, Load, load_stage, mesh, refusal, shape_of, surface, textured

import clrender
from clrender.flatten.bounds import scene_bounds
from clrender.flatten.flat_scene import flatten
from clrender.image.files import write_image
from clrender.importers.usd.places import Places
from clrender.importers.usd.process import Stage
from clrender.scene import Scene

pytest.importorskip("pxr", reason="usd-core is not installed")
__all__ = ["load_stage"]  # the fixture

VERTEX_ST = '\ntexCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")'


def arrays_of(scene: Scene) -> dict[str, Any]:
    """All numbers that the kernels read of a scene."""
    flat = flatten(scene, 16, 12)
    return {name: each for name, each in vars(flat).items() if isinstance(each, np.ndarray)}


def assert_same_rows(first: Scene, second: Scene) -> None:
    found, wanted = arrays_of(first), arrays_of(second)
    assert found.keys() == wanted.keys()
    for name, each in wanted.items():
        np.testing.assert_array_equal(found[name], each, err_msg=name)


def material_of(scene: Scene, name: str) -> Any:
    """One of its materials."""
    return scene.materials[name]


def own(**described: Any) -> Scene:
    """A scene of our own format."""
    return Scene.model_validate(described)


# --- meshes ----------------------------------------------------------------------------------------------------------


def test_a_stage_is_the_same_scene_as_in_our_own_format(load_stage: Load) -> None:
    scene = load_stage(
        surface("color3f inputs:diffuseColor = (0.5, 0.25, 0.125)\nfloat inputs:roughness = 0.75")
        + mesh(BOUND)
        + """
def RectLight "lamp"
{
    float inputs:intensity = 3
    float inputs:width = 2
    float inputs:height = 1
    double3 xformOp:translate = (0, 4, 2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DomeLight "sky" { color3f inputs:color = (0.5, 1, 1) }
def Camera "c"
{
    float horizontalAperture = 40
    float verticalAperture = 30
    float focalLength = 15
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
    )
    wanted = own(
        camera={"position": [0, 0, 5], "target": [0, 0, 4], "vertical_fov": 90.0},
        image={"width": 800, "height": 600},
        materials={"M": {"type": "principled", "base_color": [0.5, 0.25, 0.125], "roughness": 0.75}},
        shapes=[
            {
                "type": "mesh",
                "material": "M",
                "vertices": [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]],
                "faces": [[0, 1, 2], [0, 2, 3]],
            },
            {
                "type": "quad",
                "origin": [1, 3.5, 2],
                "edge_u": [-2, 0, 0],
                "edge_v": [0, 1, 0],
                "emission": [3, 3, 3],
                "visible_to_camera": False,
            },
        ],
        lights=[{"type": "environment", "radiance": [0.5, 1, 1]}],
    )
    assert_same_rows(scene, wanted)
    assert scene.camera.vertical_fov == pytest.approx(90.0, abs=1e-12)
    assert (scene.image.width, scene.image.height) == (800, 600)
    assert scene.notes == ()


@for_each(
    ("interpolation", "values", "wanted"),
    [
        ("vertex", "(0, 0), (1, 0), (1, 1), (0, 1), (5, 5), (6, 6)", [[0, 0], [1, 0], [1, 1]]),
        ("varying", "(0, 0), (1, 0), (1, 1), (0, 1), (5, 5), (6, 6)", [[0, 0], [1, 0], [1, 1]]),
        ("constant", "(3, 4)", [[3, 4], [3, 4], [3, 4]]),
        ("uniform", "(3, 4), (7, 8)", [[3, 4], [3, 4], [3, 4]]),
        ("faceVarying", "(0, 0), (2, 0), (2, 2), (0, 2), (9, 0), (9, 1), (9, 2)", [[0, 0], [2, 0], [2, 2]]),
    ],
)
def test_texture_coordinates_of_all_interpolations(
    load_stage: Load, interpolation: str, values: str, wanted: list[list[float]], tmp_path: Path
) -> None:
    write_image(tmp_path / "a.png", np.zeros((2, 2, 3), np.float32))
    st = f'texCoord2f[] primvars:st = [{values}] (interpolation = "{interpolation}")'
    points = f"{QUAD}, (3, 0, 0), (3, 1, 0)"
    text = mesh(f"{BOUND}\n{st}", counts=(4, 3), indices=(0, 1, 2, 3, 1, 4, 5), points=points)
    data = load_stage(textured() + text).mesh(0)
    assert data.uvs is not None
    np.testing.assert_array_equal(data.triangles, [[0, 1, 2], [0, 2, 3], [1, 4, 5]])
    np.testing.assert_array_equal(data.uvs[0], wanted)
    last = {"vertex": [1, 0], "varying": [1, 0], "constant": [3, 4], "uniform": [7, 8], "faceVarying": [9, 0]}
    np.testing.assert_array_equal(data.uvs[2][0], last[interpolation])


def test_holes_orientation_and_normals(load_stage: Load) -> None:
    points = f"{QUAD}, (3, 0, 0), (3, 1, 0)"
    normals = 'normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 1, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)] (\
        interpolation = "faceVarying")'
    more = f'uniform token orientation = "leftHanded"\n{normals}'
    data = load_stage(mesh(more, counts=(4, 3), indices=(0, 1, 2, 3, 1, 4, 5), points=points)).mesh(0)
    corners = data.vertices[data.triangles]
    np.testing.assert_array_equal(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] < 0, True
    )
    assert data.normals is not None
    np.testing.assert_array_equal(data.normals[data.triangles][1], [[0, 1, 0], [0, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(data.normals[data.triangles][2], [[1, 0, 0]] * 3)
    assert len(data.vertices) == 4 + 3  # of the shared points two have two normals
    holed = mesh("int[] holeIndices = [0]", counts=(4, 3), indices=(0, 1, 2, 3, 1, 4, 5), points=points)
    assert len(load_stage(holed).mesh(0).triangles) == 1


def test_faces_of_subsets_have_their_materials(load_stage: Load) -> None:
    subset = """
    rel material:binding = </M>
    def GeomSubset "s" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </N>
    }
    """
    text = mesh(subset, counts=(4, 3), indices=(0, 1, 2, 3, 1, 4, 5), points=f"{QUAD}, (3, 0, 0), (3, 1, 0)")
    other = surface("float inputs:metallic = 1").replace("/M", "/N").replace('"M"', '"N"')
    scene = load_stage(surface("float inputs:metallic = 0") + other + text)
    assert [each.material for each in scene.shapes] == ["M", "N"]
    assert [len(scene.mesh(number).triangles) for number in range(2)] == [2, 1]


def test_what_has_no_material_has_its_display_color(load_stage: Load) -> None:
    one = load_stage(mesh("color3f[] primvars:displayColor = [(0.5, 0.25, 1)]"))
    assert material_of(one, "no material").base_color == (0.5, 0.25, 1.0)
    colors = "(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)"
    each = load_stage(mesh(f'color3f[] primvars:displayColor = [{colors}] (interpolation = "vertex")'))
    found = each.mesh(0).colors
    assert found is not None
    np.testing.assert_array_equal(found[0], np.eye(3))
    assert material_of(load_stage(mesh()), "no material").base_color == (0.18, 0.18, 0.18)
    inherited = load_stage(f'def Xform "x" {{\ncolor3f[] primvars:displayColor = [(0, 1, 0)]\n{mesh()}\n}}')
    assert material_of(inherited, "no material").base_color == (0.0, 1.0, 0.0)


def test_cages_are_drawn_smooth_and_it_is_said(load_stage: Load) -> None:
    scene = load_stage(mesh(scheme="catmullClark"))
    assert scene.mesh(0).normals is not None
    assert "cages" in scene.notes[0]
    assert load_stage(mesh()).mesh(0).normals is None


def test_subsets_do_not_crease_what_is_smooth(load_stage: Load) -> None:
    """Two faces that meet at a right angle: normals at their edge are those of the whole mesh."""
    points = f"{QUAD}, (2, 0, 1), (2, 1, 1)"
    subset = """
    rel material:binding = </M>
    def GeomSubset "s" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </N>
    }
    """
    more: dict[str, Any] = {
        "counts": (4, 4),
        "indices": (0, 1, 2, 3, 1, 4, 5, 2),
        "points": points,
        "scheme": "catmullClark",
    }
    other = surface("").replace("/M", "/N").replace('"M"', '"N"')
    whole = load_stage(mesh(**more)).mesh(0)
    parted = load_stage(surface("") + other + mesh(subset, **more))
    assert whole.normals is not None and len(parted.shapes) == 2
    for number, faces in enumerate((slice(0, 2), slice(2, 4))):
        part = parted.mesh(number)
        assert part.normals is not None
        np.testing.assert_array_equal(part.normals[part.triangles], whole.normals[whole.triangles[faces]])


@for_each(
    ("more", "text"),
    [
        ({"indices": (0, 1, 2)}, "has 3 faceVertexIndices"),
        ({"indices": (0, 1, 2, 9)}, "1 face has points that there are not"),
        ({"points": "(0, 0, 0), (nan, 0, 0), (2, 1, 0), (0, 1, 0)"}, "or that are not finite"),
        ({"points": "(0, 0, 0), (1e13, 0, 0), (2, 1, 0), (0, 1, 0)"}, "beyond 1e+12"),
    ],
)
def test_damaged_meshes_are_left_out(load_stage: Load, more: dict[str, Any], text: str) -> None:
    scene = load_stage(mesh(name="sound") + mesh(**more))
    assert [each.name for each in scene.shapes] == ["/sound"]
    assert any(text in note and "left out" in note for note in scene.notes), scene.notes
    assert text in refusal(lambda: load_stage(mesh(name="sound") + mesh(**more), strict=True))
    assert text in refusal(lambda: load_stage(mesh(**more)))


# --- places ----------------------------------------------------------------------------------------------------------

_OPS = {
    "translate": "double3",
    "scale": "float3",
    "rotateX": "float",
    "rotateY": "float",
    "rotateZ": "float",
    **{f"rotate{order}": "float3" for order in ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")},
    "orient": "quatf",
    "transform": "matrix4d",
}


def _op(rng: random.Random, kind: str) -> str:
    if kind == "transform":
        rows = [[rng.uniform(-2, 2) for _ in range(3)] + [0.0] for _ in range(3)]
        rows.append([rng.uniform(-5, 5) for _ in range(3)] + [1.0])
        return "(" + ", ".join("(" + ", ".join(map(repr, row)) + ")" for row in rows) + ")"
    if kind == "orient":
        parts = [rng.gauss(0, 1) for _ in range(4)]
        size = math.sqrt(sum(x * x for x in parts))
        return "(" + ", ".join(repr(x / size) for x in parts) + ")"
    count = 3 if _OPS[kind].endswith("3") else 1
    span = 200.0 if kind.startswith("rotate") else 3.0
    numbers = [rng.uniform(-span, span) or 1.0 for _ in range(count)]
    return repr(numbers[0]) if count == 1 else "(" + ", ".join(map(repr, numbers)) + ")"


def test_transform_operations_are_those_of_the_library(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    from clrender.importers.usd.extraction import extracted

    rng = random.Random(3)
    text = ""
    for depth in range(24):
        chosen = rng.sample(sorted(_OPS), 4)
        lines = [f"{_OPS[kind]} xformOp:{kind} = {_op(rng, kind)}" for kind in chosen]
        order = [f"xformOp:{kind}" for kind in chosen]
        if depth % 3 == 0:
            order.append(f"!invert!xformOp:{chosen[0]}")
        resets = ["!resetXformStack!"] if depth % 7 == 6 else []
        tokens = ", ".join(f'"{each}"' for each in [*resets, *order])
        body = "\n".join([*lines, f"uniform token[] xformOpOrder = [{tokens}]"])
        text += f'def Sphere "s{depth}"\n{{\n{body}\n' if depth % 4 == 0 else f'def Sphere "s"\n{{\n{body}\n'
        text += "" if depth % 4 < 3 else "}\n" * 4
    path = tmp_path / "ops.usda"
    path.write_text(f"#usda 1.0\n{text}")
    tables = extracted({"source": "a", "path": str(path), "allowed": [], "time_at": None, "offsets": []}, [])
    places = Places(Stage(tables, {}))
    stage = Usd.Stage.Open(str(path))
    cache = UsdGeom.XformCache()
    assert len(tables["lists"][""]) == 24
    for item in tables["lists"][""]:
        wanted = np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(item["path"]))).T
        found = places.chain(item["node"])
        np.testing.assert_allclose(found, wanted, rtol=0, atol=2e-6 * np.abs(wanted).max())


@for_each(("head", "point"), [('metersPerUnit = 0.01\nupAxis = "Z"', (2, 3, -1)), ("metersPerUnit = 0.01", (2, 1, 3))])
def test_units_and_upward_axis(load_stage: Load, head: str, point: tuple[float, ...]) -> None:
    text = 'def Sphere "s"\n{\ndouble3 xformOp:translate = (200, 100, 300)\ndouble radius = 50\n'
    scene = load_stage(f'{text}uniform token[] xformOpOrder = ["xformOp:translate"]\n}}', head=head)
    low, high = scene_bounds(scene)
    np.testing.assert_allclose((low + high) / 2, point, atol=1e-6)
    np.testing.assert_allclose(high - low, 1.0, atol=1e-6)


def test_instances_of_references_and_of_points(load_stage: Load, tmp_path: Path) -> None:
    (tmp_path / "part.usda").write_text(f'#usda 1.0\n(defaultPrim = "p")\ndef Xform "p"\n{{\n{mesh()}\n}}')
    copies = "".join(
        f'def "i{number}" (instanceable = true\nprepend references = @part.usda@)\n{{\n'
        f"double3 xformOp:translate = ({number}, 0, 0)\n"
        'uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
        for number in range(3)
    )
    points = f"""
def PointInstancer "points"
{{
    rel prototypes = [</points/a>, </points/b>]
    int[] protoIndices = [0, 1, 0, 0]
    point3f[] positions = [(10, 0, 0), (11, 0, 0), (12, 0, 0), (13, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (0, 0, 1, 0), (1, 0, 0, 0)]
    float3[] scales = [(1, 1, 1), (2, 2, 2), (1, 1, 3), (1, 1, 1)]
    int64[] invisibleIds = [3]
    {mesh(name="a")}
    def Sphere "b" {{}}
}}
"""
    scene = load_stage(copies + points)
    found = [(each.type, np.array(each.transform.matrix)) for each in scene.shapes]
    assert [each for each, _ in found] == ["mesh"] * 3 + ["mesh", "mesh", "sphere"]
    wanted = np.eye(4)
    for number in (1, 2):
        wanted[0, 3] = number
        np.testing.assert_array_equal(found[number][1], wanted)
    np.testing.assert_array_equal(found[4][1], [[-1, 0, 0, 12], [0, 1, 0, 0], [0, 0, -3, 0], [0, 0, 0, 1]])
    np.testing.assert_array_equal(found[5][1], [[2, 0, 0, 11], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]])


def test_many_points_are_instances_of_a_group(load_stage: Load) -> None:
    count = 400
    grid = ", ".join(f"({x}, 0, 0)" for x in range(count))
    solid = """
    def Capsule "c" { }
"""
    text = f"""
def PointInstancer "points"
{{
    rel prototypes = [</points/c>]
    int[] protoIndices = {[0] * count}
    point3f[] positions = [{grid}]
    {solid}
}}
"""
    scene = load_stage(text)
    assert [each.type for each in scene.shapes] == ["instance"]
    assert scene_bounds(scene)[1][0] >= count - 1


def test_what_is_hidden_or_for_other_purposes_is_not_drawn(load_stage: Load) -> None:
    hidden = f'def Xform "h" {{\ntoken visibility = "invisible"\n{mesh(name="a")}\n}}'
    proxy = mesh('uniform token purpose = "proxy"', name="b")
    render = mesh('uniform token purpose = "render"', name="c")
    off = mesh(name="d").replace("prepend", "active = false\nprepend")
    scene = load_stage(hidden + proxy + render + off + f'class "k" {{\n{mesh(name="e")}\n}}')
    assert [each.name for each in scene.shapes] == ["/c"]


@for_each(
    ("solid", "size"),
    [
        ('Cube "s" { double size = 3 }', (3, 3, 3)),
        ('Sphere "s" { double radius = 2 }', (4, 4, 4)),
        ('Cylinder "s" { double radius = 1\n double height = 5\n token axis = "X" }', (5, 2, 2)),
        ('Cone "s" { double radius = 1\n double height = 5\n token axis = "Y" }', (2, 5, 2)),
        ('Capsule "s" { double radius = 1\n double height = 5\n token axis = "Z" }', (2, 2, 7)),
        ('Plane "s" { double width = 3\n double length = 5\n token axis = "Z" }', (3, 5, 0)),
        ('Plane "s" { double width = 3\n double length = 5\n token axis = "X" }', (0, 5, 3)),
        ('Plane "s" { double width = 3\n double length = 5\n token axis = "Y" }', (3, 0, 5)),
    ],
)
def test_solids(load_stage: Load, solid: str, size: tuple[float, ...]) -> None:
    scene = load_stage(f"def {solid}")
    low, high = scene_bounds(scene)
    np.testing.assert_allclose(high - low, size, atol=2e-3)
    assert not flatten(scene, 8, 8).warnings
    data = scene.mesh(0) if shape_of(scene, 0).type == "mesh" else None
    if data is not None and data.normals is not None:
        corners = data.vertices[data.triangles]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.sum(facing * data.normals[data.triangles].mean(axis=1), axis=1) > 0).all()
        assert (np.sum(facing * corners.mean(axis=1), axis=1) > 0).all()  # outward


# --- materials -------------------------------------------------------------------------------------------------------


def _made(load_stage: Load, text: str, key: str = "M") -> dict[str, Any]:
    return load_stage(text + mesh(f"{BOUND}\n{VERTEX_ST}")).materials[key].model_dump()


def test_the_inputs_of_a_preview_surface(load_stage: Load) -> None:
    made = _made(
        load_stage,
        surface(
            "color3f inputs:diffuseColor = (0.1, 0.2, 0.3)\nfloat inputs:metallic = 0.5\n"
            "float inputs:roughness = 0.25\nfloat inputs:ior = 1.3\nfloat inputs:clearcoat = 0.75\n"
            "float inputs:clearcoatRoughness = 0.1\n"
            "color3f inputs:emissiveColor = (2, 0, 0)"
        ),
    )
    wanted = {"metallic": 0.5, "roughness": 0.25, "ior": 1.3, "coat": 0.75}
    assert {key: made[key] for key in wanted} == pytest.approx(wanted)
    assert made["base_color"] == pytest.approx((0.1, 0.2, 0.3))
    assert made["emission"] == (2.0, 0.0, 0.0)
    assert made["coat_roughness"] == pytest.approx(0.1)


def test_the_specular_workflow_has_the_reflectance_that_is_asked_for(load_stage: Load) -> None:
    made = _made(
        load_stage, surface("int inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor = (0.25, 0.125, 0)")
    )
    root = (made["ior"] - 1) / (made["ior"] + 1)
    np.testing.assert_allclose(root * root * np.array(made["specular_color"]), [0.25, 0.125, 0.0], atol=1e-12)
    assert made["metallic"] == 0.0


def test_a_translucent_surface_is_a_thin_sheet_as_far_as_it_is(load_stage: Load) -> None:
    text = surface("float inputs:opacity = 0.25\nfloat inputs:ior = 1.4") + mesh(BOUND)
    scene = load_stage(text)
    mixed = scene.materials["M"].model_dump()
    assert (mixed["type"], mixed["weight"]) == ("mix", 0.25)
    sheet, opaque = (scene.materials[each].model_dump() for each in mixed["materials"])
    assert (sheet["type"], sheet["thin"], opaque["type"]) == ("dielectric", True, "principled")
    assert sheet["ior"] == pytest.approx(1.4)
    presence = _made(load_stage, surface('float inputs:opacity = 0.25\ntoken inputs:opacityMode = "presence"'))
    assert (presence["type"], presence["opacity"]) == ("principled", 0.25)
    cut = _made(load_stage, surface("float inputs:opacity = 0.25\nfloat inputs:opacityThreshold = 0.5"))
    assert cut["opacity"] == 0.0


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A picture of four colours, of 8 bits."""
    from PIL import Image

    pixels = np.array([[[0, 64, 128], [255, 10, 20]], [[30, 40, 50], [60, 70, 80]]], np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    Image.fromarray(pixels[..., 0]).save(tmp_path / "grey.png")
    return tmp_path / "a.png"


def test_textures_of_colors_and_numbers(load_stage: Load, picture: Path) -> None:
    more = 'token inputs:wrapS = "mirror"\ntoken inputs:wrapT = "clamp"\nfloat4 inputs:scale = (0.5, 1, 1, 1)'
    made = _made(load_stage, textured(more))["base_color"]
    assert (made["texture"], made["color_space"], made["wrap"]) == ("a.png", "srgb", ("mirror", "clamp"))
    assert made["scale"] == (0.5, 1.0, 1.0)
    made = _made(load_stage, textured(output="g", wanted="float inputs:roughness"))["roughness"]
    assert (made["channel"], made["color_space"]) == ("g", "srgb")  # auto, of three channels of 8 bits
    raw = 'token inputs:sourceColorSpace = "raw"'
    made = _made(load_stage, textured(raw, "g", "float inputs:roughness"))["roughness"]
    assert (made["channel"], made["color_space"]) == ("g", "linear")
    grey = textured(output="r", wanted="float inputs:roughness").replace("a.png", "grey.png")
    assert _made(load_stage, grey)["roughness"]["color_space"] == "linear"


def test_a_transform_of_coordinates_and_a_second_set(load_stage: Load, picture: Path) -> None:
    text = textured().replace("</M/R.outputs:result>", "</M/X.outputs:result>", 1)
    node = """
    def Shader "X"
    {
        uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </M/R.outputs:result>
        float inputs:rotation = 30
        float2 inputs:scale = (2, 3)
        float2 inputs:translation = (0.25, 0.5)
        float2 outputs:result
    }
    """
    made = _made(load_stage, text.replace('def Shader "R"', f'{node}\ndef Shader "R"'))["base_color"]
    assert made["transform"] == {"offset": (0.25, 0.5), "rotate_degrees": 30.0, "scale": (2.0, 3.0)}
    second = """
    def Shader "T2"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @a.png@
        float2 inputs:st.connect = </M/R2.outputs:result>
        float3 outputs:rgb
    }
    def Shader "R2"
    {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "other"
        float2 outputs:result
    }
    """
    both = textured().replace('def Shader "T"', f'{second}\ndef Shader "T"')
    both = both.replace("token outputs:surface\n", "color3f inputs:emissiveColor.connect = </M/T2.outputs:rgb>\n", 1)
    both = both.replace('"UsdPreviewSurface"\n', '"UsdPreviewSurface"\ntoken outputs:surface\n', 1)
    other = 'texCoord2f[] primvars:other = [(5, 5)] (interpolation = "constant")'
    scene = load_stage(both + mesh(f"{BOUND}\n{other}\n{VERTEX_ST}"))
    assert scene.materials["M"].model_dump()["emission"]["uv_set"] == 1
    data = scene.mesh(0)
    assert data.uvs is not None
    assert data.uvs_1 is not None
    np.testing.assert_array_equal(data.uvs[0], [[0, 0], [1, 0], [1, 1]])
    np.testing.assert_array_equal(data.uvs_1[0], [[5, 5]] * 3)


def test_a_bias_makes_another_picture(load_stage: Load, picture: Path) -> None:
    raw = 'token inputs:sourceColorSpace = "raw"'
    inverted = f"float4 inputs:scale = (-1, -1, -1, 1)\nfloat4 inputs:bias = (1, 1, 1, 0)\n{raw}"
    scene = load_stage(textured(inverted, "g", "float inputs:roughness") + mesh(f"{BOUND}\n{VERTEX_ST}"))
    store = scene.textures()
    made = scene.materials["M"].model_dump()["roughness"]
    assert made["texture"].startswith("a.png (times")
    values = {each for each in np.asarray(store.texels).view(np.float16).tolist()[0] if 0 < each < 1}
    assert {round(1 - 64 / 255, 3), round(1 - 10 / 255, 3)} <= {round(each, 3) for each in values}


def test_maps_of_normals(load_stage: Load, picture: Path) -> None:
    usual = "float4 inputs:scale = (2, 2, 2, 1)\nfloat4 inputs:bias = (-1, -1, -1, 0)"
    made = _made(load_stage, textured(usual, wanted="normal3f inputs:normal"))["normal_map"]
    assert (made["texture"], made["scale"]) == ("a.png", 1.0)
    flipped = "float4 inputs:scale = (2, -2, 2, 1)\nfloat4 inputs:bias = (-1, 1, -1, 0)"
    made = _made(load_stage, textured(flipped, wanted="normal3f inputs:normal"))["normal_map"]
    assert made["texture"].startswith("a.png (times")


def test_other_surfaces_are_grey_and_it_is_said(load_stage: Load) -> None:
    text = surface("").replace("UsdPreviewSurface", "ND_standard_surface_surfaceshader")
    scene = load_stage(text + mesh(BOUND))
    assert shape_of(scene, 0).material == "no material"
    assert "ND_standard_surface" in scene.notes[0]


def test_a_package_has_its_pictures_inside(load_stage: Load, picture: Path, tmp_path: Path) -> None:
    from pxr import UsdUtils

    (tmp_path / "in.usda").write_text(f"#usda 1.0\n(metersPerUnit = 1)\n{textured()}{mesh(BOUND + VERTEX_ST)}")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "in.usda"), str(tmp_path / "a.usdz"))
    picture.unlink()
    scene = clrender.load(tmp_path / "a.usdz")
    name = scene.materials["M"].model_dump()["base_color"]["texture"]
    assert name.startswith("a.usdz[")
    (found,) = {each.width for each in scene.textures().pictures.values()}
    assert found == 2
    with zipfile.ZipFile(tmp_path / "a.usdz") as package:
        assert len(package.namelist()) == 2


# --- curves ----------------------------------------------------------------------------------------------------------


@for_each(
    ("more", "basis", "rows"),
    [
        ('uniform token type = "linear"', "linear", 5),
        ('uniform token basis = "bspline"', "bspline", 5),
        ('uniform token basis = "bspline"\nuniform token wrap = "pinned"', "bspline", 7),
        ('uniform token basis = "bspline"\nuniform token wrap = "periodic"', "bspline", 8),
        ('uniform token basis = "catmullRom"', "bezier", 7),
        ('uniform token basis = "catmullRom"\nuniform token wrap = "pinned"', "bezier", 13),
        ('uniform token basis = "bezier"', "bezier", 4),
    ],
)
def test_curves(load_stage: Load, more: str, basis: str, rows: int) -> None:
    text = f"""
def BasisCurves "c"
{{
    int[] curveVertexCounts = [5]
    point3f[] points = [(0, 0, 0), (0, 1, 0), (0, 2, 0), (0, 3, 0), (1, 4, 0)]
    float[] widths = [0.5] (interpolation = "constant")
    {more}
}}
"""
    scene = load_stage(text, head="metersPerUnit = 0.1")
    shape = shape_of(scene, 0)
    assert (shape.type, shape.basis) == ("curves", basis)
    ((at, curves),) = scene.curve_files()
    data = scene.strands(at, curves)
    assert len(data.rows) == rows
    np.testing.assert_allclose(data.rows[:, 3], 0.025)
    if basis == "bezier" and rows == 7:  # through the second and the third point
        np.testing.assert_allclose(data.rows[[0, 3, 6], 1], [0.1, 0.2, 0.3])
