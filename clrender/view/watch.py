"""Tells when one of some files has changed, by looking at them a few times a second."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

__all__ = ["Watcher"]

_SECONDS: Final = 0.25
"""From one look to the next. A file is taken as changed when it is found the same twice: then it is written whole."""

_Signature = tuple[tuple[int, int, int] | None, ...]


class Watcher:
    """A thread that looks at files.

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
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Look no more."""
        self._end.set()
        self._thread.join()

    def _look(self) -> None:
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
