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
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cases import for_each
from click.testing import CliRunner
from PIL import Image

import clrender
from clrender.cli import main
from clrender.cli.render import render
from clrender.errors import ClrenderError, UsageError
from clrender.image.exposure import photographic_stops
from clrender.image.files import write_image
from clrender.rendering.job import RenderJob
from clrender.view import tables
from clrender.view.edited_scene import EditedScene
from clrender.view.environments import environment_files
from clrender.view.history import History
from clrender.view.keep import command_line, kept_scene, table_text, write_archive
from clrender.view.lights import ADDED, emitter_keys, emitter_parameters, emitters
from clrender.view.outline import outline
from clrender.view.probe import probe

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


@pytest.mark.parametrize("kind", ADDED)
def test_an_added_light_makes_a_white_surface_below_it_white(kind: str) -> None:
    """Irradiance pi at the picked point, which a white surface reflects as radiance 1, or what the exposure needs."""
    plain = {**LIT, "lights": [], "shapes": LIT["shapes"][:1]}
    exposure = {"f_stop": 4.0, "shutter": 0.01, "iso": 400.0}
    exposed = 2.0 ** -photographic_stops(**exposure)
    assert abs(exposed - 1.0) > 0.1
    for camera, white in ((LIT["camera"], 1.0), ({**LIT["camera"], **exposure}, exposed)):
        start = EditedScene.of(clrender.Scene.model_validate({**plain, "camera": camera}), {"width": 8, "height": 8})
        edited, place = start.with_added_light(kind, (0.5, -0.5, 0.0))
        light: Any = edited.emitters[place]
        height = 0.25 * float(np.linalg.norm([0.5, -0.5, -3.0]))
        if kind == "directional":
            irradiance = np.array(light.irradiance)
        elif kind in ("point", "spot"):
            assert np.allclose(light.position, [0.5, -0.5 + height, 0.0], atol=1e-3)
            irradiance = np.array(light.intensity) / height**2
        elif kind == "sphere":
            assert np.allclose(light.center, [0.5, -0.5 + height, 0.0], atol=1e-3)
            irradiance = np.pi * np.array(light.emission) * (light.radius / height) ** 2
        else:
            middle = np.array(light.origin) + 0.5 * (np.array(light.edge_u) + np.array(light.edge_v))
            assert np.allclose(middle, [0.5, -0.5 + height, 0.0], atol=1e-3)
            front = np.cross(light.edge_u, light.edge_v)
            assert np.allclose(front / np.linalg.norm(front), [0.0, -1.0, 0.0], atol=1e-3)  # it shines down
            irradiance = np.array(light.emission) * np.linalg.norm(front) / height**2
        assert np.allclose(irradiance, np.pi * white, rtol=2e-3)


def test_lights_are_added_edited_and_removed(lit: EditedScene) -> None:
    one, first = lit.with_added_light("point", (0.0, 0.0, 0.0))
    two, second = one.with_added_light("sphere", None)
    three, third = two.with_added_light("sphere", (1.0, 0.0, 0.0))
    assert [first, second, third] == ["lights[4]", "shapes[2]", "shapes[3]"]
    assert list(three.emitters) == [*(f"lights[{i}]" for i in range(5)), *(f"shapes[{i}]" for i in (1, 2, 3))]
    changed = three.with_light(third, {"radius": 0.25}).without_light(second)
    scene: Any = changed.job.scene
    assert [shape.type for shape in scene.shapes] == ["sphere"] * 3 and scene.shapes[2].radius == 0.25
    assert changed.place_of_shape(2) == third and changed.place_of_shape(1) == "shapes[1]"
    told = tables.scene(changed)["emitters"]
    assert {name: each["removable"] for name, each in told.items()} == {
        **{f"lights[{i}]": True for i in range(5)}, "shapes[1]": False, third: True,
    }  # fmt: skip
    again, another = changed.without_light("lights[0]").with_added_light("sphere", (0.0, 0.0, 1.0))
    assert another == "shapes[4]"
    assert [light.type for light in again.job.scene.lights] == ["spot", "directional", "sun_sky", "point"]
    with pytest.raises(UsageError, match="is a shape of the scene file; set its emission to 0"):
        lit.without_light("shapes[1]")
    with pytest.raises(UsageError, match="no light 'lights\\[0\\]'"):
        again.without_light("lights[0]")
    assert again.reset("lights").job.scene.sha256() == lit.scene.sha256()


