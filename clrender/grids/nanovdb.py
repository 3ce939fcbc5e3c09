"""NanoVDB files, ``.nvdb``: a sparse grid of floats as a tree of nodes of 32, 16 and 8 values a side (Museth 2021).

Offsets and sizes are those of version 32 of the format, whose nodes begin at multiples of 32 bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, BinaryIO, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.grids.compression import require_blosc, unblosced, unzipped
from clrender.grids.data import GridData
from clrender.grids.sparse import DenseBox, chosen_grid

__all__ = ["nanovdb_names", "read_nanovdb"]

_Node: TypeAlias = tuple[int, NDArray[np.int64]]
"""Where a node begins, and the coordinates of its first value."""

_MAGICS: Final = (b"NanoVDB0", b"NanoVDB1", b"NanoVDB2")
_FLOAT: Final = 1
_QUANTIZED: Final = {13: 4, 14: 8, 15: 16, 16: 0}
"""Types of grids whose leaves have codes in the place of floats: bits of a code, or 0 where each leaf has its own."""
_LEVEL_SET: Final = 1
_UNCOMPRESSED, _ZIP, _BLOSC = range(3)
_BLOSC_CHUNK: Final = 2**30
"""Bytes of a grid that are compressed together."""
_HEADER: Final = struct.Struct("<8sIHH")
_HEAD_BYTES: Final = _HEADER.size
_META: Final = struct.Struct("<QQQQII6d6i3dI4I3IHHI")
_GRID_BYTES, _MAP_AT, _CLASS_AT = 672, 296, 632
_ROOT_BYTES, _TILE_BYTES = 64, 32
_MOST_BYTES: Final = 2**33
_MOST_GRIDS: Final = 1024


@dataclass(frozen=True)
class _Level:
    """Nodes of one level.

    Attributes
    ----------
    size : int
        Bytes of a node.
    masks, table : int
        Where the masks and the table begin.
    side : int
        Entries along a side.
    step : int
        Values along a side of an entry.
    """

    size: int
    masks: int
    table: int
    side: int
    step: int


_UPPER: Final = _Level(270400, 32, 8256, 32, 128)
_LOWER: Final = _Level(33856, 32, 1088, 16, 8)
_LEAF: Final = _Level(2144, 16, 96, 8, 1)
_LEAST_LEAF: Final = 96
_LEAF_FLAGS, _LEAF_MINIMUM, _LEAF_STEP = 15, 80, 84


@dataclass(frozen=True)
class _Meta:
    name: str
    grid_bytes: int
    file_bytes: int
    kind: int
    codec: int
    at: int


def read_nanovdb(file: BinaryIO, label: str, name: str = "density") -> GridData:
    """Read the grid of that name; in the place of a missing density the first one of floats.

    Parameters
    ----------
    file : binary file
    label : str
        Beginning of error messages.
    name : str

    Raises
    ------
    SceneError
        It has no such grid, or is a level set, or has numbers that are not allowed; or it is compressed by blosc, and
        the extra is missing.
    ValueError
        It is no such file, or a damaged one.
    """
    metas = _metas(file)
    chosen = chosen_grid(metas, [each for each in metas if _has_numbers(each)], name, label)
    file.seek(chosen.at)
    return _dense(_grid_bytes(file, chosen, label), chosen.kind, chosen.name, label)


def nanovdb_names(file: BinaryIO) -> tuple[str, ...]:
    """Names of a file's grids of floats.

    Raises
    ------
    ValueError
        It is no such file, or a damaged one.
    """
    return tuple(each.name for each in _metas(file) if _has_numbers(each))


def _has_numbers(meta: _Meta) -> bool:
    return meta.kind == _FLOAT or meta.kind in _QUANTIZED


def _metas(file: BinaryIO) -> list[_Meta]:
    """What the heads of a file say about its grids, and where each begins. Each head is followed by its grids."""
    metas: list[_Meta] = []
    head = _exactly(file, _HEAD_BYTES)
    while len(head) == _HEAD_BYTES and (not metas or head[:8] in _MAGICS):
        magic, version, count, codec = _HEADER.unpack(head)
        if magic not in _MAGICS:
            raise ValueError("it does not begin with NanoVDB")
        if version >> 21 != 32:
            raise ValueError(f"its version is {version >> 21}, but 32 is known")
        if not 1 <= count <= _MOST_GRIDS - len(metas):
            raise ValueError(f"it says that it has {count} grids")
        named = [_meta(file) for _ in range(count)]
        at = file.tell()
        for name, grid_bytes, file_bytes, kind in named:
            metas.append(_Meta(name, grid_bytes, file_bytes, kind, codec, at))
            at += file_bytes
        file.seek(at)
        head = file.read(_HEAD_BYTES)
    return metas


def _meta(file: BinaryIO) -> tuple[str, int, int, int]:
    """Name of a grid, its bytes, those in the file, and its type."""
    fields = _META.unpack(_exactly(file, _META.size))
    name_bytes = fields[21]
    if not 0 < name_bytes <= 4096 or max(fields[:2]) > _MOST_BYTES:
        raise ValueError("the head of a grid has an impossible size")
    name = _exactly(file, name_bytes).rstrip(b"\0").decode("utf-8", "replace")
    return name, fields[0], fields[1], fields[4]


def _exactly(file: BinaryIO, count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        raise ValueError("it ends too early")
    return data


def _grid_bytes(file: BinaryIO, meta: _Meta, label: str) -> NDArray[np.uint8]:
    """The bytes of a grid, decompressed."""
    if meta.codec == _UNCOMPRESSED:
        if meta.grid_bytes != meta.file_bytes:
            raise ValueError("its grid is not compressed, but has another size than its bytes in the file")
        return np.frombuffer(_exactly(file, meta.grid_bytes), np.uint8)
    if meta.codec == _ZIP:
        parts = [_part(file, meta, 0, meta.grid_bytes, unzipped)]
    elif meta.codec == _BLOSC:
        require_blosc(label)
        starts = range(0, meta.grid_bytes, _BLOSC_CHUNK)
        parts = [_part(file, meta, start, _BLOSC_CHUNK, unblosced) for start in starts]
    else:
        raise SceneError(f"{label} is compressed in an unknown way; write it uncompressed, or with zip")
    if file.tell() != meta.at + meta.file_bytes:
        raise ValueError("its compressed grid has another size than its head says")
    return np.frombuffer(parts[0] if len(parts) == 1 else b"".join(parts), np.uint8)


def _part(file: BinaryIO, meta: _Meta, start: int, most: int, decompressed: Callable[[bytes, int], bytes]) -> bytes:
    """What begins at `start` of a grid, decompressed: its size in the file, and then that many bytes."""
    (size,) = struct.unpack("<Q", _exactly(file, 8))
    if size > meta.file_bytes:
        raise ValueError("its compressed grid has another size than its head says")
    return decompressed(_exactly(file, size), min(most, meta.grid_bytes - start))


def _dense(data: NDArray[np.uint8], wanted: int, name: str, label: str) -> GridData:
    """All values in the box of the active ones."""
    if len(data) < _GRID_BYTES + 64 + _ROOT_BYTES or data[:8].tobytes() not in _MAGICS:
        raise ValueError("a grid does not begin as one")
    grid_class, kind = _numbers(data, _CLASS_AT, "<u4", 2).tolist()
    if kind != wanted:
        raise ValueError("a grid has another type than its head says")
    if grid_class == _LEVEL_SET:
        raise SceneError(f"{label} is a level set, whose numbers are distances; convert it to a fog volume")
    matrix = _numbers(data, _MAP_AT + 88, "<f8", 9).reshape(3, 3)
    vector = _numbers(data, _MAP_AT + 232, "<f8", 3)
    root = _GRID_BYTES + int(_numbers(data, _GRID_BYTES + 24, "<u8", 1)[0])
    low, high = _numbers(data, root, "<i4", 6).astype(np.int64).reshape(2, 3)
    tiles = int(_numbers(data, root + 24, "<u4", 1)[0])
    background = float(_numbers(data, root + 28, "<f4", 1)[0])
    if background != 0.0 and not (background > 0.0 and name != "density"):
        raise SceneError(f"{label} has {background:g} everywhere outside of what it stores; a density has 0 there")
    if (high < low).any():  # empty, such as a frame before anything burns
        low = high = np.zeros(3, np.int64)
    box = DenseBox(low.tolist(), high.tolist(), len(data) // 4, label, background)
    if tiles > max(len(data) - root, 0) // _TILE_BYTES:
        raise ValueError("its tree has more branches than bytes")
    uppers = []
    keys: set[int] = set()
    for number in range(tiles):
        at = root + _ROOT_BYTES + number * _TILE_BYTES
        key, child = _numbers(data, at, "<u8", 2).tolist()
        if key in keys:
            raise ValueError("two branches of its tree are in one place")
        keys.add(key)
        origin = np.array([_wrapped(key >> 42), _wrapped(key >> 21), _wrapped(key)])
        if child:
            uppers.append((root + child, origin))
            if len(uppers) > len(data) // _UPPER.size:
                raise ValueError("its tree has more branches than bytes")
        else:
            box.fill(origin, 4096, float(_numbers(data, at + 20, "<f4", 1)[0]))
    lowers = _all_children(data, uppers, _UPPER, _LOWER.size, box)
    leaves = _all_children(data, lowers, _LOWER, _LEAF.size if kind == _FLOAT else _LEAST_LEAF, box)
    for at, origin in leaves:
        box.put(origin, _leaf(data, at, kind).reshape(8, 8, 8))
    return box.placed(matrix, vector)


def _leaf(data: NDArray[np.uint8], at: int, kind: int) -> NDArray[np.float32]:
    """The 512 numbers of a leaf: floats, or codes of 1 to 16 bits for steps above a least number."""
    if kind == _FLOAT:
        return np.asarray(_numbers(data, at + _LEAF.table, "<f4", 512), np.float32)
    least, step = _numbers(data, at + _LEAF_MINIMUM, "<f4", 2)
    bits = _QUANTIZED[kind] or 1 << (int(_numbers(data, at + _LEAF_FLAGS, "u1", 1)[0]) >> 5)
    if bits > 16:
        raise ValueError("a leaf has codes of more than 16 bits")
    if bits == 16:
        codes = _numbers(data, at + _LEAF.table, "<u2", 512)
    else:
        packed = _numbers(data, at + _LEAF.table, "u1", 64 * bits)
        places = np.unpackbits(packed, bitorder="little").reshape(512, bits).astype(np.uint16)
        codes = (places << np.arange(bits, dtype=np.uint16)).sum(axis=1, dtype=np.uint16)
    return codes.astype(np.float32) * np.float32(step) + np.float32(least)


def _wrapped(bits: int) -> int:
    """A coordinate of a root's branch, of whose 32 bits the upper 20 are kept."""
    value = (bits & 0xFFFFF) << 12
    return value - (1 << 32) if value >= 1 << 31 else value


