"""Interleaved runs, so that other load on the machine affects all alike, and their medians."""

from __future__ import annotations

import dataclasses
import functools
import os
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

import clrender
from clrender.bench.peers import OWN, SEGMENTS, Task
from clrender.bench.scenes import SCENES, scene_file, write_scene
from clrender.image.compare import relative_squared_error

if TYPE_CHECKING:
    from clrender.bench.peers import Peer

__all__ = ["Run", "measure", "relative_error", "summary"]

_REFERENCE_SEED: Final = 2**31
_REFERENCE_TIMES: Final = 64


@dataclass(frozen=True)
class Run:
    """One render by one renderer.

    Attributes
    ----------
    scene, renderer : str
    repeat : int
        Which turn, from 0.
    wall_seconds, cpu_seconds : float
        Times of the render, over all threads, without start, reading the scene and compiling. clrender's include
        building its BVH and uploading the scene, peers' do not.
    paths : int
    details : dict
        Reported by the renderer: version, set-up, BVH and compile seconds, rays, memory; and ``rel_mse`` if there is
        a reference.
    """

    scene: str
    renderer: str
    repeat: int
    wall_seconds: float
    cpu_seconds: float
    paths: int
    details: dict[str, Any]

    @property
    def rate(self) -> float:
        """Million paths per second of CPU time, times the number of processors: the rate of an idle machine."""
        return self.paths * _processors() / self.cpu_seconds / 1e6

    @property
    def ray_rate(self) -> float | None:
        """Million rays per second, likewise; None if they are not counted."""
        rays = self.details.get("rays")
        return None if rays is None else rays * _processors() / self.cpu_seconds / 1e6

    @property
    def efficiency(self) -> float | None:
        """1 / (relMSE × seconds), likewise; None without a reference."""
        error = self.details.get("rel_mse")
        return None if error is None else _processors() / (error * self.cpu_seconds)

    def line(self) -> dict[str, Any]:
        """The run as a line of JSON."""
        efficiency = self.efficiency
        return {
            "scene": self.scene,
            "renderer": self.renderer,
            "repeat": self.repeat,
            "wall_seconds": round(self.wall_seconds, 4),
            "cpu_seconds": round(self.cpu_seconds, 4),
            "paths": self.paths,
            "mpaths_per_second": round(self.rate, 4),
            "mpaths_per_second_wall": round(self.paths / self.wall_seconds / 1e6, 4),
            "processors": _processors(),
            **({} if efficiency is None else {"efficiency": round(efficiency, 4)}),
            **self.details,
        }


def relative_error(image: npt.NDArray[Any], reference: npt.NDArray[Any]) -> float:
    """relMSE.

    Parameters
    ----------
    image, reference : (H, W, 3) float
    """
    x, r = image.astype(np.float64), reference.astype(np.float64)
    return relative_squared_error(x - r, r)


def measure(
    names: Sequence[str],
    peers: Sequence[Peer],
    task: Task,
    repeats: int,
    device: str | None = None,
    done: Callable[[Run], None] = lambda run: None,
) -> list[Run]:
    """Render every scene with clrender and every peer, in turns.

    Parameters
    ----------
    names : sequence of str
        Keys of `SCENES`, or scene files of any format that clrender reads.
    peers : sequence of Peer
    task : Task
        Size and samples, and whether to measure errors.
    repeats : int
        Number of turns; a warm-up turn comes first, so that everything is compiled and cached.
    device : str, optional
        Device of clrender.
    done : callable, optional
        Called with every counted run as soon as it has ended.

    Raises
    ------
    ClrenderError
        If a scene cannot be rendered or a peer fails.
    """
    runs = []
    for name in names:
        with tempfile.TemporaryDirectory(prefix="clrender-bench-") as folder:
            for run in _measure_scene(Path(folder), name, peers, task, repeats, device):
                runs.append(run)
                done(run)
    return runs


