"""The page of `clrender view` in Debian's Chromium, on the real server and a real device.

Skipped where Chromium or Playwright is missing. What fails leaves a picture of the page in test-artifacts/.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from view_browser import SCENE, view_of
from view_clients import Server

import clrender
from clrender.drawing.bundle import joined, style_sheet
from clrender.film import Film
from clrender.film.replicates import standard_error
from clrender.image.tone_map import TONE_MAPS, to_display

pytestmark = pytest.mark.usefixtures("only_driver")

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")


@pytest.fixture(scope="module")
def server(browser: Any, scene: Path, only_driver: None) -> Iterator[Server]:
    """One for all tests: each begins with everything as in the scene file."""
    # The browser comes first: without one the test is skipped before anything is rendered.
    with Server(scene.name, "-d", _DEVICE, "-o", "saved.npy", folder=scene.parent) as started:
        yield started
        assert started.end()[0] == 0


def _image(view: view_of) -> np.ndarray[Any, Any]:
    width, height = view.run("[view.picture.canvas.width, view.picture.canvas.height]")
    return np.array(view.pixels(), np.uint8).reshape(height, width, 4)[..., :3]


def _enter(view: view_of, label: str, value: str) -> None:
    """Give a field a value without waiting for the pointer to reach it."""
    entered = "(field, value) => { field.value = value; field.dispatchEvent(new Event('change')); }"
    view.page.get_by_label(label, exact=True).evaluate(entered, value)


def _orbit(view: view_of, across: int, down: int) -> None:
    box = view.page.locator(".cv-canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    view.page.mouse.move(x, y)
    view.page.mouse.down()
    view.page.mouse.move(x + across, y + down, steps=4)
    view.page.mouse.up()


@pytest.mark.long
@pytest.mark.parametrize("drawing", ["webgl", "plain", ""], ids=["webgl", "canvas", "whichever is fast"])
def test_the_picture_is_that_of_render_in_every_tone_curve(
    browser: Any, server: Server, scene: Path, drawing: str
) -> None:
    """Also with exposure: the page's curves are those of the command line, within the rounding of 16-bit floats."""
    linear = clrender.render(clrender.load(scene), device=_DEVICE).linear
    with view_of(browser, server, "tone_curves", drawing=drawing) as view:
        view.wait_until_done()
        # Where the processor draws for WebGL, the page draws by itself
        assert view.run("view.picture.method") == ("WebGL 2" if drawing == "webgl" else "2D canvas")
        for name in TONE_MAPS:
            _enter(view, "Tone curve", name)
            for exposure in ("-1.5", "4") if name != TONE_MAPS[0] else ("0", "-1.5", "4"):
                _enter(view, "Exposure", exposure)
                far = np.abs(_image(view).astype(int) - to_display(linear, name, float(exposure)))
                # Half floats have 11 bits; the steepest curve (the root, next to black) makes that 2 of 255 at most.
                assert far.max() <= 2, (name, exposure)
                assert (far > 1).mean() < 0.001, (name, exposure)


@pytest.mark.long
def test_a_page_begins_with_the_exposure_and_tone_curve_of_the_command_line(browser: Any, scene: Path) -> None:
    linear = clrender.render(clrender.load(scene), device=_DEVICE).linear
    with (
        Server(str(scene), "-d", _DEVICE, "--exposure", "-1.5", "--tone-map", "agx") as server,
        view_of(browser, server, "look") as view,
    ):
        view.wait_until_done()
        assert np.abs(_image(view).astype(int) - to_display(linear, "agx", -1.5)).max() <= 2
        page = view.page
        assert page.get_by_label("Tone curve", exact=True).input_value() == "agx"
        assert page.get_by_label("Exposure", exact=True).input_value() == "-1.5"
        _enter(view, "Tone curve", "srgb")
        _enter(view, "Exposure", "1")
        assert np.abs(_image(view).astype(int) - to_display(linear, "srgb", 1.0)).max() <= 2


