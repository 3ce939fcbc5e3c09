"""glTF files: what becomes of meshes, nodes, materials, cameras and lights, and what is refused with which words."""

from __future__ import annotations

import json
import math
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from assets import ASSETS, needs_assets
from cases import for_each
from gltf_files import QUAD, Model, picture_uri

import clrender
from clrender.errors import SceneError
from clrender.exporters import exported
from clrender.exporters.own import scene_text
from clrender.flatten.bounds import scene_bounds
from clrender.flatten.flat_scene import flatten
from clrender.flatten.surfaces import flat_surfaces
from clrender.image.files import write_image
from clrender.scene import Camera, DirectionalLight, PointLight, Principled, Scene, SpotLight
from clrender.scene.portable import scene_from_portable, scene_to_portable
from clrender.scene.posed import pose_meshes
from clrender.scene.resting import opened
from clrender.scene.shapes import Mesh
from clrender.scene.textures import ImageTexture, NormalMap, ThicknessMap


def loaded(folder: Path, model: Model, name: str = "m.glb", **choices: Any) -> Scene:
    return clrender.load(model.write(folder / name), **choices)


def material(folder: Path, source: dict[str, Any], model: Model | None = None) -> Principled:
    """What becomes of a material on a quad."""
    model = model or Model()
    extensions = source.get("extensions", {})
    if extensions:
        model.extend(*extensions)
    model.node(mesh=model.quad(model.add("materials", source)))
    (made,) = loaded(folder, model).materials.values()
    assert isinstance(made, Principled)
    return made


# --- meshes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["m.glb", "m.gltf"])
def test_a_quad_has_its_vertices_triangles_and_picture_upright(tmp_path: Path, name: str) -> None:
    model = Model()
    red = {"baseColorTexture": {"index": model.texture(np.zeros((2, 2, 3)))}}
    model.node(mesh=model.quad(model.add("materials", {"pbrMetallicRoughness": red})))
    scene = loaded(tmp_path, model, name)
    mesh = scene.mesh(0)
    np.testing.assert_array_equal(mesh.vertices, np.array(QUAD, np.float32))
    np.testing.assert_array_equal(mesh.triangles, [[0, 1, 2], [0, 2, 3]])
    assert mesh.uvs is not None
    np.testing.assert_array_equal(mesh.uvs[0], [[0, 0], [1, 0], [1, 1]])  # ours begin at the lower left corner
    assert scene.materials["material 0"].model_dump()["base_color"]["texture"] == "/images/0"


@for_each(
    ("mode", "corners", "triangles"),
    [
        (4, [0, 1, 2, 0, 2, 3], [(0, 1, 2), (0, 2, 3)]),
        (4, [0, 1, 2, 0, 2], [(0, 1, 2)]),
        (5, [0, 1, 3, 2], [(0, 1, 3), (1, 2, 3)]),
        (5, [0, 1, 3, 2, 0], [(0, 1, 3), (1, 2, 3), (3, 2, 0)]),
        (6, [0, 1, 2, 3], [(1, 2, 0), (2, 3, 0)]),
    ],
)
def test_modes(tmp_path: Path, mode: int, corners: list[int], triangles: list[tuple[int, ...]]) -> None:
    """Orders as of section 3.7.2.1 of the specification."""
    model = Model()
    at = {"POSITION": model.accessor(QUAD)}
    mesh = model.add(
        "meshes", {"primitives": [{"attributes": at, "mode": mode, "indices": model.accessor(corners, "uint8")}]}
    )
    model.node(mesh=mesh)
    np.testing.assert_array_equal(loaded(tmp_path, model).mesh(0).triangles, triangles)


def test_points_and_lines_are_noted_and_left_out(tmp_path: Path) -> None:
    model = Model()
    at = {"POSITION": model.accessor(QUAD)}
    model.node(mesh=model.add("meshes", {"primitives": [{"attributes": at, "mode": mode} for mode in (0, 3, 6)]}))
    scene = loaded(tmp_path, model)
    assert len(scene.shapes) == 1
    assert any("/meshes/0/primitives/0 was left out: it consists of points" in note for note in scene.notes)
    assert any("/meshes/0/primitives/1 was left out: it consists of lines" in note for note in scene.notes)


def test_kinds_of_accessors(tmp_path: Path) -> None:
    """Sparse positions, interleaved normals, quantised texture coordinates and normalised colours."""
    model = Model()
    model.extend("KHR_mesh_quantization", required=True)
    moved = model.accessor(QUAD)
    model.root["accessors"][moved]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": model.view(np.array([1, 3], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": model.view(np.array([(9, 8, 7), (6, 5, 4)], "<f4").tobytes())},
    }
    rows = np.zeros((4, 6), "<f4")
    rows[:, 3:] = (0.0, 0.6, 0.8)
    interleaved = {"bufferView": model.view(rows.tobytes(), byteStride=24), "byteOffset": 12}
    padded = np.zeros((4, 4), "i1")
    padded[:, :2] = ((0, 127), (127, 127), (64, 0), (-128, 0))
    small = {"bufferView": model.view(padded.tobytes(), byteStride=4), "componentType": 5120, "normalized": True}
    primitive = {
        "attributes": {
            "POSITION": moved,
            "NORMAL": model.add("accessors", {**interleaved, "componentType": 5126, "count": 4, "type": "VEC3"}),
            "TEXCOORD_0": model.add("accessors", {**small, "count": 4, "type": "VEC2"}),
            "COLOR_0": model.accessor(np.full((4, 4), (65535, 0, 13107, 65535)), "uint16", normalized=True),
        },
        "mode": 6,
        "material": model.add(
            "materials", {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": model.texture([[[9, 9, 9]]])}}
        ),
    }
    model.node(mesh=model.add("meshes", {"primitives": [primitive]}))
    mesh = loaded(tmp_path, model).mesh(0)
    np.testing.assert_array_equal(mesh.vertices, [QUAD[0], (9, 8, 7), QUAD[2], (6, 5, 4)])
    assert mesh.normals is not None and mesh.uvs is not None and mesh.colors is not None
    np.testing.assert_allclose(mesh.normals, np.tile([0.0, 0.6, 0.8], (4, 1)), rtol=1e-6)
    np.testing.assert_allclose(mesh.uvs[0], [(1, 0), (64 / 127, 1), (0, 0)], atol=1e-6)
    np.testing.assert_allclose(mesh.uvs[1, 1], (-1, 1))  # -128 / 127 counts as -1
    np.testing.assert_allclose(mesh.colors, np.broadcast_to([1.0, 0.0, 0.2], (2, 3, 3)), atol=1e-6)


def test_meshes_of_many_nodes_are_kept_once_and_a_mirror_keeps_fronts(tmp_path: Path) -> None:
    model = Model()
    quad = model.quad()
    model.node(mesh=quad, translation=[3, 0, 0])
    model.node(mesh=quad, scale=[-1, 2, 1])
    parent = model.node(matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1], children=[3])
    model.add("nodes", {"mesh": quad, "rotation": [0, 0, math.sqrt(0.5), math.sqrt(0.5)]})
    assert parent == 2
    scene = loaded(tmp_path, model)
    assert scene.mesh(0) is scene.mesh(1) is scene.mesh(2)
    low, high = scene_bounds(scene)
    np.testing.assert_allclose([low, high], [(-1, -2, 0), (4, 6, 0)], atol=1e-6)
    flat = flat_surfaces(scene)
    for a, b, c in flat.vertices[flat.triangles][:, :, :3]:
        assert np.cross(b - a, c - a)[2] > 0.0


