"""Small KTX2 files for tests."""

from __future__ import annotations

import base64
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ETC1S", "ETC1S_BLOCKS", "blocks_of", "ktx2", "plain", "uastc", "zstd"]

_SOLID, _SOLID_BITS = 0x17, 5
"""Code of UASTC's mode for blocks of one colour."""


def ktx2(
    width: int, height: int, level: bytes, kind: int = 0, model: int = 1, scheme: int = 0, room: int = 0, **more: int
) -> bytes:
    """A file with one level.

    Parameters
    ----------
    width, height : int
    level : bytes
    kind, model, scheme : int
        Numbers of Vulkan's format, of the colour model and of the supercompression.
    room : int
        Bytes of the level before it was compressed again.
    more : int
        Other numbers of the header: ``depth layers faces``.
    """
    channel = 3 if model == 166 else 0  # with alpha
    dimensions = (3, 3, 0, 0, 16) if model == 166 else (0, 0, 0, 0, 4)
    descriptor = struct.pack("<IIHH", 44, 0, 2, 40) + bytes([model, 1, 2, 0, *dimensions]) + bytes(7)
    descriptor += struct.pack("<HBB4xII", 0, 127, channel, 0, 2**32 - 1)
    head = (kind, 1, width, height, more.get("depth", 0), more.get("layers", 0), more.get("faces", 1), 1, scheme)
    start = 80 + 24 + len(descriptor)
    start += -start % 16
    data = b"\xabKTX 20\xbb\r\n\x1a\n" + struct.pack("<9I", *head) + struct.pack("<4I", 104, len(descriptor), 0, 0)
    data += struct.pack("<2Q", 0, 0) + struct.pack("<3Q", start, len(level), room or len(level)) + descriptor
    return data.ljust(start, b"\0") + level


def blocks_of(colors: Any) -> NDArray[np.uint8]:
    """Pixels of a picture in blocks of 4 x 4 pixels of one colour: (h, w, n) to (4 h, 4 w, n)."""
    return np.repeat(np.repeat(np.asarray(colors, np.uint8), 4, axis=0), 4, axis=1)


def uastc(colors: Any) -> bytes:
    """Blocks of UASTC, each of one colour with alpha, without what speeds up other targets: (h, w, 4)."""
    found = b""
    for color in np.asarray(colors, np.uint8).reshape(-1, 4):
        bits = _SOLID | int.from_bytes(color.tobytes(), "little") << _SOLID_BITS
        found += bits.to_bytes(16, "little")
    return found


def zstd(data: bytes) -> bytes:
    """A frame of Zstandard (RFC 8878) that holds up to 128 KiB as they are."""
    size = len(data)
    block = (size << 3 | 1).to_bytes(3, "little")
    return struct.pack("<IBI", 0xFD2FB528, 0xA0, size) + block + data


def plain(pixels: Any, deflated: bool = False) -> bytes:
    """A file of RGB or RGBA, (h, w, 3 or 4) of 8 bits."""
    array = np.asarray(pixels, np.uint8)
    height, width, channels = array.shape
    data = array.tobytes()
    level = zlib.compress(data) if deflated else data
    return ktx2(width, height, level, 43 if channels == 4 else 29, 1, 3 if deflated else 0, len(data))


ETC1S_BLOCKS = [[[230, 30, 40, 255], [30, 200, 60, 128]], [[40, 60, 220, 255], [240, 240, 240, 20]]]
"""Colours of the blocks of `ETC1S`, which has them within 4."""
ETC1S = base64.b64decode(
    "q0tUWCAyMLsNChoKAAAAAAEAAAAIAAAACAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAADwAAACkAAAAJAAAAMgAAAAAAAAAmAAAAAAAAABgAQAA"
    "AAAAAAQAAAAAAAAAAAAAAAAAAAA8AAAAAAAAAAIAOACjAQIAAwMAAAgIAAAAAAAAAAA/AAAAAAAAAAAA/////0AAPw8AAAAAAAAAAP////8fAAAA"
    "S1RYd3JpdGVyAEJhc2lzIFVuaXZlcnNhbCAyLjEwAAAHAAIAOAAAAAkAAAAvAAAAAAAAAAAAAAAAAAAAAgAAAAIAAAACAAAAIMDUAAIAACAAOMA3"
    "SXEqgCkBAAAAAADkggAEiBsgAAAACJpDOkFEACIACAAAAEJ6BS7CVUd7XhmsqqqqUlVVVQUAwUQAAAAAAADyXynFATABIAAAAAAEMTcCRAgQAAAA"
    "gMQEEwQAEwAAAAAAAAggAEkYwi0="
)
"""A file of 8 x 8 pixels in ETC1S with alpha, whose tables are Huffman codes: written by an encoder."""
