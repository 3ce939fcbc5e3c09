"""Pictures as kernels read them: texels in tiles of 64 bytes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.image.pictures import Picture
from clrender.image.tone_map import srgb_decode

__all__ = [
    "TILE_BYTES",
    "StoredPicture",
    "aligned_tiles",
    "coded_values",
    "fill_tiles",
    "picture_sha256",
    "tile_count",
    "tile_shape",
    "tiled_picture",
]

TILE_BYTES: Final = 64
"""A cache line."""
_BYTES: Final[Mapping[str, int]] = {"unorm8": 1, "unorm16": 2, "half": 2, "float": 4}
_KINDS: Final[Mapping[str, str]] = {"unorm8": "u1", "unorm16": "<u2", "half": "<u2", "float": "<f4"}


@dataclass(frozen=True)
class StoredPicture:
    """An image in a store.

    Attributes
    ----------
    width, height : int
    channels : int
        1 or 4.
    coding : str
        See `clrender.image.pictures.Picture`.
    first_tile, tiles : int
    sha256 : str
        Hash of its pixels and of these attributes except its position.
    """

    width: int
    height: int
    channels: int
    coding: str
    first_tile: int
    tiles: int
    sha256: str

    @property
    def texel_bits(self) -> int:
        """Base-2 logarithm of the bytes per texel."""
        return (_BYTES[self.coding] * self.channels).bit_length() - 1


def picture_sha256(picture: Picture | StoredPicture, tiles: NDArray[np.uint8]) -> str:
    """Hash of an image's size, coding and tiles."""
    head = f"{picture.width} {picture.height} {picture.channels} {picture.coding}"
    digest = hashlib.sha256(head.encode())
    digest.update(tiles.data)
    return digest.hexdigest()


def tile_shape(texel_bits: int) -> tuple[int, int]:
    """Width and height of a tile whose texels have ``2 ** texel_bits`` bytes, as in kernels/texture/texel.h."""
    down = (6 - texel_bits) // 2
    return 1 << (6 - texel_bits - down), 1 << down


@cache
def coded_values(coding: str, srgb: bool) -> NDArray[np.float32]:
    """Linear value of each number of 8 or 16 bits.

    Parameters
    ----------
    coding : str
        See `clrender.image.pictures.Picture`; not "float".
    srgb : bool
        Whether the numbers are sRGB-encoded.
    """
    if coding == "half":
        return np.arange(65536, dtype=np.uint16).view(np.float16).astype(np.float32)
    largest = 255 if coding == "unorm8" else 65535
    share = np.arange(largest + 1) / largest
    return (srgb_decode(share) if srgb else share).astype(np.float32)


def tiled_picture(stored: StoredPicture, tiles: NDArray[np.uint8]) -> Picture:
    """An image that is already in tiles."""
    return Picture(stored.width, stored.height, stored.channels, stored.coding, lambda: iter((tiles,)))


def tile_count(picture: Picture) -> int:
    """Number of tiles that an image takes."""
    across, down = _shape(picture)
    return -(-picture.width // across) * -(-picture.height // down)


def _shape(picture: Picture) -> tuple[int, int]:
    return tile_shape((_BYTES[picture.coding] * picture.channels).bit_length() - 1)


def fill_tiles(tiles: NDArray[np.uint8], picture: Picture) -> None:
    """Write an image's tiles, band by band; texels beyond its edges are zero."""
    across, down = _shape(picture)
    columns = -(-picture.width // across)
    at = 0
    for band in picture.bands():
        if band.ndim == 2:  # already in tiles
            tiles[:] = band
            return
        rows = -(-len(band) // down)
        shape = (rows * down, columns * across, picture.channels)
        whole = np.asarray(band, _KINDS[picture.coding])
        if whole.shape != shape:
            whole = np.zeros(shape, whole.dtype)
            whole[: len(band), : picture.width] = band
        target = tiles[at : at + rows * columns].view(whole.dtype)
        blocks = whole.reshape(rows, down, columns, across, picture.channels)
        target.reshape(rows, columns, down, across, picture.channels)[:] = blocks.transpose(0, 2, 1, 3, 4)
        at += rows * columns


def aligned_tiles(tiles: int) -> NDArray[np.uint8]:
    """Uninitialised tiles, aligned to 4096 bytes; the system commits memory only where something is written."""
    raw = np.empty(tiles * TILE_BYTES + 4096, np.uint8)
    start = -raw.ctypes.data % 4096
    return raw[start : start + tiles * TILE_BYTES].reshape(tiles, TILE_BYTES)
