"""How much of the processor other programs take while the report is measured."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Final

__all__ = ["MachineLoad"]

_STAT: Final = Path("/proc/stat")
_WAITING: Final = (3, 4)
"""Columns of idle processors: with nothing to do, and waiting for a disk."""
_GUESTS: Final = 8
"""Columns from here on are parts of others."""


class MachineLoad:
    """Measures from its creation on; on systems without `/proc/stat` nothing is known and the share is 0."""

    def __init__(self) -> None:
        self._begin = self._now()

    def share(self) -> float:
        """Part of the processors' time, 0 to 1, that other programs have taken since the beginning."""
        processors, busy, own = (now - begin for now, begin in zip(self._now(), self._begin, strict=True))
        return min(max((busy - own) / processors, 0.0), 1.0) if processors > 0.0 else 0.0

    @staticmethod
    def _now() -> tuple[float, float, float]:
        """Seconds of all processors, of those that were busy, and of this process with its finished children."""
        try:
            ticks = [int(word) for word in _STAT.read_text().splitlines()[0].split()[1:]][:_GUESTS]
        except (OSError, ValueError, IndexError):
            return 0.0, 0.0, 0.0
        second = os.sysconf("SC_CLK_TCK")
        times = os.times()
        own = time.process_time() + times.children_user + times.children_system
        busy = sum(count for column, count in enumerate(ticks) if column not in _WAITING)
        return sum(ticks) / second, busy / second, own
