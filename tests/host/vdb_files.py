"""OpenVDB files, ``.vdb``, written by the specification of version 224 of the format: trees of floats."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["vdb_bytes"]

_ALL_VALUES = 6


def vdb_bytes(
    grids: Mapping[str, NDArray[Any]],
    first: tuple[int, int, int] = (0, 0, 0),
    voxel: float = 1.0,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    zipped: bool = False,
    blosc: bool = False,
    masked: bool = False,
    half: bool = False,
    tiles: bool = False,
    background: float = 0.0,
    grid_class: str = "fog volume",
    kind: str = "float",
) -> bytes:
    """Grids (nx, ny, nz) of floats, whose first value has the coordinates `first`.

    `masked`: inactive values are left out. `tiles`: blocks of one value are no leaves but entries of the nodes above.
    """
    how = _How((1 if zipped else 0) | (2 if masked else 0) | (4 if blosc else 0), "<f2" if half else "<f4", tiles)
    head = struct.pack("<qIIIb", 0x56444220, 224, 10, 0, 1) + b"0" * 8 + b"-" + b"1" * 27
    head += struct.pack("<I", 0) + struct.pack("<I", len(grids))
    data = head
    for name, values in grids.items():
        tree = f"Tree_{kind}_5_4_3{'_HalfFloat' if half else ''}"
        descriptor = _text(name) + _text(tree) + _text("")
        body, block_at = _grid(values, first, voxel, offset, how, background, grid_class)
        start = len(data) + len(descriptor) + 24
        data += descriptor + struct.pack("<3q", start, start + block_at, start + len(body)) + body
    return data


@dataclass(frozen=True)
class _How:
    """Compression flags, type of numbers, and whether blocks of one value are tiles."""

    compression: int
    kind: str
    tiles: bool


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _grid(
    values: NDArray[Any], first: tuple[int, int, int], voxel: float, offset: tuple[float, float, float], how: _How,
    background: float, grid_class: str,
) -> tuple[bytes, int]:  # fmt: skip
    """A grid, and where its leaves' numbers begin in it."""
    blocks: dict[tuple[int, ...], NDArray[np.float32]] = {}
    for index in np.ndindex(*values.shape):
        at = tuple(int(a) for a in np.array(first) + index)
        leaf = blocks.setdefault(tuple(a >> 3 << 3 for a in at), np.zeros((8, 8, 8), np.float32))
        leaf[tuple(a & 7 for a in at)] = values[index]
    flat = {key: float(each[0, 0, 0]) for key, each in blocks.items() if how.tiles and (each == each[0, 0, 0]).all()}
    lowers = _grouped(blocks, 7)
    uppers = _grouped(lowers, 12)
    meta = {"class": ("string", grid_class.encode())}
    if how.kind == "<f2":
        meta["is_saved_as_half_float"] = ("bool", b"\1")
    body = struct.pack("<II", how.compression, len(meta))
    for key, (of, content) in meta.items():
        body += _text(key) + _text(of) + struct.pack("<I", len(content)) + content
    scale = np.full(3, voxel)
    numbers = [scale, scale, 1.0 / scale, 1.0 / scale**2, 0.5 / scale]
    body += _text("ScaleTranslateMap") + np.array([offset, *numbers], "<f8").tobytes()
    body += struct.pack("<If2I", 1, background, 0, len(uppers))
    leaves = b""
    for upper, below in sorted(uppers.items()):
        body += struct.pack("<3i", *upper) + _node({_entry(key, 4095, 7, 32) for key in below}, {}, 32, how)
        for lower in sorted(below, key=lambda key: _entry(key, 4095, 7, 32)):
            inside = {_entry(key, 127, 3, 16): key for key in lowers[lower]}
            tiles = {entry: flat[key] for entry, key in inside.items() if key in flat}
            body += _node(inside.keys() - tiles.keys(), tiles, 16, how)
            for entry in sorted(inside.keys() - tiles.keys()):
                block = blocks[inside[entry]].ravel()
                mask = block != 0.0
                bits = np.packbits(mask, bitorder="little").tobytes()
                body += bits
                leaves += bits + _values(block, mask, how)
    return body + leaves, len(body)


def _grouped(keys: Any, shift: int) -> dict[tuple[int, ...], list[tuple[int, ...]]]:
    found: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    for key in keys:
        found.setdefault(tuple(a >> shift << shift for a in key), []).append(key)
    return found


def _entry(key: tuple[int, ...], mask: int, shift: int, side: int) -> int:
    x, y, z = ((a & mask) >> shift for a in key)
    return (x * side + y) * side + z


def _node(children: Set[int], tiles: Mapping[int, float], side: int, how: _How) -> bytes:
    """Masks of children and active tiles, and the values of tiles."""
    mask, active, values = np.zeros(side**3, bool), np.zeros(side**3, bool), np.zeros(side**3, np.float32)
    mask[list(children)] = True
    active[list(tiles)] = True
    values[list(tiles)] = list(tiles.values())
    masks = [np.packbits(each, bitorder="little").tobytes() for each in (mask, active)]
    return b"".join(masks) + _values(values, active, how)


def _values(values: NDArray[Any], active: NDArray[np.bool_], how: _How) -> bytes:
    """What is said of inactive values, and the numbers."""
    if how.compression & 2 and not values[~active].any():
        return b"\0" + _numbers(values[active], how)
    return bytes([_ALL_VALUES]) + _numbers(values, how)


def _numbers(values: NDArray[Any], how: _How) -> bytes:
    raw = values.astype(how.kind).tobytes()
    if how.kind == "<f2" and not raw:
        return b""
    if not how.compression & 5:
        return raw
    if how.compression & 4:
        from numcodecs.blosc import compress

        packed = bytes(compress(raw, b"lz4", 5, 1))
    else:
        packed = zlib.compress(raw)
    if len(packed) >= len(raw) > 0:
        return struct.pack("<q", -len(raw)) + raw
    return struct.pack("<q", len(packed)) + packed