def test_an_environment_is_replaced_by_what_is_offered_and_nothing_else(pictured: EditedScene, tmp_path: Path) -> None:
    folder = pictured.scene.base_folder
    pixels = np.full((2, 4, 3), 0.5, np.float32)
    (folder / "maps").mkdir()
    for name in ("b.exr", "maps/a.hdr"):
        write_image(folder / name, pixels)
    write_image(tmp_path / "outside.exr", pixels)
    (folder / "link.exr").symlink_to(tmp_path / "outside.exr")
    (folder / "elsewhere").symlink_to(tmp_path)
    (folder / ".hidden").mkdir()
    write_image(folder / ".hidden" / "c.exr", pixels)
    (folder / "broken.exr").write_bytes(b"no image")
    assert environment_files(pictured.scene) == ["b.exr", "broken.exr", "maps/a.hdr"]
    start = pictured.with_light("lights[0]", {"visible_to_camera": False, "rotate_degrees": 20.0})
    mapped = start.with_environment("file", "maps/a.hdr")
    light = mapped.job.scene.environment
    assert light is not None and (light.file, light.visible_to_camera, light.rotate_degrees) == (
        "maps/a.hdr",
        False,
        20.0,
    )
    assert tables.scene(mapped)["environment"] == {"place": "lights[0]", "kind": "file", "file": "maps/a.hdr"}
    sky = mapped.with_environment("sky", "")
    assert sky.job.scene.environment is None and sky.job.scene.sky is not None
    assert sky.with_environment("none", "").environment is None
    constant = sky.with_environment("none", "").with_environment("constant", "")
    assert constant.environment == "lights[0]" and constant.job.scene.environment is not None
    assert constant.with_environment("scene", "").job.scene.sha256() == pictured.scene.sha256()
    for name in ("link.exr", "../outside.exr", str(tmp_path / "outside.exr"), "elsewhere/outside.exr", "sky.png", ""):
        with pytest.raises(UsageError, match="no environment map"):
            pictured.with_environment("file", name)
    with pytest.raises(ClrenderError, match=r"broken\.exr"):
        pictured.with_environment("file", "broken.exr")


def test_a_scene_without_an_environment_gets_one_and_loses_it(lit: EditedScene) -> None:
    none = EditedScene.of(clrender.Scene.model_validate({**LIT, "lights": []}), {})
    added = none.with_environment("constant", "")
    assert added.environment == "lights[0]" and tables.state(added)["changed"] == ["lights[0]"]
    assert added.with_environment("none", "").lights == added.with_environment("scene", "").lights == {}
    assert none.with_environment("none", "").job.scene.sha256() == none.scene.sha256()
    beside = lit.with_environment("none", "").with_added_light("point", (0.0, 0.0, 0.0))[0]
    assert [light.type for light in beside.job.scene.lights] == ["point", "spot", "directional", "point"]
    assert beside.with_environment("sky", "").environment == "lights[3]"


def test_every_number_of_a_light_can_be_given_back(lit: EditedScene) -> None:
    known = emitters(lit.scene)
    assert list(known) == ["lights[0]", "lights[1]", "lights[2]", "lights[3]", "shapes[1]"]
    for place, part in known.items():
        table = {each["name"]: each for each in json.loads(json.dumps(emitter_parameters(part)))}
        assert {each["kind"] for each in table.values()} <= {"number", "color", "vector", "flag"}
        given = {key: table[key]["value"] for key in emitter_keys(part) if key in part.model_fields_set}
        assert given
        assert emitters(lit.with_light(place, given).checked.scene)[place] == part


