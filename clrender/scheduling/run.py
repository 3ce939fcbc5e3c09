"""Who computes which samples when: units, their queue, and what happens when a worker dies.

It knows workers by their interface only (`Worker`). No unit is lost: one whose worker failed goes back
into the queue for the others. The film does not depend on any of it, because its sums are exact.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.errors import ClrenderError, RenderError
from clrender.film import Film
from clrender.film.unit import Unit, UnitSums, Worker, tile_slots

__all__ = ["Plan", "Tally", "run"]

_UNIT_SLOTS: Final = 1 << 17
_LARGE_UNIT_SLOTS: Final = 1 << 23
_UNIT_SAMPLES: Final = 16
_UNREAD: Final = 8
"""Events that may wait to be dealt with: results are large, and a fast device must not pile up an image of them."""


@dataclass(frozen=True)
class Plan:
    """How an image is cut into units.

    Attributes
    ----------
    width, height, spp : int
    tile : int
        Side of a tile, a multiple of 4 (`clrender.film.unit.tile_side`).
    sample_by_sample : bool
        Units of one sample, as large as memory allows: the integrator computes something for all pixels of a sample.
    """

    width: int
    height: int
    spp: int
    tile: int
    sample_by_sample: bool = False

    def units(self) -> Iterator[Unit]:
        """All units: blocks of samples one after the other, so that the whole image refines, each tile by tile."""
        tiles = -(-self.width // self.tile) * -(-self.height // self.tile)
        area = self.tile * self.tile
        together = max(1, (_LARGE_UNIT_SLOTS if self.sample_by_sample else _UNIT_SLOTS) // area)
        samples = 1 if self.sample_by_sample else _UNIT_SAMPLES
        for sample in range(0, self.spp, samples):
            for tile in range(0, tiles, together):
                count = min(together, tiles - tile)
                yield Unit(tile * area, count * area, sample, min(samples, self.spp - sample))


@dataclass
class WorkerTally:
    """What one worker did."""

    name: str
    units: int = 0
    samples: int = 0
    requeued: int = 0


@dataclass
class Tally:
    """What a run came to.

    Attributes
    ----------
    samples, rays, shadow_rays, deepest : int
    complete : bool
        Every unit was done.
    workers : list of WorkerTally
        In the order given.
    failures : list of str
        What workers that died said.
    """

    samples: int = 0
    rays: int = 0
    shadow_rays: int = 0
    deepest: int = 0
    complete: bool = True
    workers: list[WorkerTally] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Event:
    worker: int
    unit: Unit | None = None
    result: UnitSums | None = None
    error: BaseException | None = None
    progress: tuple[int, int] | None = None


class _Queue:
    """Units still to be done, shared by the workers' threads. A worker waits while others may yet give units back."""

    def __init__(self, units: Iterator[Unit]) -> None:
        self._units = units
        self._returned: deque[Unit] = deque()
        self._out = 0
        self._changed = threading.Condition()

    def take(self) -> Unit | None:
        with self._changed:
            while True:
                unit = self._returned.popleft() if self._returned else next(self._units, None)
                if unit is not None:
                    self._out += 1
                    return unit
                if self._out == 0:
                    return None
                self._changed.wait()

    def done(self, give_back: Unit | None = None) -> None:
        with self._changed:
            self._out -= 1
            if give_back is not None:
                self._returned.append(give_back)
            self._changed.notify_all()


