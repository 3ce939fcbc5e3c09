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


@pytest.mark.parametrize("how", ["pass", "sys.exit(3)", "1 / 0", "os.kill(os.getpid(), signal.SIGINT); time.sleep(30)"])
def test_other_ends_speak_for_themselves(how: str) -> None:
    done = ends_by(how)
    assert done.returncode in (0, 1, 3, 130)
    assert "terminated" not in done.stderr
