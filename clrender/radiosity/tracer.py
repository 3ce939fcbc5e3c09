"""The device side of radiosity: rays from patches, shadow rays, and sweeps over their hits."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.device.launch import LaunchConfig
from clrender.device.radix_sort import launch_each, scan
from clrender.device.worker import DeviceWorker
from clrender.errors import UsageError
from clrender.integrators.descriptor import Pipeline
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.device.device import Argument, Buffer, Device
    from clrender.flatten.flat_scene import FlatScene
    from clrender.radiosity.moving import Moving

__all__ = ["MOST_DIRECT_SAMPLES", "Changes", "PreviousDirectLight", "Stopped", "Tracer"]

MOST_DIRECT_SAMPLES: Final = 32
_LAUNCH_SECONDS: Final = 0.15
_FIRST_LAUNCH: Final = 1 << 16
_FORM: Final = Pipeline("radiosity/form.cl", "radiosity_rays")

_Floats = NDArray[np.float64]
_Uints = NDArray[np.uint32]


@dataclass(frozen=True)
class Changes:
    """Changes of ray hits by a step of the moving shape.

    Attributes
    ----------
    brought : (r, 3) float64
        Change of the mean incident radiance over each side's rays.
    covered : (r,) int64
        Increase of the number of its rays that hit a sealed side.
    rays : int
        Rays that had to be traced.
    unknown : bool
        Whether a side without a row was hit.
    """

    brought: _Floats
    covered: NDArray[np.int64]
    rays: int
    unknown: bool


@dataclass(frozen=True)
class PreviousDirectLight:
    """Direct light before a step of the moving shape.

    Attributes
    ----------
    irradiance, seen
        Results of `Tracer.direct`.
    lights : (k, 6) float32
        Bounding boxes of the lights.
    """

    irradiance: _Floats
    seen: _Uints
    lights: NDArray[np.float32]


class Stopped(Exception):
    """The computation was stopped before there was a result."""


class Tracer:
    """Patches on one device.

    Parameters
    ----------
    device : Device
    scene : FlatScene
        Made of patches: see `clrender.radiosity.patches.Patches.flat`.
    rays : int
        Rays from each side.
    seed : int
    cut : LaunchConfig, optional
    should_stop : callable, optional
        Called between launches.
    moving : Moving, optional
        Then only `follow` and `direct` see the whole scene.
    """

    def __init__(
        self,
        device: Device,
        scene: FlatScene,
        rays: int,
        seed: int = 0,
        cut: LaunchConfig | None = None,
        should_stop: Callable[[], bool] | None = None,
        moving: Moving | None = None,
    ) -> None:
        settings = np.zeros(1, layout.dtype("Settings"))
        settings["seed"] = seed
        self.device = device
        self.rays = rays
        self.outside = 2 * scene.triangle_count
        self._has_lights = scene.light_count > 0
        self._worker = DeviceWorker(device, scene, settings, _FORM, cut, tree=moving.others if moving else None)
        any_buffer = self._worker.scene_arguments[0]
        nothing: list[Argument] = [*[any_buffer] * 4, *[np.uint32(0)] * 3]
        self._moving = moving.arguments if moving else nothing
        self._should_stop = should_stop

    def hits(self, sides: _Uints) -> _Uints:
        """Trace the rays of these sides.

        Parameters
        ----------
        sides : (r,) uint32

        Returns
        -------
        (r, rays) uint32
            Sides that they hit, or `outside`.

        Raises
        ------
        Stopped
        UsageError
            If there are more than 2**31 rays.
        """
        return self._all_rays("radiosity_rays", sides, self.rays)

    def hemicube(self, sides: _Uints, cells: NDArray[np.float32]) -> _Uints:
        """Trace rays through the cells of a hemicube at the centre of each of these sides.

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
            raise UsageError(
                f"{counted(len(sides), 'side')} of patches with {rays} rays each are too many; take fewer of either"
            )
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

    def follow(self, sides: _Uints, hits: Buffer, sent: NDArray[np.float32], kinds: NDArray[np.uint8]) -> Changes:
        """Trace only those rays that the step of the moving shape may have changed.

        Parameters
        ----------
        sides : (r,) uint32
        hits : Buffer
            (r, rays) uint32 before the step; updated in place.
        sent : (2 n + 1, 4) float32
            Radiance of each side.
        kinds : (2 n + 1,) uint8
            1 for sealed sides, 2 for those without a row.
        """
        device, worker, rows = self.device, self._worker, len(sides)
        program, words = worker.program("radiosity/update.cl"), -(-self.rays // 32)
        of, bits, places = (
            device.upload(sides),
            device.empty(4 * rows * words),
            device.upload(np.zeros(rows + 1, "<u4")),
        )

        def mark(first: int, count: int) -> None:
            span = [np.uint32(n) for n in (first, count, self.rays, words)]
            more = [*self._moving, of, *span, hits, bits, places]
            worker.launch(program, "radiosity_mark", worker.padded(count), more)

        self._slices(rows, 4096, mark)
        total = scan(device, places, rows + 1)
        which, was = device.empty(4 * total), device.empty(4 * total)
        shape = [np.uint32(n) for n in (rows, self.rays)]
        launch_each(device, program, "radiosity_list", rows, [bits, places, *shape, np.uint32(words), which])

        def trace(first: int, count: int) -> None:
            span = [np.uint32(n) for n in (first, count, self.rays)]
            worker.launch_over(program, "radiosity_listed", count, [*self._moving, of, which, *span, hits, was])

        self._slices(total, _FIRST_LAUNCH, trace)
        radiance, kind = device.upload(sent), device.upload(kinds)
        brought, counted = np.empty((rows, 4), np.float32), np.empty((rows, 4), np.int32)
        out = device.empty(brought.nbytes), device.empty(counted.nbytes)
        launch_each(
            device, program, "radiosity_changes", rows, [which, was, hits, places, shape[0], radiance, kind, *out]
        )
        device.read(out[0], brought)
        device.read(out[1], counted)
        self._release(of, bits, places, which, was, radiance, kind, *out)
        followed, covered, unknown = counted[:, :3].astype(np.int64).T
        return Changes(brought[:, :3].astype(np.float64) / self.rays, covered, int(followed.sum()), bool(unknown.any()))

    def direct(self, sides: _Uints, samples: int, known: PreviousDirectLight | None = None) -> tuple[_Floats, _Uints]:
        """Direct irradiance from the lights that shadow rays sample.

        Parameters
        ----------
        sides : (r,) uint32
        samples : int
            Shadow rays from each side, at most 32.
        known : PreviousDirectLight, optional
            Results before the step of the moving shape, to update only what it may have changed.

        Returns
        -------
        irradiance : (r, 3) float64, W/m²
        seen : (r,) uint32
            A bit for each unoccluded sample.
        """
        result, bits = np.zeros((len(sides), 3), np.float32), np.zeros(len(sides), np.uint32)
        lights = np.zeros((1, 6), np.float32)
        if known is not None:
            result, bits, lights = known.irradiance.astype(np.float32), known.seen.copy(), known.lights
        if self._has_lights and len(sides):
            device, program = self.device, self._worker.program("radiosity/direct.cl")
            around, of = device.upload(lights), device.upload(sides)
            out, kept = device.upload(result), device.upload(bits)
            boxes: list[Argument] = [around, np.uint32(0 if known is None else len(lights))]

            def launch(first: int, count: int) -> None:
                span = [np.uint32(n) for n in (first, count, samples)]
                more = [*self._moving, of, *span, *boxes, kept, out]
                self._worker.launch_over(program, "radiosity_direct", count, more)

            self._slices(len(sides), 4096, launch)
            device.read(out, result)
            device.read(kept, bits)
            self._release(around, of, out, kept)
        return result.astype(np.float64), bits

    def _slices(self, total: int, first: int, launch: Callable[[int, int], None]) -> None:
        """Launch over slices of `total` items, each of about `_LAUNCH_SECONDS`."""
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
        """Release the device's memory."""
        self._worker.release()
