"""PNG and JPEG files: display images, written with 8 bits per channel and read as linear values."""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Mapping
from typing import IO, TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError
from clrender.image.tone_map import srgb_decode

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

__all__ = [
    "JPEG_SIDE_LIMIT",
    "PIXEL_LIMIT",
    "check_size",
    "deep_pixels",
    "is_deep",
    "jpeg_bytes",
    "open_display",
    "png_bytes",
    "png_note",
    "read_display",
]

PIXEL_LIMIT: Final = 1 << 30
"""Largest number of pixels of an image that is read."""
_DEFLATE_RATIO: Final = 1032
"""Largest compression ratio of deflate (RFC 1951: 258 bytes from two bits)."""
JPEG_SIDE_LIMIT: Final = 65500
"""Largest width and height of a JPEG, pixels."""
_JPEG_RATIO: Final = 1024
"""Largest number of pixels per byte of a JPEG: a block of 64 takes one bit."""


def check_size(width: int, height: int, most: int = PIXEL_LIMIT) -> None:
    """Refuse empty images, and those of more than `most` pixels.

    Raises
    ------
    ValueError
    """
    if width < 1 or height < 1 or width * height > most:
        raise ValueError(f"{width} x {height} pixels are not between 1 and {most}")


def png_bytes(pixels: npt.NDArray[np.uint8], notes: Mapping[str, str]) -> bytes:
    """PNG file of (H, W, 3) pixels, with the notes in `iTXt` chunks."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    texts = PngInfo()
    for name, text in notes.items():
        texts.add_itxt(name, text)
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG", pnginfo=texts)
    return data.getvalue()


def jpeg_bytes(pixels: npt.NDArray[np.uint8]) -> bytes:
    """JPEG file of (H, W, 3) pixels.

    Raises
    ------
    UsageError
        Width or height exceeds the limit of the format.
    """
    from PIL import Image

    height, width, _ = pixels.shape
    if max(width, height) > JPEG_SIDE_LIMIT:
        raise UsageError(f"a .jpg holds at most {JPEG_SIDE_LIMIT} pixels a side, not {width} x {height}; use .png.")
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "JPEG", quality=95, subsampling=0)
    return data.getvalue()


def png_note(file: IO[bytes], name: str) -> str | None:
    """A text of a PNG, or None if it has none of that name."""
    text = open_display(file).info.get(name)
    return None if text is None else str(text)


def read_display(file: IO[bytes], most: int = PIXEL_LIMIT) -> npt.NDArray[np.float32]:
    """A PNG or JPEG, of 8 or 16 bits per channel, as (H, W, 3) linear values in 0..1.

    Raises
    ------
    ValueError, or whatever Pillow raises
        The file is damaged or too large.
    """
    with open_display(file, most) as picture:
        deep = is_deep(picture)
        pixels = deep_pixels(file, picture)[..., :3] if deep else np.asarray(picture.convert("RGB"))
    largest = 65535 if deep else 255
    linear: npt.NDArray[np.float32] = srgb_decode(np.arange(largest + 1) / largest).astype(np.float32)[pixels]
    return linear if linear.shape[2] == 3 else np.repeat(linear, 3, axis=2)


def is_deep(picture: ImageFile) -> bool:
    """Whether the file has 16 bits per channel, by Pillow's raw mode such as `RGB;16B`."""
    return any(";16" in str(arguments) for _, _, _, arguments in picture.tile)


def deep_pixels(file: IO[bytes], picture: ImageFile) -> npt.NDArray[np.uint16]:
    """Pixels of a PNG with 16 bits per channel: (H, W, 1) if grey, else (H, W, 3 or 4), also if one colour is clear.

    For colours, Pillow returns only the first byte of each channel. Decoded again with the opposite byte order, it
    returns the second.
    """
    modes = {str(tile.args) for tile in picture.tile}
    if modes == {"I;16B"}:
        return _with_clear(np.asarray(picture).astype(np.uint16)[..., None], picture)
    if not modes <= {"RGB;16B", "RGBA;16B"}:
        raise ValueError("it is grey with alpha in 16 bits, which is not read: save it without alpha")
    high = np.asarray(picture).astype(np.uint16)
    file.seek(0)
    again = open_display(file)
    again.tile = [tile._replace(args=str(tile.args).replace("16B", "16L")) for tile in again.tile]
    high <<= 8
    high |= np.asarray(again)
    return _with_clear(high, picture)


def _with_clear(pixels: npt.NDArray[np.uint16], picture: ImageFile) -> npt.NDArray[np.uint16]:
    """Pixels with alpha, (H, W, 4), if a chunk `tRNS` declares one colour, or level of grey, to be clear."""
    clear = picture.info.get("transparency")
    if clear is None:
        return pixels
    whole = np.empty((*pixels.shape[:2], 4), np.uint16)
    whole[..., :3] = pixels
    whole[..., 3] = np.where((pixels == np.array(clear, np.uint16)).all(axis=2), 0, 65535)
    return whole


def open_display(file: IO[bytes], most: int = PIXEL_LIMIT) -> ImageFile:
    """Open a PNG or JPEG, read only its header, and check that the file can contain an image of its size.

    Uses Pillow's format classes directly: `PIL.Image.open` refuses more than 179 million pixels.
    """
    from PIL.JpegImagePlugin import JpegImageFile
    from PIL.PngImagePlugin import PngImageFile

    start = file.read(29)
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    file.seek(0)
    if start[:8] == b"\x89PNG\r\n\x1a\n" and len(start) == 29:
        width, height, depth, color = struct.unpack(">IIBB", start[16:26])
        check_size(width, height, most)
        bits = depth * {2: 3, 4: 2, 6: 4}.get(color, 1)
        if height * (width * bits // 8 + 1) > _DEFLATE_RATIO * size:
            raise ValueError("it is truncated: it is too small for the size its header gives")
        return PngImageFile(file)
    if start[:2] == b"\xff\xd8":
        picture = JpegImageFile(file)
        check_size(*picture.size, most)
        if picture.width * picture.height > _JPEG_RATIO * size:
            raise ValueError("it is truncated: it is too small for the size its header gives")
        return picture
    raise ValueError("it is neither a PNG nor a JPEG")
