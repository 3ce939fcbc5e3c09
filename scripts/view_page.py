"""Measure the page of `clrender view` in Chromium, and take pictures of it: `scripts/view_page.py -o DIR [SCENE]`.

Needs `pip install playwright` and Debian's Chromium. Prints one JSON object: milliseconds from the page's first request
to the first picture drawn, from a camera move in the page to the frame that shows it, from an edit of a material and of
a light to the first frame of the new image, and from a question for the light paths of a pixel to its answer.

`scripts/view_page.py --documentation` makes `docs/view.jpg`: the scene `product`, and light paths of the bottle.
"""

from __future__ import annotations

import argparse
import io
import json
import statistics
import sys
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "cli"))

from PIL import Image
from view_browser import chromium, view_of
from view_clients import Server

__all__: list[str] = []

_ORBITS: Final = """
    const times = [];
    for (let i = 0; i < argument; i += 1) {
        await new Promise((resolve) => setTimeout(resolve, 300));
        const begin = performance.now();
        await new Promise((resolve) => {
            const before = view.camera.lastSent();
            view.picture.onDrawn((frame) => {
                const sent = view.camera.lastSent();
                if (sent !== before && frame.answers === sent) resolve();
            });
            view.camera.orbit(i % 2 ? 0.05 : -0.05, 0.0);
        });
        times.push(performance.now() - begin);
    }
    return times;
"""

_EDITS: Final = """
    const scene = view.hub.newest("scene");
    const tables = argument.type === "material" ? scene.materials : scene.emitters;
    const isColor = (each) => each.kind === "color" && each.value !== null;
    const name = Object.keys(tables).find((each) => tables[each].parameters.some(isColor));
    if (name === undefined) return [];
    const { name: key, value } = tables[name].parameters.find(isColor);
    const times = [];
    for (let i = 0; i < argument.count; i += 1) {
        await new Promise((resolve) => setTimeout(resolve, 300));
        const begin = performance.now();
        await new Promise((resolve) => {
            const before = view.picture.frame().revision;
            view.picture.onDrawn((frame) => frame.revision > before && resolve());
            const values = { [key]: [value].flat().map((each) => each * (i % 2 ? 1 : 0.9)) };
            view.hub.send({ type: argument.type, name, values });
        });
        times.push(performance.now() - begin);
    }
    return times;
"""

_PATHS: Final = """
    const [width, height] = view.picture.size();
    const times = [];
    for (let i = 0; i < argument; i += 1) {
        const begin = performance.now();
        const place = { x: Math.floor(width * (0.3 + 0.03 * i)), y: Math.floor(height * 0.6) };
        const ask = (answered) => view.hub.send({ type: "paths", ...place }, answered);
        const reply = await new Promise((resolve) => ask((got) => (resolve(got), true)));
        if (reply.type !== "paths") throw new Error(reply.message);
        times.push(performance.now() - begin);
    }
    return times;
"""

_DOCUMENTATION: Final = Path(__file__).resolve().parents[1] / "docs" / "view.jpg"
_PIXEL: Final = (0.545, 0.47)
"""Where the documentation's picture has its paths: in the bottle."""


