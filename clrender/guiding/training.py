"""Training of the guiding field: rounds of paths on all devices, whose sums are integers and do not depend on them."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender import layout
from clrender.errors import DeviceError, RenderError
from clrender.film.fixed_point import to_float64
from clrender.film.unit import BLOCK_SLOTS, Unit, UnitSums, slot_count, tile_side
from clrender.flatten.flat_box import scene_box
from clrender.guiding.field import GuidingField, empty_field
from clrender.guiding.octree import Growing, Sums
from clrender.integrators.descriptor import Pipeline

if TYPE_CHECKING:
    from clrender.device.device import Argument, Device
    from clrender.device.prepared import Request
    from clrender.device.worker import DeviceWorker

__all__ = ["PIPELINE", "FieldSums", "Trained", "train"]

PIPELINE: Final = Pipeline(
    "guiding/training.cl",
    "training_clear",
    ("training_trace", "training_add_all"),
    record_bytes=4 * layout.RECORD_EVENTS * layout.RECORD_WORDS,
    packets=8,
    squares=False,
)
_MOST_PIXELS: Final = 1 << 14
"""Pixels of the image that training paths begin in: larger images are trained with fewer."""
_ROUNDS: Final = (2, 2, 4, 8)
"""Batches of each round. All are of as many samples of each pixel."""
_PLAIN_ROUNDS: Final = 2
"""Rounds whose paths are not guided: the first has no cells, and those of the second know nothing yet."""
_BYTES_OF_CELL: Final = 4 * layout.FIELD_WORDS + 8 * layout.TRAINING_SUMS + 256
"""Memory on a device while a cell is trained, with its part of the nodes."""
_LUMINANCE: Final = np.array([0.2126, 0.7152, 0.0722])
_SEED_FACTOR: Final = 747796405
_SEED_TERM: Final = 2891336453
"""The seed of training: that of the image, times and plus these."""
_HOPELESS: Final = 0.8
"""Gain of the first guided round below which ``auto`` trains no further."""
_POLL_SECONDS: Final = 0.05
_GUIDED_COST: Final = 1.2
"""How much longer a ray of a guided path takes than another."""


@dataclass(frozen=True)
class Trained:
    """A field, and what its training has found.

    Attributes
    ----------
    field : GuidingField
    paths, rays : int
        Of the training.
    gain : float
        Estimate of how many times as much an unguided render costs for the same error, in rays; 1 if unknown.
    """

    field: GuidingField
    paths: int
    rays: int
    gain: float


@dataclass(frozen=True)
class _Found:
    """What a part of a round gave: the luminance of each slot, how often it was sampled, and the rays."""

    luminance: npt.NDArray[np.float64]
    counts: npt.NDArray[np.int64]
    rays: int


class FieldSums:
    """A field and the sums of a round on a device: what kernels of training take besides the scene.

    Parameters
    ----------
    device : Device
    field : GuidingField
    scale : float
        The inverse of the image's mean luminance.
    """

    def __init__(self, device: Device, field: GuidingField, scale: float) -> None:
        self._device = device
        self._sums = np.zeros((len(field.cells), layout.TRAINING_SUMS, 2), np.uint32)
        self._records = np.zeros((len(field.nodes), 8), np.uint32)
        self._held = [device.upload(array) for array in (field.nodes, field.cells, self._sums, self._records)]
        nodes, cells, sums, records = self._held
        self._arguments: list[Argument] = [nodes, cells, field.frame, sums, records, np.float32(scale)]

    def arguments(self, sample: int) -> Sequence[Argument]:
        """The same for all samples."""
        return self._arguments

    def take_rays(self) -> int:
        """None."""
        return 0

    def read(self) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.int64]]:
        """The sums of cells, (c, `TRAINING_SUMS`), and the records of places, (n, 8)."""
        self._device.read(self._held[2], self._sums)
        self._device.read(self._held[3], self._records)
        words = self._sums.astype(np.uint64)
        return words[..., 0] + (words[..., 1] << np.uint64(32)), self._records.astype(np.int64)

    def release(self) -> None:
        """Release the device memory."""
        held, self._held = self._held, []
        for buffer in held:
            self._device.release(buffer)


class _Current:
    """Stands for the buffers of the round in a worker, which stays from round to round."""

    def __init__(self) -> None:
        self.current: FieldSums | None = None

    def arguments(self, sample: int) -> Sequence[Argument]:
        return self.current.arguments(sample) if self.current is not None else []

    def take_rays(self) -> int:
        return 0

    def release(self) -> None:
        current, self.current = self.current, None
        if current is not None:
            current.release()


class _Crew:
    """The devices that train; those that fail are left out, and what they did is done again."""

    def __init__(self, request: Request, settings: npt.NDArray[np.void]) -> None:
        self._request, self._settings = request, settings
        self._current = {device: _Current() for device in request.devices}
        self._workers: dict[Device, DeviceWorker] = {}
        self._stopped = False

    def round(self, field: GuidingField, scale: float, units: Sequence[Unit]) -> tuple[Sums, dict[Unit, UnitSums]]:
        """Trace the paths of units, all with the same field."""
        cells, records = (
            np.zeros((len(field.cells), layout.TRAINING_SUMS), np.uint64),
            np.zeros((len(field.nodes), 8), np.int64),
        )
        done: dict[Unit, UnitSums] = {}
        while left := [unit for unit in units if unit not in done]:
            waiting = deque(left)
            with ThreadPoolExecutor(len(self._current)) as pool:
                running = {pool.submit(self._work, device, field, scale, waiting): device for device in self._current}
                try:
                    while any(not each.done() for each in running):
                        wait(running, _POLL_SECONDS, FIRST_COMPLETED)
                        self._stopped = self._stopped or self._request.should_stop()
                except BaseException:
                    self._stopped = True  # the pool waits for the devices
                    raise
            failures: list[RenderError | DeviceError] = []
            for each, device in running.items():
                try:
                    part, counted, of_units = each.result()
                except (RenderError, DeviceError) as error:
                    failures.append(error)
                    self._leave_out(device, error)
                else:
                    cells += part
                    records += counted
                    done |= of_units
            if failures and not self._current:
                raise failures[-1]
            if self._stopped:
                break
        return Sums(cells.astype(np.float64), records), done

    @property
    def stopped(self) -> bool:
        """Whether the render is to stop; what was found is then not complete."""
        return self._stopped

    def _work(
        self, device: Device, field: GuidingField, scale: float, waiting: deque[Unit]
    ) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.int64], dict[Unit, UnitSums]]:
        slot = self._current[device]
        slot.current = FieldSums(device, field, scale)
        try:
            worker = self._workers.get(device)
            if worker is None:
                worker = self._workers[device] = self._request.worker(device, self._settings, PIPELINE, lambda _: slot)
            done = {}
            while waiting and not self._stopped:
                try:
                    unit = waiting.popleft()
                except IndexError:  # another thread took the last one
                    break
                done[unit] = worker.render(unit, None, lambda: self._stopped)
            return *slot.current.read(), done
        finally:
            current, slot.current = slot.current, None
            current.release()

    def _leave_out(self, device: Device, error: Exception) -> None:
        self._request.notify(f"warning: {error}; guiding is trained without it, if there is another device")
        self._workers.pop(device, None)
        del self._current[device]

    def release(self) -> None:
        for worker in self._workers.values():
            worker.release()
        self._workers = {}


def train(request: Request) -> Trained:
    """Train a field; its bits are a function of the scene, the settings and the kernels alone.

    Paths begin in an image of the same view with at most 2^14 pixels, whose seed is another one. In each round the
    field guides paths, and is then replaced by what they have found (Müller, Gross and Novák 2017, section 3.3).

    Parameters
    ----------
    request : Request

    Returns
    -------
    Trained
        If the render was to stop, its field is of no use.

    Raises
    ------
    RenderError, DeviceError
        When all devices fail.
    """
    settings, width, height, samples = _training_settings(request)
    low, high = scene_box(request.flat)
    side = max(float((np.asarray(high, np.float64) - low).max()), 1e-6) * 1.0001
    growing = Growing(empty_field(low, side), max(request.settings.guiding_memory // _BYTES_OF_CELL, 8))
    tile = int(settings["tile"][0])
    crew, scale, first, rays = _Crew(request, settings), 1.0, 0, 0
    found: list[list[_Found]] = []
    try:
        for number, batches in enumerate(_ROUNDS):
            field = growing.field(final=False)
            begins = range(first, first + samples * batches, samples)
            units = [_units(width, height, tile, begin, samples, len(request.devices)) for begin in begins]
            sums, done = crew.round(field, scale, [unit for batch in units for unit in batch])
            if crew.stopped:
                return Trained(field, 0, 0, 1.0)
            found.append([_joined([done[unit] for unit in batch]) for batch in units])
            rays += sum(each.rays for each in found[-1])
            first += samples * batches
            growing.learn(sums)
            if number == _PLAIN_ROUNDS and request.settings.guiding == "auto" and _gain(found) < _HOPELESS:
                break
            if number + 1 < len(_ROUNDS):
                growing.grow(sums.records, _ROUNDS[number + 1] / batches)
            if number == 0:
                mean = _mean(found[0])
                scale = 1.0 / mean if mean > 0.0 else 1.0
    finally:
        crew.release()
    return Trained(growing.field(final=True), first * width * height, rays, _gain(found))


def _training_settings(request: Request) -> tuple[npt.NDArray[np.void], int, int, int]:
    """The kernels' settings for training, the size of its image, and the samples of a batch: a replicate."""
    wanted = request.settings
    shrunk = min(1.0, math.sqrt(_MOST_PIXELS / (wanted.width * wanted.height)))
    width, height = max(1, int(wanted.width * shrunk)), max(1, int(wanted.height * shrunk))
    settings = wanted.struct(tile_side(wanted.tile, width, height))
    settings["width"], settings["height"] = width, height
    for name in ("left", "top", "less_width", "less_height"):  # of a crop, which is guided like the whole image
        settings[name] = 0
    settings["seed"] = (wanted.seed * _SEED_FACTOR + _SEED_TERM) & 0xFFFFFFFF
    samples = wanted.guiding_paths // (width * height * sum(_ROUNDS))
    samples = 1 << max(samples.bit_length() - 1, 0)
    settings["replicate_spp"] = samples
    settings["filter_weight"], settings["filter_negative"] = 0.0, layout.FILTER_LINES
    settings["shadow_rays"] = settings["indirect_rays"] = 1
    settings["spectral"] = 0  # its numbers are luminances
    settings["light_samples"] = settings["light_samples"].clip(0, 1)
    settings["bsdf_samples"] = settings["bsdf_samples"].clip(0, 1)
    return settings, width, height, samples


