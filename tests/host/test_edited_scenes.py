"""Edits of a live view, without a device: lights, undo and redo, outlines, and what is kept of them."""

from __future__ import annotations

import dataclasses
import io
import json
import shlex
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from click.testing import CliRunner
from PIL import Image

import clrender
from clrender.cli.render import render
from clrender.errors import ClrenderError, UsageError
from clrender.rendering.job import RenderJob
from clrender.view import tables
from clrender.view.edited_scene import EditedScene
from clrender.view.history import History
from clrender.view.keep import command_line, kept_scene, table_text, write_archive
from clrender.view.lights import emitter_keys, emitter_parameters, emitters
from clrender.view.outline import outline

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LIT: dict[str, Any] = {
    "camera": {"position": [0, 0, 3], "target": [0, 0, 0]},
    "materials": {"white": {"type": "lambert", "reflectance": [0.7, 0.7, 0.7]}},
    "shapes": [
        {"type": "sphere", "radius": 0.5, "material": "white"},
        {"type": "sphere", "center": [0, 2, 0], "radius": 0.1, "emission": [9.0, 8.0, 7.0], "name": "lamp"},
    ],
    "lights": [
        {"type": "point", "position": [0, 3, 0], "intensity": [5, 5, 5]},
        {"type": "spot", "position": [1, 1, 1], "direction": [0, -1, 0], "intensity": [1, 1, 1], "cone_degrees": 30},
        {"type": "directional", "direction": [0, -1, 0], "irradiance": [1, 1, 1]},
        {"type": "sun_sky", "sun_direction": [0, 1, 1]},
    ],
}


@pytest.fixture
def lit() -> EditedScene:
    return EditedScene.of(clrender.Scene.model_validate(LIT), {"width": 32, "height": 24})


@pytest.fixture
def pictured(tmp_path: Path) -> EditedScene:
    """With an environment map and a texture."""
    folder = tmp_path / "scene"
    folder.mkdir()
    for name in ("sky.png", "tiles.png"):
        Image.fromarray(np.random.default_rng(len(name)).integers(0, 255, (8, 16, 3), np.uint8)).save(folder / name)
    (folder / "scene.toml").write_text("""
        [camera]
        position = [0.0, 0.0, 3.0]
        target = [0.0, 0.0, 0.0]
        [render]
        spp = 5
        [materials.tiles]
        type = "lambert"
        reflectance = {texture = "tiles.png"}
        [[shapes]]
        type = "sphere"
        radius = 0.5
        material = "tiles"
        [[lights]]
        type = "environment"
        file = "sky.png"
    """)
    return EditedScene.of(clrender.load(folder / "scene.toml"), {"seed": 7})


# --- lights ---


def test_every_number_of_a_light_can_be_given_back(lit: EditedScene) -> None:
    known = emitters(lit.scene)
    assert list(known) == ["lights[0]", "lights[1]", "lights[2]", "lights[3]", "shapes[1]"]
    for place, part in known.items():
        table = {each["name"]: each for each in json.loads(json.dumps(emitter_parameters(part)))}
        assert {each["kind"] for each in table.values()} <= {"number", "color", "vector", "flag"}
        given = {key: table[key]["value"] for key in emitter_keys(part) if key in part.model_fields_set}
        assert given
        assert emitters(lit.with_light(place, given).checked.scene)[place] == part


def test_places_and_directions_are_no_colours(lit: EditedScene) -> None:
    kinds = {each["name"]: each["kind"] for each in emitter_parameters(lit.scene.lights[1])}
    assert {name for name, kind in kinds.items() if kind == "vector"} == {"position", "direction"}
    assert kinds["intensity"] == "color"
    assert {each["name"] for each in emitter_parameters(emitters(lit.scene)["shapes[1]"])} == {
        "emission",
        "center",
        "radius",
        "visible_to_camera",
    }


