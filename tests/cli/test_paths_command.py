"""`clrender paths` as a user meets it: its files, its page in a browser, bad input and exit codes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from cases import for_each
from cli_support import call
from paths_support import bits
from view_browser import SCENE

import clrender

if TYPE_CHECKING:
    from clrender.device import Device


@pytest.fixture(scope="module")
def made(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene, and the page and the numbers of one of its pixels."""
    folder = tmp_path_factory.mktemp("paths")
    (folder / "ball.toml").write_text(SCENE.replace("A ball on a table", "A </script> <b>ball</b>"))
    line = ("paths", "ball.toml", "--pixel", "80,60", "--spp", "16", "--quiet", "-d", str(device.info.index))
    result = call(*line, "-o", "paths.html", "-o", "paths.json", "--exposure", "1", folder=folder)
    assert (result.returncode, result.stderr) == (0, "")
    found = re.fullmatch(
        r"paths\.html paths\.json: pixel 80,60, radiance (\S+) (\S+) (\S+), 16 of 16 samples, sample (\d+) contributes "
        r"most: (\d+\.\d)% of the pixel, (\d+) vertices\n",
        result.stdout,
    )
    assert found, result.stdout
    return folder


def numbers_of(folder: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads((folder / "paths.json").read_text())
    return read


@pytest.mark.thorough
def test_numbers_are_those_of_a_render(made: Path, device: Device) -> None:
    read = numbers_of(made)
    image = clrender.render(clrender.load(made / "ball.toml"), spp=16, device=device.info.index)
    assert bits(read["radiance"]) == bits(image.linear[60, 80])
    assert read["scene_sha256"] == image.stats["scene_sha256"] and read["kernel_sha256"] == image.stats["kernel_sha256"]


@pytest.mark.thorough
def test_maps_in_the_place_of_a_pixel(made: Path, device: Device) -> None:
    line = ("paths", "ball.toml", "--maps", "--bounces", "1", "--size", "20x16", "--spp", "32", "--quiet")
    result = call(*line, "-d", str(device.info.index), "-o", "m.html", "-o", "m.json", folder=made)
    assert (result.returncode, result.stderr) == (0, "")
    read = json.loads((made / "m.json").read_text())
    assert result.stdout.startswith("m.html m.json: ") and read["image_sha256"] in result.stdout
    assert len(read["bounces"]) == 3 and "What each bounce adds" in (made / "m.html").read_text()


@pytest.fixture(scope="module")
def bidirectional(device: Device, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder with the page and the numbers of a pixel of `bdpt`, and what the command said."""
    folder = tmp_path_factory.mktemp("bdpt")
    line = ("paths", "room", "--size", "50x38", "--pixel", "25,19", "--spp", "8", "--integrator", "bdpt", "--quiet")
    result = call(*line, "-d", str(device.info.index), "-o", "paths.html", "-o", "paths.json", folder=folder)
    assert (result.returncode, result.stderr) == (0, "")
    return folder, result.stdout


@pytest.mark.thorough
def test_bidirectional_paths_say_what_is_splatted(bidirectional: tuple[Path, str]) -> None:
    folder, said = bidirectional
    read = numbers_of(folder)
    assert read["integrator"] == "bdpt" and set(read["splats"]) == {"values", "splatted", "camera", "count", "paths"}
    assert len(read["splats"]["values"]) == 8 and read["splats"]["splatted"][0] > 0.0
    words = " ".join(f"{each:.6g}" for each in read["splats"]["splatted"])
    most = read["splats"]["paths"][0]
    brought = f"light path {most['path']} of sample {most['sample']} splats most: {most['share']:.1%} of the pixel"
    assert said.endswith(f", {words} of it splatted by paths from lights, {brought}\n")
    assert read["splats"]["count"] == len(read["splats"]["paths"])
    for each in read["splats"]["paths"]:
        assert len(each["light_path"]["vertices"]) == each["light_vertices"] - 1 and each["light_path"]["object"]
    every = [each for sample in read["samples"] for vertex in sample["vertices"] for each in vertex["additions"]]
    joined = [each["light_path"] for each in every if each["light_path"] is not None]
    assert joined and all(each["vertices"][-1]["event"] == "connection" for each in joined)
    assert {each["light_weight"] for each in every} == {None} and all(0.0 <= each["weight"] <= 1.0 for each in every)
    for sample in read["samples"]:
        assert sample["splat"] == read["splats"]["values"][sample["index"]]


@pytest.mark.long
def test_the_page_shows_light_paths(browser: Any, bidirectional: tuple[Path, str]) -> None:
    errors: list[str] = []
    folder, _ = bidirectional
    page, read = opened(browser, folder, errors), numbers_of(folder)
    assert "of it splatted by paths from lights" in page.locator("header p").inner_text()
    assert "Splatted" in page.locator(".lp-samples:not(.lp-splats) thead").inner_text()
    assert "path from a light" in page.locator(".lp-key").inner_text()
    number = next(
        place
        for place, sample in enumerate(read["samples"])
        if any(each["light_path"] for vertex in sample["vertices"] for each in vertex["additions"])
    )
    page.locator(".lp-samples:not(.lp-splats) tbody tr").nth(number).click()
    lights = [each["light_path"] for vertex in read["samples"][number]["vertices"] for each in vertex["additions"]]
    wanted = sum(1 + len(each["vertices"]) for each in lights if each)
    assert page.locator("tr.lp-light").count() == wanted
    told = page.locator(".lp-vertices").inner_text()
    assert f"light path {next(each['number'] for each in lights if each)}" in told and "[object" not in told
    assert not errors


@pytest.mark.long
def test_a_built_in_scene_has_its_name(tmp_path: Path, device: Device) -> None:
    line = ("paths", "cornell", "--pixel", "3,3", "--size", "8x8", "--spp", "1", "--quiet", "-o", "a.json")
    assert call(*line, "-d", str(device.info.index), folder=tmp_path).returncode == 0
    assert json.loads((tmp_path / "a.json").read_text())["scene"] == "cornell"


@for_each(
    ("line", "words"),
    [
        (("-o", "a.html"), "give either --pixel X,Y"),
        (("--maps", "--pixel", "1,1", "-o", "a.html"), "give either --pixel X,Y"),
        (("--maps", "-o", "a.png"), "maps are written to a .html, .json or .exr file"),
        (("--pixel", "1,1", "-o", "a.exr"), "light paths are written to a .json or an .html file"),
    ],
)
def test_a_pixel_or_maps(made: Path, line: tuple[str, ...], words: str) -> None:
    result = call("paths", "ball.toml", *line, folder=made)
    assert result.returncode == 2 and words in result.stderr and len(result.stderr.splitlines()) == 1


@pytest.mark.thorough
def test_the_page_is_one_file(made: Path) -> None:
    page = (made / "paths.html").read_text()
    assert "default-src 'none'" in page and page.count("</script>") == 3
    outside = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"(src|href)=|@import|url\((?!data:)", outside)
    assert "http://" not in page.replace("http://www.w3.org/2000/svg", "") and "https://" not in page
    inside = re.search(r'id="paths">(.*?)</script>', page, re.DOTALL)
    assert inside and json.loads(inside[1]) == numbers_of(made)


def opened(browser: Any, made: Path, errors: list[str], **options: Any) -> Any:
    """The page in a browser; what it asks for elsewhere, and what goes wrong, is appended to `errors`."""
    # Playwright waits by `eval`, which the page forbids
    page = browser.new_context(viewport={"width": 1280, "height": 900}, bypass_csp=True, **options).new_page()
    page.on("console", lambda said: errors.append(said.text) if said.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda each: None if each.url.startswith(("data:", "file:")) else errors.append(each.url))
    page.goto((made / "paths.html").as_uri())
    page.wait_for_selector(".lp-samples tbody tr")
    return page


@pytest.mark.long
def test_the_page_shows_samples_and_vertices(browser: Any, made: Path) -> None:
    errors: list[str] = []
    page, read = opened(browser, made, errors), numbers_of(made)
    rows = page.locator(".lp-samples tbody tr")
    assert rows.count() == 16
    shown = [int(each.get_attribute("data-sample")) for each in rows.all()]
    assert shown == [sample["index"] for sample in read["samples"]]
    details = page.locator("section[aria-live=polite]")
    assert details.locator("h2").inner_text() == f"Sample {shown[0]}"
    bodies = details.locator("tbody tr")
    wanted = [1 + len(vertex["additions"]) for vertex in read["samples"][0]["vertices"]]
    assert bodies.count() == sum(wanted)

    # Another sample by a click, and the next by a key
    rows.nth(3).click()
    assert details.locator("h2").inner_text() == f"Sample {shown[3]}"
    page.keyboard.press("ArrowDown")
    assert details.locator("h2").inner_text() == f"Sample {shown[4]}"
    assert page.evaluate("document.activeElement.dataset.sample") == str(shown[4])

    # Sorted by number, and back to front
    page.get_by_role("button", name="Sample", exact=True).click()
    numbers = [int(each.get_attribute("data-sample")) for each in page.locator(".lp-samples tbody tr").all()]
    assert numbers == sorted(shown)
    page.get_by_role("button", name="Sample", exact=True).click()
    numbers = [int(each.get_attribute("data-sample")) for each in page.locator(".lp-samples tbody tr").all()]
    assert numbers == sorted(shown, reverse=True)
    assert not errors


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_sketch_turns_by_mouse_and_keys(browser: Any, made: Path, scheme: str) -> None:
    errors: list[str] = []
    page = opened(browser, made, errors, color_scheme=scheme)
    picture = "document.querySelector('.lp-stage canvas').toDataURL()"
    page.wait_for_function(f"{picture}.length > 3000")

    def changes(act: Any) -> None:
        before = page.evaluate(picture)
        act()
        page.wait_for_function(f"(before) => {picture} !== before", arg=before)

    page.wait_for_timeout(200)
    first = page.evaluate(picture)
    page.locator(".lp-stage").focus()
    for key in ("ArrowLeft", "Shift+ArrowUp", "+", "-"):
        changes(lambda key=key: page.keyboard.press(key))
    changes(lambda: page.keyboard.press("0"))
    page.wait_for_function(f"(first) => {picture} === first", arg=first)
    box = page.locator(".lp-stage").bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 100)

    def drag() -> None:
        page.mouse.down()
        page.mouse.move(box["x"] + 160, box["y"] + 120)
        page.mouse.up()

    changes(drag)
    changes(lambda: page.mouse.wheel(0, 200))
    ground = page.evaluate("getComputedStyle(document.querySelector('.lp-part')).backgroundColor")
    assert ground == {"light": "rgb(247, 247, 247)", "dark": "rgb(32, 32, 32)"}[scheme]
    # Every control has a name, and pictures say what they show
    assert page.locator("img:not([alt]), input:not([aria-label])").count() == 0
    assert not errors


@pytest.mark.long
def test_an_interruption_leaves_no_file(device: Device, tmp_path: Path) -> None:
    line = ("paths", "room", "--pixel", "80,60", "--size", "160x120", "--spp", "1000000", "-o", "paths.json")
    started = subprocess.Popen(
        [sys.executable, "-m", "clrender", *line, "-d", str(device.info.index)],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)},
    )
    time.sleep(4.0)
    started.send_signal(signal.SIGINT)
    _, said = started.communicate(timeout=60)
    assert started.returncode == 130 and said.splitlines()[-1].startswith("error: interrupted")
    assert not list(tmp_path.iterdir())


BAD: dict[str, tuple[str, tuple[str, ...]]] = {
    "no pixel": ("paths room -o a.json", ("--pixel X,Y", "--maps")),
    "no output": ("paths room --pixel 1,2", ("'--output'", "missing")),
    "a pixel in words": ("paths room --pixel middle -o a.json", ("'middle'", "400,300")),
    "one number": ("paths room --pixel 7 -o a.json", ("'7'", "400,300")),
    "a negative pixel": ("paths room --pixel=-1,2 -o a.json", ("'-1,2'", "400,300")),
    "a pixel outside": ("paths room --pixel 800,2 -o a.json", ("800,2", "not within the image of 800 x 800")),
    "outside of a size": ("paths room --size 9x8 --pixel 8,8 -o a.json", ("8,8", "not within the image of 9 x 8")),
    "a very large pixel": (f"paths room --pixel {'9' * 5000},1 -o a.json", ("not within any image",)),
    "another ending": ("paths room --pixel 1,2 -o a.png", ("a.png", ".json or an .html")),
    "no ending": ("paths room --pixel 1,2 -o a", ("a:", ".json or an .html")),
    "no folder": ("paths room --pixel 1,2 -o no/a.json", ("no/a.json",)),
    "the same twice": ("paths room --pixel 1,2 -o a.json -o ./a.json", ("named twice",)),
    "an unknown integrator": ("paths room --pixel 1,2 --integrator pat -o a.json", ("'pat'", "path")),
    "photon": (
        "paths room --pixel 1,2 --integrator photon -o a.json",
        ("integrator photon gathers photons", "path, direct, whitted, bdpt"),
    ),
    "reuse": ("paths room --pixel 1,2 --integrator reuse -o a.json", ("integrator reuse shares paths",)),
    "radiosity": ("paths cornell --pixel 1,2 --integrator radiosity -o a.json", ("integrator radiosity",)),
    "no samples": ("paths room --pixel 1,2 --samples 0 -o a.json", ("--samples", "at least 1")),
    "a crop": ("paths room --pixel 1,2 --crop 0,0,4x4 -o a.json", ("--crop",)),
    "no scene": ("paths nothing --pixel 1,2 -o a.json", ('"nothing"',)),
}


@for_each("case", BAD)
def test_bad_input_is_one_sentence(case: str, tmp_path: Path) -> None:
    line, words = BAD[case]
    result = call(*line.split(), folder=tmp_path)
    assert result.returncode == 2 and result.stdout == ""
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
    for word in words:
        assert word in result.stderr, result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "way",
    [
        ("paths", "--pixel", "1,1", "-o", "p.html"),
        pytest.param(("paths", "--maps", "--spp", "32", "-o", "p.json"), marks=pytest.mark.long),
        pytest.param(("render", "--light-groups", "-o", "p.exr"), marks=pytest.mark.long),
    ],
    ids=lambda way: way[1],
)
def test_warnings_come_once(tmp_path: Path, way: tuple[str, ...]) -> None:
    """Also where an image is rendered several times."""
    ball = {"type": "sphere", "radius": 0.4, "emission": 0.0, "light_group": "a"}
    content = {"camera": {"position": [0, 0, 3], "target": [0, 0, 0]}, "shapes": [ball]}
    (tmp_path / "s.json").write_text(json.dumps(content))
    command, *more = way
    result = call(command, "s.json", "--size", "4x4", "--spp", "2", *more, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stderr.count("its image is black") == 1
