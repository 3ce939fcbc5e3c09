"""`scripts/release`: it finds what keeps a tree from being a release, and this tree is one that could be."""

from __future__ import annotations

import runpy
from collections.abc import Callable, Iterable
from pathlib import Path

from cases import for_each

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = runpy.run_path(str(ROOT / "scripts" / "release.py"))
GOOD = "# Changes\n\n## Unreleased\n\n## 1.2.0 – 2026-02-01\n\nNews.\n\n## 1.1.9 – 2026-01-01\n\nMore.\n"
CITATION = "cff-version: 1.2.0\nversion: 1.2.0\ndate-released: 2026-02-01\n"


def faults(name: str, *arguments: str) -> list[str]:
    check: Callable[..., Iterable[str]] = SCRIPT[f"{name}_faults"]
    return list(check(*arguments))


def test_a_release_has_no_fault() -> None:
    assert faults("changelog", GOOD, "1.2.0") == []
    assert faults("citation", CITATION, GOOD, "1.2.0") == []
    assert faults("table", '{"1.2.0": {"kernel_sha256": "aa"}}', "1.2.0", "aa") == []


@for_each(
    ("change", "said"),
    [
        (("## Unreleased\n", "## Unreleased\n\n- A thing.\n"), "empty section"),
        (("## Unreleased\n\n", ""), "empty section"),
        ((" – 2026-02-01", ""), "must be `## VERSION – YYYY-MM-DD`"),
        (("1.2.0", "1.3.0"), "must be that of 1.2.0"),
        (("1.1.9", "1.2.0"), "must descend"),
        (("1.1.9", "1.10.0"), "must descend"),
    ],
)
def test_a_fault_of_the_changelog_is_told(change: tuple[str, str], said: str) -> None:
    assert any(said in fault for fault in faults("changelog", GOOD.replace(*change), "1.2.0"))


def test_other_faults_are_told() -> None:
    for change in (("1.2.0\ndate", "1.1.9\ndate"), ("02-01", "02-02")):
        assert faults("citation", CITATION.replace(*change), GOOD, "1.2.0")
    assert faults("table", "{}", "1.2.0", "aa")
    assert faults("table", '{"1.2.0": {"kernel_sha256": "bb"}}', "1.2.0", "aa")


def test_a_dry_run_names_every_step() -> None:
    """Without the tree, which is dirty while one works, and the kernels, which change between releases."""
    found = dict(SCRIPT["faults"]())
    assert set(found) == {"tree and tag", "changelog", "citation", "kernels and known images", "generated pages"}
    assert found["generated pages"] == []
