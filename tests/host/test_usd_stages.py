"""USD stages: what becomes of lights, cameras and times, and which files are refused."""

from __future__ import annotations

import math
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from usd_files import BOUND, QUAD, Load, light_of, load_stage, mesh, refusal, shape_of, surface, textured

import clrender
from clrender.errors import SceneError
from clrender.flatten.bounds import scene_bounds
from clrender.flatten.flat_scene import flatten
from clrender.image.files import write_image
from clrender.scene import Scene
from clrender.scene.portable import scene_from_portable, scene_to_portable
from clrender.scene.posed import pose_meshes
from clrender.scene.resting import opened

pytest.importorskip("pxr", reason="usd-core is not installed")
__all__ = ["load_stage"]  # the fixture


# --- lights ----------------------------------------------------------------------------------------------------------


def _lamp(load_stage: Load, text: str, head: str = "metersPerUnit = 1") -> Scene:
    return load_stage(mesh() + text, head=head)


@for_each(
    ("light", "area"),
    [
        ('SphereLight "l" { float inputs:radius = 0.5', 4 * math.pi * 0.25),
        ('DiskLight "l" { float inputs:radius = 0.5', math.pi * 0.25),
        ('RectLight "l" { float inputs:width = 2\nfloat inputs:height = 3', 6.0),
        ('CylinderLight "l" { float inputs:radius = 0.5\nfloat inputs:length = 3', math.pi * 3),
    ],
)
def test_lights_with_an_area(load_stage: Load, light: str, area: float) -> None:
    strong = "float inputs:intensity = 5\nfloat inputs:exposure = 2\ncolor3f inputs:color = (1, 0.5, 0)"
    plain = shape_of(_lamp(load_stage, f"def {light}\n{strong}\n}}"), 1)
    assert plain.emission == (20.0, 10.0, 0.0)
    assert not plain.visible_to_camera
    scaled = f"{strong}\nbool inputs:normalize = 1\nfloat3 xformOp:scale = (2, 2, 2)\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:scale"]'
    # Areas are those in the stage, in its units
    even = shape_of(_lamp(load_stage, f"def {light}\n{scaled}{order}\n}}", "metersPerUnit = 0.1"), 1)
    assert even.emission[0] == pytest.approx(20.0 / (4 * area), rel=1e-6)


def test_area_lights_shine_along_minus_z(load_stage: Load) -> None:
    for light in ('RectLight "l" {}', 'DiskLight "l" {}', 'DiskLight "l" { float3 xformOp:scale = (1, 2, 1)\n%s }'):
        order = 'uniform token[] xformOpOrder = ["xformOp:scale"]'
        scene = _lamp(load_stage, f"def {light}" % order if "%" in light else f"def {light}")
        shape = shape_of(scene, 1)
        if shape.type == "mesh":
            data = scene.mesh(1)
            corners = data.vertices[data.triangles[0]]
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        elif shape.type == "quad":
            normal = np.cross(shape.edge_u, shape.edge_v)
        else:
            normal = np.array(shape.normal)
        assert normal[2] < 0


def test_points_distant_lights_and_cones(load_stage: Load) -> None:
    point = light_of(
        _lamp(
            load_stage,
            'def SphereLight "l" { float inputs:intensity = 8\nbool treatAsPoint = 1\nbool inputs:normalize = 1 }',
            "metersPerUnit = 0.5",
        )
    )
    # As if it were a sphere: the radiance over its disk, in metres
    assert (point.type, point.intensity[0]) == ("point", pytest.approx(8 / 4 * 0.25))
    turned = 'float3 xformOp:rotateXYZ = (-90, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:rotateXYZ"]'
    sun = light_of(_lamp(load_stage, f'def DistantLight "l" {{ float inputs:intensity = 50000\n{turned}\n}}'))
    assert sun.type == "directional"
    np.testing.assert_allclose(sun.direction, (0, -1, 0), atol=1e-15)
    assert sun.irradiance[0] == pytest.approx(50000 * math.pi * math.sin(math.radians(0.265)) ** 2)
    cone = "float inputs:shaping:cone:angle = 30\nfloat inputs:shaping:cone:softness = 0.5"
    spot = light_of(
        _lamp(load_stage, f'def SphereLight "l" (apiSchemas = ["ShapingAPI"])\n{{\nfloat inputs:radius = 2\n{cone}\n}}')
    )
    assert (spot.type, spot.cone_degrees) == ("spot", 60.0)
    assert spot.intensity[0] == pytest.approx(4 * math.pi)
    inner, edge = math.cos(math.radians(15)), math.cos(math.radians(30))
    assert spot.blend == pytest.approx((inner - edge) / (1 - edge))


