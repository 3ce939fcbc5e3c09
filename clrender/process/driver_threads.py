"""Threads that call drivers, and the end of a process in which one of them still does.

A driver's call cannot be interrupted, so the process must not wait for these threads without limit: they are daemon
threads. If one returns from such a call while CPython finalizes, CPython ends the thread inside the driver's binding,
which is C++, and the runtime of C++ then aborts the process. A process with such threads therefore waits for them
briefly, and else has to end without finalization.
"""

from __future__ import annotations

import atexit
import time
import weakref
from collections.abc import Callable
from typing import Any, Final

from clrender.process.pooled_threads import PooledThread

__all__ = ["driver_thread", "wait_for_driver_threads"]

_PATIENCE: Final = 10.0
"""Seconds to wait for the threads in a process whose end is not ours to choose, as that of a notebook."""

_threads: Final[weakref.WeakSet[PooledThread]] = weakref.WeakSet()


def driver_thread(target: Callable[..., Any], *arguments: Any, name: str | None = None) -> PooledThread:
    """Make a daemon thread, not yet started, that may call a driver.

    Parameters
    ----------
    target : callable
    *arguments
        Its arguments.
    name : str, optional
    """
    thread = PooledThread(target, *arguments, name=name)
    _threads.add(thread)
    return thread


def wait_for_driver_threads(seconds: float) -> bool:
    """Wait until all threads that call drivers have ended.

    Parameters
    ----------
    seconds : float
        Time limit.

    Returns
    -------
    bool
        Whether they have.
    """
    end = time.monotonic() + seconds
    for thread in [each for each in _threads if each.is_alive()]:
        thread.join(max(0.0, end - time.monotonic()))
    return not any(each.is_alive() for each in _threads)


atexit.register(wait_for_driver_threads, _PATIENCE)