def test_instances_of_a_node(tmp_path: Path) -> None:
    model = Model()
    model.extend("EXT_mesh_gpu_instancing", required=True)
    moves = model.accessor([(0, 0, 0), (10, 0, 0), (0, 0, 30)])
    sizes = model.accessor([(1, 1, 1), (2, 2, 2), (1, 1, 0)])
    attributes = {"TRANSLATION": moves, "SCALE": sizes}
    model.node(mesh=model.quad(), scale=[2, 2, 2], extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    scene = loaded(tmp_path, model)
    assert len(scene.shapes) == 2 and any("/nodes/0: a mesh was left out" in note for note in scene.notes)
    np.testing.assert_allclose(scene_bounds(scene)[1], (24, 4, 0))


def crowd(count: int, **node: Any) -> Model:
    """A quad and a smaller one beside it, many times, some of them mirrored."""
    random, model = np.random.default_rng(5), Model()
    model.extend("EXT_mesh_gpu_instancing", required=True)
    mesh = model.quad()
    points = np.array(QUAD) * 0.3 + (0.0, 0.0, 0.5)
    beside = {"attributes": {"POSITION": model.accessor(points)}, "indices": model.accessor([0, 1, 2], "uint16")}
    model.root["meshes"][mesh]["primitives"].append(beside)
    sizes = random.uniform(0.5, 2.0, (count, 3)) * np.where(random.random((count, 1)) < 0.3, -1.0, 1.0)
    attributes = {
        "TRANSLATION": model.accessor(random.uniform(-20.0, 20.0, (count, 3))),
        "ROTATION": model.accessor(random.uniform(-0.9, 0.9, (count, 4))),
        "SCALE": model.accessor(sizes),
    }
    model.node(mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}}, **node)
    return model


