"""The device that stands for a real one in tests of the host keeps the real one's promises."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from fake_device import FakeDevice

from clrender.errors import DeviceError, RenderError


def double(global_size: int, local_size: int, args: Sequence[Any]) -> None:
    values = args[0].view(np.float32)
    values[:global_size] *= args[1]


def test_it_computes_what_it_is_told_to() -> None:
    device = FakeDevice({"double": double})
    buffer = device.upload(np.arange(8, dtype=np.float32))
    device.launch(device.program("x.cl"), "double", 8, 4, [buffer, np.float32(2)])
    result = np.empty(8, np.float32)
    device.read(buffer, result)
    assert result.tolist() == [0, 2, 4, 6, 8, 10, 12, 14]
    device.finish()
    assert (device.launches, device.builds) == (1, 1)


def test_it_counts_memory() -> None:
    device = FakeDevice(memory_bytes=100)
    first = device.empty(60)
    with pytest.raises(RenderError, match="no 60 bytes left"):
        device.empty(60)
    device.release(first)
    device.empty(40)
    assert device.allocated_bytes == 60


def test_it_fails_when_told_to() -> None:
    device = FakeDevice(fail_from=1)
    program = device.program("x.cl", {"LANES": 1})
    assert device.program("x.cl", {"LANES": 1}) is program
    device.launch(program, "any", 4, 4, [])
    for _ in range(2):
        with pytest.raises(RenderError, match="told to fail"):
            device.launch(program, "any", 4, 4, [])
    with pytest.raises(DeviceError, match="cannot build"):
        FakeDevice(fail_build=True).program("x.cl")
