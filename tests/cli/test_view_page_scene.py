"""Light paths, lights, environments and alpha in the page of `clrender view`.

Skipped where Chromium or Playwright is missing, as tests/cli/test_view_page.py, whose server this file does not share.
"""

from __future__ import annotations

import os
import time
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from cli_support import call
from PIL import Image
from view_browser import BEYOND, CONTRAST, CONTROLS, NAMELESS, view_of
from view_clients import Server

import clrender
from clrender.film import Film
from clrender.image.files import write_image

pytestmark = [pytest.mark.usefixtures("only_driver"), pytest.mark.long]

_DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")
_STATUS: Final = "document.querySelector('.lp-status').textContent"
_TRACED: Final = "document.querySelector('.lp-samples') !== null && !document.querySelector('[aria-busy=true]')"
_DRAWN: Final = "document.querySelectorAll('.cv-picture .cv-paths line').length"

_VISIBLE: Final = """
    view.hub.newest("scene").emitters["lights[0]"].parameters.find((each) => each.name === "visible_to_camera").value
""".strip()


@pytest.fixture(scope="module")
def server(browser: Any, scene: Path, only_driver: None) -> Iterator[Server]:
    write_image(scene.parent / "map.exr", np.linspace(0.0, 1.0, 8 * 16 * 3, dtype=np.float32).reshape(8, 16, 3))
    with Server(scene.name, "-d", _DEVICE, folder=scene.parent) as started:
        yield started
        assert started.end()[0] == 0


def _paths(view: view_of) -> None:
    view.page.get_by_role("tab", name="Light paths").click()


def _image(view: view_of) -> np.ndarray[Any, Any]:
    return np.array(view.pixels(), np.uint8).reshape(90, 160, 4).astype(int)


def _drawn(view: view_of, wanted: Callable[[Any], bool]) -> Any:
    """The picture, as soon as it is so: a page draws what it has got at the next refresh of the screen."""
    for _ in range(300):
        image = _image(view)
        if wanted(image):
            return image
        time.sleep(0.1)
    raise AssertionError("the picture is another one")


# --- light paths ---


def test_a_click_shows_the_paths_of_the_pixel(browser: Any, server: Server) -> None:
    with view_of(browser, server, "paths") as view:
        view.wait_until_done()
        _paths(view)
        assert "Click on a pixel" in view.run(_STATUS)
        told = view.run("""
            const canvas = document.querySelector('.cv-canvas').getBoundingClientRect();
            const stage = document.querySelector('.cv-stage');
            stage.setPointerCapture = () => {};
            const place = { clientX: canvas.left + canvas.width / 2, clientY: canvas.top + canvas.height / 2,
                bubbles: true, pointerId: 1, isPrimary: true };
            stage.dispatchEvent(new PointerEvent('pointerdown', place));
            stage.dispatchEvent(new PointerEvent('pointerup', place));
            return document.querySelector('.lp-status').textContent;
        """)
        assert told == "Tracing the paths of pixel 80, 45."  # from the first moment
        view.wait(_TRACED)
        status = view.run(_STATUS)
        assert status.startswith("All 16 samples of pixel 80, 45, mean radiance ")
        radiance = [
            float(each) for each in status.split("mean radiance ")[1].split(".  ")[0].split(". Sample")[0].split()
        ]
        view.wait("document.querySelector('.cv-probe').dataset.probe !== undefined")
        probe = view.run("JSON.parse(document.querySelector('.cv-probe').dataset.probe)")
        assert radiance == pytest.approx(probe["radiance"], rel=1e-3)
        rows = view.page.locator(".lp-samples tbody tr")
        assert rows.count() == 16
        assert view.run(_DRAWN) >= 2
        assert view.page.locator(".lp-vertices .lp-vertex").count() >= 1
        for words in ("pdf, 1/sr", "Throughput before", "Roulette", "f cos / pdf", "Contribution"):
            assert view.page.locator(".lp-vertices").evaluate(
                "(each, words) => each.textContent.includes(words)", words
            )
        assert "MIS light" in view.page.locator(".lp-vertices").first.inner_text()
        # Another sample by a key, which moves no camera
        camera = view.newest("state")["camera"]
        rows.first.focus()
        view.page.keyboard.press("ArrowDown")
        chosen = rows.nth(1).get_attribute("data-sample")
        assert view.page.locator(".lp h2", has_text=f"Sample {chosen}").count() == 1
        view.page.locator(".lp-stage").focus()
        view.page.keyboard.press("ArrowLeft")
        view.page.keyboard.press("+")
        assert view.newest("state")["camera"] == camera
        view.page.get_by_role("tab", name="Controls").click()
        assert view.run(_DRAWN) == 0
        _paths(view)
        view.wait(f"{_TRACED} && {_DRAWN} >= 2")
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("Escape")
        assert view.run(_DRAWN) == 0 and "Click on a pixel" in view.run(_STATUS)