def test_colour_temperature(load_stage: Load) -> None:
    warm = "bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 3000"
    shape = shape_of(_lamp(load_stage, f'def SphereLight "l" {{ {warm} }}'), 1)
    emission = shape.emission
    assert emission[0] > emission[1] > emission[2]
    assert 0.2126 * emission[0] + 0.7152 * emission[1] + 0.0722 * emission[2] == pytest.approx(1.0, abs=0.01)


def test_domes_and_their_orientation(load_stage: Load, tmp_path: Path) -> None:
    pixels = np.zeros((8, 16, 3), np.float32)
    pixels[0] = 5.0  # above
    pixels[4, 8] = (1.0, 2.0, 3.0)  # towards +z, a little below
    write_image(tmp_path / "sky.exr", pixels)
    file = "asset inputs:texture:file = @sky.exr@"
    turn = 'float xformOp:rotateY = 90\nuniform token[] xformOpOrder = ["xformOp:rotateY"]'
    lamp = light_of(_lamp(load_stage, f'def DomeLight "l" {{ {file}\nfloat inputs:exposure = 1\n{turn} }}'))
    assert (lamp.file, lamp.scale, lamp.rotate_degrees) == ("sky.exr", (2.0,) * 3, 90.0)
    over = 'float xformOp:rotateX = 180\nuniform token[] xformOpOrder = ["xformOp:rotateX"]'
    scene = _lamp(load_stage, f'def DomeLight "l" {{ {file}\n{over} }}')
    turned = scene.environment_picture()
    assert turned is not None
    np.testing.assert_allclose(turned.pixels[7], 5.0)
    # Half a turn about x: from +z, -x and below to -z, -x and above, at the right edge of the picture
    np.testing.assert_allclose(turned.pixels[3, 15], (1.0, 2.0, 3.0), atol=1e-5)
    up = light_of(_lamp(load_stage, f'def DomeLight_1 "l" {{ {file} }}', 'metersPerUnit = 1\nupAxis = "Z"'))
    assert up.file == "sky.exr"
    second = _lamp(load_stage, 'def DomeLight "a" {}\ndef DomeLight "b" {}')
    assert len(second.lights) == 1
    assert any("one environment" in note for note in second.notes)


def test_a_mesh_may_be_a_light(load_stage: Load) -> None:
    text = mesh("float inputs:intensity = 3").replace('["MaterialBindingAPI"]', '["MeshLightAPI"]')
    scene = load_stage(text)
    assert shape_of(scene, 0).emission == (3.0, 3.0, 3.0)
    assert not any("no light" in note for note in scene.notes)


# --- cameras ---------------------------------------------------------------------------------------------------------


