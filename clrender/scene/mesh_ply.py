"""PLY files, ASCII and binary: positions, normals and faces of any size.

Format: G. Turk, "The PLY Polygon File Format" (1994). All that is read streams by: memory goes to the mesh alone.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.scene.mesh_data import TRIANGLE_LIMIT, MeshData, crossed_warning
from clrender.scene.mesh_text import line_blocks, parse_numbers
from clrender.scene.ply_header import Element, PlyHeader, Property, read_header
from clrender.scene.polygons import triangulate
from clrender.scene.wording import quoted

__all__ = ["read_ply"]

_CHUNK: Final = 1 << 21
_FEW: Final = 16
_WALK: Final = 4096
"""Where fewer than a few records in a row are alike, this many are read one by one before another try."""

_Lists = tuple[NDArray[np.int64], NDArray[np.int64]]


def read_ply(file: BinaryIO, size: int, label: str) -> MeshData:
    """Read a PLY file, with polygons split into triangles.

    Parameters
    ----------
    file : binary file
        At its start.
    size : int
        Bytes.
    label : str
        Start of an error message.

    Raises
    ------
    SceneError
        If it is truncated, damaged or not a mesh.
    """
    header = read_header(file, label)
    least = header.size + sum(element.least_bytes for element in header.elements)
    if header.encoding != "ascii" and size < least:
        raise SceneError(f"{label} is truncated: it has {size} bytes, but its header promises at least {least}")
    vertex, face = header.element("vertex"), header.element("face")
    assert vertex is not None and face is not None
    normal = ["nx", "ny", "nz"]
    columns = ["x", "y", "z", *(normal if {entry.name for entry in vertex.properties} >= set(normal) else ())]
    ascii_file = header.encoding == "ascii"
    reader = _Ascii(file, header, label) if ascii_file else _Binary(file, header, size, label)
    table = np.empty((0, 3), np.float32)
    lists: _Lists = np.empty(0, np.int64), np.empty(0, np.int64)
    for element in header.elements:
        if element is vertex:
            table = reader.columns(element, columns)
        elif element is face:
            lists = reader.lists(element)
        else:
            reader.skip(element)
    reader.end()
    return _mesh(table, *lists, label)


def _mesh(table: NDArray[np.floating], corners: NDArray[np.int64], sizes: NDArray[np.int64], label: str) -> MeshData:
    if (sizes < 3).any():
        raise SceneError(f"{label}: face {int(np.argmax(sizes < 3))} has fewer than three vertices")
    total = len(corners) - 2 * len(sizes)
    if total > TRIANGLE_LIMIT:
        raise SceneError(f"{label} holds {total} triangles, but at most {TRIANGLE_LIMIT} are read")
    low, high = int(corners.min()), int(corners.max())
    if low < 0 or high >= len(table):
        wrong = low if low < 0 else high
        raise SceneError(f"{label} has a face that names vertex {wrong}, but only 0 to {len(table) - 1} exist")
    vertices = np.ascontiguousarray(table[:, :3])
    crossed = 0
    if (sizes > 3).any():
        triangles, crossed = triangulate(vertices, corners, sizes, label)
        corners = corners[triangles]
    normals = np.ascontiguousarray(table[:, 3:]) if table.shape[1] > 3 else None
    return MeshData(vertices, corners.reshape(-1, 3).astype(np.uint32), normals, crossed_warning(crossed))


def _table(element: Element, names: list[str]) -> NDArray[np.floating]:
    """Room for properties of all records: float32 where that holds them all, else float64."""
    kinds = {entry.kind for entry in element.properties if entry.name in names}
    single = kinds <= {"f4", "i1", "u1", "i2", "u2"}
    return np.empty((element.count, len(names)), np.float32 if single else np.float64)


class _Ascii:
    """Records of an ASCII file, one on each line that holds anything."""

    def __init__(self, file: BinaryIO, header: PlyHeader, label: str) -> None:
        self._label = label
        self._blocks = line_blocks(file, label, header.lines + 1)
        self._numbers, self._sizes = np.empty(0), np.empty(0, np.int64)

    def _records(self, element: Element) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.int64]]]:
        """Parts of an element: number of the first record, numbers of all, and how many each record has."""
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
    ) -> dict[str, _Lists]:
        """Where in the numbers each property begins, and how many entries it has."""
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
        table = _table(element, names)
        for done, numbers, sizes in self._records(element):
            places = self._places(element, done, numbers, sizes)
            for column, name in enumerate(names):
                with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and refused with its place
                    table[done : done + len(sizes), column] = numbers[places[name][0]]
        return table

    def lists(self, element: Element) -> _Lists:
        """All entries of the list of vertex indices, and how many each record has."""
        assert element.index_list is not None
        return _joined(self._parts(element, element.index_list), self._label)

    def _parts(self, element: Element, wanted: Property) -> Iterator[_Lists]:
        for done, numbers, sizes in self._records(element):
            at, count = self._places(element, done, numbers, sizes)[wanted.name]
            first = np.cumsum(count) - count
            found = numbers[np.repeat(at - first, count) + np.arange(int(count.sum()))]
            if not (np.abs(found) < 2.0**53).all() or (found != np.floor(found)).any():
                raise SceneError(f"{self._label} has a face with an index that is no whole number")
            yield found.astype(np.int64), count

    def skip(self, element: Element) -> None:
        """Pass over an element."""
        for done, numbers, sizes in self._records(element):
            self._places(element, done, numbers, sizes)

    def end(self) -> None:
        """Nothing may follow."""
        while not len(self._sizes):
            if not self._next_block():
                return
        raise SceneError(f"{self._label} has lines left over behind the records its header promises")


class _Binary:
    """Records of a binary file, one right behind the other."""

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
        record = np.dtype([(entry.name, self._kind(entry.kind)) for entry in element.properties])
        table = _table(element, names)
        step = max(1, _CHUNK // record.itemsize)
        for start in range(0, element.count, step):
            count = min(step, element.count - start)
            rows = np.frombuffer(self._read(count * record.itemsize), record)
            for column, name in enumerate(names):
                with np.errstate(over="ignore"):
                    table[start : start + count, column] = rows[name]
        return table

    def lists(self, element: Element) -> _Lists:
        """All entries of the list of vertex indices, and how many each record has."""
        assert element.index_list is not None
        return _joined(self._parts(element, element.index_list), self._label)

    def skip(self, element: Element) -> None:
        """Pass over an element."""
        if element.lists:
            for _ in self._parts(element, element.lists[0]):
                pass
        else:
            for start in range(0, element.least_bytes, _CHUNK):
                self._read(min(_CHUNK, element.least_bytes - start))

    def end(self) -> None:
        """Nothing may follow."""
        if self._left:
            raise SceneError(f"{self._label} has not the length its header promises: {self._left} bytes are left over")

    def _parts(self, element: Element, wanted: Property) -> Iterator[_Lists]:
        """Entries of one list, and how many each record has, of some records at a time."""
        done, data = 0, b""
        while done < element.count:
            data += self._read(min(_CHUNK, self._left))
            start = 0
            while done < element.count:
                part, end = self._alike(element, wanted, data, start, element.count - done)
                if len(part[1]) < _FEW and len(part[1]) < element.count - done:
                    part, end = self._one_by_one(element, wanted, data, start, element.count - done)
                if not len(part[1]):
                    break
                yield part
                done, start = done + len(part[1]), end
            data = data[start:]
            if done < element.count:
                # Room for the whole of the record that has only begun: its end is known as far as its counts are.
                _, _, _, end = self._walk(element, wanted, data, 0)
                data += self._read(max(0, end - len(data)))
        self._file.seek(-len(data), os.SEEK_CUR)
        self._left += len(data)

    def _walk(self, element: Element, wanted: Property, data: bytes, at: int) -> tuple[list[int], int, int, int]:
        """One record: where its counts are, where the wanted list begins, entries of that, and the record's end.

        The end lies behind the data when the record is not whole, and then the rest means nothing.
        """
        places, first, entries = [], 0, 0
        for entry in element.properties:
            if not entry.count_kind:
                at += entry.entry_bytes
                continue
            places.append(at)
            behind = at + entry.count_bytes
            if behind > len(data):
                return places, 0, 0, behind
            signed = entry.count_kind.startswith("i")
            count = int.from_bytes(data[at:behind], "little" if self._little else "big", signed=signed)
            if count < 0:
                raise SceneError(f"{self._label} is damaged: a list of {quoted(element.name)} has {count} entries")
            if entry is wanted:
                first, entries = behind, count
            at = behind + count * entry.entry_bytes
        return places, first, entries, at

    def _alike(self, element: Element, wanted: Property, data: bytes, start: int, most: int) -> tuple[_Lists, int]:
        """Records from a byte on as long as their lists are as long as those of the first; and where they end."""
        places, first, entries, end = self._walk(element, wanted, data, start)
        size = end - start
        count = min(most, (len(data) - start) // size) if size and end <= len(data) else 0
        rows = np.frombuffer(data, np.uint8, count * size, start).reshape(count, size)
        for place, entry in zip(places if count else (), element.lists, strict=False):
            field = rows[:, place - start : place - start + entry.count_bytes]
            other = (field != field[0]).any(axis=1)
            rows = rows[: int(np.argmax(other))] if other.any() else rows
        found = rows[:, first - start : first - start + entries * wanted.entry_bytes]
        numbers = np.ascontiguousarray(found).view(self._kind(wanted.kind)) if entries else np.empty(0)
        return (numbers.reshape(-1).astype(np.int64), np.full(len(rows), entries)), start + len(rows) * size

    def _one_by_one(self, element: Element, wanted: Property, data: bytes, start: int, most: int) -> tuple[_Lists, int]:
        """Records from a byte on, however long their lists are; and where they end."""
        firsts: list[int] = []
        counts: list[int] = []
        while len(counts) < min(most, _WALK):
            _, first, entries, end = self._walk(element, wanted, data, start)
            if end > len(data):
                break
            firsts.append(first)
            counts.append(entries)
            start = end
        count, kind = np.array(counts, np.int64), self._kind(wanted.kind)
        before = np.cumsum(count) - count
        at = np.repeat(np.array(firsts, np.int64) - before * kind.itemsize, count)
        at += np.arange(len(at)) * kind.itemsize
        found = np.frombuffer(data, np.uint8)[at[:, None] + np.arange(kind.itemsize)]
        return (np.ascontiguousarray(found).view(kind).reshape(-1).astype(np.int64), count), start


def _joined(parts: Iterator[_Lists], label: str) -> _Lists:
    """All entries and all counts, as long as they are not too many."""
    entries, counts, total = [], [], 0
    for some, count in parts:
        entries.append(some)
        counts.append(count)
        total += len(some)
        if total > 3 * TRIANGLE_LIMIT:
            raise SceneError(f"{label} has faces of more than {3 * TRIANGLE_LIMIT} corners in all; split it")
    return np.concatenate(entries), np.concatenate(counts)
