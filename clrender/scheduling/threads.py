"""Worker threads: each sets up its device, takes tasks, executes them and reports events."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Final

from clrender.errors import ClrenderError, DeviceError, DeviceFailure
from clrender.film import Film
from clrender.film.held import FilmCopy, HeldUnit
from clrender.film.unit import UnitSums
from clrender.process.driver_threads import driver_thread
from clrender.process.elapsed import processor_seconds
from clrender.scheduling.watchdog import TimeLimits
from clrender.scheduling.work import Kind, Task, Work
from clrender.scheduling.worker import Candidate, HoldingWorker, Worker, can_hold

__all__ = ["Event", "Holding", "WorkerThreads"]

_UNREAD: Final = 8
"""Most events in the queue: results are large, and a fast device must not fill the memory with them."""

_PRESENCE_SECONDS: Final = 0.25
"""Interval at which a worker's presence is polled, seconds."""


@dataclass(frozen=True)
class Holding:
    """What a worker that holds the sums of its units begins with and delivers.

    Attributes
    ----------
    film : Film
        The film whose samples it begins with. While it works, only its copies change the film.
    sums : bool
        Whether the last copy has sums, and not only means.
    """

    film: Film
    sums: bool = True


@dataclass(frozen=True)
class Event:
    """An event of a worker's thread.

    Attributes
    ----------
    worker : int
    progress : (int, int) or None
        Additional samples and rays.
    task : Task or None
        The task that is done, or that was in progress at a failure. If all other fields are unset too, the thread ends.
    result : UnitSums, HeldUnit, FilmCopy, bool or None
        Result of the task. Without a task: a copy of what a worker holds that failed.
    error : exception or None
    retry : float or None
        Seconds after which a worker that failed tries again.
    back : bool
        The worker tries again now.
    away : bool
        The worker is absent and should not be waited for.
    """

    worker: int
    progress: tuple[int, int] | None = None
    task: Task | None = None
    result: UnitSums | HeldUnit | FilmCopy | bool | None = None
    error: BaseException | None = None
    retry: float | None = None
    back: bool = False
    away: bool = False


