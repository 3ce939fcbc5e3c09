"""Shapes of other formats have the names that their files give them, for mattes."""

from __future__ import annotations

from pathlib import Path

from gltf_files import Model

import clrender
from clrender.aov import matte_names
from clrender.exporters import exported
from clrender.scene import Scene

LONG = "\u00e4" * 300


def objects(scene: Scene) -> list[str | None]:
    return matte_names(scene)["crypto_object"]


def test_gltf_nodes_and_meshes(tmp_path: Path) -> None:
    model = Model()
    mesh = model.quad()
    model.root["meshes"][mesh]["name"] = "of the mesh"
    model.node(mesh=mesh, name="of the node")
    model.node(mesh=mesh, translation=[0, 0, 1])
    model.node(mesh=model.quad(), translation=[0, 0, 2])
    model.node(mesh=mesh, translation=[0, 0, 3], name=LONG)
    scene = clrender.load(model.write(tmp_path / "m.glb"))
    assert objects(scene) == ["of the node", "of the mesh", "mesh_2", LONG[:200]]


def test_obj_objects(tmp_path: Path) -> None:
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    (tmp_path / "m.obj").write_text(f"{corners}f 1 2 3\no lid\nf 1 2 3\no {LONG}\nf 1 2 3\n", encoding="utf-8")
    assert objects(clrender.load(tmp_path / "m.obj")) == ["mesh_0", "lid", LONG[:200]]


def test_mitsuba_shapes(tmp_path: Path) -> None:
    shapes = '<shape type="sphere" id="ball"/><shape type="cube"/><shape type="disk" id="K\u00f6nig"/>'
    (tmp_path / "s.xml").write_text(f'<scene version="3.0.0">{shapes}</scene>', encoding="utf-8")
    ball, box, disk = objects(clrender.load(tmp_path / "s.xml"))
    assert (ball, disk) == ("ball", "K\u00f6nig") and box in ("box_1", "mesh_1")


def test_names_are_converted(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\no lid\nf 1 2 3\n")
    assert exported(clrender.load(tmp_path / "m.obj"), "f").description["shapes"][0]["name"] == "lid"
