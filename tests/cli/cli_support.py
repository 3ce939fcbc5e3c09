"""The command line as its users have it: a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import clrender

__all__ = ["run"]


def run(*arguments: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """`clrender ARGUMENTS`, of the tree under test, in `folder`."""
    return subprocess.run(
        [sys.executable, "-m", "clrender", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)},
    )
