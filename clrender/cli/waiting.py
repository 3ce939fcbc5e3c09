"""Says what a command waits for before it can show progress."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Final

from clrender.process.stages import STAGES

__all__ = ["Waiting"]

_SECONDS: Final = 1.0


class Waiting:
    """Looks at the stage of the work every second, and says it where it is another one than before.

    Parameters
    ----------
    say : callable or None
        Called with a line of text, in another thread. None: nothing is said.

    Attributes
    ----------
    say : callable or None
        May be replaced.
    """

    def __init__(self, say: Callable[[str], None] | None) -> None:
        self.say = say
        self._stage = ""
        self._said: set[str] = {""}
        self._ended = threading.Event()

    def __enter__(self) -> Waiting:
        if self.say is not None:
            threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()

    def stage(self, stage: str) -> None:
        """What is waited for from now on: a key of `STAGES`, or the empty string."""
        self._stage = stage

    def look(self) -> None:
        """Say the stage, unless it was said before."""
        stage = self._stage
        if stage not in self._said and self.say is not None:
            self._said.add(stage)
            self.say(f"{STAGES[stage]} …")

    def _watch(self) -> None:
        while not self._ended.wait(_SECONDS):
            self.look()
