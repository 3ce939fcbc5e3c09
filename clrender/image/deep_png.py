"""PNG files with 16 bits per channel, of masks, distances and sensors: Pillow writes none with colours."""

from __future__ import annotations

import struct
import zlib
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["deep_png_bytes"]

_KINDS: Final = {1: 0, 3: 2}
"""Colour types of the format, by number of channels."""
_UP: Final = 2
"""The filter that stores differences from the row above (PNG, 9.2)."""


def deep_png_bytes(pixels: npt.NDArray[np.uint16]) -> bytes:
    """The file of an image.

    Parameters
    ----------
    pixels : (H, W) or (H, W, 3) uint16
        Grey, or red, green and blue.

    Returns
    -------
    bytes
    """
    height, width = pixels.shape[:2]
    kind = _KINDS[1 if pixels.ndim == 2 else pixels.shape[2]]
    rows = np.ascontiguousarray(pixels, ">u2").reshape(height, -1).view(np.uint8)
    filtered = np.full((height, rows.shape[1] + 1), _UP, np.uint8)
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])  # modulo 256
    header = struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(filtered.tobytes(), 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(name, data) for name, data in parts)


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
