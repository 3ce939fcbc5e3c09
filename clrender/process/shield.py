"""Calls that signals cannot interrupt half-way.

Python raises KeyboardInterrupt, and whatever other signal handlers raise, between any two instructions of the main
thread. Work that changes devices, films or files therefore runs in a thread of its own, where no signal arrives. The
main thread only waits for it and executes the callbacks. If it is interrupted, it asks the work to stop, waits a moment
and leaves; the work then ends by itself, in order, and the next call waits for that.
"""

from __future__ import annotations

import atexit
import contextvars
import queue
import threading
import weakref
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Any, Final, TypeVar

from clrender.process.pooled_threads import PooledThread

__all__ = ["Abandoned", "Call"]

_T = TypeVar("_T")

PATIENCE: Final = 0.8
"""Seconds to wait for the work to end after an interruption, which must take effect within a second."""

_threads: Final[weakref.WeakSet[PooledThread]] = weakref.WeakSet()
"""Those of the calls."""


class Abandoned(BaseException):
    """Ends work that is not waited for any more, before it has begun."""


class Call:
    """A call made in the current thread, and its callbacks.

    Attributes
    ----------
    caller : int
        Identifier of the calling thread.
    abandoned : bool
        Whether the calling thread does not wait for the call, or no longer.
    """

    def __init__(self) -> None:
        self.caller = threading.get_ident()
        self.abandoned = False
        self._requests: queue.SimpleQueue[Callable[[], Any] | None] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[tuple[Any, Exception | None]] = queue.SimpleQueue()
        self._asking = threading.Lock()
        self._deadline: float | None = None
        self._outcome: tuple[Any, BaseException | None] = None, None

    def run(self, work: Callable[[], _T]) -> _T:
        """Execute the work and return its result. Only in the main thread is it moved to a thread of its own.

        Raises
        ------
        BaseException
            Any exception of the work or of a callback, and any that a signal raises meanwhile.
        """
        if threading.current_thread() is not threading.main_thread():
            return work()
        thread = PooledThread(self._work, work, name="clrender call", context=contextvars.copy_context())
        _threads.add(thread)
        try:
            try:
                thread.start()
                while (request := self._requests.get()) is not None:
                    self._serve(request)
            finally:
                self._leave(thread)
        finally:
            self._leave(thread)  # a second interruption may have ended the first
        (result, error), self._outcome = self._outcome, (None, None)
        if error is not None:
            try:
                raise error
            finally:
                del error  # it refers to this frame
        return result  # type: ignore[no-any-return]

    def callback(self, function: Callable[..., _T], otherwise: _T) -> Callable[..., _T]:
        """A function that has `function` called in the calling thread.

        It returns `otherwise` once the call is abandoned.
        """
        return partial(self._ask, function, otherwise)

    def _ask(self, function: Callable[..., _T], otherwise: _T, *arguments: Any) -> _T:
        if threading.get_ident() == self.caller:
            return function(*arguments)
        with self._asking:
            if self.abandoned:
                return otherwise
            self._requests.put(partial(function, *arguments))
            result, error = self._answers.get()
            if error is not None:
                raise error
            return otherwise if self.abandoned else result  # type: ignore[no-any-return]

    def _serve(self, request: Callable[[], Any]) -> None:
        try:
            answer = request()
        except Exception as error:
            self._answers.put((None, error))
        else:
            self._answers.put((answer, None))

    def _work(self, work: Callable[[], Any]) -> None:
        """Main function of the work's thread."""
        try:
            if not self.abandoned:
                self._outcome = work(), None
        except BaseException as error:
            self._outcome = None, error
        finally:
            self._requests.put(None)

    def _leave(self, thread: PooledThread) -> None:
        """Stop waiting for callbacks' requests. If the work has not ended, it is asked to, and waited for briefly.

        However often it is called, it waits for `PATIENCE` since the first time at most.
        """
        self.abandoned = True
        self._answers.put((None, None))
        now = monotonic()
        if self._deadline is None:
            self._deadline = now + PATIENCE
        thread.join(max(self._deadline - now, 0.0))


def _wait_for_calls() -> None:
    """Wait for work that was left: it may change a file, and ends by itself, in order."""
    for thread in list(_threads):
        thread.join()


atexit.register(_wait_for_calls)
