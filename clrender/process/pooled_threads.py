"""Threads that stay for a moment after their work, and take the next.

To start a thread and to wait until it runs takes as long as the kernels of a small image, which needs two: one that is
shielded from signals, and one that calls the driver. Renders that follow each other find theirs still there.
"""

from __future__ import annotations

import contextvars
import os
import queue
import sys
import threading
from collections.abc import Callable
from typing import Any, Final

__all__ = ["PooledThread"]

_LINGER: Final = 0.5
"""Seconds for which a thread stays without work."""

_NAME: Final = "clrender idle"


class PooledThread:
    """A daemon thread, not yet started, or one that an earlier one has left; used like a `threading.Thread`.

    Parameters
    ----------
    target : callable
    *arguments
        Its arguments.
    name : str, optional
        Name of the thread while it works.
    context : contextvars.Context, optional
        Context to work in; by default an empty one, as that of a new thread.
    """

    def __init__(
        self,
        target: Callable[..., Any],
        *arguments: Any,
        name: str | None = None,
        context: contextvars.Context | None = None,
    ) -> None:
        self._work: tuple[Callable[..., Any], tuple[Any, ...]] | None = (target, arguments)
        self._context = context or contextvars.Context()
        self.name = name or f"clrender {getattr(target, '__name__', 'work')}"
        self.thread: threading.Thread | None = None
        self._begun = self._given = False
        self._ended = threading.Event()

    def start(self) -> None:
        """Begin the work. A second call is an error, as for any thread."""
        if self._begun:
            raise RuntimeError("threads can only be started once")
        self._begun = True
        _pool.give(self)
        self._given = True

    def is_alive(self) -> bool:
        """Whether the work was begun and has not ended."""
        # Nobody waits for what an interrupted `start` has not given to a thread
        return (self._given or self.thread is not None) and not self._ended.is_set()

    def join(self, timeout: float | None = None) -> None:
        """Wait until the work has ended.

        Parameters
        ----------
        timeout : float, optional
            Most seconds to wait.
        """
        if self.is_alive():
            self._ended.wait(timeout)

    def execute(self, thread: threading.Thread) -> None:
        """Do the work in a thread; only the pool calls this."""
        assert self._work is not None, "it works once"
        self.thread = thread
        target, arguments = self._work
        self._work = None
        try:
            self._context.run(target, *arguments)
        except BaseException:
            kind, error, trace = sys.exc_info()
            assert kind is not None
            threading.excepthook(threading.ExceptHookArgs((kind, error, trace, thread)))
        finally:
            self.thread = None

    def end(self) -> None:
        """Tell those who wait that the work has ended; only the pool calls this."""
        self._ended.set()


class _Pool:
    """The threads of this process that have no work."""

    def __init__(self) -> None:
        self.forked()

    def forked(self) -> None:
        """Begin without threads, as a process that was forked: it has none of its parent's."""
        self._lock = threading.Lock()
        self._idle: list[_Thread] = []

    def give(self, work: PooledThread) -> None:
        """Have a thread do some work."""
        # Both under one lock, as an idle thread may be about to end. An interruption between them costs a thread only
        wanted = _niceness()
        with self._lock:
            self._idle = [each for each in self._idle if each.is_alive()]
            for number in reversed(range(len(self._idle))):
                if self._idle[number].niceness == wanted:
                    self._idle.pop(number).tasks.put(work)
                    return
        thread = _Thread(self)
        thread.tasks.put(work)
        thread.start()

    def take_back(self, thread: _Thread) -> None:
        """Note that a thread has no work."""
        with self._lock:
            self._idle.append(thread)

    def may_end(self, thread: _Thread) -> bool:
        """Whether a thread without work may end; it gets none from then on."""
        with self._lock:
            if not thread.tasks.empty():
                return False
            if thread in self._idle:
                self._idle.remove(thread)
            return True


class _Thread(threading.Thread):
    """A thread of a pool."""

    def __init__(self, pool: _Pool) -> None:
        super().__init__(name=_NAME, daemon=True)
        self._pool = pool
        self.tasks: queue.SimpleQueue[PooledThread] = queue.SimpleQueue()
        self.niceness = 0

    def run(self) -> None:
        """Do what is given until nothing comes for a while."""
        while True:
            try:
                work = self.tasks.get(timeout=_LINGER)
            except queue.Empty:
                if self._pool.may_end(self):
                    return
                continue
            self.name = work.name
            work.execute(self)
            self.name = _NAME
            self.niceness = _niceness()
            self._pool.take_back(self)  # before it is told, so that who waited for it finds the thread
            work.end()
            del work


def _niceness() -> int:
    """Niceness of the calling thread: threads inherit it from whom they are started by, and only root lowers it."""
    try:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    except (AttributeError, OSError):  # a system without
        return 0


_pool: Final = _Pool()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.forked)
