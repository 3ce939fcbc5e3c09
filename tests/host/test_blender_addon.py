"""The add-on for Blender, as far as it goes without Blender: its archive, and what it makes of cameras and lights."""

from __future__ import annotations

import ast
import io
import json
import math
import os
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each

import clrender
from clrender.blender import write_addon
from clrender.blender.addon import bl_info, lights, program
from clrender.blender.addon.cameras import BlenderCamera, camera_table
from clrender.blender.addon.lights import LAMP, SHOWN, BlenderLight, light_tables
from clrender.blender.addon.scene_files import Placed, SceneParts, assembled
from clrender.blender.addon.worlds import BlenderWorld, linear, pfm_bytes, world_table
from clrender.blender.bundle import FOLDER, NAME
from clrender.cli import main
from clrender.errors import UsageError
from clrender.image.files import read_image
from clrender.scene import Camera
from clrender.settings import FIRST_LOOK, REPLICATE_SPP, settings_for
from clrender.version import __version__

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

IDENTITY = np.eye(4).tolist()
BY_BLENDER = ("reading", "exporting", "engine", "interface")
"""Modules that need Blender."""


def archive() -> bytes:
    file = io.BytesIO()
    write_addon(file)
    return file.getvalue()


def test_the_archive_has_all_files_and_always_the_same_bytes() -> None:
    made = archive()
    assert made == archive()
    with zipfile.ZipFile(io.BytesIO(made)) as packed:
        assert packed.testzip() is None
        names = {path.name for path in FOLDER.iterdir() if path.name != "__pycache__"}
        assert set(packed.namelist()) == {f"{NAME}/{name}" for name in names}
        for name in names:
            assert packed.read(f"{NAME}/{name}") == (FOLDER / name).read_bytes()


def test_the_manifest_is_that_of_an_extension() -> None:
    manifest = tomllib.loads((FOLDER / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["schema_version"] == "1.0.0"
    assert manifest["id"] == NAME
    assert manifest["type"] == "add-on"
    assert manifest["license"] == ["SPDX:MIT"]
    assert manifest["version"] == __version__ == ".".join(map(str, bl_info["version"]))
    assert manifest["blender_version_min"] == ".".join(map(str, bl_info["blender"]))
    for text in (manifest["tagline"], *manifest["permissions"].values()):
        assert len(text) <= 64  # as Blender demands
        assert text[-1].isalnum()


def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "addon.zip"
    main(["blender", "-o", str(path)], standalone_mode=False)
    assert path.read_bytes() == archive()
    assert "Install from Disk" in capsys.readouterr().out
    with pytest.raises(UsageError, match=r"name one, such as clrender_addon\.zip"):
        main(["blender", "-o", str(tmp_path / "addon.tar")], standalone_mode=False)


def test_it_needs_nothing_of_this_package(tmp_path: Path) -> None:
    with zipfile.ZipFile(io.BytesIO(archive())) as packed:
        packed.extractall(tmp_path)
    names = [f"{NAME}.{path.stem}" for path in FOLDER.glob("*.py") if path.stem not in ("__init__", *BY_BLENDER)]
    text = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import {', '.join([NAME, *names])}\n"
    text += "assert not any(name.split('.')[0] in ('clrender', 'bpy') for name in sys.modules)"
    subprocess.run([sys.executable, "-I", "-c", text], check=True)
    for path in FOLDER.glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        own = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level == 0]
        assert not any((node.module or "").startswith("clrender") for node in own)


def turned(vector: Any) -> list[float]:
    return [vector[0], vector[2], -vector[1]]


def pose() -> np.ndarray[Any, Any]:
    """A camera's place in Blender, with a scale, which does not count for cameras."""
    a, b = 0.7, -0.4
    one = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1.0]])
    two = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = one @ two, (1.5, -4.0, 2.5)
    return made


