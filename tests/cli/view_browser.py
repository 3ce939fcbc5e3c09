"""Chromium in front of `clrender view`."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest
from view_clients import Server

__all__ = ["BEYOND", "CONTRAST", "CONTROLS", "FAILURES", "NAMELESS", "SCENE", "chromium", "view_of"]

FAILURES: Final = Path(__file__).parents[2] / "test-artifacts"
"""Where screenshots of failed tests go."""

SCENE: Final = """
title = "A ball on a table"
[camera]
position = [0.0, 1.2, 4.0]
target = [0.0, 0.6, 0.0]
vertical_fov = 40.0
[image]
width = 160
height = 90
[render]
spp = 16
[materials.table]
type = "lambert"
reflectance = [0.5, 0.45, 0.4]
[materials.ball]
type = "lambert"
reflectance = [0.8, 0.1, 0.05]
[[shapes]]
type = "quad"
origin = [-6.0, 0.0, 6.0]
edge_u = [12.0, 0.0, 0.0]
edge_v = [0.0, 0.0, -12.0]
material = "table"
[[shapes]]
type = "sphere"
center = [0.0, 0.6, 0.0]
radius = 0.6
material = "ball"
[[lights]]
type = "environment"
radiance = [0.3, 0.4, 0.6]
[[shapes]]
type = "sphere"
center = [2.5, 3.0, 2.0]
radius = 0.5
emission = [15.0, 14.0, 12.0]
"""


@contextmanager
def chromium() -> Iterator[Any]:
    """A Playwright browser; skips the test where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("Chromium is not installed")
    with playwright.sync_playwright() as started:
        # Without a GPU, WebGL is drawn by SwiftShader, which newer versions want to be asked for.
        options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = started.chromium.launch(executable_path=program, args=options)
        try:
            yield browser
        finally:
            browser.close()


class view_of:
    """A page that shows a server's view; as a context manager, it fails on any error in the console.

    Parameters
    ----------
    browser
        Of `chromium`.
    server : Server
    name : str
        Of the screenshot, where the test fails.
    drawing : str
        ``webgl``, ``plain`` or whichever the page takes for fast.
    options
        Of Playwright's `new_context`.
    """

    def __init__(self, browser: Any, server: Server, name: str, *, drawing: str = "", **options: Any) -> None:
        self._context = browser.new_context(**{"viewport": {"width": 1280, "height": 720}, **options})
        self.page = self._context.new_page()
        self.page.set_default_timeout(120_000)  # of a machine that has much else to do
        self.errors: list[str] = []
        self._name = name
        self.page.on(
            "console", lambda said: self.errors.append(said.text) if said.type in ("error", "warning") else None
        )
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(server.address + (f"#{drawing}" if drawing else ""))

    def __enter__(self) -> view_of:
        # Whatever an earlier test has changed.
        self.wait("view.hub.newest('state') !== undefined")
        if self.newest("state")["changed"]:
            what = "['camera', 'settings', 'materials', 'lights']"
            self.run(f"{what}.forEach((what) => view.hub.send({{ type: 'reset', what }}))")
        if self.newest("state")["status"] == "stopped":
            self.run("view.hub.send({ type: 'run', run: true })")
        self.wait("view.hub.newest('state').changed.length === 0 && view.hub.newest('state').status !== 'stopped'")
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None or self.errors:
            FAILURES.mkdir(exist_ok=True)
            self.page.screenshot(path=FAILURES / f"{self._name}.png")
        self._context.close()
        if kind is None:
            assert not self.errors

    def run(self, script: str, argument: Any = None) -> Any:
        """The value of an expression or function body in which `view` is what `mount` returned."""
        body = script if "return" in script else f"return {script}"
        whole = f"async (argument) => {{ const {{ view }} = await import('/page/page.js'); {body} }}"
        return self.page.evaluate(whole, argument)

    def newest(self, kind: str) -> Any:
        """The engine's newest message of a kind."""
        return self.run(f"view.hub.newest('{kind}') ?? null")

    def wait(self, condition: str, argument: Any = None, seconds: float = 120) -> None:
        """Until a condition holds, in which `view` is what `mount` returned."""
        end = time.monotonic() + seconds
        while not self.run(condition, argument):
            assert time.monotonic() < end, f"still not: {condition}"
            time.sleep(0.05)

    def wait_until_done(self, seconds: float = 300) -> None:
        """All samples are there, and drawn."""
        self.wait(_DONE, seconds=seconds)

    def open(self, *names: str) -> None:
        """Open sections of the panel."""
        for name in names:
            heading = self.page.locator(".cv-section > summary").filter(has_text=name)
            heading.evaluate("each => (each.closest('details').open = true)")

    def click(self, x: float, y: float) -> None:
        """Click on the image, at shares of its width and height."""
        box = self.page.locator(".cv-canvas").bounding_box()
        self.page.mouse.click(box["x"] + box["width"] * x, box["y"] + box["height"] * y)

    def toast(self, text: str) -> None:
        """Wait for a message to people."""
        self.wait("document.querySelector('.cv-toast').textContent.includes(argument)", text)

    def pixels(self) -> list[int]:
        """What the canvas shows: RGBA bytes, rows from the top."""
        return list(self.run(_PIXELS))


