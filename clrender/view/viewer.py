"""One page or widget that looks on: what it is still to be sent, and no more of it than it takes."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from clrender.errors import ClrenderError, UsageError
from clrender.view.frames import LAYERS, encode
from clrender.view.messages import Ack, Message, Show, parse

if TYPE_CHECKING:
    from clrender.view.engine import Engine
    from clrender.view.frames import Shot

__all__ = ["Viewer"]

_MOST_REPLIES: Final = 256
"""Replies that may wait; who does not take them is not listened to any more."""
_MOST_MALFORMED: Final = 100


@dataclass(eq=False)
class _Shown:
    """A layer that is shown.

    Attributes
    ----------
    layer : str
    seen : (int, int)
        Revision and changes of the newest frame that was sent.
    under_way : int or None
        Number of a frame that is not acknowledged yet.
    """

    layer: str
    seen: tuple[int, int] = (-1, -1)
    under_way: int | None = None


class Viewer:
    """What a transport talks to; made by `Engine.connect`. All may be called in any thread.

    Parameters
    ----------
    engine : Engine
    number : int
        Of the viewer.
    wake : callable
        Called, in any thread, when there may be something to `take`.

    Attributes
    ----------
    closed : str or None
        Why the transport is to hang up.
    camera_id : int, str or None
        The `id` of its newest camera message that was followed; set by the thread that renders.
    """

    def __init__(self, engine: Engine, number: int, wake: Callable[[], None]) -> None:
        self.number = number
        self.closed: str | None = None
        self.camera_id: int | str | None = None
        self._engine, self._wake = engine, wake
        self._lock = threading.Lock()
        self._replies: deque[str] = deque()
        self._newest: dict[str, str] = {}
        self._shown = [_Shown("image")]
        self._half, self._most = True, 2048
        self._frames = self._malformed = 0

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of what it shows."""
        return tuple(shown.layer for shown in self._shown)

    def receive(self, text: str | bytes) -> None:
        """Take in a message of the page; what is wrong with it is replied, and never raised."""
        message = None
        try:
            if not isinstance(text, str):
                raise UsageError("messages are texts")
            message = parse(text)
            if isinstance(message, Ack):
                self._acknowledge(message.frame)
            elif isinstance(message, Show):
                self._show(message)
                self._engine.nudge()
            else:
                self._engine.post(self, message)
        except ClrenderError as error:
            self._malformed += message is None
            if self._malformed > _MOST_MALFORMED:
                self.end("too many messages that are none")
            self.refuse(message, str(error))

    def take(self) -> str | bytes | None:
        """What is to be sent next, if there is anything; a frame is made here, which takes some milliseconds.

        One thread at a time.
        """
        with self._lock:
            for kind in list(self._newest):
                return self._newest.pop(kind)
            if self._replies:
                return self._replies.popleft()
            wanted = [shown for shown in self._shown if shown.under_way is None]
        shot = self._engine.shot
        return None if shot is None else self._frame(shot, wanted)

    @property
    def told(self) -> bool:
        """Whether all that it is told has been taken."""
        with self._lock:
            return not self._replies and not self._newest

    def close(self) -> None:
        """It looks on no more."""
        self._engine.disconnect(self)

    def end(self, reason: str) -> None:
        """Close it from the engine's side: the transport is to hang up."""
        self.closed = self.closed or reason
        self._wake()

    def tell(self, kind: str, content: Mapping[str, Any], *, newest: bool = True) -> None:
        """Have a message sent.

        Parameters
        ----------
        kind : str
            Its type.
        content : mapping
            JSON-able.
        newest : bool
            Whether it takes the place of one of its type that was not taken yet.
        """
        text = json.dumps({"type": kind, **content}, separators=(",", ":"))
        with self._lock:
            if newest:
                self._newest[kind] = text
            elif len(self._replies) < _MOST_REPLIES:
                self._replies.append(text)
            else:
                self.closed = self.closed or "what is sent is not taken"
        self._wake()

    def reply(self, kind: str, message: Message | None, content: Mapping[str, Any]) -> None:
        """Answer a message; the answer has its `id`."""
        number = None if message is None else message.id
        self.tell(kind, content if number is None else {**content, "id": number}, newest=False)

    def refuse(self, message: Message | None, why: str) -> None:
        """Say that a message was not followed, and why."""
        self.reply("refused", message, {"to": getattr(message, "type", None), "message": why})

    def notice_frame(self) -> None:
        """There may be a newer frame."""
        if any(shown.under_way is None for shown in self._shown):
            self._wake()

    def _acknowledge(self, frame: int) -> None:
        with self._lock:
            for shown in self._shown:
                if shown.under_way == frame:
                    shown.under_way = None
        self._wake()

    def _show(self, message: Show) -> None:
        for layer in message.layers:
            if layer not in LAYERS:
                raise UsageError(f"there is no layer {layer[:40]!r}; there are {', '.join(LAYERS)}")
        with self._lock:
            before = {shown.layer: shown for shown in self._shown}
            same = (self._half, self._most) == (message.format == "float16", message.max_side)
            names = tuple(dict.fromkeys(message.layers))
            self._shown = [before[name] if same and name in before else _Shown(name) for name in names]
            self._half, self._most = message.format == "float16", message.max_side
        self._wake()

    def _frame(self, shot: Shot, wanted: list[_Shown]) -> bytes | None:
        """The newest frame of one of these layers; nobody waits for the lock while it is made."""
        for shown in wanted:
            frame = self._engine.frames.newest(shot, shown.layer, self._most, shown.seen)
            if frame is None:
                continue
            with self._lock:
                self._frames += 1
                shown.seen, shown.under_way = (shot.revision, frame.changes), self._frames
                if shown in self._shown:  # its turn comes last next time; another list, as others may read this one
                    self._shown = [*(each for each in self._shown if each is not shown), shown]
            return encode(frame, self._frames, self._half, shot.moves.get(self.number))
        return None
