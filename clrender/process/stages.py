"""What a render does before it takes samples, for those who wait for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

__all__ = ["STAGES", "Stages"]

STAGES: Final = {
    "opening": "looking for a device that works",
    "reading": "reading the scene and its files",
    "flattening": "preparing the scene for the devices",
    "building": "building the tree of the scene's shapes",
    "preparing": "preparing the integrator",
    "joining": "waiting for the cluster's workers, which compile the kernels before their first render",
    "compiling": "compiling the kernels for this scene, which is done once for each device and may take half a minute",
}
"""Each stage in words; none of them, which is the empty string, while samples are taken."""


class Stages:
    """Reports the stage of a render, of which several may be under way on several devices.

    Parameters
    ----------
    tell : callable or None
        Called with a key of `STAGES`, or the empty string, when it changes, in any thread.
    """

    def __init__(self, tell: Callable[[str], None] | None) -> None:
        self._tell = tell
        self._lock = threading.RLock()
        self._running: list[str] = []
        self._told = ""

    def begin(self, stage: str) -> None:
        """A stage begins."""
        with self._lock:
            self._running.append(stage)
            self._tell_change()

    def end(self, stage: str) -> None:
        """It has ended; nothing happens if it had not begun."""
        with self._lock:
            if stage in self._running:
                self._running.remove(stage)
            self._tell_change()

    @contextmanager
    def during(self, stage: str) -> Iterator[None]:
        """The stage lasts as long as the context."""
        self.begin(stage)
        try:
            yield
        finally:
            self.end(stage)

    def compiling(self, begins: bool) -> None:
        """The compiler of a device begins, or has ended; it is reported before everything else."""
        (self.begin if begins else self.end)("compiling")

    def _tell_change(self) -> None:
        stage = "compiling" if "compiling" in self._running else self._running[-1] if self._running else ""
        if stage != self._told and self._tell is not None:
            self._told = stage
            self._tell(stage)