@pytest.mark.slow
def test_orbit_pan_zoom_and_keys_change_the_image_and_reset_brings_it_back(browser: Any, server: Server) -> None:
    with view_of(browser, server, "orbit") as view:
        view.wait_until_done()
        before, camera = _image(view), view.newest("state")["camera"]
        _orbit(view, 120, 30)
        view.wait("view.hub.newest('state').camera.position[0] < -0.5")  # dragged to the right, seen from the left
        view.wait_until_done()
        assert np.abs(_image(view).astype(int) - before).mean() > 2
        moved = view.newest("state")["camera"]
        assert moved["position"][1] > camera["position"][1]  # dragged down, seen from above
        assert np.linalg.norm(moved["position"]) == pytest.approx(np.linalg.norm(camera["position"]), rel=0.2)
        assert moved["target"] == camera["target"]
        view.page.keyboard.press("r")
        view.wait(
            "JSON.stringify(view.hub.newest('state').camera) === argument", json.dumps(camera, separators=(",", ":"))
        )
        view.wait_until_done()
        assert (_image(view) == before).all()  # the same bits
        view.page.mouse.wheel(0, -400)
        view.wait("Math.hypot(...view.hub.newest('state').camera.position) < 3.5")
        view.page.keyboard.press("Shift+ArrowRight")
        view.wait("view.hub.newest('state').camera.target[0] !== 0")
        view.page.keyboard.down("w")
        view.wait("view.hub.newest('state').camera.target[2] < -0.2")
        view.page.keyboard.up("w")


@pytest.mark.long
def test_controls_change_what_they_say(browser: Any, server: Server) -> None:
    with view_of(browser, server, "controls") as view:
        view.wait_until_done()
        sha256 = view.newest("progress")["sha256"]
        page = view.page
        page.get_by_label("Samples", exact=True).fill("24")
        page.keyboard.press("Enter")
        view.wait("view.hub.newest('progress').spp === 24")
        view.wait_until_done()
        assert view.newest("progress")["samples"] == 24
        page.get_by_label("Integrator", exact=True).select_option(label="direct")
        view.wait("view.hub.newest('state').settings.integrator === 'direct'")
        view.wait_until_done()
        assert view.newest("progress")["sha256"] != sha256
        page.get_by_label("Samples: reset", exact=True).click()
        page.get_by_label("Integrator: reset", exact=True).click()
        view.wait("view.hub.newest('state').changed.length === 0")
        view.wait("view.hub.newest('progress').sha256 === argument", sha256)
        # A refusal stands at its field, and the field goes back to what holds.
        page.get_by_label("Samples", exact=True).fill("0")
        page.keyboard.press("Enter")
        page.locator(".cv-complaint:visible").wait_for()
        assert page.get_by_label("Samples", exact=True).input_value() == "16"


@pytest.mark.long
def test_a_material_is_changed_where_it_is_picked(browser: Any, server: Server) -> None:
    with view_of(browser, server, "material") as view:
        view.wait_until_done()
        middle = _image(view)[45, 80].astype(int)
        assert middle[0] > 2 * middle[2]  # the red ball
        box = view.page.locator(".cv-canvas").bounding_box()
        view.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        view.page.get_by_label("Material", exact=True).wait_for(state="visible")
        assert view.page.get_by_label("Material", exact=True).input_value() == "ball"
        view.page.get_by_label("Reflectance: blue").fill("0.9")
        view.page.keyboard.press("Enter")
        view.wait("view.hub.newest('state').changed.includes('materials.ball')")
        ball = view.newest("scene")["materials"]["ball"]["parameters"]
        assert [0.8, 0.1, 0.9] in [each["value"] for each in ball]
        view.wait_until_done()
        assert _image(view)[45, 80].astype(int)[2] > middle[2] + 40
        view.page.get_by_role("button", name="Reset materials").click()
        view.wait("view.hub.newest('state').changed.length === 0")
        view.wait_until_done()
        assert (_image(view)[45, 80] == middle).all()


