"""Edits in the page of `clrender view`: kept, undone and redone; lights, outlines, messages, and how the page looks.

Skipped where Chromium or Playwright is missing, as tests/cli/test_view_page.py, whose server this file does not share.
"""

from __future__ import annotations

import json
import os
import sys
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import call
from view_browser import BEYOND, CONTRAST, CONTROLS, NAMELESS, SCENE, view_of
from view_clients import Server

import clrender
from clrender.film import Film

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

pytestmark = [pytest.mark.usefixtures("only_driver"), pytest.mark.long]

_DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")
_CLIPBOARD = ["clipboard-read", "clipboard-write"]


@pytest.fixture(scope="module")
def server(browser: Any, scene: Path, only_driver: None) -> Iterator[Server]:
    with Server(scene.name, "-d", _DEVICE, folder=scene.parent) as started:
        yield started
        assert started.end()[0] == 0


def test_what_was_edited_is_downloaded_and_renders_to_the_same_image(
    browser: Any, server: Server, tmp_path: Path
) -> None:
    with view_of(browser, server, "download") as view:
        view.wait_until_done()
        before = view.newest("progress")["sha256"]
        view.page.get_by_label("Samples", exact=True).fill("6")
        view.page.keyboard.press("Enter")
        view.click(0.5, 0.5)
        view.page.get_by_label("Material", exact=True).wait_for(state="visible")
        view.page.get_by_label("Reflectance: blue").fill("0.9")
        view.page.keyboard.press("Enter")
        view.open("Light", "Save")
        view.page.get_by_label("Light", exact=True).select_option("lights[0]")
        view.page.get_by_label("Radiance: strength").fill("2.5")
        view.page.keyboard.press("Enter")
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("+")  # as the probe is pinned, arrow keys would move that
        view.wait("view.hub.newest('state').changed.length === 4")
        view.wait_until_done()
        digest = view.newest("progress")["sha256"]
        assert digest != before
        assert set(view.newest("state")["changed"]) == {"camera", "lights[0]", "materials.ball", "spp"}
        with view.page.expect_download() as download:
            view.page.get_by_role("link", name="Download scene").click()
        assert download.value.suggested_filename == "scene.zip"
        with zipfile.ZipFile(download.value.path()) as archive:
            archive.extractall(tmp_path)
    done = call("render", "scene.toml", "-d", _DEVICE, "-o", "a.film", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert Film.load(tmp_path / "a.film").provenance["image_sha256"] == digest


def test_each_panel_is_copied(browser: Any, server: Server, scene: Path, tmp_path: Path) -> None:
    """As tables of a scene file, and settings as options that the command line takes."""
    with view_of(browser, server, "copy", permissions=_CLIPBOARD) as view:
        view.wait_until_done()
        view.page.get_by_label("Max depth", exact=True).fill("5")
        view.page.keyboard.press("Enter")
        view.wait("view.hub.newest('state').changed.includes('max_depth')")
        view.open("View", "Render", "Material", "Light", "Camera")
        copied = {}
        for button, words in (
            ("Copy as options", "Options copied"),
            ("Copy as command", "Command copied"),
            ("Copy material as TOML", "Material copied"),
            ("Copy light as TOML", "Light copied"),
            ("Copy as TOML", "Camera copied"),
        ):
            view.page.get_by_role("button", name=button, exact=True).click()
            view.toast(words)
            copied[button] = view.page.evaluate("navigator.clipboard.readText()")
        view.wait_until_done()
        digest = view.newest("progress")["sha256"]
    assert copied["Copy as options"] == "--tone-map srgb --exposure 0"
    loaded = clrender.load(scene)
    assert tomllib.loads(copied["Copy material as TOML"])["materials"].keys() <= loaded.materials.keys()
    assert tomllib.loads(copied["Copy light as TOML"])["lights"][0]["type"] == "environment"
    assert tomllib.loads(copied["Copy as TOML"])["camera"]["vertical_fov"] == 40.0
    words = copied["Copy as command"].split()
    assert words[:2] == ["clrender", "render"] and "--max-depth" in words
    given = [*words[1:2], str(scene), *words[3:-1], "a.film", "-d", _DEVICE]
    assert call(*given, folder=tmp_path).returncode == 0
    assert Film.load(tmp_path / "a.film").provenance["image_sha256"] == digest


def test_without_a_clipboard_the_text_is_selected(browser: Any, server: Server) -> None:
    with view_of(browser, server, "selected", permissions=[]) as view:
        view.wait("view.picture.frame() !== undefined")
        view.run("navigator.clipboard.writeText = () => Promise.reject(new Error('no')); return 0")
        view.open("Material")
        view.page.get_by_role("button", name="Copy material as TOML").click()
        view.toast("copy it manually")
        assert tomllib.loads(view.page.evaluate("getSelection().toString()"))["materials"]


def test_edits_are_undone_and_redone_by_buttons_and_keys(browser: Any, server: Server) -> None:
    with view_of(browser, server, "undo") as view:
        view.wait_until_done()
        digest = view.newest("progress")["sha256"]
        page = view.page
        page.get_by_label("Samples", exact=True).fill("8")
        page.keyboard.press("Enter")
        view.wait("view.hub.newest('state').settings.spp === 8")
        undo, redo = page.get_by_role("button", name="Undo"), page.get_by_role("button", name="Redo")
        assert undo.get_attribute("aria-label") == "Undo: spp"
        assert redo.get_attribute("aria-disabled") == "true"
        undo.click()
        view.wait("view.hub.newest('state').settings.spp === 16")
        view.toast("Undone: spp")  # which screen readers are told
        assert page.locator(".cv-toast").get_attribute("aria-live") == "polite"
        redo.click()
        view.wait("view.hub.newest('state').settings.spp === 8")
        view.toast("Redone: spp")
        page.locator(".cv-stage").focus()
        page.keyboard.press("ArrowLeft")
        view.wait("view.hub.newest('state').changed.includes('camera')")
        page.keyboard.press("Control+z")
        view.wait("!view.hub.newest('state').changed.includes('camera')")
        page.keyboard.press("Control+z")
        view.wait("view.hub.newest('state').changed.length === 0")
        page.keyboard.press("Control+Shift+z")
        view.wait("view.hub.newest('state').settings.spp === 8")
        # What is typed has an undo of its own
        page.get_by_label("Samples", exact=True).focus()
        page.keyboard.press("Control+z")
        view.run("await new Promise((resolve) => setTimeout(resolve, 300)); return 0")
        assert view.newest("state")["settings"]["spp"] == 8
        page.locator(".cv-stage").focus()
        page.keyboard.press("Control+z")
        view.wait("view.hub.newest('progress').sha256 === argument", digest)


def test_a_light_is_edited_where_it_is_picked(browser: Any, server: Server) -> None:
    with view_of(browser, server, "light") as view:
        view.wait_until_done()
        view.open("Light")
        view.page.get_by_label("Light", exact=True).select_option("shapes[2]")
        view.page.get_by_label("Emission: strength").fill("30")
        view.page.keyboard.press("Enter")
        view.wait("view.hub.newest('state').changed.includes('shapes[2]')")
        values = {each["name"]: each["value"] for each in view.newest("scene")["emitters"]["shapes[2]"]["parameters"]}
        assert values["emission"] == pytest.approx([30.0, 28.0, 24.0])  # its colour stays
        view.page.get_by_label("Center: y", exact=True).fill("2.5")
        view.page.keyboard.press("Enter")
        view.wait("view.hub.newest('scene').emitters['shapes[2]'].parameters.some((each) => each.value[1] === 2.5)")
        view.page.get_by_label("Light", exact=True).select_option("lights[0]")
        view.page.get_by_label("Visible to camera", exact=True).uncheck()
        view.wait("view.hub.newest('state').changed.includes('lights[0]')")
        view.wait_until_done()
        view.page.get_by_role("button", name="Reset lights").click()
        view.wait("view.hub.newest('state').changed.length === 0")


def test_a_part_of_the_image_is_rendered(browser: Any, server: Server) -> None:
    with view_of(browser, server, "crop") as view:
        view.wait_until_done()
        whole = np.array(view.pixels(), np.uint8).reshape(90, 160, 4)
        for name, value in (("left", "40"), ("top", "20"), ("width", "60"), ("height", "50")):
            view.page.get_by_label(f"Crop: {name}").fill(value)
        view.page.keyboard.press("Enter")
        view.wait("view.picture.frame()?.image_width === 60")
        view.wait_until_done()
        assert (np.array(view.pixels(), np.uint8).reshape(50, 60, 4) == whole[20:70, 40:100]).all()
        view.page.get_by_label("Crop: reset").click()
        view.wait("view.picture.frame()?.image_width === 160")


def test_what_is_picked_has_an_outline_that_follows_it(browser: Any, server: Server) -> None:
    shown = "document.querySelector('.cv-outline-line').getAttribute('d')"
    with view_of(browser, server, "outline") as view:
        view.wait_until_done()
        view.click(0.5, 0.5)
        view.wait(f"({shown} ?? '') !== ''")
        box = view.run("""
            const [line, canvas] = ['.cv-outline-line', '.cv-canvas'].map((name) => document.querySelector(name));
            const [inner, outer] = [line, canvas].map((each) => each.getBoundingClientRect());
            return [inner.left, inner.right, inner.top, inner.bottom].map((side, i) => i < 2
                ? (side - outer.left) / outer.width : (side - outer.top) / outer.height);
        """)
        # A ball of 0.6 m, 4.04 m away in the middle of an image whose height is 2 tan(20°) at 1 m
        radius = np.tan(np.arcsin(0.6 / np.hypot(4.0, 0.6))) / np.tan(np.radians(20.0)) / 2
        assert box[3] - box[2] == pytest.approx(2 * radius, abs=0.05)
        assert (box[1] - box[0]) * 160 / 90 == pytest.approx(2 * radius, abs=0.05)
        before = view.run(shown)
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("+")  # nearer
        view.wait(f"![argument, ''].includes({shown})", before)
        view.page.keyboard.press("Escape")
        view.wait(f"{shown} === ''")


def test_messages_do_not_cover_the_probe(browser: Any, server: Server, scene: Path) -> None:
    overlaps = """
        const others = '.cv-banner, .cv-hint, .cv-toast.cv-visible, .cv-legend, .cv-tools';
        const boxes = [...document.querySelectorAll(others)]
            .filter((each) => each.checkVisibility()).map((each) => [each.className, each.getBoundingClientRect()]);
        const probe = document.querySelector('.cv-probe').getBoundingClientRect();
        return boxes.filter(([, box]) => box.width > 0 && box.left < probe.right && probe.left < box.right
            && box.top < probe.bottom && probe.top < box.bottom).map(([name]) => name);
    """
    for width, height in ((1280, 720), (390, 740), (320, 640)):
        with view_of(browser, server, "covers", viewport={"width": width, "height": height}) as view:
            view.wait_until_done()
            view.click(0.5, 0.5)
            view.wait("document.querySelector('.cv-probe').checkVisibility()")
            view.page.keyboard.press("l")  # with a legend
            scene.write_text(SCENE.replace("radius = 0.6", "radius = -1"))
            view.page.locator(".cv-banner").wait_for(state="visible")
            view.page.keyboard.press("Control+y")  # with a message
            view.wait("document.querySelector('.cv-toast').classList.contains('cv-visible')")
            assert view.run(overlaps) == []
            scene.write_text(SCENE)
            view.page.locator(".cv-banner").wait_for(state="hidden")


def test_what_is_waited_for_is_told_within_a_second(browser: Any, server: Server) -> None:
    with view_of(browser, server, "waiting") as view:
        connecting, waiting, drawn = view.run("""
            const { createHub } = await import('/page/hub.js');
            const { createStatus } = await import('/page/status.js');
            const transport = { send: () => {} };
            const status = createStatus(createHub(transport));
            const wait = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
            const seen = () => [status.hint.hidden, status.hint.textContent];
            await wait(0.95);
            const connecting = seen();
            transport.onstate('open');
            const state = { type: 'state', status: 'starting', problem: null, is_black: false };
            transport.onmessage(JSON.stringify(state));
            const waiting = seen();
            transport.onmessage(JSON.stringify({ ...state, status: 'rendering' }));
            return [connecting, waiting, seen()];
        """)
        assert connecting == [False, "Connecting to the renderer."]
        assert waiting == [False, "Waiting for the first image."]
        assert drawn[0]


def test_the_plot_of_the_error_has_axes(browser: Any, server: Server) -> None:
    with view_of(browser, server, "axes") as view:
        view.run("""
            const { createChart } = await import('/page/chart.js');
            window.chart = createChart();
            document.querySelector('.cv-strip .cv-chart').replaceWith(chart.element);
            chart.add(1, 0.2);
            chart.add(4, 0.1);
            chart.add(100, 0.02);
            return 0;
        """)
        text = {
            place: view.page.locator(f".cv-chart-{place}").inner_text() for place in ("most", "least", "begin", "end")
        }
        assert text == {"most": "20 %", "least": "2 %", "begin": "1.0 s", "end": "1:40"}
        assert view.page.locator(".cv-chart").get_attribute("aria-label") == "Error over time: 2 % after 1:40"


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_texts_have_contrast_and_fields_have_labels(browser: Any, server: Server, scheme: str) -> None:
    """At least 4.5 to 1, as of WCAG 2.2 AA, with all sections open and a probe, a legend and a message shown."""
    with view_of(browser, server, f"contrast-{scheme}", color_scheme=scheme) as view:
        view.wait_until_done()
        view.click(0.5, 0.5)
        view.page.keyboard.press("l")
        view.page.keyboard.press("Control+y")
        view.page.locator("details").evaluate_all("all => all.forEach((each) => each.open = true)")
        view.open("Light")
        view.run("await new Promise((resolve) => setTimeout(resolve, 300)); return 0")
        assert view.run(CONTRAST) == []
        nameless = view.page.locator(CONTROLS).evaluate_all(NAMELESS)
        assert nameless == []
        twice = view.run("""
            const ids = [...document.querySelectorAll('.cv [id]')].map((each) => each.id);
            return ids.filter((id, i) => ids.indexOf(id) !== i);
        """)
        assert twice == []


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_it_fits_phones_and_wide_screens(browser: Any, server: Server, scheme: str) -> None:
    for width in (320, 390, 1280, 2560):
        with view_of(
            browser, server, f"fits-{width}", viewport={"width": width, "height": 740}, color_scheme=scheme
        ) as view:
            view.wait("view.picture.frame() !== undefined")
            view.page.locator("details").evaluate_all("all => all.forEach((each) => each.open = true)")
            for name in ("lights[0]", "shapes[2]"):
                view.page.get_by_label("Light", exact=True).select_option(name)
                assert view.run("document.documentElement.scrollWidth") <= width
                assert view.page.locator(".cv *").evaluate_all(BEYOND, width) == [], width
            assert view.page.locator(".cv-canvas").bounding_box()["width"] > 0.7 * min(width, 900)
            long = "No connection, reconnecting"
            view.page.locator(".cv-status").evaluate("(each, text) => (each.textContent = text)", long)
            assert view.page.locator(".cv-bar").evaluate("each => each.scrollWidth - each.clientWidth") <= 0
            right = view.page.locator(".cv-primary").evaluate("each => each.getBoundingClientRect().right")
            assert right <= width


def test_lights_keep_their_colour_when_their_strength_changes(browser: Any, server: Server) -> None:
    """The picker, too, leaves the strength as it is."""
    with view_of(browser, server, "strength") as view:
        values = view.run("""
            const { createField } = await import('/page/fields.js');
            const given = [];
            const about = { label: 'Emission', kind: 'color', strength: true, schema: {} };
            const field = createField(about, (value) => given.push(value));
            field.show([20, 10, 5], false);
            const [picker, , , , strength] = field.element.querySelectorAll('input');
            const shown = picker.value;
            strength.value = '40';
            strength.dispatchEvent(new Event('change'));
            picker.value = '#ffffff';
            picker.dispatchEvent(new Event('input'));
            await new Promise((resolve) => setTimeout(resolve, 500)); // what the engine says now is newer
            field.show([0, 0, 0], false);
            strength.value = '3';
            strength.dispatchEvent(new Event('change'));
            return [shown, ...given];
        """)
        assert values[0] == "#ffbc89"
        assert values[1:] == [[40, 20, 10], [40, 40, 40], [3, 3, 3]]


def test_the_state_says_what_can_be_undone(browser: Any, server: Server) -> None:
    """Also to a page that is opened later."""
    with view_of(browser, server, "drag") as view:
        view.wait("view.picture.frame() !== undefined")
        camera = json.dumps(view.newest("state")["camera"])
        box = view.page.locator(".cv-canvas").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        view.page.mouse.move(x, y)
        view.page.mouse.down()
        view.page.mouse.move(x + 100, y)
        view.page.mouse.up()
        view.wait("view.hub.newest('state').undo === 'camera'")
        time.sleep(0.3)
        with view_of(browser, server, "later"):
            pass  # which resets all, as an edit of its own
        view.wait("view.hub.newest('state').undo === 'reset of camera'")
        for _ in range(2):
            view.run("view.hub.send({ type: 'undo' }); return 0")
        view.wait("view.hub.newest('state').redo === 'camera'")
        assert json.dumps(view.newest("state")["camera"]) == camera