def run(
    plan: Plan,
    workers: Sequence[Worker],
    film: Film,
    on_progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Tally:
    """Have the workers do all units of a plan, and add them up on the film.

    Parameters
    ----------
    plan : Plan
    workers : sequence of Worker
        At least one; each gets a thread.
    film : Film
        Of the plan's size.
    on_progress : callable, optional
        Told, in the calling thread, how many samples and rays are done in all.
    should_stop : callable, optional
        Asked by the workers between launches; when it says yes, the film keeps what is done by then.

    Returns
    -------
    Tally

    Raises
    ------
    RenderError
        When every worker died; the message is the last one's.
    """
    units, events = _Queue(plan.units()), queue.Queue[_Event](_UNREAD)
    stop = threading.Event()

    def wanted() -> bool:
        return stop.is_set() or (should_stop is not None and should_stop())

    threads = [
        threading.Thread(target=_work, args=(number, worker, units, events, wanted), daemon=True)
        for number, worker in enumerate(workers)
    ]
    tally = Tally(workers=[WorkerTally(worker.name) for worker in workers])
    merge = _Merge(plan, film)
    seen = [0, 0]
    for thread in threads:
        thread.start()
    try:
        alive = len(threads)
        while alive:
            event = events.get()
            if event.progress is not None:
                seen = [seen[0] + event.progress[0], seen[1] + event.progress[1]]
                if on_progress is not None:
                    on_progress(*seen)
            elif event.unit is not None and event.result is not None:
                merge.add(event.unit, event.result)
                _count(tally, event.worker, event.result)
            else:
                alive -= 1
                if event.error is not None:
                    _bury(tally, event)
    finally:
        stop.set()
        _end(threads, events)
    if len(tally.failures) == len(workers):
        raise RenderError(tally.failures[-1])
    tally.complete = tally.complete and tally.samples == plan.width * plan.height * plan.spp
    return tally


def _end(threads: Sequence[threading.Thread], events: queue.Queue[_Event]) -> None:
    """Wait for the threads; nobody listens any more, but none may be kept waiting for that."""
    for thread in threads:
        while thread.is_alive():
            with contextlib.suppress(queue.Empty):
                while True:
                    events.get_nowait()
            thread.join(0.05)


def _work(
    number: int, worker: Worker, units: _Queue, events: queue.Queue[_Event], should_stop: Callable[[], bool]
) -> None:
    """Life of a worker's thread: take a unit, do it, say what came of it."""
    told = [0, 0]

    def on_slice(samples: int, rays: int) -> None:
        told[0] += samples
        told[1] += rays
        events.put(_Event(number, progress=(samples, rays)))

    error: BaseException | None = None
    while not should_stop() and error is None:
        unit = units.take()
        if unit is None:
            break
        told = [0, 0]
        try:
            result = worker.render(unit, on_slice, should_stop)
        except BaseException as problem:
            error = problem
            events.put(_Event(number, progress=(-told[0], -told[1])))
            units.done(give_back=unit)
        else:
            events.put(_Event(number, unit, result))
            units.done()
    events.put(_Event(number, error=error))


def _count(tally: Tally, worker: int, result: UnitSums) -> None:
    tally.samples += result.samples
    tally.rays += result.rays
    tally.shadow_rays += result.shadow_rays
    tally.deepest = max(tally.deepest, result.deepest)
    tally.complete = tally.complete and result.complete
    tally.workers[worker].units += 1
    tally.workers[worker].samples += result.samples


def _bury(tally: Tally, event: _Event) -> None:
    if not isinstance(event.error, ClrenderError):
        raise event.error or RenderError("a worker ended without a reason")
    tally.workers[event.worker].requeued += 1
    tally.failures.append(str(event.error))


class _Merge:
    """Adds units to the film, tile by tile, each as the rectangle of pixels it is."""

    def __init__(self, plan: Plan, film: Film) -> None:
        self._plan = plan
        self._film = film
        self._orders: dict[tuple[int, int], npt.NDArray[np.int64]] = {}

    def add(self, unit: Unit, result: UnitSums) -> None:
        plan, area = self._plan, self._plan.tile * self._plan.tile
        across = -(-plan.width // plan.tile)
        for index in range(unit.slot_count // area):
            row, column = divmod(unit.first_slot // area + index, across)
            top, left = row * plan.tile, column * plan.tile
            rows, columns = min(plan.tile, plan.height - top), min(plan.tile, plan.width - left)
            order = index * area + self._order(rows, columns)
            at = np.divmod(np.arange(rows * columns), columns)
            self._film.add(top + at[0], left + at[1], result.sums[order], result.counts[order])

    def _order(self, rows: int, columns: int) -> npt.NDArray[np.int64]:
        """Slots, in a tile, of the pixels of its top left rectangle, row by row."""
        if (rows, columns) not in self._orders:
            grid = tile_slots(self._plan.tile).reshape(self._plan.tile, self._plan.tile)
            self._orders[rows, columns] = grid[:rows, :columns].reshape(-1)
        return self._orders[rows, columns]
