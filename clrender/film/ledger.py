"""The ledger of a film: the samples of each block of pixels in its sums, so that none is counted twice."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.film.unit import BLOCK, blocks_across

__all__ = ["Ledger", "Ranges"]

Ranges: TypeAlias = tuple[tuple[int, int], ...]
"""A set of sample indices: half-open ranges (start, stop), ascending, neither overlapping nor adjacent."""

_LOW: Final = (1 << 32) - 1
"""Mask of the second of two numbers packed into one."""

_MOST_SETS: Final = 4096
"""Number of sets above which unused ones are dropped."""


class Ledger:
    """The samples that each 4 x 4 block of an image's pixels has had.

    It records only samples and blocks, independently of the division of the work into tiles and units and of the
    workers. Most blocks have had the same samples, so each holds the index of its set of samples in a table of distinct
    sets.

    Parameters
    ----------
    width, height : int
        Size of the image, pixels.
    """

    def __init__(self, width: int, height: int) -> None:
        self.width = width
        self.height = height
        self._blocks = np.zeros(blocks_across(width) * blocks_across(height), np.uint32)
        self._sets: list[Ranges] = [()]
        self._numbers: dict[Ranges, int] = {(): 0}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Ledger):
            return NotImplemented
        (ours, blocks), (theirs, other_blocks) = self.to_file(), other.to_file()
        return ours == theirs and np.array_equal(blocks, other_blocks)

    __hash__ = None  # type: ignore[assignment]  # mutable

    @property
    def samples(self) -> int:
        """Number of samples taken, over all pixels of the image."""
        return int((self.pixels_of_blocks() * self.taken()).sum())

    def taken(self) -> npt.NDArray[np.int64]:
        """Number of samples that each block has had: (blocks,) int64, row by row."""
        sizes = np.array([sum(stop - start for start, stop in each) for each in self._sets], np.int64)
        counts: npt.NDArray[np.int64] = sizes[self._blocks]
        return counts

    def pixels_of_blocks(self) -> npt.NDArray[np.int64]:
        """Number of pixels of each block inside the image: (blocks,) int64, row by row."""
        rows = np.minimum(BLOCK, self.height - BLOCK * np.arange(blocks_across(self.height)))
        columns = np.minimum(BLOCK, self.width - BLOCK * np.arange(blocks_across(self.width)))
        pixels: npt.NDArray[np.int64] = (rows[:, None] * columns).reshape(-1)
        return pixels

    def ranges(self, row: int, column: int) -> Ranges:
        """The samples that the block of this pixel has had."""
        return self._sets[int(self._blocks[row // BLOCK * blocks_across(self.width) + column // BLOCK])]

    def holds(self, start: int, stop: int) -> bool:
        """Whether every block has had exactly the samples from `start` to `stop`, excluding `stop`."""
        wanted: Ranges = ((start, stop),) if stop > start else ()
        return all(self._sets[number] == wanted for number in np.unique(self._blocks))

    def divides(self, whole: int) -> bool:
        """Whether every block has had only whole groups of `whole` samples, counted from 0."""
        held = [self._sets[number] for number in np.unique(self._blocks)]
        return all(bound % whole == 0 for ranges in held for pair in ranges for bound in pair)

    def sets_of(self, blocks: npt.NDArray[np.integer[Any]]) -> tuple[list[Ranges], npt.NDArray[np.uint32]]:
        """The distinct sets of samples of some blocks, and the index of each block's set.

        Parameters
        ----------
        blocks : (n,) integers

        Returns
        -------
        sets : list of Ranges
        numbers : (n,) uint32
            Indices into `sets`.
        """
        return list(self._sets), self._blocks[blocks]

    def lacking(self, start: int, stop: int) -> Ledger:
        """The samples from `start` to `stop`, excluding `stop`, that each block lacks."""
        wanted: Ranges = ((start, stop),) if start < stop else ()
        return self._with_sets([_without(wanted, each) for each in self._sets])

    def restricted(self, blocks: npt.NDArray[np.bool_]) -> Ledger:
        """A copy restricted to some blocks, (blocks,) bool, with no samples for the others."""
        part = self._with_sets([*self._sets, ()])
        part._blocks[~blocks] = part._numbers[()]
        return part

    def copy(self) -> Ledger:
        """An independent copy."""
        return self._with_sets(self._sets)

    def _with_sets(self, sets: Sequence[Ranges]) -> Ledger:
        """A ledger in which the sets of the table are replaced by others."""
        other = Ledger(self.width, self.height)
        other._blocks[:] = other._keep(sets)[self._blocks]
        return other

    def add(self, blocks: npt.NDArray[np.integer[Any]], start: int, counts: npt.NDArray[np.integer[Any]]) -> None:
        """Record samples of some blocks.

        Parameters
        ----------
        blocks : (n,) integers
            Indices of blocks, without duplicates; negative ones are outside the image and ignored.
        start : int
            First sample of each block.
        counts : (n,) integers
            Number of samples of each block.

        Raises
        ------
        UsageError
            When a block has already had one of these samples. The ledger is then unchanged.
        """
        wanted = (blocks >= 0) & (counts > 0)
        blocks, counts = blocks[wanted], counts[wanted]
        # The union is computed once for each distinct pair of a block's set and its new range
        pairs, inverse = _distinct(self._blocks[blocks].astype(np.int64) << 32 | counts.astype(np.int64))
        united = [_united(self._sets[pair >> 32], ((start, start + (pair & _LOW)),)) for pair in pairs]
        self._blocks[blocks] = self._keep(united)[inverse]

    def unite(self, other: Ledger) -> None:
        """Add the samples of another ledger of the same size.

        Raises
        ------
        UsageError
            When a block has already had one of these samples. The ledger is then unchanged.
        """
        pairs, inverse = self._beside(other)
        self._blocks[:] = self._keep(_united(ours, theirs) for ours, theirs in pairs)[inverse]

    def take_out(self, other: Ledger) -> None:
        """Remove the samples of another ledger of the same size.

        Raises
        ------
        UsageError
            When some of them are not in this ledger. The ledger is then unchanged.
        """
        pairs, inverse = self._beside(other)
        self._blocks[:] = self._keep(_taken_out(ours, theirs) for ours, theirs in pairs)[inverse]

    def _beside(self, other: Ledger) -> tuple[list[tuple[Ranges, Ranges]], npt.NDArray[np.intp]]:
        """The distinct pairs of a block's sets in the two ledgers, and the index of each block's pair."""
        pairs, inverse = _distinct(self._blocks.astype(np.int64) << 32 | other._blocks.astype(np.int64))
        return [(self._sets[pair >> 32], other._sets[pair & _LOW]) for pair in pairs], inverse

    def _keep(self, sets: Iterable[Ranges]) -> npt.NDArray[np.uint32]:
        """Add sets to the table; returns their indices."""
        numbers = []
        for each in sets:
            if each not in self._numbers:
                self._numbers[each] = len(self._sets)
                self._sets.append(each)
            numbers.append(self._numbers[each])
        if len(self._sets) > _MOST_SETS:
            return self._compact(numbers)
        return np.array(numbers, np.uint32)

    def _compact(self, more: Sequence[int] = ()) -> npt.NDArray[np.uint32]:
        """Drop the sets that no block uses, except `more`, whose new indices are returned.

        The remaining sets are numbered in the order of their first use by blocks, so that equal ledgers are identical.
        """
        used, first = np.unique(np.append(self._blocks, np.array(more, np.uint32)), return_index=True)
        used = used[np.argsort(first)]
        renumbered = np.zeros(len(self._sets), np.uint32)
        renumbered[used] = np.arange(len(used), dtype=np.uint32)
        self._blocks[:] = renumbered[self._blocks]
        self._sets = [self._sets[number] for number in used.tolist()]
        self._numbers = {each: number for number, each in enumerate(self._sets)}
        kept: npt.NDArray[np.uint32] = renumbered[np.array(more, np.uint32)]
        return kept

    def to_file(self) -> tuple[dict[str, Any], npt.NDArray[np.uint32]]:
        """Table of sets, as JSON values, and (blocks,) uint32 indices into it; identical for equal ledgers."""
        compact = self.copy()
        compact._compact()
        return {"block": BLOCK, "sets": [[list(pair) for pair in each] for each in compact._sets]}, compact._blocks

    @classmethod
    def from_file(cls, width: int, height: int, table: Mapping[str, Any], blocks: npt.NDArray[np.uint32]) -> Ledger:
        """Create a ledger from the result of `to_file`.

        Raises
        ------
        ValueError, TypeError, KeyError
            When the data are invalid.
        """
        ledger = cls(width, height)
        if table["block"] != BLOCK or len(blocks) != len(ledger._blocks):
            raise ValueError(f"its ledger is not of blocks of {BLOCK} x {BLOCK} pixels of this image")
        sets = [_checked(each) for each in table["sets"]]
        if len(set(sets)) != len(sets) or int(blocks.max(initial=0)) >= len(sets):
            raise ValueError("its table of samples is not one of distinct sets, one for each block")
        ledger._sets, ledger._numbers = sets, {each: number for number, each in enumerate(sets)}
        ledger._blocks[:] = blocks
        return ledger


def _distinct(keys: npt.NDArray[np.int64]) -> tuple[list[int], npt.NDArray[np.intp]]:
    """The distinct keys, and the index of each key. Neighbours are mostly equal, so only runs are sorted."""
    starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1])[: len(keys)])
    distinct, numbers = np.unique(keys[starts], return_inverse=True)
    return distinct.tolist(), np.repeat(numbers, np.diff(np.append(starts, len(keys))))


def _united(ours: Ranges, theirs: Ranges) -> Ranges:
    """Union of two disjoint sets of samples.

    Raises
    ------
    UsageError
        When a sample is in both.
    """
    merged: list[tuple[int, int]] = []
    for start, stop in sorted((*ours, *theirs)):
        if merged and start < merged[-1][1]:
            last = min(stop, merged[-1][1]) - 1
            raise UsageError(f"samples {start} to {last} of some pixels are held already; each counts once.")
        if merged and start == merged[-1][1]:
            merged[-1] = (merged[-1][0], stop)
        else:
            merged.append((start, stop))
    return tuple(merged)


def _without(ours: Ranges, theirs: Ranges) -> Ranges:
    """Difference of two sets of samples; samples of `theirs` that are not in `ours` are ignored."""
    left: list[tuple[int, int]] = []
    for start, stop in ours:
        for low, high in theirs:
            if start < min(low, stop):
                left.append((start, min(low, stop)))
            start = max(start, high)
        if start < stop:
            left.append((start, stop))
    return tuple(left)


def _taken_out(ours: Ranges, theirs: Ranges) -> Ranges:
    """Difference of two sets of samples, the second a subset of the first.

    Raises
    ------
    UsageError
        When it is no subset.
    """
    for start, stop in _without(theirs, ours):
        raise UsageError(f"samples {start} to {stop - 1} of some pixels are not held; they cannot be taken out.")
    return _without(ours, theirs)


def _checked(ranges: Any) -> Ranges:
    checked = tuple((start, stop) for start, stop in ranges)
    before = -1
    for start, stop in checked:
        if type(start) is not int or type(stop) is not int or not before < start < stop <= 2**32:
            raise ValueError(f"{list(checked)!r} is not an ascending list of ranges of samples")
        before = stop
    return checked