def test_a_camera_sees_what_that_of_the_library_does(load_stage: Load, tmp_path: Path) -> None:
    from pxr import Gf, Usd, UsdGeom

    text = """
def Camera "c"
{
    float horizontalAperture = 36
    float verticalAperture = 24
    float horizontalApertureOffset = 3
    float verticalApertureOffset = -2
    float focalLength = 40
    float fStop = 2
    float focusDistance = 7
    double3 xformOp:translate = (1, 2, 3)
    float3 xformOp:rotateXYZ = (20, 30, 40)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}
"""
    scene = load_stage(mesh() + text, name="camera.usda")
    camera = scene.camera
    assert (scene.image.width, scene.image.height) == (800, 533)
    assert camera.aperture_radius == pytest.approx(40 / 10 / (2 * 2))
    assert camera.focus_distance == pytest.approx(7.0)
    stage = Usd.Stage.Open(str(tmp_path / "camera.usda"))
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/c")).GetCamera(0).frustum
    view = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    projection = camera.projection(800, 533)
    for point in ((0.5, 1.0, -5.0), (-1.0, 0.5, -4.0)):
        seen = frustum.ComputeViewInverse().Transform(Gf.Vec3d(*point))
        x, y, _ = view.Transform(Gf.Vec3d(*seen))
        # Their frame has z backward and y up; ours z forward and y down
        found = projection.places(np.array([[point[0], -point[1], -point[2]]]))[0]
        np.testing.assert_allclose(found, [(x + 1) / 2, (1 - y) / 2], atol=1e-3)
        right, up, forward = (np.array(each) for each in camera.axes)
        away = np.array(seen) - np.array(camera.position)
        np.testing.assert_allclose(
            [away @ right, away @ up, away @ forward], [point[0], point[1], -point[2]], atol=1e-9
        )


def test_an_orthographic_camera_and_an_exposure(load_stage: Load) -> None:
    flat = load_stage(mesh() + 'def Camera "c" { token projection = "orthographic"\nfloat verticalAperture = 30 }')
    assert flat.camera.type == "orthographic"
    assert flat.camera.height == pytest.approx(3.0)
    from clrender.image.exposure import photographic_stops

    exposed = load_stage(mesh() + 'def Camera "c" { float exposure = -2.5 }\ndef DomeLight "d" {}').camera
    assert isinstance(exposed.shutter, float)
    assert photographic_stops(exposed.f_stop, exposed.shutter) == pytest.approx(-2.5, abs=1e-6)


def test_render_settings_name_the_camera_and_the_size(load_stage: Load) -> None:
    settings = """
def RenderSettings "r"
{
    rel camera = </b>
    uniform int2 resolution = (64, 32)
}
"""
    cameras = 'def Camera "a" { float focalLength = 10 }\ndef Camera "b" { float focalLength = 90 }'
    scene = load_stage(mesh() + cameras + settings, head='metersPerUnit = 1\nrenderSettingsPrimPath = "/r"')
    assert (scene.image.width, scene.image.height) == (64, 32)
    assert scene.camera.vertical_fov < 20
    assert any("render settings" in note for note in scene.notes)


def test_another_camera_is_chosen_by_its_name(load_stage: Load, tmp_path: Path) -> None:
    cameras = 'def Camera "a" { float focalLength = 10 }\ndef Xform "x" {\ndef Camera "b" { float focalLength = 90 }\n}'
    load_stage(mesh() + cameras, name="a.usda")
    found = clrender.load_cameras(tmp_path / "a.usda")
    assert list(found) == ["/a", "/x/b"]
    chosen = clrender.load(tmp_path / "a.usda", camera=f"{tmp_path / 'a.usda'}#b")
    assert chosen.camera.vertical_fov == found["/x/b"].vertical_fov < 20


# --- times -----------------------------------------------------------------------------------------------------------

