"""Who computes which samples when: workers in threads, a queue, and what happens when a device fails.

No unit is lost: one whose worker failed goes back into the queue for the others. The film does not depend on any of
it, because its sums are exact.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from clrender.errors import ClrenderError
from clrender.film.unit import Unit, UnitSums
from clrender.scheduling.policy import Plan, Remaining
from clrender.scheduling.worker import Candidate

__all__ = ["Receiver", "Tally", "WorkerTally", "run"]

_UNREAD: Final = 8
"""Events that may wait to be dealt with: results are large, and a fast device must not pile up an image of them."""

_PATIENCE: Final = 0.05
"""Seconds between two questions whether to stop, where nothing else happens."""


class Receiver(Protocol):
    """Where units go when they are done: a film, or whatever adds them up in another way."""

    def commit(self, unit: Unit, result: UnitSums) -> int:
        """Take in what was done of a unit; gives its samples, over all pixels of the image."""


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
        Every sample of the plan was taken.
    workers : list of WorkerTally
        In the order given.
    failures : list of ClrenderError
        Why workers failed, each with the name of its device in the message.
    """

    samples: int = 0
    rays: int = 0
    shadow_rays: int = 0
    deepest: int = 0
    complete: bool = False
    workers: list[WorkerTally] = field(default_factory=list)
    failures: list[ClrenderError] = field(default_factory=list)

    @property
    def all_failed(self) -> bool:
        """Whether nobody is left who could go on."""
        return len(self.failures) == len(self.workers)

    def raise_failure(self) -> None:
        """Raise why the last worker failed, where all did before the work was done."""
        if self.all_failed and not self.complete:
            raise self.failures[-1]


@dataclass(frozen=True)
class _Event:
    """Something a worker's thread says: progress, a result, or, with neither, that it ends, and why."""

    worker: int
    progress: tuple[int, int] | None = None
    unit: Unit | None = None
    result: UnitSums | None = None
    error: BaseException | None = None


class _Queue:
    """Work shared by the workers' threads. A worker waits while others may yet give units back."""

    def __init__(self, plan: Plan, workers: int) -> None:
        self._remaining = Remaining(plan, workers)
        self._out = 0
        self._changed = threading.Condition()

    def take(self, worker: int) -> Unit | None:
        with self._changed:
            while True:
                unit = self._remaining.take(worker)
                if unit is not None:
                    self._out += 1
                    return unit
                if self._out == 0:
                    return None
                self._changed.wait()

    def done(self, worker: int, unit: Unit, seconds: float) -> None:
        with self._changed:
            self._out -= 1
            self._remaining.measured(worker, unit, seconds)
            self._changed.notify_all()

    def failed(self, worker: int, unit: Unit | None) -> None:
        with self._changed:
            if unit is not None:
                self._out -= 1
                self._remaining.put_back(unit)
            self._remaining.retire(worker)
            self._changed.notify_all()


def run(
    plan: Plan,
    candidates: Sequence[Candidate],
    film: Receiver,
    on_progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Tally:
    """Have workers do the work of a plan, and commit it to the film.

    Parameters
    ----------
    plan : Plan
    candidates : sequence of Candidate
        At least one; each gets a thread, in which it is set up and works.
    film : Receiver
        A `clrender.film.Film` of the plan's size, or the like, without any of its samples.
    on_progress : callable, optional
        Told, in the calling thread, how many samples and rays are done in all.
    should_stop : callable, optional
        Asked in the calling thread, twenty times a second at least; after a yes, the film keeps what is done by then.

    Returns
    -------
    Tally
        `all_failed` when every worker failed; what was finished before is in the film all the same.

    Raises
    ------
    Exception
        What `on_progress` or `should_stop` raised, or a worker that is no `ClrenderError`. No thread is left then.
    """
    work, events = _Queue(plan, len(candidates)), queue.Queue[_Event](_UNREAD)
    stop = threading.Event()
    threads = [
        threading.Thread(target=_work, args=(number, candidate, work, events, stop), daemon=True)
        for number, candidate in enumerate(candidates)
    ]
    tally = Tally(workers=[WorkerTally(candidate.name) for candidate in candidates])
    seen = [0, 0]
    if should_stop is not None and should_stop():
        return tally
    for thread in threads:
        thread.start()
    try:
        alive = len(threads)
        while alive:
            if not stop.is_set() and should_stop is not None and should_stop():
                stop.set()
            try:
                event = events.get(timeout=_PATIENCE)
            except queue.Empty:
                continue
            if event.progress is not None:
                seen = [seen[0] + event.progress[0], seen[1] + event.progress[1]]
                if on_progress is not None:
                    on_progress(*seen)
            elif event.unit is not None and event.result is not None:
                _commit(tally, film, event.worker, event.unit, event.result)
            else:
                alive -= 1
                if event.error is not None:
                    _record_failure(tally, event)
    finally:
        stop.set()
        _end(threads, events)
    tally.complete = tally.samples == plan.samples
    return tally


def _end(threads: Sequence[threading.Thread], events: queue.Queue[_Event]) -> None:
    """Wait for the threads; nobody listens any more, but none may be kept waiting for that."""
    for thread in threads:
        while thread.is_alive():
            with contextlib.suppress(queue.Empty):
                while True:
                    events.get_nowait()
            thread.join(0.05)


def _work(number: int, candidate: Candidate, work: _Queue, events: queue.Queue[_Event], stop: threading.Event) -> None:
    """Life of a worker's thread: set the device up, take a unit, do it, say what came of it."""
    told = [0, 0]
    unit: Unit | None = None

    def on_slice(samples: int, rays: int) -> None:
        told[0] += samples
        told[1] += rays
        events.put(_Event(number, progress=(samples, rays)))

    try:
        worker = candidate.set_up()
        while not stop.is_set() and (unit := work.take(number)) is not None:
            told = [0, 0]
            begin = time.perf_counter()
            result = worker.render(unit, on_slice, stop.is_set)
            events.put(_Event(number, unit=unit, result=result))
            work.done(number, unit, time.perf_counter() - begin)
            unit = None
    except BaseException as error:
        events.put(_Event(number, progress=(-told[0], -told[1])))
        work.failed(number, unit)
        events.put(_Event(number, unit=unit, error=error))
    else:
        events.put(_Event(number))


def _commit(tally: Tally, film: Receiver, worker: int, unit: Unit, result: UnitSums) -> None:
    samples = film.commit(unit, result)
    tally.samples += samples
    tally.rays += result.rays
    tally.shadow_rays += result.shadow_rays
    tally.deepest = max(tally.deepest, result.deepest)
    tally.workers[worker].units += 1
    tally.workers[worker].samples += samples


def _record_failure(tally: Tally, event: _Event) -> None:
    if not isinstance(event.error, ClrenderError):
        raise event.error or AssertionError("a worker failed without a reason")
    tally.workers[event.worker].requeued += event.unit is not None
    tally.failures.append(event.error)