@pytest.mark.long
def test_the_probe_says_the_numbers_of_the_film(browser: Any, server: Server, tmp_path: Path) -> None:
    with view_of(browser, server, "probe") as view:
        view.wait_until_done()
        view.page.get_by_label("Replicate samples", exact=True).select_option(label="4")
        view.wait("view.hub.newest('state').settings.replicate_spp === 4")
        view.wait_until_done()
        answer = view.page.request.get(f"http://127.0.0.1:{server.port}/download/image.film")
        film = tmp_path / "image.film"
        film.write_bytes(answer.body())
        held = Film.load(film)
        linear, error = held.mean(), standard_error(held)
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("p")  # begins in the middle
        for keys, (x, y) in (
            ("", (80, 45)),
            ("ArrowRight Shift+ArrowDown", (81, 55)),
            ("Shift+ArrowLeft", (71, 55)),
        ):
            for key in keys.split():
                view.page.keyboard.press(key)
            view.wait("JSON.parse(document.querySelector('.cv-probe').dataset.probe ?? '{}').x === argument", x)
            view.wait("JSON.parse(document.querySelector('.cv-probe').dataset.probe).y === argument", y)
            said = json.loads(view.page.locator(".cv-probe").get_attribute("data-probe"))
            assert np.array(said["radiance"], np.float32) == pytest.approx(linear[y, x], rel=1e-6)
            assert np.array(said["standard_error"], np.float32) == pytest.approx(error[y, x], rel=1e-6)
        text = view.page.locator(".cv-probe").inner_text()
        assert "71, 55" in text
        assert f"{linear[55, 71, 0]:.4g}".rstrip("0") in text
        assert "ball" in text
        view.wait("document.querySelector('.cv-hidden[aria-live]').textContent.includes('71, 55')")  # and is read aloud


@pytest.mark.slow
def test_two_layers_are_shown_beside_a_divider(browser: Any, server: Server) -> None:
    with view_of(browser, server, "divider") as view:
        view.wait_until_done()
        image = _image(view)
        view.page.get_by_label("Layer", exact=True).select_option(label="Albedo")
        view.wait("view.picture.frame()?.layer === 'albedo' && !view.picture.frame().coarse")
        albedo = _image(view)
        assert (
            np.abs(albedo[45, 80] - 255 * np.array([0.906, 0.349, 0.247])).max() < 2
        )  # sRGB of the ball's reflectance
        view.page.get_by_label("Layer", exact=True).select_option(label="Image")
        view.page.get_by_label("Compare with").select_option(label="Albedo")
        view.wait("view.picture.frame()?.layer === 'image' && document.querySelector('.cv-divider').checkVisibility()")
        for part in (0.5, 0.25):
            view.page.locator(".cv-split").fill(str(part))
            edge = round(160 * part)
            view.wait("view.picture.isWhole()")
            shown = _image(view)
            assert (shown[:, :edge] == image[:, :edge]).all()
            assert (shown[:, edge:] == albedo[:, edge:]).all()
        # The keys of the divider are its own: they do not move the camera.
        view.page.locator(".cv-split").focus()
        view.page.keyboard.press("ArrowLeft")
        assert float(view.page.locator(".cv-split").input_value()) == pytest.approx(0.248)
        assert "camera" not in view.newest("state")["changed"]


@pytest.mark.slow
def test_a_layer_that_is_no_longer_shown_leaves_no_texture(browser: Any, server: Server) -> None:
    with view_of(browser, server, "textures", drawing="webgl") as view:
        view.wait_until_done()
        view.run("""
            const kind = WebGL2RenderingContext.prototype;
            window.textures = 0;
            for (const [name, change] of [['createTexture', 1], ['deleteTexture', -1]]) {
                const original = kind[name];
                kind[name] = function (...given) { window.textures += change; return original.apply(this, given); };
            }
        """)
        for label, name in (("Albedo", "albedo"), ("Normal", "normal"), ("Depth", "depth"), ("Image", "image")):
            view.page.get_by_label("Layer", exact=True).select_option(label=label)
            view.wait("view.picture.frame()?.layer === argument", name)
            assert view.run("window.textures") == 0


