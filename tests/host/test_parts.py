"""The tests in parts: every test is in one of them."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def collected(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", *arguments]
    where = str(ROOT / "tests" / "host" / "test_scheduling.py")
    return subprocess.run([*command, where], cwd=ROOT, capture_output=True, text=True, check=False)


def names(*arguments: str) -> list[str]:
    return [line for line in collected(*arguments).stdout.splitlines() if "::" in line]


@pytest.mark.long
def test_every_test_is_in_one_part() -> None:
    parts = [names("--part", f"{number}/3") for number in (1, 2, 3)]
    assert all(parts)
    assert sorted(itertools.chain(*parts)) == sorted(names())


@pytest.mark.long
@pytest.mark.parametrize("part", ["0/4", "5/4", "2", "a/b"])
def test_what_is_no_part_is_refused(part: str) -> None:
    done = collected("--part", part)
    assert done.returncode == 4 and "is no part; the second of four is 2/4" in done.stderr
