"""Query a terminal for its image protocol and its cell size."""

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
"""Seconds to wait for an answer; all but the simplest terminals answer within milliseconds, even remote ones."""

_COLORS: Final = 128
"""Colours of a sixel image: twice as many take twice as long to write, with little visible improvement."""

_SMALL_CELL: Final = (6, 12)
"""Default cell size: a too small one leaves free rows below an image, a too large one would overwrite the image."""

_ITERM2: Final = ("iterm2", "wezterm", "mintty")
"""Terminals with iTerm2's protocol, by the name that they report."""

_QUERIES: Final = (
    "\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"  # kitty: query for displaying one pixel
    "\x1b[>q"  # XTVERSION: name of the terminal
    "\x1b[?1;1;0S"  # XTSMGRAPHICS: number of colours of a sixel image
    "\x1b[16t"  # XTWINOPS: size of a cell
    "\x1b[c"  # DA1: capabilities. All terminals answer this, and answers come in the order of the queries.
)
_LAST: Final = re.compile(r"\x1b\[\?([\d;]*)c")


@dataclass(frozen=True)
class Terminal:
    """A terminal that can show images.

    Attributes
    ----------
    protocol : str
        One of `clrender.image.terminal.PROTOCOLS`.
    cell : (int, int)
        Width and height of a cell, pixels.
    colors : int
        Number of colours of a sixel image.
    """

    protocol: str
    cell: tuple[int, int]
    colors: int = _COLORS


def ask(seconds: float = _SECONDS) -> Terminal | None:
    """The terminal of this process, if it reports that it can show images.

    Environment variables are not used, as they are wrong within tmux or on a remote machine. Keys typed during the
    query are lost.
    """
    if os.environ.get("TERM", "") in ("", "dumb", "linux"):  # they print queries as text
        return None
    answer, known = _answer(seconds)
    found = _LAST.search(answer)
    if found is None:
        return None
    told = re.search(r"\x1b\[6;(\d+);(\d+)t", answer)  # xterm does not answer unless configured to
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
    """The terminal's answers to the queries, and the cell size according to the system, if known.

    The answer is empty if there is no terminal, or this process is in the background.
    """
    try:
        import termios
        import tty

        terminal = os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC)
    except (ImportError, OSError):
        return "", None
    try:
        if os.tcgetpgrp(terminal) != os.getpgrp():  # in the background, where reading would stop this process
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
    """Read up to the answer to the last query, or until the time is over."""
    end, answer = time.monotonic() + seconds, ""
    while not _LAST.search(answer) and (left := end - time.monotonic()) > 0.0:
        if select.select([terminal], [], [], left)[0]:
            answer += os.read(terminal, 1024).decode("ascii", "replace")
    return answer
