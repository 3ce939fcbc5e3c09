"""Records of an ASCII PLY file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.ply_header import Element, PlyHeader, Property
from clrender.meshes.ply_records import Lists, joined_lists, property_table
from clrender.meshes.text import line_blocks, parse_numbers
from clrender.wording import quoted

__all__ = ["AsciiRecords"]


class AsciiRecords:
    """Records of an ASCII file, one on each line that is not blank."""

    def __init__(self, file: BinaryIO, header: PlyHeader, label: str) -> None:
        self._label = label
        self._blocks = line_blocks(file, label, header.lines + 1)
        self._numbers, self._sizes = np.empty(0), np.empty(0, np.int64)

    def _records(self, element: Element) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.int64]]]:
        """Parts of an element: index of the first record, all numbers, and how many of them each record has."""
        done = 0
        while done < element.count:
            if not len(self._sizes) and not self._next_block():
                left = f"element {quoted(element.name)} has {element.count} records, but {done} follow"
                raise SceneError(f"{self._label} is truncated: its header promises that {left}")
            sizes, self._sizes = np.split(self._sizes, [element.count - done])
            numbers, self._numbers = np.split(self._numbers, [int(sizes.sum())])
            yield done, numbers, sizes
            done += len(sizes)

    def _next_block(self) -> bool:
        block = next(self._blocks, None)
        if block is None:
            return False
        numbers = parse_numbers(block.text)
        at = 0
        if numbers is None:
            for line in block.text.splitlines(keepends=True):
                if parse_numbers(line) is None:
                    place = f"line {block.line_number(at)} cannot be read: {quoted(block.line(at))}"
                    raise SceneError(f"{self._label}: {place} is not all numbers")
                at += len(line)
            raise SceneError(f"{self._label} cannot be read: it holds what is no number")
        data = np.frombuffer(block.text, np.uint8)
        blank = data <= 32
        starts = np.flatnonzero(~blank & np.concatenate([[True], blank[:-1]]))
        words = np.diff(np.searchsorted(starts, np.flatnonzero(data == ord("\n"))), prepend=0)
        self._numbers, self._sizes = numbers, words[words > 0]
        return True

    def _places(
        self, element: Element, done: int, numbers: NDArray[np.float64], sizes: NDArray[np.int64]
    ) -> dict[str, Lists]:
        """Positions in the numbers where each property begins, and its numbers of entries."""
        ends = np.cumsum(sizes)
        at = ends - sizes
        places = {}
        bad = np.zeros(len(sizes), bool)
        for entry in element.properties:
            count = np.ones(len(sizes), np.int64)
            bad |= at >= ends
            if entry.count_kind:
                given = numbers[np.minimum(at, len(numbers) - 1)]
                bad |= ~((given >= 0) & (given <= len(numbers)) & (given == np.floor(given)))
                count = np.where(bad, 0, given).astype(np.int64)
                at = at + 1
            places[entry.name] = (at, count)
            at = at + count
        bad |= at != ends
        if bad.any():
            text = f"record {done + int(np.argmax(bad))} of element {quoted(element.name)}"
            raise SceneError(f"{self._label} is damaged: {text} has not the numbers its header promises")
        return places

    def columns(self, element: Element, names: list[str]) -> NDArray[np.floating]:
        """Scalar properties of every record, as a table."""
        table = property_table(element, names)
        for done, numbers, sizes in self._records(element):
            places = self._places(element, done, numbers, sizes)
            for column, name in enumerate(names):
                with np.errstate(over="ignore"):  # values too large for float32 become infinite and are rejected later
                    table[done : done + len(sizes), column] = numbers[places[name][0]]
        return table

    def lists(self, element: Element, wanted: Sequence[Property]) -> list[Lists]:
        """All entries of each of these lists, and how many of them each record has."""
        return joined_lists(self._parts(element, wanted), self._label)

    def _parts(self, element: Element, wanted: Sequence[Property]) -> Iterator[list[Lists]]:
        for done, numbers, sizes in self._records(element):
            places = self._places(element, done, numbers, sizes)
            part: list[Lists] = []
            for entry in wanted:
                at, count = places[entry.name]
                first = np.cumsum(count) - count
                found = numbers[np.repeat(at - first, count) + np.arange(int(count.sum()))]
                if entry.kind[0] == "f":
                    with np.errstate(over="ignore"):
                        part.append((found.astype(entry.kind), count))
                    continue
                if not (np.abs(found) < 2.0**53).all() or (found != np.floor(found)).any():
                    raise SceneError(f"{self._label} has a face with an index that is no whole number")
                part.append((found.astype(np.int64), count))
            yield part

    def skip(self, element: Element) -> None:
        """Skip an element."""
        for done, numbers, sizes in self._records(element):
            self._places(element, done, numbers, sizes)

    def end(self) -> None:
        """Raise an error if anything follows."""
        while not len(self._sizes):
            if not self._next_block():
                return
        raise SceneError(f"{self._label} has lines left over behind the records its header promises")
