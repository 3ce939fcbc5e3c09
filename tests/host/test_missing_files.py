"""Pictures and meshes that are missing or damaged: left out with a note, counted, and refused if strict."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import peer_scenes
import pytest
from cases import for_each
from PIL import Image

from clrender.errors import OutOfMemory, SceneError
from clrender.importers import load
from clrender.scene import Scene

FACE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"


def write(folder: Path, kind: str, picture: str = "t.png", mesh: str = "part.ply", inside: str = "") -> Path:
    """A scene of each format, with a picture as a colour, and where there can be some as numbers and maps."""
    peer_scenes.write_parts(folder)
    Image.new("RGB", (2, 2), (200, 100, 50)).save(folder / "t.png")
    path = folder / f"a.{kind}"
    if kind == "pbrt":
        textures = f'"imagemap" "string filename" "{picture}"'
        path.write_text(
            f'Camera "perspective"\nWorldBegin\nTexture "c" "spectrum" {textures} "float scale" 0.5\n'
            f'Texture "n" "float" {textures}\n{inside}'
            f'Material "coateddiffuse" "texture reflectance" "c" "texture roughness" "n" "texture displacement" "n"\n'
            f'Shape "plymesh" "string filename" "{mesh}" "texture alpha" "n"\nShape "sphere"\n'
        )
    elif kind == "xml":
        texture = f'type="bitmap"><string name="filename" value="{picture}"/></texture>'
        path.write_text(
            f'<scene version="3.0.0">{inside}<bsdf type="twosided" id="a"><bsdf type="bumpmap"><texture {texture}'
            f'<bsdf type="roughplastic"><texture name="diffuse_reflectance" {texture}'
            f'<texture name="alpha" {texture}</bsdf></bsdf></bsdf>\n'
            f'<shape type="ply"><string name="filename" value="{mesh}"/><ref id="a"/></shape>\n'
            '<shape type="sphere"><ref id="a"/></shape></scene>'
        )
    else:
        (folder / "m.mtl").write_text(f"newmtl a\nKd 1 0.5 0.5\nmap_Kd {picture}\nmap_Ke {picture}\nbump {picture}\n")
        path.write_text(f"mtllib m.mtl\n{FACE}")
    return path


def binary_ply(points: Any, corners: Any) -> bytes:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
    head += f"property float z\nelement face {len(corners)}\nproperty list uchar int vertex_indices\nend_header\n"
    faces = np.zeros(len(corners), [("n", "u1"), ("at", "<i4", 3)])
    faces["n"], faces["at"] = 3, corners
    made: bytes = head.encode() + points.tobytes() + faces.tobytes()
    return made


def base_of(scene: Scene) -> Any:
    every: list[Any] = list(scene.materials.values())
    (base,) = {made.reflectance if made.type == "lambert" else made.base_color for made in every}
    return base


@for_each("kind", ["pbrt", "xml", "obj"])
@for_each("fault", ["missing", "damaged", "empty", "no picture"])
def test_a_picture_that_cannot_be_read_is_grey(tmp_path: Path, kind: str, fault: str) -> None:
    sound = load(write(tmp_path, kind))
    assert sound.faults["left_out"] == 0
    name = f"{fault.replace(' ', '-')}.png"
    data = {"damaged": (tmp_path / "t.png").read_bytes()[:50], "empty": b"", "no picture": b"picture"}.get(fault)
    if data is not None:
        (tmp_path / name).write_bytes(data)
    path = write(tmp_path, kind, name)
    scene = load(path)
    assert base_of(scene) == {"pbrt": (0.25,) * 3, "xml": (0.5,) * 3, "obj": (0.5, 0.25, 0.25)}[kind]
    every: list[Any] = list(scene.materials.values())
    for made in every:
        assert made.bump_map is None and made.opacity == 1.0
        assert made.type == "lambert" or made.roughness == 1.0
    assert not any(shape.emission is not None and any(shape.emission) for shape in scene.plain_shapes)
    told = [note for note in scene.notes if name in note]
    assert len(told) == 1 and told[0].endswith(": left out") and scene.faults["left_out"] == 1
    assert scene.sha256() != sound.sha256()
    with pytest.raises(SceneError, match=name):
        load(path, strict=True)


@for_each("kind", ["pbrt", "xml"])
@for_each("fault", ["missing", "damaged"])
def test_a_mesh_that_cannot_be_read_is_left_out(tmp_path: Path, kind: str, fault: str) -> None:
    sound = load(write(tmp_path, kind))
    assert len(sound.shapes) == 2
    if fault == "damaged":
        (tmp_path / "none.ply").write_bytes((tmp_path / "part.ply").read_bytes()[:-5])
    path = write(tmp_path, kind, mesh="none.ply")
    scene = load(path)
    assert [shape.type for shape in scene.shapes] == ["sphere"] and scene.faults["left_out"] == 1
    (told,) = (note for note in scene.notes if "none.ply" in note)
    assert told.endswith(": left out") and "line " in told and scene.sha256() != sound.sha256()
    with pytest.raises(SceneError, match=r"none\.ply"):
        load(path, strict=True)


@for_each("kind", ["pbrt", "xml"])
def test_files_of_other_folders_are_refused_and_not_left_out(tmp_path: Path, kind: str) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    for more in ({"mesh": "../none.ply"}, {"picture": "../none.png"}):
        with pytest.raises(SceneError, match="outside the scene's own folder"):
            load(write(inner, kind, **more))


def test_what_is_too_large_for_this_machine_is_not_left_out(tmp_path: Path, monkeypatch: Any) -> None:
    """Or the image would depend on the machine."""

    def full(*_: Any) -> Any:
        raise MemoryError

    path = write(tmp_path, "pbrt")
    monkeypatch.setattr("clrender.meshes.ply.read_ply", full)
    with pytest.raises(OutOfMemory, match="too large for the memory"):
        load(path)
    monkeypatch.undo()
    monkeypatch.setattr("clrender.scene.pictures.open_picture", full)
    with pytest.raises(OutOfMemory, match="too large for the memory"):
        load(path)


def test_pictures_that_nothing_shows_need_not_be_there(tmp_path: Path) -> None:
    unused = 'Texture "u" "spectrum" "imagemap" "string filename" "unused.png"\n'
    scene = load(write(tmp_path, "pbrt", inside=unused), strict=True)
    assert scene.faults["left_out"] == 0 and not any("unused" in note for note in scene.notes)


def test_shapes_in_groups_lose_their_picture_too(tmp_path: Path) -> None:
    """Also where meshes have become instances before the picture is read."""
    peer_scenes.write_parts(tmp_path)
    side = 300
    points = np.stack(np.meshgrid(np.arange(side), np.arange(side), [0.0]), axis=-1).reshape(-1, 3)
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    corners = np.stack([first, first + 1, first + side], axis=1)
    (tmp_path / "big.ply").write_bytes(binary_ply(points.astype("<f4"), corners.astype("<i4")))
    shape = 'Shape "plymesh" "string filename" "big.ply"\n'
    world = (
        'Texture "c" "spectrum" "imagemap" "string filename" "none.png"\nMaterial "diffuse" "texture reflectance" "c"\n'
    )
    world += 'AreaLightSource "diffuse" "string filename" "none.png"\n'
    (tmp_path / "a.pbrt").write_text(
        f'Camera "perspective"\nWorldBegin\n{world}{shape}Translate 0 0 1\n{shape}Translate 0 0 1\n{shape}'
    )
    scene = load(tmp_path / "a.pbrt")
    assert scene.groups and scene.faults["left_out"] == 1
    assert base_of(scene) == (0.5, 0.5, 0.5)
    assert {shape.emission for _, shape in scene.all_shapes()} <= {None, (0.0, 0.0, 0.0)}
