"""OpenVDB files, ``.vdb``: a sparse grid of floats as a tree of nodes of 32, 16 and 8 values a side (Museth 2013).

Versions 222 to 224 of the format. A grid has the topology of its tree first, in the order of the masks of children,
and then the numbers of all leaves.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.grids.compression import require_blosc, unblosced, unzipped
from clrender.grids.data import GridData
from clrender.grids.sparse import DenseBox, chosen_grid
from clrender.wording import counted, quoted

__all__ = ["read_openvdb", "vdb_names"]

_MAGIC: Final = 0x56444220
_VERSIONS: Final = range(222, 225)
_TREE: Final = "Tree_float_5_4_3"
_HALF: Final = "_HalfFloat"
_ZIP, _ACTIVE_MASK, _BLOSC = 1, 2, 4
_MOST_TEXT: Final = 2**16
_MOST_ENTRIES: Final = 4096
_MOST_GRIDS: Final = 1024
_COORDINATE_LIMIT: Final = 2**30
_MOST_TILES: Final = 2**22
_MOST_OF_TILE: Final = 2**15
"""What a tile counts among the numbers that are stored: a large one takes as little room in a file as a small one."""
# What a node says about its inactive values (io::writeCompressedValues)
_MINUS_BACKGROUND, _ONE_VALUE, _MASK, _MASK_ONE, _MASK_TWO, _ALL_VALUES = range(1, 7)


@dataclass(frozen=True)
class _Entry:
    """A grid of the file."""

    name: str
    tree: str
    parent: str
    begin: int
    blocks: int


@dataclass(frozen=True)
class _How:
    """How numbers of a grid are written."""

    half: bool
    compression: int
    background: float


class _Stream:
    """Bytes that are read one after the other."""

    def __init__(self, data: NDArray[np.uint8]) -> None:
        self._data, self.at = data, 0

    @property
    def rest(self) -> int:
        """Bytes that are left."""
        return len(self._data) - self.at

    def take(self, count: int) -> bytes:
        """So many bytes."""
        if not 0 <= count <= self.rest:
            raise ValueError("it ends too early")
        self.at += count
        return self._data[self.at - count : self.at].tobytes()

    def seek(self, at: int) -> None:
        """Go to a place."""
        if not 0 <= at <= len(self._data):
            raise ValueError("a grid begins outside of it")
        self.at = at

    def unpack(self, form: str) -> tuple[Any, ...]:
        """Numbers of a form of `struct`."""
        return struct.unpack(f"<{form}", self.take(struct.calcsize(f"<{form}")))

    def numbers(self, kind: str, count: int) -> NDArray[Any]:
        """Numbers of a type."""
        return np.frombuffer(self.take(np.dtype(kind).itemsize * count), kind)

    def mask(self, count: int) -> NDArray[np.bool_]:
        """As many bits."""
        return np.unpackbits(self.numbers("u1", count // 8), bitorder="little").astype(bool)

    def text(self) -> str:
        """A text after its length."""
        (length,) = self.unpack("I")
        if length > _MOST_TEXT:
            raise ValueError("a text has an impossible length")
        return self.take(length).decode("utf-8", "replace")

    def metadata(self) -> dict[str, bytes]:
        """A table of names and contents."""
        (count,) = self.unpack("I")
        if count > _MOST_ENTRIES:
            raise ValueError(f"it says that it has {counted(count, 'entry', 'entries')} of metadata")
        found = {}
        for _ in range(count):
            name, _ = self.text(), self.text()
            found[name] = self.take(*self.unpack("I"))
        return found


def vdb_names(file: BinaryIO) -> tuple[str, ...]:
    """Names of a file's grids of floats.

    Raises
    ------
    ValueError
        It is no such file, or a damaged one.
    """
    return tuple(each.name for each in _entries(_Stream(_content(file))) if each.tree == _TREE)


def read_openvdb(file: BinaryIO, label: str, name: str = "density") -> GridData:
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
    stream = _Stream(_content(file))
    entries = _entries(stream)
    chosen = chosen_grid(entries, [each for each in entries if each.tree == _TREE], name, label)
    if chosen.parent:
        raise SceneError(f"{label}: the grid {quoted(chosen.name)} is an instance of another one; name that")
    return _dense(stream, chosen, label)


def _content(file: BinaryIO) -> NDArray[np.uint8]:
    return np.frombuffer(file.read(), np.uint8)


def _entries(stream: _Stream) -> list[_Entry]:
    """What the head of a file says about its grids."""
    if stream.rest < 8 or stream.unpack("q")[0] != _MAGIC:
        raise ValueError("it does not begin as one")
    version, _, _, has_offsets = stream.unpack("IIIb")
    if version not in _VERSIONS:
        raise ValueError(f"its version is {version}, but {_VERSIONS[0]} to {_VERSIONS[-1]} are known")
    if not has_offsets:
        raise ValueError("it does not say where its grids are")
    stream.take(36)
    stream.metadata()
    (count,) = stream.unpack("I")
    if count > _MOST_GRIDS:
        raise ValueError(f"it says that it has {count} grids")
    entries = []
    for _ in range(count):
        name, tree, parent = stream.text().split("\x1e")[0], stream.text(), stream.text()
        begin, blocks, end = stream.unpack("3q")
        entries.append(_Entry(name, tree.removesuffix(_HALF), parent, begin, blocks))
        stream.seek(end)
    return entries


def _dense(stream: _Stream, entry: _Entry, label: str) -> GridData:
    """All values in the box of the leaves and tiles."""
    stream.seek(entry.begin)
    (compression,) = stream.unpack("I")
    if compression & ~(_ZIP | _ACTIVE_MASK | _BLOSC):
        raise ValueError("it is compressed in an unknown way")
    if compression & _BLOSC:
        require_blosc(label)
    meta = stream.metadata()
    if meta.get("class") == b"level set":
        raise SceneError(f"{label} is a level set, whose numbers are distances; convert it to a fog volume")
    matrix, vector = _map(stream, label)
    (buffers, background, tiles, children) = stream.unpack("IfII")
    if buffers != 1:
        raise ValueError("its tree has several buffers")
    if background != 0.0 and not (background > 0.0 and entry.name != "density"):
        raise SceneError(f"{label} has {background:g} everywhere outside of what it stores; a density has 0 there")
    how = _How(any(meta.get("is_saved_as_half_float", b"")), compression, background)
    tree = _Tree()
    if tiles > stream.rest // 17 or children > stream.rest // 12:
        raise ValueError("its tree has more branches than bytes")
    for _ in range(tiles):
        x, y, z, value, active = stream.unpack("3ifb")
        tree.root(x, y, z)
        if active:
            tree.add(np.array([[x, y, z]], np.int64), 4096, np.array([value], np.float32))
    for _ in range(children):
        x, y, z = stream.unpack("3i")
        tree.root(x, y, z)
        _branch(stream, np.array([x, y, z], np.int64), 32, 128, how, tree)
    stream.seek(entry.blocks)
    blocks = [_values(stream, stream.mask(512), how).reshape(8, 8, 8) for _ in tree.leaves]
    parts = [(origin[None], 8) for origin in tree.leaves] + [(origins, side) for origins, side, _ in tree.cubes]
    if not parts:  # such as a frame before anything burns
        parts = [(np.zeros((1, 3), np.int64), 1)]
    low = np.min([origins.min(axis=0) for origins, _ in parts], axis=0)
    high = np.max([origins.max(axis=0) + side - 1 for origins, side in parts], axis=0)
    stored = 512 * len(tree.leaves) + sum(len(values) * min(side**3, _MOST_OF_TILE) for _, side, values in tree.cubes)
    box = DenseBox(low.tolist(), high.tolist(), stored, label, background)
    for origins, side, values in tree.cubes:
        for origin, value in zip(origins, values.tolist(), strict=True):
            box.fill(origin, side, value)
    for origin, block in zip(tree.leaves, blocks, strict=True):
        box.put(origin, block)
    return box.placed(matrix, vector)


class _Tree:
    """Leaves of a tree, and cubes of one value, which are active and not the background."""

    def __init__(self) -> None:
        self.leaves: list[NDArray[np.int64]] = []
        self.cubes: list[tuple[NDArray[np.int64], int, NDArray[np.float32]]] = []
        self._roots: set[tuple[int, int, int]] = set()
        self._count = 0

    def root(self, x: int, y: int, z: int) -> None:
        """A branch of the root begins there, and no other one."""
        if (x, y, z) in self._roots or any(each % 4096 or abs(each) > _COORDINATE_LIMIT for each in (x, y, z)):
            raise ValueError("a branch of its tree is in a place where none can be")
        self._roots.add((x, y, z))

    def add(self, origins: NDArray[np.int64], side: int, values: NDArray[np.float32]) -> None:
        """Cubes of a side."""
        self._count += len(values)
        if self._count > _MOST_TILES:
            raise ValueError(f"its tree has more than {counted(_MOST_TILES, 'tile')}")
        if len(values):
            self.cubes.append((origins, side, values))


def _map(stream: _Stream, label: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The map from coordinates to metres: (3, 3) and (3,)."""
    kind = stream.text()
    if kind in ("AffineMap", "UnitaryMap"):
        rows = stream.numbers("<f8", 16).reshape(4, 4)  # of row vectors
        return np.ascontiguousarray(rows[:3, :3].T), rows[3, :3]
    vector = stream.numbers("<f8", 3) if "Translat" in kind else np.zeros(3)
    if kind == "TranslationMap":
        return np.eye(3), vector
    if kind not in ("UniformScaleMap", "ScaleMap", "UniformScaleTranslateMap", "ScaleTranslateMap"):
        raise SceneError(f"{label} is placed by a {quoted(kind)}, which is not known; resample the grid")
    scales = stream.numbers("<f8", 15)[:3]
    return np.diag(scales), vector


