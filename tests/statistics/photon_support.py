"""Photon maps as a render makes them, read back: `photon_map`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.device.device import Buffer
from clrender.device.worker import DeviceWorker
from clrender.flatten.flat_scene import flatten
from clrender.integrators import INTEGRATORS
from clrender.photon.maps import PhotonMaps
from clrender.settings import RenderSettings

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.scene import Scene

__all__ = ["ALBEDO", "PHOTONS", "photon_map"]

ALBEDO: Final = 0.8
PHOTONS: Final = 1 << 14


def photon_map(device: Device, what: Scene, number: int, photons: int = PHOTONS) -> npt.NDArray[np.float32]:
    """(10, n) the deposits of a map: position, normal, flux, scattering events."""
    flat = flatten(what, 16, 16, "power")
    worker = DeviceWorker(device, flat, RenderSettings(integrator="photon").struct(16), INTEGRATORS["photon"].pipeline)
    maps = PhotonMaps(worker, flat, photons, None)
    buffer, starts, stride, _, size, _, _ = maps.arguments(number)
    assert isinstance(buffer, Buffer) and isinstance(starts, Buffer)
    assert isinstance(size, np.ndarray) and isinstance(stride, np.uint32)
    begin, words = np.empty(int(size[3]) + 1, np.uint32), np.empty((10, int(stride)), np.float32)
    device.read(starts, begin)
    device.read(buffer, words)
    maps.release()
    worker.release()
    return words[:, : begin[-1]]