@pytest.mark.slow
def test_the_error_map_measures_errors_first(browser: Any, server: Server) -> None:
    with view_of(browser, server, "error_map") as view:
        view.wait_until_done()
        view.page.get_by_label("Layer", exact=True).select_option(label="Standard error")
        view.page.get_by_role("button", name="Estimate errors").click()
        view.wait("view.hub.newest('state').settings.replicate_spp === 4")
        view.wait_until_done()
        view.wait("view.picture.frame().layer === 'stderr'")
        assert not view.page.get_by_role("button", name="Estimate errors").is_visible()
        assert "Standard error, W/(sr m²)" in view.page.locator(".cv-legend").inner_text()
        error = view.newest("progress")["error"]
        assert 0.0 < error < 1.0
        shown = view.page.locator(".cv-strip dl").inner_text()
        assert f"{100 * error:.3g} %" in shown


@pytest.mark.slow
def test_focus_by_click_and_the_camera_as_toml(browser: Any, server: Server) -> None:
    permissions = ["clipboard-read", "clipboard-write"]
    with view_of(browser, server, "focus", permissions=permissions) as view:
        view.wait_until_done()
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("f")
        box = view.page.locator(".cv-canvas").bounding_box()
        view.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        view.wait("view.hub.newest('state').changed.includes('camera')")
        # The near side of a ball of 0.6 m, whose middle is looked at from sqrt(4^2 + 0.6^2) m.
        distance = view.newest("state")["camera"]["focus_distance"]
        assert distance == pytest.approx(np.hypot(4.0, 0.6) - 0.6, abs=0.01)
        view.page.keyboard.press("Escape")
        view.page.keyboard.press("c")
        view.wait("document.querySelector('.cv-toast').textContent.includes('copied')")
        copied = tomllib.loads(view.page.evaluate("navigator.clipboard.readText()"))["camera"]
        assert copied["position"] == [0.0, 1.2, 4.0]
        assert copied["focus_distance"] == pytest.approx(distance)


@pytest.mark.slow
def test_saving_and_downloading(browser: Any, server: Server, scene: Path) -> None:
    with view_of(browser, server, "save") as view:
        view.wait_until_done()
        view.page.get_by_text("Save", exact=True).click()
        view.page.get_by_role("button", name="Save saved.npy").click()
        view.wait("document.querySelector('.cv-toast').textContent.includes('Saved')")
        linear = np.load(scene.parent / "saved.npy")
        view.page.get_by_label("Tone curve").select_option("agx")
        with view.page.expect_download() as download:
            view.page.get_by_role("link", name=".png", exact=True).click()
        with Image.open(download.value.path()) as picture:
            assert (np.asarray(picture) == to_display(linear, "agx", 0.0)).all()
        shown = _image(view)
        with view.page.expect_download() as download:
            view.page.get_by_role("button", name="Current view, .png").click()
        assert download.value.suggested_filename == "A ball on a table.png"
        with Image.open(download.value.path()) as picture:
            assert (np.asarray(picture.convert("RGB")) == shown).all()


@pytest.mark.long
def test_a_changed_scene_file_is_read_again_and_a_broken_one_told_of(browser: Any, server: Server, scene: Path) -> None:
    with view_of(browser, server, "reload") as view:
        view.wait_until_done()
        before, revision = _image(view), view.newest("state")["revision"]
        scene.write_text(SCENE.replace("reflectance = [0.8, 0.1, 0.05]", "reflectance = [0.1, 0.1, 0.8]"))
        view.wait("view.hub.newest('state').revision > argument", revision)
        view.wait_until_done()
        changed = _image(view)
        assert changed[45, 80, 2] > before[45, 80, 2] + 40
        scene.write_text(SCENE.replace("reflectance = [0.8, 0.1, 0.05]", "reflectence = [0.1, 0.1, 0.8]"))
        banner = view.page.locator(".cv-banner")
        banner.wait_for(state="visible")
        assert "reflectence" in banner.inner_text()
        assert (_image(view) == changed).all()  # the last image that was good
        revision = view.newest("state")["revision"]
        scene.write_text(SCENE)
        banner.wait_for(state="hidden")
        view.wait("view.hub.newest('state').revision > argument", revision)
        view.wait_until_done()
        assert (_image(view) == before).all()


@pytest.mark.long
def test_a_black_image_has_a_hint_how_to_get_back(browser: Any, server: Server) -> None:
    with view_of(browser, server, "black") as view:
        view.wait_until_done()
        hint = view.page.locator(".cv-hint")
        assert not hint.is_visible()
        view.run("view.hub.send({ type: 'camera', camera: { position: [0, 0.6, 0.1] } })")  # inside of the ball
        hint.wait_for(state="visible")
        assert "R resets the camera" in hint.inner_text()
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("r")
        hint.wait_for(state="hidden")


