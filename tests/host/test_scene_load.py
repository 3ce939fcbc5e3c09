"""Scenes from files and from code: the same model, the same hash, the built-in ones sound."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from cases import for_each
from special_files import special

import clrender
from clrender import scene as scenes
from clrender.errors import SceneError
from clrender.files.package_data import scenes_folder
from clrender.flatten.flat_scene import flatten

TOML = """
title = "Two ways"
[camera]
position = [0.0, 0.0, -3.4]
target = [0, 0, 0]
[image]
width = 320
[materials.white]
type = "lambert"
reflectance = [0.75, 0.75, 0.75]
[[shapes]]
type = "sphere"
center = [0.4, -0.6, 0.1]
radius = 0.4
material = "white"
[[shapes]]
type = "mesh"
vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
faces = [[0, 1, 2]]
emission = [12.0, 12.0, 12.0]
transform = { translate = [0, 0, 0], rotate_degrees = [0, 90, 0], scale = 1.0 }
[[lights]]
type = "point"
position = [0, 0.9, 0]
intensity = [1, 1, 1]
"""
NEEDED = {
    "room", "room-mirror", "room-glass", "cornell", "furnace", "furnace-room", "furnace-sphere", "furnace-glass",
    "point-plane", "directional-plane", "quad-plane", "sphere-plane", "mirror-light", "slab", "inside-sphere", "bumpy",
    "metals", "sky", "drink", "surfaces", "lamps", "haze", "sundial",
    "candles",
    "foliage", "product", "fisheye", "avenue", "pool", "canal", "interior", "metalware", "cradle",
    "still-life", "veranda", "balustrade", "museum", "attic",
}  # fmt: skip
INEXACT = {
    "avenue",
    "room",
    "room-mirror",
    "room-glass",
    "cornell",
    "bumpy",
    "metals",
    "sky",
    "drink",
    "surfaces",
    "lamps",
    "haze",
    "sundial",
    "candles",
    "foliage",
    "product",
    "fisheye",
    "pool",
    "canal",
    "interior",
    "metalware",
    "cradle",
    "still-life",
    "veranda",
    "balustrade",
    "museum",
    "attic",
}
EXACT = NEEDED - INEXACT


def as_json(tmp_path: Path) -> dict[str, object]:
    (tmp_path / "a.toml").write_text(TOML)
    return scenes.load(tmp_path / "a.toml").model_dump(mode="json", exclude_unset=True)


def test_toml_json_and_code_are_one(tmp_path: Path) -> None:
    content = as_json(tmp_path)
    (tmp_path / "b.json").write_text("\ufeff" + json.dumps(content), encoding="utf-8")
    loaded = [scenes.load(tmp_path / "a.toml"), scenes.load(str(tmp_path / "b.json")), scenes.Scene(**content)]
    assert loaded[0].model_dump() == loaded[1].model_dump() == loaded[2].model_dump()
    assert len({scene.sha256() for scene in loaded}) == 1
    assert len({flatten(scene, 32, 32).sha256 for scene in loaded}) == 1
    assert loaded[0].image.width == 320 and loaded[0].image.height == 800 and loaded[0].render.spp == 64


def test_hash_is_of_the_content(tmp_path: Path) -> None:
    content = as_json(tmp_path)
    original = scenes.Scene(**content).sha256()
    assert scenes.Scene(**{**content, "title": "Another"}).sha256() == original
    assert scenes.Scene(**{**content, "image": {"width": 321}}).sha256() != original
    ply = (scenes_folder() / "bumpy.ply").read_bytes()
    text = '[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\n[[shapes]]\ntype = "mesh"\nfile = "{}"\n'
    hashes = []
    for name, data in (("one.ply", ply), ("two.ply", ply), ("three.ply", ply[:400] + b"\x00" + ply[401:])):
        (tmp_path / name).write_bytes(data)
        (tmp_path / "s.toml").write_text(text.format(name))
        hashes.append(scenes.load(tmp_path / "s.toml").sha256())
    assert hashes[0] == hashes[1] != hashes[2]


def test_code_gets_scene_errors_too() -> None:
    with pytest.raises(SceneError, match="Sphere: radius is -1, but must be greater than 0"):
        scenes.Sphere(type="sphere", radius=-1)
    with pytest.raises(SceneError, match=r"Scene: shapes\[0\].material names a material \"a\""):
        scenes.Scene(
            camera=scenes.Camera(position=(0, 0, 1), target=(0, 0, 0)),
            shapes=(scenes.Sphere(type="sphere", radius=1, material="a"),),
        )
    with pytest.raises(SceneError, match='centre is an unknown key; did you mean "center"'):
        scenes.Sphere(type="sphere", radius=1, centre=(0, 0, 0))  # type: ignore[call-arg]


def test_builtin_scenes_are_complete() -> None:
    assert set(scenes.builtin_names()) >= NEEDED


@pytest.mark.parametrize("name", sorted(NEEDED))
def test_builtin_scene_is_sound(name: str) -> None:
    description = scenes.builtin_names()[name]
    assert 20 < len(description) < 130
    scene = scenes.load(name)
    flat = flatten(scene, scene.image.width, scene.image.height)
    assert flat.light_count > 0 and not flat.messages
    comment = [line for line in (scenes_folder() / f"{name}.toml").read_text().splitlines() if line.startswith("# ")]
    assert any("Exact answer" in line for line in comment) == (name in EXACT)
    if name not in EXACT:
        assert any("No exact answer is known" in line for line in comment)


def test_builtin_scenes_are_named_as_typed_wherever_they_lie(tmp_path: Path) -> None:
    assert scenes.load("room").source == "room"
    path = scenes_folder() / "room.toml"
    assert scenes.load(path).source == str(path) == scenes.load(str(path)).source


def test_builtin_name_wins_over_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "room").mkdir()
    monkeypatch.chdir(tmp_path)
    assert scenes.load("room").title == "The room"


@pytest.mark.parametrize(
    "name",
    [
        *(
            "make_meshes.py",
            "make_models.py",
            "make_vessels.py",
            "make_canal.py",
            "make_interior.py",
            "make_sky.py",
            "make_lamps.py",
        ),
        *(pytest.param(name, marks=pytest.mark.long) for name in ("make_clouds.py", "make_strands.py")),
    ],
)
def test_files_are_the_ones_the_script_makes(name: str) -> None:
    script = scenes_folder().parent / "scripts" / name
    done = subprocess.run([sys.executable, str(script), "--check"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_schema_describes_the_file() -> None:
    schema = scenes.Scene.model_json_schema()
    assert set(schema["properties"]) == {
        *("title", "camera", "image", "render", "materials", "shapes", "groups", "lights", "media", "fog")
    }
    assert schema["additionalProperties"] is False and schema["required"] == ["camera"]
    kinds = schema["properties"]["shapes"]["items"]["discriminator"]["mapping"]
    assert set(kinds) == {"sphere", "quad", "triangle", "box", "tetrahedron", "disk", "mesh", "curves", "instance"}
    json.dumps(schema)


def test_start_up_imports_nothing_slow() -> None:
    code = "import sys, clrender.scene; print(sorted({'scipy', 'pyopencl', 'PIL', 'OpenEXR'} & set(sys.modules)))"
    root = str(Path(scenes.__file__).parents[2])
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@for_each("kind", ["pipe", "socket", "device", "folder"])
@for_each("ending", [".toml", ".json"])
def test_a_scene_that_is_no_file_is_refused_at_once(tmp_path: Path, kind: str, ending: str) -> None:
    path = tmp_path / f"s{ending}"
    with special(path, kind), pytest.raises(SceneError, match=r"only regular files are read|is a folder"):
        scenes.load(path)


@for_each("name, given, said", [
    ("room", {"time_at": 3.0}, "the time asked for changes nothing"),
    ("room", {"shutter": (0.0, 1.0)}, "the shutter asked for changes nothing"),
    ("room", {"time_at": 3.0, "shutter": (0.0, 1.0)}, "the time and shutter asked for change nothing"),
    ("sundial", {"time_at": 3.0}, "changes nothing; the time of day is `time` of its sun_sky light"),
    ("cradle", {"time_at": 0.5}, ""),
    ("cradle", {}, ""),
    ("room", {}, ""),
])  # fmt: skip
def test_a_time_at_which_nothing_moves_is_told(name: str, given: dict[str, Any], said: str) -> None:
    notes = clrender.load(name, **given).notes
    assert len(notes) == (1 if said else 0) and all(note.startswith(f"{name}: ") and said in note for note in notes)
