"""Records of a binary PLY file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any, BinaryIO, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.ply_header import Element, PlyHeader, Property
from clrender.meshes.ply_records import Lists, joined_lists, property_table, widened
from clrender.wording import counted, quoted

__all__ = ["BinaryRecords"]

_T = TypeVar("_T")

_CHUNK: Final = 1 << 21
_FEW: Final = 16
_WALK: Final = 4096
"""If too few consecutive records are alike, this many are read one by one before the next attempt."""


class BinaryRecords:
    """Records of a binary file, which are contiguous."""

    def __init__(self, file: BinaryIO, header: PlyHeader, size: int, label: str) -> None:
        self._file, self._label = file, label
        self._little = header.encoding == "binary_little_endian"
        self._left = size - header.size

    def _kind(self, name: str) -> np.dtype[Any]:
        return np.dtype(("<" if self._little else ">") + name)

    def _read(self, count: int) -> bytes:
        data = self._file.read(count) if count <= self._left else b""
        if len(data) != count:
            raise SceneError(f"{self._label} is truncated: it has not the length its header promises")
        self._left -= count
        return data

    def columns(self, element: Element, names: list[str]) -> NDArray[np.floating]:
        """Scalar properties of every record, as a table."""
        if element.lists:
            return self._columns_between_lists(element, names)
        record = np.dtype([(entry.name, self._kind(entry.kind)) for entry in element.properties])
        table = property_table(element, names)
        step = max(1, _CHUNK // record.itemsize)
        for start in range(0, element.count, step):
            count = min(step, element.count - start)
            rows = np.frombuffer(self._read(count * record.itemsize), record)
            for column, name in enumerate(names):
                with np.errstate(over="ignore"):
                    table[start : start + count, column] = rows[name]
        return table

    def _columns_between_lists(self, element: Element, names: list[str]) -> NDArray[np.floating]:
        """The same where records have lists, so that each may have another length."""
        table = property_table(element, names)

        def take(data: bytes, start: int, done: int) -> tuple[None, int, int]:
            _, counts, end = self._walk(element, data, start)
            if end > len(data):
                return None, 0, end
            at, lengths = start, iter(counts)
            for entry in element.properties:
                if entry.count_kind:
                    at += entry.count_bytes + next(lengths) * entry.entry_bytes
                    continue
                if entry.name in names:
                    value = np.frombuffer(data, self._kind(entry.kind), 1, at)[0]
                    with np.errstate(over="ignore"):
                        table[done, names.index(entry.name)] = value
                at += entry.entry_bytes
            return None, 1, end

        for _ in self._pieces(element, take):
            pass
        return table

    def lists(self, element: Element, wanted: Sequence[Property]) -> list[Lists]:
        """All entries of each of these lists, and how many of them each record has."""
        return joined_lists(self._parts(element, wanted), self._label)

    def skip(self, element: Element) -> None:
        """Skip an element."""
        if element.lists:
            for _ in self._parts(element, element.lists[:1]):
                pass
        else:
            for start in range(0, element.least_bytes, _CHUNK):
                self._read(min(_CHUNK, element.least_bytes - start))

    def end(self) -> None:
        """Raise an error if anything follows."""
        if self._left:
            raise SceneError(
                f"{self._label} has not the length its header promises: "
                f"{counted(self._left, 'byte is', 'bytes are')} left over"
            )

    def _pieces(self, element: Element, take: Callable[[bytes, int, int], tuple[_T, int, int]]) -> Iterator[_T]:
        """What `take` makes of some records at a time.

        It is given data, the byte where a record begins, and how many came before. It returns its result, the number of
        records taken (0: the first one is incomplete), and their end.
        """
        done, data = 0, b""
        while done < element.count:
            data += self._read(min(_CHUNK, self._left))
            start = 0
            while done < element.count:
                result, count, end = take(data, start, done)
                if not count:
                    break
                yield result
                done, start = done + count, end
            data = data[start:]
            if done < element.count:
                # Read the rest of the incomplete record: its end is known as far as its counts are.
                _, _, end = self._walk(element, data, 0)
                data += self._read(max(0, end - len(data)))
        self._file.seek(-len(data), os.SEEK_CUR)
        self._left += len(data)

    def _parts(self, element: Element, wanted: Sequence[Property]) -> Iterator[list[Lists]]:
        """Entries of some lists, and how many of them each record has, for some records at a time."""

        def take(data: bytes, start: int, done: int) -> tuple[list[Lists], int, int]:
            part, end = self._alike(element, wanted, data, start, element.count - done)
            if len(part[0][1]) < _FEW and len(part[0][1]) < element.count - done:
                part, end = self._one_by_one(element, wanted, data, start, element.count - done)
            return part, len(part[0][1]), end

        return self._pieces(element, take)

    def _walk(self, element: Element, data: bytes, at: int) -> tuple[list[int], list[int], int]:
        """One record: positions of its counts, numbers of its lists' entries, and its end.

        If the record is incomplete, its end lies beyond the data, and the rest is meaningless.
        """
        places: list[int] = []
        counts: list[int] = []
        for entry in element.properties:
            if not entry.count_kind:
                at += entry.entry_bytes
                continue
            places.append(at)
            behind = at + entry.count_bytes
            if behind > len(data):
                return places, counts, behind
            signed = entry.count_kind.startswith("i")
            count = int.from_bytes(data[at:behind], "little" if self._little else "big", signed=signed)
            if count < 0:
                raise SceneError(
                    f"{self._label} is damaged: a list of {quoted(element.name)} has "
                    f"{counted(count, 'entry', 'entries')}"
                )
            counts.append(count)
            at = behind + count * entry.entry_bytes
        return places, counts, at

    def _alike(
        self, element: Element, wanted: Sequence[Property], data: bytes, start: int, most: int
    ) -> tuple[list[Lists], int]:
        """Consecutive records from a byte on whose lists have the lengths of the first record's; and their end."""
        places, counts, end = self._walk(element, data, start)
        size = end - start
        count = min(most, (len(data) - start) // size) if size and end <= len(data) else 0
        rows = np.frombuffer(data, np.uint8, count * size, start).reshape(count, size)
        for place, entry in zip(places if count else (), element.lists, strict=False):
            field = rows[:, place - start : place - start + entry.count_bytes]
            other = (field != field[0]).any(axis=1)
            rows = rows[: int(np.argmax(other))] if other.any() else rows
        found: list[Lists] = []
        for entry in wanted:
            kind = self._kind(entry.kind)
            if not len(rows):
                found.append((widened(np.empty(0, kind)), np.empty(0, np.int64)))
                continue
            number = element.lists.index(entry)
            first = places[number] - start + entry.count_bytes
            field = np.ascontiguousarray(rows[:, first : first + counts[number] * kind.itemsize])
            numbers = field.view(kind) if counts[number] else np.empty(0, kind)
            found.append((widened(numbers.reshape(-1)), np.full(len(rows), counts[number])))
        return found, start + len(rows) * size

    def _one_by_one(
        self, element: Element, wanted: Sequence[Property], data: bytes, start: int, most: int
    ) -> tuple[list[Lists], int]:
        """Records from a byte on, with lists of any length; and their end."""
        firsts: list[list[int]] = []
        counts: list[list[int]] = []
        while len(counts) < min(most, _WALK):
            places, lengths, end = self._walk(element, data, start)
            if end > len(data):
                break
            firsts.append(places)
            counts.append(lengths)
            start = end
        found: list[Lists] = []
        for entry in wanted:
            number, kind = element.lists.index(entry), self._kind(entry.kind)
            count = np.array([lengths[number] for lengths in counts], np.int64)
            begins = np.array([places[number] for places in firsts], np.int64) + entry.count_bytes
            before = np.cumsum(count) - count
            at = np.repeat(begins - before * kind.itemsize, count)
            at += np.arange(len(at)) * kind.itemsize
            field = np.frombuffer(data, np.uint8)[at[:, None] + np.arange(kind.itemsize)]
            found.append((widened(np.ascontiguousarray(field).view(kind).reshape(-1)), count))
        return found, start