def _units(width: int, height: int, tile: int, first: int, samples: int, devices: int) -> list[Unit]:
    """A batch, in parts that devices share."""
    slots = slot_count(width, height, tile)
    parts = 1 if devices == 1 else 4 * devices
    ends = [slots // BLOCK_SLOTS * k // parts * BLOCK_SLOTS for k in range(parts + 1)]
    pairs = itertools.pairwise(ends)
    return [Unit(begin, end - begin, first, samples, tile) for begin, end in pairs if end > begin]


def _joined(parts: Sequence[UnitSums]) -> _Found:
    sums = np.concatenate([part.sums for part in parts]).astype(np.uint64)
    low, high = (sums[..., k] + (sums[..., k + 1] << np.uint64(32)) for k in (0, 2))
    luminance = (to_float64(np.stack([low, high], axis=-1)) * _LUMINANCE).sum(axis=-1)
    counts = np.concatenate([part.counts for part in parts]).astype(np.int64)
    return _Found(luminance, counts, sum(part.rays for part in parts))


def _mean(found: Sequence[_Found]) -> float:
    """Mean luminance of the image."""
    total = math.fsum(itertools.chain.from_iterable(batch.luminance.tolist() for batch in found))
    return total / max(int(sum(batch.counts.sum() for batch in found)), 1)


def _gain(found: Sequence[Sequence[_Found]]) -> float:
    """How many times as much unguided paths cost as those of the last round, for the same error."""
    batches = [batch for each in found for batch in each]
    totals, counts = sum(batch.luminance for batch in batches), sum(batch.counts for batch in batches)
    of_blocks = np.asarray(totals).reshape(-1, BLOCK_SLOTS).sum(axis=1)
    mean = of_blocks / np.asarray(counts).reshape(-1, BLOCK_SLOTS).sum(axis=1).clip(1)
    floor = 0.1 * _mean(batches)
    weight = np.repeat(1.0 / np.maximum(np.square(mean) + floor * floor, 1e-300), BLOCK_SLOTS)
    unguided = [batch for each in found[:_PLAIN_ROUNDS] for batch in each]
    plain, guided = _cost(unguided, weight), _cost(found[-1], weight) * _GUIDED_COST
    return plain / guided if plain > 0.0 and guided > 0.0 else 1.0


def _cost(batches: Sequence[_Found], weight: npt.NDArray[np.float64]) -> float:
    """Rays of a batch times its relative variance: the batches of a round are independent, and stratified alike."""
    inside = np.all([batch.counts > 0 for batch in batches], axis=0)
    images = np.array([batch.luminance[inside] / batch.counts[inside] for batch in batches])
    squared = np.square(images - images.mean(axis=0)).sum(axis=0) / (len(batches) - 1)
    return math.fsum((squared * weight[inside]).tolist()) * sum(batch.rays for batch in batches) / len(batches)
