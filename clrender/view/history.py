"""Edits that can be undone and redone."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from clrender.view.edited_scene import EditedScene

__all__ = ["History"]

_MOST: Final = 200
"""Steps that are kept. Each shares with its neighbours all but what was edited."""
_TOGETHER_SECONDS: Final = 1.0
"""Edits of the same thing that follow each other so soon are one step: a drag, or a slider."""


@dataclass(frozen=True)
class _Step:
    """A scene, and what was changed next to it in words."""

    edited: EditedScene
    label: str


class History:
    """The scenes before each edit, and after it those that were undone. The render thread alone calls it.

    Parameters
    ----------
    clock : callable
        Seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._undone: list[_Step] = []
        self._done: list[_Step] = []
        self._last: tuple[Hashable, float] = (None, 0.0)

    @property
    def undo_label(self) -> str | None:
        """What `undo` would take back, in words; None: nothing."""
        return self._done[-1].label if self._done else None

    @property
    def redo_label(self) -> str | None:
        """What `redo` would do again, in words; None: nothing."""
        return self._undone[-1].label if self._undone else None

    def record(self, before: EditedScene, label: str, key: Hashable) -> None:
        """Remember the scene before an edit.

        Parameters
        ----------
        before : EditedScene
        label : str
            What is edited, in words.
        key : hashable
            Who edits what: edits with the same one that follow each other soon are one step. None: one of its own.
        """
        now = self._clock()
        last, when = self._last
        self._last = key, now
        if key is not None and self._done and not self._undone and last == key and now - when < _TOGETHER_SECONDS:
            return
        self._undone.clear()
        self._done = [*self._done[1 - _MOST :], _Step(before, label)]

    def undo(self, now: EditedScene) -> tuple[EditedScene, str] | None:
        """The scene before the last edit and what that was, or None: there was none."""
        return self._moved(now, self._done, self._undone)

    def redo(self, now: EditedScene) -> tuple[EditedScene, str] | None:
        """The scene after the edit that was undone last and what that was, or None: there is none."""
        return self._moved(now, self._undone, self._done)

    def clear(self) -> None:
        """Forget all: the scene was read anew, and earlier ones are of another file."""
        self._undone.clear()
        self._done.clear()
        self._last = (None, 0.0)

    def _moved(self, now: EditedScene, source: list[_Step], target: list[_Step]) -> tuple[EditedScene, str] | None:
        self._last = (None, 0.0)
        if not source:
            return None
        step = source.pop()
        target.append(_Step(now, step.label))
        return step.edited, step.label
