"""A session that renders for hours grows by nothing and leaves no handle behind.

``CLRENDER_SOAK_SECONDS=7200 ./scripts/test -n 0 -m slow tests/image/test_soak.py`` is the
two hours; ``--all`` has a minute.
"""

from __future__ import annotations

import ctypes
import gc
import itertools
import os
import statistics
import threading
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyopencl as cl
import pytest

import clrender
from clrender.device import Device
from clrender.device.launch import Scratch
from clrender.drivers import select
from clrender.process.heap import return_large_blocks

SECONDS: Final = float(os.environ.get("CLRENDER_SOAK_SECONDS", "60"))
"""How long it renders once everything has been rendered before."""

JOBS: Final[tuple[tuple[str, dict[str, Any]], ...]] = (
    ("room", {"size": (200, 160), "spp": 8}),
    ("room", {"size": (120, 120), "spp": 4, "aov": ("albedo", "normal", "crypto_object")}),
    ("cornell", {"integrator": "reuse", "size": (128, 128), "spp": 4}),
    ("room-diffuse", {"integrator": "radiosity", "size": (96, 96), "spp": 2, "patches": 500, "patch_rays": 64}),
    ("caustic", {"integrator": "photon", "size": (96, 96), "spp": 4, "photons": 4096}),
    ("room", {"integrator": "whitted", "size": (160, 120), "spp": 2}),
    ("drink", {"size": (96, 96), "spp": 4}),
    ("avenue", {"size": (96, 96), "spp": 4}),
    ("textures", {"size": (128, 96), "spp": 4}),
)
"""What a session has to forget from one render to the next: scenes, integrators, sizes and layers."""

HANDLES: Final = (cl.Buffer, cl.Program, cl.Kernel, cl.CommandQueue, cl.Context)


@dataclass(frozen=True)
class Held:
    """What the process has of things that can leak."""

    files: int
    threads: int
    handles: tuple[tuple[str, int], ...]

    @classmethod
    def now(cls) -> Held:
        gc.collect()
        handles = Counter(type(each).__name__ for each in gc.get_objects() if isinstance(each, HANDLES))
        return cls(
            sum(1 for _ in Path("/proc/self/fd").iterdir()), threading.active_count(), tuple(sorted(handles.items()))
        )


def resident_bytes() -> int:
    """Memory of the process at this moment, without what `malloc` keeps for the next who asks.

    That comes and goes by some per cent with the order in which threads allocate, and hides what leaks.
    """
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def buffers_on(device: Device) -> tuple[list[int], Counter[str]]:
    """Bytes of the buffers that are not released, and the bytes by name of those that launches write into.

    The latter are as large as the largest launch so far. Launches are sized by speed, which other programs change.
    """
    scratch = [each for each in gc.get_objects() if isinstance(each, Scratch) and each._device is device]
    names = {buffer: name for each in scratch for name, buffer in each._kept.items()}
    assert names.keys() <= device.buffers
    written: Counter[str] = Counter()
    for buffer, name in names.items():
        written[name] += buffer.nbytes
    return sorted(each.nbytes for each in device.buffers - names.keys()), written


def rounds(session: clrender.Session, checkpoint: Path) -> Iterator[None]:
    """Render all jobs, again and again, each time with another seed; every scene is read anew, as by a server."""
    for seed in itertools.count():
        for name, settings in JOBS:
            session.render(clrender.load(name), seed=seed, code="fast", **settings)
        session.render(clrender.load("room"), seed=seed, size=(64, 64), spp=4, code="fast", checkpoint=checkpoint)
        checkpoint.unlink()
        yield


@pytest.mark.slow
def test_hours_of_renders_leave_nothing(tmp_path: Path) -> None:
    return_large_blocks()  # as the command and the workers of clusters do
    select("pocl")[0].close()  # the driver's own threads and files begin with its first device
    before = Held.now()
    device: Device = select("pocl")[0]
    grown: list[int] = []
    with clrender.Session(device) as session:
        again = rounds(session, tmp_path / "saved.film")
        for _ in range(3):
            next(again)
        settled, end = Held.now(), time.monotonic() + SECONDS
        buffers, builds = buffers_on(device), device.builds
        while time.monotonic() < end or len(grown) < 8:
            next(again)
            grown.append(resident_bytes())
        assert device.builds == builds
        kept, written = buffers_on(device)
        assert kept == buffers[0] and written.keys() == buffers[1].keys()
        assert Held.now() == settled
    eighth = len(grown) // 8
    course = ", ".join(
        f"{statistics.median(grown[at : at + eighth]) / 2**20:.1f}" for at in range(0, 8 * eighth, eighth)
    )
    sizes = f"{buffers[1].total() / 2**20:.2f} to {written.total() / 2**20:.2f}"
    print(f"{len(grown)} rounds of {len(JOBS) + 1} renders; MiB by eighths: {course}; {sizes} written by launches")
    quarter = len(grown) // 4
    assert statistics.median(grown[-quarter:]) < 1.01 * statistics.median(grown[:quarter])
    assert not device.buffers
    device.close()
    del device, session, again
    assert Held.now() == before