def test_a_spectrum_stays_one_and_its_factor_can_be_changed() -> None:
    """Three numbers would give the light another spectrum, without a word."""
    table = {"wavelengths": [400, 700], "values": [0.1, 0.6]}
    scene = {
        **LIT,
        "materials": {"white": {"type": "lambert", "reflectance": table}},
        "lights": [{"type": "point", "position": [0, 3, 0], "intensity": {"illuminant": "FL11", "scale": 20.0}}],
        "render": {"spectral": True},
    }
    scene["shapes"] = [*LIT["shapes"][:1], {**LIT["shapes"][1], "emission": {"blackbody": 3000.0}}]
    edited = EditedScene.of(clrender.Scene.model_validate(scene), {"width": 32, "height": 24})
    told = {each["name"]: each for each in emitter_parameters(edited.emitters["lights[0]"])}["intensity"]
    assert (told["kind"], told["value"], told["help"]) == ("number", 20.0, "factor of its spectrum FL11")
    lamp = {each["name"]: each for each in emitter_parameters(edited.emitters["shapes[1]"])}["emission"]
    assert (lamp["kind"], lamp["value"], lamp["help"]) == ("number", 1.0, "factor of its black body of 3000 K")
    parameters = tables.scene(edited)["materials"]["white"]["parameters"]
    white = next(each for each in parameters if each["name"] == "reflectance")
    assert (white["kind"], white["value"]) == ("fixed", "spectrum, 400 to 700 nm, times 1")

    brighter = edited.with_light("lights[0]", {"intensity": 40.0}).with_light("shapes[1]", {"emission": 2})
    wanted = {**scene, "lights": [{**scene["lights"][0], "intensity": {"illuminant": "FL11", "scale": 40.0}}]}
    wanted["shapes"] = [*LIT["shapes"][:1], {**LIT["shapes"][1], "emission": {"blackbody": 3000.0, "scale": 2.0}}]
    made = brighter.checked.scene
    expected = clrender.Scene.model_validate(wanted)
    lamp_made: Any = made.lights[0]
    lamp_expected: Any = expected.lights[0]
    assert made.lights == expected.lights and made.shapes == expected.shapes
    assert lamp_made.intensity.spectrum.illuminant == "FL11"
    assert np.array_equal(lamp_made.intensity.values, lamp_expected.intensity.values)
    assert 'illuminant = "FL11"' in table_text(brighter, "light", "lights[0]")
    other: Any = edited.with_material("white", {"reflectance": 0.5}).checked.scene.materials["white"]
    assert other.reflectance.spectrum.scale == 0.5 and other.reflectance.spectrum.values == (0.1, 0.6)
    with pytest.raises(UsageError, match="is a spectrum"):
        edited.with_light("lights[0]", {"intensity": [1.0, 2.0, 3.0]})
    with pytest.raises(UsageError, match="is a spectrum"):
        edited.with_material("white", {"reflectance": [0.5, 0.5, 0.5]})
    with pytest.raises(ClrenderError, match=r"lights\[0\]: intensity\.scale"):
        edited.with_light("lights[0]", {"intensity": -1.0})


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
    assert changed.reread(lit.scene.model_copy()).lights == changed.lights
    assert not changed.reread(lit.scene.changed({"lights[0].intensity": [7.0, 7.0, 7.0]})).lights


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


def test_edits_that_are_no_part_of_a_drag_are_steps_of_their_own(lit: EditedScene) -> None:
    history, now = History(lambda: 0.0), lit
    for _ in range(3):
        history.record(now, "added point light", None)
        now, _ = now.with_added_light("point", None)
    for count in (2, 1, 0):
        found = history.undo(now)
        assert found is not None
        now = found[0]
        assert len(now.lights) == count


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
    top = main.make_context("clrender", ["render"])  # without it, the command would have no -h from then on
    context = render.make_context("render", [*command[2:-2], "-o", "image.png"], top)
    options = {key: context.params[key] for key in edited.checked.settings.__dict__ if context.params.get(key)}
    kept = RenderJob.of(clrender.load(path), **options)
    # The hash of a scene has its size, which a view may have got from its command line
    kept = dataclasses.replace(kept, scene=kept.scene.with_checked(image=edited.scene.image))
    assert kept.request() == edited.job.request()
    assert kept.settings == edited.checked.settings
    assert not Path(tomllib.loads(path.read_text())["lights"][0]["file"]).is_absolute()


