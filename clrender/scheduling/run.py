"""The scheduler: workers in threads, a queue of units, and the handling of devices that fail.

No unit is lost. If a worker fails, its unit returns to the queue for the others; if its results turn out to be wrong,
all its units do. None of this changes the film, because its sums are exact.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from clrender.errors import ClrenderError, DeviceFailure, RenderError
from clrender.film import Film
from clrender.film.held import FilmCopy, HeldUnit
from clrender.film.unit import Unit, UnitSums
from clrender.scheduling.arbitration import Arbitration
from clrender.scheduling.contributions import MOST_BYTES, Contributions
from clrender.scheduling.policy import Plan, Remaining
from clrender.scheduling.spot_check import SHARE, Sampler, finished
from clrender.scheduling.tally import Tally, WorkerTally
from clrender.scheduling.threads import Event, Holding, WorkerThreads
from clrender.scheduling.watchdog import TimeLimits, Watchdog
from clrender.scheduling.work import Kind, Task, Work
from clrender.scheduling.worker import Candidate

__all__ = ["TIME_LIMITS", "Receiver", "Tally", "WorkerTally", "run"]

TIME_LIMITS: Final = TimeLimits()

_POLL: Final = 0.05
"""Seconds between two calls of `should_stop` while there are no events."""

_COPY_SHARES: Final = (0.05, 0.01)
"""Largest share of the time that copies of what a worker holds may take: if somebody waits for one, and if not."""
_COPY_BYTES: Final = 1 << 30
"""Bytes a second at which a first copy is expected to be made."""


class Receiver(Protocol):
    """The destination of finished units: a film, or another accumulator."""

    def commit(self, unit: Unit, result: UnitSums) -> int:
        """Add the result of a unit; returns its number of samples, over all pixels of the image."""


@dataclass(frozen=True)
class Listeners:
    """Callbacks of a run, all called in the calling thread."""

    on_progress: Callable[[int, int], None] | None = None
    should_stop: Callable[[], bool] | None = None
    tell: Callable[[str], None] | None = None


def run(
    plan: Plan,
    candidates: Sequence[Candidate],
    film: Receiver,
    on_progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    tell: Callable[[str], None] | None = None,
    check_share: float = SHARE,
    limits: TimeLimits | None = None,
    apart_bytes: int = MOST_BYTES,
    holds: bool = False,
    sums: bool = True,
) -> Tally:
    """Have workers render the units of a plan, and commit them to the film.

    Parameters
    ----------
    plan : Plan
    candidates : sequence of Candidate
        At least one; each gets a thread, in which it is set up and works.
    film : Receiver
        A `clrender.film.Film` of the plan's size, or another receiver, without any of the plan's samples.
    on_progress : callable, optional
        Called in the calling thread with the total numbers of finished samples and rays; the last call comes after the
        last commit.
    should_stop : callable, optional
        Called in the calling thread, at least twenty times a second. If it returns True, the run ends and the film
        keeps the samples taken so far.
    tell : callable, optional
        Called with one line of text when a device failed and will be tried again.
    check_share : float
        Fraction of the samples that a second worker renders again for comparison, if there are several workers and the
        receiver is a film.
    limits : TimeLimits, optional
    apart_bytes : int
        Memory for per-worker films, with which a worker's contributions can be subtracted.
    holds : bool
        Whether a single worker may hold the sums of its units (`HoldingWorker`) if the receiver is a film, which then
        has them at the end, and copies of them now and then.
    sums : bool
        Whether the film's sums are wanted at the end. Otherwise it may then be developed.

    Returns
    -------
    Tally
        `all_failed` is True if every worker failed; the film keeps what was finished before.

    Raises
    ------
    Exception
        Any exception of `on_progress` or `should_stop`, and any exception of a worker that is no `ClrenderError`. All
        threads have ended then, except those whose driver call does not return.
    """
    listeners = Listeners(on_progress, should_stop, tell)
    if should_stop is not None and should_stop():
        return Tally(stopped=True, workers=[WorkerTally(candidate.name) for candidate in candidates])
    holding = Holding(film, sums) if holds and isinstance(film, Film) and len(candidates) == 1 else None
    limits = limits or TIME_LIMITS
    return _Run(plan, candidates, film, listeners, check_share, limits, apart_bytes, holding).tally_of_all()


@dataclass(frozen=True)
class _Held:
    """A unit whose sums its worker holds, and the number of its samples, over all pixels."""

    unit: Unit
    result: HeldUnit
    samples: int


class _Run:
    """State and decisions of one run, all in the calling thread."""

    def __init__(
        self,
        plan: Plan,
        candidates: Sequence[Candidate],
        film: Receiver,
        listeners: Listeners,
        share: float,
        limits: TimeLimits,
        apart_bytes: int,
        holding: Holding | None,
    ) -> None:
        self._plan = plan
        self._candidates = candidates
        self._film = film
        self._listeners = listeners
        count = len(candidates)
        self._tally = Tally(workers=[WorkerTally(candidate.name) for candidate in candidates])
        self._work = Work(Remaining(plan, count), count)
        self._threads = WorkerThreads(candidates, self._work, limits, holding)
        processors = [self._threads.processor(number) for number in range(count)]
        self._watchdog = Watchdog([each.pulse for each in candidates], limits, processors=processors)
        self._alive = set(range(count))
        self._told = [(0, 0)] * count
        self._seen = (0, 0)
        self._pending: dict[int, ClrenderError] = {}
        checked = count > 1 and share > 0.0
        self._apart = Contributions(film, count, apart_bytes) if checked and isinstance(film, Film) else None
        self._sampler = Sampler(plan, share) if self._apart is not None else None
        self._arbitration = Arbitration(candidates, self._work, self._exclude)
        self._holding = holding
        self._held: list[_Held] = []
        self._copies = _Copies(film.width * film.height * film.pixel_bytes if isinstance(film, Film) else 0)

    def tally_of_all(self) -> Tally:
        """Run until all workers have ended, and return the tally."""
        try:
            self._threads.start()
            while self._alive:
                self._ask_to_stop()
                try:
                    event = self._threads.events.get(timeout=_POLL)
                except queue.Empty:
                    event = None
                if event is not None:
                    self._deal_with(event)
                self._look_for_hung()
                self._order_copy()
        finally:
            self._work.abandon()
            self._threads.stop()
            while self._threads.end(self._alive):
                self._look_for_hung()
            if self._holding is not None:
                self._holding.film.held = False
        tally = self._tally
        for worker, error in self._pending.items():
            tally.workers[worker].state = "failed"
            tally.failures.append(error)
        if self._arbitration.undecided:
            self._say(
                f"warning: {self._arbitration.undecided} give different results for the same samples, and the render "
                "ended before it was found which are wrong; the image may be"
            )
        tally.complete = tally.samples == self._plan.samples
        if self._listeners.on_progress is not None and tally.samples:
            self._listeners.on_progress(tally.samples, tally.rays)
        return tally

    def _ask_to_stop(self) -> None:
        asked = self._listeners.should_stop
        if not self._threads.stopping and asked is not None and asked():
            self._tally.stopped = True
            self._threads.stop()

    def _say(self, line: str) -> None:
        if self._listeners.tell is not None:
            self._listeners.tell(line)

    def _deal_with(self, event: Event) -> None:
        """Handle an event of a worker's thread."""
        worker = event.worker
        if worker not in self._alive:
            return
        self._watchdog.beat(worker, slice_done=event.progress is not None or event.result is not None)
        if event.progress is not None:
            if not self._work.dismissed(worker):
                self._advance(worker, *event.progress)
        elif event.error is not None:
            self._failed(event)
        elif event.away:
            self._work.pause(worker)
        elif event.back:
            self._tally.workers[worker].name = self._candidates[worker].name  # a worker that joined has a name only now
            self._work.enlist(worker)
            self._watchdog.start_over(worker)
        elif event.task is None and isinstance(event.result, FilmCopy):
            if not self._work.dismissed(worker):
                self._receive(worker, event.result)
        elif event.task is None:
            self._alive.discard(worker)
            self._work.pause(worker)
        elif self._work.is_out(event.task):
            self._done(event.task, event.result)
            self._work.settle(event.task)

    def _advance(self, worker: int, samples: int, rays: int) -> None:
        before, seen = self._told[worker], self._seen
        self._told[worker] = (before[0] + samples, before[1] + rays)
        self._seen = (seen[0] + samples, seen[1] + rays)
        if self._listeners.on_progress is not None:
            self._listeners.on_progress(*self._seen)

    def _forget_progress(self, worker: int) -> None:
        """Subtract the reported progress of a unit that a worker will not deliver."""
        samples, rays = self._told[worker]
        if samples or rays:
            self._advance(worker, -samples, -rays)

    def _order_copy(self) -> None:
        """Have a copy made of what the worker holds, if one is due."""
        if self._holding is not None and self._held and self._copies.due(self._holding.film.asked):
            self._copies.ordered = self._work.order_copy(0)

    def _receive(self, worker: int, copy: FilmCopy) -> None:
        """Take a copy of all that a worker holds into the film."""
        assert self._holding is not None, "only a worker that may hold sums delivers them"
        self._holding.film.receive(copy, [(each.unit, each.result) for each in self._held])
        for each in self._held:
            self._tally.workers[worker].add(each.result, each.samples)
        self._held.clear()
        self._work.holds(worker, False)
        self._copies.made(copy.seconds)

    def _lose_held(self, worker: int) -> None:
        """Requeue the units whose sums a worker held when it failed."""
        tally = self._tally.workers[worker]
        for each in self._held:
            self._advance(worker, -each.samples, -each.result.rays)
        self._told[worker] = (0, 0)
        tally.requeued += len(self._held)
        self._work.redo([each.unit for each in self._held])
        self._held.clear()
        self._work.holds(worker, False)
        self._copies.ordered = False

    def _done(self, task: Task, result: UnitSums | HeldUnit | FilmCopy | bool | None) -> None:
        worker = task.worker
        if isinstance(result, FilmCopy):
            self._receive(worker, result)
        elif task.unit is not None and isinstance(result, HeldUnit):
            pixels = task.unit.pixels(self._plan.width, self._plan.height)
            self._held.append(_Held(task.unit, result, int((pixels * result.done).sum())))
            self._work.holds(worker, True)
            self._told[worker] = (0, 0)
            if (error := self._pending.pop(worker, None)) is not None:
                self._tally.recovered.append(error)
        elif task.kind is Kind.UNIT and task.unit is not None and isinstance(result, UnitSums):
            if self._apart is None:
                samples = self._film.commit(task.unit, result)
            else:
                samples = self._apart.commit(worker, task.unit, result)
            self._tally.workers[worker].add(result, samples)
            self._told[worker] = (0, 0)
            if (error := self._pending.pop(worker, None)) is not None:
                self._tally.recovered.append(error)
            if self._sampler is not None:
                piece = self._sampler.piece(worker, task.unit, result, self._work.room(worker))
                if piece is not None:
                    self._work.check(piece)
        elif task.kind is Kind.CHECK and task.piece is not None and isinstance(result, UnitSums):
            if not finished(task.piece.unit, result):
                return  # the render is being stopped
            self._tally.checks += 1
            self._tally.check_samples += task.piece.samples
            self._tally.workers[task.piece.worker].checked += task.piece.samples
            if not task.piece.agrees(result):
                self._tally.differences += 1
                self._arbitration.open(task.piece, worker, result)
        elif not isinstance(result, HeldUnit):
            self._arbitration.hear(task, result)

    def _failed(self, event: Event) -> None:
        """Handle the failure of a worker: its unit is requeued for the others. It may come back."""
        worker, error = event.worker, event.error
        if not isinstance(error, ClrenderError):
            raise error or AssertionError("a worker failed without a reason")
        if self._work.dismissed(worker):
            return
        tally = self._tally.workers[worker]
        tally.failures += 1
        if event.task is not None and self._work.give_back(event.task):
            tally.requeued += event.task.kind is Kind.UNIT
        self._forget_progress(worker)
        self._lose_held(worker)
        self._pending.pop(worker, None)
        if event.retry is None:
            self._end_of(worker, error, "failed")
            if self._candidates[worker].elsewhere and len(self._alive) > 1 and not self._threads.stopping:
                # One that cannot take the job, such as one of another version: to be mended while the render runs
                self._say(f"warning: {error}; its work is done by the others")
                self._tally.told.append(error)
        else:
            self._pending[worker] = error
            self._work.pause(worker)
            when = f"in {event.retry:g} s"
            if self._candidates[worker].present is not None:
                when = "when it is there"
            self._say(f"warning: {error}; it is set up again {when}")
        self._leaves_arbitration(worker)

    def _leaves_arbitration(self, worker: int) -> None:
        """Tell the arbitration that a worker left, unless the run is stopping: then no dispute is settled any more."""
        if not self._threads.stopping:
            self._arbitration.left(worker)

    def _end_of(self, worker: int, error: ClrenderError, state: str) -> None:
        self._tally.workers[worker].state = state
        self._tally.failures.append(error)
        self._pending.pop(worker, None)
        self._work.retire(worker)

    def _look_for_hung(self) -> None:
        busy, others_wait = self._work.busy(self._alive)
        for worker in busy if self._work.ended else ():
            if (give_up := self._candidates[worker].give_up) is not None:
                give_up()
        stopping = self._threads.stopping
        waited_for = self._tally.samples > 0 or bool(self._held) if stopping else others_wait
        for worker in self._watchdog.silent(busy, waited_for=waited_for, hurry=stopping):
            self._alive.discard(worker)
            lose = self._candidates[worker].lose
            if lose is not None:
                lose()
            tally = self._tally.workers[worker]
            tally.failures += 1
            tally.requeued += sum(task.kind is Kind.UNIT for task in self._work.dismiss(worker))
            self._forget_progress(worker)
            self._lose_held(worker)
            hangs = f"{tally.name} hangs: a call of its driver did not come back"
            if self._tally.stopped:
                hangs = f"{tally.name} did not stop in time; it is not used any more"
            if tally.state == "ok":
                self._end_of(worker, DeviceFailure(hangs), "hung")
            self._leaves_arbitration(worker)

    def _exclude(self, worker: int, why: str) -> None:
        """Exclude a worker with wrong results: its units are subtracted from the film, and others render them again."""
        tally = self._tally.workers[worker]
        if tally.state == "wrong":
            return
        self._work.dismiss(worker)
        self._work.cancel_checks(worker)
        self._forget_progress(worker)
        samples, rays = self._tally.samples, self._tally.rays
        for number, units in (self._apart.withdraw(worker) if self._apart else {}).items():
            self._tally.workers[number].withdraw(units)
            self._work.redo(units)
        self._seen = (self._seen[0] - samples + self._tally.samples, self._seen[1] - rays + self._tally.rays)
        self._end_of(worker, RenderError(f"{tally.name} computes wrong results: {why}"), "wrong")


class _Copies:
    """When to copy what a worker holds: so often that little is lost if it fails, and seldom enough to cost little.

    Parameters
    ----------
    nbytes : int
        Size of a copy.

    Attributes
    ----------
    ordered : bool
        Whether one is ordered that has not been delivered yet.
    """

    def __init__(self, nbytes: int) -> None:
        self._last, self._seconds = time.perf_counter(), nbytes / _COPY_BYTES
        self.ordered = False

    def due(self, asked: bool) -> bool:
        """Whether to order a copy now; `asked` tells whether somebody waits for one."""
        share = _COPY_SHARES[not asked]
        return not self.ordered and time.perf_counter() >= self._last + self._seconds / share

    def made(self, seconds: float) -> None:
        """Note that one was delivered, which took this long."""
        self._last, self._seconds = time.perf_counter(), seconds
        self.ordered = False
