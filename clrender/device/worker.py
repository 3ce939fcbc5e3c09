"""Worker for one render on one device: renders units of work, in launches short enough to be stopped."""

from __future__ import annotations

import hashlib
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.device.device_film import DeviceFilm
from clrender.device.kernel_build import kernel_build
from clrender.device.launch import LaunchConfig, Scratch
from clrender.device.preparation import DevicePreparation, SplattingPreparation
from clrender.device.replicates import ReplicateSums
from clrender.device.scene_arrays import SceneArrays, scene_array_names
from clrender.device.staged import StagedTracing
from clrender.device.tracing_program import TracingProgram
from clrender.errors import RenderError
from clrender.film.held import FilmCopy, HeldUnit
from clrender.film.unit import BLOCK_SLOTS, Unit, UnitSums
from clrender.flatten.flat_box import around_box, scene_box
from clrender.integrators.descriptor import Pipeline
from clrender.integrators.path import INTEGRATOR as PATH

if TYPE_CHECKING:
    from clrender.device.bvh import Bvh
    from clrender.device.device import Argument, Buffer, Device, Program, Reading
    from clrender.film import Film
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["DeviceWorker", "probe_hash"]

_SHORT_SECONDS: Final = 0.005

_GPU_FILL: Final = 300_000
_UNIT_THREADS: Final = 2048
_SAMPLES_BYTES: Final = (96 << 20, 512 << 20)
"""Most bytes of the samples of a slice: on a CPU, or a device with little memory, and on a GPU with much."""
_SAMPLES_SHARE: Final = 16
"""The part of a GPU's memory that the samples of a slice may be, where that is more than on a CPU."""
_STATS_BYTES: Final = 16
"""Bytes of statistics per work-item."""
_TOTALS: Final = 4096
"""Rows of statistics that the host reads at most; more work-items are summed up on the device."""
_OF_SLICES: Final = ("samples", "records", "stats", "totals")
"""Names of the buffers of a slice."""
_MOST_SAMPLES_PER_PASS: Final = (16, 64)
"""Most samples per pixel of a launch: on a CPU, and on a GPU, where ever fewer paths are left towards its end."""

_SHORT_LOOPS: Final = ("rusticl",)
"""Platforms that end loops after 65,535 iterations (llvmpipe, which counts the iterations of all loops of a work-item).
A work-item then gets only one sample; if even that is not written, it counts as not finite."""


@dataclass(frozen=True)
class _Slice:
    """A launch in progress.

    Attributes
    ----------
    part : Unit
        Part of the unit that it renders.
    reading : Reading
        Reading of its statistics, (work-items, 4) uint32, or sums over some work-items each, (n, 4) uint64.
    rays : int
        Rays that were traced to prepare it.
    begin : float
        Time when it was enqueued.
    """

    part: Unit
    reading: Reading
    rays: int
    begin: float


