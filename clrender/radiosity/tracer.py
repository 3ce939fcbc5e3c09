"""The device side of radiosity: rays from patches, shadow rays, and sweeps over what they met."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.device.worker import Cut, DeviceWorker
from clrender.errors import UsageError
from clrender.integrators import Integrator

if TYPE_CHECKING:
    from clrender.device.device import Buffer, Device
    from clrender.flatten import FlatScene

__all__ = ["MOST_DIRECT_SAMPLES", "Boxes", "Stopped", "Tracer"]

MOST_DIRECT_SAMPLES: Final = 32
_LAUNCH_SECONDS: Final = 0.15
_FIRST_LAUNCH: Final = 1 << 16
_GROUP: Final = 16
_FORM: Final = Integrator("radiosity/form.cl", "radiosity_rays")

_Floats = NDArray[np.float64]
_Uints = NDArray[np.uint32]
Boxes = NDArray[np.float32]
"""(2, 6): where a shape was and where it is, low x, y, z and high x, y, z."""


class Stopped(Exception):
    """Somebody asked for an end before there was a result."""


class Tracer:
    """Patches on one device.

    Parameters
    ----------
    device : Device
    scene : FlatScene
        Of patches: `clrender.radiosity.patches.Patches.flat`.
    rays : int
        From each side.
    seed : int
    cut : Cut, optional
    should_stop : callable, optional
        Asked between launches.
    """

    def __init__(
        self,
        device: Device,
        scene: FlatScene,
        rays: int,
        seed: int = 0,
        cut: Cut | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> None:
        settings = np.zeros(1, layout.dtype("Settings"))
        settings["seed"] = seed
        self.device = device
        self.rays = rays
        self.outside = 2 * scene.triangle_count
        self._has_lights = scene.light_count > 0
        self._worker = DeviceWorker(device, scene, settings, _FORM, cut)
        self._should_stop = should_stop

    def hits(self, sides: _Uints) -> _Uints:
        """What the rays of these sides meet.

        Parameters
        ----------
        sides : (r,) uint32

        Returns
        -------
        (r, rays) uint32
            Sides, or `outside`.

        Raises
        ------
        Stopped
        UsageError
            When there are more rays than 2**31.
        """
        return self._all_rays("radiosity_rays", sides, self.rays)

    def hemicube(self, sides: _Uints, cells: NDArray[np.float32]) -> _Uints:
        """What is seen through the cells of a hemicube about the centre of these sides.

        Parameters
        ----------
        sides : (r,) uint32
        cells : (c, 4) float32
            Directions, z along the normal.

        Returns
        -------
        (r, c) uint32
        """
        return self._all_rays("radiosity_hemicube", sides, len(cells), cells)

    def _all_rays(self, kernel: str, sides: _Uints, rays: int, cells: NDArray[np.float32] | None = None) -> _Uints:
        total = len(sides) * rays
        if total > 2**31:
            raise UsageError(f"{len(sides)} sides of patches with {rays} rays each are too many; take fewer of either")
        device, met = self.device, np.empty((len(sides), rays), np.uint32)
        program = self._worker.program(_FORM.entry)
        of, hits = device.upload(sides), device.empty(met.nbytes)
        table = [] if cells is None else [device.upload(cells)]

        def launch(first: int, count: int) -> None:
            span = [np.uint32(first), np.uint32(count), np.uint32(rays)]
            self._worker.launch_over(program, kernel, count, [of, *table, *span, hits])

        self._slices(total, _FIRST_LAUNCH, launch)
        device.read(hits, met)
        self._release(of, hits, *table)
        return met

    def trace_again(
        self, sides: _Uints, hits: Buffer, moved: tuple[int, int], box: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], _Uints]:
        """Trace only those rays that a move may have changed.

        Parameters
        ----------
        sides : (r,) uint32
        hits : Buffer
            (r, rays) uint32 of before the move; changed in place.
        moved : (int, int)
            First side that moved, and the one after the last.
        box : (6,) float32
            Around where they are now.

        Returns
        -------
        listed : (k,) int64
            Rays that were traced: row x rays + index.
        met : (k,) uint32
        """
        device, worker = self.device, self._worker
        flags = np.empty(len(sides) * self.rays, np.uint8)
        of, around, affected = device.upload(sides), device.upload(box), device.empty(flags.nbytes)
        program = worker.program(_FORM.entry)

        def mark(first: int, count: int) -> None:
            span = [np.uint32(n) for n in (first, count, self.rays, *moved)]
            worker.launch_over(program, "radiosity_affected", count, [of, *span, around, hits, affected])

        self._slices(flags.size, _FIRST_LAUNCH * 16, mark)
        device.read(affected, flags)
        listed = np.flatnonzero(flags)
        met = np.empty(len(listed), np.uint32)
        if len(listed):
            which, found = device.upload(listed.astype(np.uint32)), device.empty(met.nbytes)

            def launch(first: int, count: int) -> None:
                span = [np.uint32(n) for n in (first, count, self.rays)]
                worker.launch_over(program, "radiosity_listed", count, [of, which, *span, hits, found])

            self._slices(len(listed), _FIRST_LAUNCH, launch)
            device.read(found, met)
            self._release(which, found)
        self._release(of, around, affected)
        return listed, met

    def direct(
        self,
        sides: _Uints,
        samples: int,
        seen: _Uints | None = None,
        moved: tuple[int, int] = (0, 0),
        boxes: Boxes | None = None,
    ) -> tuple[_Floats, _Uints]:
        """Irradiance straight from the lights that shadow rays look for.

        Parameters
        ----------
        sides : (r,) uint32
        samples : int
            Points of each side, at most 32.
        seen : (r,) uint32, optional
            Of before a move, whose sides and boxes then have to be given too.

        Returns
        -------
        irradiance : (r, 3) float64, W/m²
        seen : (r,) uint32
            A bit for each sample that arrived.
        """
        result, bits = np.zeros((len(sides), 3), np.float32), np.zeros(len(sides), np.uint32)
        if self._has_lights and len(sides):
            device, program = self.device, self._worker.program("radiosity/direct.cl")
            around = device.upload(np.zeros((2, 6), np.float32) if boxes is None else boxes)
            of, out = device.upload(sides), device.empty(result.nbytes)
            kept = device.upload(bits if seen is None else seen)
            update = seen is not None and boxes is not None

            def launch(first: int, count: int) -> None:
                span = [np.uint32(n) for n in (first, count, samples, update, *moved)]
                self._worker.launch_over(program, "radiosity_direct", count, [of, *span, around, kept, out])

            self._slices(len(sides), 4096, launch)
            device.read(out, result)
            device.read(kept, bits)
            self._release(around, of, out, kept)
        return result.astype(np.float64), bits

    def _slices(self, total: int, first: int, launch: Callable[[int, int], None]) -> None:
        """Launch over parts of `total` things, each of about `_LAUNCH_SECONDS`."""
        start, length = 0, first
        while start < total:
            if self._should_stop is not None and self._should_stop():
                raise Stopped
            count = min(length, total - start)
            begin = time.perf_counter()
            launch(start, count)
            self.device.finish()
            seconds = max(time.perf_counter() - begin, 1e-4)
            start += count
            length = max(first // 4, min(int(count / seconds * _LAUNCH_SECONDS), 4 * count)) // 1024 * 1024

    def _release(self, *buffers: Buffer) -> None:
        for buffer in buffers:
            self.device.release(buffer)

    def release(self) -> None:
        """Give the device's memory back."""
        self._worker.release()
