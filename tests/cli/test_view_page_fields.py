"""Fields and camera moves of the page of `clrender view`, and what the page does without a connection.

Skipped where Chromium or Playwright is missing. Most of it is parts of the page with an engine that the test plays.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from view_browser import view_of
from view_clients import Server

from clrender.scene.camera import Camera

pytestmark = [pytest.mark.usefixtures("only_driver"), pytest.mark.long]

_DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")


@pytest.fixture(scope="module")
def server(browser: Any, scene: Path, only_driver: None) -> Iterator[Server]:
    with Server(scene.name, "-d", _DEVICE, folder=scene.parent) as started:
        yield started
        assert started.end()[0] == 0


@pytest.fixture(scope="module")
def view(browser: Any, server: Server) -> Iterator[view_of]:
    """One page for all tests; each makes parts of its own in it, or resets what it has changed."""
    with view_of(browser, server, "fields") as opened:
        yield opened


_PARTS: Final = """
    const { createField } = await import('/page/fields.js');
    const { createHub } = await import('/page/hub.js');
    const wait = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));
    const given = [];
    const made = (about) => {
        const field = createField({ label: 'A field', schema: {}, ...about }, (value) => given.push(value));
        document.body.append(field.element);
        return { ...field, inputs: [...field.element.querySelectorAll('input, select')] };
    };
    const typed = (input, value) => {
        input.focus();
        input.value = value;
        input.dispatchEvent(new Event('input', { bubbles: true }));
    };
    const entered = (input, value) => {
        typed(input, value);
        input.dispatchEvent(new Event('change', { bubbles: true }));
    };
    const sent = [];
    const transport = { send: (text) => void sent.push(JSON.parse(text)) };
    const hub = createHub(transport);
    const tell = (message) => transport.onmessage(JSON.stringify(message));
