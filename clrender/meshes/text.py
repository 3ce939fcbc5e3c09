"""Text of mesh files: reads blocks of whole lines, and parses numbers strictly."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.decimals import decimal_values
from clrender.wording import counted

__all__ = ["CONTINUATION", "Block", "line_blocks", "parse_numbers", "parse_whole", "word_spans"]

_READ: Final = 1 << 19
"""Bytes read at a time: arrays computed from them fit into the caches."""
_KEPT: Final = 1 << 24
"""More bytes than any array of a block has."""
_LINE_LIMIT: Final = 1 << 26
CONTINUATION: Final = b"\x0b"
"""Replaces the line break of a continued line: a blank to the parsers, but a line break for line numbers."""

# Form feeds and vertical tabs are blanks. Other control characters are invalid in numbers: they become "?".
_PLAIN: Final = bytes(
    byte if byte >= 32 or byte in b"\t\n\r" else 32 if byte in b"\f\v" else ord("?") for byte in range(256)
)
Spans: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int64]]


@dataclass(frozen=True)
class Block:
    """Whole lines of a file, each ended by a line feed.

    Attributes
    ----------
    text : bytes
    first_line : int
        Number of the first line in the file, counted from 1.
    """

    text: bytes
    first_line: int

    def line_number(self, position: int) -> int:
        """Line number, in the file, of the line that begins at a byte of the text."""
        before = self.text[:position]
        return self.first_line + before.count(b"\n") + before.count(CONTINUATION)

    def line(self, position: int) -> str:
        """The line that begins at a byte of the text, truncated, for a message."""
        line = self.text[position : position + 200].split(b"\n", 1)[0]
        return line.replace(CONTINUATION, b" ").decode("utf-8", errors="replace").strip()[:80]


def line_blocks(file: BinaryIO, label: str, first_line: int = 1, obj: bool = False) -> Iterator[Block]:
    """Lines of a text file from its current position, in blocks.

    Parameters
    ----------
    file : binary file
        Lines may end in line feed, carriage return or both; a UTF-8 byte order mark is skipped.
    label : str
        Prefix of error messages.
    first_line : int
        Line number of the current position.
    obj : bool
        Whether `#` begins a comment and a backslash at the end of a line continues it, as in OBJ files.

    Raises
    ------
    SceneError
        For UTF-16, for bytes that are not text, and for a line of more than 64 MiB.
    """
    # Until an array of this size has been freed, glibc requests each large array from the system, which takes longer
    # than the computation.
    freed = np.empty(_KEPT, np.uint8)
    del freed
    pending, held, line, start = b"", b"", first_line, True
    while True:
        data = file.read(_READ)
        if start:
            start = False
            if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
                raise SceneError(f"{label} is a text in UTF-16; save it as UTF-8 or plain ASCII")
            data = data.removeprefix(b"\xef\xbb\xbf")
        if b"\0" in data:
            raise SceneError(f"{label} is no text file: it holds zero bytes; export it again as plain text")
        ended = len(data) == 0
        text = held + data if held else data
        # A carriage return at the very end may be the first half of a line ending.
        held = b"\r" if text.endswith(b"\r") and not ended else b""
        text = text[: len(text) - len(held)]
        codes = np.frombuffer(text, np.uint8)
        if np.count_nonzero(codes < 32) != np.count_nonzero(codes == ord("\n")):
            text = text.translate(_PLAIN)
        if b"\r" in text:
            text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        text = pending + text if pending else text
        if ended and text and not text.endswith(b"\n"):
            text += b"\n"
        end = text.rfind(b"\n") + 1
        while obj and not ended and end > 1 and text[end - 2] == ord("\\"):
            end = text.rfind(b"\n", 0, end - 1) + 1
        whole, pending = text[:end], text[end:]
        if len(pending) > _LINE_LIMIT:
            raise SceneError(f"{label}: line {line + whole.count(10)} is longer than {counted(_LINE_LIMIT, 'byte')}")
        if whole:
            block = Block(_joined(whole) if obj else whole, line)
            line += int(np.count_nonzero(np.frombuffer(whole, np.uint8) == ord("\n")))
            yield block
        if ended:
            return


def _joined(text: bytes) -> bytes:
    """Remove comments and join continued lines."""
    if b"#" in text:
        # Remove comments first: one that ends in a backslash, such as a Windows path, must not swallow the next line.
        text = re.sub(rb"#[^\n]*", b"", text)
    if b"\\" in text:
        text = text.replace(b"\\\n", b" " + CONTINUATION)
    return text if text.endswith(b"\n") else text + b"\n"  # a file may end in a continued line


def word_spans(data: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Positions where the words of a text begin, and of the blank after each.

    Parameters
    ----------
    data : (n,) uint8
        Blank at its end.

    Returns
    -------
    starts, ends : (words,) int64
    """
    edges = np.empty(len(data) + 1, bool)
    edges[0] = True
    np.less_equal(data, 32, out=edges[1:])
    changes = np.flatnonzero(edges[1:] != edges[:-1])
    return changes[0::2], changes[1::2]


def parse_whole(text: bytes) -> NDArray[np.int64] | None:
    """Integers separated by blanks, from a text with a blank at its end.

    None, or fewer numbers than words, if a word is not a number; more if a word contains several.
    """
    if b"-" in text or b"+" in text:
        # The parser would allow blanks between a sign and its number.
        data = np.frombuffer(text, np.uint8)
        signs = np.flatnonzero((data == ord("-")) | (data == ord("+")))
        if (data[signs + 1] <= 32).any():
            return None
    try:
        return np.fromstring(text, np.int64, sep=" ")
    except (ValueError, DeprecationWarning):
        return None


def parse_numbers(text: bytes, spans: Spans | None = None) -> NDArray[np.float64] | None:
    """Decimal numbers separated by blanks, each correctly rounded.

    Parameters
    ----------
    text : bytes
        Blank at its end.
    spans : two (words,) int64, optional
        Result of `word_spans`, if known.

    Returns
    -------
    (words,) float64, or None
        None if a word is not exactly one number.
    """
    data = np.frombuffer(text, np.uint8)
    starts, ends = word_spans(data) if spans is None else spans
    values = _from_digits(text, data, starts, ends)
    if values is None:
        try:
            values = np.fromstring(text, np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
    # The parser takes "1.2.3" for two numbers, but never a word for none: equal counts mean one number per word.
    return values if len(values) == len(starts) else None


def _from_digits(
    text: bytes, data: NDArray[np.uint8], starts: NDArray[np.int64], ends: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Fast path for numbers without exponents: an integer of the digits, divided by a power of ten.

    Both are exact while the integer is below 2^53 and the power at most 10^22, and a division rounds correctly
    (Clinger, "How to Read Floating Point Numbers Accurately", 1990). None if some number does not qualify.
    """
    dots = np.flatnonzero(data == ord("."))
    digits = parse_whole(text.replace(b".", b"") if len(dots) else text)
    if digits is None or len(digits) != len(starts):
        return None
    decimals = np.zeros(len(starts), np.int64)
    if len(dots):
        words = np.searchsorted(starts, dots, side="right") - 1
        behind = data[dots + 1]
        sound = (behind <= 32) | ((behind >= ord("0")) & (behind <= ord("9")))
        two_in_one, alone = (words[1:] == words[:-1]).any(), (ends[words] - starts[words] == 1).any()
        if not sound.all() or two_in_one or alone:
            return None
        decimals[words] = ends[words] - dots - 1
    return decimal_values(digits, decimals, data[starts] == ord("-"))
