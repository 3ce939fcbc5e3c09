"""The documentation site as readers use it: questions find the page that answers, and pages fit a phone."""

from __future__ import annotations

import functools
import http.server
import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from view_browser import chromium

ROOT = Path(__file__).resolve().parents[2]

QUESTIONS: Final = {
    "my picture is black": "troubleshooting",
    "fireflies": "troubleshooting",
    "out of memory": "troubleshooting",
    "exposure too dark": "troubleshooting",
    "slow render": "troubleshooting",
    "noise": "errors",
    "speckled": "hard-light",
    "caustics": "hard-light",
    "which integrator": "integrators",
    "memory limit": "devices",
    "gpu": "devices",
    "blender": "coming-from",
    "max bounces": "coming-from",
    "field of view": "cameras",
    "gltf": "scenes",
    "denoise": "rendering",
    "resume checkpoint": "long-renders",
    "depth layer": "layers",
    "cite": "cite",
    "version": "cite",
    "texture": "textures",
    "environment map": "lights",
    "motion blur": "motion",
    "glass": "materials",
    "hair": "materials",
    "roughness": "materials",
    "add a light": "extend",
    "exit code": "reference",
    "cryptomatte": "reference",
    "dask cluster": "scaling",
    "session": "python",
    "install": "start",
    "smoke": "media",
    "spectral": "wavelengths",
    "render_batch": "python",
}
"""Page that answers, by what a reader types."""

WIDTH: Final = 390
"""Of a phone, pixels."""
WIDE: Final = (
    "README",
    "docs/coming-from",
    "docs/cite",
    "docs/scene-file",
    "docs/devices",
    "docs/integrators",
    "docs/layers",
    "docs/report",
)
"""Pages with wide tables and long names."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("sphinx")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", "-c", "docs", "-d", str(folder / "doctrees")]
    subprocess.run([*command, ".", str(folder / "site")], cwd=ROOT, check=True, capture_output=True)
    return folder / "site"


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(site))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


@pytest.mark.long
def test_questions_find_the_page_that_answers(site: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no node to run the search")
    command = [node, str(ROOT / "scripts" / "site_search.js"), str(site), *QUESTIONS]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    wrong = {}
    for (question, page), results in zip(QUESTIONS.items(), found, strict=True):
        pages = list(dict.fromkeys(result["page"] for result in results))
        if f"docs/{page}" not in pages[:3]:
            wrong[question] = pages[:5]
        logs = ("docs/notes/", "DECISIONS", "CHANGELOG")
        assert pages and not pages[0].startswith(logs), f"{question}: a log is first"
    assert wrong == {}


@pytest.mark.long
def test_a_browser_shows_the_results_in_that_order(address: str) -> None:
    with chromium() as browser:
        page = browser.new_page()
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(f"{address}/search.html?q=which+integrator")
        first = page.locator("ul.search > li a").first
        first.wait_for(timeout=60_000)
        assert first.get_attribute("href").startswith("docs/integrators.html")
        icon = page.evaluate("document.querySelector('link[rel~=icon]').href")
        assert page.request.get(icon).status == 200
        assert errors == []


OVERFLOW: Final = """() => {
    const scrolls = (each) => ["auto", "scroll"].includes(getComputedStyle(each).overflowX);
    const within = (each) => each.closest("article") && (scrolls(each) || within(each.parentElement));
    const wide = [...document.querySelectorAll("article *")]
        .filter((each) => each.getBoundingClientRect().right > innerWidth + 1);
    return [wide.length, wide.filter((each) => !within(each.parentElement)).map((each) => each.outerHTML.slice(0, 80))];
}"""
"""How many parts of a page reach beyond its right edge, and those of them that no part around them scrolls to."""


@pytest.mark.long
def test_wide_tables_scroll_by_themselves_on_a_phone(address: str) -> None:
    with chromium() as browser:
        page = browser.new_page(viewport={"width": WIDTH, "height": 800})
        for name in WIDE:
            page.goto(f"{address}/{name}.html")
            wide, lost = page.evaluate(OVERFLOW)
            assert lost == [] and page.evaluate("document.scrollingElement.scrollWidth") <= WIDTH, name
            assert wide > 0 or name == "README"


REPORT: Final = """() => ({
    contents: [...document.querySelectorAll("#the-founding-report-reproduced > ul a")].map((each) => each.hash),
    headings: [...document.querySelectorAll("article section section[id]")].map((each) => "#" + each.id),
    cut: [...document.querySelectorAll("article .table-wrapper")].filter((each) => each.scrollWidth > each.clientWidth)
        .map((each) => [each.scrollWidth, each.clientWidth]),
    right: Math.max(...[...document.querySelectorAll("article *")].map((each) => each.getBoundingClientRect().right)),
    resized: [...document.querySelectorAll("article img")].filter((each) => each.src.endsWith(".jpg")
        && Math.abs(each.getBoundingClientRect().width - each.naturalWidth) > 1).map((each) => each.src),
})"""
"""Of the report's page: links and headings, tables that scroll, its right end, pictures that are not at their size."""


@pytest.mark.long
@pytest.mark.parametrize("width", [1280, 1600])
def test_the_report_shows_whole_tables_and_figures_at_their_size(address: str, width: int) -> None:
    with chromium() as browser:
        page = browser.new_page(viewport={"width": width, "height": 900})
        page.goto(f"{address}/docs/report.html")
        page.wait_for_function("[...document.images].every((each) => each.complete)")
        found = page.evaluate(REPORT)
        assert found["contents"] == found["headings"] and len(found["contents"]) == 6
        assert found["cut"] == [] and found["resized"] == []
        assert found["right"] <= width and page.evaluate("document.scrollingElement.scrollWidth") <= width