def test_a_model_without_light_is_kept_with_the_light_that_it_is_given(tmp_path: Path) -> None:
    """That light is a picture in memory, which is written as OpenEXR: a format whose writer goes back in the file."""
    (tmp_path / "sheet.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    edited = EditedScene.of(clrender.load(tmp_path / "sheet.obj"), {"width": 32, "height": 24})
    kept = clrender.load(_unpacked(edited, tmp_path / "kept"))
    assert kept.sha256() == kept_scene(edited).sha256()


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


def test_a_table_that_names_what_no_scene_file_could_is_refused(pictured: EditedScene, tmp_path: Path) -> None:
    """Of a model with its pictures inside: another scene that is given the table would find nothing there."""
    assert 'texture = "tiles.png"' in table_text(pictured, "material", "tiles")
    assert 'file = "sky.png"' in table_text(pictured, "light", "lights[0]")
    scene = clrender.Scene.model_validate(
        {
            **LIT,
            "materials": {"white": {"type": "lambert", "reflectance": {"texture": "/images/0"}}},
            "lights": [*LIT["lights"][:3], {"type": "environment", "file": "around"}],
        }
    )
    edited = EditedScene.of(scene.placed("model.glb", tmp_path), {})
    for what, name in (("material", "white"), ("light", "lights[3]")):
        with pytest.raises(
            UsageError, match=r"is no file beside the scene but a part of model\.glb: use Download scene"
        ):
            table_text(edited, what, name)
    assert "intensity" in table_text(edited, "light", "lights[0]")


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


MOVING = {**LIT, "camera": {**LIT["camera"], "time": 1.0, "motion": [{"time": 0}, {"time": 1, "position": [0, 0, 2]}]}}


def test_a_camera_in_motion_is_moved_from_where_it_was_as_the_shutter_opened() -> None:
    start = EditedScene.of(clrender.Scene.model_validate(MOVING), {"width": 8, "height": 8})
    assert tables.state(start)["camera"]["position"] == [0.0, 0.0, 2.0]
    moved = start.moved({"target": (0.0, 1.0, 0.0)}).job.scene.camera
    assert not moved.motion and moved.position == (0.0, 0.0, 2.0) and moved.target == (0.0, 1.0, 0.0)
    assert start.moved({"vertical_fov": 20.0}).camera.motion == start.camera.motion


def test_light_and_focus_are_those_of_a_moving_camera_as_the_shutter_opens() -> None:
    start = EditedScene.of(clrender.Scene.model_validate(MOVING), {"width": 8, "height": 8})
    light: Any = start.with_added_light("point", None)[0].job.scene.lights[-1]
    assert light.position == (0.0, 0.5, 0.0)  # a quarter of 2 m
    layers = {
        "object": [0],
        "material": [0],
        "depth": np.array([1.5]),
        "position": np.array([0, 0, 0.5]),
        "normal": np.eye(3)[2],
    }
    progressive: Any = SimpleNamespace(
        image_state=SimpleNamespace(width=8, height=8, film=None, revision=1), probed=lambda x, y: layers
    )
    assert probe(progressive, start, 4, 4)["focus_distance"] == 1.5


def test_an_environment_after_none_has_what_that_of_the_scene_had() -> None:
    sky = {"type": "environment", "radiance": [1, 1, 1], "visible_to_camera": False, "light_group": "sky"}
    start = EditedScene.of(clrender.Scene.model_validate({**LIT, "lights": [sky]}), {"width": 8, "height": 8})
    light: Any = start.with_environment("none", "").with_environment("constant", "").job.scene.lights[0]
    assert not light.visible_to_camera and light.light_group == "sky"
