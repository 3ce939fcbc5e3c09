"""Runs the kernels of sampling.cl, and puts lights on a device to be sampled."""

from __future__ import annotations

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

__all__ = ["COUNT", "LightTable", "launch", "random_bits"]

Floats = npt.NDArray[np.float64]
Uints = npt.NDArray[np.uint32]

SOURCE = Path(__file__).resolve().with_name("sampling.cl")
COUNT = 1 << 18
LANES = 8


def launch(
    device: Device, kernel: str, numbers: Uints, arguments: list[Any], outputs: int, lamps: bool = False
) -> npt.NDArray[np.float32]:
    """(outputs, count) results of one of the kernels of sampling.cl, whose first array is `numbers`, (2, count)."""
    count = numbers.shape[1]
    assert count % (LANES * 16) == 0
    buffers = [device.upload(np.ascontiguousarray(numbers)), device.empty(4 * outputs * count)]
    at = next((i for i, a in enumerate(arguments) if a is None), None)
    given = [*arguments, np.uint32(count), buffers[1]]
    if at is None:
        given = [buffers[0], *given]
    else:
        given[at] = buffers[0]
    defines: dict[str, int | str] = {"LANES": LANES, **({"LAMPS": 1} if lamps else {})}
    device.launch(device.program(SOURCE, defines), kernel, count // LANES, 16, given)
    results = np.empty((outputs, count), np.float32)
    device.read(buffers[1], results)
    for buffer in buffers:
        device.release(buffer)
    return results


def random_bits(seed: int, count: int = COUNT) -> Uints:
    """Independent numbers: what is judged here is what is made of them."""
    return np.random.default_rng(seed).integers(0, 2**32, (2, count), dtype=np.uint32)


class LightTable:
    """A scene on the device whose lights can be sampled from a point."""

    def __init__(self, device: Device, what: Scene, light_sampler: str = "auto") -> None:
        self.device = device
        self.flat = flatten(what, 16, 16, light_sampler)
        self.arrays = SceneArrays(device, self.flat)
        settings = np.zeros(1, layout.dtype("Settings"))
        settings["triangle_count"] = self.flat.triangle_count
        settings["primitive_count"] = self.flat.triangle_count + self.flat.analytic_count
        settings["light_count"] = self.flat.light_count
        settings["environment"] = self.flat.environment
        settings["light_levels"] = self.flat.light_levels
        settings["lights_equal"] = bool((self.flat.arrays["lights"]["alias_threshold"] >= 1.0).all())
        self.settings = device.upload(settings)

    def sample(self, origin: tuple[float, ...], seed: int = 90) -> tuple[Floats, Floats, Uints, Uints, Floats, Floats]:
        """Directions, densities, primitives; what a ray there meets: primitive, density, distance from the sample."""
        out = self._launch("sampling_light", origin, (0.0, 0.0, 1.0), seed, 8)
        wide = out.astype(np.float64)
        return wide[:3].T, wide[3], out[4].view(np.uint32), out[5].view(np.uint32), wide[6], wide[7]

    def choose(
        self, origin: tuple[float, ...], normal: tuple[float, ...], seed: int = 91
    ) -> tuple[Uints, Floats, Floats, Floats]:
        """Lights chosen at a point, how likely each was, how likely it is when asked, and so of all lights in turn."""
        out = self._launch("sampling_light_choice", origin, normal, seed, 6)
        return out[0].view(np.uint32), out[1], out[2], out[3][: self.flat.light_count]

    def places(self, origin: tuple[float, ...], normal: tuple[float, ...], seed: int = 91) -> tuple[Uints, Floats]:
        """Lights chosen at a point, and (2, COUNT) what is left of the random numbers for the point on each."""
        out = self._launch("sampling_light_choice", origin, normal, seed, 6)
        return out[0].view(np.uint32), out[4:].astype(np.float64)

    def _launch(
        self, kernel: str, origin: tuple[float, ...], normal: tuple[float, ...], seed: int, outputs: int
    ) -> npt.NDArray[np.float32]:
        named = {**self.arrays.buffers, "settings": self.settings}
        vectors = [np.array([*vector, 0.0], np.float32) for vector in (origin, normal)]
        arguments = [*(named[name] for name in scene_array_names()), None, *vectors]
        return launch(self.device, kernel, random_bits(seed), arguments, outputs, self.flat.features.lamps)