def test_paths_follow_the_camera_and_edits_by_keyboard_too(browser: Any, server: Server) -> None:
    with view_of(browser, server, "follow") as view:
        view.wait_until_done()
        view.page.locator(".cv-stage").focus()
        view.page.keyboard.press("t")
        view.page.keyboard.press("p")
        view.page.keyboard.press("Enter")
        view.wait(_TRACED)
        first = view.run(_STATUS)
        view.page.keyboard.press("+")
        view.wait("document.querySelector('.cv-picture .cv-paths') === null")  # it would lie beside what it shows
        view.wait(f"{_TRACED} && {_DRAWN} >= 2 && {_STATUS} !== argument", first)
        second = view.run(_STATUS)
        view.run(
            "view.hub.send({ type: 'material', name: 'ball', values: { reflectance: [0.1, 0.1, 0.9] } }); return 0"
        )
        view.wait(f"{_TRACED} && {_DRAWN} >= 2 && {_STATUS}.startsWith('All') && {_STATUS} !== argument", second)
        view.page.get_by_label("Traced samples", exact=True).fill("4")
        view.page.keyboard.press("Enter")
        view.wait(f"{_STATUS}.startsWith('The first 4 of 16 samples')")
        assert view.page.locator(".lp-samples tbody tr").count() == 4


def test_paths_of_bdpt_tell_what_light_paths_splatted(browser: Any, server: Server) -> None:
    with view_of(browser, server, "bdpt") as view:
        view.run("view.hub.send({ type: 'set', settings: { integrator: 'bdpt' } }); return 0")
        view.wait("view.hub.newest('state').settings.integrator === 'bdpt'")
        view.wait_until_done()
        _paths(view)
        view.click(0.5, 0.5)
        view.wait(f"{_TRACED} && {_STATUS}.startsWith('All 16 samples of pixel 80, 45')")
        status = view.run(_STATUS)
        assert " of it splatted by paths from lights" in status
        radiance, splatted = (
            [float(each) for each in part.split()[-3:]]
            for part in status.split(" of it splatted")[0].removesuffix(",").split(", ")[-2:]
        )
        view.wait("document.querySelector('.cv-probe').dataset.probe !== undefined")
        probe = view.run("JSON.parse(document.querySelector('.cv-probe').dataset.probe)")
        assert radiance == pytest.approx(probe["radiance"], rel=1e-3)
        assert all(0.0 <= part <= whole for part, whole in zip(splatted, radiance, strict=True))
        assert view.page.locator(".lp-samples:not(.lp-splats) tbody tr").count() == 16 and view.run(_DRAWN) >= 2
        # A light path is listed and drawn by a click, and another one by a key
        rows = view.page.locator(".lp-splats tbody tr")
        assert rows.count() == 2 and "All 2 splats" in view.page.locator(".lp-splats caption").inner_text()
        before = view.run(f"return {_DRAWN}")
        rows.first.click()
        assert rows.first.get_attribute("aria-current") == "true"
        number = rows.first.locator("td").first.inner_text()
        assert view.page.locator(f"[aria-label='Vertices of light path {number}'] .lp-light").count() >= 2
        assert view.run(f"return {_DRAWN}") != before
        rows.first.press("ArrowDown")
        assert rows.nth(1).get_attribute("aria-current") == "true"
        rows.nth(1).press("Enter")
        assert view.page.locator(".lp-splats tr[aria-current=true]").count() == 0
        assert view.run(f"return {_DRAWN}") == before
        assert view.run(CONTRAST) == []


