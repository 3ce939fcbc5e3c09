"""Raises an exception in the main thread, in the program's own code, at a chosen point at which Python takes signals.

Python looks for signals when a function begins, when a loop goes round, and after the call of a function in C. A point
is the instruction before which that happens.
"""

from __future__ import annotations

import dis
import signal
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final

import clrender

ROOT: Final = str(Path(clrender.__file__).parent)

Point = tuple[CodeType, int]


class Alarm(Exception):
    """What a handler of the user's may raise, as for a time limit."""


def _by_signal() -> None:
    """As a time limit does it: the handler of a signal raises."""
    before = signal.signal(signal.SIGUSR1, _raise_alarm)
    try:
        signal.raise_signal(signal.SIGUSR1)
    finally:
        signal.signal(signal.SIGUSR1, before)


def _raise_alarm(_number: int, _frame: FrameType | None) -> None:
    raise Alarm


def _ctrl_c() -> None:
    raise KeyboardInterrupt


def _exit() -> None:
    raise SystemExit


KINDS: Final[tuple[Callable[[], None], ...]] = (_ctrl_c, _exit, _by_signal)


@cache
def _names(code: CodeType) -> dict[int, str]:
    return {each.offset: each.opname for each in dis.get_instructions(code)}


class Tracer:
    """Traces the main thread while a function runs; notes its points, and interrupts it at one of them.

    Parameters
    ----------
    at : (code, offset), optional
        The point.
    visit : int
        Times that it is passed before.
    interrupt : callable
        Raises.

    Attributes
    ----------
    points : dict
        Each point, in the order of their first visits, with the number of visits.
    met : bool
        Whether it was interrupted.
    """

    def __init__(self, at: Point | None = None, visit: int = 0, interrupt: Callable[[], None] = _ctrl_c) -> None:
        self.at, self.visit, self.interrupt = at, visit, interrupt
        self.points: dict[Point, int] = {}
        self.met = False
        self._called: set[FrameType] = set()

    def run(self, function: Callable[[], Any]) -> Any:
        """Call a function under the tracer."""
        sys.settrace(self._enter)
        try:
            return function()
        finally:
            sys.settrace(None)
            self._called.clear()

    def _enter(self, frame: FrameType, event: str, _argument: Any) -> Callable[..., Any] | None:
        if not frame.f_code.co_filename.startswith(ROOT):
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return self._step

    def _step(self, frame: FrameType, event: str, _argument: Any) -> Callable[..., Any]:
        if event == "opcode":
            name = _names(frame.f_code).get(frame.f_lasti, "")
            if frame in self._called or name.startswith(("RESUME", "JUMP_BACKWARD")):
                self._pass((frame.f_code, frame.f_lasti))
            self._called.discard(frame)
            if name.startswith("CALL"):
                self._called.add(frame)
        return self._step

    def _pass(self, point: Point) -> None:
        before = self.points.get(point, 0)
        self.points[point] = before + 1
        if point == self.at and before == self.visit and not self.met:
            self.met = True
            self.interrupt()
