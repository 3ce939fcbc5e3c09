"""The queue of the render thread: messages of viewers, and calls of other threads."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Final, TypeVar

from clrender.errors import UsageError
from clrender.view.messages import Message, MoveCamera
from clrender.wording import counted

if TYPE_CHECKING:
    from clrender.view.viewer import Viewer

__all__ = ["Inbox"]

_MOST: Final = 256
"""Messages that may wait."""

_Result = TypeVar("_Result")


class Inbox:
    """A queue that the render thread empties between launches; other threads fill it.

    Attributes
    ----------
    closed : bool
        Whether the render thread is to end.
    """

    def __init__(self) -> None:
        self.closed = False
        self._messages: deque[tuple[Viewer, Message]] = deque()
        self._calls: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._last_calls: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._woken = False
        self._changed = threading.Condition()

    def post(self, viewer: Viewer, message: Message) -> None:
        """Queue a message; a camera message that waits is merged with a newer one of the same viewer.

        Raises
        ------
        UsageError
            Too many wait.
        """
        with self._changed:
            sender, last = self._messages[-1] if self._messages else (None, None)
            if sender is viewer and isinstance(message, MoveCamera) and isinstance(last, MoveCamera):
                merged = {**last.camera, **message.camera}
                self._messages[-1] = viewer, message.model_copy(update={"camera": merged})
            elif len(self._messages) >= _MOST:
                raise UsageError(f"{counted(_MOST, 'message')} wait already; send fewer at a time")
            else:
                self._messages.append((viewer, message))
            self._changed.notify_all()

    def call(self, function: Callable[[], _Result], *, after_messages: bool = False) -> Future[_Result]:
        """Have the render thread call a function; cancelled when the thread ends before.

        Parameters
        ----------
        function : callable
        after_messages : bool
            Whether all messages that wait are handled first; otherwise it comes before them.
        """
        future: Future[_Result] = Future()
        with self._changed:
            if self.closed:
                future.cancel()
            else:
                (self._last_calls if after_messages else self._calls).append((function, future))
                self._changed.notify_all()
        return future

    def wake(self) -> None:
        """Have the render thread look for what is wanted now; several of these that wait are one."""
        with self._changed:
            self._woken = True
            self._changed.notify_all()

    def close(self) -> None:
        """Have the render thread end."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()

    @property
    def camera_waits(self) -> bool:
        """Whether a camera message waits."""
        with self._changed:
            return any(isinstance(message, MoveCamera) for _, message in self._messages)

    # --- the render thread ---

    @property
    def pending(self) -> bool:
        """Whether something waits."""
        return bool(self._messages or self._calls or self._last_calls) or self._woken or self.closed

    def process(self, handle: Callable[[Viewer, Message], None]) -> None:
        """Handle all messages, and run all calls."""
        while self.pending and not self.closed:
            with self._changed:
                self._woken = False
                first = self._calls if self._calls or self._messages else self._last_calls
                call = first.popleft() if first else None
                posted = self._messages.popleft() if call is None and self._messages else None
            if call is not None:
                _resolve(*call)
            if posted is not None:
                handle(*posted)

    def wait(self) -> None:
        """Block until something waits."""
        with self._changed:
            self._changed.wait_for(lambda: self.pending)

    def refuse_all(self) -> None:
        """Close, and cancel the calls that wait."""
        self.close()
        for calls in (self._calls, self._last_calls):
            while calls:
                calls.popleft()[1].cancel()


def _resolve(function: Callable[[], Any], future: Future[Any]) -> None:
    if future.set_running_or_notify_cancel():
        try:
            future.set_result(function())
        except Exception as error:
            future.set_exception(error)
