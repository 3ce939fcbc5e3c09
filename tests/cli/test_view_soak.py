"""A view whose camera never rests grows by nothing.

``CLRENDER_SOAK_SECONDS=600 ./scripts/test -n 0 -m slow tests/cli/test_view_soak.py`` is the ten minutes; ``--all`` has
one.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import statistics
import time
from pathlib import Path
from typing import Final

import pytest
from view_clients import EngineClient, Received

import clrender
from clrender.device import Device
from clrender.process.heap import return_large_blocks
from clrender.view import Engine

SECONDS: Final = float(os.environ.get("CLRENDER_SOAK_SECONDS", "60"))


def resident_bytes() -> int:
    """Memory of the process at this moment, without what `malloc` keeps for the next who asks."""
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
def test_ten_minutes_of_a_moving_camera_grow_by_less_than_two_per_cent(device: Device) -> None:
    """With all that a page may want in between: layers, probes, settings, materials, who comes and goes."""
    return_large_blocks()  # as the command does
    grown: list[int] = []
    number = 0

    def answers(message: Received) -> bool:
        return message.kind == "frame" and bool(message.content["answers"] == number)

    def look_around(page: EngineClient, moves: int) -> None:
        nonlocal number
        for _ in range(moves):
            number += 1
            angle = 0.3 * math.sin(number / 10.0)
            page.say("camera", id=number, camera={"position": [5.6 * math.sin(angle), 2.0, 5.6 * math.cos(angle)]})
            page.until(answers)

    with Engine(clrender.load("room"), device=device, width=320, height=180, spp=256) as engine:
        first = EngineClient(engine)
        for replicate_spp in (16, None):  # a driver compiles a kernel when it is first launched, and keeps it
            first.say("set", settings={"replicate_spp": replicate_spp})
            first.until_done()
        begin, rounds = time.monotonic(), 0
        while time.monotonic() - begin < SECONDS or len(grown) < 8:
            other = EngineClient(engine)
            other.say("show", layers=["normal", "image"], format="float32")
            look_around(first, 40)
            other.until_kind("frame", layer="normal")
            first.say("probe", x=rounds % 320, y=90)
            first.until_kind("probe")
            first.say("material", name="white", values={"reflectance": [0.2 + 0.01 * (rounds % 50)] * 3})
            first.say("set", settings={"seed": rounds % 7, "replicate_spp": (None, 16)[rounds % 2]})
            look_around(first, 10)
            other.viewer.close()
            rounds += 1
            if rounds > 14 and time.monotonic() - begin > 0.1 * SECONDS:  # every combination of settings was used once
                grown.append(resident_bytes())
    quarter = len(grown) // 4
    early, late = statistics.median(grown[:quarter]), statistics.median(grown[-quarter:])
    print(f"{number} cameras, {rounds} rounds: {early / 2**20:.1f} MiB, then {late / 2**20:.1f} MiB")
    assert late < 1.02 * early
