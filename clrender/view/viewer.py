"""One connected page or widget: its queue of messages, and the flow control of its frames."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

from clrender.errors import ClrenderError, UsageError
from clrender.view.frames import LAYERS, Frames, encode
from clrender.view.messages import Ack, Message, Show, parse

if TYPE_CHECKING:
    from clrender.view.image_state import ImageState

__all__ = ["ViewedEngine", "Viewer"]

_MOST_REPLIES: Final = 256
"""Replies that may wait; a viewer that does not take them is closed."""
_MOST_MALFORMED: Final = 100


@dataclass(eq=False)
class _LayerStream:
    """The frames of one layer that a viewer shows: one at a time is under way.

    Attributes
    ----------
    layer : str
    sent : (int, int)
        Revision and changes of the newest frame that was sent.
    unacknowledged : int or None
        Number of a frame that is not acknowledged yet.
    """

    layer: str
    sent: tuple[int, int] = (-1, -1)
    unacknowledged: int | None = None


class ViewedEngine(Protocol):
    """What viewers use of the engine; see `clrender.view.engine.Engine`."""

    frames: Frames

    @property
    def displayed(self) -> ImageState | None: ...

    @property
    def superseded(self) -> bool: ...

    def post(self, viewer: Viewer, message: Message) -> None: ...

    def wake_renderer(self) -> None: ...

    def disconnect(self, viewer: Viewer) -> None: ...


class Viewer:
    """A client of the engine; made by `Engine.connect`, and driven by a transport.

    The transport calls `receive`, `take` and `close`. The render thread queues messages with `send`, `reply` and
    `refuse`. Methods may be called in any thread, `take` in one at a time.

    Parameters
    ----------
    engine : ViewedEngine
    number : int
        Of the viewer.
    wake : callable
        Called, in any thread, when there may be something to `take`.

    Attributes
    ----------
    closed : str or None
        Why the transport is to close the connection; None: it is open.
    camera_id : int, str or None
        The `id` of its newest camera message that was followed; set by the render thread.
    """

    def __init__(self, engine: ViewedEngine, number: int, wake: Callable[[], None]) -> None:
        self.number = number
        self.closed: str | None = None
        self.camera_id: int | str | None = None
        self._engine, self._wake = engine, wake
        self._lock = threading.Lock()
        self._replies: deque[str] = deque()
        self._newest: dict[str, str] = {}
        self._streams = [_LayerStream("image")]
        self._half, self._max_side = True, 2048
        self._frames = self._malformed = 0

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the layers that it shows."""
        return tuple(stream.layer for stream in self._streams)

    def receive(self, text: str | bytes) -> None:
        """Handle a message of the page. An error is sent as a reply, and never raised."""
        message = None
        try:
            if not isinstance(text, str):
                raise UsageError("messages are texts")
            message = parse(text)
            if isinstance(message, Ack):
                self._acknowledge(message.frame)
            elif isinstance(message, Show):
                self._show(message)
                self._engine.wake_renderer()
            else:
                self._engine.post(self, message)
        except ClrenderError as error:
            self._malformed += message is None
            if self._malformed > _MOST_MALFORMED:
                self.end("too many messages that are none")
            self.refuse(message, str(error))

    def take(self) -> str | bytes | None:
        """The next message or frame to send, or None.

        A frame is made here, which takes some milliseconds. One thread at a time may call.
        """
        with self._lock:
            for kind in list(self._newest):
                return self._newest.pop(kind)
            if self._replies:
                return self._replies.popleft()
            wanted = [stream for stream in self._streams if stream.unacknowledged is None]
        state = self._engine.displayed
        return None if state is None else self._frame(state, wanted)

    @property
    def drained(self) -> bool:
        """Whether no message is left to take."""
        with self._lock:
            return not self._replies and not self._newest

    def close(self) -> None:
        """Disconnect, from the transport's side."""
        self._engine.disconnect(self)

    def end(self, reason: str) -> None:
        """Disconnect, from the engine's side: the transport is to close the connection."""
        self.closed = self.closed or reason
        self._wake()

    def send(self, kind: str, content: Mapping[str, Any], *, newest: bool = True) -> None:
        """Queue a message.

        Parameters
        ----------
        kind : str
            Its type.
        content : mapping
            JSON-able.
        newest : bool
            Whether it replaces one of its type that was not taken yet.
        """
        text = json.dumps({"type": kind, **content}, separators=(",", ":"))
        with self._lock:
            if newest:
                self._newest.pop(kind, None)  # it takes its turn anew, after what was sent before it
                self._newest[kind] = text
            elif len(self._replies) < _MOST_REPLIES:
                self._replies.append(text)
            else:
                self.closed = self.closed or "what is sent is not taken"
        self._wake()

    def reply(self, kind: str, message: Message | None, content: Mapping[str, Any]) -> None:
        """Queue the reply to a message, with its `id`."""
        number = None if message is None else message.id
        self.send(kind, content if number is None else {**content, "id": number}, newest=False)

    def refuse(self, message: Message | None, why: str) -> None:
        """Queue the reply that a message was refused, and why."""
        self.reply("refused", message, {"to": getattr(message, "type", None), "message": why})

    def frame_available(self) -> None:
        """Wake the transport, unless all its frames are unacknowledged: there may be a newer one."""
        if any(stream.unacknowledged is None for stream in self._streams):
            self._wake()

    def _acknowledge(self, frame: int) -> None:
        with self._lock:
            for stream in self._streams:
                if stream.unacknowledged == frame:
                    stream.unacknowledged = None
        self._wake()

    def _show(self, message: Show) -> None:
        for layer in message.layers:
            if layer not in LAYERS:
                raise UsageError(f"there is no layer {layer[:40]!r}; there are {', '.join(LAYERS)}")
        with self._lock:
            before = {stream.layer: stream for stream in self._streams}
            same = (self._half, self._max_side) == (message.format == "float16", message.max_side)
            names = tuple(dict.fromkeys(message.layers))
            self._streams = [before[name] if same and name in before else _LayerStream(name) for name in names]
            self._half, self._max_side = message.format == "float16", message.max_side
        self._wake()

    def _frame(self, state: ImageState, wanted: list[_LayerStream]) -> bytes | None:
        """The newest frame of one of these layers; the lock is not held while it is made."""
        for stream in wanted:
            if self._is_enough(stream, state):
                continue
            frame = self._engine.frames.newest(state, stream.layer, self._max_side, stream.sent)
            if frame is None or self._is_enough(stream, state):  # a camera may have come meanwhile
                continue
            with self._lock:
                self._frames += 1
                stream.sent, stream.unacknowledged = (state.revision, frame.changes), self._frames
                if stream in self._streams:  # its turn comes last next time; another list, as others may read this one
                    self._streams = [*(each for each in self._streams if each is not stream), stream]
            return encode(frame, self._frames, self._half, state.camera_ids.get(self.number))
        return None

    def _is_enough(self, stream: _LayerStream, state: ImageState) -> bool:
        """Whether one frame of an image that is about to be replaced was sent; another would delay the next image."""
        return stream.sent[0] == state.revision and self._engine.superseded