def test_a_changed_light_is_that_of_the_scene_and_nothing_else_changes(lit: EditedScene) -> None:
    changed = lit.with_light("lights[0]", {"intensity": [1.0, 2.0, 3.0]}).with_light("shapes[1]", {"radius": 0.2})
    scene = changed.job.scene
    expected = lit.scene.changed({"lights[0].intensity": [1.0, 2.0, 3.0], "shapes[1].radius": 0.2})
    assert scene.sha256() == expected.sha256() != lit.scene.sha256()
    assert scene.shapes[0] is lit.scene.shapes[0]
    assert changed.restarts(lit)
    assert changed.reset("lights").job.scene.sha256() == lit.scene.sha256()
    assert tables.state(changed)["changed"] == ["lights[0]", "shapes[1]"]
    told = tables.scene(changed)["emitters"]
    assert told["shapes[1]"]["label"] == "lamp (shapes[1])"
    assert {each["name"]: each["value"] for each in told["lights[0]"]["parameters"]}["intensity"] == (1.0, 2.0, 3.0)
    assert not changed.reread(lit.scene.model_copy()).lights


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.with_light("lights[9]", {"intensity": [1, 1, 1]}),
        lambda s: s.with_light("shapes[0]", {"emission": [1, 1, 1]}),
        lambda s: s.with_light("lights[0]", {"intensity": [-1, 1, 1]}),
        lambda s: s.with_light("lights[0]", {"type": "spot"}),
        lambda s: s.with_light("lights[1]", {"direction": [0, 0, 0]}),
        lambda s: s.with_light("lights[3]", {"sun_direction": [0, -1, 0]}),
        lambda s: s.with_light("shapes[1]", {"emission": {"texture": "/etc/passwd"}}),
        lambda s: s.with_light("shapes[1]", {"material": "white"}),
        lambda s: s.with_light("lights[0]", {"intensity": {"blackbody": 3000}}),
    ],
)
def test_what_is_no_light_is_refused(lit: EditedScene, change: Callable[[EditedScene], EditedScene]) -> None:
    with pytest.raises(ClrenderError) as refused:
        change(lit)
    assert "\n" not in str(refused.value)


def test_an_environment_is_turned_scaled_and_hidden_but_its_file_stays(pictured: EditedScene) -> None:
    values = {"rotate_degrees": 90.0, "scale": [2.0, 2.0, 2.0], "visible_to_camera": False}
    light = pictured.with_light("lights[0]", values).job.scene.environment
    assert light is not None
    assert (light.rotate_degrees, light.scale, light.visible_to_camera) == (90.0, (2.0, 2.0, 2.0), False)
    with pytest.raises(UsageError, match="file"):
        pictured.with_light("lights[0]", {"file": "tiles.png"})
    kinds = {each["name"]: each["kind"] for each in emitter_parameters(light)}
    assert kinds["file"] == "fixed"
    assert "radiance" not in kinds


# --- undo and redo ---


def test_edits_are_undone_and_redone_one_by_one(lit: EditedScene) -> None:
    history = History(lambda: 0.0)
    moved = lit.moved({"position": [0, 0, 4]})
    lighter = moved.with_light("lights[0]", {"intensity": [9, 9, 9]})
    history.record(lit, "camera", "a")
    history.record(moved, "intensity of lights[0]", "b")
    assert (history.undo_label, history.redo_label) == ("intensity of lights[0]", None)
    assert history.undo(lighter) == (moved, "intensity of lights[0]")
    assert history.undo(moved) == (lit, "camera")
    assert history.undo(lit) is None
    assert history.redo(lit) == (moved, "camera")
    assert (history.undo_label, history.redo_label) == ("camera", "intensity of lights[0]")
    assert history.redo(moved) == (lighter, "intensity of lights[0]")
    assert history.redo(lighter) is None
    history.undo(lighter)
    history.record(moved, "camera", "c")  # another way from here: what was undone is gone
    assert history.redo_label is None


