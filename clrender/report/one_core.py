"""Renders on one core, in a separate process: PoCL reads its number of threads when it starts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import clrender
from clrender.errors import RenderError

__all__ = ["THREADS", "one_core_runs"]

THREADS: Final = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
"""Environment variables for PoCL's number of threads: of older and of newer versions."""

_POLL_SECONDS: Final = 0.1


def one_core_runs(
    scene: str, size: tuple[int, int], device: str | None, wanted: Sequence[dict[str, Any]],
    should_stop: Callable[[], bool] = lambda: False,
) -> list[dict[str, Any]] | None:  # fmt: skip
    """Render with one thread.

    Parameters
    ----------
    scene : str
        Name of a built-in scene.
    size : (int, int)
    device : str or None
    wanted : sequence of dict
        Settings of each render; a warm-up render comes first, so that everything is compiled.
    should_stop : callable
        Called ten times a second.

    Returns
    -------
    list of dict, or None
        The `stats` of each; None if stopped.

    Raises
    ------
    RenderError
        If the process fails.
    """
    task = json.dumps({"scene": scene, "size": size, "device": device, "wanted": list(wanted)})
    home = str(Path(clrender.__file__).resolve().parent.parent)
    path = os.pathsep.join(filter(None, [home, os.environ.get("PYTHONPATH", "")]))
    environment = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": path}
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as error:
        command = [sys.executable, "-m", "clrender.report.child", task]
        with subprocess.Popen(command, stdout=out, stderr=error, env=environment) as process:
            try:
                while process.poll() is None:
                    if should_stop():
                        return None
                    time.sleep(_POLL_SECONDS)
            finally:
                process.kill()
        for file in (out, error):
            file.seek(0)
        if process.returncode != 0:
            lines = error.read().decode(errors="replace").strip().splitlines()
            raise RenderError(f"the render on one core failed: {lines[-1] if lines else process.returncode}")
        return [json.loads(line) for line in out.read().splitlines()]
