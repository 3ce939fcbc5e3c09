"""`clrender report` as a user runs it: a page that needs nothing else, with every row and every figure."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import clrender

COMMAND = [sys.executable, "-m", "clrender", "report"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)}
DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, env=ENVIRONMENT, timeout=300, check=False
    )


class PageReader(HTMLParser):
    """Gathers rows, figures, and whatever points out of the page; and sees that every tag is closed."""

    EMPTY = ("meta", "img", "link", "br")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.figures: list[str] = []
        self.outside: list[str] = []
        self.pictures = self.drawings = self.rows = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.EMPTY:
            self.open.append(tag)
        values = dict(attrs)
        self.outside += [
            value or ""
            for name, value in attrs
            if name in ("src", "href", "xlink:href", "data", "action", "srcset")
            and not (value or "").startswith(("data:image/jpeg;base64,", "#"))
        ]
        self.outside += [tag] if tag in ("script", "link", "iframe", "object") else []
        self.pictures += tag == "img"
        self.drawings += tag == "svg"
        self.rows += tag == "tr"
        if tag == "figure" and "id" in values:
            self.figures.append(values["id"] or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.long
def test_the_page_is_whole_and_needs_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "made"
    result = run("-o", str(folder), "--quick", "--size", "16x16", "-d", DEVICE)
    assert result.returncode == 0, result.stderr
    html = (folder / "report.html").read_text()
    page = PageReader()
    page.feed(html)
    page.close()
    assert not page.open and not page.outside
    # The namespaces of drawings are names, not addresses.
    assert not re.search(r"https?://", re.sub(r'xmlns(:xlink)?="[^"]*"', "", html))
    assert not re.search(r"url\((?!#)|@import|file:|/tmp|/home", html)
    numbers = json.loads((folder / "report.json").read_text())
    one_core = not numbers["no_one_core"]
    assert one_core == ("one-core" in numbers["rows"])
    settings = len(numbers["rows"]) - (3 if one_core else 0)
    assert page.rows == (1 + len(numbers["verdicts"])) + (1 + 11) + (1 + settings)
    assert page.figures == [
        "figure-1", "figure-2-5", "figure-3", "figure-4", "figure-6", "figure-7", "figure-8", "figure-9", "roulettes",
        "whitted",
    ]  # fmt: skip
    assert page.pictures == 3 + 2 + 2 + 3 * 6 + 4 + 2 and page.drawings == 3 + 2
    _check_markdown(folder)
    if one_core:
        twins = {run["seed"]: run["sha256"] for run in numbers["rows"]["base"]["runs"]}
        assert all(twins[run["seed"]] == run["sha256"] for run in numbers["rows"]["one-core"]["runs"])
        assert all(run["cpu_seconds"] < 1.2 * run["seconds"] + 0.05 for run in numbers["rows"]["one-core"]["runs"])


def _check_markdown(folder: Path) -> None:
    """Its pictures are beside it, all of them are used, and none is large."""
    markdown = (folder / "report.md").read_text()
    named = set(re.findall(r"\]\(([^)]*)\)", markdown))
    there = {path.name for path in folder.iterdir()} - {"report.html", "report.md", "report.json"}
    assert named == there
    assert all((folder / name).stat().st_size <= 60_000 for name in named)


def test_ctrl_c_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "made"
    with subprocess.Popen(
        [*COMMAND, "-o", str(folder), "--size", "64x64", "-d", DEVICE],
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    ) as child:
        assert child.stderr is not None
        while "finding" not in child.stderr.readline():
            pass
        child.send_signal(signal.SIGINT)
        _, error = child.communicate(timeout=60)
        assert child.returncode == 130
    assert "Traceback" not in error and "interrupted" in error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("place", "words"), [("full", "not empty"), ("file", "is a file"), ("none/deep", "there is no folder")]
)
def test_a_place_that_will_not_do_is_refused_at_once(tmp_path: Path, place: str, words: str) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a.txt").write_text("mine")
    (tmp_path / "file").write_text("mine")
    result = run("-o", str(tmp_path / place))
    assert result.returncode == 2 and words in result.stderr and result.stderr.count("\n") == 1
    assert (tmp_path / "full" / "a.txt").read_text() == "mine"
