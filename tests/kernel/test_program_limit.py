"""A device keeps the programs that were used last, so that a session of many settings does not grow without bound."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clrender.device import Device
from clrender.device import device as module
from clrender.drivers import select

SOURCE = "__kernel void fill(__global int *out) { out[get_global_id(0)] = VALUE; }\n"


def filled(device: Device, entry: Path, value: int) -> int:
    program = device.program(entry, {"VALUE": value})
    out, found = device.empty(64), np.zeros(16, np.int32)
    device.launch(program, "fill", 16, 16, [out])
    device.read(out, found)
    device.release(out)
    assert (found == found[0]).all()
    return int(found[0])


def test_the_programs_used_last_are_kept(tmp_path: Path, cache_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PROGRAM_LIMIT", 3)
    (tmp_path / "fill.cl").write_text(SOURCE)
    entry = tmp_path / "fill.cl"
    device: Device = select("pocl")[0]
    start = device.builds
    for value in (1, 2, 3, 1, 2, 3, 1):
        assert filled(device, entry, value) == value
    assert device.builds == start + 3
    assert filled(device, entry, 2) == 2
    assert filled(device, entry, 1) == 1
    assert filled(device, entry, 4) == 4  # in the place of 3, which was used longest ago
    assert [filled(device, entry, value) for value in (1, 2, 4)] == [1, 2, 4]
    assert device.builds == start + 4
    assert filled(device, entry, 3) == 3
    assert device.builds == start + 5
    device.close()
