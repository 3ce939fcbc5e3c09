"""The viewers that are connected, and the messages that go to all of them."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from clrender.errors import UsageError
from clrender.process.stages import STAGES
from clrender.view.frames import first_hit_layers_of
from clrender.view.viewer import ViewedEngine, Viewer

__all__ = ["MOST_VIEWERS", "Broadcaster"]

MOST_VIEWERS: Final = 16
_NOTICES: Final = 50
_RETAINED: Final = ("hello", "scene", "state", "compiling", "progress")
"""Types of which the newest message is sent to each new viewer, in this order."""


class Broadcaster:
    """Sends messages to all viewers, and to new ones those that still hold. Any thread may call any method."""

    def __init__(self) -> None:
        self._viewers: dict[int, Viewer] = {}
        self._count = 0
        self._lock = threading.RLock()
        self._retained: dict[str, Mapping[str, Any]] = {}
        self._notices: deque[str] = deque(maxlen=_NOTICES)

    def __len__(self) -> int:
        return len(self._viewers)

    @property
    def first_hit_layers(self) -> set[str]:
        """First-hit layers that some viewer needs for what it shows."""
        return {name for viewer in self._all() for layer in viewer.layers for name in first_hit_layers_of(layer)}

    @property
    def camera_ids(self) -> dict[int, int | str]:
        """By viewer, the `id` of its newest camera message that was followed."""
        return {each.number: each.camera_id for each in self._all() if each.camera_id is not None}

    def connect(self, engine: ViewedEngine, wake: Callable[[], None]) -> Viewer:
        """A new viewer; `Engine.connect` has the details."""
        with self._lock:
            if len(self._viewers) >= MOST_VIEWERS:
                raise UsageError(f"{MOST_VIEWERS} viewers are connected already, and there may be no more")
            self._count += 1
            viewer = self._viewers[self._count] = Viewer(engine, self._count, wake)
            for kind in _RETAINED:
                if kind in self._retained:
                    viewer.send(kind, self._retained[kind])
            for line in self._notices:
                viewer.send("notice", {"message": line}, newest=False)
        return viewer

    def disconnect(self, viewer: Viewer) -> None:
        """Send a viewer nothing more."""
        with self._lock:
            self._viewers.pop(viewer.number, None)

    def send(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a message to all viewers; of a retained type, to later ones as well."""
        with self._lock:
            if kind in _RETAINED:
                self._retained[kind] = content
            for viewer in self._viewers.values():
                viewer.send(kind, content)

    def send_if_changed(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a message of a retained type, unless it is the same as the last one."""
        with self._lock:
            if self.is_news(kind, content):
                self.send(kind, content)

    def is_news(self, kind: str, content: Mapping[str, Any]) -> bool:
        """Whether a message of a retained type differs from the last one."""
        with self._lock:
            return self._retained.get(kind) != content

    def retain(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a message to later viewers only."""
        with self._lock:
            self._retained[kind] = content

    def notice(self, line: str, *, later: bool = True) -> None:
        """Send all viewers, and later ones unless not, a line that the renderer wants to be read."""
        with self._lock:
            if later:
                self._notices.append(line)
            for viewer in self._viewers.values():
                viewer.send("notice", {"message": line}, newest=False)

    def stage(self, stage: str) -> None:
        """Tell what the image waits for: a key of `STAGES`, or the empty string."""
        content = {"compiling": stage == "compiling", "stage": stage, "text": STAGES.get(stage, "")}
        self.send_if_changed("compiling", content)

    def frame_available(self) -> None:
        """Wake the viewers that could send a frame: there may be a newer one."""
        for viewer in self._all():
            viewer.frame_available()

    def send_goodbye(self, reason: str) -> None:
        """Tell all viewers that the view ends."""
        for viewer in self._all():
            viewer.send("bye", {"reason": reason}, newest=False)

    @property
    def drained(self) -> bool:
        """Whether no viewer has a message left to take."""
        return all(viewer.drained for viewer in self._all())

    def end(self, reason: str) -> None:
        """Have all transports close their connections."""
        for viewer in self._all():
            viewer.end(reason)

    def _all(self) -> list[Viewer]:
        with self._lock:
            return list(self._viewers.values())
