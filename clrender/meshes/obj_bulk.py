"""Fast path for OBJ lines of identical form, which most programs write.

The non-digits of a line, such as ``f // // //``, are compared for all lines at once, and delimit the digits of each
number.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from clrender.meshes.decimals import decimal_values, digit_values
from clrender.meshes.text import CONTINUATION, Block

__all__ = ["Run", "alike_corners", "alike_vectors", "runs"]

_LEAST: Final = 256
"""Fewest lines for which the fast path pays off."""
_MOST_RUNS: Final = 64
_MOST_DIGITS: Final = 18
"""Most digits of a number, so that they fit into 64 bits."""
_POWERS: Final = 10 ** np.arange(_MOST_DIGITS + 1)


class Run(NamedTuple):
    """Consecutive lines of a block.

    Attributes
    ----------
    kind : str
        ``v``, ``vt``, ``vn`` or ``f``, if all of them begin with it and a blank; else empty.
    block : Block
    lines : int
    """

    kind: str
    block: Block
    lines: int


def runs(block: Block) -> Iterator[Run]:
    """Split a block where the keyword of lines changes, if there are few such places."""
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


def _marks(data: NDArray[np.uint8], lines: int, signs: bool) -> tuple[NDArray[np.intp], bytes] | None:
    """Positions of the bytes of lines that are not digits (or signs, if `signs`); None if the lines' forms differ.

    Returns
    -------
    places : (lines, n) int64
    form : bytes
        These n bytes, the same for each line.
    """
    found = (data - np.uint8(ord("0"))) > 9
    if signs:
        found &= data != ord("-")
    places = np.flatnonzero(found)
    each, odd = divmod(len(places), lines)
    if odd:
        return None
    rows = places.reshape(lines, each)
    bytes_of = data.take(rows)
    return (rows, bytes_of[0].tobytes()) if (bytes_of == bytes_of[0]).all() else None


def alike_corners(run: Run) -> tuple[list[NDArray[np.int64]], int] | None:
    """Indices of the corners of faces, and the number of corners per face; None if the lines' forms differ.

    Returns
    -------
    indices : list of three (corners,) int64
        Indices of vertices, texture coordinates and normals, each all above 0 or all 0.
    size : int
    """
    data, lines = np.frombuffer(run.block.text, np.uint8), run.lines
    if (marks := _marks(data, lines, signs=False)) is None:
        return None
    places, form = marks
    size = form.count(b" ")
    slashes = form.count(b"/") // max(size, 1)
    if size < 3 or slashes > 2 or form != b"f" + (b" " + b"/" * slashes) * size + b"\n":
        return None
    # After the keyword and its blank, each mark ends a number, except the second slash of 1//2
    ends, lengths = places[:, 2:], np.diff(places[:, 1:])
    lengths -= 1
    indices = []
    for column in range(3):
        some = lengths[:, column :: slashes + 1].reshape(-1)
        if column > slashes or (column == 1 and slashes == 2 and not some.any()):
            indices.append(np.zeros(lines * size, np.int64))
            continue
        numbers = digit_values(data, ends[:, column :: slashes + 1].reshape(-1), some) if some.all() else None
        if numbers is None or not numbers.all():
            return None
        indices.append(numbers)
    return indices, size


def alike_vectors(run: Run) -> NDArray[np.float64] | None:
    """Numbers after the keyword of each line, (lines, n) float64; None if the lines' forms differ."""
    data, lines = np.frombuffer(run.block.text, np.uint8), run.lines
    if (marks := _marks(data, lines, signs=True)) is None:
        return None
    places, form = marks
    size = form.count(b".")
    if not size or form != run.kind.encode() + b" ." * size + b"\n":
        return None
    blanks, dots = places[:, len(run.kind) : -1 : 2].reshape(-1), places[:, len(run.kind) + 1 :: 2].reshape(-1)
    ends = places[:, len(run.kind) + 2 :: 2].reshape(-1)
    negative = data.take(blanks + 1) == ord("-")
    if np.count_nonzero(negative) != run.block.text.count(b"-"):
        return None
    before, behind = dots - blanks - 1 - negative, ends - dots - 1
    whole, part = digit_values(data, dots, before), digit_values(data, ends, behind)
    digits = before + behind
    if whole is None or part is None or not digits.all() or digits.max() > _MOST_DIGITS:
        return None
    whole *= _POWERS.take(behind)
    whole += part
    np.negative(whole, out=whole, where=negative)
    values = decimal_values(whole, behind, negative)
    return None if values is None else values.reshape(lines, size)