def _numbers(data: NDArray[np.uint8], at: int, kind: str, count: int) -> NDArray[Any]:
    size = np.dtype(kind).itemsize * count
    if not 0 <= at <= len(data) - size:
        raise ValueError("its tree leads out of the file")
    return np.frombuffer(data[at : at + size].tobytes(), kind)


def _all_children(data: NDArray[np.uint8], nodes: list[_Node], level: _Level, below: int, box: DenseBox) -> list[_Node]:
    """Children of all nodes of a level; there are no more than their bytes, `below` for each, have room for."""
    found: list[_Node] = []
    for at, origin in nodes:
        found += _children(data, at, origin, level, box)
        if len(found) > len(data) // below:
            raise ValueError("its tree has more branches than bytes")
    return found


def _children(data: NDArray[np.uint8], at: int, origin: NDArray[np.int64], level: _Level, box: DenseBox) -> list[_Node]:
    """Where the children of a node are, and their first coordinates; tiles of one value are filled in at once."""
    count = level.side**3
    mask = _numbers(data, at + level.masks + count // 8, "<u1", count // 8)
    is_child = np.unpackbits(mask, bitorder="little").astype(bool)
    table = _numbers(data, at + level.table, "<i8", count)
    number = np.arange(count)
    cell = np.stack([number // level.side**2, number // level.side % level.side, number % level.side], axis=1)
    origins = origin + cell * level.step
    tile = np.ascontiguousarray(table).view("<f4")[::2]
    for index in np.flatnonzero(~is_child & (tile != 0.0)).tolist():
        box.fill(origins[index], level.step, float(tile[index]))
    found = np.flatnonzero(is_child).tolist()
    return [(at + int(table[index]), origins[index]) for index in found]
