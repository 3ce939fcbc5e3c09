"""Picture files of other programs: TGA, BMP, PNM, TIFF, GIF and DDS, each by Pillow's reader of just that format.

Pillow's own `open` tries dozens of readers, and refuses large images. Here the content decides. Only the header is read
until pixels are requested, and a file that cannot contain as many pixels as it says is refused before.
"""

from __future__ import annotations

import os
import re
import sys
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

__all__ = [
    "RASTER_ENDINGS",
    "is_deep_raster",
    "open_raster",
    "raster_colors",
    "raster_ending",
    "raster_floats",
    "raster_words",
    "read_raster",
]


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


def is_deep_raster(picture: ImageFile) -> bool:
    """Whether a TIFF or PPM has colours of more than 8 bits, which `raster_colors` reads.

    Not those of a TIFF in CMYK or multiplied by alpha, of which Pillow gives 8 bits.
    """
    return picture.mode in ("RGB", "RGBA") and (_most_of_ppm(picture) > 255 or bool(_words_of_tiff(picture)))


def raster_colors(file: IO[bytes], picture: ImageFile) -> npt.NDArray[np.uint16]:
    """Pixels of a picture of `is_deep_raster`: (H, W, 3 or 4) uint16, where 65535 is 1.

    Raises
    ------
    ValueError, or whatever Pillow raises
        The file is damaged.
    """
    if (most := _most_of_ppm(picture)) > 255:
        return _ppm_words(file, picture, most)
    # Pillow keeps the first byte of each number; read in the other order of bytes, the second one is the first
    turned = _words_of_tiff(picture)
    high = np.asarray(picture).astype(np.uint16)
    file.seek(0)
    again = _FORMATS["TIFF"].open(file)
    again.tile = [
        tile._replace(args=(mode, *(tile.args or ())[1:]))  # its arguments are a tuple, as `turned` says
        for tile, mode in zip(again.tile, turned, strict=True)
    ]
    high <<= 8
    high |= np.asarray(again)
    return high


def _words_of_tiff(picture: ImageFile) -> list[str]:
    """Pillow's raw modes of the parts of a TIFF in the other order of bytes; none if it is not of 16 bits."""
    turned = {"L": "B", "B": "L", "N": "B" if sys.byteorder == "little" else "L"}
    kinds = [tile.args[0] for tile in picture.tile if isinstance(tile.args, tuple) and tile.args]
    found = [re.fullmatch(r"((?:RGB|RGBA|RGBX|[RGBA]);16)([LBN])", str(kind)) for kind in kinds]
    if picture.format != "TIFF" or len(kinds) < len(picture.tile):
        return []
    return [f"{each[1]}{turned[each[2]]}" for each in found if each] if all(found) else []


def _most_of_ppm(picture: ImageFile) -> int:
    """The number that stands for 1 in a PPM; 0 of other files."""
    if picture.format != "PPM" or picture.mode != "RGB" or not picture.tile:
        return 0
    args = picture.tile[0].args
    return int(args[1]) if isinstance(args, tuple) else 255


def _ppm_words(file: IO[bytes], picture: ImageFile, most: int) -> npt.NDArray[np.uint16]:
    (width, height), tile = picture.size, picture.tile[0]
    count = width * height * 3
    file.seek(tile.offset)
    if tile.codec_name == "ppm_plain":
        words = re.sub(rb"#[^\r\n]*", b"", file.read()).split()[:count]
        numbers = np.array(words, "S6").astype(np.int64)
    else:
        data = file.read(2 * count)
        numbers = np.frombuffer(data, ">u2", len(data) // 2).astype(np.int64)
    if len(numbers) < count:
        raise ValueError("it is truncated")
    if numbers.min() < 0 or numbers.max() > most:
        raise ValueError(f"it has numbers above {most}, which it says is the largest")
    return ((numbers * 131070 + most) // (2 * most)).astype(np.uint16).reshape(height, width, 3)


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
        deep = picture.mode.startswith("I") or is_deep_raster(picture)
        if picture.mode.startswith("I"):
            pixels: npt.NDArray[Any] = np.repeat(raster_words(picture), 3, axis=2)
        elif deep:
            pixels = raster_colors(file, picture)[..., :3]
        else:
            pixels = np.asarray(picture.convert("RGB"))
    largest = 65535 if deep else 255
    linear: npt.NDArray[np.float32] = srgb_decode(np.arange(largest + 1) / largest).astype(np.float32)[pixels]
    return linear
