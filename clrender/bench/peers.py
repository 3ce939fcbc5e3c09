"""Other renderers, each run by its own Python interpreter, which need not have clrender."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from clrender.errors import RenderError, UsageError

__all__ = ["OWN", "PEERS", "SEGMENTS", "Peer", "Task", "peer_from"]

OWN: Final = "clrender"
SEGMENTS: Final = 14
"""Segments of a path from the camera to a light: the depth limit of the comparison, without roulette."""
OWN_SCENE: Final = "scene.json"
"""Name of the file that `write_scene` writes."""
_FOLDER: Final = Path(__file__).resolve().parent


@dataclass(frozen=True)
class _Kind:
    """A peer's script in this folder, its variant, and its limitations."""

    script: str
    variant: str
    writer: str = ""
    """The function of `clrender.exporters` that writes the scene for it; empty: it takes clrender's own."""
    ending: str = ""
    """Of that scene file."""
    spheres: bool = True
    """Whether it has analytic spheres."""
    no_opencl: bool = False
    """Whether it fails in the presence of OpenCL drivers."""


_MITSUBA: Final = ("write_mitsuba", ".xml")
_CYCLES: Final = ("write_cycles", ".py")
_LUXCORE: Final = ("write_luxcore", ".scn")
PEERS: Final[Mapping[str, _Kind]] = {
    "mitsuba": _Kind("peer_mitsuba.py", "llvm_ad_rgb", *_MITSUBA),
    "mitsuba-path": _Kind("peer_mitsuba.py", "llvm_ad_rgb:path", *_MITSUBA),
    "mitsuba-scalar": _Kind("peer_mitsuba.py", "scalar_rgb", *_MITSUBA),
    "mitsuba-cuda": _Kind("peer_mitsuba.py", "cuda_ad_rgb", *_MITSUBA),
    "luxcore": _Kind("peer_luxcore.py", "PATHCPU", *_LUXCORE, spheres=False, no_opencl=True),
    "luxcore-bidir": _Kind("peer_luxcore.py", "BIDIRCPU", *_LUXCORE, spheres=False, no_opencl=True),
    "luxcore-bidirvm": _Kind("peer_luxcore.py", "BIDIRVMCPU", *_LUXCORE, spheres=False, no_opencl=True),
    "cycles": _Kind("peer_cycles.py", "plain", *_CYCLES, spheres=False),
    "cycles-tree": _Kind("peer_cycles.py", "tree", *_CYCLES, spheres=False),
    "cycles-guided": _Kind("peer_cycles.py", "guided", *_CYCLES, spheres=False),
    "embree": _Kind("peer_embree.py", "rays", spheres=False),
}
"""Other renderers by name; ``embree`` only traces rays.

For scenes with opacity masks, ``mitsuba`` is its `volpath`, whose shadow rays pass holes like clrender's. The shadow
rays of its `path`, ``mitsuba-path``, do not, so that only BSDF sampling finds light through holes: faster, but noisier.
"""


@dataclass(frozen=True)
class Task:
    """The common render task, with a box filter, and paths of `SEGMENTS` without roulette or as the scene says."""

    width: int
    height: int
    spp: int
    errors: bool = False
    """Whether images are compared with a reference by clrender with 64 times the samples."""
    light_sampler: str = "auto"
    """Light sampler of clrender; Mitsuba picks lights uniformly."""
    seed: int = 0
    """Random seed, different in each turn."""
    own_paths: bool = False
    """Whether paths are as long as the scene says, and end by its roulette."""


@dataclass(frozen=True)
class Peer:
    """A renderer to compare with.

    Attributes
    ----------
    name : str
        One of `PEERS`.
    python : str
        The interpreter that has it installed.
    """

    name: str
    python: str

    @property
    def spheres(self) -> bool:
        """Whether it has analytic spheres; else its scene has triangle meshes for them."""
        return PEERS[self.name].spheres

    def run(self, scene: Path, task: Task, image: Path, folder: Path | None = None) -> dict[str, Any]:
        """Render once, in a separate process; returns ``wall_seconds``, ``cpu_seconds``, ``version`` and more.

        Parameters
        ----------
        scene : Path
            A file that `write_scene` wrote, or another that clrender reads.
        task : Task
        image : Path
            Output path of the (height, width, 3) float32 NumPy array of the image, if the peer makes one.
        folder : Path, optional
            Where the scene is written for the peer; default: beside `scene`.

        Raises
        ------
        RenderError
            If the peer cannot be started or fails.
        """
        kind = PEERS[self.name]
        if not kind.writer and scene.name != OWN_SCENE:
            raise UsageError(f"{self.name} reads only the scenes of this benchmark, not {scene}; leave it out")
        scene = _written(scene, task, kind, folder or scene.parent) if kind.writer else scene
        numbers = [str(number) for number in (task.width, task.height, task.spp, SEGMENTS, task.seed)]
        command = [self.python, str(_FOLDER / kind.script), kind.variant, str(scene), *numbers, str(image)]
        environment = {**os.environ, "OCL_ICD_VENDORS": str(image.parent)} if kind.no_opencl else None
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        except OSError as error:
            raise RenderError(
                f"{self.name}: {self.python} cannot be started ({error.strerror}); give the Python that has it"
            ) from error
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise RenderError(f"{self.name} failed with exit status {done.returncode}: {last}")
        lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
        if not lines:
            raise RenderError(
                f"{self.name} printed no result; the peer's script and this clrender may be of different versions"
            )
        answer: dict[str, Any] = json.loads(lines[-1])
        return answer


def _written(path: Path, task: Task, kind: _Kind, folder: Path) -> Path:
    """Write a scene for a peer, with the settings of the task and its flat shapes as meshes."""
    from clrender import exporters
    from clrender.importers import load

    settings: dict[str, Any] = {"filter": "box", "spp": task.spp}
    settings |= {} if task.own_paths else {"max_depth": SEGMENTS - 1, "roulette": "none"}
    changes = {"image.width": task.width, "image.height": task.height}
    scene = load(path).changed({**changes, **{f"render.{name}": setting for name, setting in settings.items()}})
    output = folder / path.with_suffix(kind.ending).name
    getattr(exporters, kind.writer)(scene, output, merge=True)
    return output


def peer_from(text: str) -> Peer:
    """The peer that ``NAME=PYTHON`` means.

    Raises
    ------
    UsageError
        If the name is unknown or no Python is given.
    """
    name, _, python = text.partition("=")
    if name not in PEERS or not python:
        raise UsageError(f"{text!r} is not a peer; write NAME=PYTHON with one of {', '.join(PEERS)}")
    return Peer(name, python)