def _measure_scene(
    folder: Path, name: str, peers: Sequence[Peer], task: Task, repeats: int, device: str | None
) -> Iterator[Run]:
    """The runs of one scene, without the warm-up."""
    paths, references = {}, {}
    own_file = None if name in SCENES else scene_file(name)
    for spheres in {True, *(peer.spheres for peer in peers)}:
        place = folder / ("spheres" if spheres else "triangles")
        place.mkdir()
        paths[spheres] = own_file or write_scene(name, place, triangles=not spheres)
        if task.errors:
            times = task.spp * _REFERENCE_TIMES
            better = dataclasses.replace(task, spp=times, light_sampler="auto", seed=_REFERENCE_SEED)
            _own(paths[spheres], better, device, folder / "own.npy")
            references[spheres] = np.load(folder / "own.npy")
    for repeat in range(-1, repeats):
        turn = dataclasses.replace(task, seed=repeat + 1)
        for peer in (None, *peers):
            image = folder / "image.npy"
            image.unlink(missing_ok=True)
            spheres = peer is None or peer.spheres
            path = paths[spheres]
            details = _own(path, turn, device, image) if peer is None else peer.run(path, turn, image, folder)
            if task.errors and image.exists():
                details["rel_mse"] = round(relative_error(np.load(image), references[spheres]), 7)
            wall, cpu = details.pop("wall_seconds"), details.pop("cpu_seconds")
            count = details.pop("paths", task.width * task.height * task.spp)
            if repeat >= 0:
                yield Run(name, OWN if peer is None else peer.name, repeat, wall, cpu, count, details)


def summary(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Median and range of each renderer on each scene, and the median ratio, turn by turn, of clrender to each peer.

    Parameters
    ----------
    runs : sequence of Run

    Returns
    -------
    list of dict
        ``scene, renderer, runs, mpaths_per_second, lowest, highest``; for peers ``ratio``; with a reference also
        ``rel_mse``, ``efficiency``, and for peers ``efficiency_ratio``. Pure ray tracers have ``mrays_per_second``
        instead of paths, and their ``ratio`` is of rays.
    """
    rows = []
    for scene, renderer in dict.fromkeys((run.scene, run.renderer) for run in runs):
        these = {run.repeat: run for run in runs if (run.scene, run.renderer) == (scene, renderer)}
        own = {run.repeat: run for run in runs if (run.scene, run.renderer) == (scene, OWN)}
        hits_only = renderer == "embree"
        rates = [_known(run.ray_rate) if hits_only else run.rate for run in these.values()]
        row = {
            "scene": scene,
            "renderer": renderer,
            "runs": len(rates),
            "mrays_per_second" if hits_only else "mpaths_per_second": round(statistics.median(rates), 4),
            "lowest": round(min(rates), 4),
            "highest": round(max(rates), 4),
        }
        judged = all(run.efficiency is not None for run in these.values())
        if judged:
            row["rel_mse"] = round(statistics.median(run.details["rel_mse"] for run in these.values()), 6)
            row["efficiency"] = round(statistics.median(_known(run.efficiency) for run in these.values()), 3)
        both = [(own[turn], these[turn]) for turn in these.keys() & own.keys()]
        if renderer != OWN and both:
            ratios = [_known(a.ray_rate) / _known(b.ray_rate) if hits_only else a.rate / b.rate for a, b in both]
            row["ratio"] = round(statistics.median(ratios), 3)
            if judged:
                better = [_known(a.efficiency) / _known(b.efficiency) for a, b in both]
                row["efficiency_ratio"] = round(statistics.median(better), 3)
        rows.append(row)
    return rows


def _known(value: float | None) -> float:
    assert value is not None
    return value


def _own(path: Path, task: Task, device: str | None, image_path: Path) -> dict[str, Any]:
    scene = clrender.load(str(path))
    begin, cpu = time.perf_counter(), time.process_time()
    image = clrender.render(
        scene,
        device=device,
        size=(task.width, task.height),
        spp=task.spp,
        seed=task.seed,
        roulette="none",
        max_depth=SEGMENTS - 1,
        light_sampler=task.light_sampler,
        code="fast",
    )
    wall, used = time.perf_counter() - begin, time.process_time() - cpu
    np.save(image_path, image.linear)
    stats = image.stats
    return {
        "wall_seconds": wall,
        "cpu_seconds": used,
        "version": stats["version"],
        "light_sampler": task.light_sampler,
        "commit": _commit(),
        "driver": stats["devices"][0]["driver"],
        "device": stats["devices"][0]["name"],
        **{name: round(stats[name], 4) for name in ("build_seconds", "compile_seconds", "render_seconds")},
        **{name: stats[name] for name in ("rays", "device_bytes", "peak_rss_bytes", "image_sha256")},
        "mean": [round(float(x), 6) for x in image.linear.mean((0, 1))],
    }


@functools.cache
def _commit() -> str | None:
    """The current commit, with a plus sign if files differ from it; None outside a checkout."""
    root = Path(clrender.__file__).resolve().parent.parent
    try:
        told = [
            subprocess.run(
                ["git", "-C", str(root), *command], capture_output=True, text=True, check=True
            ).stdout.strip()
            for command in (["rev-parse", "--short", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
        ]
    except (OSError, subprocess.CalledProcessError):
        return None
    return told[0] + ("+" if told[1] else "")


def _processors() -> int:
    return len(os.sched_getaffinity(0))
