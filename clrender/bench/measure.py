"""Runs taken in turns, so that what else the machine does falls on all alike, and what they come to."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import clrender
from clrender.bench.peers import OWN, SEGMENTS, Task

if TYPE_CHECKING:
    from pathlib import Path

    from clrender.bench.peers import Peer

__all__ = ["Run", "measure", "summary"]


@dataclass(frozen=True)
class Run:
    """One render by one renderer.

    Attributes
    ----------
    scene, renderer : str
    repeat : int
        Which turn, from 0.
    wall_seconds, cpu_seconds : float
        Of the render, by all threads: without start, reading the scene and compilers. clrender's are with its tree and
        upload, peers' without.
    paths : int
    details : dict
        What the renderer says of itself: its version, set-up, tree and compile seconds, rays, memory.
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
        """Million paths a second of CPU time, times the processors: what an idle machine would give."""
        return self.paths * _processors() / self.cpu_seconds / 1e6

    def line(self) -> dict[str, Any]:
        """The run as a line of JSON."""
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
            **self.details,
        }


def measure(
    scenes: Sequence[tuple[str, Path]],
    peers: Sequence[Peer],
    task: Task,
    repeats: int,
    device: str | None = None,
    done: Callable[[Run], None] = lambda run: None,
) -> list[Run]:
    """Render every scene with clrender and every peer, in turns.

    Parameters
    ----------
    scenes : sequence of (str, Path)
        Name and file of each.
    peers : sequence of Peer
    task : Task
        Size and samples.
    repeats : int
        Turns; one more comes first and does not count, so that everything is compiled and read.
    device : str, optional
        clrender's.
    done : callable, optional
        Told every run that counts, as soon as it has ended.

    Raises
    ------
    ClrenderError
        When a scene cannot be rendered or a peer fails.
    """
    runs = []
    for name, path in scenes:
        for repeat in range(-1, repeats):
            for renderer in (None, *peers):
                details = _own(path, task, device) if renderer is None else renderer.run(path, task)
                wall, cpu = details.pop("wall_seconds"), details.pop("cpu_seconds")
                title = OWN if renderer is None else renderer.name
                run = Run(name, title, repeat, wall, cpu, task.width * task.height * task.spp, details)
                if repeat >= 0:
                    runs.append(run)
                    done(run)
    return runs


def summary(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Median and spread of each renderer on each scene, and the median, turn by turn, of clrender's rate over a peer's.

    Parameters
    ----------
    runs : sequence of Run

    Returns
    -------
    list of dict
        ``scene, renderer, runs, mpaths_per_second, lowest, highest``, and ``ratio`` of peers.
    """
    rows = []
    for scene, renderer in dict.fromkeys((run.scene, run.renderer) for run in runs):
        rates = {run.repeat: run.rate for run in runs if (run.scene, run.renderer) == (scene, renderer)}
        own = {run.repeat: run.rate for run in runs if (run.scene, run.renderer) == (scene, OWN)}
        row = {
            "scene": scene,
            "renderer": renderer,
            "runs": len(rates),
            "mpaths_per_second": round(statistics.median(rates.values()), 4),
            "lowest": round(min(rates.values()), 4),
            "highest": round(max(rates.values()), 4),
        }
        both = rates.keys() & own.keys()
        if renderer != OWN and both:
            row["ratio"] = round(statistics.median(own[turn] / rates[turn] for turn in both), 3)
        rows.append(row)
    return rows


def _own(path: Path, task: Task, device: str | None) -> dict[str, Any]:
    scene = clrender.load(str(path))
    begin, cpu = time.perf_counter(), time.process_time()
    size = (task.width, task.height)
    image = clrender.render(scene, device=device, size=size, spp=task.spp, roulette="none", max_depth=SEGMENTS - 1)
    wall, used = time.perf_counter() - begin, time.process_time() - cpu
    stats = image.stats
    return {
        "wall_seconds": wall,
        "cpu_seconds": used,
        "version": stats["version"],
        "driver": stats["devices"][0]["driver"],
        "device": stats["devices"][0]["name"],
        **{name: round(stats[name], 4) for name in ("build_seconds", "compile_seconds", "render_seconds")},
        **{name: stats[name] for name in ("rays", "device_bytes", "peak_rss_bytes", "image_sha256")},
        "mean": [round(float(x), 6) for x in image.linear.mean((0, 1))],
    }


def _processors() -> int:
    return len(os.sched_getaffinity(0))