def test_what_has_no_paths_is_said_in_words(browser: Any, server: Server) -> None:
    with view_of(browser, server, "refused") as view:
        view.run("view.hub.send({ type: 'set', settings: { integrator: 'reuse' } }); return 0")
        view.wait("view.hub.newest('state').settings.integrator === 'reuse'")
        view.wait("view.picture.frame() !== undefined")
        _paths(view)
        view.click(0.5, 0.5)
        view.wait(f"{_STATUS}.startsWith('Integrator reuse ')")
        assert "light paths are shown of path, " in view.run(_STATUS)
        assert view.page.locator(".lp-samples").count() == 0


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_the_tab_fits_phones_and_wide_screens_and_is_read(browser: Any, server: Server, scheme: str) -> None:
    for width in (320, 390, 1280, 2560):
        size = {"width": width, "height": 740}
        with view_of(browser, server, f"paths-{width}", viewport=size, color_scheme=scheme) as view:
            view.wait_until_done()
            _paths(view)
            view.click(0.5, 0.5)
            view.wait(_TRACED)
            assert view.run("document.documentElement.scrollWidth") <= width
            assert view.page.locator(".cv *").evaluate_all(BEYOND, width) == [], width
            assert view.page.locator(".cv-canvas").bounding_box()["width"] > 0.4 * min(width, 1600)
            assert view.page.locator(CONTROLS).evaluate_all(NAMELESS) == []
            assert view.run(CONTRAST) == []
            tab = view.page.get_by_role("tab", name="Light paths")
            assert tab.get_attribute("aria-selected") == "true"
            part = view.page.locator(f"#{tab.get_attribute('aria-controls')}")
            assert part.get_attribute("aria-labelledby") == tab.get_attribute("id") and part.is_visible()
            tab.focus()
            view.page.keyboard.press("ArrowLeft")
            assert view.page.locator(":focus").inner_text() == "Controls"
            assert view.page.get_by_label("Tone curve").is_visible() and not part.is_visible()


# --- lights and environments ---


