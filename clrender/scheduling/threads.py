"""The workers' threads: each sets its device up, takes tasks, does them, and says what came of it."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from clrender.errors import DeviceError, DeviceFailure
from clrender.film.unit import UnitSums
from clrender.scheduling.watchdog import TimeLimits
from clrender.scheduling.work import Kind, Task, Work
from clrender.scheduling.worker import Candidate, Worker

__all__ = ["Event", "WorkerThreads"]

_UNREAD: Final = 8
"""Events that may wait to be dealt with: results are large, and a fast device must not pile up an image of them."""

_PRESENCE_SECONDS: Final = 0.25
"""From one question whether a worker is there to the next."""


@dataclass(frozen=True)
class Event:
    """Something a worker's thread says.

    Attributes
    ----------
    worker : int
    progress : (int, int) or None
        Samples and rays more.
    task : Task or None
        That is done, or was being done when it failed; None with nothing else: the thread ends.
    result : UnitSums, bool or None
        Of the task.
    error : exception or None
    retry : float or None
        Seconds after which a worker that failed tries again.
    back : bool
        It tries again now.
    away : bool
        It is not there; nobody should wait for it.
    """

    worker: int
    progress: tuple[int, int] | None = None
    task: Task | None = None
    result: UnitSums | bool | None = None
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

    Attributes
    ----------
    events : queue.Queue
        What they say.
    """

    def __init__(self, candidates: Sequence[Candidate], work: Work, limits: TimeLimits) -> None:
        self.events: queue.Queue[Event] = queue.Queue(_UNREAD)
        self._candidates = candidates
        self._work = work
        self._limits = limits
        self._stop = threading.Event()
        # A thread whose driver does not return cannot be ended; the process can, and does not wait for it
        self._threads = [
            threading.Thread(target=self._live, args=(number,), daemon=True) for number in range(len(candidates))
        ]

    def start(self) -> None:
        """Begin."""
        for thread in self._threads:
            thread.start()

    @property
    def stopping(self) -> bool:
        """Whether they were told to end."""
        return self._stop.is_set()

    def stop(self) -> None:
        """Tell all to end with what they have done by then."""
        self._stop.set()
        self._work.end()

    def end(self, which: Collection[int]) -> bool:
        """Wait a moment for threads to end, and give whether some are left.

        Nobody listens any more, but none may be kept waiting for that.
        """
        for number in which:
            if self._threads[number].is_alive():
                with contextlib.suppress(queue.Empty):
                    while True:
                        self.events.get_nowait()
                self._threads[number].join(0.05)
        return any(self._threads[number].is_alive() for number in which)

    def _live(self, number: int) -> None:
        """Life of a thread."""
        failures = 0
        task: Task | None = None
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
                while not self._stop.is_set() and (task := self._work.take(number)) is not None:
                    self._do(worker, task)
                    task, steady = None, steady + 1
                    failures = 0 if steady >= self._limits.steady else failures
                break
            except BaseException as error:
                failures += 1
                pause = self._limits.pause * 2.0 ** (failures - 1)
                again = failures <= self._retries(error) and not self._stop.is_set()
                self._post(Event(number, task=task, error=error, retry=pause if again else None))
                task = None
                if not again or not self._work.rest(number, pause):
                    break
                self._post(Event(number, back=True))
        self._post(Event(number))

    def _await_presence(self, number: int) -> bool:
        """Wait until a worker is there; gives whether there is still something to do."""
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
        """How many failures in a row are forgiven, given the last one."""
        if isinstance(error, DeviceFailure):
            return self._limits.retries
        # A compiler that refuses a kernel will do so again, unless it lacked memory or room
        return min(1, self._limits.retries) if isinstance(error, DeviceError) else 0

    def _do(self, worker: Worker, task: Task) -> None:
        number = task.worker
        if task.kind is Kind.PROBE:
            prove = self._candidates[number].prove
            self._post(Event(number, task=task, result=prove() if prove is not None else True))
            return
        assert task.unit is not None
        begin = time.perf_counter()
        of_image = task.kind is Kind.UNIT
        result = worker.render(
            task.unit,
            (lambda samples, rays: self._post(Event(number, progress=(samples, rays)))) if of_image else None,
            lambda: self._stop.is_set() or self._work.dismissed(number),
        )
        # Before anybody has dealt with the result: this thread wants its next unit now
        seconds = time.perf_counter() - begin
        if of_image:
            self._work.measured(number, task.unit, seconds)
        elif task.piece is not None:
            self._work.timed(number, task.piece.samples, seconds)
        self._post(Event(number, task=task, result=result))

    def _post(self, event: Event) -> None:
        """Say something, as long as somebody listens to this worker."""
        while True:
            try:
                self.events.put(event, timeout=0.2)
                return
            except queue.Full:
                if self._work.dismissed(event.worker):
                    return
