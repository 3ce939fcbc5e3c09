"""The live view without a device: messages, tables, frames, who may talk to it, and what waits for whom."""

from __future__ import annotations

import gc
import json
import os
import sys
import threading
import time
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cases import for_each
from hypothesis import given
from hypothesis import strategies as st

import clrender
from clrender.errors import ClrenderError, SceneError, UsageError
from clrender.film.ledger import Ledger
from clrender.film.running import RunningFilm
from clrender.film.unit import Unit, UnitSums
from clrender.scheduling.policy import Plan, Remaining
from clrender.settings import SETTINGS
from clrender.view import tables
from clrender.view.broadcaster import MOST_VIEWERS
from clrender.view.edited_scene import NOT_LIVE, EditedScene, camera_toml
from clrender.view.frames import Frame, Frames, encode
from clrender.view.guard import Guard
from clrender.view.image_state import ImageState
from clrender.view.inbox import Inbox
from clrender.view.keep import command_line, table_text
from clrender.view.messages import MESSAGE_BYTES, MoveCamera, Probe, Restart, parse
from clrender.view.parameters import changeable, parameters
from clrender.view.priority import lower_priority
from clrender.view.progressive import Progressive
from clrender.view.viewer import Viewer
from clrender.view.watch import Watcher

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MATERIALS: dict[str, dict[str, Any]] = {
    "lambert": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]},
    "checked": {"type": "lambert", "reflectance": {"checker": [[0, 0, 0], [1, 1, 1]]}},
    "mirror": {"type": "mirror"},
    "glass": {"type": "dielectric", "ior": 1.5},
    "rough": {"type": "oren_nayar", "reflectance": [0.5, 0.5, 0.5]},
    "gold": {"type": "conductor", "metal": "Au"},
    "plastic": {"type": "principled"},
    "wax": {"type": "subsurface", "albedo": 0.5, "radius": 0.1},
    "mixed": {"type": "mix", "materials": ["mirror", "lambert"]},
}


@pytest.fixture(scope="module")
def edited() -> EditedScene:
    return EditedScene.of(clrender.load("room"), {"width": 64, "height": 48})


def of_materials() -> EditedScene:
    camera = {"position": [0, 0, 3], "target": [0, 0, 0]}
    return EditedScene.of(clrender.Scene.model_validate({"camera": camera, "materials": MATERIALS}), {})


# --- messages ---


@for_each(
    ("text", "words"),
    [
        ("", "JSON"),
        ("{", "JSON"),
        ("[]", "object"),
        ("{}", "type"),
        ('{"type": "shutdown"}', "shutdown"),
        ('{"type": "probe", "x": -1, "y": 0}', "x: "),
        ('{"type": "probe", "x": 1.5, "y": 0}', "x: "),
        ('{"type": "probe", "x": true, "y": 0}', "x: "),
        ('{"type": "probe", "x": 1, "y": 0, "z": 0}', "z: "),
        ('{"type": "probe", "x": 1, "y": 0, "id": {}}', "id"),
        ('{"type": "show", "layers": []}', "layers"),
        ('{"type": "show", "layers": ["image", "depth", "normal", "uv"]}', "layers"),
        ('{"type": "show", "layers": ["image"], "max_side": 100000}', "max_side"),
        ('{"type": "save", "name": "a.png", "tone_map": "film"}', "tone_map"),
        ('{"type": "save", "name": "a.png", "exposure": NaN}', "exposure"),
        ('{"type": "run", "run": 1}', "run"),
        ('{"type": "restart", "id": "' + "x" * MESSAGE_BYTES + '"}', f"{MESSAGE_BYTES:,} bytes"),
        ("[" * 20000 + "]" * 20000, "recursion|JSON|object"),
    ],
)
def test_a_malformed_message_is_refused_in_a_sentence(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words) as refused:
        parse(text)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 500


@given(st.text(max_size=200) | st.recursive(st.none() | st.floats() | st.text(), st.lists).map(json.dumps))
def test_no_text_does_more_than_be_refused(text: str) -> None:
    with pytest.raises(UsageError):
        parse(text)


# --- what is looked at ---


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.moved({"vertical_fov": 200}),
        lambda s: s.moved({"position": [0.0, 2.0, 0.0]}),
        lambda s: s.moved({"position": [float("nan"), 2.0, 0.0]}),
        lambda s: s.moved({"file": "/etc/passwd"}),
        lambda s: s.set({"spp": 0}),
        lambda s: s.set({"integrator": "mlt"}),
        lambda s: s.set({"photons": 10}),
        lambda s: s.set({"time_limit": 3.0}),
        lambda s: s.set({"__class__": 3}),
        lambda s: s.set({"width": 10**9}),
        lambda s: s.with_material("whit", {"reflectance": [0, 0, 0]}),
        lambda s: s.with_material("white", {"type": "mirror"}),
        lambda s: s.with_material("white", {"reflectance": {"texture": "/etc/passwd"}}),
        lambda s: s.with_material("white", {"reflectance": "/etc/passwd"}),
        lambda s: s.with_material("white", {"reflectance": [[1], 2, 3]}),
        lambda s: s.with_material("white", {"normal_map": {"texture": "/etc/passwd"}}),
        lambda s: s.with_material("white", {"reflectance": [2.0, 0.0, 0.0]}),
        lambda s: s.with_material("glass", {"ior": None}),
    ],
)
def test_what_cannot_be_rendered_is_refused(edited: EditedScene, change: Callable[[EditedScene], EditedScene]) -> None:
    with pytest.raises(ClrenderError) as refused:
        change(edited)
    assert str(refused.value).count("\n") == 0


