"""Files of grids, written by their specifications: Mitsuba's ``.vol`` and NanoVDB's ``.nvdb``."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["nanovdb_bytes", "vol_bytes"]

_LEAF, _LOWER, _UPPER = 2144, 33856, 270400


def vol_bytes(values: NDArray[Any], box: tuple[float, ...] = (0, 0, 0, 1, 1, 1), channels: int = 1) -> bytes:
    """A grid (nz, ny, nx) of floats or bytes."""
    kind = {"f4": 1, "f2": 2, "u1": 3}[values.dtype.str[1:]]
    nz, ny, nx = values.shape[:3]
    return struct.pack("<3sBi3ii6f", b"VOL", 3, kind, nx, ny, nz, channels, *box) + values.tobytes()


def nanovdb_bytes(
    values: NDArray[Any],
    first: tuple[int, int, int] = (0, 0, 0),
    voxel: float = 1.0,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    name: str = "density",
    codec: int = 0,
    chunk: int = 2**30,
    tiles: bool = False,
    background: float = 0.0,
    grid_class: int = 2,
    kind: int = 1,
    bits: int = 0,
) -> bytes:
    """A grid (nx, ny, nz) of floats, whose first value has the coordinates `first`.

    With `tiles`, blocks of one value are no leaves but entries of the nodes above. With `bits`, leaves have codes.
    """
    leaf_bytes = 96 + 64 * bits if bits else _LEAF
    blocks: dict[tuple[int, ...], NDArray[np.float32]] = {}
    low = np.array(first)
    for index in np.ndindex(*values.shape):
        at = tuple(int(a) for a in low + index)
        leaf = blocks.setdefault(tuple(a >> 3 << 3 for a in at), np.zeros((8, 8, 8), np.float32))
        leaf[tuple(a & 7 for a in at)] = values[index]
    lowers: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    for key in blocks:
        lowers.setdefault(tuple(a >> 7 << 7 for a in key), []).append(key)
    uppers: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    for key in lowers:
        uppers.setdefault(tuple(a >> 12 << 12 for a in key), []).append(key)
    flat = {key for key, block in blocks.items() if tiles and (block == block[0, 0, 0]).all()}
    leaves = [key for key in blocks if key not in flat]

    root_at = 64  # from the tree on
    upper_at = root_at + 64 + 32 * len(uppers)
    lower_at = upper_at + _UPPER * len(uppers)
    leaf_at = lower_at + _LOWER * len(lowers)
    total = 672 + leaf_at + leaf_bytes * len(leaves)
    data = bytearray(total)
    high = low + np.array(values.shape) - 1

    struct.pack_into("<8sQIIIIQ", data, 0, b"NanoVDB1", 0, 32 << 21 | 6 << 10, 0, 0, 1, total)
    data[40 : 40 + len(name)] = name.encode()
    struct.pack_into("<9d", data, 296 + 88, *(voxel * np.eye(3)).reshape(-1))
    struct.pack_into("<3d", data, 296 + 232, *offset)
    struct.pack_into("<II", data, 632, grid_class, kind)
    tree = 672
    counts = len(leaves), len(lowers), len(uppers), len(flat), 0, 0
    struct.pack_into("<4Q6IQ", data, tree, leaf_at, lower_at, upper_at, root_at, *counts, values.size)
    root = tree + root_at
    struct.pack_into("<6iI4f", data, root, *low.tolist(), *high.tolist(), len(uppers), background, 0.0, 1.0, 0.0)
    place = {key: tree + upper_at + _UPPER * i for i, key in enumerate(uppers)}
    lower_place = {key: tree + lower_at + _LOWER * i for i, key in enumerate(lowers)}
    leaf_place = {key: tree + leaf_at + leaf_bytes * i for i, key in enumerate(leaves)}
    for number, (key, children) in enumerate(uppers.items()):
        x, y, z = ((a & 0xFFFFFFFF) >> 12 for a in key)
        struct.pack_into("<QqIf", data, root + 64 + 32 * number, x << 42 | y << 21 | z, place[key] - root, 0, 0.0)
        for child in children:
            n = _entry(child, 4095, 7, 32)
            _child(data, place[key], 32, 32768, 8256, n, lower_place[child])
    for key, children in lowers.items():
        for child in children:
            n = _entry(child, 127, 3, 16)
            if child in flat:
                struct.pack_into("<f", data, lower_place[key] + 1088 + 8 * n, float(blocks[child][0, 0, 0]))
            else:
                _child(data, lower_place[key], 32, 4096, 1088, n, leaf_place[child])
    for key, where in leaf_place.items():
        struct.pack_into("<3i", data, where, *key)
        data[where + 96 : where + leaf_bytes] = _leaf(data, where, blocks[key].ravel(), bits)

    packed = bytes(data)
    if codec == 1:
        packed = zlib.compress(packed)
        packed = struct.pack("<Q", len(packed)) + packed
    if codec == 2:
        from numcodecs.blosc import compress

        parts = [compress(packed[at : at + chunk], b"lz4", 9, 1) for at in range(0, total, chunk)]
        packed = b"".join(struct.pack("<Q", len(part)) + part for part in parts)
    head = struct.pack("<8sIHH", b"NanoVDB2", 32 << 21 | 6 << 10, 1, codec)
    meta = struct.pack("<QQQQII6d6i3dI4I3IHHI", total, len(packed), 0, values.size, kind, grid_class, *[0.0] * 6,
                       *low.tolist(), *high.tolist(), voxel, voxel, voxel, len(name) + 1, len(leaves), len(lowers),
                       len(uppers), 1, 0, 0, 0, codec, 0, 32 << 21 | 6 << 10)  # fmt: skip
    return head + meta + name.encode() + b"\0" + packed


def _leaf(data: bytearray, at: int, values: NDArray[np.float32], bits: int) -> bytes:
    """The table of a leaf: floats, or codes, of which the least value and the step are written before."""
    if not bits:
        return values.astype("<f4").tobytes()
    least, most = float(values.min()), float(values.max())
    step = (most - least) / (2**bits - 1)
    struct.pack_into("<2f", data, at + 80, least, step)
    data[at + 15] = (bits.bit_length() - 1) << 5
    codes = np.floor((values - least) / (step or 1.0) + 0.5).astype(np.uint16)
    return np.packbits(codes[:, None] >> np.arange(bits, dtype=np.uint16) & 1, bitorder="little").tobytes()


def _entry(key: tuple[int, ...], mask: int, shift: int, side: int) -> int:
    x, y, z = ((a & mask) >> shift for a in key)
    return (x * side + y) * side + z


def _child(data: bytearray, node: int, masks: int, count: int, table: int, n: int, child: int) -> None:
    data[node + masks + count // 8 + n // 8] |= 1 << (n % 8)
    struct.pack_into("<q", data, node + table + 8 * n, child - node)