def test_lights_are_added_where_one_clicks_and_kept(browser: Any, server: Server, tmp_path: Path) -> None:
    with view_of(browser, server, "lights") as view:
        view.wait_until_done()
        before = view.newest("progress")["sha256"]
        view.open("Light", "Save")
        for kind, click in (("sphere", True), ("spot", False)):
            view.page.get_by_label("New light").select_option(kind)
            view.page.get_by_role("button", name="Add by click").click()
            view.toast(f"Click on what the {kind} light is to be above")
            if click:
                view.click(0.75, 0.7)
            else:
                view.page.locator(".cv-stage").focus()
                view.page.keyboard.press("Enter")  # above the probe
            view.toast(f"Added {kind} light.")
        view.wait("view.hub.newest('state').changed.length === 2")
        assert view.newest("state")["changed"] == ["lights[1]", "shapes[3]"]
        light = view.page.get_by_label("Light", exact=True)
        view.wait("[...document.querySelectorAll('select')].some((each) => each.value === 'lights[1]')")
        view.page.get_by_label("Cone degrees", exact=True).fill("90")
        view.page.keyboard.press("Enter")
        view.wait("JSON.stringify(view.hub.newest('scene').emitters['lights[1]'].parameters).includes('90')")
        light.select_option("shapes[2]")  # of the scene file
        assert view.page.get_by_role("button", name="Remove light").is_disabled()
        light.select_option("shapes[3]")
        view.page.get_by_role("button", name="Remove light").click()
        view.wait("view.hub.newest('state').changed.length === 1")
        view.page.get_by_role("button", name="Undo").click()
        view.wait("view.hub.newest('state').changed.length === 2")
        view.wait_until_done()
        digest = view.newest("progress")["sha256"]
        assert digest != before
        with view.page.expect_download() as download:
            view.page.get_by_role("link", name="Download scene").click()
        with zipfile.ZipFile(download.value.path()) as archive:
            archive.extractall(tmp_path)
    done = call("render", "scene.toml", "-d", _DEVICE, "-o", "a.film", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert Film.load(tmp_path / "a.film").provenance["image_sha256"] == digest
    kept = clrender.load(tmp_path / "scene.toml")
    assert [each.type for each in kept.lights] == ["environment", "spot"] and len(kept.shapes) == 4


def test_the_environment_is_a_file_beside_the_scene_or_a_sky(browser: Any, server: Server, tmp_path: Path) -> None:
    with view_of(browser, server, "environment") as view:
        view.wait_until_done()
        view.open("Environment", "Save")
        chosen = view.page.get_by_label("Environment", exact=True)
        assert chosen.input_value() == "constant"
        view.wait("[...document.querySelectorAll('option')].some((each) => each.value === 'file:map.exr')")
        chosen.select_option("sky")
        view.page.get_by_label("Haze (turbidity)", exact=True).last.wait_for(state="visible")
        chosen.select_option("file:map.exr")
        view.wait("view.hub.newest('scene').environment.kind === 'file'")
        view.page.get_by_label("Strength: strength").fill("2.5")
        view.page.keyboard.press("Enter")
        view.page.get_by_label("Rotation", exact=True).fill("70")
        view.page.keyboard.press("Enter")
        view.wait("JSON.stringify(view.hub.newest('scene').emitters['lights[0]'].parameters).includes('70')")
        view.page.get_by_label("Visible", exact=True).uncheck()
        view.wait(f"{_VISIBLE} === false")
        assert view.page.get_by_label("Hide environment").is_checked()
        view.wait_until_done()
        digest = view.newest("progress")["sha256"]
        with view.page.expect_download() as download:
            view.page.get_by_role("link", name="Download scene").click()
        with zipfile.ZipFile(download.value.path()) as archive:
            archive.extractall(tmp_path)
        chosen.select_option("none")
        view.wait("view.hub.newest('scene').environment === null")
        chosen.select_option("scene")
        view.wait("view.hub.newest('state').changed.length === 0")
    assert call("render", "scene.toml", "-d", _DEVICE, "-o", "a.film", folder=tmp_path).returncode == 0
    assert Film.load(tmp_path / "a.film").provenance["image_sha256"] == digest
    light = clrender.load(tmp_path / "scene.toml").environment
    assert light is not None and light.scale == (2.5, 2.5, 2.5) and light.rotate_degrees == 70.0


# --- alpha ---


def test_alpha_is_shown_over_a_chequerboard_and_downloaded(browser: Any, server: Server) -> None:
    drawn = {}
    for drawing in ("webgl", "plain"):
        with view_of(browser, server, "alpha", drawing=drawing) as view:
            view.wait_until_done()
            view.open("View", "Save")
            opaque = _image(view)
            view.page.get_by_label("Alpha", exact=True).check()
            view.wait("view.hub.newest('state').changed.includes('lights[0]')")
            view.wait_until_done()
            assert view.page.get_by_label("Hide environment").is_checked()
            # Squares of 8 pixels, of two greys
            drawn[drawing] = _drawn(view, lambda image: set(np.unique(image[2:6, 2:158:8, 0])) == {115, 153})
            assert (drawn[drawing][45, 70:90] == opaque[45, 70:90]).all()  # the ball is opaque
            with view.page.expect_download() as download:
                view.page.get_by_role("link", name=".png", exact=True).click()
            with Image.open(download.value.path()) as saved:
                assert saved.mode == "RGBA"
                alpha = np.asarray(saved)[..., 3]
            assert alpha[0, 0] == 0 and alpha[45, 80] == 255
            view.page.get_by_label("Alpha", exact=True).uncheck()
            view.wait(f"{_VISIBLE} === true")
            view.wait_until_done()
            _drawn(view, partial(np.array_equal, opaque))
            with view.page.expect_download() as download:
                view.page.get_by_role("link", name=".png", exact=True).click()
            with Image.open(download.value.path()) as saved:
                assert saved.mode == "RGB"
    assert np.abs(drawn["webgl"] - drawn["plain"]).max() <= 1