class DeviceWorker:
    """A scene and its settings on one device.

    Parameters
    ----------
    device : Device
    scene : FlatScene
    settings : (1,) `Settings`
        Fields that depend on the scene are filled in here.
    pipeline : Pipeline
    launch : LaunchConfig
    prepare : callable, optional
        Called with this worker; creates the pipeline's additional data.
    tree : Bvh, optional
        BVH over a part of the scene, for pipelines whose kernels handle the rest; the caller still owns it.
    arrays : SceneArrays, optional
        The scene if it is already on the device; the caller still owns it.
    scratch : Scratch, optional
        Buffers to reuse; the caller still owns them.

    Attributes
    ----------
    lanes : int
        Paths per work-item, in SIMD fashion, of what is launched by `launch`.
    build_seconds : float
        Time of the upload and the BVH build.
    busy_seconds : float
        Time in launches, including waiting for them.

    Raises
    ------
    RenderError, DeviceError
        When the device lacks the memory, or its driver fails. Everything is then released from the device.
    """

    def __init__(
        self,
        device: Device,
        scene: FlatScene,
        settings: npt.NDArray[np.void],
        pipeline: Pipeline = PATH.pipeline,
        launch: LaunchConfig | None = None,
        prepare: Callable[[DeviceWorker], DevicePreparation] | None = None,
        *,
        tree: Bvh | None = None,
        arrays: SceneArrays | None = None,
        scratch: Scratch | None = None,
    ) -> None:
        launch = launch or LaunchConfig()
        self.device = device
        self.busy_seconds = 0.0
        self._owned = ExitStack()
        with ExitStack() as undone:
            undone.callback(self._owned.close)
            begin = time.perf_counter()
            self._arrays = arrays or SceneArrays(device, scene, tree)
            if arrays is None:
                self._owned.callback(self._arrays.release)
            self._scratch = scratch or Scratch(device)
            if scratch is None:
                self._owned.callback(self._scratch.release)
            self._settings = settings.copy()
            self._settings["triangle_count"] = scene.triangle_count
            self._settings["primitive_count"] = scene.triangle_count + scene.analytic_count
            self._settings["light_count"] = scene.light_count
            self._settings["environment"] = scene.environment
            self._settings["light_levels"] = scene.light_levels
            self._settings["has"] = scene.features.stated(self._arrays.masked_tree is not None)
            if pipeline.splats:
                self._settings["bounds"] = around_box(*scene_box(scene))[0]
            self._settings["lights_equal"] = bool((scene.arrays["lights"]["alias_threshold"] >= 1.0).all())
            self._settings_buffer = self._scratch.buffer("settings", self._settings.nbytes)
            device.write(self._settings_buffer, self._settings)
            self.build_seconds = time.perf_counter() - begin
            table = self._arrays.chain_table() if settings["specular_chains"][0] else None
            build = partial(
                kernel_build,
                device,
                self._arrays,
                scene.features,
                self._settings,
                pipeline,
                launch=launch,
                chains=table is not None,
            )
            # What an integrator prepares is compiled for the scene, and must agree with the rest
            staged = launch.staged and pipeline.staged
            stand_ins = launch.stand_ins and not staged
            any_scene = (stand_ins or (launch.code == "any" and not prepare)) and not scene.features.rare
            any_scene = any_scene and not settings["spectral"][0]
            universal = build(universal=True) if any_scene else None
            self._own = universal if universal and launch.code == "any" else build()
            self._preparing = build(launch=launch.prepared) if launch.prepared else self._own
            self.lanes = self._preparing.lanes
            self._per_pass = launch.samples_per_pass
            self._samples = launch.compiled_for
            self._prepared_samples = (launch.prepared or launch).compiled_for
            self._slice_seconds = launch.slice_seconds
            platform = device.info.platform.lower()
            self._short_loops = any(name in platform for name in _SHORT_LOOPS)
            self._pipeline = pipeline
            self._tracing: TracingProgram | StagedTracing
            if staged:
                paths, group = _staged_paths(device), self._own.group
                self._tracing = StagedTracing(device, self._own.tracing, group, self._samples, paths)
                self._owned.callback(self._tracing.release)
            else:
                stands_in = universal if launch.code is None else None
                self._tracing = TracingProgram(device, pipeline, self._own, stands_in, self._samples)
            self._common = self._accumulate = device.common_program()
            if pipeline.splats:
                self._accumulate = device.program("film/accumulate.cl", {"LANES": 1, "SPLATS": 1})
            self._splats: list[Buffer | np.generic] = []
            replicate_spp = int(settings["replicate_spp"][0]) if pipeline.squares else 0
            self._replicates = ReplicateSums(device, self._scratch, replicate_spp) if replicate_spp else None
            self._film: DeviceFilm | None = None
            self._owned.callback(self._release_film)
            self._film_version: object | None = None
            self._alike = pipeline.entry, _but_seed(self._settings)
            self._rate = self._arrays.rates.get(self._alike, 0.0)
            self._done_at = 0.0
            self._rays = 0
            self._records: list[npt.NDArray[np.uint32]] = []
            self._brought: list[npt.NDArray[np.uint32]] = []
            named = {**self._arrays.buffers, "settings": self._settings_buffer}
            if settings["spectral"][0]:
                first, count = divmod(int(settings["bands"][0]), 1024)
                named |= self._arrays.spectral((first, count) if count else None, scene.film)
            if table is not None:
                named["chain_table"] = table
            self.scene_arguments = [named[name] for name in scene_array_names()]
            self._preparation = prepare(self) if prepare else None
            if self._preparation:
                self._owned.callback(self._preparation.release)
            undone.pop_all()

    def program(self, entry: str, more: Mapping[str, int | str] | None = None) -> Program:
        """Build a kernel file that reads the scene, for this scene and launch configuration, with `more` macros."""
        return self.device.program(entry, {**self._preparing.macros, **(more or {})}, self._prepared_samples)

    def padded(self, items: int) -> int:
        """Round a number of work-items up to whole groups."""
        return _padded(items, self._preparing.group)

    def launch(self, program: Program, kernel: str, items: int, arguments: Sequence[Argument]) -> None:
        """Launch a kernel over a padded number of work-items; the scene's arguments come first."""
        self.device.launch(program, kernel, items, self._preparing.group, [*self.scene_arguments, *arguments])

    def launch_beside(self, kernel: str, items: int, arguments: Sequence[Argument]) -> None:
        """Launch another kernel of the tracing program, over unpadded work-items."""
        program, group = self.device.program(self._pipeline.entry, self._own.tracing, self._samples), self._own.group
        self.device.launch(program, kernel, _padded(items, group), group, [*self.scene_arguments, *arguments])

    @property
    def lists_splats(self) -> bool:
        """Whether the splats into its pixel are to be listed one by one."""
        return self._pipeline.splats and self._pipeline.reads_records

    def launch_over(self, program: Program, kernel: str, count: int, arguments: Sequence[Argument]) -> None:
        """Launch a kernel over `count` elements, one per lane; the scene's arguments come first."""
        self.launch(program, kernel, self.padded(-(-count // self.lanes)), arguments)

    def render(
        self,
        unit: Unit,
        on_slice: Callable[[int, int], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> UnitSums:
        """Trace the samples of a unit, in slices of about `LaunchConfig.slice_seconds`.

        Parameters
        ----------
        unit : Unit
        on_slice : callable, optional
            Called after each slice with its numbers of samples and rays.
        should_stop : callable, optional
            Called between slices. If it returns True, the result so far is returned.

        Raises
        ------
        RenderError
            When the driver fails.
        """
        if self._pipeline.apart:
            return self._apart(unit, on_slice, should_stop)
        traced, sums, counts = self._traced(unit, on_slice, should_stop)
        done, slots = traced.done, unit.slot_count
        read = self._read(sums, counts, slots)
        squares = None if self._replicates is None else self._replicates.read(*read, done)
        records = np.concatenate(self._records) if self._records else None
        splats = np.stack(self._brought) if self._brought else None
        counted = traced.rays, traced.shadow_rays, traced.deepest
        listed = self._preparation.take_splats() if isinstance(self._preparation, SplattingPreparation) else None
        return UnitSums(*read, done, *counted, squares, records=records, splats=splats, listed=listed)

    def recorded_splats(self, listed: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """Trace light paths of `UnitSums.listed` again, and write them down.

        Returns
        -------
        (n, `INSPECT_ROWS`, `INSPECT_WORDS`) uint32
        """
        assert isinstance(self._preparation, SplattingPreparation), "there are splats"
        return self._preparation.recorded_splats(listed)

    def hold(self, film: Film) -> bool:
        """Prepare for `render_held`, with the samples of a film; False if the device has not memory to spare for it."""
        if self._film is not None and self._film_version is film.version:
            return True
        self._release_film()
        if film.pixel_bytes * film.width * film.height > self.device.free_bytes / 4:
            return False  # slices and units need some, too
        try:
            self._film = DeviceFilm(self.device, self._settings_buffer, film)
        except RenderError:
            return False
        return True

    def render_held(
        self,
        unit: Unit,
        on_slice: Callable[[int, int], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> HeldUnit:
        """Trace the samples of a unit like `render`, and add their sums to those that are held on the device."""
        assert self._film is not None, "it is prepared"
        self._film_version = None
        traced, sums, counts = self._traced(unit, on_slice, should_stop)
        squares = None
        if self._replicates is not None:
            squares = self._replicates.cut(sums, counts, traced.done)
        self._film.add(unit, sums, counts, squares)
        return traced

    def copy_held(self, *, sums: bool, image: bool, last: bool) -> FilmCopy:
        """Copy what is held on the device; see `DeviceFilm.copy`."""
        assert self._film is not None, "it is prepared"
        copy = self._film.copy(sums=sums, image=image, last=last)
        self._film_version = copy.version
        if last:
            self._release_film()
        return copy

    def _release_film(self) -> None:
        if self._film is not None:
            self._film.release()
            self._film = None

    def _traced(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> tuple[HeldUnit, Buffer, Buffer]:
        """Trace the samples of a unit; returns its result, and the buffers of its sums and counts."""
        slots = unit.slot_count
        sums, counts = self._scratch.buffer("sums", 48 * slots), self._scratch.buffer("counts", 4 * slots)
        self._launch(self._common, "film_clear", slots, [sums, counts, np.uint32(slots)])
        if self._replicates is not None:
            begun = self._replicates.begin(slots, unit.first_sample)
            self._launch(self._common, "film_clear_replicates", slots, begun)
        if isinstance(self._preparation, SplattingPreparation):
            splats = self._scratch.buffer("splats", 48 * slots)
            self._launch(self._accumulate, "film_clear_splats", slots, [splats, np.uint32(slots)])
            self._preparation.begin_unit(unit, splats)
            self._splats = [splats]

        def add(part: Unit, samples: Buffer) -> None:
            if self._pipeline.reads_records:
                self._read_records(part)
            self._accumulated(part, samples, part.first_slot - unit.first_slot, sums, counts)

        self._records.clear()
        self._brought.clear()
        return self._in_slices(unit, add, on_slice, should_stop), sums, counts

    def _read_records(self, part: Unit) -> None:
        """Read what the kernel has written about the samples of one pixel, and what light paths have brought to it."""
        found = np.empty((part.sample_count, self._pipeline.record_bytes // 4), np.uint32)
        self.device.read(self._scratch.buffer("records", found.nbytes), found)
        self._records.append(found)
        if self._pipeline.splats:  # one sample: the film takes them next, and clears them
            brought = np.empty((part.slot_count, 3, 4), np.uint32)
            self.device.read(self._scratch.buffer("splats", brought.nbytes), brought)
            self._brought.append(brought[0])

    def _apart(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        """Trace the samples of a unit, and read each of them."""
        found = np.full((unit.sample_count, 3, unit.slot_count), np.nan, np.float32)

        def read(part: Unit, samples: Buffer) -> None:
            some = np.empty((part.sample_count, 3, part.slot_count), np.float32)
            self.device.read(samples, some)
            slot, sample = part.first_slot - unit.first_slot, part.first_sample - unit.first_sample
            found[sample : sample + part.sample_count, :, slot : slot + part.slot_count] = some

        traced = self._in_slices(unit, read, on_slice, should_stop)
        none = np.zeros((0, 3, 4), np.uint32), np.zeros(0, np.uint32)
        return UnitSums(*none, traced.done, traced.rays, traced.shadow_rays, traced.deepest, samples=found)

    def _in_slices(
        self,
        unit: Unit,
        take: Callable[[Unit, Buffer], None],
        on_slice: Callable[[int, int], None] | None,
        should_stop: Callable[[], bool] | None,
    ) -> HeldUnit:
        """Trace the samples of a unit; `take` is called with each slice and the buffer of its samples."""
        self._tracing.improve(self._rays)
        slots = unit.slot_count
        columns, rows = (
            int(self._settings[side][0] - self._settings[f"less_{side}"][0]) for side in ("width", "height")
        )
        rows = int(self._settings["views"][0] * self._settings["view_rows"][0]) or rows
        pixels = unit.pixels(columns, rows)
        done = np.zeros(slots // BLOCK_SLOTS, np.uint32)
        counted = np.zeros(3, np.int64)
        flying: deque[_Slice] = deque()

        def land() -> None:
            """Wait for the oldest slice in progress, and count its samples and rays."""
            each = flying.popleft()
            rays, shadow_rays, deepest = self._landed(each)
            first = each.part.first_slot - unit.first_slot
            blocks = slice(first // BLOCK_SLOTS, (first + each.part.slot_count) // BLOCK_SLOTS)
            done[blocks] += np.uint32(each.part.sample_count)
            counted[:] = counted[0] + rays, counted[1] + shadow_rays, max(counted[2], deepest)
            if on_slice is not None:
                on_slice(int(pixels[blocks].sum()) * each.part.sample_count, rays)

        for part in self._parts_of(unit):
            if should_stop is not None and should_stop():
                break
            flying.append(self._launched(part, take))
            while len(flying) > self._most_flying():
                land()
        while flying:
            land()
        rays, shadow_rays, deepest = counted.tolist()
        self._rays += rays
        return HeldUnit(done, rays, shadow_rays, deepest)

    def _parts_of(self, unit: Unit) -> Iterator[Unit]:
        """Divide a unit into slices, each sized by the device's speed as known when it is launched."""
        finished = 0
        while finished < unit.sample_count:
            passes = self._passes(unit.slot_count, unit.sample_count - finished)
            start = 0
            while start < unit.slot_count:
                length = self._slice_slots(unit.slot_count - start, passes)
                yield Unit(unit.first_slot + start, length, unit.first_sample + finished, passes, unit.tile)
                start += length
            finished += passes

    def _most_flying(self) -> int:
        """Slices that may be in progress when the next is launched, so that the device need not wait for the host."""
        waits = self._pipeline.sample_by_sample or self._tracing.waits
        return 0 if self._rate == 0.0 or waits or self._short_loops else 1

    def _read(self, sums: Buffer, counts: Buffer, slots: int) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]:
        result = np.empty((slots, 3, 4), np.uint32), np.empty(slots, np.uint32)
        self.device.read(sums, result[0])
        self.device.read(counts, result[1])
        return result

    def _launched(self, part: Unit, take: Callable[[Unit, Buffer], None]) -> _Slice:
        """Enqueue the launches of a slice; then its samples are taken."""
        device = self.device
        more, rays = self._prepared(part.first_sample)
        begin = time.perf_counter()
        rows = self._tracing.rows(part.slot_count, part.sample_count)
        samples = self._scratch.buffer("samples", 12 * part.slot_count * part.sample_count)
        stats = self._scratch.buffer("stats", _STATS_BYTES * rows)
        if self._short_loops:
            device.write(samples, np.full(3 * part.slot_count * part.sample_count, np.nan, np.float32))
        span = [
            np.uint32(number) for number in (part.first_slot, part.slot_count, part.first_sample, part.sample_count)
        ]
        if self._pipeline.record_bytes:
            record_bytes = self._pipeline.record_bytes * part.slot_count * part.sample_count
            more.append(self._scratch.buffer("records", record_bytes))
        self._tracing.trace(self.scene_arguments, span, samples, stats, more)
        take(part, samples)
        return _Slice(part, self._begin_stats(stats, rows), rays, begin)

    def _accumulated(self, part: Unit, samples: Buffer, start: int, sums: Buffer, counts: Buffer) -> None:
        """Enqueue the accumulation of the samples of a slice, which begins at a slot of the unit."""
        head: list[Buffer | np.generic] = [
            self._settings_buffer,
            samples,
            np.uint32(part.first_slot),
            np.uint32(part.slot_count),
        ]
        tail: list[Buffer | np.generic] = [np.uint32(part.sample_count), np.uint32(start), sums, counts]
        if self._replicates is None:
            self._launch(self._accumulate, "film_accumulate", part.slot_count, [*head, *tail, *self._splats])
        else:
            tail = [np.uint32(part.first_sample), *tail, *self._replicates.buffers, *self._splats]
            self._launch(self._accumulate, "film_accumulate_replicates", part.slot_count, [*head, *tail])

    def _begin_stats(self, stats: Buffer, items: int) -> Reading:
        """Enqueue the reading of a launch's statistics; many of them are first summed up."""
        if items <= _TOTALS:
            return self.device.begin_read(stats, np.empty((items, 4), np.uint32))
        totals = self._scratch.buffer("totals", 32 * _TOTALS)
        arguments: list[Buffer | np.generic] = [stats, np.uint32(items), totals, np.uint32(_TOTALS)]
        self._launch(self._common, "film_total_stats", _TOTALS, arguments)
        return self.device.begin_read(totals, np.empty((_TOTALS, 4), np.uint64))

    def _landed(self, part: _Slice) -> tuple[int, int, int]:
        """Wait for a slice; returns its rays of all kinds, its shadow rays and its deepest path."""
        self.device.end_read(part.reading)
        now = time.perf_counter()
        # The queue is in-order: the slice began when the one before it was done
        seconds = now - max(part.begin, self._done_at)
        self._done_at = now
        self.busy_seconds += seconds
        rate = part.part.slot_count * part.part.sample_count / max(seconds, 1e-4)
        # A very short launch, such as a spot check, does not show that the device is slow
        self._rate = rate if seconds > _SHORT_SECONDS else max(rate, self._rate)
        self._arrays.rates[self._alike] = self._rate
        rays, shadow_rays, deepest = (part.reading.array[:, column] for column in range(3))
        shadows = int(shadow_rays.sum(dtype=np.uint64))
        return part.rays + int(rays.sum(dtype=np.uint64)) + shadows, shadows, int(deepest.max())

    def _prepared(self, sample: int) -> tuple[list[Argument], int]:
        """Additional arguments for the pipeline's kernel, and the number of rays traced to prepare them."""
        if self._preparation is None:
            return [], 0
        if self.device.memory_limit is not None and self._pipeline.sample_by_sample:
            self._scratch.give_back(*_OF_SLICES)  # the preparation may need their memory
        begin = time.perf_counter()
        arguments = list(self._preparation.arguments(sample))
        self.busy_seconds += time.perf_counter() - begin
        return arguments, self._preparation.take_rays()

    def _passes(self, slots: int, left: int) -> int:
        """Samples per pixel in the next launches."""
        if self._pipeline.sample_by_sample or self._short_loops:
            return 1
        if self._per_pass is not None:
            return min(self._per_pass, left)
        if self._rate == 0.0:
            return 1
        most = _MOST_SAMPLES_PER_PASS[not self.device.is_cpu]
        full = min(slots, _fill(self.device))
        in_time, in_room = self._rate * self._slice_seconds / full, self._room() / (self._sample_bytes * full)
        return max(1, min(left, most, int(in_time), int(in_room)))

    @property
    def _sample_bytes(self) -> int:
        """Memory of a sample in a launch, bytes."""
        return 12 + self._pipeline.record_bytes

    def _slice_slots(self, left: int, passes: int) -> int:
        """Slots of the next launch, by the measured speed; the first launch is small, to measure it.

        Where several launches are needed they are of one size: a small one would not fill the device.
        """
        wanted = self._rate * self._slice_seconds / passes
        room = self._room() // (self._sample_bytes * passes + _STATS_BYTES)
        most = max(256, int(room) // 16 * 16)
        if not self._rate:
            return min(left, most, 4096)
        launches = max(round(left / max(256.0, wanted)), -(-left // most), 1)
        return min(left, -(-left // launches // 16) * 16)

    def _room(self) -> int:
        """Bytes available for the buffers of a slice."""
        most, much = _SAMPLES_BYTES
        if not self.device.is_cpu:
            most = min(max(most, self.device.info.memory_bytes // _SAMPLES_SHARE), much)
        if self.device.memory_limit is None:
            return min(most, self.device.max_allocation_bytes)
        # One half is for the slice, the other for the sums of the next unit, which may be larger
        free = self.device.free_bytes + self._scratch.held(*_OF_SLICES, "sums", "counts")
        return int(min(most, self.device.max_allocation_bytes, free * 15 / 32))

    def _launch(self, program: Program, kernel: str, count: int, arguments: list[Buffer | np.generic]) -> None:
        self.device.launch_each(program, kernel, count, arguments)

    def release(self) -> None:
        """Release everything that the worker allocated on the device."""
        self._owned.close()


def _but_seed(settings: npt.NDArray[np.void]) -> bytes:
    """The settings on which the speed depends."""
    same = settings.copy()
    same["seed"] = 0
    return same.tobytes()


def _padded(items: int, group: int) -> int:
    return -(-items // group) * group


def _fill(device: Device) -> int:
    """Slots of a launch that fully occupy the device; above it, more samples per pixel are better than more slots.

    A GPU hides memory latency with many threads: two thousand on each compute unit.
    """
    return 4096 if device.is_cpu else max(_GPU_FILL, _UNIT_THREADS * device.info.compute_units)


def _staged_paths(device: Device) -> int:
    """Paths under way at a time in stages: as many as fully occupy the device."""
    return _fill(device)


def probe_hash(device: Device, codes: Sequence[str] = ("fast", "small")) -> str:
    """SHA-256 of a small tile of a fixed scene, rendered with the real kernels and the device's default configuration.

    The scene is the built-in room: triangles, spheres, every material, area lights, indirect light of any depth.

    Parameters
    ----------
    device : Device
    codes : sequence of str
        Kinds of code, of a device that has both.

    Returns
    -------
    str
        Hexadecimal digits; the same on every device that computes correctly. Where fast and small code disagree, both.

    Raises
    ------
    RenderError, DeviceError
        When the driver fails.
    """
    from clrender.flatten.flat_scene import flatten
    from clrender.scene import load

    size, spp = 16, 4
    settings = np.zeros(1, layout.dtype("Settings"))
    for name, value in {
        "width": size, "height": size, "tile": size, "shadow_rays": 1, "indirect_rays": 1, "max_depth": layout.NONE,
        "roulette": layout.ROULETTE_THROUGHPUT, "light_samples": 1, "bsdf_samples": 1,
    }.items():  # fmt: skip
        settings[name] = value
    scene, found = flatten(load("room"), size, size), set[str]()
    for code in codes if device.compiles_small_code else ("fast",):
        worker = DeviceWorker(device, scene, settings, launch=LaunchConfig(code=code))
        result = worker.render(Unit(0, size * size, 0, spp, size))
        worker.release()
        data = result.sums.astype("<u4").tobytes() + result.counts.astype("<u4").tobytes()
        found.add(hashlib.sha256(data).hexdigest())
    return " and ".join(sorted(found))