def test_a_drag_is_one_step_and_two_drags_are_two(lit: EditedScene) -> None:
    now = [0.0]
    history = History(lambda: now[0])
    cameras = [lit.moved({"position": [0, 0, 3 + number]}) for number in range(1, 60)]
    for before in (lit, *cameras[:29]):
        history.record(before, "camera", "camera")
        now[0] += 0.1
    now[0] += 5.0
    for before in cameras[29:-1]:
        history.record(before, "camera", "camera")
        now[0] += 0.1
    assert history.undo(cameras[-1]) == (cameras[29], "camera")
    history.record(cameras[29], "camera", "camera")  # at once, but after an undo: a step of its own
    assert history.undo(cameras[3]) == (cameras[29], "camera")
    assert history.undo(cameras[29]) == (lit, "camera")


def test_other_edits_soon_after_are_steps_of_their_own_and_not_all_are_kept(lit: EditedScene) -> None:
    history = History(lambda: 0.0)
    history.record(lit, "camera", "camera")
    history.record(lit, "spp", "spp")
    history.undo(lit)
    assert history.undo_label == "camera"
    for number in range(1000):
        history.record(lit, str(number), number)
    steps = 0
    while history.undo(lit) is not None:
        steps += 1
    assert 100 <= steps <= 300
    history.clear()
    assert not history.undo_label
    assert history.undo(lit) is None


# --- what is kept ---


def _unpacked(edited: EditedScene, folder: Path) -> Path:
    file = io.BytesIO()
    write_archive(edited, file)
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder)
    return folder / "scene.toml"


EDITS: dict[str, Callable[[EditedScene], EditedScene]] = {
    "nothing": lambda s: s,
    "camera": lambda s: s.moved({"position": [0.25, 0.1, 2.5], "aperture_radius": 0.01}),
    "light": lambda s: s.with_light("lights[0]", {"rotate_degrees": 45.0}),
    "settings": lambda s: s.set({"width": 48, "spp": 3, "filter": "gaussian", "max_depth": 4, "roulette": "none"}),
    "integrator": lambda s: s.set({"integrator": "photon", "photons": 1000}),
    "guiding": lambda s: s.set({"guiding": "on", "guiding_paths": 128}),
    "options": lambda s: s.set({"replicate_spp": 1, "crop": [8, 4, 16, 12]}),
    "error": lambda s: s.set({"spp": 64, "replicate_spp": 4, "error": 0.25}),
}


@for_each("name", EDITS)
def test_a_downloaded_scene_is_that_of_the_view(pictured: EditedScene, tmp_path: Path, name: str) -> None:
    edited = EDITS[name](pictured)
    path = _unpacked(edited, tmp_path / "kept")
    # By the command in the archive, whose options are what a scene file cannot say
    command = shlex.split((path.parent / "command.txt").read_text().splitlines()[-1])
    assert command[:3] == ["clrender", "render", "scene.toml"]
    context = render.make_context("render", [*command[2:-2], "-o", "image.png"])
    options = {key: context.params[key] for key in edited.checked.settings.__dict__ if context.params.get(key)}
    kept = RenderJob.of(clrender.load(path), **options)
    # The hash of a scene has its size, which a view may have got from its command line
    kept = dataclasses.replace(kept, scene=kept.scene.with_checked(image=edited.scene.image))
    assert kept.request() == edited.job.request()
    assert kept.settings == edited.checked.settings
    assert not Path(tomllib.loads(path.read_text())["lights"][0]["file"]).is_absolute()


def test_the_same_scene_makes_the_same_archive(pictured: EditedScene) -> None:
    one, two = io.BytesIO(), io.BytesIO()
    write_archive(pictured, one)
    write_archive(pictured, two)
    assert one.getvalue() == two.getvalue()
    with zipfile.ZipFile(one) as archive:
        assert {each.date_time[0] for each in archive.infolist()} == {1980}