"""
"""Begins a script: fields that are in the page, and a hub whose engine the test is."""


def _run(view: view_of, script: str, argument: Any = None) -> Any:
    return view.run(f"{_PARTS} {script}", argument)


def test_a_colour_is_that_of_what_was_entered_before(view: view_of) -> None:
    """Though the engine has not told it yet, and the field has the focus all the time."""
    given, shown = _run(
        view,
        """
        const field = made({ kind: 'color', strength: true });
        field.show([0.3, 0.4, 0.6], false);
        const [picker, , , , strength] = field.inputs;
        typed(picker, '#ff0000');
        entered(strength, '2');
        field.show([0.6, 0, 0], false); // of the pick
        field.show([2, 0, 0], false);
        await wait(500);
        typed(picker, '#00ff00');
        await wait(500);
        const shown = field.inputs.map((input) => input.value);
        field.element.remove();
        return [given, shown];
        """,
    )
    assert given == [[0.6, 0, 0], [2, 0, 0], [0, 2, 0]]
    assert shown == ["#00ff00", "0", "2", "0", "2"]


def test_numbers_that_were_not_edited_stay_what_they_were(view: view_of) -> None:
    """A field shows a few digits; what it sends of the others is exact. A number that is emptied comes back."""
    given, shown = _run(
        view,
        """
        const color = made({ kind: 'color', optional: false });
        color.show([0.123456, 0.234567, 0.345678], false);
        entered(color.inputs[1], '0.5');
        entered(color.inputs[2], '');
        entered(color.inputs[1], '0.1235');
        const place = made({ kind: 'vector', optional: false });
        place.show([1.23456789, 123.456789, -0.1], false);
        entered(place.inputs[0], '12');
        entered(place.inputs[2], '');
        const shown = [color.inputs[2].value, place.inputs[2].value];
        color.element.remove();
        place.element.remove();
        return [given, shown];
        """,
    )
    assert given == [
        [0.5, 0.234567, 0.345678],
        [0.1235, 0.234567, 0.345678],
        [12, 123.456789, -0.1],
    ]
    assert shown == ["0.2346", "-0.1"]


def test_a_field_with_the_focus_shows_what_holds(view: view_of) -> None:
    """But for a text that is not entered yet, and for what the engine says of entries before the last."""
    seen = _run(
        view,
        """
        const seen = {};
        const field = made({ schema: { type: 'number', minimum: 0, maximum: 1 } });
        const [slider, number] = field.inputs;
        field.show(0.5, false);
        slider.focus();
        typed(slider, '0.6');
        typed(slider, '0.7');
        field.show(0.6, false);
        seen.dragged = [slider.value, number.value];
        field.show(0.7, false);
        await wait(500);
        field.show(0.5, false); // undone
        seen.undone = [slider.value, number.value];
        typed(number, '0.9');
        field.show(0.4, false);
        seen.typing = number.value;
        number.blur();
        seen.left = number.value;
        entered(number, '2');
        field.complain('refused');
        seen.refused = number.value;
        entered(number, '');
        number.blur();
        seen.emptied = number.value; // the engine says nothing where that changes nothing
        const flag = made({ kind: 'flag' });
        flag.show(false, false);
        flag.inputs[0].focus();
        flag.inputs[0].click();
        await wait(500);
        flag.show(false, false);
        seen.flag = flag.inputs[0].checked;
        field.element.remove();
        flag.element.remove();
        return { ...seen, given };
        """,
    )
    assert seen == {
        "dragged": ["0.7", "0.7"],
        "undone": ["0.5", "0.5"],
        "typing": "0.9",
        "left": "0.4",
        "refused": "0.4",
        "emptied": "0.4",
        "flag": False,
        "given": [0.6, 0.7, 2, None, True],
    }


def test_what_may_be_without_a_value_can_be_emptied(view: view_of) -> None:
    given, shown = _run(
        view,
        """
        const metal = made({ kind: 'choice', schema: { type: 'string', enum: ['Au', 'Cu'] }, optional: true });
        metal.show(null, false);
        const shown = [metal.inputs[0].selectedOptions[0].textContent];
        entered(metal.inputs[0], '1');
        entered(metal.inputs[0], '0');
        const eta = made({ kind: 'color', optional: true });
        eta.show(null, false);
        entered(eta.inputs[1], '1');
        entered(eta.inputs[2], '2');
        entered(eta.inputs[3], '3');
        eta.inputs.slice(1).forEach((input) => entered(input, ''));
        for (const optional of [true, false]) {
            const number = made({ schema: { type: 'number' }, optional });
            number.show(0.5, false);
            entered(number.inputs[0], '');
            shown.push(number.inputs[0].value);
            number.element.remove();
        }
        metal.element.remove();
        eta.element.remove();
        return [given, shown];
        """,
    )
    assert given == ["Au", None, [1, 2, 3], None, None]
    assert shown == ["–", "", "0.5"]


_POSE: Final = {"position": [0.5, 1.2, 4.0], "target": [0.2, 0.6, 0.0], "up": [0.0, 1.0, 0.0]}


@pytest.mark.parametrize(
    "keys",
    [
        {"vertical_fov": 40.0},
        {"vertical_fov": 40.0, "mirrored": True, "lens_shift": [0.1, 0.2]},
        {"type": "orthographic", "height": 3.0},
        {"type": "orthographic", "height": 3.0, "mirrored": True},
        {"type": "intrinsics", "fx": 40.0, "fy": 60.0},
        {"type": "intrinsics", "fx": 400.0, "resolution": [320, 240], "mirrored": True},
        {"type": "fisheye", "vertical_fov": 220.0},
        {"type": "panoramic"},
    ],
    ids=str,
)
@pytest.mark.parametrize("crop", [False, True], ids=["whole", "crop"])
def test_what_is_panned_stays_under_the_pointer(view: view_of, keys: dict[str, Any], crop: bool) -> None:
    """A drag by a part of what is shown, which of a crop is half as high as the image."""
    width, height = 64, 48
    camera = Camera.model_validate({**_POSE, **keys})
    part = (0.02, -0.01) if keys.get("type") in ("fisheye", "panoramic") else (0.2, -0.1)  # of the shown height
    shown = height // 2 if crop else height
    moved = _run(
        view,
        """
        const { createCamera } = await import('/page/camera_panel.js');
        const camera = createCamera(hub);
        tell({ type: 'state', camera: argument.camera, height: argument.shown, settings: argument.size });
        camera.pan(...argument.part);
        return sent[0].camera;
        """,
        {
            "camera": camera.model_dump(mode="json", include=camera.own_keys),
            "shown": shown,
            "size": {"width": width, "height": height},
            "part": part,
        },
    )
    after = Camera.model_validate({**_POSE, **keys, **{name: moved[name] for name in _POSE}})
    (x, y), (begin_x, begin_y) = (each.project(_POSE["target"], (width, height)) for each in (after, camera))
    assert x - begin_x == pytest.approx(part[0] * shown, rel=2e-2 if part[0] < 0.1 else 1e-6)
    assert y - begin_y == pytest.approx(part[1] * shown, rel=2e-2 if part[0] < 0.1 else 1e-6)


@pytest.mark.parametrize("mirrored", [False, True], ids=["plain", "mirrored"])
def test_other_moves_go_where_they_are_dragged(view: view_of, mirrored: bool) -> None:
    """The head is turned to the left, what lies before the target goes to the right, one flies to the left."""
    keys = {"vertical_fov": 40.0, "mirrored": mirrored}
    camera = Camera.model_validate({**_POSE, **keys})
    moves = _run(
        view,
        """
        const moves = await import('/page/camera.js');
        return {
            look: moves.look(argument, -0.1, 0, { width: 64, height: 48 }),
            orbit: moves.orbit(argument, 0.02, 0),
            fly: moves.fly(argument, 0, -0.3, 0),
        };
        """,
        camera.model_dump(mode="json", include=camera.own_keys),
    )
    near = [t + 0.3 * (p - t) for t, p in zip(_POSE["target"], _POSE["position"], strict=True)]
    for name, point in (("look", _POSE["target"]), ("orbit", near), ("fly", _POSE["target"])):
        after = Camera.model_validate({**_POSE, **keys, **{key: moves[name][key] for key in _POSE}})
        x, y = after.project(point, (64, 48))
        assert 33.0 < x < 40.0, name
        assert y == pytest.approx(24.0, abs=0.5)


def test_a_camera_move_waits_for_a_busy_engine(view: view_of) -> None:
    """Until the engine says the same, refuses it, or shows a frame of it, as when another viewer moves it as well."""
    waited, refused, shown = _run(
        view,
        """
        const { createCamera } = await import('/page/camera_panel.js');
        const camera = createCamera(hub);
        const begin = { position: [0, 0, 4], target: [0, 0, 0], up: [0, 1, 0], vertical_fov: 40 };
        const size = { height: 48, settings: { width: 64, height: 48 } };
        const state = (changed) => tell({ type: 'state', camera: { ...begin, ...changed }, ...size });
        const next = async () => { await wait(60); return sent.at(-1); };
        state({});
        camera.pan(0.5, 0);
        await wait(3200);
        camera.zoom(2);
        const waited = await next();
        tell({ type: 'refused', id: waited.id, message: 'no' });
        camera.zoom(2);
        const refused = await next();
        state({ position: [0, 0, 16] }); // of another viewer
        const header = new TextEncoder().encode(JSON.stringify(
            { type: 'frame', answers: refused.id, width: 0, height: 0, channels: 4, format: 'float32' }).padEnd(124));
        const buffer = new ArrayBuffer(4 + header.length);
        new DataView(buffer).setUint32(0, header.length, true);
        new Uint8Array(buffer).set(header, 4);
        transport.onmessage(buffer);
        camera.zoom(0.5);
        return [waited, refused, await next()].map((message) => message.camera);
        """,
    )
    step = 0.5 * 8.0 * math.tan(math.radians(20.0))
    assert waited["target"] == pytest.approx([-step, 0, 0])
    assert waited["position"] == pytest.approx([-step, 0, 8])
    assert refused["position"] == [0, 0, 8]
    assert shown["position"] == [0, 0, 8]


def test_materials_beyond_the_list_follow_the_engine(view: view_of) -> None:
    """What was picked is listed from then on; the page says that there are more."""
    seen = _run(
        view,
        """
        const { createTablePanel, MATERIALS } = await import('/page/table_panel.js');
        const panel = createTablePanel(hub, () => {}, MATERIALS);
        const box = document.createElement('div');
        box.append(...panel.content);
        const about = { name: 'reflectance', kind: 'color', schema: {}, optional: false, help: '' };
        const parameters = (value) => [{ ...about, value }];
        const table = (value) => ({ type: 'lambert', parameters: parameters(value) });
        const seen = {};
        const shown = () => [...box.querySelectorAll('.cv-color input[type=number]')].map((input) => input.value);
        const scene = (materials) => tell({ type: 'scene', materials, material_count: 1003 });
        scene({ first: table([0.1, 0.1, 0.1]) });
        const notes = [...box.querySelectorAll('.cv-note:not([hidden])')].map((note) => note.textContent);
        panel.choose('toString', parameters([0.8, 0.1, 0.05]));
        seen.picked = shown();
        scene({ first: table([0.1, 0.1, 0.1]), toString: table([0.33, 0.1, 0.05]) });
        seen.edited = shown();
        panel.choose('first');
        panel.choose('toString');
        seen.again = shown();
        scene({ first: table([0.1, 0.1, 0.1]) });
        panel.choose('first');
        scene({ first: table([0.1, 0.1, 0.1]) });
        seen.listed = [...box.querySelectorAll('select option')].map((option) => option.value);
        return { ...seen, notes };
        """,
    )
    assert "1 of 1003 are listed. Click on an object for another one." in seen["notes"]
    assert seen["picked"] == ["0.8", "0.1", "0.05"]
    assert seen["edited"] == seen["again"] == ["0.33", "0.1", "0.05"]
    assert seen["listed"] == ["first"]


def test_without_a_connection_edits_are_refused(view: view_of) -> None:
    """Beside the field, or as a message; what the page sends by itself is not missed."""
    told, answers = _run(
        view,
        """
        const lost = { send: () => false };
        const severed = createHub(lost);
        const [told, answers] = [[], []];
        severed.on('refused', (message) => told.push(message.to));
        severed.send({ type: 'ack', frame: 1 });
        severed.send({ type: 'camera', camera: {} });
        severed.send({ type: 'material', name: 'a', values: {} }, (reply) => { answers.push(reply); return true; });
        severed.send({ type: 'undo' }, () => false);
        await wait(0);
        return [told, answers];
        """,
    )
    assert told == ["camera", "undo"]
    assert [each["type"] for each in answers] == ["refused"]
    assert "no connection" in answers[0]["message"]


def test_paths_are_traced_when_the_connection_is_back(view: view_of) -> None:
    texts, questions = _run(
        view,
        """
        const { createPathsPanel } = await import('/page/paths_panel.js');
        const panel = createPathsPanel(hub, { overlay: () => {} });
        const box = document.createElement('div');
        box.append(...panel.content);
        const [line, cancel] = ['.lp-status', 'button:not(.cv-undo)'].map((name) => box.querySelector(name));
        const status = () => [line.textContent, cancel.hidden];
        const texts = [];
        transport.onstate('open');
        panel.open(true);
        panel.trace(3, 4);
        texts.push(status());
        transport.onstate('lost');
        texts.push(status());
        transport.onstate('open');
        texts.push(status());
        const questions = sent.map(({ type, x, y }) => [type, x, y]);
        tell({ type: 'refused', id: sent.at(-1).id, message: 'it has none' });
        texts.push(status());
        return [texts, questions];
        """,
    )
    assert [hidden for _, hidden in texts] == [False, True, False, True]
    assert "connection is lost" in texts[1][0]
    assert texts[2][0] == texts[0][0] == "Tracing the paths of pixel 3, 4."
    assert texts[3][0] == "It has none."
    assert questions == [["paths", 3, 4]] * 2


def _reset(view: view_of) -> None:
    view.run("['camera', 'lights'].forEach((what) => view.hub.send({ type: 'reset', what })); return 0")
    view.wait("view.hub.newest('state').changed.length === 0")


_ENVIRONMENT: Final = (
    "view.hub.newest('scene').emitters['lights[0]'].parameters.find(({ name }) => name === 'visible_to_camera').value"
)


def test_alpha_leaves_the_environment_as_it_was(view: view_of) -> None:
    view.open("View")
    alpha = view.page.get_by_label("Alpha", exact=True)
    hidden = view.page.get_by_label("Hide environment", exact=True)
    alpha.check()
    view.wait(f"{_ENVIRONMENT} === false")
    assert hidden.is_checked()
    view.page.keyboard.press("Control+z")  # the environment is seen again, and so nothing is transparent
    view.wait(f"{_ENVIRONMENT} === true")
    assert not alpha.is_checked() and not hidden.is_checked()
    hidden.check()
    view.wait(f"{_ENVIRONMENT} === false")
    revision = view.newest("state")["revision"]
    alpha.check()
    alpha.uncheck()
    view.page.keyboard.press("Control+Shift+z")  # nothing was sent before it
    view.wait("document.querySelector('.cv-toast').textContent.includes('nothing to redo')")
    assert view.run(_ENVIRONMENT) is False
    assert view.newest("state")["revision"] == revision
    _reset(view)


def test_cameras_without_a_focus_offer_none(view: view_of) -> None:
    view.open("Camera")
    focus = view.page.get_by_role("button", name="Focus by click")
    assert focus.count() == 2  # a tool, and in the panel
    view.run("view.hub.send({ type: 'camera', camera: { type: 'fisheye', vertical_fov: 180 } }); return 0")
    view.wait("view.hub.newest('state').camera.type === 'fisheye'")
    assert focus.count() == 0
    assert not view.page.get_by_label("Focus distance", exact=True).is_visible()
    view.page.locator(".cv-stage").focus()
    view.page.keyboard.press("f")
    view.toast("everything is in focus")
    _reset(view)
    assert focus.count() == 2