@pytest.mark.long
def test_a_compiler_is_shown_only_where_it_takes_long(browser: Any, server: Server) -> None:
    with view_of(browser, server, "compiling") as view:
        short, begun, long, done, series = view.run("""
            const { createHub } = await import('/page/hub.js');
            const { createStatus } = await import('/page/status.js');
            const transport = { send: () => {} };
            const status = createStatus(createHub(transport));
            const say = (message) => transport.onmessage(JSON.stringify(message));
            const wait = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
            const seen = () => [status.pill.textContent, status.hint.hidden, status.hint.textContent];
            transport.onstate('open');
            say({ type: 'state', status: 'starting', problem: null, is_black: true });
            say({ type: 'compiling', compiling: true, stage: 'compiling', text: 'compiling the kernels' });
            say({ type: 'compiling', compiling: false, stage: '', text: '' });
            await wait(1);
            const short = seen();
            say({ type: 'compiling', compiling: true, stage: 'compiling', text: 'compiling the kernels' });
            await wait(0.1);
            const begun = seen();
            await wait(0.9);
            const long = seen();
            say({ type: 'compiling', compiling: false, stage: '', text: '' });
            await wait(0.5);
            const done = seen();
            for (let turn = 0; turn < 6; turn += 1) {  // one wait of several stages, none of them long
              say({ type: 'compiling', compiling: false, stage: 'flattening', text: 'preparing the scene' });
              await wait(0.1);
              say({ type: 'compiling', compiling: false, stage: '', text: '' });
              await wait(0.05);
            }
            say({ type: 'compiling', compiling: false, stage: 'building', text: 'building the tree' });
            return [short, begun, long, done, seen()];
        """)
        assert short[:2] == begun[:2] == done[:2] == ["Starting", False] and "black" in short[2]
        assert long[:2] == ["Compiling", False] and "kernels" in long[2]
        assert series == ["Building", False, "Building the tree. What you change meanwhile is shown afterwards."]


def test_the_reply_of_a_probe_is_not_lost_among_cameras(browser: Any, server: Server) -> None:
    """Cameras have no reply; those of a drag must not push out the question that has one."""
    with view_of(browser, server, "hub") as view:
        answered = view.run("""
            const { createHub } = await import('/page/hub.js');
            const transport = { send: () => {} };
            const hub = createHub(transport);
            let answered = 0;
            const id = hub.send({ type: 'probe', x: 0, y: 0 }, () => (answered += 1));
            for (let i = 0; i < 200; i += 1) hub.send({ type: 'camera', camera: {} }, () => false);
            transport.onmessage(JSON.stringify({ type: 'probe', id }));
            return answered;
        """)
        assert answered == 1


@pytest.mark.long
def test_a_camera_is_sent_at_once_and_then_once_a_screen_frame(browser: Any, server: Server) -> None:
    with view_of(browser, server, "sent") as view:
        view.wait("view.picture.frame() !== undefined")
        before, *at_once, later, still = view.run("""
            const [sent, frame] = [[view.camera.lastSent() ?? 0], () => new Promise(requestAnimationFrame)];
            for (let i = 0; i < 3; i += 1) {
                view.camera.orbit(0.01, 0.0);
                sent.push(view.camera.lastSent());
            }
            for (let i = 0; i < 2; i += 1) {
                await frame();
                await frame();
                sent.push(view.camera.lastSent());
            }
            return sent;
        """)
        assert before < at_once[0] == at_once[1] == at_once[2] < later == still


