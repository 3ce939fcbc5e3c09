"""All who look on: who they are, and what is told to all of them."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

from clrender.errors import UsageError
from clrender.view.frames import first_hits_of
from clrender.view.viewer import Viewer

if TYPE_CHECKING:
    from clrender.view.engine import Engine

__all__ = ["MOST_VIEWERS", "Audience"]

MOST_VIEWERS: Final = 16
_NOTICES: Final = 50
_LASTING: Final = ("hello", "scene", "state", "progress")
"""Messages of which the newest is told to whoever comes later, in this order."""


class Audience:
    """The viewers of an engine. All may be called in any thread."""

    def __init__(self) -> None:
        self._viewers: dict[int, Viewer] = {}
        self._numbers = 0
        self._lock = threading.RLock()
        self._lasting: dict[str, Mapping[str, Any]] = {}
        self._notices: deque[str] = deque(maxlen=_NOTICES)

    def __len__(self) -> int:
        return len(self._viewers)

    @property
    def first_hits(self) -> set[str]:
        """Layers of what is seen first that somebody looks at."""
        return {name for viewer in self._all() for layer in viewer.layers for name in first_hits_of(layer)}

    @property
    def camera_ids(self) -> dict[int, int | str]:
        """Of each viewer that has moved the camera, the `id` of its newest message that did."""
        return {each.number: each.camera_id for each in self._all() if each.camera_id is not None}

    def join(self, engine: Engine, wake: Callable[[], None]) -> Viewer:
        """As of `Engine.connect`."""
        with self._lock:
            if len(self._viewers) >= MOST_VIEWERS:
                raise UsageError(f"{MOST_VIEWERS} viewers look on already, and there may be no more")
            self._numbers += 1
            viewer = self._viewers[self._numbers] = Viewer(engine, self._numbers, wake)
            for kind in _LASTING:
                if kind in self._lasting:
                    viewer.tell(kind, self._lasting[kind])
            for line in self._notices:
                viewer.tell("notice", {"message": line}, newest=False)
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """Somebody looks on no more."""
        with self._lock:
            self._viewers.pop(viewer.number, None)

    def tell(self, kind: str, content: Mapping[str, Any], *, again: bool = True) -> bool:
        """Tell all; of a lasting kind, where it is `again` or another than the last one. Gives whether it was told."""
        with self._lock:
            if not again and self._lasting.get(kind) == content:
                return False
            if kind in _LASTING:
                self._lasting[kind] = content
            for viewer in self._viewers.values():
                viewer.tell(kind, content)
        return True

    def remember(self, kind: str, content: Mapping[str, Any]) -> None:
        """Tell it to those alone who come later."""
        with self._lock:
            self._lasting[kind] = content

    def notice(self, line: str) -> None:
        """Tell all, and those who come later, what the renderer says."""
        with self._lock:
            self._notices.append(line)
            for viewer in self._viewers.values():
                viewer.tell("notice", {"message": line}, newest=False)

    def see(self) -> None:
        """There may be something new to see."""
        for viewer in self._all():
            viewer.notice_frame()

    def say_goodbye(self, reason: str) -> None:
        """Tell all that the view ends."""
        for viewer in self._all():
            viewer.tell("bye", {"reason": reason}, newest=False)

    @property
    def told(self) -> bool:
        """Whether all have taken what they are told."""
        return all(viewer.told for viewer in self._all())

    def end(self, reason: str) -> None:
        """Have all transports hang up."""
        for viewer in self._all():
            viewer.end(reason)

    def _all(self) -> list[Viewer]:
        with self._lock:
            return list(self._viewers.values())