def test_only_what_makes_another_image_restarts_it(edited: EditedScene) -> None:
    assert not edited.set({"spp": 1000}).restarts(edited)
    assert not edited.set({"tile": 32}).restarts(edited)
    assert not edited.moved({}).restarts(edited)
    assert edited.set({"seed": 1}).restarts(edited)
    assert edited.set({"width": 65}).restarts(edited)
    assert edited.moved({"position": [0.0, 2.0, 5.5]}).restarts(edited)
    assert edited.with_material("white", {"reflectance": [0.1, 0.1, 0.1]}).restarts(edited)


def test_a_moved_camera_is_that_of_the_job_and_checks_nothing_else(edited: EditedScene) -> None:
    moved = edited.moved({"position": [0.5, 2.0, 5.0], "aperture_radius": 0.1})
    assert moved.job.scene.camera.position == (0.5, 2.0, 5.0)
    assert moved.job.scene.shapes is edited.scene.shapes
    assert moved.checked is edited.checked
    assert moved.moved({"aperture_radius": None}).camera.aperture_radius == 0.0
    assert moved.reset("camera").camera == edited.camera


def test_settings_of_another_integrator_are_forgotten(edited: EditedScene) -> None:
    photons = edited.set({"integrator": "photon", "photons": 1000})
    assert photons.set({"integrator": "path"}).settings == {"integrator": "path"}
    ending = edited.set({"roulette": "constant", "termination": 0.5})
    assert ending.set({"roulette": None}).settings == {}
    assert ending.set({"termination": None}).settings == {"roulette": "constant"}


@for_each(
    ("asked", "change"),
    [
        ({"guiding": "on", "guiding_paths": 100}, {"integrator": "bdpt"}),
        ({"guiding": "on"}, {"integrator": "bdpt"}),
        ({"guiding": "on", "guiding_paths": 100}, {"guiding": "off"}),
        ({"error": 0.1, "share": 0.9, "replicate_spp": 32}, {"integrator": "photon"}),
        ({"light_sampler": "bvh"}, {"integrator": "photon"}),
        ({"indirect_rays": 2, "sampling": "light"}, {"integrator": "bdpt"}),
        ({"roulette": "constant", "termination": 0.5}, {"roulette": "throughput"}),
    ],
)
def test_what_the_command_line_gave_stands_in_the_way_of_no_integrator(
    asked: dict[str, Any], change: dict[str, Any]
) -> None:
    edited = EditedScene.of(clrender.load("room"), asked)
    other = edited.set(change)
    made = other.checked.settings
    assert all(getattr(made, name) == value for name, value in change.items())
    words = command_line(other, "room", whole=True)
    for name in asked.keys() - change.keys():
        assert str(SETTINGS[name].option) not in words.split()
    back = other.set(dict.fromkeys(other.settings))
    assert back.checked.settings == edited.checked.settings
    with pytest.raises(UsageError):
        EditedScene.of(clrender.load("room"), {**asked, **change})


def test_a_setting_that_was_turned_off_does_not_come_back_with_another_integrator() -> None:
    edited = EditedScene.of(clrender.load("room"), {"guiding": "on"}).set({"guiding": "off"})
    assert edited.set({"integrator": "bdpt"}).checked.settings.integrator == "bdpt"


def test_a_camera_that_rests_after_an_edit_is_one_that_rests() -> None:
    scene = clrender.load("cornell")
    keys = [{"time": 0.0, "position": [0, 1, 5]}, {"time": 1.0, "position": [1, 1, 5]}]
    moving = scene.changed({"camera": scene.camera.changed({"shutter": (0.0, 1.0), "motion": keys})})
    edited = EditedScene.of(moving, {})
    with pytest.raises(ClrenderError, match="takes nothing that moves"):
        edited.set({"integrator": "radiosity"})
    resting = edited.moved({"position": [0.5, 1.0, 5.0]})
    solved = resting.set({"integrator": "radiosity"})
    assert solved.job.settings.integrator == "radiosity" and not solved.job.scene.camera.motion
    with pytest.raises(ClrenderError, match="takes nothing that moves"):
        solved.moved({"motion": keys})
    with pytest.raises(ClrenderError, match="takes nothing that moves"):
        solved.reset("camera")
    assert resting.moved({"motion": keys}).job.scene.camera.motion