def test_tables_are_told_as_a_scene_file_has_them(lit: EditedScene) -> None:
    edited = lit.with_material("white", {"reflectance": [0.1, 0.2, 0.3]})
    edited = edited.with_light("lights[0]", {"intensity": [1.0, 2.0, 3.0]}).moved({"position": [1, 2, 3]})
    text = table_text(edited, "material", "white")
    assert tomllib.loads(text) == {"materials": {"white": {"type": "lambert", "reflectance": [0.1, 0.2, 0.3]}}}
    assert "reflectance = [0.1, 0.2, 0.3]" in text
    light = tomllib.loads(table_text(edited, "light", "lights[0]"))["lights"]
    assert light == [{"type": "point", "position": [0.0, 3.0, 0.0], "intensity": [1.0, 2.0, 3.0]}]
    assert tomllib.loads(table_text(edited, "light", "shapes[1]"))["shapes"][0]["emission"] == [9.0, 8.0, 7.0]
    assert tomllib.loads(table_text(edited, "camera", ""))["camera"]["position"] == [1.0, 2.0, 3.0]
    for what in ("material", "light"):
        with pytest.raises(UsageError, match=f"no {what}"):
            table_text(edited, what, "nothing")


def test_the_command_line_has_what_was_asked_for_and_is_one(lit: EditedScene) -> None:
    edited = lit.set({"spp": 24, "spectral": True, "crop": [0, 0, 16, 8], "tile": 32})
    words = shlex.split(command_line(edited, "a scene.toml", whole=True))
    assert words[:3] == ["clrender", "render", "a scene.toml"]
    for option in ("--size 32x24", "--spp 24", "--spectral", "--crop 0,0,16x8"):
        assert option in " ".join(words)
    assert "--tile" not in words  # it does not change the image
    done = CliRunner().invoke(render, [*words[2:], "--help"])
    assert done.exit_code == 0
    assert command_line(lit, "s.toml", whole=False) == "clrender render s.toml -o image.png"


def test_settings_of_another_integrator_are_not_kept(lit: EditedScene) -> None:
    scene = lit.scene.changed({"render": {"photons": 500, "spp": 9}})
    edited = EditedScene.of(scene, {})
    assert kept_scene(edited).render.model_dump(exclude_unset=True) == {"spp": 9}


# --- outlines ---


def _drawn(width: int, height: int, path: str) -> set[tuple[float, float, str]]:
    """Unit edges of a path: their middle, and whether they are level or upright."""
    edges = set()
    for piece in path.split("M")[1:]:
        kind = "h" if "h" in piece else "v"
        place, length = piece.split(kind)
        x, y = map(int, place.split())
        assert int(length) > 0
        for step in range(int(length)):
            middle = (x + step + 0.5, y) if kind == "h" else (x, y + step + 0.5)
            assert 0 <= middle[0] <= width and 0 <= middle[1] <= height
            edges.add((*middle, kind))
    return edges


def test_an_outline_has_each_edge_of_the_object_once() -> None:
    mask = np.random.default_rng(3).random((13, 17)) < 0.5
    width, height, path = outline(mask)
    assert (width, height) == (17, 13)
    around = np.pad(mask, 1)
    expected: set[tuple[float, float, str]] = set()
    for y in range(14):
        for x in range(18):
            if around[y, x + 1] != around[y + 1, x + 1] and x < 17:
                expected.add((x + 0.5, y, "h"))
            if around[y + 1, x] != around[y + 1, x + 1] and y < 13:
                expected.add((x, y + 0.5, "v"))
    assert _drawn(width, height, path) == expected


def test_the_outline_of_a_rectangle_is_four_lines_and_that_of_nothing_none() -> None:
    mask = np.zeros((100, 200), bool)
    assert outline(mask) == (200, 100, "")
    mask[10:20, 30:80] = True
    assert outline(mask)[2].count("M") == 4


def test_an_outline_of_too_many_edges_is_coarser() -> None:
    mask = np.random.default_rng(3).random((513, 701)) < 0.5
    width, height, path = outline(mask)
    assert width < 701 and height < 513
    assert path.count("M") <= 20_000
