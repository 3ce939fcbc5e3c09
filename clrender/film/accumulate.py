"""Adds 128-bit sums to those of pixels, many rows at a time. Most of the cost of merging a unit into a film is here.

A unit stores pixels tile by tile, in blocks of 4 x 4 pixels; a film stores them row by row. Runs of four horizontal
pixels are contiguous in both, so tiles are converted to rows by copying runs of four.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError
from clrender.film.fixed_point import QUANTUM_BITS, SAMPLE_LIMIT_BITS
from clrender.film.unit import BLOCK, Unit

__all__ = ["Counts", "Rows", "Sums", "add", "rows_of"]

Sums = npt.NDArray[np.uint64]
Counts = npt.NDArray[np.uint32]

_COUNT_LIMIT: Final = 1 << (126 - QUANTUM_BITS - SAMPLE_LIMIT_BITS)
"""Samples of a pixel up to which its sum needs no overflow check: it cannot exceed 2^126 quanta."""

_CHUNK: Final = 1 << 13
"""Pixels added at a time, few enough to stay in the cache between the steps of the addition."""


@dataclass(frozen=True)
class Rows:
    """Sums and counts of a rectangle of pixels.

    Attributes
    ----------
    top, left : int
        Position of its first pixel.
    sums : (height, width, 3, 2) uint64
        Low word first.
    counts : (height, width) uint32
    squares : (height, width, 3, 4) uint64 or None
        Lowest word first.
    """

    top: int
    left: int
    sums: Sums
    counts: Counts
    squares: Sums | None = None


def rows_of(
    unit: Unit, sums: Sums, counts: Counts, width: int, height: int, squares: Sums | None = None
) -> Iterator[Rows]:
    """Split the result of a unit into rectangles of pixels of an image.

    Parameters
    ----------
    unit : Unit
    sums : (slot_count, 3, 2) uint64
    counts : (slot_count,) uint32
    width, height : int
        Size of the image, pixels.
    squares : (slot_count, 3, 4) uint64, optional
    """
    area, across, along = unit.tile * unit.tile, -(-width // unit.tile), unit.tile // BLOCK
    tile, offset = divmod(unit.first_slot, area)
    slots = -(-(offset + unit.slot_count) // area) * area

    def in_runs(values: npt.NDArray[Any]) -> npt.NDArray[np.void]:
        """View values as runs: a block is 4 rows of 4 pixels, and each row is moved as one item."""
        whole = np.ascontiguousarray(_within(values, offset, slots))
        bytes_of_run = BLOCK * whole.nbytes // slots
        return whole.reshape(-1).view(f"V{bytes_of_run}").reshape(-1, along, along, BLOCK)

    runs, some, squared = in_runs(sums), in_runs(counts), None if squares is None else in_runs(squares)
    stop = tile + slots // area
    first = tile
    while first < stop:
        row, column = divmod(first, across)
        end = min(stop, (row + 1) * across)
        tiles = slice(first - tile, end - tile)
        left, right = column * unit.tile, min((column + end - first) * unit.tile, width)
        blocks = -(-(min((row + 1) * unit.tile, height) - row * unit.tile) // BLOCK)
        step = max(1, _CHUNK // (BLOCK * unit.tile * (end - first)))
        for begin in range(0, blocks, step):
            part = slice(begin, min(begin + step, blocks))
            top = row * unit.tile + BLOCK * begin
            kept = (slice(0, height - top), slice(0, right - left))
            shape = (BLOCK * (part.stop - part.start), unit.tile * (end - first))
            yield Rows(
                top,
                left,
                _in_rows(runs[tiles, part]).view(np.uint64).reshape(*shape, 3, 2)[kept],
                _in_rows(some[tiles, part]).view(np.uint32).reshape(shape)[kept],
                None if squared is None else _in_rows(squared[tiles, part]).view(np.uint64).reshape(*shape, 3, 4)[kept],
            )
        first = end


def _in_rows(runs: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """Reorder runs of pixels from (tile, block row, block, row of the block) to pixel rows across all tiles."""
    return np.ascontiguousarray(runs.transpose(1, 3, 0, 2)).reshape(-1)


def _within(part: npt.NDArray[Any], offset: int, slots: int) -> npt.NDArray[Any]:
    """Pad the given slots with zeros to `slots` slots, starting at `offset`."""
    if slots == len(part):
        return part
    whole = np.zeros((slots, *part.shape[1:]), part.dtype)
    whole[offset : offset + len(part)] = part
    return whole


def add(total: Sums, total_counts: Counts, sums: Sums, counts: Counts) -> None:
    """Add sums and counts of pixels to totals, in place.

    Parameters
    ----------
    total, sums : (rows, columns, 3, 2) uint64
        Low word first.
    total_counts, counts : (rows, columns) uint32

    Raises
    ------
    RenderError
        When a sum or a count exceeds the range of a film.
    """
    step = max(1, _CHUNK // max(1, total.shape[1]))
    for first in range(0, len(total), step):
        part = slice(first, first + step)
        _add(total[part], total_counts[part], sums[part], counts[part])


def _add(total: Sums, total_counts: Counts, sums: Sums, counts: Counts) -> None:
    total += sums
    # The low words overflowed where their sum is less than what was added
    total[..., 1] += total[..., 0] < sums[..., 0]
    total_counts += counts
    if np.any(total_counts < counts):
        raise RenderError("a pixel has more than 4294967295 samples, the most a film counts; ask for fewer.")
    if total_counts.max(initial=0) >= _COUNT_LIMIT and np.any(total[..., 1].astype(np.int64) + (1 << 62) < 0):
        raise RenderError("the sum of a pixel's samples is beyond 2^62, the range of a film; use dimmer lights.")
