"""Faults of glTF files that leave no doubt: the image is the same, they are noted, and `strict` refuses the file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from gltf_files import Model, picture_uri

import clrender
from clrender.cli import main
from clrender.errors import SceneError

RED = np.full((2, 2, 3), (200, 30, 30), np.uint8)


def sound() -> Model:
    """Two quads below a moved node, one of them with a picture, and an animation of the other."""
    model = Model()
    model.add(
        "materials",
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": model.texture(RED)}, "metallicFactor": 1.0}},
    )
    one, two = model.quad(0, NORMAL=[(0, 0, 1)] * 4), model.quad()
    model.add("nodes", {"mesh": one, "translation": [0, 1, 0]})
    model.add("nodes", {"mesh": two, "rotation": [0, 0, 0, 1]})
    model.node(children=[0, 1], translation=[1, 2, 3])
    sampler = {"input": model.times([0.0, 1.0]), "output": model.accessor([(0, 0, 0), (0, 2, 0)])}
    model.add(
        "animations",
        {"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}]},
    )
    return model


def loaded(folder: Path, model: Model, **more: Any) -> clrender.Scene:
    return clrender.load(model.write(folder / "m.gltf"), time_at=0.5, **more)


def material(root: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = root["materials"][0]["pbrMetallicRoughness"]
    return found


FAULTS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "a number as version": (lambda r: r["asset"].update(version=2.0), "/asset/version is a number"),
    "a higher least version": (lambda r: r["asset"].update(minVersion="2.1"), "/asset/minVersion is above"),
    "a factor of 1.1": (
        lambda r: material(r).update(metallicFactor=1.1),
        "metallicFactor is 1.1, but must be from 0 to 1",
    ),
    "bounds that are off": (lambda r: r["accessors"][0].update(min=[0.5, 0, 0]), "/accessors/0/min/0 is 0.5"),
    "times without bounds": (
        lambda r: r["accessors"][r["animations"][0]["samplers"][0]["input"]].pop("max"),
        "/animations/0/samplers/0/input names an accessor without min and max",
    ),
    "an empty animation": (lambda r: r["animations"].append({"samplers": [], "channels": []}), "has no entries"),
    "an empty view": (lambda r: r["bufferViews"].append({"buffer": 0, "byteLength": 0}), "byteLength is 0"),
    "a child listed as root": (lambda r: r["scenes"][0]["nodes"].append(1), "names node 1, which is a child of node 2"),
    "a node listed twice": (lambda r: r["scenes"][0]["nodes"].append(2), "is 2, which is there already"),
    "two parents": (
        lambda r: (r["nodes"].append({"children": [0]}), r["scenes"][0]["nodes"].append(3)),
        "names node 0, which is a child",
    ),
    "an undeclared extension": (
        lambda r: material(r)["baseColorTexture"].update(extensions={"KHR_texture_transform": {"scale": [1, 1]}}),
        "extensionsUsed does not name",
    ),
    "a quaternion above 1": (lambda r: r["nodes"][1].update(rotation=[0, 0, 0, 1.001]), "is no rotation"),
    "a quaternion of zeros": (lambda r: r["nodes"][1].update(rotation=[0, 0, 0, 0]), "is no rotation"),
    "a matrix beside a move": (
        lambda r: r["nodes"][2].update(matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1], translation=[9, 9, 9]),
        "is given beside translation",
    ),
    "a skin without a mesh": (
        lambda r: (r.update(skins=[{"joints": [1]}]), r["nodes"][2].update(skin=0)),
        "/nodes/2/skin is given without a mesh",
    ),
}


@for_each("name", FAULTS)
def test_the_scene_is_that_of_the_sound_file(tmp_path: Path, name: str) -> None:
    change, words = FAULTS[name]
    wanted, model = loaded(tmp_path, sound()), sound()
    change(model.root)
    scene = loaded(tmp_path, model)
    assert scene.sha256() == wanted.sha256()
    assert any(words in note and note.endswith(": read all the same") for note in scene.notes), scene.notes
    with pytest.raises(SceneError, match=r"m\.gltf: /"):
        loaded(tmp_path, model, strict=True)


def test_faults_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = sound()
    material(model.root).update(metallicFactor=1.1, roughnessFactor=2.0, baseColorTexture={"index": 1})
    model.add("textures", {"source": model.add("images", {"uri": "none.png"})})
    path = model.write(tmp_path / "m.gltf")
    scene = clrender.load(path)
    assert scene.faults == {"forgiven": 2, "left_out": 1}
    assert scene.with_environment(2.0).faults == scene.faults and clrender.load("room").faults == {
        "forgiven": 0,
        "left_out": 0,
    }
    with pytest.raises(SystemExit) as end:
        main(["check", str(path), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert end.value.code == 0 and found["faults"] == scene.faults and found["triangles"] == 4
    assert sum("none.png" in each for each in found["messages"]) == 1 and found["scene_sha256"] == scene.sha256()


def test_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "m.gltf"
    path.write_bytes(b"\xef\xbb\xbf" + sound().gltf())
    assert clrender.load(path, time_at=0.5).sha256() == loaded(tmp_path, sound()).sha256()
    path.write_bytes(b"\xef\xbb\xbf" + sound().gltf())
    with pytest.raises(SceneError, match="byte order mark"):
        clrender.load(path, strict=True)


def test_data_between_multiples_of_four_bytes(tmp_path: Path) -> None:
    wanted, model = loaded(tmp_path, sound()), sound()
    view = model.root["bufferViews"][model.root["accessors"][0]["bufferView"]]
    data = bytes(model.data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]])
    model.data += b"\0" * (-len(model.data) % 4 + 2) + data
    view["byteOffset"] = len(model.data) - len(data)
    scene = loaded(tmp_path, model)
    assert scene.sha256() == wanted.sha256() and any("must be a multiple of 4" in note for note in scene.notes)


def test_a_last_row_with_a_rounding_error(tmp_path: Path) -> None:
    def moved(last: float) -> clrender.Scene:
        model = Model()
        model.node(mesh=model.quad(), matrix=[1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 3, 4, 5, last])
        return clrender.load(model.write(tmp_path / "m.gltf"))

    scene = moved(1.0 + 1e-6)
    assert scene.sha256() == moved(1.0).sha256() and any("only affine transforms" in note for note in scene.notes)
    with pytest.raises(SceneError, match="only affine transforms"):
        moved(1.1)


def test_an_animation_with_a_stride(tmp_path: Path) -> None:
    wanted, model = loaded(tmp_path, sound()), sound()
    accessor = model.root["accessors"][model.root["animations"][0]["samplers"][0]["output"]]
    rows = np.zeros((2, 5), "<f4")
    rows[:, :3] = (0, 0, 0), (0, 2, 0)
    accessor["bufferView"] = model.view(rows.tobytes(), byteStride=20)
    scene = loaded(tmp_path, model)
    assert scene.sha256() == wanted.sha256() and any("byteStride" in note for note in scene.notes)


@for_each("error", [1e-7, 1e-5])
def test_inverse_bind_matrices_with_rounding_errors(tmp_path: Path, error: float) -> None:
    def skinned(last: float) -> Model:
        model = Model()
        matrix = np.eye(4)
        matrix[3, 3] = last
        which, weights = model.accessor(np.zeros((4, 4)), "uint8"), [(1.0, 0, 0, 0)] * 4
        mesh = model.quad(WEIGHTS_0=weights)
        model.root["meshes"][mesh]["primitives"][0]["attributes"]["JOINTS_0"] = which
        model.add("skins", {"joints": [1], "inverseBindMatrices": model.accessor(matrix.T.reshape(1, 16))})
        model.node(mesh=mesh, skin=0)
        model.node(translation=[0, 1, 0])
        return model

    scene = clrender.load(skinned(1.0 + error).write(tmp_path / "a.gltf"))
    assert scene.sha256() == clrender.load(skinned(1.0).write(tmp_path / "b.gltf")).sha256()
    assert any("last row is not 0, 0, 0, 1" in note for note in scene.notes)
    with pytest.raises(SceneError, match="last row"):
        clrender.load(skinned(1.1).write(tmp_path / "c.gltf"))


@for_each("value", [math.nan, math.inf])
def test_normals_that_are_not_finite_are_those_of_the_triangles(tmp_path: Path, value: float) -> None:
    def quad(normal: tuple[float, float, float]) -> clrender.Scene:
        model = Model()
        model.node(mesh=model.quad(NORMAL=[normal, (0, 0, 1), (0, 0, 1), (0, 0, 1)]))
        return clrender.load(model.write(tmp_path / "m.glb"))

    scene = quad((0.0, value, 0.0))
    assert scene.sha256() == quad((0.0, 0.0, 0.0)).sha256()
    assert any("is not finite" in note for note in scene.notes)


@for_each("value", [math.nan, math.inf])
def test_triangles_with_a_corner_that_is_not_finite_are_left_out(tmp_path: Path, value: float) -> None:
    model = Model()
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, value, 0)]
    attributes = {
        "POSITION": model.accessor(points),
        "TEXCOORD_0": model.accessor([(0, 0), (1, value), (1, 1), (0, 1)]),
    }
    model.root["meshes"] = [
        {"primitives": [{"attributes": attributes, "indices": model.accessor([0, 1, 2, 0, 2, 3], "uint16")}]}
    ]
    model.node(mesh=0)
    path = model.write(tmp_path / "m.glb")
    scene = clrender.load(path)
    ((at, shape),) = scene.all_shapes()
    assert len(scene.mesh_of(at, shape).triangles) == 1  # type: ignore[arg-type]
    assert scene.faults == {"forgiven": 1, "left_out": 1}
    assert any("POSITION has a number in element 3 that is not finite" in note for note in scene.notes)
    with pytest.raises(SceneError, match="that is not finite"):
        clrender.load(path, strict=True)
    model.root["meshes"][0]["primitives"][0]["indices"] = model.accessor([0, 2, 3], "uint16")
    with pytest.raises(SceneError, match="POSITION has a number in element 3"):
        clrender.load(model.write(path))


def test_triangles_of_vertices_that_there_are_not(tmp_path: Path) -> None:
    model = Model()
    mesh = model.quad()
    model.root["meshes"][mesh]["primitives"][0]["indices"] = model.accessor([0, 1, 2, 65535, 2, 3], "uint16")
    model.node(mesh=mesh)
    scene = clrender.load(model.write(tmp_path / "m.glb"))
    ((at, shape),) = scene.all_shapes()
    assert len(scene.mesh_of(at, shape).triangles) == 1  # type: ignore[arg-type]
    assert any("hold 65535" in note and note.endswith(": left out") for note in scene.notes)


def test_pictures_that_are_missing(tmp_path: Path) -> None:
    """Grey in the place of colours, nothing in that of numbers, and another scene than one without a picture."""
    model = sound()
    lost = model.add("textures", {"source": model.add("images", {"uri": "none.png"})})
    model.root["materials"][0] |= {
        "normalTexture": {"index": lost},
        "emissiveTexture": {"index": lost},
        "emissiveFactor": [1, 1, 1],
    }
    material(model.root).update(
        baseColorTexture={"index": lost}, metallicRoughnessTexture={"index": lost}, baseColorFactor=[1, 0.5, 0.5, 1]
    )
    scene = loaded(tmp_path, model)
    made = scene.materials["material 0"].model_dump()
    assert (
        made["base_color"] == (0.5, 0.25, 0.25) and made["normal_map"] is None and made["emission"] == (0.0, 0.0, 0.0)
    )
    assert made["metallic"] == 1.0
    notes = [note for note in scene.notes if "none.png" in note]
    assert len(notes) == 1 and notes[0].endswith("does not exist (no such file); check its name and folder: left out")
    with pytest.raises(SceneError, match=r"none\.png.*does not exist"):
        loaded(tmp_path, model, strict=True)


@for_each("kind", ["BMP", "GIF", "TGA", "TIFF"])
def test_pictures_of_other_kinds(tmp_path: Path, kind: str) -> None:
    wanted, model = loaded(tmp_path, sound()), sound()
    model.root["images"][0]["uri"] = picture_uri(RED, kind)
    scene = loaded(tmp_path, model)
    assert scene.sha256() == wanted.sha256()
    assert any("not in PNG, JPEG or WebP" in note for note in scene.notes)


def test_specular_and_glossiness(tmp_path: Path) -> None:
    """The reflectance at normal incidence is the file's, by colour."""
    model = sound()
    model.extend("KHR_materials_pbrSpecularGlossiness", required=True)
    given = {"diffuseFactor": [0.3, 0.4, 0.5, 1.0], "specularFactor": [0.09, 0.04, 0.01], "glossinessFactor": 0.7}
    model.root["materials"][0] = {"extensions": {"KHR_materials_pbrSpecularGlossiness": given}}
    made: Any = loaded(tmp_path, model).materials["material 0"]
    at_zero = ((made.ior - 1.0) / (made.ior + 1.0)) ** 2
    np.testing.assert_allclose(np.multiply(made.specular_color, at_zero), [0.09, 0.04, 0.01], rtol=1e-6)
    assert (made.base_color, made.metallic) == ((0.3, 0.4, 0.5), 0.0) and abs(made.roughness - 0.3) < 1e-12
