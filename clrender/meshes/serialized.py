"""Mitsuba's `.serialized` files: several meshes, each compressed separately, and a table of their offsets.

Format: Mitsuba 0.6 documentation, section "Serialized mesh loader".
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.data import TRIANGLE_LIMIT, MeshData
from clrender.wording import counted

__all__ = ["SerializedMesh", "read_serialized"]

_MAGIC: Final = 0x041C
_OFFSETS: Final = {3: "<u4", 4: "<u8"}
"""Type of the table of offsets, by version."""
_NORMALS, _UVS, _COLORS, _FACETED, _SINGLE, _DOUBLE = 0x1, 0x2, 0x8, 0x10, 0x1000, 0x2000
_IGNORED: Final = 0xF00
"""Bits that some writers set, and Mitsuba does not look at."""
_KNOWN: Final = _NORMALS | _UVS | _COLORS | _FACETED | _SINGLE | _DOUBLE
_MESH_LIMIT: Final = 2**20
_NAME_LIMIT: Final = 2**12
_PIECE: Final = 2**20
"""Bytes decompressed at a time."""
_FREE: Final = 2**24
_MOST_INFLATION: Final = 100
"""Largest compression ratio of meshes of more than `_FREE` bytes; those of regular grids stay below it."""


@dataclass(frozen=True)
class SerializedMesh:
    """One mesh of a file.

    Attributes
    ----------
    mesh : MeshData
        Without colours, which are not read.
    faceted : bool
        Whether the file requests flat shading although the mesh may have normals.
    """

    mesh: MeshData
    faceted: bool


def read_serialized(file: BinaryIO, size: int, label: str, index: int) -> SerializedMesh:
    """Read one mesh.

    Parameters
    ----------
    file : binary file
        Positioned at its start.
    size : int
        Bytes.
    label : str
        Prefix of error messages.
    index : int
        Index of the mesh, from 0.

    Raises
    ------
    SceneError
        It is truncated or damaged, or has no such mesh.
    """
    version = _version(file.read(4), label, 0)
    kind = np.dtype(_OFFSETS[version])
    file.seek(max(size - 4, 0))
    (count,) = struct.unpack("<I", file.read(4))
    table = size - 4 - count * kind.itemsize
    if not 0 < count <= _MESH_LIMIT or table < 4:
        raise SceneError(f"{label} ends in the number {count}, which cannot be that of its meshes; it is truncated")
    if not 0 <= index < count:
        held = "one mesh" if count == 1 else f"{count} meshes"
        raise SceneError(f"{label} holds {held}, and none with the number {index}, counted from 0")
    file.seek(table)
    offsets = np.frombuffer(file.read(count * kind.itemsize), kind)
    begins = np.minimum(offsets, kind.type(table + 1)).astype(np.int64)
    ends = np.append(begins[1:], table)
    wrong = ends < begins + 4
    wrong[0] |= begins[0] != 0
    if wrong.any():
        which = int(np.argmax(wrong))
        raise SceneError(f"{label}: mesh {which} begins at byte {offsets[which]}, where it cannot; it is damaged")
    begin, end = int(begins[index]), int(ends[index])
    label = f"{label}: mesh {index}"
    file.seek(begin)
    version = _version(file.read(4), label, begin)
    return _mesh(_Stream(file, end - begin - 4, label), version, label)


def _version(head: bytes, label: str, place: int) -> int:
    magic, version = struct.unpack("<HH", head) if len(head) == 4 else (0, 0)
    if magic != _MAGIC:
        raise SceneError(f"{label} is no serialized mesh: byte {place} does not begin one; export it again")
    if version not in _OFFSETS:
        raise SceneError(f"{label} is a serialized mesh of version {version}; those of 3 and 4 are read")
    return int(version)


class _Stream:
    """Decompresses a zlib stream piece by piece."""

    def __init__(self, file: BinaryIO, size: int, label: str) -> None:
        self._file, self._left, self._label = file, size, label
        self.size = size
        self._inflate = zlib.decompressobj()

    def _piece(self, most: int) -> bytes:
        """The next bytes; empty at the end."""
        while not self._inflate.eof:
            data = self._inflate.unconsumed_tail
            if not data:
                data = self._file.read(min(_PIECE, self._left))
                self._left -= len(data)
            try:
                piece = self._inflate.decompress(data, min(most, _PIECE))
            except zlib.error:
                raise SceneError(f"{self._label} is damaged: its zlib stream is not sound") from None
            if piece:
                return piece
            if not data:
                raise SceneError(f"{self._label} is truncated: its zlib stream has no end")
        return b""

    def read(self, count: int) -> bytes:
        """Read exactly `count` bytes."""
        pieces: list[bytes] = []
        while count:
            pieces.append(self._piece(count))
            count -= len(pieces[-1])
            if not pieces[-1]:
                raise SceneError(f"{self._label} is truncated: it holds less than it says")
        return b"".join(pieces)

    def table(self, rows: int, columns: int, kind: str) -> NDArray[Any]:
        """Read a (rows, columns) array."""
        data = self.read(rows * columns * np.dtype(kind).itemsize)
        return np.frombuffer(data, kind).reshape(rows, columns)

    def end(self) -> None:
        """Raise an error if anything follows but the checksum."""
        if self._piece(1):
            raise SceneError(f"{self._label} is damaged: it holds more than it says")
        if self._left or self._inflate.unused_data:
            raise SceneError(f"{self._label} is damaged: bytes follow its zlib stream")


def _mesh(stream: _Stream, version: int, label: str) -> SerializedMesh:
    (flags,) = struct.unpack("<I", stream.read(4))
    if flags & ~(_KNOWN | _IGNORED) or (flags & _SINGLE and flags & _DOUBLE):
        raise SceneError(f"{label} has the flags {flags:#x}, which mean nothing; export it again")
    if version == 4:
        for _ in range(_NAME_LIMIT + 1):
            if stream.read(1) == b"\0":
                break
        else:
            raise SceneError(f"{label} has a name of more than {counted(_NAME_LIMIT, 'byte')}; shorten it")
    vertices, triangles = struct.unpack("<QQ", stream.read(16))
    for found, what in ((vertices, "vertices"), (triangles, "triangles")):
        if not 0 < found <= TRIANGLE_LIMIT:
            raise SceneError(f"{label} holds {found} {what}; 1 to {TRIANGLE_LIMIT} are read")
    columns = 3 + 3 * bool(flags & _NORMALS) + 2 * bool(flags & _UVS) + 3 * bool(flags & _COLORS)
    promised = vertices * columns * (8 if flags & _DOUBLE else 4) + triangles * 12
    if promised > max(_FREE, _MOST_INFLATION * stream.size):
        text = f"it says that its {stream.size} compressed bytes hold {promised}, of which only hundredths are there"
        raise SceneError(f"{label} is damaged: {text}")
    kind = "<f8" if flags & _DOUBLE else "<f4"
    positions = stream.table(vertices, 3, kind)
    normals = stream.table(vertices, 3, kind) if flags & _NORMALS else None
    uvs = stream.table(vertices, 2, kind) if flags & _UVS else None
    if flags & _COLORS:
        stream.table(vertices, 3, kind)
    indices = stream.table(triangles, 3, "<u4")
    stream.end()
    if int(indices.max()) >= vertices:
        row = int(np.argmax((indices >= vertices).any(axis=1)))
        named = int(indices[row].max())
        raise SceneError(f"{label}: triangle {row} names vertex {named}, but there are only {vertices}, counted from 0")
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # values too large for float32 become infinite and are rejected later
        corners = None if uvs is None else uvs.astype(np.float32)[indices]
    mesh = MeshData(positions, indices.astype(np.uint32), normals, uvs=corners)
    return SerializedMesh(mesh, bool(flags & _FACETED))