def test_a_scene_that_is_read_again_keeps_the_camera_unless_it_has_another(edited: EditedScene) -> None:
    moved = edited.moved({"position": [0.5, 2.0, 5.0]}).with_material("white", {"reflectance": [0, 0, 0]})
    scene = edited.scene
    again = moved.reread(scene.model_copy())
    assert again.camera == moved.camera
    other = scene.changed({"camera": scene.camera.changed({"vertical_fov": 30.0})})
    assert moved.reread(other).camera.vertical_fov == 30.0


def test_a_scene_that_is_read_again_keeps_edits_of_what_is_the_same(edited: EditedScene) -> None:
    """Where its camera alone is another, as that of a file of cameras, no material or light is reset."""
    moved = edited.moved({"position": [0.5, 2.0, 5.0]}).with_material("white", {"reflectance": [0, 0, 0]})
    moved = moved.without_light("lights[0]") if edited.scene.lights else moved
    scene = edited.scene
    other = scene.changed({"camera": scene.camera.changed({"vertical_fov": 30.0})})
    again = moved.reread(other)
    assert again.scene is other and again.materials == moved.materials and again.lights == moved.lights
    white: Any = again.checked.scene.materials["white"]
    assert white.reflectance == (0.0, 0.0, 0.0)
    assert again.ended(moved) == ["camera"]
    assert moved.reread(scene.model_copy()).ended(moved) == []
    same = scene.changed({"camera": scene.camera.changed({"position": (0.5, 2.0, 5.0)})})
    assert moved.reread(same).ended(moved) == []
    red = scene.changed({"materials.white.reflectance": (1.0, 0.0, 0.0)})
    changed = moved.reread(red)
    assert not changed.materials and not changed.lights and changed.camera == moved.camera
    assert changed.ended(moved) == [name for name in moved.edits if name != "camera"]


def test_settings_that_the_scene_does_not_take_any_more_are_forgotten() -> None:
    scene = clrender.load("room")
    small = scene.changed({"image.width": 40, "image.height": 30})
    edited = EditedScene.of(scene, {}).set({"crop": (100, 80, 50, 40), "seed": 3, "max_depth": 5})
    again = edited.reread(small)
    assert again.settings == {"seed": 3, "max_depth": 5} and again.checked.settings.film_size == (40, 30)
    assert again.ended(edited) == ["crop"]
    # Those that belong to one that is forgotten, too
    box = clrender.load("cornell")
    solved = EditedScene.of(box, {}).set({"integrator": "radiosity", "patches": 500, "seed": 3})
    keys = [{"time": 0.0, "position": [0, 1, 5]}, {"time": 1.0, "position": [1, 1, 5]}]
    moving = box.changed({"camera": box.camera.changed({"shutter": (0.0, 1.0), "motion": keys})})
    assert solved.reread(moving).settings == {"seed": 3}
    # And what the command line asks for is the file's affair
    given = EditedScene.of(scene, {"crop": (100, 80, 50, 40)}).set({"seed": 3})
    with pytest.raises(UsageError, match="not within the image of 40 x 30"):
        given.reread(small)


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"aperture_radius": 0.25, "focus_distance": 1e-7, "blades": 6},
        {"position": [1e12, -1.2345678901234567, 0.1], "f_stop": 2.8, "shutter": 0.008},
        {"type": "orthographic", "vertical_fov": None, "height": 3.0, "mirrored": True},
    ],
)
def test_the_camera_as_toml_is_that_camera(edited: EditedScene, keys: dict[str, Any]) -> None:
    camera = edited.moved(keys).camera
    text = camera_toml(camera)
    assert type(camera).model_validate(tomllib.loads(text)["camera"]) == camera
    assert text.startswith("[camera]\n")
    assert max(text.splitlines(), key=len).count("=") == 1


@for_each("name", MATERIALS)
def test_every_number_of_a_material_can_be_given_back(name: str) -> None:
    edited = of_materials()
    material = edited.scene.materials[name]
    table = {each["name"]: each for each in json.loads(json.dumps(parameters(material)))}
    assert table
    assert {each["kind"] for each in table.values()} <= {"number", "integer", "color", "flag", "choice", "fixed"}
    same = {key: table[key]["value"] for key in changeable(material) if table[key]["kind"] != "fixed"}
    given = {key: value for key, value in same.items() if key in material.model_fields_set}
    assert edited.with_material(name, given).checked.scene.materials[name] == material


def test_textures_and_structure_cannot_be_changed() -> None:
    edited = of_materials()
    kinds = {each["name"]: each["kind"] for each in parameters(edited.scene.materials["checked"])}
    assert kinds["reflectance"] == "fixed"
    kinds = {each["name"]: each["kind"] for each in parameters(edited.scene.materials["mixed"])}
    assert kinds["materials"] == "fixed"
    with pytest.raises(UsageError, match="materials"):
        edited.with_material("mixed", {"materials": ["gold", "glass"]})


