"""Locks for resources that only one render at a time may use: sessions, and devices that several sessions share."""

from __future__ import annotations

import threading
from typing import Any

from clrender.errors import UsageError

__all__ = ["Turn"]


class Turn:
    """A non-reentrant lock. Other threads wait for it; the thread that holds it gets an error instead of a deadlock.

    It is a context manager.

    Parameters
    ----------
    busy : str
        Message of the error if a thread acquires the lock while it already holds it.
    """

    def __init__(self, busy: str) -> None:
        self._busy = busy
        self._lock = threading.RLock()
        self._taken = False

    def __enter__(self) -> Turn:
        # An `RLock`, so that an interrupt right after this line cannot make this thread wait for itself later
        self._lock.acquire()
        if self._taken:
            self._lock.release()
            raise UsageError(self._busy)
        self._taken = True
        return self

    def __exit__(self, *details: Any) -> None:
        self._taken = False
        self._lock.release()
