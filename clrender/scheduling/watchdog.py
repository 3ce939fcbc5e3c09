"""Watch over calls that do not come back: how long a worker has been silent, against what it took before."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Final

__all__ = ["TimeLimits", "Watchdog"]

_LONGEST_STEP: Final = 1.0
"""Seconds that count between two looks. More have passed where this process itself was stopped or starved."""
_BETWEEN: Final = 0.02


@dataclass(frozen=True)
class TimeLimits:
    """How long to wait for a device, and how often to try again.

    Attributes
    ----------
    call : float
        Seconds that one call of a driver may always take, once the device has shown how fast it is.
    factor : float
        Or so many times the longest call so far, if that is more.
    compile : float
        Seconds that its compiler may take, as may setting up and the first slice of samples, which say nothing yet.
    hurry : float
        In place of `call` when somebody wants the render to end.
    pause : float
        Seconds before a device that failed is set up again; twice as long each time.
    retries : int
        How often in a row.
    steady : int
        Units after which a device no longer counts as one that failed.
    """

    call: float = 60.0
    factor: float = 20.0
    compile: float = 1800.0
    hurry: float = 5.0
    pause: float = 1.0
    retries: int = 3
    steady: int = 16


class Watchdog:
    """How long workers have been silent.

    Signs of life are the calls of a device that begin or end, and whatever a worker's thread says.

    Parameters
    ----------
    pulses : sequence of callable or None
        One for each worker.
    limits : TimeLimits
    clock : callable
        Seconds; one that stands still while the machine sleeps.
    """

    def __init__(
        self,
        pulses: Sequence[Callable[[], tuple[int, bool]] | None],
        limits: TimeLimits,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._pulses = pulses
        self._limits = limits
        self._clock = clock
        self._last = clock()
        self._silent = [0.0] * len(pulses)
        self._longest = [0.0] * len(pulses)
        self._known = [False] * len(pulses)
        self._seen: list[tuple[int, bool] | None] = [None] * len(pulses)

    def beat(self, worker: int, *, slice_done: bool = False) -> None:
        """A worker's thread said something; `slice_done`: that some samples are done."""
        if self._known[worker]:
            self._longest[worker] = max(self._longest[worker], self._silent[worker])
        self._known[worker] |= slice_done
        self._silent[worker] = 0.0

    def start_over(self, worker: int) -> None:
        """A worker is set up again: nothing is known of it."""
        self._known[worker], self._silent[worker] = False, 0.0

    def silent(self, busy: Collection[int], *, waited_for: bool = False, hurry: bool = False) -> list[int]:
        """Workers that have been silent for too long.

        Parameters
        ----------
        busy : collection of int
            Those that have something to do.
        waited_for : bool
            All others have nothing left to do: compiling gets no more time than a call.
        hurry : bool
            Somebody wants the render to end.
        """
        now = self._clock()
        step = now - self._last
        if step < _BETWEEN:
            return []
        self._last = now
        late = []
        for worker, pulse in enumerate(self._pulses):
            if worker not in busy:
                self._silent[worker] = 0.0
                continue
            seen = pulse() if pulse is not None else None
            if seen != self._seen[worker]:
                self._seen[worker] = seen
                self.beat(worker)
            self._silent[worker] += min(step, _LONGEST_STEP)
            compiling = not self._known[worker] or (seen is not None and seen[1])
            if self._silent[worker] > self._limit(worker, compiling and not waited_for, hurry):
                late.append(worker)
        return late

    def _limit(self, worker: int, compiling: bool, hurry: bool) -> float:
        limits = self._limits
        if hurry:
            return limits.call if compiling else max(limits.hurry, limits.factor * self._longest[worker] / 4.0)
        if compiling:
            return max(limits.compile, limits.call)
        return max(limits.call, limits.factor * self._longest[worker])
