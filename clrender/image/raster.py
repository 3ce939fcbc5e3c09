"""Picture files of other programs: TGA, BMP, PNM, TIFF, GIF and DDS, each by Pillow's reader of just that format.

Pillow's own `open` tries dozens of readers, and refuses large images. Here the content decides. Only the header is read
until pixels are requested, and a file that cannot contain as many pixels as it says is refused before.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import IO, TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.image.display import check_size
from clrender.image.tone_map import srgb_decode

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

__all__ = ["RASTER_ENDINGS", "open_raster", "raster_ending", "raster_floats", "raster_words", "read_raster"]


@dataclass(frozen=True)
class _Format:
    """A format of files.

    Attributes
    ----------
    reader : str
        Module and class of Pillow.
    signature : callable
        Whether a file that begins with these bytes is of this format.
    ratio : int
        Upper bound of the pixels per byte of a file.
    """

    reader: str
    signature: Callable[[bytes], bool]
    ratio: int

    def open(self, file: IO[bytes]) -> ImageFile:
        module, name = self.reader.split(".")
        picture: ImageFile = getattr(import_module(f"PIL.{module}"), name)(file)
        return picture


def _tga(start: bytes) -> bool:
    """TGA has no signature: kinds of colour map and image that there are, and depths."""
    return len(start) >= 18 and start[1] <= 1 and start[2] in (1, 2, 3, 9, 10, 11) and start[16] in (8, 15, 16, 24, 32)


_FORMATS: Final[Mapping[str, _Format]] = {
    # Runs of up to 255 pixels in two bytes
    "BMP": _Format("BmpImagePlugin.BmpImageFile", lambda start: start[:2] == b"BM", 128),
    # A code of 12 bits is a row of up to 4096 pixels
    "GIF": _Format("GifImagePlugin.GifImageFile", lambda start: start[:6] in (b"GIF87a", b"GIF89a"), 2731),
    # Deflate, of one bit for each pixel
    "TIFF": _Format("TiffImagePlugin.TiffImageFile", lambda start: start[:4] in (b"II*\0", b"MM\0*"), 8 * 1032),
    "DDS": _Format("DdsImagePlugin.DdsImageFile", lambda start: start[:4] == b"DDS ", 2),
    "PNM": _Format("PpmImagePlugin.PpmImageFile", lambda start: start[:1] == b"P" and start[1:2] in b"123456", 8),
    # Runs of up to 128 pixels in two bytes
    "TGA": _Format("TgaImagePlugin.TgaImageFile", _tga, 64),
}
"""Those with a signature first."""
RASTER_ENDINGS: Final = (".tga", ".bmp", ".ppm", ".pgm", ".pbm", ".pnm", ".tif", ".tiff", ".gif", ".dds")
"""Extensions of their files."""


def raster_ending(start: bytes) -> str | None:
    """Extension of the format of a file that begins with these bytes; of TGA, which has no signature, a guess."""
    names = {"BMP": ".bmp", "GIF": ".gif", "TIFF": ".tif", "DDS": ".dds", "PNM": ".ppm", "TGA": ".tga"}
    return next((names[name] for name, each in _FORMATS.items() if each.signature(start)), None)


def open_raster(file: IO[bytes], most: int) -> ImageFile | None:
    """Open a picture file and read its header; None if it is in none of the formats.

    Parameters
    ----------
    file : binary file
        At its beginning.
    most : int
        Largest number of pixels.

    Raises
    ------
    ValueError, or whatever Pillow raises
        The file is damaged, too large, or too small for its size.
    """
    start = file.read(32)
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    found = next((each for each in _FORMATS.values() if each.signature(start)), None)
    if found is None:
        return None
    picture = found.open(file)
    check_size(*picture.size, most)
    if picture.width * picture.height > found.ratio * size:
        raise ValueError("it is truncated: it is too small for the size its header gives")
    return picture


def raster_floats(picture: ImageFile) -> npt.NDArray[np.float32]:
    """Pixels of a picture of floats, which is grey: (H, W, 3) float32."""
    pixels = np.asarray(picture, np.float32)
    return np.ascontiguousarray(np.broadcast_to(pixels[..., None], (*pixels.shape, 3)))


def raster_words(picture: ImageFile) -> npt.NDArray[np.uint16]:
    """Pixels of a picture of integers, which is grey: (H, W, 1) uint16, where 65535 is 1.

    Raises
    ------
    ValueError
        It has more than 16 bits.
    """
    pixels: npt.NDArray[Any] = np.asarray(picture)
    if pixels.min() < 0 or pixels.max() > 65535:
        raise ValueError("its integers have more than 16 bits, which are not read; save it with 16, or as floats")
    return pixels.astype(np.uint16)[..., None]


def read_raster(file: IO[bytes], most: int) -> npt.NDArray[np.float32]:
    """A picture as (H, W, 3) linear values: decoded from sRGB to 0..1, or floats as they are.

    Raises
    ------
    ValueError, or whatever Pillow raises
        The file is damaged, too large, or in none of the formats.
    """
    picture = open_raster(file, most)
    if picture is None:
        raise ValueError("it is no TGA, BMP, PNM, TIFF, GIF or DDS")
    with picture:
        if picture.mode.startswith("F"):
            return raster_floats(picture)
        deep = picture.mode.startswith("I")
        pixels = np.repeat(raster_words(picture), 3, axis=2) if deep else np.asarray(picture.convert("RGB"))
    largest = 65535 if deep else 255
    linear: npt.NDArray[np.float32] = srgb_decode(np.arange(largest + 1) / largest).astype(np.float32)[pixels]
    return linear