_MOVING = """
def Sphere "s"
{
    double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 20: (10, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
_HEAD = "metersPerUnit = 1\nstartTimeCode = 10\nendTimeCode = 20\ntimeCodesPerSecond = 10"


def test_a_time_is_one_of_the_stage(load_stage: Load) -> None:
    def at(scene: Scene) -> float:
        low, high = scene_bounds(scene)
        return float(low[0] + high[0]) / 2

    rest = load_stage(_MOVING, head=_HEAD)
    assert at(rest) == pytest.approx(0.0)
    assert any("--time-at" in note for note in rest.notes)
    assert at(load_stage(_MOVING, head=_HEAD, time_at=1.5)) == pytest.approx(5.0)
    assert any("no animation" in note for note in load_stage(mesh(), time_at=1.0).notes)


def test_an_open_shutter_blurs_what_moves(load_stage: Load) -> None:
    scene = load_stage(_MOVING, head=_HEAD, time_at=1.25, shutter=(-0.25, 0.25))
    keys = shape_of(scene, 0).motion
    assert (keys[0].time, keys[-1].time) == (1.0, 1.5)
    matrices = [np.array(each.matrix) for each in (keys[0], keys[8], keys[-1])]
    assert [each[0, 3] for each in matrices] == pytest.approx([0.0, 2.5, 5.0])
    points = f"point3f[] points.timeSamples = {{ 10: [{QUAD}], 20: [{QUAD.replace('2, 1', '4, 1')}] }}"
    text = mesh().replace(f"point3f[] points = [{QUAD}]", points)
    posed = load_stage(text, head=_HEAD, time_at=1.0, shutter=(0.0, 1.0))
    poses = shape_of(posed, 0).poses
    assert [each.time for each in (poses[0], poses[-1])] == [1.0, 2.0]


_TURN = "xformOp:rotateZ.timeSamples = { 10: 0, 20: 90 }"


@for_each(
    ("kind", "inputs"),
    [
        ("SphereLight", "float inputs:radius = 0.5"),
        ("DiskLight", "float inputs:radius = 0.5"),
        ("RectLight", "float inputs:width = 2"),
        ("CylinderLight", "float inputs:length = 3"),
        ("SphereLight", "bool treatAsPoint = 1"),
        ("DiskLight", "float inputs:shaping:cone:angle = 20"),
        ("DistantLight", "float inputs:angle = 0"),
    ],
)
def test_lights_move_while_the_shutter_is_open(load_stage: Load, kind: str, inputs: str) -> None:
    """At its end they are as an image of that moment has them."""
    place = "double3 xformOp:translate.timeSamples = { 10: (1, 0, 0), 20: (1, 3, 0) }\nfloat " + _TURN
    order = 'float xformOp:rotateX = 30\nuniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ", '
    light = f'def {kind} "l" {{\n{inputs}\n{place}\n{order}"xformOp:rotateX"]\n}}'
    moving = load_stage(mesh() + light, head=_HEAD, time_at=1.0, shutter=(0.0, 1.0))
    assert not any("rests" in note for note in moving.notes)
    late = opened(moving.changed({"camera": {"position": (0, 0, 9), "target": (0, 0, 0), "time": 2.0}}))
    there = load_stage(mesh() + light, head=_HEAD, time_at=2.0)
    for ours, other in zip(late.lights, there.lights, strict=True):
        for key in ("position", "direction"):
            np.testing.assert_allclose(getattr(ours, key, 0.0), getattr(other, key, 0.0), atol=1e-6)
    np.testing.assert_allclose(scene_bounds(late), scene_bounds(there), atol=1e-6)
    assert len(there.lights) + len(there.shapes) == 2


def test_what_cannot_move_is_said(load_stage: Load) -> None:
    """What shines while it changes its form, what becomes its mirror image, and what points or curves place."""
    shutter: dict[str, Any] = {"head": _HEAD, "time_at": 1.0, "shutter": (0.0, 1.0)}
    points = f"point3f[] points.timeSamples = {{ 10: [{QUAD}], 20: [{QUAD.replace('2, 1', '4, 1')}] }}"
    shining = mesh("float inputs:intensity = 1").replace('"MaterialBindingAPI"', '"MeshLightAPI"')
    text = shining.replace(f"point3f[] points = [{QUAD}]", points)
    assert any("it changes its form, and shines" in note for note in load_stage(text, **shutter).notes)
    scaled = "float3 xformOp:scale.timeSamples = {{ 10: (1, 1, 1), 20: ({}, 1, 1) }}\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:scale"]'
    mirrored = load_stage(mesh(scaled.format(-0.5) + order), **shutter)
    assert not shape_of(mirrored).motion and any('"/m" rests' in note for note in mirrored.notes)
    turned = f'def Xform "x" {{\nfloat {_TURN}\nuniform token[] xformOpOrder = ["xformOp:rotateZ"]\n'
    placed = """
    def PointInstancer "p"
    {
        point3f[] positions = [(0, 0, 0)]
        int[] protoIndices = [0]
        rel prototypes = </x/p/m>
        %s
    }
    }
    """
    assert any('"/x/p" rests' in note for note in load_stage(turned + placed % mesh(), **shutter).notes)
    dome = f'def DomeLight "d" {{\nfloat {_TURN}\nuniform token[] xformOpOrder = ["xformOp:rotateZ"]\n}}'
    assert any('"/d" rests' in note for note in load_stage(mesh() + dome, **shutter).notes)


def test_what_is_scaled_to_zero_on_its_way_still_moves(load_stage: Load) -> None:
    """So animations hide things; also if the image is of the moment at which it is hidden."""
    scaled = "float3 xformOp:scale.timeSamples = { 10: (1, 1, 1), 20: (0, 0, 0) }\n"
    placed = "double3 xformOp:translate.timeSamples = { 10: (0, 0, 0), 20: (5, 0, 0) }\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]'
    text = mesh(scaled + placed + order) + f'def Sphere "s" {{\n{scaled}{placed}{order}\n}}'
    for time in (1.0, 2.0):
        scene = load_stage(text, head=_HEAD, time_at=time, shutter=(1.0 - time, 2.0 - time))
        assert len(scene.shapes) == 2 and not any("rests" in note or "left out" in note for note in scene.notes)
        for number in range(2):
            first, *_, last = (np.array(key.matrix) for key in shape_of(scene, number).motion)
            np.testing.assert_array_equal(first, np.eye(4))
            assert last[0, 3] == 5.0 and 0.0 < last[0, 0] < 1e-3


def test_what_is_hidden_at_the_time_of_the_image_grows(load_stage: Load) -> None:
    """A mesh whose points are one point then, and a light that is as bright as at its largest."""
    shutter: dict[str, Any] = {"head": _HEAD, "time_at": 1.0, "shutter": (0.0, 1.0)}
    samples = f"point3f[] points.timeSamples = {{ 10: [{', '.join(['(0, 0, 0)'] * 4)}], 20: [{QUAD}] }}"
    grown = load_stage(mesh().replace(f"point3f[] points = [{QUAD}]", samples), **shutter)
    assert len(shape_of(grown).poses) == 9 and flatten(grown, 8, 8).triangle_count == 2
    scaled = "float3 xformOp:scale.timeSamples = { 10: (0, 0, 0), 20: (2, 2, 2) }\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:scale"]'
    light = f'def RectLight "l" {{\nbool inputs:normalize = 1\n{scaled}{order}\n}}'
    scene = load_stage(mesh() + light, **shutter)
    assert shape_of(scene, 1).emission == pytest.approx((0.25,) * 3)
    assert any("as bright as at its largest" in note for note in scene.notes)


def test_normals_follow_while_the_shutter_is_open(load_stage: Load) -> None:
    """They have samples of their own, as attribute and as primvar; files of poses hold no more than those."""
    turned = "(0, 0, 0), (2, 0, 0), (2, 0, 1), (0, 0, 1)"
    points = f"point3f[] points.timeSamples = {{ 10: [{QUAD}], 20: [{turned}] }}"
    colors = "color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] ("
    colors += '\ninterpolation = "vertex"\n)\n'
    for name in ("normals", "primvars:normals"):
        samples = f"normal3f[] {name} (\n" + 'interpolation = "vertex"\n)\n'
        samples += f"normal3f[] {name}.timeSamples = {{ 10: [{', '.join(['(0, 0, 1)'] * 4)}], "
        samples += f"20: [{', '.join(['(0, -1, 0)'] * 4)}] }}"
        text = mesh(colors + samples).replace(f"point3f[] points = [{QUAD}]", points)
        scene = load_stage(text, head=_HEAD, time_at=1.0, shutter=(0.0, 1.0))
        first, *_, last = pose_meshes(scene, ("shapes", 0), shape_of(scene))
        np.testing.assert_array_equal(first.normals, [(0, 0, 1)] * 4)
        np.testing.assert_array_equal(last.normals, [(0, -1, 0)] * 4)
        assert scene_from_portable(*scene_to_portable(scene)).sha256() == scene.sha256()


_SKELETON = """
def SkelRoot "r" (prepend apiSchemas = ["SkelBindingAPI"])
{
    rel skel:skeleton = </r/k>
    def Skeleton "k" (prepend apiSchemas = ["SkelBindingAPI"])
    {
        uniform token[] joints = ["a"]
        uniform matrix4d[] bindTransforms = [((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]
        uniform matrix4d[] restTransforms = [((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]
        rel skel:animationSource = </r/k/anim>
        def SkelAnimation "anim"
        {
            uniform token[] joints = ["a"]
            float3[] translations.timeSamples = { 10: [(0, 0, 0)], 20: [(10, 0, 0)] }
            quatf[] rotations = [(1, 0, 0, 0)]
            half3[] scales = [(1, 1, 1)]
            uniform token[] blendShapes = ["up"]
            float[] blendShapeWeights.timeSamples = { 10: [0], 20: [1] }
        }
    }
    %s
}
"""
_SKINNED = """
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    int[] primvars:skel:jointIndices = [0, 0, 0, 0] (
        elementSize = 1
        interpolation = "vertex"
    )
    float[] primvars:skel:jointWeights = [1, 1, 1, 1] (
        elementSize = 1
        interpolation = "vertex"
    )
    uniform token[] skel:blendShapes = ["up"]
    rel skel:blendShapeTargets = </r/m/up>
    def BlendShape "up"
    {
        uniform vector3f[] offsets = [(0, 0, 2)]
        uniform int[] pointIndices = [2]
    }
"""


def test_skeletons_and_blend_shapes_deform_meshes(load_stage: Load) -> None:
    text = _SKELETON % mesh(_SKINNED).replace('["MaterialBindingAPI"]', '["SkelBindingAPI"]')
    scene = load_stage(text, head=_HEAD, time_at=1.5)
    world = scene.mesh(0).vertices @ np.eye(3) + np.array(shape_of(scene, 0).transform.matrix)[:3, 3]
    # A skinned mesh goes where its skeleton is, whatever its own transform
    np.testing.assert_allclose(world, [[5, 0, 0], [7, 0, 0], [7, 1, 1], [5, 1, 0]])
    moving = load_stage(text, head=_HEAD, time_at=1.5, shutter=(0.0, 0.1))
    assert len(shape_of(moving, 0).poses) == 9
    assert not any("no animation" in note for note in scene.notes)


def test_a_joint_that_mirrors_leaves_fronts_in_front(load_stage: Load) -> None:
    text = _SKELETON % mesh(_SKINNED).replace('["MaterialBindingAPI"]', '["SkelBindingAPI"]')

    def fronts(text: str, **choices: Any) -> Any:
        found = load_stage(text, head=_HEAD, time_at=1.0, **choices)
        data = found.mesh(0)
        a, b, c = (data.vertices[data.triangles[:, corner]] for corner in range(3))
        return found, np.cross(b - a, c - a)[:, 2]

    assert (fronts(text)[1] > 0.0).all()
    mirrored = text.replace("[(1, 1, 1)]", "[(-1, 1, 1)]")
    assert (fronts(mirrored)[1] > 0.0).all()
    turned = text.replace("scales = [(1, 1, 1)]", "scales.timeSamples = { 10: [(1, 1, 1)], 20: [(-1, 1, 1)] }")
    scene, _ = fronts(turned, shutter=(0.0, 1.0))
    assert not shape_of(scene).poses and any("make its mirror image" in note for note in scene.notes)


# --- files -----------------------------------------------------------------------------------------------------------


def test_layers_are_read_from_allowed_folders_only(load_stage: Load, tmp_path: Path) -> None:
    inside, outside = tmp_path / "scene", tmp_path / "elsewhere"
    inside.mkdir()
    outside.mkdir()
    for folder in (inside, outside):
        (folder / "part.usda").write_text(f'#usda 1.0\n(defaultPrim = "m")\n{mesh()}')

    def stage(name: str, path: str) -> Path:
        (inside / name).write_text(f'#usda 1.0\ndef "a" (references = @{path}@) {{}}\n{mesh(name="own")}')
        return inside / name

    scene = clrender.load(stage("a.usda", "part.usda"))
    assert [each.name for each in scene.shapes] == ["/a", "/own"]
    assert inside / "part.usda" in scene.read_files
    for path in ("../elsewhere/part.usda", str(outside / "part.usda")):
        name = f"b{len(path)}.usda"
        assert "lies outside the scene's own folder" in refusal(partial(clrender.load, stage(name, path)))
    (inside / "link.usda").symlink_to(outside / "part.usda")
    assert "lies outside" in refusal(lambda: clrender.load(stage("c.usda", "link.usda")))
    allowed = clrender.load(stage("d.usda", "../elsewhere/part.usda"), allow_paths=[outside])
    assert [each.name for each in allowed.shapes] == ["/a", "/own"]
    missing = clrender.load(stage("e.usda", "nothing.usda"))
    assert [each.name for each in missing.shapes] == ["/own"]
    assert any("nothing.usda" in note and "left out" in note for note in missing.notes)
    assert "nothing.usda" in refusal(lambda: clrender.load(stage("e.usda", "nothing.usda"), strict=True))
    expression = stage("f.usda", '`"${X}"`')
    assert "expression" in refusal(lambda: clrender.load(expression))
    assert "nothing is fetched" in refusal(lambda: clrender.load(stage("g.usda", "https://example.com/a.usd")))


def test_pictures_and_clips_of_other_folders_are_refused(load_stage: Load, tmp_path: Path) -> None:
    text = textured().replace("@a.png@", "@/etc/hostname@") + mesh(BOUND)
    assert "lies outside" in refusal(lambda: load_stage(text))
    clips = """
def Xform "x" (clips = { dictionary default = {
    asset[] assetPaths = [@/etc/passwd@]
    string primPath = "/x"
    double2[] active = [(0, 0)]
} }) {}
"""
    assert "lies outside" in refusal(lambda: load_stage(clips + mesh()))


@for_each(
    ("content", "text"),
    [
        (b"#usda 1.0\ndef Mesh {", "no readable USD file: line 2"),
        (b"PXR-USDC" + bytes(200), "no readable USD file"),
        (b"", "no readable USD file"),
        (b"PK\x03\x04" + bytes(50), "no readable USD file"),
    ],
)
def test_damaged_files_are_refused(load_stage: Load, tmp_path: Path, content: bytes, text: str) -> None:
    path = tmp_path / ("a.usdz" if content[:2] == b"PK" else "a.usd")
    path.write_bytes(content)
    message = refusal(lambda: clrender.load(path))
    assert text in message
    assert "\n" not in message


@pytest.mark.thorough
def test_a_stage_is_read_in_a_process_of_its_own(
    load_stage: Load, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = load_stage(surface("") + mesh(BOUND) + 'def SphereLight "l" {}', name="a.usda")
    monkeypatch.undo()
    assert clrender.load(tmp_path / "a.usda").sha256() == here.sha256()
    (tmp_path / "b.usda").write_text("#usda 1.0\ndef Mesh {")
    assert "b.usda: it is no readable USD file: line 2" in refusal(lambda: clrender.load(tmp_path / "b.usda"))


def test_a_library_that_crashes_refuses_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.usda"
    path.write_text("#usda 1.0\n")
    run = subprocess.run

    def crashing(command: list[str], **more: Any) -> Any:
        return run([sys.executable, "-c", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"], **more)

    monkeypatch.setattr("clrender.importers.usd.process.subprocess.run", crashing)
    assert "it ended by signal 11" in refusal(lambda: clrender.load(path))


def test_without_the_library_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.usda"
    path.write_text("#usda 1.0\n")
    monkeypatch.setattr("clrender.importers.usd.process.find_spec", lambda name: None)
    with pytest.raises(SceneError, match="USD needs usd-core; install it with") as error:
        clrender.load(path)
    assert error.value.extra == "usd"
