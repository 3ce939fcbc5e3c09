"""Turns at something that only one render at a time may use: a session, and a device that several sessions share."""

from __future__ import annotations

import threading
from typing import Any

from clrender.errors import UsageError

__all__ = ["Turn"]


class Turn:
    """A lock for which other threads wait. The thread that has it is refused instead: it would wait for itself.

    A context manager.

    Parameters
    ----------
    busy : str
        What the message says to a thread that asks again while it has its turn.
    """

    def __init__(self, busy: str) -> None:
        self._busy = busy
        self._lock = threading.RLock()
        self._taken = False

    def __enter__(self) -> Turn:
        # Reentrant, so that an interrupt right after this line leaves nothing that this thread would wait for
        self._lock.acquire()
        if self._taken:
            self._lock.release()
            raise UsageError(self._busy)
        self._taken = True
        return self

    def __exit__(self, *details: Any) -> None:
        self._taken = False
        self._lock.release()
