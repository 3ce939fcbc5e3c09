"""Watchdog for driver calls that do not return: compares a worker's silence with its earlier call durations."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Final

from clrender.process.elapsed import Elapsed

__all__ = ["TimeLimits", "Watchdog"]

_BETWEEN: Final = 0.02
"""Least seconds between two looks."""


@dataclass(frozen=True)
class TimeLimits:
    """How long to wait for a device, and how often to try again.

    Seconds are those of `clrender.process.elapsed.Elapsed`: a starved process is slow, but does not hang.

    Attributes
    ----------
    call : float
        Seconds that any driver call may take, after the first slice of samples.
    factor : float
        A call may also take this many times as long as the longest call so far.
    compile : float
        Seconds that compilation, set-up and the first slice of samples may take, before speeds are known.
    hurry : float
        Replaces `call` while the render is being stopped.
    pause : float
        Seconds before a device that failed is set up again; doubled each time.
    retries : int
        Most retries in a row.
    steady : int
        Units after which the earlier failures of a device are forgotten.
    """

    call: float = 60.0
    factor: float = 20.0
    compile: float = 1800.0
    hurry: float = 5.0
    pause: float = 1.0
    retries: int = 3
    steady: int = 16


class Watchdog:
    """Measures how long workers have been silent.

    Signs of life are driver calls that begin or end, and the events of a worker's thread.

    Parameters
    ----------
    pulses : sequence of callable or None
        One for each worker.
    limits : TimeLimits
    clock : callable
        Clock in seconds, which should not advance while the machine sleeps.
    processors : sequence of callable or None, optional
        Processor seconds in this process that each worker may have used; None for workers elsewhere.
    """

    def __init__(
        self,
        pulses: Sequence[Callable[[], tuple[int, bool]] | None],
        limits: TimeLimits,
        clock: Callable[[], float] = time.monotonic,
        processors: Sequence[Callable[[], float] | None] | None = None,
    ) -> None:
        self._pulses = pulses
        self._limits = limits
        self._clock = clock
        self._last = clock()
        self._silent = [Elapsed(each) for each in processors or [None] * len(pulses)]
        self._longest = [0.0] * len(pulses)
        self._known = [False] * len(pulses)
        self._seen: list[tuple[int, bool] | None] = [None] * len(pulses)

    def beat(self, worker: int, *, slice_done: bool = False) -> None:
        """Note an event of a worker's thread; `slice_done` means that some samples are done."""
        if self._known[worker]:
            self._longest[worker] = max(self._longest[worker], self._silent[worker].seconds)
        self._known[worker] |= slice_done
        self._silent[worker].start_over()

    def start_over(self, worker: int) -> None:
        """Forget the history of a worker, which is set up again."""
        self._known[worker] = False
        self._silent[worker].start_over()

    def silent(self, busy: Collection[int], *, waited_for: bool = False, hurry: bool = False) -> list[int]:
        """Workers that have been silent for too long.

        Parameters
        ----------
        busy : collection of int
            Workers that have work to do.
        waited_for : bool
            Whether all others have nothing left to do. Compiling then gets no more time than a call.
        hurry : bool
            Whether the render is being stopped; `waited_for` then means that there are samples to keep.
        """
        now = self._clock()
        step = now - self._last
        if step < _BETWEEN:
            return []
        self._last = now
        late = []
        for worker, pulse in enumerate(self._pulses):
            if worker not in busy:
                self._silent[worker].start_over()
                continue
            seen = pulse() if pulse is not None else None
            if seen != self._seen[worker]:
                self._seen[worker] = seen
                self.beat(worker)
            self._silent[worker].add(step)
            compiling = not self._known[worker] or (seen is not None and seen[1])
            if self._silent[worker].seconds > self._limit(worker, compiling, waited_for, hurry):
                late.append(worker)
        return late

    def _limit(self, worker: int, compiling: bool, waited_for: bool, hurry: bool) -> float:
        limits, longest = self._limits, self._longest[worker]
        if compiling:
            if not waited_for:
                return max(limits.compile, limits.call)
            return limits.call if hurry else max(limits.call, limits.factor * longest)
        if hurry:
            return max(limits.hurry, limits.factor * longest / 4.0)
        return max(limits.call, limits.factor * longest)