@pytest.mark.long
def test_a_slow_browser_slows_nobody(browser: Any, server: Server) -> None:
    with view_of(browser, server, "fast") as fast, view_of(browser, server, "slow") as slow:
        slow.wait_until_done()  # no frame is on its way, nor is its acknowledgement
        # One that draws, and so acknowledges, nothing for a while.
        slow.run("window.draw = window.requestAnimationFrame.bind(window); window.held = []; return 0")
        slow.run("window.requestAnimationFrame = (call) => window.held.push(call); return 0")
        slow.run("window.came = 0; view.hub.on('frame', () => window.came += 1); return 0")
        for i in range(6):
            sent = fast.run("view.camera.lastSent() ?? 0")
            fast.page.keyboard.press("ArrowLeft" if i % 2 else "ArrowUp")
            fast.wait("view.camera.lastSent() > argument", sent)
            fast.wait("view.picture.frame().answers === view.camera.lastSent()")
        fast.wait_until_done()  # its state may come after the first frame of a camera
        assert slow.run("window.came") <= 1
        slow.run("window.requestAnimationFrame = window.draw; window.held.forEach((call) => draw(call)); return 0")
        camera = "JSON.stringify(view.hub.newest('state').camera)"
        slow.wait(f"{camera} === argument", fast.run(camera))  # what one does, the other sees
        for view in (fast, slow):
            view.wait_until_done()
        assert (_image(fast) == _image(slow)).all()


@pytest.mark.slow
def test_the_page_goes_on_when_the_server_is_back(browser: Any, scene: Path) -> None:
    with (
        Server(str(scene), "-d", _DEVICE, token="of-this-test") as first,
        view_of(browser, first, "reconnect") as view,
    ):
        view.wait_until_done()
        before = _image(view)
        assert first.end()[0] == 0
        status = view.page.locator(".cv-status")
        view.wait("document.querySelector('.cv-status').dataset.status === 'lost'")
        assert "stopped" in status.inner_text() or "No connection" in status.inner_text()
        assert (_image(view) == before).all()
        view.page.get_by_label("Tone curve").select_option("linear")  # what is there can still be looked at
        assert (_image(view) != before).any()
        view.errors.clear()  # the browser itself tells of each attempt in vain
        again = ("--port", str(first.port), "--spp", "8")
        with Server(str(scene), "-d", _DEVICE, *again, token="of-this-test"):
            view.wait("view.hub.newest('state').settings.spp === 8")
            view.wait("document.querySelector('.cv-status').dataset.status === 'done'")
            view.wait("view.picture.frame().final && view.picture.frame().samples === 8")
            assert view.page.get_by_label("Tone curve").input_value() == "linear", "what was chosen stays"
            view.errors.clear()


