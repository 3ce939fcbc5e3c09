"""Has a USD stage read in a separate process, with limits: for a bad file the library may crash or take all memory."""

from __future__ import annotations

import io
import json
import signal
import struct
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.extras import install_command, lacking
from clrender.importers.asset_files import AssetFiles

__all__ = ["Stage", "read_stage"]

_CHILD: Final = Path(__file__).with_name("stage_child.py")
_MEMORY: Final = 16 << 30
"""Limit of the memory of the process, bytes."""
_CPU_SECONDS: Final = 300
_SECONDS: Final = 900.0
"""Limits of its processor time, and of the time on a busy machine."""


class Stage:
    """What was read.

    Attributes
    ----------
    tables : dict
        See `clrender.importers.usd.extraction`.
    """

    def __init__(self, tables: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        self.tables, self._arrays = tables, arrays

    def array(self, number: int | None) -> NDArray[Any] | None:
        """An array of the answer."""
        return None if number is None else self._arrays[str(number)]


def read_stage(path: Path, files: AssetFiles, time_at: float | None, offsets: Sequence[float]) -> Stage:
    """Read a stage at the time of the image, and at some from there.

    Parameters
    ----------
    path : pathlib.Path
    files : AssetFiles
    time_at : float, optional
        Seconds; default: where the animation begins.
    offsets : sequence of float
        Seconds from that time.

    Raises
    ------
    SceneError
        The file cannot be read, or usd-core is not installed.
    """
    if find_spec("pxr") is None:
        problem = f"{files.source}: USD needs usd-core"
        raise lacking("usd", SceneError(f"{problem}; install it with `{install_command('usd')}`"))
    file, _ = files.open_scene(path)
    file.close()
    request = {
        "source": files.source,
        "path": str(path),
        "allowed": [str(each) for each in files.allow_paths],
        "time_at": time_at,
        "offsets": list(offsets),
    }
    try:
        done = subprocess.run(
            [sys.executable, str(_CHILD), str(_MEMORY), str(_CPU_SECONDS)],
            input=json.dumps(request).encode(),
            capture_output=True,
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise _too_much(files, f"longer than {_SECONDS:g} s") from None
    except OSError as error:
        why = f"the process that reads USD cannot be started: {error.strerror}"
        raise SceneError(f"{files.source}: {why}") from None
    answer = done.stdout
    if len(answer) < 8 or done.returncode != 0:
        raise _failed(files, done.returncode, done.stderr)
    (size,) = struct.unpack_from("<Q", answer)
    tables: dict[str, Any] = json.loads(answer[8 : 8 + size])
    if "error" in tables:
        raise SceneError(tables["error"])
    with np.load(io.BytesIO(memoryview(answer)[8 + size :]), allow_pickle=False) as archive:
        return Stage(tables, dict(archive))


def _too_much(files: AssetFiles, what: str) -> SceneError:
    return SceneError(f"{files.source}: to read it takes {what}, which is the limit; export less, or in parts")


def _failed(files: AssetFiles, code: int, said: bytes) -> SceneError:
    if code == -signal.SIGXCPU:
        return _too_much(files, f"more than {_CPU_SECONDS} s of processor time")
    if b"MemoryError" in said or b"bad_alloc" in said:
        return _too_much(files, f"more than {_MEMORY >> 30} GiB of memory")
    how = f"it ended by signal {-code}" if code < 0 else "it failed"
    return SceneError(
        f"{files.source}: the library usd-core cannot read it ({how}); the file is damaged, export it again"
    )