@for_each(
    ("width", "height", "values"),
    [
        (320, 200, {}),
        (200, 320, {}),
        (200, 320, {"sensor_fit": "HORIZONTAL", "shift_x": 0.1, "shift_y": -0.2}),
        (320, 200, {"sensor_fit": "VERTICAL", "sensor_height": 18.0, "shift_x": 0.1, "shift_y": 0.2}),
        (320, 200, {"type": "ORTHO", "ortho_scale": 5.0, "shift_x": 0.2, "shift_y": 0.1}),
        (200, 320, {"type": "ORTHO", "ortho_scale": 5.0, "sensor_fit": "HORIZONTAL"}),
        (320, 200, {"pixel_aspect": 1.5, "shift_x": 0.05, "shift_y": 0.1}),
        (320, 200, {"pixel_aspect": 2.0, "sensor_fit": "VERTICAL", "shift_y": 0.1}),
    ],
)
def test_a_camera_sees_points_where_blender_does(width: int, height: int, values: dict[str, Any]) -> None:
    """Blender's sensor fits one side of the image, and its shift is in units of that side."""
    place = pose()
    camera = BlenderCamera(place.tolist(), width, height, **values)
    table, notes = camera_table(camera)
    assert not notes
    local = np.random.default_rng(1).uniform((-1.0, -1.0, -6.0), (1.0, 1.0, -3.0), (20, 3))
    world = local @ place[:3, :3].T + place[:3, 3]
    made = Camera.model_validate(table)
    found = made.project([turned(point) for point in world], size=(width, height))
    fit = values.get("sensor_fit", "AUTO")
    aspect = values.get("pixel_aspect", 1.0)
    wide = width >= height * aspect if fit == "AUTO" else fit == "HORIZONTAL"
    side = width if wide else height * aspect
    sensor = values.get("sensor_height", 24.0) if fit == "VERTICAL" else 36.0
    flat = (
        local[:, :2] / values["ortho_scale"]
        if "ortho_scale" in values
        else -50.0 / sensor * local[:, :2] / local[:, 2:]
    )
    x = width / 2.0 + (flat[:, 0] - values.get("shift_x", 0.0)) * side
    y = height / 2.0 - (flat[:, 1] - values.get("shift_y", 0.0)) * side / aspect
    np.testing.assert_allclose(np.asarray(found), np.stack([x, y], axis=1), atol=2e-3)


def test_depth_of_field_is_that_of_the_lens() -> None:
    camera = BlenderCamera(IDENTITY, 10, 10, use_dof=True, lens=85.0, fstop=1.4, focus_distance=2.5, blades=6)
    table, _ = camera_table(camera)
    assert table["aperture_radius"] == pytest.approx(0.085 / 2.8)
    assert table["focus_distance"] == 2.5
    assert (table["blades"], table["blade_rotation_degrees"]) == (6, 30.0)
    flat, notes = camera_table(
        BlenderCamera(IDENTITY, 10, 10, type="ORTHO", use_dof=True, fstop=2.0, aperture_ratio=2.0)
    )
    assert flat["aperture_radius"] == 0.25
    assert "ratio" in notes[0]


@for_each(
    ("values", "kind", "note"),
    [
        ({}, "panoramic", ""),
        ({"panorama_type": "FISHEYE_EQUIDISTANT"}, "fisheye", ""),
        ({"panorama_type": "FISHEYE_EQUIDISTANT", "width": 20}, "fisheye", "round"),
        ({"panorama_type": "MIRRORBALL"}, "panoramic", "MIRRORBALL"),
    ],
)
def test_panoramas(values: dict[str, Any], kind: str, note: str) -> None:
    given: dict[str, Any] = {"width": 10, "height": 10, "type": "PANO", **values}
    table, notes = camera_table(BlenderCamera(IDENTITY, **given))
    assert Camera.model_validate(table).type == kind
    assert bool(notes) == bool(note)
    assert all(note in each for each in notes)


def flux(light: BlenderLight) -> float:
    """Power of a light of one colour, watts, by what clrender defines its numbers to be."""
    made, shapes, _ = light_tables(light)
    if made:
        table = made[0]
        if table["type"] == "point":
            return float(4.0 * math.pi * table["intensity"][0])
        edge = math.cos(math.radians(table["cone_degrees"]) / 2.0)
        return float(2.0 * math.pi * (1.0 - edge) * (1.0 - table["blend"] / 2.0) * table["intensity"][0])
    table = shapes[0]
    radiance = SHOWN * table["emission"][0]
    if table["type"] == "sphere":
        area = 4.0 * math.pi * table["radius"] ** 2
    elif table["type"] == "disk":
        area = math.pi * table["radius"] ** 2
    elif table["type"] == "quad":
        area = float(np.linalg.norm(np.cross(table["edge_u"], table["edge_v"])))
    else:
        points, faces = np.array(table["vertices"]), np.array(table["faces"])
        a, b, c = (points[faces[:, i]] for i in range(3))
        area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0)
    return float(math.pi * area * radiance)


SCALED = np.diag([2.0, 0.5, 1.0, 1.0]).tolist()


