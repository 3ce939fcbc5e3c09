"""Sweeps over form factors on the device: what every side reflects of what the others send."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from clrender.device.device import Buffer, Device

__all__ = ["Sweeper"]

_GROUP: Final = 16
_FEW: Final = 0.3
"""Where less than this share of the sides sends anything, it pays to ask first."""

_Floats = NDArray[np.float64]


class Sweeper:
    """Form factors as what rays met, on a device; single precision, in a fixed order.

    Parameters
    ----------
    device : Device
    hits : Buffer
        (r, rays) uint32, sides that rays met.
    rays : int
    reflectance : (r, 3) float64
    columns : int
        2 n + 1.
    """

    def __init__(self, device: Device, hits: Buffer, rays: int, reflectance: _Floats, columns: int) -> None:
        self._device, self._program = device, device.program("radiosity/sweep.cl")
        self._rows, self._rays, self._hits = len(reflectance), rays, hits
        self._sent, self._got = np.zeros((columns, 4), np.float32), np.empty((self._rows, 4), np.float32)
        self._bits = np.zeros(-(-columns // 32) * 32, bool)
        colors = np.zeros((self._rows, 4), np.float32)
        colors[:, :3] = reflectance
        self._colors = device.upload(colors)
        self._wide, self._out = device.empty(self._sent.nbytes), device.empty(self._got.nbytes)
        self._senders = device.empty(len(self._bits) // 8)

    def reflected(self, sent: _Floats) -> _Floats:
        """What each row's side reflects.

        Parameters
        ----------
        sent : (columns, 3) float64
            Radiance of each side.

        Returns
        -------
        (r, 3) float64
            With the precision of float32.
        """
        device, columns = self._device, len(sent)
        self._sent[:, :3] = sent
        self._bits[:columns] = (sent[:, 0] != 0.0) | (sent[:, 1] != 0.0) | (sent[:, 2] != 0.0)
        few = np.count_nonzero(self._bits) < _FEW * columns
        device.write(self._wide, self._sent)
        device.write(self._senders, np.packbits(self._bits, bitorder="little").view("<u4"))
        arguments: list[Buffer | np.generic] = [self._hits, np.uint32(self._rows), np.uint32(self._rays)]
        arguments += [np.float32(1.0 / self._rays), self._colors, self._wide, np.uint32(few), self._senders, self._out]
        device.launch(self._program, "radiosity_sweep", -(-self._rows // _GROUP) * _GROUP, _GROUP, arguments)
        device.read(self._out, self._got)
        return self._got[:, :3].astype(np.float64)

    def release(self) -> None:
        """Give the device's memory back."""
        for buffer in (self._colors, self._wide, self._out, self._senders):
            self._device.release(buffer)
