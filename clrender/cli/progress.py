"""Progress of a render on stderr: a live bar on a terminal, a few plain lines elsewhere."""

from __future__ import annotations

import sys
import threading
from types import TracebackType
from typing import Any, Protocol

__all__ = ["ProgressDisplay", "ProgressLike", "duration", "quantity"]

_BAR_AFTER = 0.3
"""Seconds of rendering before the bar appears: a short render needs none, and its library takes time to load."""

_FIRST_LINE = 2.0
_LINES_APART_AT_MOST = 60.0
_SETUP_NOTICE = 3.0


class ProgressLike(Protocol):
    """What the display reads of a render's progress."""

    @property
    def samples_done(self) -> int: ...
    @property
    def samples_total(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    @property
    def samples_per_second(self) -> float: ...
    @property
    def seconds_left(self) -> float | None: ...


class ProgressDisplay:
    """Shows progress while it is open; call it with each new state.

    Parameters
    ----------
    quiet : bool
        Show nothing.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._terminal = sys.stderr.isatty()
        self._bar: Any = None
        self._task: Any = None
        self._next_line = _FIRST_LINE
        self._notice = threading.Timer(_SETUP_NOTICE, self._say_setup)
        self._notice.daemon = True

    def __enter__(self) -> ProgressDisplay:
        if not self._quiet:
            self._notice.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._notice.cancel()
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, progress: ProgressLike) -> None:
        """Show a new state; cheap enough for every launch."""
        if self._quiet:
            return
        self._notice.cancel()
        if self._terminal:
            self._show_bar(progress)
        elif progress.seconds >= self._next_line:
            # Lines come at 2, 4, 8, … seconds, then once a minute.
            self._next_line = progress.seconds + min(progress.seconds, _LINES_APART_AT_MOST)
            share = progress.samples_done / max(progress.samples_total, 1)
            print(f"{share:4.0%} {_state(progress)}", file=sys.stderr, flush=True)

    def say(self, line: str) -> None:
        """Print a line above the bar."""
        if self._quiet:
            return
        if self._bar is not None:
            self._bar.console.print(line, markup=False, highlight=False)
        else:
            print(line, file=sys.stderr, flush=True)

    def _show_bar(self, progress: ProgressLike) -> None:
        if self._bar is None:
            if progress.seconds < _BAR_AFTER:
                return
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            self._bar = Progress(
                BarColumn(),
                TextColumn("{task.percentage:3.0f} %"),
                TextColumn("{task.fields[state]}"),
                console=Console(stderr=True),
                refresh_per_second=4,
                transient=True,
            )
            self._task = self._bar.add_task("", total=progress.samples_total, state="")
            self._bar.start()
        self._bar.update(
            self._task, completed=progress.samples_done, total=progress.samples_total, state=_state(progress)
        )

    def _say_setup(self) -> None:
        print("preparing: the first render on a device compiles its kernels, which can take a while", file=sys.stderr)


def _state(progress: ProgressLike) -> str:
    left = progress.seconds_left
    parts = [
        f"{quantity(progress.samples_done)} of {quantity(progress.samples_total)} samples",
        f"{quantity(progress.samples_per_second)} samples/s",
    ]
    if left is not None and 0 <= left < 1e9:
        parts.append(f"{duration(left)} left")
    return ", ".join(parts)


def quantity(number: float) -> str:
    """A number with three or four digits and a unit prefix: 12.3 M."""
    for factor, prefix in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if number >= factor:
            return f"{number / factor:.{0 if number >= 100 * factor else 1}f} {prefix}"
    return f"{number:.0f}"


def duration(seconds: float) -> str:
    """A time span in its two largest units: 2 h 05 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
