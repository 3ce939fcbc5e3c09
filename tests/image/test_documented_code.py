"""The Python of the documentation runs as it stands there."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
from doc_blocks import blocks
from documented_files import make_files

import clrender

ROOT = Path(__file__).resolve().parents[2]
DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")
SIZE = {"(800, 800)": "(24, 16)", "spp=64": "spp=2"}
"""What is made smaller."""

BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "python.md").read_text(), re.DOTALL)


def run(block: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("CLRENDER_DEVICE", DEVICE)
    for large, small in SIZE.items():
        block = block.replace(large, small)
    names: dict[str, object] = {}
    exec(compile(block, "documentation", "exec"), names)
    return names


PAGES = [
    page
    for page in sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
    if page.name != "film-format.md" and any(each.language == "python" for each in blocks(page))
]
"""Those with Python; the page on films has a test of its own below."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_python_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CLRENDER_DEVICE", DEVICE)
    make_files(tmp_path)
    names: dict[str, object] = {"__name__": "documentation"}
    for block in blocks(page):
        if block.language == "python" and block.not_run is None:
            text = re.sub(r"spp=\d+(, size=\(\d+, \d+\))?", "spp=2, size=(24, 16)", block.text)
            exec(compile(text.replace('device="all"', ""), f"{page.name}:{block.line}", "exec"), names)


def test_the_first_lines_of_python_render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = run(BLOCKS[0], tmp_path, monkeypatch)
    image = names["image"]
    assert isinstance(image, clrender.RenderedImage)
    assert image.linear.shape == (16, 24, 3) and image.linear.dtype == np.float32
    table = (ROOT / "docs" / "reference.md").read_text().split("## Statistics")[1].split("## Python")[0]
    assert {key for key in image.stats if f"`{key}`" not in table} == set()
    assert set(image.stats["devices"][0]) <= set(re.findall(r"`(\w+)`", table))
    assert (tmp_path / "room.png").read_bytes().startswith(b"\x89PNG")


def test_the_files_that_are_said_to_carry_their_settings_do(tmp_path: Path) -> None:
    rows = re.findall(r"^\| (`\..*?) \|.*\| (yes|no) \|$", (ROOT / "docs" / "rendering.md").read_text(), re.MULTILINE)
    said = {ending: answer == "yes" for endings, answer in rows for ending in re.findall(r"`\.(\w+)`", endings)}
    assert set(said) == {"png", "jpg", "exr", "npy", "hdr", "film"}
    image = clrender.render(clrender.load("room"), spp=1, size=(16, 16), device=DEVICE)
    for ending, carries in said.items():
        image.save(tmp_path / f"a.{ending}")
        content = (tmp_path / f"a.{ending}").read_bytes()
        assert (image.stats["image_sha256"].encode() in content) == carries, ending


def test_a_session_renders_two_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (block,) = [each for each in BLOCKS if "first = session.render" in each]
    block = block.replace("spp=16", "spp=1, size=(16, 16)").replace('"all"', repr(DEVICE))
    names = run("import clrender\nscene = clrender.load('room')\n" + block, tmp_path, monkeypatch)
    first, other = names["first"], names["other"]
    assert isinstance(first, clrender.RenderedImage) and isinstance(other, clrender.RenderedImage)
    assert first.stats["image_sha256"] != other.stats["image_sha256"]


def test_the_film_that_is_read_by_hand_is_the_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image = clrender.render(clrender.load("room"), spp=2, size=(24, 16), device=DEVICE)
    image.save(tmp_path / "all.film")
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "film-format.md").read_text(), re.DOTALL)
    names = run(block, tmp_path, monkeypatch)
    np.testing.assert_array_equal(np.asarray(names["mean"], np.float64).astype(np.float32), image.linear)
    header = names["header"]
    assert isinstance(header, dict) and header["format"] == "clrender film 1" and header["width"] == 24
