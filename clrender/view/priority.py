"""Scheduling priority of the threads that render: the browser, on the same machine, goes first."""

from __future__ import annotations

import contextlib
import os
import threading
from typing import Final

__all__ = ["lower_priority"]

_NICENESS: Final = 10


def lower_priority() -> None:
    """Lower the priority of the calling thread, and of threads that it starts. Does nothing where that is impossible.

    On Linux a niceness belongs to a thread. A CPU driver starts its threads when its first device is opened.
    """
    with contextlib.suppress(AttributeError, OSError):
        thread = threading.get_native_id()
        os.setpriority(os.PRIO_PROCESS, thread, max(_NICENESS, os.getpriority(os.PRIO_PROCESS, thread)))