def test_what_a_page_offers_is_not_refused_whatever_the_value() -> None:
    """An index that a dispersion says is told in words; what may be without a value is told so, but not of lights."""
    camera = {"position": [0, 0, 3], "target": [0, 0, 0]}
    materials = {
        "crown": {"type": "dielectric", "dispersion": {"glass": "BK7"}},
        "abbe": {"type": "dielectric", "ior": 1.5, "dispersion": {"abbe": 40.0}},
        "gold": {"type": "conductor", "f0": [0.9, 0.6, 0.3], "termination": 0.5},
    }
    lights = [{"type": "point", "position": [0, 1, 0], "intensity": [1, 1, 1]}]
    whole = clrender.Scene.model_validate({"camera": camera, "materials": materials, "lights": lights})
    edited = EditedScene.of(whole, {})
    told = {name: {each["name"]: each for each in parameters(whole.materials[name])} for name in materials}
    assert (told["crown"]["ior"]["kind"], told["crown"]["ior"]["value"]) == ("fixed", "1.5168")
    assert told["abbe"]["ior"]["kind"] == "number"
    abbe: Any = edited.with_material("abbe", {"ior": 1.6}).checked.scene.materials["abbe"]
    assert abbe.ior == 1.6
    optional = {name for name, each in told["gold"].items() if each["optional"]}
    assert {"termination", "metal", "eta"} <= optional
    assert not optional & {"roughness", "two_sided", "microfacets"}
    assert edited.with_material("gold", {"termination": None}).checked.scene.materials["gold"].termination is None
    emitters = tables.scene(edited)["emitters"]
    assert not any(each["optional"] for each in emitters["lights[0]"]["parameters"])