def _branch(stream: _Stream, origin: NDArray[np.int64], side: int, step: int, how: _How, tree: _Tree) -> None:
    """The topology of a node, whose entries have so many values a side."""
    count = side * side * side
    is_child, is_active = stream.mask(count), stream.mask(count)
    values = _values(stream, is_active, how)
    number = np.arange(count)
    cell = np.stack([number // (side * side), number // side % side, number % side], axis=1)
    tiles = ~is_child & is_active & (values != how.background)
    tree.add(origin + cell[tiles] * step, step, values[tiles])
    for child in origin + cell[is_child] * step:
        if step == 8:
            stream.take(64)
            tree.leaves.append(child)
        else:
            _branch(stream, child, 16, 8, how, tree)


def _values(stream: _Stream, is_active: NDArray[np.bool_], how: _How) -> NDArray[np.float32]:
    """The numbers of a node, of which those that are not active may have been left out."""
    count = len(is_active)
    (says,) = stream.unpack("B")
    if says > _ALL_VALUES:
        raise ValueError("a node is compressed in an unknown way")
    others = how.background
    inactive = others if says == 0 else -others
    if says in (_ONE_VALUE, _MASK_ONE, _MASK_TWO):
        (inactive,) = stream.unpack("f")
        if says == _MASK_TWO:
            (others,) = stream.unpack("f")
    chosen = stream.mask(count) if says in (_MASK, _MASK_ONE, _MASK_TWO) else np.zeros(count, bool)
    if not how.compression & _ACTIVE_MASK or says == _ALL_VALUES:
        return _numbers(stream, count, how)
    values = np.where(chosen, np.float32(others), np.float32(inactive))
    values[is_active] = _numbers(stream, int(np.count_nonzero(is_active)), how)
    return values


def _numbers(stream: _Stream, count: int, how: _How) -> NDArray[np.float32]:
    """So many numbers, decompressed."""
    kind = np.dtype("<f2" if how.half else "<f4")
    size = count * kind.itemsize
    if how.half and count == 0:
        return np.zeros(0, np.float32)
    packed: int | None = None
    if how.compression & (_ZIP | _BLOSC):
        (packed,) = stream.unpack("q")
    if packed is None or packed <= 0:  # these are as they are
        if packed is not None and -packed != size:
            raise ValueError("a node has another size than it says")
        return np.frombuffer(stream.take(size), kind).astype(np.float32)
    data = stream.take(packed)
    if size == 0:
        return np.zeros(0, np.float32)  # blosc has a head for nothing, too
    raw = (unblosced if how.compression & _BLOSC else unzipped)(data, size)
    return np.frombuffer(raw, kind).astype(np.float32)
