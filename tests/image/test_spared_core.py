"""A CPU beside a GPU leaves a core to the thread that feeds the GPU."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import clrender
from clrender.device import Device
from clrender.drivers.select import spare_cores


def busy_threads(before: dict[str, int], after: dict[str, int]) -> int:
    """Threads that did a real part of the work in between, of the driver: those of a render do not last."""
    ours = str(threading.main_thread().native_id)
    spent = [after[name] - before[name] for name in after if name in before and name != ours]
    return sum(each > max(spent) / 8 for each in spent)


def ticks() -> dict[str, int]:
    """Processor time of each thread of this process, in hundredths of a second."""
    found = {}
    for task in Path("/proc/self/task").iterdir():
        try:
            fields = (task / "stat").read_text().rsplit(")", 1)[1].split()
        except OSError:  # a thread of an earlier render that has ended since
            continue
        found[task.name] = int(fields[11]) + int(fields[12])
    return found


def wait_for_quiet() -> None:
    """Until no thread of this process works: compilers may still be busy with programs of other tests."""
    for _ in range(400):
        before = ticks()
        time.sleep(0.3)
        if ticks() == before:
            return


class Undividable:
    def create_sub_devices(self, properties: list[int]) -> list[Any]:
        import pyopencl as cl

        raise cl.LogicError("clCreateSubDevices failed: INVALID_VALUE")


def test_nothing_is_divided_without_need(device: Device) -> None:
    gpu, lone = replace(device.info, type="gpu"), replace(device.info, compute_units=1)
    for infos in ([device.info], [device.info, device.info], [gpu, gpu], [gpu, lone]):
        handles: list[Any] = [device._handle] * len(infos)
        assert spare_cores(infos, handles) == list(zip(infos, handles, strict=True))
    refuses = Undividable()
    assert spare_cores([gpu, device.info], [None, refuses]) == [(gpu, None), (device.info, refuses)]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads' times are Linux's to tell")
def test_the_divided_cpu_renders_the_same_on_one_core_less(device: Device) -> None:
    units = device.info.compute_units
    if units < 2 or device.info.type != "cpu" or (os.cpu_count() or 1) < 2:
        pytest.skip("this processor has no core to spare")
    gpu = replace(device.info, type="gpu")
    (same, nothing), (info, handle) = spare_cores([gpu, device.info], [None, device._handle])
    assert same is gpu and nothing is None and info.compute_units == units - 1
    if handle is device._handle:
        pytest.skip("its driver does not divide it")
    how: dict[str, Any] = {"size": (160, 120), "spp": 64, "code": "fast"}
    part, hashes, busy = Device(info, handle), [], []
    for each in (device, part):
        clrender.render(clrender.load("room"), device=each, **{**how, "spp": 1})
        wait_for_quiet()
        before = ticks()
        hashes.append(clrender.render(clrender.load("room"), device=each, **how).stats["image_sha256"])
        busy.append(busy_threads(before, ticks()))
    assert hashes[0] == hashes[1]
    assert busy == [units, units - 1]
    part.close()
