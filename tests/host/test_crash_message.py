"""A process that dies inside a driver is not silent; one that ends otherwise says nothing of the kind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import clrender

ROOT = str(Path(clrender.__path__[0]).parent)


def ends_by(how: str) -> subprocess.CompletedProcess[str]:
    """A program that ends so in the midst of a render."""
    code = (
        f"import ctypes, os, signal, sys, time; sys.path.insert(0, {ROOT!r})\n"
        "from clrender.cli.interrupt import interruptible\n"
        f"with interruptible() as interrupt:\n    {how}\n"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize("how", ["os.kill(os.getpid(), 9)", "os.abort()", "ctypes.string_at(0)"])
def test_a_crash_is_told_in_one_sentence(how: str) -> None:
    done = ends_by(how)
    assert done.returncode < 0
    (line,) = [line for line in done.stderr.splitlines() if line]
    assert line.startswith("error: the process was terminated by a crash")
    assert "clrender doctor" in line


@pytest.mark.parametrize(
    ("how", "code", "said"),
    [
        ("pass", 0, ""),
        ("sys.exit(3)", 3, ""),
        ("1 / 0", 1, "ZeroDivisionError: division by zero"),
        (
            "os.kill(os.getpid(), signal.SIGINT); time.sleep(30)",
            130,
            "error: interrupted; nothing was written",
        ),
    ],
)
def test_other_ends_speak_for_themselves(how: str, code: int, said: str) -> None:
    done = ends_by(how)
    assert done.returncode == code
    assert done.stderr.strip().rpartition("\n")[2] == said