@pytest.mark.slow
def test_the_viewer_is_one_module_for_notebooks(browser: Any) -> None:
    """Put together, it mounts in a page of others, with a transport of its own, and leaves their keys alone."""
    hello = {
        "type": "hello",
        "settings": [
            {"name": "spp", "help": "Samples", "schema": {"type": "integer", "minimum": 1}, "integrator": None}
        ],
        "integrators": [],
        "devices": [],
        "layers": [{"name": "image", "label": "Image", "kind": "radiance", "needs": ""}],
        "tone_maps": [],
        "saves": [],
    }
    page = browser.new_page()
    said: list[str] = []
    page.on("console", lambda line: said.append(line.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.set_content("<input id='other'><div id='view'></div>")
    page.add_style_tag(content=style_sheet())
    page.add_script_tag(content=f"{joined('viewer.js')}\nwindow.mount = module_viewer.mount;", type="module")
    page.wait_for_function("window.mount !== undefined")
    before = page.evaluate(
        """hello => {
            window.sent = [];
            window.transport = { send: (text) => sent.push(JSON.parse(text)) };
            window.view = mount(document.getElementById("view"), transport, { shared: true });
            transport.onstate("open");
            transport.onmessage(JSON.stringify(hello));
            const scene = { type: "scene", title: null, source: "s.toml", shapes: 1, lights: 0, materials: {} };
            transport.onmessage(JSON.stringify(scene));
            const before = getComputedStyle(document.querySelector(".cv-canvas")).visibility;
            const of = { frame: 7, revision: 1, layer: "image", format: "float32", channels: 3, samples: 1 };
            const size = { width: 2, height: 1, image_width: 2, image_height: 1 };
            const more = { coarse: false, final: true, answers: null, range: null };
            const header = JSON.stringify({ ...of, ...size, ...more }).padEnd(260);
            const frame = new ArrayBuffer(4 + 260 + 24);
            new DataView(frame).setUint32(0, 260, true);
            new Uint8Array(frame).set(new TextEncoder().encode(header), 4);
            new Float32Array(frame, 264).set([1, 0, 0, 0, 1, 0]);
            transport.onmessage(frame);
            return before;
        }""",
        hello,
    )
    assert before == "hidden", "nothing black is shown before the first image"
    page.wait_for_function("sent.some((message) => message.type === 'ack' && message.frame === 7)")
    assert page.get_by_label("Samples", exact=True).is_visible()
    assert page.locator("h1").inner_text() == "s.toml"
    assert page.locator(".cv-canvas").is_visible()
    sent = page.evaluate("sent.length")
    page.locator("#other").focus()
    page.keyboard.press("r")  # typed into a field of the page's own
    assert page.evaluate("sent.length") == sent
    page.get_by_label("Samples", exact=True).fill("5")
    page.keyboard.press("Enter")
    assert page.evaluate("sent.at(-1).settings") == {"spp": 5}
    page.locator(".cv-stage").focus()
    page.keyboard.press("r")
    assert page.evaluate("sent.at(-1)")["type"] == "reset"
    page.evaluate("view.close()")
    assert page.locator(".cv-stage").count() == 0
    assert said == []
    page.close()


@pytest.mark.slow
def test_stop_and_go_on_and_false_colour_by_keyboard(browser: Any, server: Server) -> None:
    with view_of(browser, server, "keyboard") as view:
        page = view.page
        view.wait("view.picture.frame() !== undefined")
        page.get_by_label("Samples", exact=True).fill("100000")
        page.keyboard.press("Enter")
        page.locator(".cv-stage").focus()
        view.wait("view.hub.newest('progress').spp === 100000")
        page.keyboard.press("Space")
        view.wait("view.hub.newest('state').status === 'stopped'")
        assert page.locator(".cv-status").inner_text() == "Stopped"
        time.sleep(0.5)
        samples = view.newest("progress")["samples"]
        time.sleep(0.7)
        assert view.newest("progress")["samples"] == samples
        before = _image(view)
        page.keyboard.press("l")
        assert page.get_by_label("False colour", exact=True).is_checked()
        assert page.locator(".cv-legend").is_visible()
        assert np.abs(_image(view).astype(int) - before).mean() > 10
        page.keyboard.press("l")
        assert (_image(view) == before).all()
        page.keyboard.press("]")
        assert page.get_by_label("Exposure", exact=True).input_value() == "0.33"
        page.keyboard.press("Space")
        view.wait("view.hub.newest('progress').samples > argument", samples)


@pytest.mark.slow
def test_everything_has_a_name_and_is_reached_by_tab(browser: Any, server: Server) -> None:
    with view_of(browser, server, "names") as view:
        view.wait("view.picture.frame() !== undefined")
        view.page.locator("details").evaluate_all("all => all.forEach((each) => each.open = true)")
        nameless = view.page.locator(".cv button, .cv input, .cv select, .cv a").evaluate_all(
            """all => all.filter((each) => !each.getAttribute("aria-label") && !each.labels?.length)
                .filter((each) => !each.textContent.trim()).map((each) => each.outerHTML)"""
        )
        assert nameless == []
        reached = set()
        for _ in range(12):
            view.page.keyboard.press("Tab")
            reached.add(view.page.evaluate("document.activeElement.className || document.activeElement.tagName"))
        assert len(reached) > 2
        assert view.page.locator("[aria-live]").count() >= 2
        assert view.page.locator(".cv-canvas[aria-live], .cv-strip [aria-live]").count() == 0  # not for every frame


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["dark", pytest.param("light", marks=pytest.mark.slow)])
@pytest.mark.parametrize("width", [360, pytest.param(1280, marks=pytest.mark.slow)])
def test_it_fits_its_width(browser: Any, server: Server, width: int, scheme: str) -> None:
    with view_of(browser, server, "fits", viewport={"width": width, "height": 740}, color_scheme=scheme) as view:
        view.wait("view.picture.frame() !== undefined")
        view.page.locator("details").evaluate_all("all => all.forEach((each) => each.open = true)")
        assert view.run("document.documentElement.scrollWidth") <= width
        over = view.page.locator(".cv button, .cv input, .cv select").evaluate_all(
            """(all, width) => all.filter((each) => each.getBoundingClientRect().right > width + 0.5)
                .map((each) => each.outerHTML)""",
            width,
        )
        assert over == []
        box = view.page.locator(".cv-canvas").bounding_box()
        assert box["width"] >= (330 if width == 360 else 900)
        assert box["width"] / box["height"] == pytest.approx(160 / 90, rel=0.02)


_NEARER = """
    const { position, target } = view.hub.newest("state").camera;
    return Math.hypot(...position.map((value, i) => value - target[i])) < argument;
"""


def _touch(view: view_of, devtools: Any, kind: str, *places: tuple[float, float]) -> None:
    """Fingers on the image, as shares of its width and height."""
    box = view.page.locator(".cv-canvas").bounding_box()
    points = [
        {"x": box["x"] + box["width"] * x, "y": box["y"] + box["height"] * y, "id": finger}
        for finger, (x, y) in enumerate(places)
    ]
    devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


@pytest.mark.slow
def test_one_finger_orbits_two_zoom_and_a_tap_picks(browser: Any, server: Server) -> None:
    phone: dict[str, Any] = {"viewport": {"width": 390, "height": 740}, "has_touch": True, "is_mobile": True}
    with view_of(browser, server, "touch", **phone) as view:
        view.wait_until_done()
        start = view.newest("state")["camera"]
        touch = partial(_touch, view, view.page.context.new_cdp_session(view.page))
        touch("touchStart", (0.5, 0.5))
        for step in range(1, 6):
            touch("touchMove", (0.5 + 0.06 * step, 0.5))
        touch("touchEnd")
        view.wait("view.hub.newest('state').camera.position[0] < -0.5")
        turned = view.newest("state")["camera"]
        assert turned["target"] == start["target"]
        touch("touchStart", (0.4, 0.5), (0.6, 0.5))
        for step in range(1, 6):
            touch("touchMove", (0.4 - 0.04 * step, 0.5), (0.6 + 0.04 * step, 0.5))
        touch("touchEnd")
        far = float(np.linalg.norm(np.subtract(turned["position"], turned["target"])))
        view.wait(_NEARER, 0.6 * far)
        view.run("view.hub.send({ type: 'reset', what: 'camera' })")
        view.wait("view.hub.newest('state').changed.length === 0")
        view.wait_until_done()
        touch("touchStart", (0.5, 0.5))
        touch("touchEnd")
        view.wait("document.querySelector('.cv-probe').dataset.probe !== undefined")
        assert json.loads(view.page.locator(".cv-probe").get_attribute("data-probe"))["material"] == "ball"
        assert view.newest("state")["changed"] == []


@pytest.mark.slow
def test_the_divider_shows_before_and_after_the_denoiser(browser: Any, server: Server, scene: Path) -> None:
    pytest.importorskip("pyoidn", reason="the denoiser is not installed")
    truth = to_display(clrender.render(clrender.load(scene), device=_DEVICE, spp=2048).linear, "srgb", 0.0).astype(int)
    with view_of(browser, server, "denoiser") as view:
        view.wait_until_done()
        noisy = _image(view)
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("b")
        view.wait("document.querySelector('.cv-divider').checkVisibility()")
        # Guides are rendered first; until they are there the layer is the image itself.
        view.page.locator(".cv-split").fill("0")
        end = time.monotonic() + 120
        while (_image(view) == noisy).all():
            assert time.monotonic() < end
            time.sleep(0.1)
        denoised = _image(view)
        view.page.locator(".cv-split").fill("1")
        assert (_image(view) == noisy).all()
        view.page.locator(".cv-split").fill("0.5")
        shown = _image(view)
        assert (shown[:, :80] == noisy[:, :80]).all() and (shown[:, 80:] == denoised[:, 80:]).all()
        before, after = (np.abs(each.astype(int) - truth).mean() for each in (noisy, denoised))
        assert after < 0.7 * before, (before, after)
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("b")
        view.wait("!document.querySelector('.cv-divider').checkVisibility()")
