"""Lines of an OBJ file that are all written alike, as most programs write them: faster than lines of any form.

What a line is made of but digits, such as ``f // // //``, is compared for all lines at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from clrender.scene.mesh_text import CONTINUATION, Block, decimal_values

__all__ = ["Run", "alike_corners", "alike_vectors", "runs"]

_LEAST: Final = 256
"""Fewer lines than these are not worth a look."""
_MOST_RUNS: Final = 64
_DIGITS: Final = b"0123456789"
_BLANKED: Final = bytes(32 if byte in b"fvtn/" else byte for byte in range(256))


class Run(NamedTuple):
    """Lines of a block that follow each other.

    Attributes
    ----------
    kind : str
        ``v``, ``vt``, ``vn`` or ``f``, with a blank behind it, if all of them begin so; else empty.
    block : Block
    lines : int
    """

    kind: str
    block: Block
    lines: int


def runs(block: Block) -> Iterator[Run]:
    """A block cut where lines begin otherwise than those before, if there are few such places."""
    data = np.frombuffer(block.text, np.uint8)
    ends = np.flatnonzero(data == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    first, second = data[starts], data[np.minimum(starts + 1, len(data) - 1)]
    third = data[np.minimum(starts + 2, len(data) - 1)]
    blank = third == ord(" ")
    kinds = np.select(
        [
            (first == ord("f")) & (second == ord(" ")),
            (first == ord("v")) & (second == ord(" ")),
            (first == ord("v")) & (second == ord("t")) & blank,
            (first == ord("v")) & (second == ord("n")) & blank,
        ],
        [1, 2, 3, 4],
    )
    cuts = np.flatnonzero(np.diff(kinds)) + 1
    if len(cuts) > _MOST_RUNS or CONTINUATION in block.text:
        yield Run("", block, len(starts))
        return
    bounds = [0, *cuts.tolist(), len(starts)]
    done = 0
    for begin, end in pairwise(bounds):
        if not kinds[begin] or end - begin < _LEAST:
            continue
        if done < begin:
            yield Run("", _part(block, starts, ends, done, begin), begin - done)
        yield Run(("", "f", "v", "vt", "vn")[kinds[begin]], _part(block, starts, ends, begin, end), end - begin)
        done = end
    if done < len(starts):
        yield Run("", _part(block, starts, ends, done, len(starts)), len(starts) - done)


def _part(block: Block, starts: NDArray[np.int64], ends: NDArray[np.int64], first: int, last: int) -> Block:
    whole = first == 0 and last == len(starts)
    text = block.text if whole else block.text[int(starts[first]) : int(ends[last - 1]) + 1]
    return Block(text, block.first_line + first)


def alike_corners(run: Run) -> tuple[NDArray[np.int64], int] | None:
    """What the corners of faces name, and how many each face has; None where not all are written alike.

    Returns
    -------
    indices : (corners, 3) int64
        Of vertices, texture coordinates and normals, all above 0; or 0 for a whole column.
    size : int
    """
    text, lines = run.block.text, run.lines
    form = text[: text.index(b"\n") + 1].translate(None, _DIGITS)
    size = form.count(b" ")
    slashes = form.count(b"/") // max(size, 1)
    if size < 3 or slashes > 2 or form != b"f" + (b" " + b"/" * slashes) * size + b"\n":
        return None
    if text.translate(None, _DIGITS) != form * lines:
        return None
    numbers = np.fromstring(text.translate(_BLANKED), np.int64, sep=" ")
    corners = lines * size
    each, odd = divmod(len(numbers), corners)
    if odd or each < 1 or not (numbers > 0).all():
        return None
    # Of 1//2 the middle is missing, of 1/2/ the end: only the first is meant to be
    if each != slashes + 1 and not (each == 2 and slashes == 2 and text.count(b"//") == corners):
        return None
    columns = (0, 2) if each != slashes + 1 else range(each)
    if each == 3:
        return numbers.reshape(corners, 3), size
    table = np.zeros((corners, 3), np.int64)
    table[:, list(columns)] = numbers.reshape(corners, each)
    return table, size


def alike_vectors(run: Run) -> NDArray[np.float64] | None:
    """Numbers behind the keyword of each line, (lines, n) float64; None where not all have one form of decimals."""
    text, lines = run.block.text, run.lines
    form = text[: text.index(b"\n") + 1].translate(None, b"0123456789-")
    size = form.count(b".")
    if not size or form != run.kind.encode() + b" ." * size + b"\n":
        return None
    if text.translate(None, b"0123456789-") != form * lines or text.count(b"-") != text.count(b" -"):
        return None
    data = np.frombuffer(text, np.uint8)
    blanks = np.flatnonzero(data <= 32).reshape(lines, size + 1)
    dots = np.flatnonzero(data == ord("."))
    digits = text.translate(_BLANKED, b".")
    if b"- " in digits or b"-\n" in digits:
        return None
    whole = np.fromstring(digits, np.int64, sep=" ")
    if len(whole) != len(dots):
        return None
    starts, ends = blanks[:, :-1].reshape(-1) + 1, blanks[:, 1:].reshape(-1)
    values = decimal_values(whole, ends - dots - 1, data[starts] == ord("-"))
    return None if values is None else values.reshape(lines, size)
