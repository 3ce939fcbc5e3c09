"""Preview of a render in the terminal, redrawn as samples are added."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from clrender.cli.progress import state
from clrender.cli.terminal import Terminal, ask

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from clrender.image.tone_map import DisplayMap
    from clrender.rendering.rendered_image import Progress, RenderedImage

__all__ = ["Preview", "preview_here"]

_APART: Final = 0.25
_COST: Final = 0.05
"""Largest share of the time that drawing may take."""


class Preview:
    """An image at a fixed place, with a line of progress below it.

    Parameters
    ----------
    terminal : Terminal
    develop : callable
        Converts (h, w, 3) float32 radiance to (h, w, 3) uint8 for display.

    Notes
    -----
    Rows for the image and the line below it are reserved once, by line feeds. The cursor is always on that line; the
    image is drawn starting `_above` rows higher. A message replaces the line, and moves the image up.
    """

    def __init__(self, terminal: Terminal, develop: Callable[[npt.NDArray[np.float32]], npt.NDArray[np.uint8]]) -> None:
        self._terminal = terminal
        self._develop = develop
        self._area = (0, 0)
        self._above = 0
        self._next = 0.0

    def show(self, progress: Progress) -> None:
        now = time.perf_counter()
        if now < self._next:
            return
        if progress.film is not None and progress.film.samples:
            self._draw(progress.film.snapshot(self._pixels()))
        self._line(f"{progress.fraction:4.0%} {state(progress)}")
        took = time.perf_counter() - now
        self._next = now + took + max(_APART, took / _COST)

    def say(self, line: str) -> None:
        columns = _screen().columns
        self._line(line, cut=False)
        if self._above:
            self._above += 1 + max(0, len(line) - 1) // columns
        self._put("\n")

    def finish(self, image: RenderedImage) -> None:
        step = max(1, -(-max(image.picture.shape) // self._pixels()))
        self._draw(image.picture[::step, ::step])

    def close(self) -> None:
        self._line("")

    def _pixels(self) -> int:
        """Most pixels of the longer side of the image to fetch: twice those of the screen, for antialiasing."""
        screen = _screen()
        return 2 * max(screen.columns * self._terminal.cell[0], screen.lines * self._terminal.cell[1])

    def _draw(self, linear: npt.NDArray[np.float32]) -> None:
        from clrender.image.terminal import encode, resized

        self._take_place(linear.shape[1], linear.shape[0])
        unit, (high, wide) = self._unit(), linear.shape[:2]
        wide = min(wide, self._area[0] * self._terminal.cell[0])
        high = min(high, max(1, self._area[1] * self._terminal.cell[1] // unit * unit))
        picture = resized(self._develop(linear), wide, high)
        drawn = encode(picture, self._terminal.protocol, number=os.getpid(), colors=self._terminal.colors)
        # Save the cursor, move to the image's place, draw, and restore the cursor, wherever drawing has moved it.
        self._put(f"\x1b7\r\x1b[{self._above}A{drawn}\x1b8")

    def _unit(self) -> int:
        """Rounding unit of the image height: a partial sixel band below the image would make it scroll."""
        return 6 if self._terminal.protocol == "sixel" else 1

    def _take_place(self, width: int, height: int) -> None:
        """Reserve rows for the image, unless it has rows that are still on the screen."""
        from clrender.image.terminal import fit

        screen = _screen()
        if self._above and self._above < screen.lines and self._area[0] <= screen.columns:
            return
        self._line("")
        whole = -(-height // self._unit()) * self._unit()
        self._area = fit((width, whole), (screen.columns, max(1, screen.lines - 2)), self._terminal.cell)
        self._above = self._area[1]
        self._put("\n" * self._above)

    def _line(self, text: str, cut: bool = True) -> None:
        """Replace the line below the image by a text."""
        self._put(f"\r\x1b[2K{text[: _screen().columns - 1] if cut else text}")

    @staticmethod
    def _put(text: str) -> None:
        print(text, end="", file=sys.stderr, flush=True)


def preview_here(tone_map: str | DisplayMap, exposure: float) -> Preview | None:
    """A preview on stderr's terminal. If it cannot show images: None, after a message that says why.

    Parameters
    ----------
    tone_map, exposure
        See `clrender.image.tone_map.to_display`.
    """
    terminal = ask() if sys.stderr.isatty() else None
    if terminal is None:
        why = "this terminal does not say that it shows pictures" if sys.stderr.isatty() else "stderr is no terminal"
        print(f"--preview: {why} (kitty, iTerm2 or sixel); the render goes on without", file=sys.stderr, flush=True)
        return None

    def develop(linear: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
        from clrender.image.tone_map import to_display

        return to_display(linear, tone_map, exposure)

    return Preview(terminal, develop)


def _screen() -> os.terminal_size:
    """Columns and lines of stderr's terminal."""
    try:
        size = os.get_terminal_size(sys.stderr.fileno())
    except (OSError, ValueError):
        size = shutil.get_terminal_size()
    return size if size.columns and size.lines else os.terminal_size((80, 24))
