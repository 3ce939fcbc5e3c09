"""A terminal for tests: it answers questions as real ones do, keeps what it is sent, and decodes the pictures in it."""

from __future__ import annotations

import base64
import fcntl
import io
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

import clrender

__all__ = ["ANSWERS", "Shown", "cursor_rows", "decode_sixel", "pictures", "run_at_terminal"]

_CELL: Final = b"\x1b[6;16;8t"
ANSWERS: Final[dict[str, bytes]] = {
    "kitty": b"\x1b_Gi=31;OK\x1b\\\x1bP>|kitty(0.32.2)\x1b\\" + _CELL + b"\x1b[?62;c",
    "iterm2": b"\x1bP>|iTerm2 3.5.0\x1b\\" + _CELL + b"\x1b[?64;1;2;4;6;17;18;21;22c",
    # xterm keeps the size of its cells to itself; the system knows it
    "sixel": b"\x1bP>|XTerm(379)\x1b\\\x1b[?1;0;64S\x1b[?63;1;2;4;6;9;15;22c",
    "none": b"\x1bP>|VTE(7006)\x1b\\" + _CELL + b"\x1b[?65;1;9c",
    "silent": b"",
}
"""What terminals say to the questions of `clrender.cli.terminal`, as their documentation has it."""


class Shown:
    """What came of a command at a terminal.

    Attributes
    ----------
    code : int
        Exit code.
    text : str
        All that was written to the terminal.
    restored : bool
        Whether its settings are what they were.
    """

    def __init__(self, code: int, text: str, restored: bool) -> None:
        self.code, self.text, self.restored = code, text, restored


def run_at_terminal(
    kind: str, *arguments: str, folder: Path, size: tuple[int, int] = (80, 24), seconds: float = 300
) -> Shown:
    """`clrender ARGUMENTS` at a terminal of a kind of `ANSWERS`, of so many columns and rows."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 8 * size[0], 16 * size[1]))
    before = termios.tcgetattr(theirs)
    environment = {**os.environ, "PYTHONPATH": str(Path(clrender.__path__[0]).parent), "TERM": "xterm-256color"}
    process = subprocess.Popen(
        [sys.executable, "-m", "clrender", *arguments], cwd=folder, env=environment, stdin=theirs, stdout=theirs,
        stderr=theirs, start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # noqa: PLW1509  # no thread runs here
    )  # fmt: skip
    try:
        written = _converse(process, ours, ANSWERS[kind], time.monotonic() + seconds)
        code = process.wait(10)
        restored = termios.tcgetattr(theirs) == before
    finally:
        process.kill()
        os.close(ours)
        os.close(theirs)
    return Shown(code, written.decode("utf-8", "replace"), restored)


def _converse(process: subprocess.Popen[Any], terminal: int, answer: bytes, end: float) -> bytes:
    """Read all that a process writes, and answer its questions once."""
    written, answered = b"", False
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.05)[0]:
            written += os.read(terminal, 1 << 16)
            if not answered and b"\x1b[c" in written:
                answered = True
                os.write(terminal, answer)
        elif process.poll() is not None:
            return written
    raise TimeoutError(written[-500:])


def pictures(shown: str) -> list[npt.NDArray[np.uint8]]:
    """Pictures in what was written to a terminal, in order: (h, w, 3) uint8."""
    found = [(m.start(), _png(m[1])) for m in re.finditer(r"\x1b\]1337;File=[^:]*:([^\a]*)\a", shown)]
    found += [(m.start(), decode_sixel(m[0])) for m in re.finditer(r"\x1bP[\d;]*q[^\x1b]*\x1b\\", shown)]
    data, start = "", 0
    for part in re.finditer(r"\x1b_G(?:(a=T,[^;]*),)?m=([01]);([^\x1b]*)\x1b\\", shown):
        start = part.start() if part[1] else start
        data += part[3]
        if part[2] == "0":
            found.append((start, _png(data)))
            data = ""
    return [picture for _, picture in sorted(found, key=lambda each: each[0])]


def _png(data: str) -> npt.NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data, validate=True))).convert("RGB"))


def decode_sixel(text: str) -> npt.NDArray[np.uint8]:
    """The picture of a sixel sequence, by the manual of the VT340."""
    head = re.match(r'\x1bP[\d;]*q"1;1;(\d+);(\d+)', text)
    assert head
    width, height = int(head[1]), int(head[2])
    picture = np.zeros((-(-height // 6) * 6, width, 3), np.uint8)
    palette: dict[int, tuple[int, ...]] = {}
    x = y = color = 0
    for token in re.finditer(r"#(\d+)(?:;2;(\d+);(\d+);(\d+))?|!(\d+)([?-~])|([?-~])|([$-])", text[head.end() : -2]):
        if token[1]:
            color = int(token[1])
            if token[2]:
                palette[color] = tuple(round(int(each) * 2.55) for each in token.group(2, 3, 4))
        elif token[8]:
            x, y = 0, y + (6 if token[8] == "-" else 0)
        else:
            count, bits = int(token[5] or 1), ord(token[6] or token[7]) - 63
            for row in range(6):
                if bits >> row & 1:
                    assert x + count <= width and y + row < height
                    picture[y + row, x : x + count] = palette[color]
            x += count
    return picture[:height]


def cursor_rows(shown: str, lines: int) -> list[tuple[str, int]]:
    """Where on an endless roll of paper, whose last `lines` rows are the screen, pictures and lines of text begin.

    Returns
    -------
    list of (str, int)
        ``"picture"`` or the text, and its row, from 0 where the cursor was at first.
    """
    row, saved, bottom, found = 0, 0, lines - 1, []
    plain = re.sub(r"\x1b_G(?!a=T)[^\x1b]*\x1b\\", "", shown)  # further parts of a picture
    for token in re.finditer(
        r"(\x1b7)|(\x1b8)|\x1b\[(\d+)A|(\x1b_Ga=T[^\x1b]*\x1b\\|\x1b\]1337[^\a]*\a|\x1bP[^\x1b]*\x1b\\)|(\n)"
        r"|\x1b\[[\d;?>]*[a-zA-Z]|\x1b_G[^\x1b]*\x1b\\|\r|([^\x1b\r\n]+)",
        plain,
    ):
        if token[1]:
            saved = row
        elif token[2]:
            row = saved
        elif token[3]:
            row -= int(token[3])
            assert row > bottom - lines, "the cursor stops at the top of the screen"
        elif token[4]:
            found.append(("picture", row))
        elif token[5]:
            row += 1
            bottom = max(bottom, row)
        elif token[6]:
            found.append((token[6], row))
    return found
