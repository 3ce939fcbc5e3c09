"""Time that a computation has had, which is less than what passes on a machine that has no time for it.

A process may be stopped, or get a small part of a processor. Whoever watches a driver or a child process then must not
take its slowness for a hang.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Final

__all__ = ["Elapsed", "processor_seconds", "processor_seconds_of"]

ON_TIME: Final = 0.25
"""Seconds between two looks above which the watching process itself did not run. That time does not count."""

_STARVED_SHARE: Final = 0.01
"""Share of a processor from which on a computation counts as running, not as idle."""

_UNMEASURED: Final = 1.0
"""Seconds up to which processor time is not looked at, which costs more than looking at a clock."""


class Elapsed:
    """Seconds that a computation has had: those of a processor that it used, and those in which it was idle.

    Parameters
    ----------
    processor : callable, optional
        Processor seconds that it has used so far. Without it, all time counts as idle.
    """

    def __init__(self, processor: Callable[[], float] | None = None) -> None:
        self._processor = processor
        self.start_over()

    def start_over(self) -> None:
        """Begin at 0."""
        self._used = self._idle = self._passed = 0.0
        self._before: float | None = None

    @property
    def seconds(self) -> float:
        """The time so far."""
        return self._used + self._idle

    def add(self, step: float) -> None:
        """Add the time since the last look.

        Parameters
        ----------
        step : float
            Seconds.
        """
        here = step if step <= ON_TIME else 0.0
        self._passed += step
        if self._processor is None or self._passed < _UNMEASURED:
            self._idle += here
            return
        now = self._processor()
        used = 0.0 if self._before is None else max(now - self._before, 0.0)
        self._before = now
        self._used += min(used, step)
        # What was counted as idle was not, if it gets its share in bursts
        self._idle = max(0.0, self._idle + here - used / _STARVED_SHARE)


def processor_seconds(threads: Callable[[], Collection[threading.Thread]]) -> Callable[[], float]:
    """Processor seconds of this process, without its Python threads, except some.

    Parameters
    ----------
    threads : callable
        Python threads that count, because they call a driver.
    """

    def seconds() -> float:
        counted = threads()
        others = [each for each in threading.enumerate() if each not in counted]
        return time.process_time() - sum(_seconds_of_thread(each.native_id) for each in others)

    return seconds


def _seconds_of_thread(number: int | None) -> float:
    try:
        return int(Path(f"/proc/self/task/{number}/schedstat").read_text().split()[0]) * 1e-9
    except (OSError, ValueError, IndexError):  # it has just ended, or this system does not say
        return 0.0


def processor_seconds_of(pid: int) -> float:
    """Processor seconds of another process and of its children that have ended; 0 if the system does not say."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError):
        return 0.0
