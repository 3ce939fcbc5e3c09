"""The documentation site: it is built without a warning, its links lead somewhere, and it needs no network."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from cases import for_each
from site_links import faults

ROOT = Path(__file__).resolve().parents[2]


def page(folder: Path, name: str, body: str) -> None:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(f"<html><body>{body}</body></html>")


def test_a_sound_site_has_no_fault(tmp_path: Path) -> None:
    page(
        tmp_path, "index.html", '<h1 id="top"></h1><a href="docs/a.html#part">a</a><a href="https://example.org">b</a>'
    )
    page(tmp_path, "docs/a.html", '<p id="part"><a href="../#top">up</a><img src="p.png"><a href="#part">here</a>')
    (tmp_path / "docs" / "p.png").write_bytes(b"")
    assert faults(tmp_path) == []


@for_each(
    ("body", "said"),
    [
        ('<a href="b.html">b</a>', "no such file"),
        ('<a href="#b">b</a>', "no such anchor"),
        ('<a href="index.html#b">b</a>', "no such anchor"),
        ('<img src="b.png">', "no such file"),
        ('<script src="https://example.org/x.js"></script>', "another host"),
        ('<link rel="stylesheet" href="//example.org/x.css">', "another host"),
    ],
)
def test_a_dead_link_is_found(tmp_path: Path, body: str, said: str) -> None:
    page(tmp_path, "index.html", body)
    (fault,) = faults(tmp_path)
    assert said in fault and fault.startswith("index.html: ")


@pytest.mark.long
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-c", "docs"]
    done = subprocess.run(
        [*command, "-d", str(tmp_path / "doctrees"), ".", str(tmp_path / "site")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert faults(tmp_path / "site") == []
    assert (tmp_path / "site" / "index.html").is_file() and (tmp_path / "site" / "docs" / "index.html").is_file()