@for_each(
    "values",
    [
        {"type": "POINT"},
        {"type": "POINT", "radius": 0.2},
        {"type": "AREA", "size": 0.5},
        {"type": "AREA", "shape": "RECTANGLE", "size": 0.5, "size_y": 2.0},
        {"type": "AREA", "shape": "DISK", "size": 0.5},
        {"type": "AREA", "shape": "ELLIPSE", "size": 0.5, "size_y": 2.0},
        {"type": "AREA", "shape": "DISK", "size": 0.5, "matrix": SCALED},
        {"type": "AREA", "matrix": SCALED},
    ],
)
def test_lights_have_the_power_of_blenders(values: dict[str, Any]) -> None:
    assert flux(BlenderLight("light", values.pop("matrix", IDENTITY), energy=30.0, **values)) == pytest.approx(30.0)


def test_powers_that_are_not_of_the_whole_lamp_are_those_of_a_square_metre() -> None:
    area = BlenderLight("area", IDENTITY, "AREA", size=0.5, energy=30.0, normalize=False)
    point = BlenderLight("point", IDENTITY, "POINT", radius=0.2, energy=30.0, normalize=False)
    assert flux(area) == pytest.approx(30.0 * 0.25)
    assert flux(point) == pytest.approx(30.0 * 4.0 * math.pi * 0.04)


def test_a_spot_has_the_intensity_of_a_point() -> None:
    spot = BlenderLight("spot", IDENTITY, "SPOT", energy=30.0, spot_size=0.8, spot_blend=0.3, radius=0.1)
    made, _, notes = light_tables(spot)
    assert made[0]["intensity"] == pytest.approx([30.0 / (4.0 * math.pi)] * 3)
    assert made[0]["direction"] == [0.0, -1.0, 0.0]
    assert (made[0]["cone_degrees"], made[0]["blend"]) == (pytest.approx(math.degrees(0.8)), 0.3)
    assert "radius" in notes[0]


def test_a_sun_has_its_irradiance() -> None:
    made, _, notes = light_tables(BlenderLight("sun", IDENTITY, "SUN", color=(1.0, 0.5, 0.0), energy=3.0, angle=0.2))
    assert made == [{"type": "directional", "direction": [0.0, -1.0, 0.0], "irradiance": [3.0, 1.5, 0.0]}]
    assert "11.5 degrees" in notes[0]


@for_each("mirror", [1.0, -1.0])
@for_each("shape", ["SQUARE", "DISK", "ELLIPSE"])
def test_area_lights_shine_downward_also_where_they_are_mirrored(mirror: float, shape: str) -> None:
    matrix = np.diag([mirror, 1.0, 1.0, 1.0])
    matrix[:3, 3] = (1.0, 2.0, 3.0)
    _, (table,), _ = light_tables(BlenderLight("lamp", matrix.tolist(), "AREA", shape=shape, size_y=2.0))
    if "normal" in table:
        normal = np.array(table["normal"])
    elif "edge_u" in table:
        normal = np.cross(table["edge_u"], table["edge_v"])
        middle = np.array(table["origin"]) + np.add(table["edge_u"], table["edge_v"]) / 2.0
        np.testing.assert_allclose(middle, [1.0, 3.0, -2.0])
    else:
        a, b, c = (np.array(table["vertices"][i]) for i in table["faces"][0])
        normal = np.cross(b - a, c - a)
    np.testing.assert_allclose(normal / np.linalg.norm(normal), [0.0, -1.0, 0.0], atol=1e-12)


@for_each(
    ("values", "note"),
    [
        ({"type": "AREA", "is_portal": True}, "portals"),
        ({"type": "AREA", "spread": 1.0}, "spread"),
        ({"type": "POINT", "use_shadow": False}, "shadows"),
        ({"type": "POINT", "use_nodes": True}, "nodes"),
        ({"type": "HEMI"}, "HEMI"),
        ({"type": "AREA", "size": 0.0}, "no area"),
    ],
)
def test_what_is_left_out_of_lights_is_told(values: dict[str, Any], note: str) -> None:
    notes = light_tables(BlenderLight("lamp", IDENTITY, **values))[2]
    assert len(notes) == 1
    assert note in notes[0]


def test_dark_lights_are_none() -> None:
    assert light_tables(BlenderLight("lamp", IDENTITY, "POINT", energy=0.0)) == ([], [], [])


@for_each(
    ("degrees", "inverse", "turn"),
    [(0.0, False, 90.0), (30.0, False, 60.0), (30.0, True, 120.0), (-120.0, False, -150.0)],
)
def test_environment_maps_are_turned_as_blender_turns_them(degrees: float, inverse: bool, turn: float) -> None:
    world = BlenderWorld(file="a.exr", strength=2.0, rotation=(0.0, 0.0, math.radians(degrees)), inverse=inverse)
    table, notes = world_table(world)
    assert table == {"type": "environment", "file": "a.exr", "rotate_degrees": pytest.approx(turn), "scale": 2.0}
    assert not notes
    assert "tilt" in world_table(BlenderWorld(file="a.exr", rotation=(0.1, 0.0, 0.0)))[1][0]


