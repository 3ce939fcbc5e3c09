"""The command line as its users have it: in a process of its own, or, where no process matters, within this one."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
import warnings
from pathlib import Path

import clrender
from clrender.cli import main

__all__ = ["call", "run"]


def run(*arguments: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """`clrender ARGUMENTS`, of the tree under test, in `folder`: for what a process brings along."""
    return subprocess.run(
        [sys.executable, "-m", "clrender", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent)},
    )


def call(*arguments: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """The same without a process: no start of an interpreter, no imports, no search for devices.

    Standard streams encode as those of the program, and its warnings are silent. A traceback reaches the test.
    """
    here = Path.cwd()
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", "backslashreplace") for _ in range(2))
    code: object = None
    try:
        os.chdir(folder or here)
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            main(list(arguments))
    except SystemExit as end:
        code = end.code
    finally:
        os.chdir(here)
    assert isinstance(code, int), code
    texts = []
    for stream in (out, err):
        stream.flush()
        stream.seek(0)
        texts.append(stream.read())
    return subprocess.CompletedProcess(arguments, code, *texts)
