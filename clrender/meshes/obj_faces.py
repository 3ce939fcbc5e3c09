"""Vectorised parsing of the faces of an OBJ file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.text import Block, parse_whole
from clrender.wording import quoted

__all__ = ["Lines", "bad_line", "face_corners"]

_Whole = NDArray[np.int64]
# Vertex, texture coordinate, normal; some programs also write the slashes of missing parts: 1/ or 1//.
_CORNER: Final = re.compile(r"(-?[0-9]{1,18})(?:/(-?[0-9]{1,18})?(?:/(-?[0-9]{1,18})?)?)?")
_FACE_BYTES: Final = b"0123456789-/ \t\n\x0b"


@dataclass(frozen=True)
class Lines:
    """The lines of one kind in a block.

    Attributes
    ----------
    places : (n,) int64
        Byte positions at which they begin.
    words : (n,) int64
        Number of words after the keyword.
    text : bytes
        The lines, their keywords replaced by blanks.
    starts, ends : (words in all,) int64
        Positions in `text` of the words, and of the blanks after them.
    """

    places: _Whole
    words: _Whole
    text: bytes
    starts: _Whole
    ends: _Whole


def bad_line(block: Block, place: int, label: str, what: str) -> SceneError:
    """The error for the line that begins at a byte of a block."""
    return SceneError(f"{label}: line {block.line_number(place)} {what}: {quoted(block.line(place))}")


def face_corners(lines: Lines, block: Block, label: str) -> _Whole:
    """Indices of the vertex, texture coordinates and normal of each corner.

    Returns
    -------
    (corners, 3) int64
        As in the file; 0 for missing ones.

    Raises
    ------
    SceneError
        A line is not a valid face.
    """
    found = _uniform_corners(lines) if (lines.words >= 3).all() else None
    return _any_corners(lines, block, label) if found is None else found


def _uniform_corners(lines: Lines) -> _Whole | None:
    """Like `face_corners`, if all lines of a block have the same form; else None."""
    total = len(lines.starts)
    if lines.text.translate(None, _FACE_BYTES):
        return None
    data = np.frombuffer(lines.text, np.uint8)
    if b"-" in lines.text:
        minus = np.flatnonzero(data == ord("-"))
        if not ((data[minus - 1] <= 32) | (data[minus - 1] == ord("/"))).all():
            return None
    slashes = np.flatnonzero(data == ord("/"))
    if not len(slashes):
        return _spread(_columns(parse_whole(lines.text), total, 1), (0,))
    each, odd = divmod(len(slashes), total)
    if odd or each > 2:
        return None
    inside = slashes.reshape(total, each)
    if not ((inside[:, 0] > lines.starts) & (inside[:, -1] < lines.ends)).all():
        return None
    numbers = parse_whole(lines.text.replace(b"/", b" "))
    count = 0 if numbers is None else len(numbers) // total
    # Every word begins with a number and has at most one more after each slash: so the total determines each.
    table = _columns(numbers, total, count)
    if count == 2 and each == 2:
        return _spread(table, (0, 2)) if (inside[:, 1] - inside[:, 0] == 1).all() else None
    return _spread(table, range(count))


def _spread(table: _Whole | None, columns: Sequence[int]) -> _Whole | None:
    """Copy a table's columns to the given ones of three; the others are 0."""
    if table is None or len(columns) == 3:
        return table
    whole = np.zeros((len(table), 3), np.int64)
    whole[:, list(columns)] = table
    return whole


def _columns(numbers: _Whole | None, rows: int, columns: int) -> _Whole | None:
    """Reshape the numbers, if their count fits and none is 0, which is not an index."""
    if numbers is None or columns == 0 or len(numbers) != rows * columns or (numbers == 0).any():
        return None
    return numbers.reshape(rows, columns)


def _any_corners(lines: Lines, block: Block, label: str) -> _Whole:
    """Like `face_corners`, corner by corner; finds the invalid line."""
    kept: list[tuple[int, int, int]] = []
    words = iter(lines.text.split())
    for place, count in zip(lines.places.tolist(), lines.words.tolist(), strict=True):
        good = True
        for word in (next(words) for _ in range(count)):
            match = _CORNER.fullmatch(word.decode("latin-1"))
            indices = [int(each) for each in match.groups() if each] if match else [0]
            good = good and 0 not in indices
            if match:
                kept.append((int(match[1]), int(match[2] or 0), int(match[3] or 0)))
        if not good:
            raise bad_line(block, place, label, "is not a face of 3 or more vertex indices")
    return np.array(kept, np.int64).reshape(-1, 3)
