"""Other renderers, each run by a Python of its own, where it is installed and clrender need not be."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from clrender.errors import RenderError, UsageError

__all__ = ["OWN", "PEERS", "SEGMENTS", "Peer", "Task", "peer_from"]

OWN: Final = "clrender"
SEGMENTS: Final = 14
"""Of a path, from the camera to a light: the depth at which renderers are compared, without roulette."""
_FOLDER: Final = Path(__file__).resolve().parent
PEERS: Final[Mapping[str, tuple[str, ...]]] = {
    "mitsuba": ("peer_mitsuba.py", "llvm_ad_rgb"),
    "mitsuba-scalar": ("peer_mitsuba.py", "scalar_rgb"),
}
"""Name -> script in this folder, and what it is told before the task."""


@dataclass(frozen=True)
class Task:
    """What every renderer is to do: so many pixels and samples, paths of `SEGMENTS`, no roulette, no filter."""

    width: int
    height: int
    spp: int


@dataclass(frozen=True)
class Peer:
    """A renderer to compare with.

    Attributes
    ----------
    name : str
        One of `PEERS`.
    python : str
        The interpreter that has it.
    """

    name: str
    python: str

    def run(self, scene: Path, task: Task) -> dict[str, Any]:
        """Render once, in a process of its own; gives ``wall_seconds``, ``cpu_seconds``, ``version`` and more.

        Parameters
        ----------
        scene : Path
            A file that `write_scene` wrote.
        task : Task

        Raises
        ------
        RenderError
            When the peer cannot be started or fails.
        """
        script, *told = PEERS[self.name]
        numbers = [str(number) for number in (task.width, task.height, task.spp, SEGMENTS)]
        command = [self.python, str(_FOLDER / script), *told, str(scene), *numbers]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        except OSError as error:
            raise RenderError(
                f"{self.name}: {self.python} cannot be started ({error.strerror}); give the Python that has it"
            ) from error
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise RenderError(f"{self.name} failed with exit status {done.returncode}: {last}")
        answer: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
        return answer


def peer_from(text: str) -> Peer:
    """The peer that ``NAME=PYTHON`` means.

    Raises
    ------
    UsageError
        When the name is unknown or no Python is given.
    """
    name, _, python = text.partition("=")
    if name not in PEERS or not python:
        raise UsageError(f"{text!r} is no peer; write NAME=PYTHON with one of {', '.join(PEERS)}")
    return Peer(name, python)
