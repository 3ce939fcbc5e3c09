"""Which versions give the same bits: the known images of docs/cite.md are what the current kernels render."""

from __future__ import annotations

import json
import os
import runpy
from pathlib import Path
from typing import Any

import pytest
from cases import for_each

import clrender

ROOT = Path(__file__).resolve().parents[2]
DEVICE = os.environ.get("CLRENDER_TEST_DEVICE", "pocl")
MAKER = runpy.run_path(str(ROOT / "scripts" / "version_docs.py"))
TABLE: dict[str, Any] = json.loads((ROOT / "docs" / "versions.json").read_text())
CURE = (
    "images of {} are not what its entry in docs/versions.json says: bump the version in clrender/version.py, or, if "
    "it is not released yet, run `python scripts/version_docs.py --record` and tell the change in CHANGELOG.md"
)


def test_the_table_is_that_of_the_page() -> None:
    page = (ROOT / "docs" / "cite.md").read_text()
    assert MAKER["current"](page, TABLE) == page, "run `python scripts/version_docs.py`"


def test_the_versions_are_those_of_the_changelog() -> None:
    dates = MAKER["released"]((ROOT / "CHANGELOG.md").read_text())
    assert dates and {version: entry["date"] for version, entry in TABLE.items()} == dates
    for entry in TABLE.values():
        hashes = [entry["kernel_sha256"], *entry["images"].values()]
        assert len(hashes) > 1 and all(len(each) == 64 and int(each, 16) for each in hashes)
    assert set(TABLE[list(TABLE)[-1]]["images"]) == set(MAKER["IMAGES"])


def test_the_table_counts_images_that_kept_their_bits() -> None:
    def entry(*images: str) -> dict[str, Any]:
        return {"date": "2026-01-01", "kernel_sha256": "0" * 64, "images": dict(zip("abc", images, strict=True))}

    text = MAKER["tables"]({"1.0.0": entry("1", "2", "3"), "1.1.0": entry("1", "5", "3")})
    assert text.index("| 1.1.0 |") < text.index("| 1.0.0 |")
    assert "| 2 of 3 |" in text and "| the first version |" in text


def known(names: tuple[str, ...]) -> None:
    """Check that the running version, if it is in the table, has these images."""
    version = clrender.__version__
    if version not in TABLE:
        pytest.skip(f"{version} is not released")
    recorded = {name: TABLE[version]["images"][name] for name in names}
    assert MAKER["images"](*names, device=DEVICE) == recorded, CURE.format(version)


@pytest.mark.thorough
def test_this_version_has_its_bits() -> None:
    known(("room", "surfaces"))


@pytest.mark.long
@for_each("name", MAKER["IMAGES"])
def test_this_version_has_all_of_its_bits(name: str) -> None:
    known((name,))