def test_instances_have_the_matrices_of_nodes(tmp_path: Path) -> None:
    """Those of the same transforms as nodes of their own, computed one by one, bit for bit."""
    placing: dict[str, Any] = {"translation": [1, 2, 3], "rotation": [0.1, 0.7, 0.2, 0.4], "scale": [2, -1, 0.3]}
    model = crowd(40, **placing)
    node = model.root["nodes"][0]
    attributes = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    model.node(children=list(range(2, 42)), **placing)
    for i in range(40):
        values = {}
        for key, number in attributes.items():
            view = model.root["bufferViews"][model.root["accessors"][number]["bufferView"]]
            row = np.frombuffer(model.data, "<f4", view["byteLength"] // 4, view["byteOffset"]).reshape(40, -1)[i]
            values[key.lower()] = row.astype(float).tolist()
        model.add("nodes", {"mesh": node["mesh"], **values})
    shapes = loaded(tmp_path, model).shapes
    assert len(shapes) == 2 * 2 * 40
    for one, other in zip(shapes[:80], shapes[80:], strict=True):
        assert one.model_dump() == other.model_dump() and one.transform.matrix is not None


@pytest.mark.thorough
def test_many_instances_are_one_array(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of both primitives in one group; the places are those of the shapes written out."""
    some = loaded(tmp_path, crowd(500, name="leaf", scale=[2, 1, 1]), "some.glb").shapes
    monkeypatch.setattr("clrender.importers.instancing._WORTH", 1000)
    model = crowd(500, name="leaf", scale=[2, 1, 1])
    model.node(mesh=0)
    scene = loaded(tmp_path, model)
    assert len(some) == 1000
    placed, *alone = scene.shapes
    assert placed.type == "instance" and placed.name == "leaf" and len(alone) == 2
    (group,) = scene.groups.values()
    assert [shape.model_dump(exclude={"name", "transform"}) for shape in group.shapes] == [
        shape.model_dump(exclude={"name", "transform"}) for shape in some[:2]
    ]
    expected = [shape.transform.matrix for shape in some[::2]]
    np.testing.assert_array_equal(scene.transforms(0).maps, np.array(expected)[:, :3])
    monkeypatch.undo()
    many = crowd(10**5)
    tracemalloc.start()
    try:
        assert len(loaded(tmp_path, many).shapes) == 1
        assert tracemalloc.get_traced_memory()[1] < 1500 * 10**5  # bytes; a shape for each takes 5000 each
    finally:
        tracemalloc.stop()


# --- animation, morph targets, skins ---------------------------------------------------------------------------------


def animated(model: Model, node: int, path: str, times: list[float], values: Any, kind: str = "LINEAR") -> None:
    sampler = {"input": model.times(times), "output": model.accessor(values), "interpolation": kind}
    channel = {"sampler": 0, "target": {"node": node, "path": path}}
    model.add("animations", {"samplers": [sampler], "channels": [channel]})


@for_each(
    ("kind", "seconds", "x"),
    [
        ("LINEAR", None, 7.0),
        ("LINEAR", -1.0, 0.0),
        ("LINEAR", 1.5, 1.0),
        ("LINEAR", 2.5, 3.0),
        ("LINEAR", 9.0, 4.0),
        ("STEP", 2.9, 2.0),
        ("CUBICSPLINE", 2.5, 0.5 * 2.0 + 0.125 * 1.0 + 0.5 * 4.0 - 0.125 * 3.0),
    ],
)
def test_a_moment_of_an_animation(tmp_path: Path, kind: str, seconds: float | None, x: float) -> None:
    """Appendix C: a cubic spline is 2 at its middle key frame and leaves it with tangent 1, and arrives at 4 with 3."""
    model = Model()
    node = model.node(mesh=model.quad(), translation=[7, 0, 0])
    if kind == "CUBICSPLINE":
        rows: Any = [(0, 0, 0)] * 4 + [(2, 0, 0), (1, 0, 0), (3, 0, 0), (4, 0, 0), (0, 0, 0)]
    else:
        rows = [(0, 0, 0), (2, 0, 0), (4, 0, 0)]
    animated(model, node, "translation", [1.0, 2.0, 3.0], rows, kind)
    scene = loaded(tmp_path, model, time_at=seconds)
    np.testing.assert_allclose(scene_bounds(scene)[0][0], x - 1.0, atol=1e-6)


def test_an_animation_while_the_shutter_is_open(tmp_path: Path) -> None:
    """Nodes become motions, whose keys are at key frames and between; a child turns about its parent's origin."""
    model = Model()
    child = model.node(mesh=model.quad(), translation=[2, 0, 0])
    parent = model.node(children=[child], translation=[0, 0, 1])
    model.node(mesh=model.quad(), translation=[0, 5, 0])
    half = math.sqrt(0.5)
    animated(model, parent, "rotation", [0.0, 1.0], [(0, 0, 0, 1), (0, 0, half, half)])  # 90 degrees about z
    scene = loaded(tmp_path, model, time_at=0.5, shutter=(0.0, 1.0))
    assert scene.camera.interval == (0.5, 1.5)
    turned, still = scene.shapes[:2]
    assert not still.motion and turned.motion[0].time == 0.5 and turned.motion[-1].time == 1.5
    assert {key.time for key in turned.motion} > {1.0}
    for key in turned.motion:
        angle = math.radians(90.0 * min(key.time, 1.0))
        matrix = np.array(key.matrix)
        np.testing.assert_allclose(matrix[:3, 3], [2 * math.cos(angle), 2 * math.sin(angle), 1], atol=1e-6)
    moment = loaded(tmp_path, model, time_at=0.5)
    assert not moment.shapes[0].motion and moment.camera.interval == (0.0, 0.0)
    places = [np.array(each.shapes[0].transform.matrix) for each in (opened(scene), moment)]
    np.testing.assert_allclose(places[0], places[1], atol=1e-6)


def test_lights_move_with_their_nodes(tmp_path: Path) -> None:
    """Below a parent that turns and is twice as large, which makes no lamp larger."""
    model = Model()
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": kind} for kind in ("spot", "directional")]}}
    places: list[Any] = [{"extensions": {"KHR_lights_punctual": {"light": number}}} for number in range(2)]
    lamp, sun = (model.node(translation=[1, 0, 0], rotation=[0, 1, 0, 0], **each) for each in places)  # turned round y
    parent = model.node(children=[lamp, sun], scale=[2, 2, 2])
    model.node(mesh=model.quad())
    half = math.sqrt(0.5)
    animated(model, parent, "rotation", [0.0, 1.0], [(0, 0, 0, 1), (half, 0, 0, half)])  # 90 degrees about x
    scene = loaded(tmp_path, model, time_at=0.0, shutter=(0.0, 1.0))
    spot: Any = scene.lights[0]
    assert spot.motion[0].time == 0.0 and spot.motion[-1].time == 1.0
    for time in (0.0, 0.4, 1.0):
        shown: Any = opened(scene.with_checked(camera=scene.camera.with_checked(shutter=None, time=time))).lights
        angle = math.radians(90.0 * time)
        towards = (0.0, -2.0 * math.sin(angle), 2.0 * math.cos(angle))
        assert shown[0].position == pytest.approx((2.0, 0.0, 0.0), abs=1e-6)
        assert [each.direction for each in shown] == [pytest.approx(towards, abs=1e-4)] * 2
    moment: Any = loaded(tmp_path, model, time_at=0.7)
    assert not moment.lights[0].motion
    angle = math.radians(63.0)
    assert moment.lights[0].direction == pytest.approx((0.0, -2.0 * math.sin(angle), 2.0 * math.cos(angle)), abs=1e-6)


def test_rotations_go_the_short_way_round(tmp_path: Path) -> None:
    model = Model()
    node = model.node(mesh=model.quad(), translation=[0, 0, 0])
    half = math.sqrt(0.5)
    animated(model, node, "rotation", [0.0, 1.0], [(0, 0, 0, 1), (0, 0, -half, -half)])  # 90 degrees about z
    scene = loaded(tmp_path, model, time_at=0.5)
    np.testing.assert_allclose(scene_bounds(scene)[1][:2], [math.sqrt(2.0)] * 2, rtol=1e-6)
    matrix = scene.shapes[0].transform.matrix
    assert matrix is not None and matrix[1][0] == pytest.approx(half)


def test_morph_targets(tmp_path: Path) -> None:
    model = Model()
    mesh = model.quad()
    primitive = model.root["meshes"][mesh]["primitives"][0]
    primitive["targets"] = [{"POSITION": model.accessor([(0, 0, i)] * 4)} for i in (1, 10)]
    model.root["meshes"][mesh]["weights"] = [0.5, 0.0]
    model.node(mesh=mesh)
    moved = model.node(mesh=mesh, weights=[0.0, 1.0])
    animated(model, moved, "weights", [0.0, 1.0], [1, 0, 0, 2])
    for seconds, (first, second) in {None: (0.5, 10.0), 0.0: (0.5, 1.0), 1.0: (0.5, 20.0)}.items():
        scene = loaded(tmp_path, model, time_at=seconds)
        found = [float(scene.mesh(i).vertices[0, 2]) for i in (0, 1)]
        np.testing.assert_allclose(found, [first, second])


def test_a_skin_carries_vertices_by_its_joints_not_by_its_node(tmp_path: Path) -> None:
    model = Model()
    joints = np.zeros((4, 4))
    joints[2:, 0] = 1
    mesh = model.quad(WEIGHTS_0=[(1, 0, 0, 0)] * 4, NORMAL=[(0, 0, 1)] * 4)
    model.root["meshes"][mesh]["primitives"][0]["attributes"]["JOINTS_0"] = model.accessor(joints, "uint8")
    # Bound while the second joint was at y = 1; it has since turned by 90 degrees about x
    bound = np.array([np.eye(4), [[1, 0, 0, 0], [0, 1, 0, -1], [0, 0, 1, 0], [0, 0, 0, 1]]])
    inverse = model.accessor(bound.transpose(0, 2, 1).reshape(2, 16))
    half = math.sqrt(0.5)
    skin = model.add("skins", {"joints": [1, 2], "inverseBindMatrices": inverse})
    model.node(mesh=mesh, skin=skin, translation=[100, 0, 0])
    model.node()
    model.node(translation=[0, 1, 0], rotation=[half, 0, 0, half])
    scene = loaded(tmp_path, model)
    np.testing.assert_allclose(scene.mesh(0).vertices, [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], atol=1e-6)
    np.testing.assert_allclose(scene_bounds(scene), [(-1, -1, 0), (1, 1, 0)], atol=1e-6)
    normals = scene.mesh(0).normals
    assert normals is not None
    np.testing.assert_allclose(normals, [(0, 0, 1)] * 2 + [(0, -1, 0)] * 2, atol=1e-6)


def test_morph_targets_of_colours_and_coordinates(tmp_path: Path) -> None:
    model = Model()
    texture = model.texture([[[255, 0, 0], [0, 255, 0]]])
    material = model.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    mesh = model.quad(material, COLOR_0=[(1, 0, 0, 1)] * 4)
    more = {"COLOR_0": model.accessor([(-2, 1, 0)] * 4), "TEXCOORD_0": model.accessor([(0.5, 0.25)] * 4)}
    model.root["meshes"][mesh] |= {"weights": [0.5]}
    model.root["meshes"][mesh]["primitives"][0]["targets"] = [more]
    moved = model.node(mesh=mesh)
    found = loaded(tmp_path, model).mesh(0)
    assert found.colors is not None and found.uvs is not None
    np.testing.assert_allclose(found.colors, np.broadcast_to([0.0, 0.5, 0.0], (2, 3, 3)))
    np.testing.assert_allclose(found.uvs[0], [(0.25, -0.125), (1.25, -0.125), (1.25, 0.875)])
    animated(model, moved, "weights", [0.0, 1.0], [0, 1])
    assert any("colours and texture coordinates" in each for each in loaded(tmp_path, model, shutter=(0.0, 1.0)).notes)


def hung(model: Model, mesh: int, **bone: Any) -> int:
    """A node with a mesh that hangs on one joint; the joint."""
    joint = model.node(**bone)
    primitive = model.root["meshes"][mesh]["primitives"][0]
    primitive["attributes"] |= {
        "JOINTS_0": model.accessor(np.zeros((4, 4)), "uint8"),
        "WEIGHTS_0": model.accessor([(1, 0, 0, 0)] * 4),
    }
    model.node(mesh=mesh, skin=model.add("skins", {"joints": [joint]}))
    return joint


def fronts(mesh: Any) -> Any:
    """z of the normals of triangles."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)[:, 2]


def test_a_joint_that_mirrors_leaves_fronts_in_front(tmp_path: Path) -> None:
    """As a node that mirrors does; colours stay with their vertices, and poses have the same triangles."""
    model = Model()
    joint = hung(model, model.quad(COLOR_0=[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]), scale=[-1, 1, 1])
    found = loaded(tmp_path, model).mesh(0)
    assert (fronts(found) > 0.0).all() and found.colors is not None
    corners = found.vertices[found.triangles]
    np.testing.assert_allclose(found.colors[..., :2], (corners[..., :2] * [-1.0, 1.0] + 1.0) / 2.0)
    animated(model, joint, "scale", [0.0, 1.0], [(-1, 1, 1), (-2, 1, 1)])
    scene = loaded(tmp_path, model, shutter=(0.0, 1.0))
    shape = scene.shapes[0]
    assert isinstance(shape, Mesh) and shape.poses
    assert all((fronts(each) > 0.0).all() for each in pose_meshes(scene, ("shapes", 0), shape))
    turned = Model()
    joint = hung(turned, turned.quad(), scale=[1, 1, 1])
    animated(turned, joint, "scale", [0.0, 1.0], [(1, 1, 1), (-1, 1, 1)])
    scene = loaded(tmp_path, turned, shutter=(0.0, 1.0))
    assert isinstance(scene.shapes[0], Mesh) and not scene.shapes[0].poses
    assert any("changes its form" in note for note in scene.notes)


def test_what_is_scaled_to_zero_on_its_way_still_moves(tmp_path: Path) -> None:
    """So animations hide things: a mesh, a skinned one, a camera and a light."""
    model = Model()
    model.extend("KHR_lights_punctual")
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "spot"}]}}
    model.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.6, "znear": 0.01}})
    parts: list[Any] = [{"mesh": model.quad()}, {"camera": 0}, {"extensions": {"KHR_lights_punctual": {"light": 0}}}]
    parent = model.node(children=[model.add("nodes", each) for each in parts], scale=[1, 1, 1])
    joint = hung(model, model.quad(NORMAL=[(0, 0, 1)] * 4))
    sampler = {"input": model.times([0.0, 0.5, 1.0]), "output": model.accessor([(1, 1, 1), (0, 0, 0), (1, 2, 1)])}
    steps = {"input": model.times([0.0, 1.0]), "output": model.accessor([(0, 0, 0), (4, 0, 0)])}
    channels = [
        {"sampler": sampler, "target": {"node": node, "path": path}}
        for node in (parent, joint)
        for sampler, path in enumerate(("scale", "translation"))
    ]
    model.add("animations", {"samplers": [sampler, steps], "channels": channels})
    for time in (0.0, 0.5):  # the second time the image is of the moment at which nothing is seen
        scene = loaded(tmp_path, model, time_at=time, shutter=(-time, 1.0 - time))
        assert not [note for note in scene.notes if "candela" not in note and "animation" not in note]
        moved, skinned = scene.shapes
        at = next(key for key in moved.motion if key.time == 0.5)
        assert at.matrix is not None and 0.0 < at.matrix[0][0] < 1e-3 and at.matrix[0][3] == 2.0
        assert moved.motion[-1].matrix == ((1, 0, 0, 4), (0, 2, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
        assert isinstance(skinned, Mesh) and len(skinned.poses) == 17
        middle = pose_meshes(scene, ("shapes", 1), skinned)[8]
        np.testing.assert_allclose(middle.vertices, [(2, 0, 0)] * 4, atol=1e-3)
        assert middle.normals is not None and (middle.normals[:, 2] > 0.0).all()
        light: Any = scene.lights[0]
        assert len(scene.camera.motion) == len(light.motion) == len(moved.motion)
        assert scene.camera.motion[-1].position == pytest.approx((4.0, 0.0, 0.0))


def test_what_grows_from_a_point_is_not_left_out(tmp_path: Path) -> None:
    model = Model()
    mesh = model.quad(POSITION=[(0, 0, 0)] * 4)
    model.root["meshes"][mesh]["primitives"][0]["targets"] = [{"POSITION": model.accessor(QUAD)}]
    node = model.node(mesh=mesh, weights=[0.0])
    model.node(mesh=model.quad())
    animated(model, node, "weights", [0.0, 1.0], [0, 1])
    scene = loaded(tmp_path, model, shutter=(0.0, 1.0))
    assert flatten(scene, 8, 8).triangle_count == 4 and not any("area" in note for note in scene.notes)
    assert any("no triangle with an area" in note for note in loaded(tmp_path, model, time_at=0.0).notes)


def test_what_becomes_its_mirror_image_on_its_way_rests_and_it_is_said(tmp_path: Path) -> None:
    model = Model()
    node = model.node(mesh=model.quad(), scale=[1, 1, 1])
    animated(model, node, "scale", [0.0, 1.0], [(1, 1, 1), (-0.5, 1, 1)])
    scene = loaded(tmp_path, model, shutter=(0.0, 1.0))
    assert not scene.shapes[0].motion
    assert any("/nodes/0 rests while the shutter is open: on its way it becomes its mirror" in n for n in scene.notes)


def test_a_step_is_a_jump_while_the_shutter_is_open(tmp_path: Path) -> None:
    model = Model()
    node = model.node(mesh=model.quad(), translation=[0, 0, 0])
    animated(model, node, "translation", [0.0, 0.5], [(0, 0, 0), (1, 0, 0)], "STEP")
    keys = loaded(tmp_path, model, shutter=(0.0, 1.0)).shapes[0].motion
    last = max(key.time for key in keys if key.matrix is not None and key.matrix[0][3] == 0.0)
    assert 0.499999 < last < 0.5 and min(key.time for key in keys if key.time > last) == 0.5


def waving(tmp_path: Path, kind: str) -> Model:
    """A quad that a joint bends, or a morph target lifts, in the first second."""
    model = Model()
    if kind == "skin":
        colors = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
        mesh = model.quad(WEIGHTS_0=[(1, 0, 0, 0)] * 4, NORMAL=[(0, 0, 1)] * 4, COLOR_0=colors)
        joints = np.zeros((4, 4))
        joints[2:, 0] = 1
        model.root["meshes"][mesh]["primitives"][0]["attributes"]["JOINTS_0"] = model.accessor(joints, "uint8")
        skin = model.add("skins", {"joints": [1, 2]})
        model.node(mesh=mesh, skin=skin)
        model.node()
        bone, half = model.node(), math.sqrt(0.5)
        animated(model, bone, "rotation", [0.0, 1.0], [(0, 0, 0, 1), (half, 0, 0, half)])
        return model
    mesh = model.quad()
    model.root["meshes"][mesh]["primitives"][0]["targets"] = [{"POSITION": model.accessor([(0, 0, 1), (0, 0, 0)] * 2)}]
    moved = model.node(mesh=mesh, weights=[0.0])
    animated(model, moved, "weights", [0.0, 1.0], [0, 2])
    return model


@for_each("kind", ["skin", "morph"])
def test_meshes_change_their_form_while_the_shutter_is_open(tmp_path: Path, kind: str) -> None:
    """At the times of poses they are those of that moment; what rests has none."""
    model = waving(tmp_path, kind)
    scene = loaded(tmp_path, model, time_at=0.25, shutter=(0.0, 0.5))
    shape = scene.shapes[0]
    assert isinstance(shape, Mesh) and not shape.motion and not any("changes its form" in note for note in scene.notes)
    assert [pose.time for pose in shape.poses][:: len(shape.poses) - 1] == [0.25, 0.75] and len(shape.poses) == 9
    for number in (0, 4, 8):
        there = loaded(tmp_path, model, time_at=shape.poses[number].time).mesh(0)
        mesh = pose_meshes(scene, ("shapes", 0), shape)[number]
        np.testing.assert_allclose(mesh.vertices, there.vertices, atol=1e-6)
        assert (mesh.normals is None) == (there.normals is None)
    late = loaded(tmp_path, model, time_at=2.0, shutter=(0.0, 0.5)).shapes[0]
    assert isinstance(late, Mesh) and not late.poses
    again = scene_from_portable(*scene_to_portable(scene))
    assert again.sha256() == scene.sha256()
    files = exported(scene, "s-files")
    with files.written(tmp_path / "s.json"):
        (tmp_path / "s.json").write_bytes(scene_text(files.description, ".json", "s"))
    assert clrender.load(tmp_path / "s.json").sha256() == scene.sha256()
    flat = [flatten(each, 8, 8) for each in (scene, loaded(tmp_path, model))]
    assert [each.features.deformation for each in flat] == [True, False]


# --- materials -------------------------------------------------------------------------------------------------------


def test_the_default_material_is_a_rough_metal(tmp_path: Path) -> None:
    model = Model()
    model.node(mesh=model.quad())
    made = loaded(tmp_path, model).materials["default"].model_dump()
    assert (made["base_color"], made["metallic"], made["roughness"]) == ((1.0, 1.0, 1.0), 1.0, 1.0)


def test_extensions_of_materials(tmp_path: Path) -> None:
    made = material(
        tmp_path,
        {
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.1, 0.2, 0.3, 1.0],
                "metallicFactor": 0.25,
                "roughnessFactor": 0.5,
            },
            "emissiveFactor": [1.0, 0.5, 0.0],
            "extensions": {
                "KHR_materials_emissive_strength": {"emissiveStrength": 8.0},
                "KHR_materials_ior": {"ior": 1.7},
                "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [0.5, 1.0, 2.0]},
                "KHR_materials_clearcoat": {"clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.125},
                "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.2, 0.4], "sheenRoughnessFactor": 0.6},
                "KHR_materials_anisotropy": {"anisotropyStrength": 0.4, "anisotropyRotation": math.pi / 2},
                "KHR_materials_transmission": {"transmissionFactor": 0.9},
                "KHR_materials_volume": {
                    "thicknessFactor": 1.0,
                    "attenuationDistance": 2.0,
                    "attenuationColor": [0, 0.5, 1],
                },
            },
        },
    )
    assert made.base_color == (0.1, 0.2, 0.3) and (made.metallic, made.roughness, made.ior) == (0.25, 0.5, 1.7)
    assert made.emission == (1.0, 0.5, 0.0) and made.emission_strength == 8.0
    assert made.specular == 0.5 and made.specular_color == (0.5, 1.0, 1.0)
    assert (made.coat, made.coat_roughness) == (0.75, 0.125)
    assert made.sheen_color == (0.1, 0.2, 0.4) and made.sheen_roughness == 0.6
    assert made.anisotropy == 0.4 and made.anisotropy_rotation == pytest.approx(90.0)
    assert made.transmission == 0.9 and not made.thin
    assert made.attenuation_color == (0.001, 0.5, 1.0) and made.attenuation_distance == 2.0


def test_a_leaf_lets_diffuse_light_through(tmp_path: Path) -> None:
    leaf = {"diffuseTransmissionFactor": 0.6, "diffuseTransmissionColorFactor": [0.2, 0.4, 0.8]}
    made = material(tmp_path, {"extensions": {"KHR_materials_diffuse_transmission": leaf}})
    assert made.diffuse_transmission == 0.6
    assert made.diffuse_transmission_color == (0.2, 0.4, 0.8)
    assert not made.solid


def test_a_leaf_has_no_inside(tmp_path: Path) -> None:
    model = Model()
    sheet, volume = "KHR_materials_diffuse_transmission", "KHR_materials_volume"
    model.extend(sheet, volume)
    inside = {"thicknessFactor": 1.0, "attenuationColor": [1.0, 0.1, 0.1], "attenuationDistance": 0.5}
    source = {"extensions": {sheet: {"diffuseTransmissionFactor": 0.5}, volume: inside}}
    model.node(mesh=model.quad(model.add("materials", source)))
    assert any(f"{volume} was left out" in note for note in loaded(tmp_path, model).notes)


def test_what_has_an_inside_is_no_leaf(tmp_path: Path) -> None:
    extensions = {
        "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.6},
        "KHR_materials_transmission": {"transmissionFactor": 0.9},
        "KHR_materials_volume": {"thicknessFactor": 1.0},
    }
    model = Model()
    model.extend(*extensions)
    model.node(mesh=model.quad(model.add("materials", {"extensions": extensions})))
    scene = loaded(tmp_path, model)
    assert scene.materials["material 0"].model_dump()["diffuse_transmission"] == 0.0
    assert any("KHR_materials_diffuse_transmission was left out" in note for note in scene.notes)


def test_glass_without_thickness_is_thin(tmp_path: Path) -> None:
    glass: dict[str, Any] = {"KHR_materials_transmission": {"transmissionFactor": 1.0}}
    assert material(tmp_path, {"extensions": glass}).thin
    glass["KHR_materials_volume"] = {"thicknessFactor": 0.0, "attenuationDistance": 1.0, "attenuationColor": [0, 0, 0]}
    made = material(tmp_path, {"extensions": glass})
    assert made.thin and made.attenuation_color is None


@pytest.mark.parametrize(
    "dispersion, abbe",
    [(0.0, None), (0.1, 200.0), (0.36, 20.0 / 0.36), (1e3, 1.0)],
    ids=["none", "little", "glass", "most"],
)
def test_dispersion_is_twenty_over_the_abbe_number(tmp_path: Path, dispersion: float, abbe: float | None) -> None:
    extensions: dict[str, Any] = {
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_volume": {"thicknessFactor": 1.0},
        "KHR_materials_ior": {"ior": 1.6},
        "KHR_materials_dispersion": {"dispersion": dispersion},
    }
    made = material(tmp_path, {"extensions": extensions})
    assert made.ior == 1.6 and (made.dispersion is None) == (abbe is None)
    if made.dispersion is not None:
        assert made.dispersion.abbe == pytest.approx(abbe)


def test_a_file_whose_walls_are_thin_may_name_a_dispersion(tmp_path: Path) -> None:
    extensions: dict[str, Any] = {
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_dispersion": {"dispersion": 0.5},
    }
    assert material(tmp_path, {"extensions": extensions}).thin


def test_iridescence_is_a_film_of_its_largest_thickness(tmp_path: Path) -> None:
    film: dict[str, Any] = {"iridescenceFactor": 0.7, "iridescenceIor": 1.8, "iridescenceThicknessMaximum": 350.0}
    made = material(tmp_path, {"extensions": {"KHR_materials_iridescence": film}})
    assert (made.iridescence, made.iridescence_ior, made.iridescence_thickness) == (0.7, 1.8, 350.0)
    plain = material(tmp_path, {"extensions": {"KHR_materials_iridescence": {"iridescenceFactor": 1.0}}})
    assert (plain.iridescence, plain.iridescence_ior, plain.iridescence_thickness) == (1.0, 1.3, 400.0)
    none = material(tmp_path, {"extensions": {"KHR_materials_iridescence": {"iridescenceIor": 1.8}}})
    assert not none.filmed


def test_a_film_may_vary_and_what_none_is_like_is_cut_off(tmp_path: Path) -> None:
    model = Model()
    picture = model.texture(np.zeros((2, 2, 3)), {"wrapS": 33071})
    film = {
        "iridescenceFactor": 0.5,
        "iridescenceTexture": {"index": picture},
        "iridescenceIor": 9.0,
        "iridescenceThicknessMaximum": 2e4,
        "iridescenceThicknessTexture": {"index": picture},
    }
    model.extend("KHR_materials_iridescence")
    source = {"extensions": {"KHR_materials_iridescence": film}}
    model.node(mesh=model.quad(model.add("materials", source)))
    scene = loaded(tmp_path, model)
    made = scene.materials["material 0"]
    assert isinstance(made, Principled) and made.iridescence_ior == 5.0
    share, thickness = made.iridescence, made.iridescence_thickness
    assert isinstance(share, ImageTexture) and isinstance(thickness, ThicknessMap)
    assert (share.channel, share.scale, share.wrap) == ("r", (0.5,) * 3, ("clamp", "repeat"))
    assert (thickness.channel, thickness.range, thickness.wrap) == ("g", (100.0, 1e4), ("clamp", "repeat"))
    assert sum("KHR_materials_iridescence" in note for note in scene.notes) == 2


def test_textures_have_their_channels_samplers_and_sets(tmp_path: Path) -> None:
    model = Model()
    near = model.texture(np.zeros((2, 2, 4)), {"magFilter": 9728, "wrapS": 33071, "wrapT": 33648})
    plain = model.texture(np.zeros((2, 2, 3)))
    base = {
        "baseColorTexture": {"index": near, "texCoord": 1},
        "baseColorFactor": [0.5, 0.25, 1.0, 0.5],
        "metallicRoughnessTexture": {"index": plain},
        "metallicFactor": 0.5,
    }
    source = {"pbrMetallicRoughness": base, "normalTexture": {"index": plain, "scale": -2.0}, "alphaMode": "BLEND"}
    model.node(mesh=model.quad(model.add("materials", source), TEXCOORD_1=((0, 1), (0, 0), (1, 0), (1, 1))))
    scene = loaded(tmp_path, model)
    made = scene.materials["material 0"]
    assert isinstance(made, Principled)
    color, metal, rough, opacity, normal = made.base_color, made.metallic, made.roughness, made.opacity, made.normal_map
    assert isinstance(color, ImageTexture) and isinstance(metal, ImageTexture) and isinstance(rough, ImageTexture)
    assert isinstance(opacity, ImageTexture) and isinstance(normal, NormalMap)
    assert color.uv_set == 1 and color.wrap == ("clamp", "mirror") and color.filter == "nearest"
    assert color.scale == (0.5, 0.25, 1.0) and color.color_space == "srgb"
    assert (metal.channel, rough.channel, metal.scale, rough.scale) == ("b", "g", (0.5,) * 3, (1.0,) * 3)
    assert (opacity.channel, opacity.scale, normal.scale) == ("a", (0.5,) * 3, -2.0)
    assert metal.color_space == rough.color_space == "linear" and made.opacity_cutoff is None
    second = scene.mesh(0).uvs_1
    assert second is not None
    np.testing.assert_array_equal(second[0], [(0, 0), (0, 1), (1, 1)])


@for_each(
    ("alpha", "mode", "cutoff", "opacity", "kept_cutoff"),
    [
        (0.25, "OPAQUE", None, 1.0, None),
        (0.25, "BLEND", None, 0.25, None),
        (0.25, "MASK", None, 0.0, None),
        (0.25, "MASK", 0.25, 1.0, None),
        (1.0, "MASK", 1.5, 0.0, None),
    ],
)
def test_modes_of_alpha(
    tmp_path: Path, alpha: float, mode: str, cutoff: float | None, opacity: float, kept_cutoff: float | None
) -> None:
    source: dict[str, Any] = {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, alpha]}}
    if cutoff is not None:
        source["alphaCutoff"] = cutoff
    made = material(tmp_path, source)
    assert (made.opacity, made.opacity_cutoff) == (opacity, kept_cutoff)


def test_webp_and_its_fallback(tmp_path: Path) -> None:
    model = Model()
    model.extend("EXT_texture_webp", required=True)
    webp = model.add("images", {"uri": picture_uri([[[255, 0, 0]]], "WEBP")})
    png = model.add("images", {"uri": picture_uri([[[0, 255, 0]]])})
    texture = model.add("textures", {"source": png, "extensions": {"EXT_texture_webp": {"source": webp}}})
    base = {"baseColorTexture": {"index": texture}}
    model.node(mesh=model.quad(model.add("materials", {"pbrMetallicRoughness": base})))
    color = loaded(tmp_path, model).materials["material 0"].model_dump()["base_color"]
    assert color["texture"] == f"/images/{webp}"


def test_variants_by_name(tmp_path: Path) -> None:
    model = Model()
    model.extend("KHR_materials_variants")
    names = [{"name": "night"}, {"name": "day"}]
    model.root["extensions"] = {"KHR_materials_variants": {"variants": names}}
    mesh = model.quad(model.add("materials", {"name": "first"}))
    bright = model.add("materials", {"name": "bright"})
    mapping = {"variants": [1], "material": bright}
    primitive = model.root["meshes"][mesh]["primitives"][0]
    primitive["extensions"] = {"KHR_materials_variants": {"mappings": [mapping]}}
    model.node(mesh=mesh)
    for variant, name in ((None, "first"), ("night", "first"), ("day", "bright")):
        assert loaded(tmp_path, model, variant=variant).shapes[0].material == name
    with pytest.raises(SceneError, match='no variant "dya"; did you mean "day"'):
        loaded(tmp_path, model, variant="dya")
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match=r"takes no variant, which is for \.gltf and \.glb"):
        clrender.load(tmp_path / "a.obj", variant="day")


# --- cameras and lights ----------------------------------------------------------------------------------------------


def test_the_first_camera_of_the_scene(tmp_path: Path) -> None:
    model = Model()
    model.node(mesh=model.quad())
    flat = {"xmag": 2.0, "ymag": 1.0, "znear": 0.1, "zfar": 9.0}
    model.add("cameras", {"type": "orthographic", "orthographic": flat})
    model.add("cameras", {"type": "perspective", "perspective": {"yfov": math.pi / 3, "znear": 1, "aspectRatio": 0.5}})
    half = math.sqrt(0.5)
    model.node(camera=1, translation=[0, 0, 4])
    model.node(camera=0, translation=[5, 0, 0], rotation=[0, half, 0, half])
    scene = loaded(tmp_path, model)
    assert scene.camera.type == "perspective" and scene.camera.vertical_fov == pytest.approx(60.0)
    assert (scene.image.width, scene.image.height) == (400, 800)
    assert scene.camera.position == (0, 0, 4) and scene.camera.target == (0, 0, 0)
    assert any("it has 2 cameras" in note for note in scene.notes)
    model.root["scenes"][0]["nodes"].remove(1)
    camera: Camera = loaded(tmp_path, model).camera
    assert camera.type == "orthographic" and camera.height == 2.0
    np.testing.assert_allclose(camera.target, (0, 0, 0), atol=1e-12)


def test_punctual_lights(tmp_path: Path) -> None:
    """683 candela are 1 W/sr; a spot of 60 degrees from edge to edge, fully lit within 30."""
    model = Model()
    model.extend("KHR_lights_punctual")
    spot = {"innerConeAngle": math.radians(15.0), "outerConeAngle": math.radians(30.0)}
    lights = [
        {"type": "point", "intensity": 683.0, "color": [1.0, 0.5, 0.0]},
        {"type": "directional", "intensity": 1366.0},
        {"type": "spot", "intensity": 68.3, "spot": spot},
    ]
    model.root["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    half = math.sqrt(0.5)
    for light in range(3):
        extensions = {"KHR_lights_punctual": {"light": light}}
        model.node(translation=[0, light, 0], rotation=[-half, 0, 0, half], extensions=extensions)  # shine down
    model.node(mesh=model.quad())
    point, sun, lamp = loaded(tmp_path, model).lights
    assert isinstance(point, PointLight) and isinstance(sun, DirectionalLight) and isinstance(lamp, SpotLight)
    assert point.intensity == (1.0, 0.5, 0.0) and lamp.position == (0, 2, 0)
    np.testing.assert_allclose([sun.direction, lamp.direction], [(0, -1, 0)] * 2, atol=1e-12)
    assert sun.irradiance == (2.0, 2.0, 2.0) and lamp.intensity == pytest.approx((0.1,) * 3)
    assert lamp.cone_degrees == pytest.approx(60.0)
    edge, inner = math.cos(math.radians(30.0)), math.cos(math.radians(15.0))
    assert lamp.blend == pytest.approx((inner - edge) / (1.0 - edge))


# --- notes and refusals ----------------------------------------------------------------------------------------------


def test_models_without_light_take_another_environment(tmp_path: Path) -> None:
    model = Model()
    model.node(mesh=model.quad(model.add("materials", {"emissiveFactor": [1, 1, 1]})))
    scene = loaded(tmp_path, model)
    assert sum("there is no light in it" in note for note in scene.notes) == 1 and scene.environment is not None
    write_image(tmp_path / "sky.hdr", np.ones((8, 16, 3), np.float32), {})
    lit = loaded(tmp_path, model, environment=tmp_path / "sky.hdr")
    assert len(lit.lights) == 1 and lit.environment is not None and lit.environment.file == str(tmp_path / "sky.hdr")
    assert not any("no light" in note for note in lit.notes)
    with pytest.raises(SceneError, match="is an environment already"):
        lit.with_environment(tmp_path / "sky.hdr")
    even = loaded(tmp_path, model, environment=0.5)
    assert even.environment is not None and even.environment.radiance == (0.5, 0.5, 0.5)
    for wrong in (-1.0, math.nan, math.inf):
        with pytest.raises(SceneError, match="a radiance must be from 0"):
            scene.with_environment(wrong)


REQUIRED = {
    "KHR_lights_image_based": "--environment FILE",
    "EXT_lights_image_based": "--environment FILE",
    "ACME_unheard_of": "that extension is not known",
}


@for_each("name", REQUIRED)
def test_required_extensions_are_refused_by_name(tmp_path: Path, name: str) -> None:
    model = Model()
    model.node(mesh=model.quad())
    model.extend(name)
    assert any(name in note for note in loaded(tmp_path, model).notes)
    model.root["extensionsRequired"] = [name]
    with pytest.raises(SceneError, match=f'm.glb: /extensionsRequired/0 is "{name}".*{REQUIRED[name]}'):
        loaded(tmp_path, model)


def _broken(change: Callable[[dict[str, Any]], Any]) -> Model:
    model = Model()
    model.node(mesh=model.quad())
    change(model.root)
    return model


@for_each(
    ("change", "words"),
    [
        (lambda r: r["accessors"][0].update(count=5), "/accessors/0 needs 60 bytes"),
        (lambda r: r["accessors"][0].update(type="VEC4"), "/accessors/0 needs 64 bytes"),
        (lambda r: r["accessors"][0].update(max=[0.5, 1, 0]), "/accessors/0/max/0 is 0.5, but there is a number 1"),
        (lambda r: r["nodes"][0].update(mesh=True), "/nodes/0/mesh is true, but must be a whole number"),
        (lambda r: r["nodes"][0].update(mesh=7), "/nodes/0/mesh is 7, but of meshes there are only 1"),
        (lambda r: r["nodes"][0].update(children=[0]), "/nodes/0/children/0 names node 0, which is itself"),
        (lambda r: r["nodes"][0].update(scale=[1, 2]), "/nodes/0/scale has 2 entries, but must have at least 3"),
        (lambda r: r["nodes"][0].update(matrix=[0.0] * 16), "/nodes/0/matrix has a last row"),
        (lambda r: r["nodes"][0].update(translation=[1e13, 0, 0]), "/nodes/0 is scaled or moved by more than"),
        (lambda r: r["accessors"][2].update(componentType=5126, count=3), "/indices must name whole numbers"),
        (lambda r: r["meshes"][0]["primitives"][0].update(indices=0), "/indices must name whole numbers"),
        (lambda r: r["meshes"][0]["primitives"][0]["attributes"].update(NORMAL=1), "/NORMAL is of type VEC2"),
        (lambda r: r["bufferViews"][0].update(byteLength=999), "/bufferViews/0/byteLength takes it to byte 999"),
        (lambda r: r["asset"].update(version="1.0"), '/asset/version is "1.0", but only glTF 2.0'),
        (lambda r: r.update(scene=3), "/scene is 3, but of scenes there are only 1"),
        (lambda r: r["nodes"][0].update(extensions={"A_B": {}}), "/nodes/0/extensions/A_B is an extension that"),
    ],
)
def test_faults_are_told_with_their_json_pointer(
    tmp_path: Path, change: Callable[[dict[str, Any]], Any], words: str
) -> None:
    with pytest.raises(SceneError) as error:
        loaded(tmp_path, _broken(change), strict=True)
    assert words in str(error.value) and str(error.value).startswith(str(tmp_path / "m.glb"))


def test_many_faults_take_no_time_and_few_notes(tmp_path: Path) -> None:
    """Twenty thousand flattened nodes, and a list whose last entry is there twice."""
    model = Model()
    quad = model.quad()
    for _ in range(20_000):
        model.node(mesh=quad, scale=[0, 0, 0])
    scene = loaded(tmp_path, model)
    assert scene.shapes == () and len(scene.notes) < 50 and any("19,961 more things" in note for note in scene.notes)
    model.root["scenes"][0]["nodes"].append(19_999)
    with pytest.raises(SceneError, match="/scenes/0/nodes/20000 is 19999, which is there already"):
        loaded(tmp_path, model, strict=True)


def test_indices_beyond_the_vertices(tmp_path: Path) -> None:
    model = _broken(lambda root: root)
    model.root["meshes"][0]["primitives"][0]["indices"] = model.accessor([0, 1, 4], "uint32")
    with pytest.raises(SceneError, match="/meshes/0/primitives/0/indices hold 4, but the mesh has only 4 vertices"):
        loaded(tmp_path, model, strict=True)


def test_numbers_that_are_not_finite(tmp_path: Path) -> None:
    model = Model()
    model.node(mesh=model.quad(NORMAL=[(0, 0, 1), (0, np.nan, 1), (0, 0, 1), (0, 0, 1)]))
    with pytest.raises(SceneError, match="/accessors/2 has a number in element 1 that is not finite"):
        loaded(tmp_path, model, strict=True)


def test_damaged_containers(tmp_path: Path) -> None:
    model = _broken(lambda root: root)
    whole = model.glb()
    path = tmp_path / "m.glb"
    for data, words in (
        (whole[:-5], "byte 8: the GLB says that it has"),
        (whole[:15], "byte 15: the GLB ends within its header"),
        (whole[:4] + b"\1" + whole[5:], "byte 4: GLB of version 1"),
        (whole[:12] + b"\xff\xff\xff\x7f" + whole[16:], "byte 12: the chunk of 2,147,483,647 bytes"),
        (b"[" * 100_000, "the JSON is nested too deeply"),
        (b'{"asset": NaN}', "NaN is no number of JSON"),
        (b'{"asset": ' + b"1" * 5000 + b"}", "a number that is too long"),
        (b'{"a": "\xff"}', "byte 7: the JSON is not UTF-8"),
        (b"\xff{}", 'byte 0: a GLB begins with "glTF", but this file does not'),
    ):
        path.write_bytes(data)
        with pytest.raises(SceneError) as error:
            clrender.load(path)
        assert words in str(error.value)


def test_files_outside_the_folder_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "a b.bin").write_bytes(bytes(4))
    root = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4, "uri": "../a%20b.bin"}]}
    path = tmp_path / "in" / "m.gltf"
    path.write_text(json.dumps(root))
    with pytest.raises(SceneError, match=r"/buffers/0/uri: .* lies outside the scene's own folder"):
        clrender.load(path)
    assert clrender.load(path, allow_paths=[tmp_path]).shapes == ()


@needs_assets
def test_the_files_of_the_khronos_validator() -> None:
    """Files with errors are refused with the place of one, or of what it names; those with warnings are read."""
    count = 0
    for path in sorted((ASSETS / "gltf-invalid").glob("*/*.gl[tb]*")):
        report = path.with_name(path.name + ".report.json")
        if path.suffix == ".json" or not report.is_file():
            continue
        count += 1
        messages = json.loads(report.read_text())["issues"]["messages"]
        wrong = [message.get("pointer", "").removesuffix("/") for message in messages if message["severity"] == 0]
        # Valid for a validator, but the bytes of what is to be drawn lie nowhere
        wrong += ["/buffers/0"] if path.stem in ("named_objects", "unused_objects") else []
        try:
            clrender.load(path, strict=True)
        except SceneError as error:
            place = str(error).removeprefix(f"{path}: ").split(" ")[0].rstrip(":")
            near = any(place.startswith(each.rsplit("/", 2)[0] if "/channels/" in each else each) for each in wrong)
            assert near and "\n" not in str(error) and len(str(error)) < 600, f"{path}: {error}: {wrong}"
        else:
            assert not wrong, f"{path} was read, but {wrong} is wrong"
    assert count >= 130
