"""Names that users of other programs type, folders, endings, and letters beyond ASCII: what the errors say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cases import for_each
from cli_support import call
from PIL import Image

import clrender
from clrender import SceneError
from clrender.flatten.flat_scene import flatten
from clrender.wording import printable, quoted, suggestion

CAMERA = "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n"


@for_each(
    ("text", "message"),
    [
        ("fov = 40\n", 'camera.fov is an unknown key; did you mean "vertical_fov"?'),
        ("[render]\nsamples = 4\n", 'render.samples is an unknown key; did you mean "spp"?'),
        ('[[shapes]]\ntype = "cube"\n', 'shapes[0].type is "cube", which is not known; did you mean "box"?'),
        ('[[shapes]]\ntype = "Plane"\n', 'shapes[0].type is "Plane", which is not known; did you mean "quad"?'),
        ('[[lights]]\ntype = "sun"\n', 'lights[0].type is "sun", which is not known; did you mean "directional"?'),
        ('[[lights]]\ntype = "area"\n', "a light with an area is a shape with `emission`"),
        ('[materials.a]\ntype = "diffuse"\n', 'which is not known; did you mean "lambert"?'),
        ('[materials.a]\ntype = "lambert"\ncolor = 1\n', 'unknown key; did you mean "reflectance"?'),
        ('[materials.a]\ntype = "principled"\nmetalness = 1\n', 'unknown key; did you mean "metallic"?'),
        ('[materials.a]\ntype = "principled"\nxyzzy = 1\n', "unknown key; docs/scene-file.md lists those"),
    ],
)
def test_names_of_other_programs(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.toml").write_text(CAMERA + text)
    with pytest.raises(SceneError) as error:
        clrender.load(tmp_path / "a.toml")
    assert message in str(error.value)


def test_a_slip_of_the_pen_comes_before_another_meaning() -> None:
    assert suggestion("color", ["colors", "reflectance"]) == '; did you mean "colors"?'
    assert suggestion("color", ["motion", "reflectance"]) == '; did you mean "reflectance"?'


@for_each(
    ("name", "message"),
    [
        ("folder", '"folder" is a folder; name a scene file in it'),
        ("folder.d", '"folder.d" is a folder; name a scene file in it'),
        ("folder/scene", '"folder/scene" is no scene; did you mean "folder/scene.toml"?'),
        ("a.blend", '"a.blend" is no scene: export it as .glb or .obj from a program that reads it, or name'),
        ("a.FBX", '"a.FBX" is no scene: export it as .glb or .obj'),
        ("./none", '"none" is no scene: name a scene or model file with its ending'),
        ("x" * 300 + "/y", "is no scene: name a scene or model file with its ending"),
    ],
)
def test_what_is_no_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, message: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.d").mkdir()
    (tmp_path / "folder" / "scene.toml").write_text(CAMERA)
    with pytest.raises(SceneError) as error:
        clrender.load(Path(name))
    assert message in str(error.value)


@for_each(
    ("text", "shown"),
    [
        ("Bäume/木.obj", "Bäume/木.obj"),
        ("a\nb\x1b[31m", "a\\nb\\x1b[31m"),
        ("a\u202eb", "a\\u202eb"),  # writes from right to left from there on
        ("a\udcff", "a\\udcff"),  # a byte that is no text
        ("a\\b", "a\\\\b"),
    ],
)
def test_letters_are_shown_and_what_could_deceive_is_not(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert quoted(text) == f'"{shown}"'


def test_a_file_is_named_as_its_user_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Bäume.toml").write_text(CAMERA + '[[shapes]]\ntype = "mesh"\nfile = "Äste.ply"\n')
    with pytest.raises(SceneError, match=r'^Bäume\.toml: shapes\[0\]\.file: "Äste\.ply" does not exist'):
        clrender.load("Bäume.toml")


def test_triangles_lost_far_from_the_origin_are_told_with_the_cure() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.01, 0, 0], [0.02, 0, 0], [0.01, 0.01, 0]])
    shape = {"type": "mesh", "file": "sheet", "material": "a"}
    base = clrender.Scene(
        camera={"position": (0, 0, 9), "target": (0, 0, 0)},
        materials={"a": {"type": "lambert", "reflectance": 0.5}},
        shapes=[shape],
        lights=[{"type": "environment", "radiance": 1.0}],
    )
    for distance, told in ((0.0, False), (1.0e6, True)):
        moved = (corners + np.array([distance, 0, 0])).astype(np.float32)
        faces = [[0, 1, 2], [3, 4, 5]] if told else [[0, 1, 2], [3, 4, 3]]
        scene = base.with_arrays(meshes={"sheet": {"vertices": moved, "faces": faces}})
        warnings = " ".join(flatten(scene, 8, 8).warnings)
        assert "1 of 2 triangle" in warnings and ("from the origin: move it closer" in warnings) == told


def test_a_display_image_against_a_linear_one_is_noted(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.full((8, 8, 3), 0.5, np.float32))
    Image.fromarray(np.full((8, 8, 3), 128, np.uint8)).save(tmp_path / "a.png")
    mixed = call("compare", "a.npy", "a.png", folder=tmp_path)
    assert mixed.returncode == 0
    assert mixed.stderr == (
        "note: a.png is a display image, with a tone curve, and a.npy is linear; compare two of a kind\n"
    )
    assert call("compare", "a.png", "a.png", folder=tmp_path).stderr == ""
    (tmp_path / "d").mkdir()
    assert "d: is a folder; name an image in it" in call("compare", "a.png", "d", folder=tmp_path).stderr


@for_each(
    ("name", "message"),
    [
        ("room", "there is no command 'room'; did you mean `clrender render room -o image.png`?"),
        ("a b.glb", "there is no command 'a b.glb'; did you mean `clrender render 'a b.glb' -o image.png`?"),
        ("none.glb", "there is no command 'none.glb'; choose one of render, view"),
        ("rendr", "there is no command 'rendr'; did you mean 'render'?"),
        ("x" * 300, "choose one of render, view"),
    ],
)
def test_a_scene_in_the_place_of_a_command(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "a b.glb").write_bytes(b"")
    done = call(name, folder=tmp_path)
    assert done.returncode == 2 and message in done.stderr, done.stderr
