"""Where a scene comes from, and a thread that notices when the files of one have changed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["Source", "Watcher"]

_SECONDS: Final = 0.25
"""Between two looks at the files. A change counts when two looks find it the same: then the file is written whole."""

_Signature = tuple[tuple[int, int, int] | None, ...]


class Source(Protocol):
    """Where a scene comes from, which may change."""

    def read(self) -> Scene:
        """The scene as it is now; raises `ClrenderError`."""

    def files(self, scene: Scene) -> Sequence[Path]:
        """What it was read from."""


class Watcher:
    """A thread that looks at files a few times a second, and calls back when one has changed.

    Parameters
    ----------
    files : callable
        Gives the files, each time anew: a scene that changes may name others.
    on_change : callable
        Called in the thread.
    """

    def __init__(self, files: Callable[[], Iterable[Path]], on_change: Callable[[], None]) -> None:
        self._files, self._on_change = files, on_change
        self._end = threading.Event()
        self._known = self._signature()
        self._thread = threading.Thread(target=self._poll_loop, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop watching; waits for a callback that is running."""
        self._end.set()
        self._thread.join()

    def _poll_loop(self) -> None:
        before = self._known
        while not self._end.wait(_SECONDS):
            now = self._signature()
            if now == before and now != self._known:
                self._known = now  # before it is read: what is written meanwhile is another change
                self._on_change()
            before = now

    def _signature(self) -> _Signature:
        return tuple(_of(path) for path in self._files())


def _of(path: Path) -> tuple[int, int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
