"""Progress of a render on stderr: a live bar on a terminal, a few plain lines elsewhere, or JSON for programs."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Protocol

if TYPE_CHECKING:
    from clrender.rendering.rendered_image import Progress, RenderedImage

__all__ = ["STYLES", "ProgressDisplay", "ProgressView", "duration", "quantity", "state"]

_BAR_AFTER: Final = 0.3
"""Seconds of rendering before the bar appears: a short render needs none, and the library loads slowly."""

_BAR_APART: Final = 0.25
_JSON_APART: Final = 0.25
_FIRST_LINE: Final = 2.0
_LINES_APART_AT_MOST: Final = 60.0
_LEFT_FROM_FRACTION: Final = 0.01
"""Fraction of the samples from which the remaining time is shown: the first launches wait for the compiler."""
_LEFT_FROM_SECONDS: Final = 10.0
"""Seconds from which it is shown in any case."""


class ProgressView(Protocol):
    """Interface of a display of progress."""

    def show(self, progress: Progress) -> None:
        """Show a new state; called after each launch."""

    def say(self, line: str) -> None:
        """Show a line of text in addition."""

    def finish(self, image: RenderedImage) -> None:
        """Show that the render has ended, with this image."""

    def close(self) -> None:
        """Leave the screen in its final state; also called after a failure."""


class ProgressDisplay:
    """Shows progress while it is open; call it with each new state.

    Parameters
    ----------
    quiet : bool
        Show nothing.
    view : ProgressView, optional
        The display; default: a bar on a terminal, and lines elsewhere.
    """

    def __init__(self, *, quiet: bool = False, view: ProgressView | None = None) -> None:
        self._view: ProgressView | None = None if quiet else view or STYLES["auto"]()

    def __enter__(self) -> ProgressDisplay:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._view is not None:
            self._view.close()

    def __call__(self, progress: Progress) -> None:
        """Show a new state; fast enough to be called after every launch."""
        if self._view is not None:
            self._view.show(progress)

    def say(self, line: str) -> None:
        """Show a line of text."""
        if self._view is not None:
            self._view.say(line)

    def finish(self, image: RenderedImage) -> None:
        """Show that the render has ended."""
        if self._view is not None:
            self._view.finish(image)


class _Lines:
    """Plain lines after 2, 4, 8, … seconds, then once a minute."""

    def __init__(self) -> None:
        self._next = _FIRST_LINE

    def show(self, progress: Progress) -> None:
        if progress.seconds >= self._next:
            self._next = progress.seconds + min(progress.seconds, _LINES_APART_AT_MOST)
            self.say(f"{progress.fraction:4.0%} {state(progress)}")

    def say(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    def finish(self, image: RenderedImage) -> None:
        pass

    def close(self) -> None:
        pass


class _Bar(_Lines):
    """A bar that is removed at the end."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._task: Any = None
        self._next = _BAR_AFTER

    def show(self, progress: Progress) -> None:
        if progress.seconds < self._next:
            return
        self._next = progress.seconds + _BAR_APART
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as Columns

            self._bar = Columns(
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
            self._task, completed=progress.samples_done, total=progress.samples_total, state=state(progress)
        )

    def say(self, line: str) -> None:
        if self._bar is not None:
            self._bar.console.print(line, markup=False, highlight=False)
        else:
            super().say(line)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.stop()


class _Json(_Lines):
    """One JSON object per line, for programs; docs/reference.md describes the keys."""

    def __init__(self) -> None:
        self._next = 0.0
        self._unwritten: Progress | None = None

    def show(self, progress: Progress) -> None:
        if progress.seconds < self._next:
            self._unwritten = progress
            return
        self._next = progress.seconds + _JSON_APART
        self._write(progress)

    def _write(self, progress: Progress) -> None:
        self._unwritten = None
        left = progress.seconds_left
        self._put(
            "progress",
            samples=progress.samples_done,
            samples_total=progress.samples_total,
            seconds=progress.seconds,
            samples_per_second=progress.samples_per_second,
            seconds_left=left if math.isfinite(left) else None,
            relative_error=progress.relative_error,
        )

    def say(self, line: str) -> None:
        self._put("message", text=line)

    def finish(self, image: RenderedImage) -> None:
        if self._unwritten is not None:
            self._write(self._unwritten)
        told = ("samples", "render_seconds", "image_sha256")
        self._put("end", **{name: image.stats[name] for name in told}, interrupted=image.interrupted)

    def _put(self, event: str, **values: Any) -> None:
        super().say(json.dumps({"event": event, **values}))


STYLES: Final[dict[str, Callable[[], ProgressView]]] = {
    "auto": lambda: _Bar() if sys.stderr.isatty() else _Lines(),
    "json": _Json,
}
"""The choices of ``--progress``."""


def state(progress: Progress) -> str:
    """Progress of a render, as text."""
    left, error = progress.seconds_left, progress.relative_error
    parts = [
        f"{quantity(progress.samples_done)} of {quantity(progress.samples_total)} samples",
        f"{quantity(progress.samples_per_second)} samples/s",
    ]
    if error is not None:
        parts.append(f"error {100 * error:.2g} %")
    known = progress.fraction >= _LEFT_FROM_FRACTION or progress.seconds >= _LEFT_FROM_SECONDS
    if known and 0 <= left < 1e9:
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
