"""Shared by the peers' scripts: command line and result. Needs NumPy, not clrender."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

__all__ = [
    "Job",
    "answer",
    "job",
    "timed",
]


@dataclass(frozen=True)
class Job:
    """One render: scene, size, samples per pixel, segments of a path, seed, output path.

    `variant` is the peer's, with further options after a colon.
    """

    variant: str
    scene: Path
    width: int
    height: int
    spp: int
    segments: int
    seed: int
    image: Path


def job() -> Job:
    """The command line: ``VARIANT SCENE.json WIDTH HEIGHT SPP SEGMENTS SEED IMAGE.npy``."""
    variant, scene, *numbers, image = sys.argv[1:]
    width, height, spp, segments, seed = (int(number) for number in numbers)
    return Job(variant, Path(scene), width, height, spp, segments, seed, Path(image))


def timed(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """The result of `work`, and its elapsed and CPU seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def answer(one: Job, image: Any, wall: float, cpu: float, version: str, setup: float, **more: Any) -> None:
    """Save the image, (height, width, 3) with the top row first, and print the line that the benchmark reads."""
    if image is not None:
        np.save(one.image, np.ascontiguousarray(image, np.float32))
        more["mean"] = [round(float(x), 6) for x in image.mean((0, 1))]
    line = {"wall_seconds": wall, "cpu_seconds": cpu, "version": version, "setup_seconds": round(setup, 4), **more}
    print("\n" + json.dumps(line), flush=True)