def test_constant_worlds() -> None:
    seen = {"type": "environment", "radiance": [0.1, 0.2, 0.3]}
    assert world_table(BlenderWorld((0.1, 0.2, 0.3))) == (seen, [])
    hidden = world_table(BlenderWorld((0.1, 0.2, 0.3), visible_camera=False))[0]
    assert hidden == {**seen, "visible_to_camera": False}
    assert world_table(BlenderWorld()) == (None, [])


def test_pictures_are_written_as_they_are_read(tmp_path: Path) -> None:
    pixels = np.random.default_rng(2).uniform(0.0, 9.0, (3, 5, 3)).astype(np.float32)
    (tmp_path / "a.pfm").write_bytes(pfm_bytes(pixels))
    np.testing.assert_array_equal(read_image(tmp_path / "a.pfm"), pixels[::-1])
    np.testing.assert_allclose(
        linear(np.array([0.0, 0.04045, 0.5, 1.0], np.float32)), [0.0, 0.0031308, 0.21404, 1.0], rtol=1e-4
    )


def test_a_region_is_that_of_whole_pixels() -> None:
    assert program.region((96, 72), (0.2, 0.61), (0.33, 0.9)) == (19, 8, 39, 41)
    assert program.region((96, 72), (0.0, 1.0), (0.0, 1.0)) == (0, 0, 96, 72)


def test_the_command_to_render_has_options_that_there_are() -> None:
    from clrender.cli.render import render

    options = program.RenderOptions(
        max_depth=3,
        error=0.1,
        seconds=2.0,
        device="cpu",
        denoise=True,
        alpha=True,
        crop=(1, 2, 3, 4),
        more="--guiding on",
    )
    words = program.render_command(Path("scene.json"), Path("image.exr"), options)
    there_are = {name for each in render.params for name in each.opts}
    assert {word for word in words if word.startswith("--")} <= there_are
    assert words[:2] == ["render", "scene.json"]
    assert words[-2:] == ["--guiding", "on"]
    assert "1,2,3x4" in words
    plain = program.render_command(Path("a.json"), Path("a.exr"), program.RenderOptions())
    assert not {"--max-depth", "--error", "--time", "--device", "--denoise", "--alpha", "--crop"} & set(plain)


def rendering(**values: Any) -> list[str]:
    return program.render_command(Path("a.json"), Path("a.exr"), program.RenderOptions(**values))


@for_each("integrator", ["path", "bdpt", "photon", "reuse", "direct"])
def test_the_defaults_suit_every_integrator(integrator: str) -> None:
    words = rendering(integrator=integrator)
    assert "--light-sampler" not in words
    settings_for(clrender.load("room"), None, {"integrator": integrator, "spp": int(words[words.index("--spp") + 1])})
    assert "power" in rendering(light_sampler="power")
    tree = ast.parse((FOLDER / "interface.py").read_text(encoding="utf-8"))
    defaults = [
        ast.unparse(each.keywords[-1].value)
        for each in ast.walk(tree)
        if isinstance(each, ast.Call) and any("_LIGHT_SAMPLERS" in ast.unparse(key.value) for key in each.keywords)
    ]
    assert defaults == ["'auto'"]


@for_each(
    ("spp", "more", "expected"),
    [
        (64, "", None),
        (255, "", None),
        (256, "", 256),
        (300, "", 288),
        (300, "--replicate-spp 4", 300),
    ],
)
def test_samples_with_an_error_are_as_many_as_its_test_needs(spp: int, more: str, expected: int | None) -> None:
    words = rendering(spp=spp, error=0.02, more=more)
    given = {"error": 0.02} if expected is None else {"error": 0.02, "spp": expected}
    assert ("--spp" in words) == ("spp" in given)
    assert expected is None or words[words.index("--spp") + 1] == str(expected)
    made = settings_for(clrender.load("room"), None, given | ({"replicate_spp": 4} if more else {}))
    assert program._LEAST_OF_ERROR == FIRST_LOOK * REPLICATE_SPP <= made.spp


