"""Ask a terminal whether it shows pictures, and how large its cells are."""

from __future__ import annotations

import os
import re
import select
import struct
import time
from dataclasses import dataclass
from typing import Final

__all__ = ["Terminal", "ask"]

_SECONDS: Final = 1.0
"""To wait for an answer; every terminal but the simplest answers within some milliseconds, also from afar."""

_COLORS: Final = 128
"""Of a sixel picture: twice as many take twice as long to write, and are hardly seen."""

_SMALL_CELL: Final = (6, 12)
"""Where a cell's size is not known: too small leaves rows free below a picture, too large would write into it."""

_ITERM2: Final = ("iterm2", "wezterm", "mintty")
"""Terminals, by the name that they give themselves, that know iTerm2's protocol."""

_QUERIES: Final = (
    "\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"  # kitty: would you show this pixel?
    "\x1b[>q"  # XTVERSION: what is your name?
    "\x1b[?1;1;0S"  # XTSMGRAPHICS: how many colours has a sixel picture?
    "\x1b[16t"  # XTWINOPS: how large is a cell?
    "\x1b[c"  # DA1: what can you do? All terminals answer, in the order of the questions.
)
_LAST: Final = re.compile(r"\x1b\[\?([\d;]*)c")


@dataclass(frozen=True)
class Terminal:
    """A terminal that shows pictures.

    Attributes
    ----------
    protocol : str
        One of `clrender.image.terminal.PROTOCOLS`.
    cell : (int, int)
        Width and height of a cell, pixels.
    colors : int
        Of a sixel picture.
    """

    protocol: str
    cell: tuple[int, int]
    colors: int = _COLORS


def ask(seconds: float = _SECONDS) -> Terminal | None:
    """The terminal that this process runs at, if it says itself that it shows pictures.

    Nothing is guessed from names in the environment: they are wrong within tmux, or on another machine. What is typed
    while it is asked is lost.
    """
    if os.environ.get("TERM", "") in ("", "dumb", "linux"):  # they write questions down
        return None
    answer, known = _answer(seconds)
    found = _LAST.search(answer)
    if found is None:
        return None
    told = re.search(r"\x1b\[6;(\d+);(\d+)t", answer)  # xterm says nothing unless it is allowed to
    cell = (int(told[2]), int(told[1])) if told and int(told[1]) * int(told[2]) else known or _SMALL_CELL
    colors = re.search(r"\x1b\[\?1;0;(\d+)S", answer)
    most = min(_COLORS, int(colors[1])) if colors else _COLORS
    name = re.search(r"\x1bP>\|([^\x1b]*)", answer)
    if "\x1b_Gi=31;OK" in answer:
        return Terminal("kitty", cell)
    if name and name[1].lower().startswith(_ITERM2):
        return Terminal("iterm2", cell)
    return Terminal("sixel", cell, most) if "4" in found[1].split(";") else None


def _answer(seconds: float) -> tuple[str, tuple[int, int] | None]:
    """What the terminal says to the questions, and the size of a cell as the system knows it, if it does.

    Nothing where there is no terminal, or it belongs to another process.
    """
    try:
        import termios
        import tty

        terminal = os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC)
    except (ImportError, OSError):
        return "", None
    try:
        if os.tcgetpgrp(terminal) != os.getpgrp():  # in the background: reading would stop this process
            return "", None
        before = termios.tcgetattr(terminal)
        try:
            tty.setcbreak(terminal, termios.TCSAFLUSH)
            os.write(terminal, _QUERIES.encode("ascii"))
            return _read(terminal, seconds), _cell(terminal)
        finally:
            termios.tcsetattr(terminal, termios.TCSAFLUSH, before)
    except OSError:
        return "", None
    finally:
        os.close(terminal)


def _cell(terminal: int) -> tuple[int, int] | None:
    """Width and height of a cell, from the window's size in cells and in pixels."""
    import fcntl
    import termios

    rows, columns, width, height = struct.unpack("HHHH", fcntl.ioctl(terminal, termios.TIOCGWINSZ, bytes(8)))
    return (width // columns, height // rows) if 0 < columns <= width and 0 < rows <= height else None


def _read(terminal: int, seconds: float) -> str:
    """All up to the answer to the last question, or what came in time."""
    end, answer = time.monotonic() + seconds, ""
    while not _LAST.search(answer) and (left := end - time.monotonic()) > 0.0:
        if select.select([terminal], [], [], left)[0]:
            answer += os.read(terminal, 1024).decode("ascii", "replace")
    return answer