def main() -> int:
    """Measure, and take screenshots."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="room")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("-d", "--device")
    parser.add_argument("--orbits", type=int, default=20)
    parser.add_argument("-o", "--output", type=Path, help="folder for pictures")
    parser.add_argument("--documentation", action="store_true", help="make the picture of docs/view.md instead")
    parser.add_argument("--spp", type=int, default=64, help="of that picture, which is denoised (64)")
    chosen = parser.parse_args()
    if chosen.documentation:
        _documented(chosen.spp, chosen.output)
        return 0
    if chosen.output is None:
        parser.error("name a folder for pictures with -o")
    chosen.output.mkdir(parents=True, exist_ok=True)
    with chromium() as browser:
        arguments = (
            chosen.scene,
            "--size",
            chosen.size,
            "--spp",
            "4096",
            *(["-d", chosen.device] if chosen.device else []),
        )
        with Server(*arguments) as server:
            firsts = [_first(browser, server) for _ in range(5)]
            orbits = _orbits(browser, server, chosen.orbits)
            edits = {kind: _edits(browser, server, kind, chosen.orbits) for kind in ("material", "light")}
            paths = _traced(browser, server, 8)
            for scheme in ("dark", "light"):
                for name, width, height in (("desktop", 1440, 900), ("phone", 390, 844)):
                    _pictures(browser, server, chosen.output, f"{name}-{scheme}", scheme, (width, height))
            server.end()
    told = {"scene": chosen.scene, "size": chosen.size, "first_ms": firsts, "orbit_ms": orbits}
    told |= {"first_median_ms": statistics.median(firsts), "orbit_median_ms": statistics.median(orbits)}
    told |= {f"{kind}_median_ms": round(statistics.median(times), 1) for kind, times in edits.items() if times}
    told |= {"first_paths_ms": paths[0], "paths_median_ms": statistics.median(paths[1:])}
    print(json.dumps(told))
    return 0


def _documented(spp: int, folder: Path | None) -> None:
    """Write the picture of the documentation, and as PNG into a folder, if one is given."""
    viewport = {"width": 1440, "height": 900}
    with chromium() as browser, Server("product", "--size", "800x600", "--spp", str(spp)) as server:
        with view_of(browser, server, "documentation", viewport=viewport, color_scheme="dark") as view:
            page = view.page
            view.wait("view.hub.newest('hello') !== undefined")
            page.get_by_label("Layer", exact=True).select_option("denoised")
            view.wait_until_done(1800)
            page.get_by_role("tab", name="Light paths").click()
            view.click(*_PIXEL)
            view.wait("document.querySelector('.lp-samples') !== null")
            page.wait_for_timeout(8000)  # until messages are gone
            picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        server.end()
    picture.save(_DOCUMENTATION, quality=80, optimize=True)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        picture.save(folder / "view.png")


def _first(browser: Any, server: Server) -> float:
    """Milliseconds to the first image."""
    with view_of(browser, server, "first") as view:
        view.wait("performance.getEntriesByName('clrender-first-image').length > 0")
        return float(view.run("performance.getEntriesByName('clrender-first-image')[0].startTime"))


def _orbits(browser: Any, server: Server, count: int) -> list[float]:
    """Milliseconds from each of some camera moves to its image."""
    with view_of(browser, server, "orbits") as view:
        view.wait("view.picture.frame() !== undefined && view.hub.newest('state') !== undefined")
        times = view.run(_ORBITS, count)
        view.page.keyboard.press("r")
        return [round(each, 1) for each in times]


def _edits(browser: Any, server: Server, kind: str, count: int) -> list[float]:
    """Milliseconds from each of some edits to the image with it; none where the scene has nothing of the kind."""
    with view_of(browser, server, "edits") as view:
        view.wait("view.picture.frame() !== undefined && view.hub.newest('scene') !== undefined")
        return [float(each) for each in view.run(_EDITS, {"type": kind, "count": count})]


def _traced(browser: Any, server: Server, count: int) -> list[float]:
    """Milliseconds from each of some questions for light paths to its answer; the first with what is compiled."""
    with view_of(browser, server, "paths") as view:
        view.wait("view.picture.frame() !== undefined && view.hub.newest('state') !== undefined")
        return [round(each, 1) for each in view.run(_PATHS, count)]


def _pictures(browser: Any, server: Server, folder: Path, name: str, scheme: str, size: tuple[int, int]) -> None:
    options: dict[str, Any] = {"viewport": {"width": size[0], "height": size[1]}, "color_scheme": scheme}
    with view_of(browser, server, name, **options) as view:
        view.wait("view.picture.frame() !== undefined && view.hub.newest('progress')?.samples > 4", seconds=120)
        page = view.page
        page.screenshot(path=folder / f"{name}.png")
        box = page.locator(".cv-canvas").bounding_box()
        page.mouse.click(box["x"] + box["width"] * 0.45, box["y"] + box["height"] * 0.7)
        view.wait("document.querySelector('.cv-probe').dataset.probe !== undefined")
        page.wait_for_timeout(300)
        page.screenshot(path=folder / f"{name}-picked.png")
        page.keyboard.press("Escape")
        page.keyboard.press("l")
        page.wait_for_timeout(200)
        page.screenshot(path=folder / f"{name}-false.png")
        page.keyboard.press("l")
        page.keyboard.press("?")
        page.screenshot(path=folder / f"{name}-help.png")


if __name__ == "__main__":
    sys.exit(main())
