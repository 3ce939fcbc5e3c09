"""Evaluates the formulas of lights of plugins on a device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from clrender.layout import PLUGIN_NUMBERS
from clrender.plugins import kernel_files

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from clrender.device.device import Argument, Device
    from clrender.plugins import Plugin

    _Floats = npt.NDArray[np.float32]

__all__ = ["Formula", "said_by"]

_ENTRY: Final = "plugin/formula.cl"
_PADDING: Final = 16
"""Directions are padded to a multiple of this, the most lanes of a work-item."""


class Formula:
    """The formula of one light of a plugin, with numbers for its parameters.

    Parameters
    ----------
    device : Device
    plugins : sequence of Plugin
        Those of its scene, which share a program.
    number : int
        Which of them it is, from 1 on.
    numbers : sequence of float
        Its parameters.
    lanes : int
        Directions of a work-item; no result depends on it.
    """

    def __init__(
        self, device: Device, plugins: Sequence[Plugin], number: int, numbers: Sequence[float], lanes: int = 1
    ) -> None:
        self._device, self._number, self._lanes = device, np.uint32(number), lanes
        self._program = device.program(_ENTRY, {"LANES": lanes, **kernel_files(plugins)}, 0)
        self._numbers = np.zeros(PLUGIN_NUMBERS, np.float32)
        self._numbers[: len(numbers)] = numbers

    def intensities(self, directions: _Floats) -> _Floats:
        """What it says in these directions of its own frame, whatever that is, (n, 3) float32, W/sr.

        Parameters
        ----------
        directions : (n, 3) float32
            Unit vectors.

        Raises
        ------
        RenderError, DeviceError
            If the driver fails.
        """
        return self._launch("formula_intensities", [], directions, 3)

    def densities(self, spread: float, directions: _Floats) -> _Floats:
        """The density of its samples, (n,) float32, per steradian, without what lies beyond its cone.

        Parameters
        ----------
        spread : float
            1 - cosine of half its cone.
        directions : (n, 3) float32
        """
        return self._launch("formula_densities", [np.float32(spread)], directions, 1)[:, 0]

    def samples(self, spread: float, random: _Floats) -> _Floats:
        """Directions that it samples, (n, 3) float32.

        Parameters
        ----------
        spread : float
        random : (n, 2) float32
            From 0 to below 1.
        """
        return self._launch("formula_samples", [np.float32(spread)], random, 3)

    def _launch(self, kernel: str, more: Sequence[np.generic], rows: _Floats, outputs: int) -> _Floats:
        device, count = self._device, -(-len(rows) // _PADDING) * _PADDING
        given = np.zeros((rows.shape[1], count), np.float32)
        given[:, : len(rows)] = rows.T
        given[:, len(rows) :] = rows[-1:].T  # no direction is zero
        out = np.empty((outputs, count), np.float32)
        buffers = [device.upload(self._numbers), device.upload(given), device.empty(out.nbytes)]
        try:
            arguments: list[Argument] = [buffers[0], self._number, *more, buffers[1], np.uint32(count), buffers[2]]
            device.launch_each(self._program, kernel, count // self._lanes, arguments)
            device.read(buffers[2], out)
        finally:
            for buffer in buffers:
                device.release(buffer)
        return np.ascontiguousarray(out[:, : len(rows)].T)


def said_by(
    device: Device, plugins: Sequence[Plugin], number: int, numbers: Sequence[float], directions: _Floats
) -> _Floats:
    """What a formula says; see `clrender.flatten.plugin_lights.Said`."""
    return Formula(device, plugins, number, numbers).intensities(directions)
