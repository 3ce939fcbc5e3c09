"""Interval between saves of a render: every few seconds, limited to a small share of the render time."""

from __future__ import annotations

import os
from typing import Final

__all__ = ["Cadence", "processors"]

EVERY_SECONDS: Final = 5.0
"""Seconds between the starts of two saves. If the process dies, everything since the start of the last complete save is
lost. With the unit in progress, about a second, and the save itself, that is less than ten seconds."""

SHARE: Final = 0.02
"""Largest share of the render time that saving may take."""


class Cadence:
    """Schedule of saves: every few seconds, or less often if saving takes more than its share.

    Parameters
    ----------
    now : float
        Time at the start of the render, seconds on any clock.

    Attributes
    ----------
    interval : float
        Seconds between the starts of two saves.
    """

    def __init__(self, now: float) -> None:
        self.interval = EVERY_SECONDS
        self._next = now + self.interval

    def due(self, now: float) -> bool:
        """Whether a save is due."""
        return now >= self._next

    def saved(self, began: float, cost: float) -> None:
        """Record the start of a save and its cost to the render, seconds, whether it succeeded or not."""
        self.interval = max(EVERY_SECONDS, cost / SHARE)
        self._next = began + self.interval


def processors() -> int:
    """Number of processors that this process may use."""
    try:
        return max(1, len(os.sched_getaffinity(0)))
    except AttributeError:  # the system does not report it
        return os.cpu_count() or 1