def test_the_scene_file_is_one(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    glass = {"type": "principled", "transmission": 1.0, "thin": True}
    converted = {
        "camera": {"position": [0.0, 0.0, 9.0]},
        "materials": {"glass": glass, "pane": glass, "both": glass, "leaf": {**glass, "opacity": 0.5}},
        "shapes": [
            {"type": "mesh", "name": "clrender 0", "file": "a.ply", "material": "glass"},
            {"type": "mesh", "name": "clrender 1", "file": "a.ply", "material": "pane"},
            {"type": "mesh", "name": "clrender 2", "file": "a.ply", "material": "leaf"},
            {"type": "mesh", "name": "clrender 3", "file": "a.ply", "material": "both"},
            {"type": "mesh", "name": "clrender 4", "file": "a.ply", "material": "both"},
        ],
        "lights": [{"type": "environment", "radiance": [1.0, 1.0, 1.0]}],
    }
    table, _ = camera_table(BlenderCamera(pose().tolist(), 32, 16))
    _, shapes, _ = light_tables(BlenderLight("key", pose().tolist(), "AREA", visible_camera=False))
    objects = {"clrender 0": Placed("ball"), "clrender 1": Placed("pane", visible_camera=False, is_open=True)}
    objects["clrender 2"] = Placed("leaf", shadow_catcher=True)
    objects |= {"clrender 3": Placed("bulb"), "clrender 4": Placed("window", is_open=True)}
    parts = SceneParts(table, 32, 16, shapes=shapes, objects=objects)
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(assembled(converted, parts)), encoding="utf-8")
    scene = clrender.load(path, strict=True)
    assert [shape.name for shape in scene.shapes] == ["ball", "pane", "leaf", "bulb", "window", "key"]
    assert [getattr(shape, "visible_to_camera", None) for shape in scene.shapes] == [
        True,
        False,
        True,
        True,
        True,
        False,
    ]
    assert getattr(scene.shapes[2], "shadow_catcher", False)
    assert [getattr(scene.materials[name], "thin", None) for name in ("glass", "pane", "leaf")] == [False, True, True]
    both = [getattr(scene.materials[str(shape.material)], "thin", None) for shape in scene.shapes[3:5]]
    assert both == [False, True]
    assert LAMP in scene.materials
    assert not scene.lights
    assert (scene.image.width, scene.image.height) == (32, 16)
    assert lights.LAMP_MATERIAL["opacity"] == SHOWN


def script(folder: Path, text: str) -> list[str]:
    path = folder / "program.py"
    path.write_text(f"import json, signal, sys, time\n{text}")
    return [sys.executable, str(path)]


def test_what_the_program_says_is_sorted(tmp_path: Path) -> None:
    text = """
say = lambda **event: print(json.dumps(event), file=sys.stderr, flush=True)
say(event="message", text="device: none")
print("note: a lamp was left out", file=sys.stderr)
say(event="progress", samples=1, samples_total=4)
print("{no json", file=sys.stderr)
print("error: the file is missing", file=sys.stderr)
sys.exit(2)
"""
    events: list[dict[str, Any]] = []
    finished = program.run(script(tmp_path, text), on_event=events.append)
    assert (finished.code, finished.error) == (2, "the file is missing")
    assert finished.messages == ["device: none", "note: a lamp was left out"]
    assert events == [{"event": "progress", "samples": 1, "samples_total": 4}]
    assert program.run(script(tmp_path, "raise SystemError('no')")).error == "SystemError: no"
    assert program.run(script(tmp_path, "sys.exit(3)")).error == "clrender ended with the exit code 3"


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGINT for other processes")
def test_a_program_is_interrupted_and_ends_by_itself(tmp_path: Path) -> None:
    text = """
try:
    print(json.dumps({"event": "progress"}), file=sys.stderr, flush=True)
    time.sleep(60.0)
except KeyboardInterrupt:
    sys.exit(130)
"""
    seen: list[dict[str, Any]] = []
    began = time.perf_counter()
    finished = program.run(script(tmp_path, text), lambda: bool(seen), seen.append)
    assert (finished.code, finished.error) == (program.INTERRUPTED, "")
    assert time.perf_counter() - began < 30.0


def test_the_program_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "clrender"
    own.write_text("#!/bin/sh\n")
    own.chmod(0o755)
    assert program.found_program(str(own)) == [str(own)]
    python = tmp_path / "python3.11"
    python.write_text("")
    assert program.found_program(f" {python} ") == [str(python), "-m", "clrender"]
    with pytest.raises(FileNotFoundError, match="preferences"):
        program.found_program(str(tmp_path / "none"))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert program.found_program("") == [str(own)]
    own.unlink()
    assert program.found_program("") == [sys.executable, "-m", "clrender"]
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(FileNotFoundError, match="was not found"):
        program.found_program("")
    monkeypatch.setenv("PYTHONHOME", "/blender")
    assert "PYTHONHOME" not in program.child_environment()
