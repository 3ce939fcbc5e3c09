"""Tangents of normal maps: by the method of MikkTSpace, as a glTF file gives them, and on their way to the kernels."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from gltf_files import QUAD, Model

import clrender
from clrender.errors import SceneError
from clrender.exporters.mesh_ply import write_ply
from clrender.flatten.surfaces import flat_surfaces
from clrender.importers.shared.tangents import mikktspace
from clrender.meshes.data import MeshData
from clrender.meshes.read import read_mesh
from clrender.scene.resting import resting

UP = (0.0, 0.0, 1.0)


def tangents(positions: Any, uvs: Any, triangles: Any, normals: Any = None) -> npt.NDArray[np.float32]:
    normals = [UP] * len(positions) if normals is None else normals
    places, around, flat = (np.array(each, np.float32) for each in (positions, normals, uvs))
    return mikktspace(places, around, flat, np.array(triangles, np.uint32))


def test_a_flat_picture_has_one_direction_and_a_mirrored_one_another_sign() -> None:
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    found = tangents(square, [(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)])
    np.testing.assert_allclose(found, np.broadcast_to([1, 0, 0, 1], (2, 3, 4)), atol=1e-7)
    found = tangents(square, [(1, 0), (0, 0), (0, 1), (1, 1)], [(0, 1, 2), (0, 2, 3)])
    np.testing.assert_allclose(found, np.broadcast_to([-1, 0, 0, -1], (2, 3, 4)), atol=1e-7)


def test_directions_around_a_vertex_count_by_their_angles() -> None:
    """Two triangles in a plane, of 90 and 45 degrees at the origin; u grows to the right on the first."""
    places = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (-1, 1, 0)]
    uvs = [(0, 0), (1, 0), (0, 1), (-2.0, 1.5)]
    found = tangents(places, uvs, [(0, 1, 2), (0, 2, 3)])
    b, c = np.array(places[2][:2], float), np.array(places[3][:2], float)
    (u1, v1), (u2, v2) = uvs[2], uvs[3]
    second = (v2 * b - v1 * c) * np.sign(u1 * v2 - u2 * v1)
    second /= np.hypot(*second)
    expected = math.radians(90.0) * np.array([1.0, 0.0]) + math.radians(45.0) * second
    expected /= np.hypot(*expected)
    np.testing.assert_allclose(found[0, 0, :2], expected, atol=1e-6)
    np.testing.assert_array_equal(found[0, 0], found[1, 0])
    np.testing.assert_allclose(found[0, 1, :2], (1.0, 0.0), atol=1e-6)  # only the first has that vertex
    at_the_end = math.radians(45.0) * np.array([1.0, 0.0]) + math.radians(90.0) * second
    np.testing.assert_allclose(found[0, 2, :2], at_the_end / np.hypot(*at_the_end), atol=1e-6)


def test_fans_end_where_pictures_are_mirrored_where_coordinates_differ_and_where_only_a_vertex_is_shared() -> None:
    bow = [(0, 0, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0)]
    uvs = [(0, 0), (1, -1), (1, 1), (0, 2), (-2, 0)]  # both the right way round, u in other directions
    first, second = tangents(bow, uvs, [(0, 1, 2), (0, 3, 4)])
    assert not np.allclose(first[0], second[0], atol=0.1)
    folded = tangents(
        [(0, 0, 0), (0, 1, 0), (-1, 0.5, 0), (1, 0, 0)], [(0, 0), (0, 1), (1, 0.5), (1, 0)], [(0, 1, 2), (0, 3, 1)]
    )
    np.testing.assert_allclose(folded[:, 0, 3], (-1, 1))
    np.testing.assert_allclose(folded[1, 0], (1, 0, 0, 1), atol=1e-7)
    np.testing.assert_allclose(folded[0, 0], (-1, 0, 0, -1), atol=1e-7)


def test_vertices_split_without_need_are_one() -> None:
    """A cylinder whose triangles share no vertices has the tangents of one whose triangles do."""
    around, up = np.meshgrid(np.linspace(0.0, math.pi, 9), np.linspace(0.0, 2.0, 4), indexing="ij")
    normals = np.stack([np.cos(around), np.zeros_like(up), np.sin(around)], -1).reshape(-1, 3).astype(np.float32)
    places = normals + np.stack([0 * up, up, 0 * up], -1).reshape(-1, 3).astype(np.float32)
    uvs = np.stack([1.0 - around / math.pi + 0.1 * up, up], -1).reshape(-1, 2).astype(np.float32)
    a = (np.arange(8)[:, None] * 4 + np.arange(3)).ravel()
    corners = np.concatenate([np.stack([a, a + 1, a + 5], 1), np.stack([a, a + 5, a + 4], 1)]).astype(np.uint32)
    shared = mikktspace(places, normals, uvs, corners)
    order = corners.ravel()
    split = mikktspace(places[order], normals[order], uvs[order], np.arange(len(order), dtype=np.uint32).reshape(-1, 3))
    np.testing.assert_array_equal(shared, split)
    np.testing.assert_allclose((shared[..., :3] * normals[corners]).sum(-1), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(shared[..., :3], axis=-1), 1.0, atol=1e-6)


def test_triangles_without_a_direction_take_that_of_their_neighbours() -> None:
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    found = tangents(square, [(0, 0), (1, 0), (1, 1), (1, 1)], [(0, 1, 2), (0, 2, 3)])
    np.testing.assert_allclose(found[1, :2], [(1, 0, 0, 1)] * 2, atol=1e-7)
    np.testing.assert_array_equal(found[1, 2, :3], 0.0)
    assert not tangents(square, [(0, 0)] * 4, [(0, 1, 2), (0, 2, 3)])[..., :3].any()


def mapped(model: Model, **attributes: Any) -> int:
    """A quad with normals and a normal map."""
    texture = model.texture([[[128, 128, 255]]])
    material = model.add("materials", {"normalTexture": {"index": texture}})
    return model.quad(material, NORMAL=[UP] * 4, **attributes)


def rows(scene: clrender.scene.Scene) -> npt.NDArray[np.float32]:
    """TANGENT_ROW_* of all triangles."""
    attributes = flat_surfaces(scene).attributes
    return attributes[attributes[:2, 14].view(np.uint32)][:, :10]


def test_tangents_of_a_file_reach_the_kernels_and_a_mirror_turns_their_sign(tmp_path: Path) -> None:
    model = Model()
    mesh = mapped(model, TANGENT=[(0, 1, 0, -1), (0, 1, 0, -1), (1, 0, 0, -1), (0, 1, 0, -1)])
    model.node(mesh=mesh, scale=[2, 3, 1])
    scene = clrender.load(model.write(tmp_path / "m.glb"))
    assert not any("tangent" in note.rpartition("m.glb: ")[2].lower() for note in scene.notes)
    np.testing.assert_allclose(rows(scene)[0], (0, 1, 0, 0, 1, 0, 1, 0, 0, -1), atol=1e-7)
    model.root["nodes"][0]["scale"] = [-2, 3, 1]
    mirrored = rows(clrender.load(model.write(tmp_path / "m.glb")))
    np.testing.assert_allclose(mirrored[0], (-1, 0, 0, 0, 1, 0, 0, 1, 0, 1), atol=1e-7)


def test_without_tangents_a_normal_map_gets_them_and_nothing_else_does(tmp_path: Path) -> None:
    model = Model()
    model.node(mesh=mapped(model))
    scene = clrender.load(model.write(tmp_path / "m.glb"))
    np.testing.assert_allclose(rows(scene), [(1, 0, 0) * 3 + (1,)] * 2, atol=1e-7)
    del model.root["materials"][0]["normalTexture"]
    assert clrender.load(model.write(tmp_path / "m.glb")).mesh(0).tangents is None
    model = Model()
    texture = model.texture([[[128, 128, 255]]])
    flat = model.quad(model.add("materials", {"normalTexture": {"index": texture}}), TANGENT=[(0, 1, 0, 1)] * 4)
    model.node(mesh=flat)  # without normals they are to be ignored
    scene = clrender.load(model.write(tmp_path / "m.glb"))
    assert scene.mesh(0).tangents is None and not flat_surfaces(scene).attributes[:, 14].any()


def test_tangents_run_along_a_picture_that_is_turned(tmp_path: Path) -> None:
    """By KHR_texture_transform, as if the coordinates themselves were."""
    model = Model()
    mesh = mapped(model)
    turn = {"KHR_texture_transform": {"rotation": np.pi / 2.0}}
    model.root["materials"][0]["normalTexture"]["extensions"] = turn
    model.root["extensionsUsed"] = ["KHR_texture_transform"]
    model.node(mesh=mesh)
    # u' = v, so that the picture's right is where v grows: down, as glTF counts
    np.testing.assert_allclose(
        rows(clrender.load(model.write(tmp_path / "m.glb"))), [(0, -1, 0) * 3 + (1,)] * 2, atol=1e-6
    )


def test_tangents_move_with_morph_targets_and_skins(tmp_path: Path) -> None:
    model = Model()
    mesh = mapped(model, TANGENT=[(1, 0, 0, 1)] * 4, WEIGHTS_0=[(1, 0, 0, 0)] * 4)
    primitive = model.root["meshes"][mesh]["primitives"][0]
    primitive["targets"] = [{"TANGENT": model.accessor([(-1, 1, 0)] * 4), "POSITION": model.accessor([(0, 0, 0)] * 4)}]
    node = model.node(mesh=mesh, weights=[1.0])
    scene = clrender.load(model.write(tmp_path / "m.glb"))
    np.testing.assert_allclose(rows(scene)[0], (0, 1, 0) * 3 + (1,), atol=1e-7)
    primitive["attributes"]["JOINTS_0"] = model.accessor(np.zeros((4, 4)), "uint8")
    half = math.sqrt(0.5)
    model.root["nodes"][node]["skin"] = model.add("skins", {"joints": [model.node(rotation=[0, 0, half, half])]})
    scene = clrender.load(model.write(tmp_path / "m.glb"))
    np.testing.assert_allclose(rows(scene)[0], (-1, 0, 0) * 3 + (1,), atol=1e-6)
    model.root["nodes"][1]["scale"] = [1, -1, 1]
    scene = clrender.load(model.write(tmp_path / "m.glb"))
    # Mirrored, its front stays its front: against z x (1, 0, 0) is down, as the mirrored bitangent is
    np.testing.assert_allclose(rows(scene)[0], (1, 0, 0) * 3 + (-1,), atol=1e-6)


def test_unsound_tangents(tmp_path: Path) -> None:
    model = Model()
    model.node(mesh=mapped(model, TANGENT=[(1, 0, 0, 0.5)] * 4))
    assert any(
        "TANGENT has a w that is neither 1 nor -1" in n for n in clrender.load(model.write(tmp_path / "m.glb")).notes
    )
    model = Model()
    model.node(mesh=mapped(model, TANGENT=[(1, 0, 0)] * 4))
    with pytest.raises(SceneError, match="/meshes/0/primitives/0/attributes/TANGENT is of type VEC3, but must be VEC4"):
        clrender.load(model.write(tmp_path / "m.glb"))


def test_mesh_files_keep_them(tmp_path: Path) -> None:
    given = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    corners = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
    mesh = MeshData(np.array(QUAD, np.float32), corners, tangents=given)
    assert mesh.sha256() != MeshData(mesh.vertices, corners).sha256()
    with (tmp_path / "a.ply").open("wb") as file:
        write_ply(file, mesh)
    assert read_mesh("a.ply", tmp_path, (), "test").sha256() == mesh.sha256()
    given[1, 2, 0] = np.inf
    with (tmp_path / "a.ply").open("wb") as file:
        write_ply(file, mesh)
    with pytest.raises(SceneError, match=r"a\.ply.*triangle 1 has a tangent that is not finite"):
        read_mesh("a.ply", tmp_path, (), "test")


def turned_sheet(*, given: bool, share: float, uvs: bool = True) -> clrender.scene.Scene:
    """A quad with tangents along x that turns by 90 degrees about z in a second; its poses may bring theirs."""
    sheet: dict[str, Any] = {"vertices": np.array(QUAD), "faces": [[0, 1, 2], [0, 2, 3]], "normals": np.array([UP] * 4)}
    sheet |= {"uvs": np.array(QUAD)[:, :2] / 2 + 0.5} if uvs else {}
    later = {**sheet, "vertices": np.array(QUAD) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])}
    along, across = (np.array([axis] * 4) for axis in ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0)))
    own = {**sheet, "tangents": along}
    poses = {"first": own if given else sheet, "last": {**later, "tangents": across} if given else later}
    shape = {"type": "mesh", "file": "own", "material": "brushed"}
    shape["poses"] = [{"time": 0.0, "file": "first"}, {"time": 1.0, "file": "last"}]  # type: ignore[assignment]
    material = {"type": "principled", "base_color": [0.5] * 3, "anisotropy": 0.5}
    camera = {"position": (0, 0, 4), "target": (0, 0, 0), "time": share}
    scene = clrender.Scene.model_validate({"camera": camera, "materials": {"brushed": material}, "shapes": [shape]})
    return resting(scene.with_arrays(meshes={"own": own, **poses}))


def test_tangents_of_a_form_are_those_of_its_moment() -> None:
    """Poses bring theirs; else they follow from the texture coordinates once vertices move."""
    np.testing.assert_allclose(rows(turned_sheet(given=True, share=1.0))[0], (0, 1, 0) * 3 + (1,), atol=1e-6)
    halfway = rows(turned_sheet(given=True, share=0.5))[0]
    np.testing.assert_allclose(halfway, (math.sqrt(0.5), math.sqrt(0.5), 0) * 3 + (1,), atol=1e-6)
    np.testing.assert_allclose(rows(turned_sheet(given=False, share=0.0))[0], (1, 0, 0) * 3 + (1,), atol=1e-6)
    assert turned_sheet(given=False, share=1.0).mesh(0).tangents is None
    assert turned_sheet(given=False, share=1.0, uvs=False).mesh(0).tangents is not None
