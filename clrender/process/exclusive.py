"""Locks for resources that only one render at a time may use: sessions, and devices that several sessions share."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from clrender.errors import UsageError
from clrender.process.shield import Abandoned, Call

__all__ = ["Turn"]

_LOOK_SECONDS: Final = 0.1
"""Interval at which a call that waits looks whether its caller still does."""


class Turn:
    """A non-reentrant lock. Calls wait for it; one from a callback of its holder gets an error instead of a deadlock.

    Parameters
    ----------
    busy : str
        Message of that error.
    """

    def __init__(self, busy: str) -> None:
        self._busy = busy
        self._lock = threading.Lock()
        self._holder: Call | None = None

    @contextmanager
    def of(self, call: Call) -> Iterator[None]:
        """Context in which a call holds the lock; entered in the call's own thread.

        Raises
        ------
        UsageError
            When a call that has not ended, made in the same thread, holds it.
        """
        holder = self._holder
        # A call that was abandoned still holds it for a moment, but is not waited for by this thread
        if holder is not None and holder.caller == call.caller and not holder.abandoned:
            raise UsageError(self._busy)
        while not self._lock.acquire(timeout=_LOOK_SECONDS):
            if call.abandoned:
                raise Abandoned
        self._holder = call
        try:
            yield
        finally:
            self._holder = None
            self._lock.release()