class WorkerThreads:
    """A thread for each worker.

    Parameters
    ----------
    candidates : sequence of Candidate
    work : Work
    limits : TimeLimits
    holding : Holding, optional
        Given if the worker, the only one, may hold the sums of its units.

    Attributes
    ----------
    events : queue.Queue
        The events of all threads.
    """

    def __init__(
        self, candidates: Sequence[Candidate], work: Work, limits: TimeLimits, holding: Holding | None = None
    ) -> None:
        self.events: queue.Queue[Event] = queue.Queue(_UNREAD)
        self._candidates = candidates
        self._work = work
        self._limits = limits
        self._holding = holding
        self._stop = threading.Event()
        self._threads = [driver_thread(self._live, number) for number in range(len(candidates))]

    def start(self) -> None:
        """Start the threads."""
        for thread in self._threads:
            thread.start()

    @property
    def stopping(self) -> bool:
        """Whether the threads were told to end."""
        return self._stop.is_set()

    def stop(self) -> None:
        """Tell all threads to end after their current slice."""
        self._stop.set()
        self._work.end()

    def end(self, which: Collection[int]) -> bool:
        """Wait briefly for threads to end; returns whether some are left.

        Events are no longer handled, but the queue is emptied so that no thread blocks on it.
        """
        alive = [self._threads[number] for number in which if self._threads[number].is_alive()]
        with contextlib.suppress(queue.Empty):
            while True:
                self.events.get_nowait()
        for thread in alive[:1]:
            thread.join(0.05)
        return bool(alive)

    def processor(self, number: int) -> Callable[[], float] | None:
        """Processor seconds that a worker of this process may have used; None for a worker elsewhere."""
        if self._candidates[number].elsewhere:
            return None
        thread = self._threads[number]
        return processor_seconds(lambda: [thread.thread] if thread.thread is not None else [])

    def _live(self, number: int) -> None:
        """Main function of a thread."""
        failures = 0
        task: Task | None = None
        holder: HoldingWorker | None = None
        while True:
            steady = 0
            try:
                if not self._await_presence(number):
                    break
                if failures:
                    restart = self._candidates[number].restart
                    if restart is not None:
                        restart()
                worker = self._candidates[number].set_up()
                holder = self._holder(number, worker)
                while (task := self._work.take(number)) is not None:
                    self._do(worker, holder, task)
                    task, steady = None, steady + 1
                    failures = 0 if steady >= self._limits.steady else failures
                break
            except BaseException as error:
                failures += 1
                if holder is not None and isinstance(error, ClrenderError) and not self._work.dismissed(number):
                    self._rescue(number, holder)
                holder = None
                pause = self._limits.pause * 2.0 ** (failures - 1)
                again = failures <= self._retries(error) and not self._stop.is_set()
                self._post(Event(number, task=task, error=error, retry=pause if again else None))
                task = None
                if not again or not self._work.rest(number, pause):
                    break
                self._post(Event(number, back=True))
        self._post(Event(number))

    def _await_presence(self, number: int) -> bool:
        """Wait until a worker is present; returns whether there is still work to do."""
        present = self._candidates[number].present
        if present is None or present():
            return True
        self._post(Event(number, away=True))
        while not present():
            if not self._work.rest(number, _PRESENCE_SECONDS):
                return False
        self._post(Event(number, back=True))
        return True

    def _retries(self, error: BaseException) -> int:
        """Number of consecutive failures after which the worker is still retried, given the last error."""
        if isinstance(error, DeviceFailure):
            return self._limits.retries
        # A compiler that rejects a kernel will do so again, unless it lacked memory or disk space
        return min(1, self._limits.retries) if isinstance(error, DeviceError) else 0

    def _holder(self, number: int, worker: Worker) -> HoldingWorker | None:
        """The worker, if it is to hold the sums of its units, and can."""
        holding = self._holding
        if holding is None or not can_hold(worker):
            return None
        self._work.await_settled(number)  # what was rescued of an earlier worker is then in the film
        held = holding.film.held = worker.hold(holding.film)
        holding.film.asked = False  # it has just been read for that
        return worker if held else None

    def _rescue(self, number: int, holder: HoldingWorker) -> None:
        """Deliver what a worker holds that failed, if its device still lets it be read."""
        with contextlib.suppress(ClrenderError):
            self._post(Event(number, result=holder.copy_held(sums=True, image=False, last=True)))

    def _do(self, worker: Worker, holder: HoldingWorker | None, task: Task) -> None:
        number = task.worker
        if task.kind is Kind.PROBE:
            prove = self._candidates[number].prove
            self._post(Event(number, task=task, result=prove() if prove is not None else True))
            return
        if task.kind is Kind.COPY:
            assert holder is not None and self._holding is not None, (
                "only a worker that holds something is asked for it"
            )
            copy = holder.copy_held(sums=self._holding.sums or not task.last, image=task.last, last=task.last)
            self._post(Event(number, task=task, result=copy))
            return
        assert task.unit is not None
        begin = time.perf_counter()
        of_image = task.kind is Kind.UNIT
        render = worker.render if holder is None else holder.render_held
        result = render(
            task.unit,
            (lambda samples, rays: self._post(Event(number, progress=(samples, rays)))) if of_image else None,
            lambda: self._stop.is_set() or self._work.dismissed(number),
        )
        # Recorded before the result is handled, as this thread takes its next unit at once
        seconds = time.perf_counter() - begin
        if of_image:
            self._work.measured(number, task.unit, seconds)
        elif task.piece is not None:
            self._work.timed(number, task.piece.samples, seconds)
        self._post(Event(number, task=task, result=result))

    def _post(self, event: Event) -> None:
        """Post an event, unless this worker is no longer listened to."""
        while True:
            try:
                self.events.put(event, timeout=0.2)
                return
            except queue.Full:
                if self._work.dismissed(event.worker):
                    return
