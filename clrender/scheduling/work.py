"""The work shared by the worker threads: units, pieces to check, and the tasks in progress."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from clrender.film.unit import Unit
from clrender.scheduling.policy import Remaining
from clrender.scheduling.spot_check import Piece

__all__ = ["Kind", "Task", "Work"]

_MOST_CHECKS: Final = 64
"""Most pieces that may wait to be checked."""
_CHECK_SECONDS: Final = (0.3, 1.0)
"""Bounds of the seconds that the fastest checker may need for the waiting pieces; between them, a share of the run."""
_CHECK_SHARE: Final = 0.02
_LAST_CHECK_SECONDS: Final = 0.1
"""Seconds that checks may take after all units are taken, when all workers wait for them; more in a long run."""
_LAST_CHECK_SHARE: Final = 0.01
"""Share of the run time that they may take, if it is longer."""
_CHECK_SAMPLES: Final = 1 << 18
"""Most samples of the waiting pieces while the speed of the other workers is unknown."""


class Kind(Enum):
    """Kind of a task."""

    UNIT = "unit"
    CHECK = "check"
    REPEAT = "repeat"
    COPY = "copy"
    PROBE = "probe"


@dataclass(frozen=True, eq=False)
class Task:
    """A task of one worker.

    Attributes
    ----------
    number : int
        Unique number within the run.
    worker : int
    kind : Kind
        A unit; a piece of another's unit, to check it or to settle a dispute; a copy of what the worker holds; or a
        probe.
    unit : Unit or None
        None for a copy and a probe.
    piece : Piece or None
        The piece that `unit` belongs to.
    last : bool
        Whether no unit is left, or the run is stopping: a copy is then the last one.
    """

    number: int
    worker: int
    kind: Kind
    unit: Unit | None = None
    piece: Piece | None = None
    last: bool = False


class Work:
    """Work shared by the worker threads. An idle worker waits as long as there may be further work.

    Worker threads take tasks; the thread that commits results reports everything else. A task is outstanding from when
    it is taken until it is settled or given back, so that none is counted twice or lost.
    """

    def __init__(self, remaining: Remaining, workers: int) -> None:
        self._remaining = remaining
        self._numbers = itertools.count()
        self._out: dict[int, Task] = {}
        self._orders: dict[int, deque[tuple[Kind, Piece | None]]] = {number: deque() for number in range(workers)}
        self._checks: deque[Piece] = deque()
        self._checked_last: set[int] = set()
        self._in_service = set(range(workers))
        self._rates: dict[int, float] = {}
        self._check_rates: dict[int, float] = {}
        self._check_overheads: dict[int, deque[float]] = {}
        self._begin = self._last_unit = time.monotonic()
        self._checked: set[int] = set()
        self._waiting: set[int] = set()
        self._resting: set[int] = set()
        self._retired: set[int] = set()
        self._dismissed: set[int] = set()
        self._holding: set[int] = set()
        self._disputed = False
        self._ended = self._abandoned = False
        self._changed = threading.Condition()

    # Called by worker threads

    def take(self, worker: int) -> Task | None:
        """Wait for a worker's next task and take it; None if the worker should end."""
        with self._changed:
            self._waiting.add(worker)
            while not self._ended and worker not in self._dismissed:
                task = self._next(worker)
                if task is not None:
                    self._waiting.discard(worker)
                    self._out[task.number] = task
                    return task
                if self._over():
                    self._ended = True
                    self._changed.notify_all()
                    break
                self._changed.wait()
            # At the end of a run that was stopped, too, what a worker holds is wanted
            while not (self._abandoned or worker in self._dismissed):
                if self._occupied(worker):
                    self._changed.wait()
                elif worker in self._holding:
                    last = self._copy(worker)
                    self._out[last.number] = last
                    return last
                else:
                    break
            return None

    def await_settled(self, worker: int) -> None:
        """Wait until none of a worker's tasks is outstanding."""
        with self._changed:
            while self._occupied(worker) and not (self._abandoned or worker in self._dismissed):
                self._changed.wait()

    def rest(self, worker: int, seconds: float) -> bool:
        """Wait before a retry; returns whether there is still work for the worker."""
        end = time.monotonic() + seconds
        with self._changed:
            self._resting.add(worker)
            while not self._ended and worker not in self._dismissed and (left := end - time.monotonic()) > 0.0:
                self._changed.wait(left)
            self._resting.discard(worker)
            return not self._ended and worker not in self._dismissed

    def measured(self, worker: int, unit: Unit, seconds: float) -> None:
        """Record the time that a worker took for a unit."""
        with self._changed:
            self._rates[worker] = unit.slot_count * unit.sample_count / max(seconds, 1e-6)
            self._remaining.measured(worker, unit, seconds)

    def timed(self, worker: int, samples: int, seconds: float) -> None:
        """Record the time of a check: some devices need long even for few samples."""
        with self._changed:
            self._check_rates[worker] = samples / max(seconds, 1e-6)
            overhead = max(seconds - samples / self._check_rate(worker), 0.0)
            self._check_overheads.setdefault(worker, deque(maxlen=2)).append(overhead)

    def dismissed(self, worker: int) -> bool:
        """Whether this worker was dismissed."""
        return worker in self._dismissed

    # Called by the thread that commits results

    def is_out(self, task: Task) -> bool:
        """Whether a task is outstanding."""
        return task.number in self._out

    def settle(self, task: Task) -> None:
        """Note that a task is done and its result has been handled."""
        with self._changed:
            self._out.pop(task.number, None)
            if task.kind is Kind.UNIT:
                self._last_unit = time.monotonic()
            elif task.kind is Kind.CHECK and task.piece is not None:
                self._checked.add(task.piece.worker)
            self._changed.notify_all()

    def give_back(self, task: Task) -> bool:
        """Requeue a task that was not done; returns whether it was outstanding."""
        with self._changed:
            mine = self._out.pop(task.number, None) is not None
            if mine:
                self._put_back(task)
            self._changed.notify_all()
        return mine

    def redo(self, units: Collection[Unit]) -> None:
        """Requeue units whose results were withdrawn."""
        with self._changed:
            for unit in reversed(list(units)):
                self._remaining.put_back(unit)
            self._changed.notify_all()

    def room(self, worker: int) -> float:
        """Samples of a worker that the others can check in time, in addition to its waiting pieces."""
        with self._changed:
            others = self._in_service - {worker}
            if not others or len(self._checks) >= _MOST_CHECKS:
                return 0.0
            waiting = [piece.samples for piece in self._checks if piece.worker == worker]
            if not others <= self._rates.keys() | self._check_rates.keys():
                return _CHECK_SAMPLES - sum(waiting)
            seconds, pieces = self._check_seconds(), len(waiting) + 1
            most = max((seconds - pieces * self._overhead(each)) * self._check_rate(each) for each in others)
            return max(most, 0.0 if waiting else 1.0) - sum(waiting)

    def check(self, piece: Piece) -> None:
        """Queue a spot check: another worker renders this piece again."""
        with self._changed:
            self._checks.append(piece)
            self._changed.notify_all()

    def dispute(self, is_open: bool) -> None:
        """Note whether a dispute is open. Meanwhile no worker ends, as units may have to be rendered again."""
        self._change(lambda: setattr(self, "_disputed", is_open))

    def order(self, worker: int, kind: Kind, piece: Piece | None = None) -> None:
        """Give a task to a particular worker, ahead of all others."""
        self._change(lambda: self._orders[worker].append((kind, piece)))

    def order_copy(self, worker: int) -> bool:
        """Have a worker deliver a copy of what it holds, unless it does so already; returns whether it is ordered."""
        with self._changed:
            if any(task.kind is Kind.COPY for task in self._out.values()):
                return False
            self._orders[worker].append((Kind.COPY, None))
            self._changed.notify_all()
            return True

    def pause(self, worker: int) -> None:
        """Note that a worker is absent but may come back: it is not waited for."""
        with self._changed:
            self._in_service.discard(worker)
            self._orders[worker].clear()
            self._changed.notify_all()

    def enlist(self, worker: int) -> None:
        """Note that a worker is back."""
        self._change(lambda: self._in_service.add(worker))

    def retire(self, worker: int) -> None:
        """Note that a worker takes no more work."""
        self.pause(worker)
        with self._changed:
            if worker not in self._retired:
                self._retired.add(worker)
                self._remaining.retire(worker)

    def dismiss(self, worker: int) -> list[Task]:
        """Dismiss a worker at once; its outstanding tasks are requeued for others, and returned.

        Pieces that it has already rendered are still checked.
        """
        with self._changed:
            tasks = [task for task in self._out.values() if task.worker == worker]
            for task in tasks:
                del self._out[task.number]
                self._put_back(task)
            self._dismissed.add(worker)
            self._changed.notify_all()
        self.retire(worker)
        return tasks

    def cancel_checks(self, worker: int) -> None:
        """Remove the waiting checks of a worker's pieces."""
        with self._changed:
            self._checks = deque(piece for piece in self._checks if piece.worker != worker)
            self._changed.notify_all()

    def holds(self, worker: int, holding: bool) -> None:
        """Note whether a worker holds sums that it has not delivered yet: the work is not over before."""
        self._change(lambda: (self._holding.add if holding else self._holding.discard)(worker))

    def abandon(self) -> None:
        """Give out no more tasks, and want nothing that workers hold."""
        self._change(lambda: setattr(self, "_abandoned", True))
        self.end()

    @property
    def ended(self) -> bool:
        """Whether no more tasks are given out."""
        return self._ended

    def end(self) -> None:
        """Give out no more tasks."""
        self._change(lambda: setattr(self, "_ended", True))

    def in_service(self) -> set[int]:
        """Workers that work or wait for work."""
        with self._changed:
            return set(self._in_service)

    def busy(self, workers: Collection[int]) -> tuple[set[int], bool]:
        """The busy ones among some workers, and whether all others wait for a single one or the work has ended."""
        with self._changed:
            busy = set(workers) - self._waiting - self._resting
            return busy, self._ended or (len(busy) == 1 < len(workers) and not self._resting)

    # With the lock held

    def _change(self, change: Callable[[], Any]) -> None:
        with self._changed:
            change()
            self._changed.notify_all()

    def _next(self, worker: int) -> Task | None:
        if self._orders[worker]:
            kind, piece = self._orders[worker].popleft()
            if kind is Kind.COPY:
                return self._copy(worker)
            return self._task(worker, kind, piece)
        check = next((piece for piece in self._checks if self._may_check(worker, piece)), None)
        # At most one check between two units, as a slow worker has units of its own to render
        known = worker in self._rates or worker in self._check_rates
        check_first = check is not None and known and worker not in self._checked_last
        unit = None if check_first else self._remaining.take(worker)
        self._checked_last.discard(worker)
        if unit is not None:
            return Task(next(self._numbers), worker, Kind.UNIT, unit)
        if check is not None:
            self._checked_last.add(worker)
            self._checks.remove(check)
            if not self._remaining.is_empty:
                self._drop_checks(worker)
            return self._task(worker, Kind.CHECK, check)
        if worker in self._holding and not self._occupied(worker):
            return self._copy(worker)
        return None

    def _drop_checks(self, worker: int) -> None:
        """Drop the waiting pieces, latest first, that this worker could not check in time."""
        allowed = self._check_seconds() * self._check_rate(worker)
        for piece in [each for each in self._checks if each.worker != worker]:
            allowed -= piece.samples
            if allowed < 0.0:
                self._checks.remove(piece)

    def _may_check(self, worker: int, piece: Piece) -> bool:
        """Whether a worker may check a piece: it must be another's, and that one's first or checkable in time."""
        if piece.worker == worker:
            return False
        if piece.worker not in self._checked:
            return True
        return self._overhead(worker) + piece.samples / self._check_rate(worker) <= self._last_seconds()

    def _check_seconds(self) -> float:
        """Seconds that the waiting pieces may take."""
        least, most = _CHECK_SECONDS
        planned = min(max(least, _CHECK_SHARE * (time.monotonic() - self._begin)), most)
        return min(planned, self._last_seconds())

    def _last_seconds(self) -> float:
        """Seconds that the run may still wait for checks; infinite while there are units to take."""
        if not self._remaining.is_empty:
            return math.inf
        now = time.monotonic()
        waited = 0.0 if any(task.kind is Kind.UNIT for task in self._out.values()) else now - self._last_unit
        return max(_LAST_CHECK_SECONDS, _LAST_CHECK_SHARE * (now - self._begin)) - waited

    def _check_rate(self, worker: int) -> float:
        """Samples a second of a worker in checks: its speed for units, if it has rendered any."""
        return self._rates.get(worker, self._check_rates.get(worker, math.inf))

    def _overhead(self, worker: int) -> float:
        """Seconds that a worker takes for a piece, in addition to those for its samples.

        The shorter of the last two: other load on the machine may have delayed one.
        """
        return min(self._check_overheads.get(worker, (0.0,)))

    def _task(self, worker: int, kind: Kind, piece: Piece | None) -> Task:
        return Task(next(self._numbers), worker, kind, None if piece is None else piece.unit, piece)

    def _occupied(self, worker: int) -> bool:
        """Whether a task of a worker is outstanding; its result may be on its way."""
        return any(task.worker == worker for task in self._out.values())

    def _copy(self, worker: int) -> Task:
        unit = None if self._ended else self._remaining.take(worker)
        if unit is not None:
            self._remaining.put_back(unit)
        return Task(next(self._numbers), worker, Kind.COPY, last=unit is None)

    def _put_back(self, task: Task) -> None:
        if task.kind is Kind.UNIT and task.unit is not None:
            self._remaining.put_back(task.unit)
        elif task.kind is Kind.CHECK and task.piece is not None:
            self._checks.append(task.piece)

    def _over(self) -> bool:
        """Whether no more tasks can arise: none is outstanding, no dispute is open, no waiting piece may be checked."""
        if self._out or self._holding or self._disputed or any(self._orders.values()):
            return False
        return not any(self._may_check(each, piece) for piece in self._checks for each in self._in_service)
