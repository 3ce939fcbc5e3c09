"""film/splat.h against Python's integers: work-items that add to the same words at the same time lose nothing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from exact_sums import quanta

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.device import Argument

KERNEL = str(Path(__file__).with_name("splat.cl"))
COUNT, SLOTS = 40_000, 3


def total(words: np.ndarray[tuple[int, ...], np.dtype[np.uint32]]) -> int:
    """A sum of four words in two's complement."""
    value = sum(int(word) << (32 * place) for place, word in enumerate(words))
    return value - (1 << 128) if value >> 127 else value


@pytest.mark.parametrize("lanes", [1, 8])
def test_sums_are_exact(device: Device, lanes: int) -> None:
    rng = np.random.default_rng(5)
    values = (rng.standard_normal(COUNT) * 10.0 ** rng.integers(-22, 12, COUNT)).astype(np.float32)
    values[::97], values[5::1001], values[7::1003] = 0.0, np.nan, np.inf
    values[3::50] = -(2.0**-64)  # borrows through all words, again and again
    values[4::50] = 2.0**-64
    slots = rng.integers(0, SLOTS, COUNT, np.uint32)
    program = device.program(KERNEL, {"LANES": lanes})
    buffers = [device.upload(each) for each in (values, slots, np.zeros((SLOTS, 3, 4), np.uint32))]
    items = -(-COUNT // lanes // 16) * 16
    arguments: list[Argument] = [buffers[0], buffers[1], np.uint32(COUNT), np.uint32(SLOTS), buffers[2]]
    device.launch(program, "add_splats", items, 16, arguments)
    words = np.empty((SLOTS, 3, 4), np.uint32)
    device.read(buffers[2], words)
    for buffer in buffers:
        device.release(buffer)
    kept = np.isfinite(values)
    for slot in range(SLOTS):
        own = values[kept & (slots == slot)]
        for channel, factor in enumerate((1.0, 0.5, -1.0)):
            assert total(words[slot, channel]) == sum(quanta(float(np.float32(x * factor))) for x in own.tolist())