_DONE: Final = """
    const [state, frame] = [view.hub.newest("state"), view.picture.frame()];
    return state?.status === "done" && frame?.final && frame.revision === state.revision
        && frame.samples === state.settings.spp;
"""

_PIXELS: Final = """
    const image = await createImageBitmap(await view.picture.snapshot());
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    return [...context.getImageData(0, 0, image.width, image.height).data];
"""

CONTRAST: Final = """
    const parsed = (text) => (text.match(/[\\d.]+/g) ?? []).map(Number);
    const channel = (x) => (x / 255 <= 0.04045 ? x / 255 / 12.92 : ((x / 255 + 0.055) / 1.055) ** 2.4);
    const luminance = ([r, g, b]) => 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
    const behind = (element) => {
        for (let each = element; each !== null; each = each.parentElement) {
            const color = parsed(getComputedStyle(each).backgroundColor);
            if (color.length === 3 || (color.length === 4 && color[3] > 0.8)) return color.slice(0, 3);
        }
        return [255, 255, 255];
    };
    const faded = (element) => {
        for (let each = element; each !== null; each = each.parentElement) {
            if (Number(getComputedStyle(each).opacity) < 1) return true;
        }
        return false;
    };
    const seen = [...document.querySelectorAll('.cv *')].filter((each) => each.checkVisibility() && !faded(each)
        && [...each.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim() !== ''));
    return seen.map((each) => {
        const [a, b] = [parsed(getComputedStyle(each).color), behind(each)].map(luminance).sort((x, y) => y - x);
        return [(a + 0.05) / (b + 0.05), `${each.className} ${each.textContent.slice(0, 40)}`];
    }).filter(([ratio]) => ratio < 4.5);
"""
"""Texts whose contrast is below 4.5 to 1, as of WCAG 2.2 AA, as the body of a function for `view_of.run`."""

CONTROLS: Final = (
    ".cv button, .cv input, .cv select, .cv a, .cv [role=group], .cv [role=region], .cv [role=application]"
)
NAMELESS: Final = """all => all.filter((each) => !each.getAttribute("aria-label") && !each.labels?.length)
    .filter((each) => !each.textContent.trim()).map((each) => each.outerHTML)"""
"""Controls without a name."""

BEYOND: Final = """(all, width) => all.filter((each) => each.checkVisibility())
    .filter((each) => !each.closest('pre, .cv-hidden, .lp-scroll, .cv-paths'))
    .filter((each) => each.getBoundingClientRect().right > width + 0.5).map((each) => each.outerHTML.slice(0, 200))"""
"""Elements that reach beyond the width of the page, but for those in parts that scroll."""
