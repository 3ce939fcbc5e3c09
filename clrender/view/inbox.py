"""What waits for the thread that renders: messages of viewers, and calls of other threads."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Final, TypeVar

from clrender.errors import UsageError
from clrender.view.messages import Message, MoveCamera

if TYPE_CHECKING:
    from clrender.view.viewer import Viewer

__all__ = ["Inbox"]

_MOST: Final = 256
"""Messages that may wait."""

_Result = TypeVar("_Result")


class Inbox:
    """A queue whose reader has other things to do, too.

    Attributes
    ----------
    closed : bool
        Whether the reader is to end.
    """

    def __init__(self) -> None:
        self.closed = False
        self._messages: deque[tuple[Viewer, Message]] = deque()
        self._calls: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._nudged = False
        self._changed = threading.Condition()

    def post(self, viewer: Viewer, message: Message) -> None:
        """A message; a camera that waits is replaced by a newer one of the same viewer.

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
                raise UsageError(f"{_MOST} messages wait already; send fewer at a time")
            else:
                self._messages.append((viewer, message))
            self._changed.notify_all()

    def call(self, function: Callable[[], _Result]) -> Future[_Result]:
        """Have the reader call something; cancelled when it ends before."""
        future: Future[_Result] = Future()
        with self._changed:
            if self.closed:
                future.cancel()
            else:
                self._calls.append((function, future))
                self._changed.notify_all()
        return future

    def nudge(self) -> None:
        """Have the reader look anew at what it does; any number of nudges that wait are one."""
        with self._changed:
            self._nudged = True
            self._changed.notify_all()

    def close(self) -> None:
        """Have the reader end."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()

    # --- the reader ---

    @property
    def urgent(self) -> bool:
        """Whether something waits."""
        return bool(self._messages or self._calls) or self._nudged or self.closed

    def follow(self, answer: Callable[[Viewer, Message], None]) -> None:
        """Have all that waits answered, or called."""
        while self.urgent and not self.closed:
            with self._changed:
                self._nudged = False
                call = self._calls.popleft() if self._calls else None
                posted = self._messages.popleft() if call is None and self._messages else None
            if call is not None:
                _resolve(*call)
            if posted is not None:
                answer(*posted)

    def wait(self) -> None:
        """Wait until there is something."""
        with self._changed:
            self._changed.wait_for(lambda: self.urgent)

    def refuse_all(self) -> None:
        """The reader has ended: nothing is called any more."""
        self.close()
        while self._calls:
            self._calls.popleft()[1].cancel()


def _resolve(function: Callable[[], Any], future: Future[Any]) -> None:
    if future.set_running_or_notify_cancel():
        try:
            future.set_result(function())
        except Exception as error:
            future.set_exception(error)
