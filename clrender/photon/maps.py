"""Photon maps: one for each sample index, built on the device before that sample of the pixels is taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.device.prepared import Prepared, Request
from clrender.device.radix_sort import launch_each, sort
from clrender.flatten.flat_box import around_box, scene_box
from clrender.flatten.interiors import has_volumes

if TYPE_CHECKING:
    from clrender.device.device import Argument, Buffer
    from clrender.device.worker import DeviceWorker
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["PhotonMaps", "prepare", "radius_of_pass"]

SHRINKING: Final = 2.0 / 3.0
"""Parameter alpha of the radius reduction: the value recommended by Knaus and Zwicker (2011, section 4.1)."""
RADIUS_SHARE: Final = 0.01
"""Default radius of the first photon map, relative to the scene's radius."""

# kernels/photon/deposit.h; a test compares them.
DEPOSITS: Final = 8
DEPOSIT_WORDS: Final = 12

_MAP_WORDS: Final = 10
_MAP_WORDS_WITH_KIND: Final = 11
_MOST_CELLS: Final = 1 << 22


def radius_of_pass(first: float, number: int) -> float:
    """Radius of a photon map, metres (Knaus and Zwicker 2011, equation 15).

    Parameters
    ----------
    first : float
        Radius of map 0.
    number : int
        Index of the map, from 0.
    """
    return first * math.sqrt(float(_shrunk(max(number, 255).bit_length())[number]))


@lru_cache
def _shrunk(bits: int) -> npt.NDArray[np.float64]:
    """(2**bits,) float64: ratio of each map's squared radius to the first one's, as a sequential product."""
    i = np.arange(1.0, 2.0**bits)
    return np.concatenate([[1.0], np.cumprod((i + SHRINKING) / (i + 1.0))])


def photons_per_item(lanes: int) -> int:
    """Photons that a work-item traces: ``PHOTONS_PER_ITEM`` of ``kernels/photon/photons.cl``."""
    return 1 if lanes == 1 else 16 * lanes


class PhotonMaps:
    """The photon maps of a render on one device; only one is in memory at a time.

    Map `n` is a function of the scene, the settings and `n`, so every device that builds it gets the same bits.

    Parameters
    ----------
    worker : DeviceWorker
        The photons are traced in its scene.
    flat : FlatScene
        The same scene.
    photons : int
        Number of photons emitted for each map.
    radius : float or None
        Radius of the first map, metres; None: a hundredth of the scene's.
    """

    def __init__(self, worker: DeviceWorker, flat: FlatScene, photons: int, radius: float | None) -> None:
        self._worker = worker
        self._photons = photons
        low, high = scene_box(flat)
        self._bounds, around = around_box(low, high)
        self._radius = RADIUS_SHARE * around if radius is None else radius
        self._low, self._extent = low, np.maximum(high - low, 1e-3 * around)
        more: dict[str, int | str] = {"LIGHTS_IN_MEDIA": 1} if has_volumes(flat.arrays) else {}
        self._trace = worker.program("photon/photons.cl", more)
        self._media = flat.features.media
        self._has_kinds = flat.features.media or flat.features.textures
        self._grid = worker.device.program("photon/grid.cl", {"LANES": 1})
        self._dark = flat.light_count == 0
        self._held: list[Buffer] = []
        self._ready: tuple[int, list[Argument]] | None = None
        self._rays = 0

    def take_rays(self) -> int:
        """Number of rays traced since the last call."""
        rays, self._rays = self._rays, 0
        return rays

    def arguments(self, sample: int) -> Sequence[Argument]:
        """The photon map for this sample of every pixel, as arguments of ``kernels/integrator/photon.cl``."""
        if self._ready is None or self._ready[0] != sample:
            self.release()
            self._ready = sample, self._make(sample)
        return self._ready[1]

    def _make(self, number: int) -> list[Argument]:
        device, places = self._worker.device, self._photons * DEPOSITS
        radius = np.float32(radius_of_pass(self._radius, number))
        low, size = self._cells(float(radius))
        deposits, counts = self._deposits(number)
        keys, values = device.empty(8 * places), device.empty(4 * places)
        media, cells = np.uint32(self._media), int(size[3]) * (2 if self._media else 1)
        arguments: list[Argument] = [deposits, counts, np.uint32(places), low, size, media, keys, values]
        launch_each(device, self._grid, "grid_keys", places, arguments)
        keys, values = sort(device, keys, values, places, cells.bit_length())
        starts = device.empty(4 * (cells + 1))
        launch_each(device, self._grid, "grid_starts", places + 1, [keys, np.uint32(places), np.uint32(cells), starts])
        stride = np.uint32(-(-places // 16) * 16 + 16)
        words = np.uint32(_MAP_WORDS_WITH_KIND if self._has_kinds else _MAP_WORDS)
        photon_map = device.empty(4 * int(words) * int(stride))
        arguments = [deposits, counts, values, starts, np.uint32(cells), stride, words, photon_map]
        launch_each(device, self._grid, "grid_place", int(stride), arguments)
        device.finish()
        for buffer in (deposits, counts, keys, values):
            device.release(buffer)
        self._held = [photon_map, starts]
        area = math.pi * (float(radius) * float(radius))
        return [photon_map, starts, stride, words, low, size, radius, np.float32(1.0 / (self._photons * area))]

    def _deposits(self, number: int) -> tuple[Buffer, Buffer]:
        """Trace the photons; returns their deposits, and the number of deposits of each photon."""
        device, worker = self._worker.device, self._worker
        deposits = device.empty(4 * DEPOSIT_WORDS * DEPOSITS * self._photons)
        counts = device.empty(4 * self._photons)
        device.write(counts, np.zeros(self._photons, np.uint32))
        if self._dark:
            return deposits, counts
        items = worker.padded(-(-self._photons // photons_per_item(worker.lanes)))
        rays = device.empty(4 * items)
        arguments: list[Argument] = [self._bounds, np.uint32(number), np.uint32(self._photons), deposits, counts, rays]
        worker.launch(self._trace, "photon_pass", items, arguments)
        traced = np.empty(items, np.uint32)
        device.read(rays, traced)
        device.release(rays)
        self._rays += int(traced.sum(dtype=np.uint64))
        return deposits, counts

    def _cells(self, radius: float) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
        """The grid: its corner and cells per metre; its number of cells along each axis and in total."""
        side = radius
        along = np.ceil(self._extent / side)
        while along.prod() > _MOST_CELLS:
            side *= 1.1
            along = np.ceil(self._extent / side)
        return np.array([*self._low, 1.0 / side], np.float32), np.array([*along, along.prod()], np.uint32)

    def release(self) -> None:
        """Release the device memory."""
        for buffer in self._held:
            self._worker.device.release(buffer)
        self._held, self._ready = [], None


def prepare(request: Request) -> Prepared:
    """Prepare photon maps on each device."""
    settings = request.settings
    maps = partial(PhotonMaps, flat=request.flat, photons=settings.photons, radius=settings.photon_radius)
    return Prepared(request.flat, request.pipeline, maps)
