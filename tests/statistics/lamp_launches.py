"""What the kernels make of the lights of a scene: intensities and photons, of lights alone."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.device.scene_arrays import SceneArrays, scene_array_names
from clrender.flatten.flat_scene import flatten

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

__all__ = ["Lamps", "around", "hammersley"]

Floats = npt.NDArray[np.float64]

SOURCE = Path(__file__).resolve().with_name("lamp.cl")
LANES = 8


def around(steps: int = 64) -> Floats:
    """Directions all around, none of them at a line of the files; (2 steps², 3)."""
    height, turn = (np.arange(steps) + 0.5) / steps * 2.0 - 1.0, (np.arange(2 * steps) + 0.37) / steps * math.pi
    across = np.sqrt(1.0 - height * height)
    parts = across[:, None] * np.cos(turn), across[:, None] * np.sin(turn), height[:, None]
    return np.stack(np.broadcast_arrays(*parts), axis=-1).reshape(-1, 3)


class Lamps:
    """The lights of a scene on a device."""

    def __init__(self, device: Device, what: Scene) -> None:
        self.device, self.flat = device, flatten(what, 16, 16)
        self.arrays = SceneArrays(device, self.flat)
        named = {**self.arrays.buffers, "settings": device.upload(np.zeros(1, layout.dtype("Settings")))}
        self.scene = [named[name] for name in scene_array_names()]

    def launch(self, kernel: str, numbers: npt.NDArray[Any], number: int, outputs: int) -> Floats:
        count = numbers.shape[1]
        buffers = [self.device.upload(np.ascontiguousarray(numbers)), self.device.empty(4 * outputs * count)]
        arguments: list[Any] = [*self.scene, buffers[0], np.uint32(number), np.uint32(count), buffers[1]]
        program = self.device.program(SOURCE, {"LANES": LANES, "LAMPS": 1})
        self.device.launch(program, kernel, count // LANES, 16, arguments)
        results = np.empty((outputs, count), np.float32)
        self.device.read(buffers[1], results)
        return results.astype(np.float64)


def hammersley(bits: int) -> npt.NDArray[np.uint32]:
    """Bits of points in the square in the place of random ones, (2, 2^bits): means err by a few millionths."""
    number = np.arange(2**bits, dtype=np.uint32)
    reversed_ = sum(((number >> np.uint32(k)) & np.uint32(1)) << np.uint32(31 - k) for k in range(bits))
    both = np.stack([number << np.uint32(32 - bits), np.asarray(reversed_, np.uint32)])
    return both + np.uint32(2 ** (31 - bits))