def test_long_tables_keep_what_somebody_works_on(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = {"position": [0, 0, 3], "target": [0, 0, 0]}
    lamp = {"type": "point", "position": [0, 1, 0], "intensity": [1, 1, 1]}
    materials = {f"m{i}": {"type": "lambert", "reflectance": 0.5} for i in range(6)}
    lights = [*[lamp] * 5, {"type": "environment", "radiance": 0.5}]
    whole = clrender.Scene.model_validate({"camera": camera, "materials": materials, "lights": lights})
    monkeypatch.setattr(tables, "MOST_MATERIALS", 2)
    monkeypatch.setattr(tables, "_MOST_LIGHTS", 2)
    edited = EditedScene.of(whole, {}).with_material("m4", {"reflectance": 0.2})
    edited, added = edited.with_added_light("point", None)
    edited = edited.with_light("lights[3]", {"position": [0, 2, 0]})
    told = tables.scene(edited, ["m3"])
    assert list(told["materials"]) == ["m0", "m1", "m3", "m4"]
    assert list(told["emitters"]) == ["lights[0]", "lights[1]", "lights[3]", "lights[5]", added]
    assert (told["material_count"], told["emitter_count"]) == (6, 7)
    assert told["environment"]["place"] == "lights[5]"


def test_a_page_is_told_of_every_setting_that_it_may_change(edited: EditedScene) -> None:
    told = json.loads(json.dumps(tables.hello([], ["a.png"], {"tone_map": "agx", "exposure": 2.0}), allow_nan=False))
    assert told["look"] == {"tone_map": "agx", "exposure": 2.0}
    assert [each["name"] for each in told["settings"]] == [name for name in SETTINGS if name not in NOT_LIVE]
    assert told["saves"] == ["a.png"]
    state = json.loads(json.dumps(tables.state(edited), allow_nan=False))
    assert set(state["settings"]) == {each["name"] for each in told["settings"]}
    assert set(json.loads(json.dumps(tables.scene(edited)))["materials"]) == set(edited.scene.materials)


# --- who may talk to it ---

HOST = {"host": "127.0.0.1:8000"}


@for_each(
    ("headers", "token", "allowed"),
    [
        (HOST, "secret", True),
        ({"host": "localhost:8000"}, "secret", True),
        ({"host": "[::1]:8000"}, "secret", True),
        ({**HOST, "origin": "http://127.0.0.1:8000"}, "secret", True),
        ({**HOST, "cookie": "a=b; clrender-view-8000=secret"}, None, True),
        (HOST, None, False),
        (HOST, "", False),
        (HOST, "secre", False),
        (HOST, "secret\u00e9", False),
        ({**HOST, "cookie": "clrender-view-8001=secret"}, None, False),
        ({**HOST, "cookie": "clrender-view-8000=other"}, None, False),
        ({**HOST, "cookie": "clrender-view-8000=secret"}, "other", False),
        ({**HOST, "origin": "http://evil.example"}, "secret", False),
        ({**HOST, "origin": "http://127.0.0.1:8001"}, "secret", False),
        ({**HOST, "origin": "https://127.0.0.1:8000"}, "secret", False),
        ({**HOST, "origin": "null"}, "secret", False),
        ({**HOST, "sec-fetch-site": "cross-site"}, "secret", False),
        ({**HOST, "sec-fetch-site": "same-site"}, "secret", False),
        ({"host": "evil.example:8000", "origin": "http://evil.example:8000"}, "secret", False),
        ({"host": "127.0.0.1:8001"}, "secret", False),
        ({"host": "127.0.0.1"}, "secret", False),
        ({"host": "127.0.0.1.evil.example:8000"}, "secret", False),
        ({}, "secret", False),
    ],
)
def test_the_guard_lets_nobody_else_pass(headers: dict[str, str], token: str | None, allowed: bool) -> None:
    assert Guard("secret", 8000, "127.0.0.1").allows(headers, token) is allowed


# --- frames ---


def test_a_frame_says_what_it_holds() -> None:
    pixels = np.array([[[1.0, -2.0, 1e9], [0.5, np.inf, np.nan]]], np.float32)
    state = ImageState(7, 4, 2, 16)
    data = encode(Frame(state, "normal", pixels, 3, 1.5, True, False), 9, True, "a")
    start = 4 + int.from_bytes(data[:4], "little")
    header = json.loads(data[4:start])
    assert start % 8 == 0
    assert (header["frame"], header["revision"], header["answers"], header["samples"]) == (9, 7, "a", 1.5)
    assert (header["width"], header["height"], header["channels"], header["format"]) == (2, 1, 3, "float16")
    assert (header["image_width"], header["image_height"], header["coarse"], header["final"]) == (4, 2, True, False)
    assert header["range"] == [-2.0, 1e9]
    sent = np.frombuffer(data[start:], "<f2").reshape(1, 2, 3)
    assert sent[0, 0].tolist() == [1.0, -2.0, 65504.0]
    assert np.isnan(sent[0, 1, 2])
    exact = encode(Frame(state, "depth", pixels[..., :1] + 1e-4, 3, 1.5, False, True), 1, True, None)
    assert json.loads(exact[4 : 4 + int.from_bytes(exact[:4], "little")])["format"] == "float32"


class _FakeEngine:
    """What a viewer needs of an engine, without one that renders."""

    def __init__(self) -> None:
        self.frames = Frames()
        self.displayed = ImageState(1, 8, 8, 4, preview=np.ones((2, 2, 3), np.float32), changes=1)
        self.superseded = False
        self.posted: list[Any] = []

    def wake_renderer(self) -> None:
        pass

    def post(self, viewer: Viewer, message: Any) -> None:
        self.posted.append(message)


def frame_of(taken: str | bytes | None) -> dict[str, Any] | None:
    if not isinstance(taken, bytes):
        return None
    header: dict[str, Any] = json.loads(taken[4 : 4 + int.from_bytes(taken[:4], "little")])
    return header


def test_who_does_not_acknowledge_gets_one_frame_and_then_the_newest() -> None:
    engine = _FakeEngine()
    viewer = Viewer(engine, 1, lambda: None)  # type: ignore[arg-type]
    first = frame_of(viewer.take())
    assert first is not None
    for change in range(2, 6):
        engine.displayed.changes = change
        assert viewer.take() is None
    engine.displayed.preview = np.full((4, 4, 3), 2.0, np.float32)
    engine.displayed.changes = 6
    viewer.receive(json.dumps({"type": "ack", "frame": first["frame"] + 1}))  # of no frame
    assert viewer.take() is None
    viewer.receive(json.dumps({"type": "ack", "frame": first["frame"]}))
    second = frame_of(viewer.take())
    assert second is not None
    assert second["width"] == 4
    viewer.receive(json.dumps({"type": "ack", "frame": second["frame"]}))
    assert viewer.take() is None  # there is nothing newer


def test_of_an_image_that_is_about_to_be_replaced_one_frame_is_enough() -> None:
    engine = _FakeEngine()
    engine.superseded = True
    viewer = Viewer(engine, 1, lambda: None)  # type: ignore[arg-type]
    first = frame_of(viewer.take())
    assert first is not None  # a moving camera shows something
    viewer.receive(json.dumps({"type": "ack", "frame": first["frame"]}))
    engine.displayed.changes = 2
    assert viewer.take() is None
    engine.superseded = False
    assert frame_of(viewer.take()) is not None


def test_a_camera_that_comes_while_a_frame_is_made_stops_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = _FakeEngine()
    viewer = Viewer(engine, 1, lambda: None)  # type: ignore[arg-type]
    first = frame_of(viewer.take())
    assert first is not None
    viewer.receive(json.dumps({"type": "ack", "frame": first["frame"]}))
    engine.displayed.changes = 2
    newest = engine.frames.newest

    def meanwhile(*args: Any) -> Any:
        engine.superseded = True
        return newest(*args)

    monkeypatch.setattr(engine.frames, "newest", meanwhile)
    assert viewer.take() is None
    engine.superseded = False
    monkeypatch.undo()
    assert frame_of(viewer.take()) is not None


def test_state_that_nobody_took_is_replaced_and_replies_are_not() -> None:
    engine = _FakeEngine()
    viewer = Viewer(engine, 1, lambda: None)  # type: ignore[arg-type]
    for number in range(100):
        viewer.send("state", {"number": number})
        viewer.send("probe", {"number": number}, newest=False)
    taken = [json.loads(each) for each in iter(viewer.take, None) if isinstance(each, str)]
    assert [each["number"] for each in taken if each["type"] == "state"] == [99]
    assert [each["number"] for each in taken if each["type"] == "probe"] == list(range(100))


def test_messages_are_taken_in_the_order_in_which_the_newest_were_sent() -> None:
    viewer = Viewer(_FakeEngine(), 1, lambda: None)  # type: ignore[arg-type]
    for kind in ("state", "progress", "state"):
        viewer.send(kind, {})
    taken = [json.loads(each)["type"] for each in iter(viewer.take, None) if isinstance(each, str)]
    assert taken == ["progress", "state"]


def test_who_takes_no_replies_is_hung_up_on() -> None:
    engine = _FakeEngine()
    viewer = Viewer(engine, 1, lambda: None)  # type: ignore[arg-type]
    for _ in range(1000):
        viewer.send("probe", {}, newest=False)
    assert viewer.closed
    assert sum(1 for _ in iter(viewer.take, None)) <= 257


def test_malformed_messages_are_replied_to_and_then_end_it() -> None:
    engine = _FakeEngine()
    viewer = Viewer(engine, 1, lambda: None)  # type: ignore[arg-type]
    for text in ("{", b"\x00", '{"type": "show", "layers": ["depht"]}', '{"type": "probe", "x": 1, "y": 1, "id": 5}'):
        viewer.receive(text)
    refused = [json.loads(each) for each in iter(viewer.take, None) if isinstance(each, str)]
    assert [each["to"] for each in refused] == [None, None, "show"]
    assert len(engine.posted) == 1
    assert viewer.closed is None
    for _ in range(200):
        viewer.receive("nonsense")
    assert viewer.closed


# --- what waits ---


def moved(x: float, number: int) -> MoveCamera:
    return MoveCamera(type="camera", id=number, camera={"position": [x, 0.0, 0.0]})


def test_a_camera_that_waits_is_replaced_by_a_newer_one_of_the_same_viewer() -> None:
    inbox, one, other = Inbox(), SimpleNamespace(), SimpleNamespace()
    followed: list[Any] = []
    for number in range(10_000):
        inbox.post(one, moved(float(number), number))  # type: ignore[arg-type]
    inbox.post(other, moved(-1.0, 1))  # type: ignore[arg-type]
    inbox.post(one, MoveCamera(type="camera", camera={"vertical_fov": 30.0}))  # type: ignore[arg-type]
    inbox.post(one, MoveCamera(type="camera", id="z", camera={"up": [0, 1, 0]}))  # type: ignore[arg-type]
    assert inbox.camera_waits
    inbox.process(lambda viewer, message: followed.append((viewer, message)))
    assert [message.id for _, message in followed] == [9999, 1, "z"]
    assert followed[2][1].camera == {"vertical_fov": 30.0, "up": [0, 1, 0]}
    inbox.post(one, Restart(type="restart"))  # type: ignore[arg-type]
    assert not inbox.camera_waits


def test_too_many_messages_are_refused_and_calls_are_cancelled_at_the_end() -> None:
    inbox, one = Inbox(), SimpleNamespace()
    with pytest.raises(UsageError, match="wait already"):
        for _ in range(1000):
            inbox.post(one, Restart(type="restart"))  # type: ignore[arg-type]
    called = inbox.call(lambda: 3)
    failing = inbox.call(lambda: int("x"))
    inbox.process(lambda viewer, message: None)
    assert called.result(1) == 3
    assert isinstance(failing.exception(1), ValueError)
    late = inbox.call(lambda: 4)
    inbox.refuse_all()
    assert late.cancelled()
    assert inbox.call(lambda: 5).cancelled()


def test_a_call_may_wait_for_the_messages_that_came_before_it() -> None:
    inbox, order = Inbox(), []
    for number in range(3):
        inbox.post(SimpleNamespace(), parse(json.dumps({"type": "probe", "x": number, "y": 0})))  # type: ignore[arg-type]
    last = inbox.call(lambda: order.append("last"), after_messages=True)
    inbox.call(lambda: order.append("first"))
    inbox.process(lambda _, message: order.append(message.x))  # type: ignore[attr-defined]
    assert order == ["first", 0, 1, 2, "last"]
    assert last.done()
    waiting = inbox.call(lambda: None, after_messages=True)
    inbox.refuse_all()
    assert waiting.cancelled()


def test_wake_ups_that_wait_are_one() -> None:
    inbox = Inbox()
    for _ in range(1000):
        inbox.wake()
    assert inbox.pending
    inbox.wait()
    inbox.process(lambda viewer, message: None)
    assert not inbox.pending


def test_a_reader_of_the_layers_that_are_shown_misses_none_while_their_turns_change() -> None:
    """The render thread reads them while a transport takes a frame, which puts its layer last."""
    engine = _FakeEngine()
    engine.displayed.layers = {"normal": np.ones((8, 8, 3), np.float32)}
    viewer = Viewer(engine, 1, lambda: None)  # type: ignore[arg-type]
    viewer.receive(json.dumps({"type": "show", "layers": ["image", "normal"]}))
    reader = iter(viewer._streams)
    names = {next(reader).layer}
    assert frame_of(viewer.take()) is not None
    names |= {each.layer for each in reader}
    assert names == {"image", "normal"}


def test_the_reader_is_woken() -> None:
    inbox = Inbox()
    threading.Timer(0.05, lambda: inbox.post(SimpleNamespace(), Probe(type="probe", x=0, y=0))).start()  # type: ignore[arg-type]
    inbox.wait()
    assert inbox.pending


def test_a_file_that_changes_while_it_is_read_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("1")
    told: list[str] = []
    is_read_again = threading.Event()

    def read() -> None:
        told.append(path.read_text())
        if len(told) == 1:
            path.write_text("333")
        else:
            is_read_again.set()

    watcher = Watcher(lambda: [path], read)
    try:
        path.write_text("22")
        assert is_read_again.wait(30.0)
        assert told == ["22", "333"]
    finally:
        watcher.close()


@pytest.mark.long
def test_a_file_that_changes_is_noticed_once_it_is_whole(tmp_path: Path) -> None:
    path, missing = tmp_path / "scene.toml", tmp_path / "later.ply"
    path.write_text("1")
    told: list[str] = []
    watcher = Watcher(lambda: [path, missing], lambda: told.append(path.read_text() if path.exists() else ""))

    def wait_for(count: int) -> None:
        end = time.monotonic() + 30.0
        while len(told) < count and time.monotonic() < end:
            time.sleep(0.05)
        assert len(told) == count

    try:
        path.write_text("22")
        wait_for(1)
        missing.write_text("x")
        wait_for(2)
        path.unlink()
        wait_for(3)
        time.sleep(1.0)
        assert told == ["22", "22", ""]
    finally:
        watcher.close()


# --- how it refines ---


def test_who_watches_gets_one_sample_of_every_pixel_first_and_twice_as_many_each_time() -> None:
    remaining = Remaining(Plan(64, 64, 0, 100, 64, gradual=True), 1)
    ranges = []
    while (unit := remaining.take(0)) is not None:
        ranges.append((unit.first_sample, unit.sample_count))
        remaining.measured(0, unit, 1e-3)
    assert ranges[:5] == [(0, 1), (1, 2), (3, 4), (7, 8), (15, 16)]
    assert sum(count for _, count in ranges) == 100


def test_what_is_left_after_a_stop_is_taken_gradually_too() -> None:
    ledger = Ledger(64, 64)
    ledger.add(np.arange(256), 0, np.where(np.arange(256) < 100, 3, 1))
    plan = Plan(64, 64, 0, 8, 64, wanted=ledger.lacking(0, 8), gradual=True)
    remaining = Remaining(plan, 1)
    while (unit := remaining.take(0)) is not None:
        ledger.add(unit.blocks(64, 64), unit.first_sample, np.full(unit.slot_count // 16, unit.sample_count))
        remaining.measured(0, unit, 1e-3)
    assert ledger.holds(0, 8)


def test_the_scene_of_a_refused_material_is_not_kept(edited: EditedScene) -> None:
    with pytest.raises(SceneError):
        edited.with_material("white", {"opacity_cutoff": 0.5})
    assert edited.checked.scene.materials["white"].opacity_cutoff is None


def test_pixels_without_a_sample_show_the_coarse_picture_also_where_one_comes_meanwhile() -> None:
    class Busy(RunningFilm):
        """Has a sample of every pixel as soon as its sums are read."""

        def snapshot(self, most: int = 512) -> Any:
            pixels = super().snapshot(most)
            self.counts[:] = 1
            return pixels

    film = Busy(8, 4)
    film.counts[:, :4], film.changes = 1, 1
    state = ImageState(1, 8, 4, 4, preview=np.full((2, 4, 3), 3.0, np.float32), film=film, changes=1)
    frame = Frames().newest(state, "image", 16, (0, 0))
    assert frame is not None and not frame.coarse
    assert (frame.pixels[:, :4] == 0.0).all() and (frame.pixels[:, 4:] == 3.0).all()


@pytest.mark.thorough
def test_what_a_frame_says_of_the_samples_can_be_asked_while_samples_come() -> None:
    """A ledger that is read while it grows has blocks whose set of samples the reader does not know yet."""
    film = RunningFilm(64, 64)
    state = ImageState(1, 64, 64, 4096, film=film)
    failures: list[Exception] = []
    is_over = threading.Event()

    def ask() -> None:
        try:
            while not is_over.is_set():
                assert state.samples <= 40.0
        except Exception as error:
            failures.append(error)

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    asking = threading.Thread(target=ask)
    asking.start()
    try:
        for number in range(4 * 256):
            unit = Unit(16 * (number % 256), 16, number // 256, 1, 64)
            nothing = UnitSums.nothing(unit)
            nothing.done[:] = 1
            film.commit(unit, nothing)
            if failures:
                break
    finally:
        is_over.set()
        asking.join()
        sys.setswitchinterval(before)
    assert not failures


def test_frames_of_an_earlier_image_do_not_keep_its_film() -> None:
    frames = Frames()
    pixels = np.zeros((4, 8, 3), np.float32)
    first = ImageState(1, 8, 4, 4, preview=pixels, layers={"normal": pixels}, changes=1)
    for layer in ("normal", "image"):
        assert frames.newest(first, layer, 16, (0, 0)) is not None
    assert frames.newest(ImageState(2, 8, 4, 4, preview=pixels, changes=1), "image", 16, (0, 0)) is not None
    gone = weakref.ref(first)
    del first
    gc.collect()
    assert gone() is None


def test_a_frame_has_a_quarter_more_samples_or_comes_a_second_later(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    frames, film = Frames(), RunningFilm(8, 4, {})
    state = ImageState(1, 8, 4, 64, film=film)

    def samples_of_newest(seconds: float, samples: int) -> float | None:
        now[0] += seconds
        for _ in range(samples):
            unit = Unit(0, 32, film.samples_taken // 32, 1, 64)
            sums = UnitSums.nothing(unit)
            sums.done[:] = 1
            film.commit(unit, sums)
        state.changes += 1
        frame = frames.newest(state, "image", 16, (0, 0))
        return None if frame is None else frame.samples

    assert [samples_of_newest(0.1, 8), samples_of_newest(0.1, 1), samples_of_newest(0.1, 1)] == [8.0, 8.0, 10.0]
    assert [samples_of_newest(0.01, 5), samples_of_newest(0.1, 0)] == [10.0, 15.0]  # thirty a second at most
    assert [samples_of_newest(0.5, 1), samples_of_newest(0.6, 0)] == [15.0, 16.0]
    samples_of_newest(0.0, 1)
    state.idle = True
    assert samples_of_newest(0.0, 0) == 17.0


def test_frames_of_many_sizes_are_not_all_kept() -> None:
    frames = Frames()
    state = ImageState(1, 8, 4, 4, preview=np.zeros((4, 8, 3), np.float32), changes=1)
    made = [weakref.ref(frames.newest(state, "image", most, (0, 0))) for most in range(16, 1016)]
    gc.collect()
    assert sum(each() is not None for each in made) <= 2 * MOST_VIEWERS


@pytest.mark.skipif(sys.platform != "linux", reason="only there do threads have a priority of their own")
def test_the_threads_that_render_let_others_go_first() -> None:
    def niceness() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    before = niceness()
    with ThreadPoolExecutor(1, initializer=lower_priority) as pool:
        assert pool.submit(niceness).result() == max(10, before)
    assert niceness() == before


def test_a_pixel_has_as_many_samples_as_were_taken_of_it() -> None:
    counts = np.array([[16, 48, 32]])
    state = SimpleNamespace(width=3, height=1, film=SimpleNamespace(counts=counts))
    having: Any = SimpleNamespace(image_state=state)
    assert [Progressive.samples_of(having, x, 0) for x in range(4)] == [16, 48, 32, 0]
    assert Progressive.samples_of(SimpleNamespace(image_state=None), 0, 0) == 0  # type: ignore[arg-type]


def test_the_copied_command_reads_the_scene_in_the_same_way(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n")
    path = str(tmp_path / "m.obj")
    scene = clrender.load(path, up="z", environment=0.5, hide_environment=True)
    command = table_text(EditedScene.of(scene, {"spp": 4}), "settings", "")
    assert "--spp 4" in command and "--up z --environment 0.5 --hide-environment -o image.png" in command
    assert "--environment" not in table_text(EditedScene.of(clrender.load("room"), {}), "settings", "")
    seen = EditedScene.of(clrender.load(path, camera={"position": [0, 0, 5], "target": [0, 0, 0]}), {})
    assert "--camera 'my cam.toml#b' -o" in table_text(seen, "settings", "", ("--camera", "my cam.toml#b"))
