"""How often a render saves itself: every few seconds, but for no more than a small share of its time."""

from __future__ import annotations

import os
from typing import Final

__all__ = ["Cadence", "processors"]

EVERY_SECONDS: Final = 5.0
"""From the beginning of one save to that of the next. A unit lasts about a second, and what is lost with a process is
what came in since the last save that ended had begun: with a unit and the save itself less than ten seconds."""

SHARE: Final = 0.02
"""Of the render's time that saving may take."""


class Cadence:
    """When to save next: every few seconds, and less often where saving takes more than its share.

    Parameters
    ----------
    now : float
        Seconds, on any clock, when the render begins.

    Attributes
    ----------
    interval : float
        Seconds from the beginning of one save to that of the next.
    """

    def __init__(self, now: float) -> None:
        self.interval = EVERY_SECONDS
        self._next = now + self.interval

    def due(self, now: float) -> bool:
        """Whether it is time."""
        return now >= self._next

    def saved(self, began: float, cost: float) -> None:
        """A save that began at a moment has cost the render so many seconds, whether it succeeded or not."""
        self.interval = max(EVERY_SECONDS, cost / SHARE)
        self._next = began + self.interval


def processors() -> int:
    """How many processors this process may use."""
    try:
        return max(1, len(os.sched_getaffinity(0)))
    except AttributeError:  # a system that does not tell
        return os.cpu_count() or 1
