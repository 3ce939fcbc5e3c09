"""Outputs of a notebook that display one view: a viewer for each, over the messages of one widget.

What comes in is ``{"display": name, "text": message}``, without a text where an output only begins or says that it is
still there, and with ``"leaves": true`` where it goes. What goes out has the same ``display``, and a ``text``, or one
buffer that is a frame, or ``"ended": true``.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from clrender.errors import UsageError
from clrender.view.engine import Engine
from clrender.view.viewer import Viewer

__all__ = ["Displays"]

_SILENT_SECONDS: Final = 150.0
"""An output without a message for so long is gone. A hidden page sends one a minute, and is connected again by it."""
_TICK_SECONDS: Final = 0.5
_NAME_LENGTH: Final = 64


@dataclass
class _Display:
    viewer: Viewer
    heard: float


class Displays:
    """The outputs that display a view, and the thread that sends to them.

    Parameters
    ----------
    engine : Engine
    send : callable
        Takes a JSON-able message, and ``buffers``, a list of bytes; called in a thread.
    on_tick : callable
        Called twice a second, in the same thread.
    """

    def __init__(self, engine: Engine, send: Callable[..., None], on_tick: Callable[[], None]) -> None:
        self._engine, self._send_message, self._on_tick = engine, send, on_tick
        self._displays: dict[str, _Display] = {}
        self._lock = threading.RLock()
        self._awake = threading.Event()
        self._left: float | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._send_loop, name="clrender displays", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        return len(self._displays)

    @property
    def unwatched_seconds(self) -> float:
        """Seconds since the last output went away; 0 where there is one, or was none yet."""
        return 0.0 if self._left is None else time.monotonic() - self._left

    def receive(self, content: Any) -> None:
        """Handle a message of an output, in any thread; a malformed one is ignored."""
        name = content.get("display") if isinstance(content, dict) else None
        if not isinstance(name, str) or not 0 < len(name) <= _NAME_LENGTH:
            return
        with self._lock:
            if self._closed:
                return
            if content.get("leaves"):
                self._forget(name)
                self._left = None if self._displays else time.monotonic()
                return
            display = self._displays.get(name) or self._join(name)
        if display is not None:
            display.heard = time.monotonic()
            if (text := content.get("text")) is not None:
                display.viewer.receive(text)

    def close(self) -> None:
        """Send what is queued, the engine's goodbye included, and end the thread."""
        with self._lock:
            self._closed = True
        self._awake.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(_TICK_SECONDS)

    def _join(self, name: str) -> _Display | None:
        try:
            viewer = self._engine.connect(self._awake.set)
        except UsageError as error:
            self._send(name, text=json.dumps({"type": "refused", "to": None, "message": str(error)}))
            return None
        self._left = None
        self._displays[name] = _Display(viewer, time.monotonic())
        self._awake.set()
        return self._displays[name]

    def _forget(self, name: str) -> None:
        display = self._displays.pop(name, None)
        if display is not None:
            display.viewer.close()

    # --- the thread ---

    def _send_loop(self) -> None:
        ticked = 0.0
        while not self._closed:
            self._awake.wait(_TICK_SECONDS)
            self._awake.clear()
            self._deliver()
            if time.monotonic() - ticked > _TICK_SECONDS:
                ticked = time.monotonic()
                self._forget_silent(ticked - _SILENT_SECONDS)
                with contextlib.suppress(Exception):  # whatever it trips over, sending goes on
                    self._on_tick()
        self._deliver()
        for name in list(self._displays):
            self._send(name, ended=True)
            self._forget(name)

    def _deliver(self) -> None:
        """Send each output what is queued for it; a slow one has not acknowledged its frame, and gets no other."""
        for name, display in list(self._displays.items()):
            try:
                while (item := display.viewer.take()) is not None:
                    if isinstance(item, str):
                        self._send(name, text=item)
                    else:
                        self._send(name, [item])
            except Exception as error:  # of one output: the others are sent to all the same
                display.viewer.end(f"{type(error).__name__}: {error}")
            if display.viewer.closed is not None and not self._closed:
                self._send(name, ended=True)
                with self._lock:
                    self._forget(name)

    def _forget_silent(self, since: float) -> None:
        """Disconnect outputs without a message for long. The view goes on: their pages may be asleep."""
        with self._lock:
            for name, display in list(self._displays.items()):
                if display.heard < since:
                    self._forget(name)

    def _send(self, name: str, buffers: list[bytes] | None = None, **content: Any) -> None:
        with contextlib.suppress(Exception):  # a kernel that ends does not send any more, in its own words
            self._send_message({"display": name, **content}, buffers=buffers)
