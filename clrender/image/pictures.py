"""Texture images: any file format, with the numbers as stored, read in bands of rows."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.image.display import check_size, deep_pixels, is_deep, open_display
from clrender.image.raster import (
    RASTER_ENDINGS,
    is_deep_raster,
    open_raster,
    raster_colors,
    raster_floats,
    raster_words,
)
from clrender.wording import grouped

__all__ = ["CODED_ENDINGS", "PICTURE_ENDINGS", "PICTURE_LIMIT", "Picture", "open_picture", "picture_room"]

PICTURE_ENDINGS: Final = (".png", ".jpg", ".jpeg", ".webp", ".exr", ".hdr", ".pfm", *RASTER_ENDINGS)
CODED_ENDINGS: Final = (".png", ".jpg", ".jpeg", ".webp", *RASTER_ENDINGS)
"""Those of formats whose colours are coded in sRGB unless a scene says otherwise."""
_FLOATS: Final = (".exr", ".hdr", ".pfm")
PICTURE_LIMIT: Final = 1 << 28
"""Largest number of pixels of an image: 16384 x 16384."""
_BAND: Final = 256
_WEBP_RATIO: Final = 1 << 15
"""Upper bound of the pixels per byte of a valid WebP."""


@dataclass(frozen=True)
class Picture:
    """An image whose header has been read.

    Attributes
    ----------
    width, height : int
    channels : int
        1 (grey) or 4.
    coding : str
        ``unorm8`` or ``unorm16`` (0 to 1 in that many bits), ``half`` or ``float``.
    bands : callable
        Yields its rows from top to bottom in bands: (h, width, channels) arrays of uint8, uint16 (also for ``half``) or
        float32; all but the last have `_BAND` rows.
    """

    width: int
    height: int
    channels: int
    coding: str
    bands: Callable[[], Iterator[npt.NDArray[Any]]]


def picture_room(file: IO[bytes], ending: str) -> tuple[int, int, int]:
    """Width, height and an upper bound of the bytes per texel of an image, from its header alone.

    Parameters
    ----------
    file, ending
        See `open_picture`.

    Raises
    ------
    ValueError, or whatever a library raises
        The file is damaged, or too large.
    """
    if ending in _FLOATS:
        width, height = _size_of_floats(file, ending)
        _check(width, height)
        return width, height, 16
    raster = open_raster(file, PICTURE_LIMIT)
    if raster is not None:
        return *raster.size, 16 if raster.mode.startswith("F") else 8 if is_deep_raster(raster) else 4
    picture = open_picture(file, ending)
    return picture.width, picture.height, picture.channels * (1 if picture.coding == "unorm8" else 2)


def _size_of_floats(file: IO[bytes], ending: str) -> tuple[int, int]:
    if ending == ".exr":
        from clrender.image.exr import exr_size

        return exr_size(file)
    if ending == ".pfm":
        from clrender.image.pfm import pfm_size

        return pfm_size(file)
    from clrender.image.radiance_hdr import hdr_size

    return hdr_size(file)


def open_picture(file: IO[bytes], ending: str) -> Picture:
    """Read the header of an image; of floats all of it.

    Parameters
    ----------
    file : binary file
        Must stay open until the bands are read.
    ending : str
        One of `PICTURE_ENDINGS`; among those of `CODED_ENDINGS` the content decides.

    Raises
    ------
    ValueError, or whatever a library raises
        The file is damaged, or too large.
    """
    if ending == ".exr":
        from clrender.image.exr import exr_alpha, read_exr

        image = read_exr(file)
        return _of_floats(image, exr_alpha(file))
    if ending == ".hdr":
        from clrender.image.radiance_hdr import read_hdr

        return _of_floats(read_hdr(file))
    if ending == ".pfm":
        from clrender.image.pfm import read_pfm

        return _of_floats(read_pfm(file, PICTURE_LIMIT))
    start = file.read(16)
    file.seek(0)
    raster = open_raster(file, PICTURE_LIMIT)
    webp = start[:4] == b"RIFF" and start[8:12] == b"WEBP"
    picture = raster or (_open_webp(file) if webp else open_display(file))
    width, height = picture.size
    _check(width, height)
    if raster is not None and raster.mode.startswith("F"):
        return _of_floats(raster_floats(raster))
    if raster is not None and raster.mode.startswith("I"):

        def words() -> Iterator[npt.NDArray[Any]]:
            pixels = raster_words(raster)
            for top in range(0, height, _BAND):
                yield pixels[top : top + _BAND]

        return Picture(width, height, 1, "unorm16", words)
    if raster is not None and is_deep_raster(raster):

        def deep_colors() -> Iterator[npt.NDArray[Any]]:
            pixels = raster_colors(file, raster)
            for top in range(0, height, _BAND):
                yield _padded(pixels[top : top + _BAND], 65535)

        return Picture(width, height, 4, "unorm16", deep_colors)
    if raster is None and is_deep(picture):
        grey = picture.mode.startswith("I") and "transparency" not in picture.info

        def deep() -> Iterator[npt.NDArray[Any]]:
            pixels = deep_pixels(file, picture)
            for top in range(0, height, _BAND):
                yield _padded(pixels[top : top + _BAND], 65535)

        return Picture(width, height, 1 if grey else 4, "unorm16", deep)
    grey = picture.mode in ("1", "L") and "transparency" not in picture.info

    def bands() -> Iterator[npt.NDArray[Any]]:
        picture.load()
        mode = "L" if grey else "RGBA"
        for top in range(0, height, _BAND):
            band = picture.crop((0, top, width, min(top + _BAND, height)))
            if not grey and band.mode not in ("RGB", "RGBA", "P", "LA", "PA", "L"):
                band = band.convert("RGB")  # CMYK and the like cannot be converted to RGBA directly
            pixels = np.asarray(band if band.mode == mode else band.convert(mode))
            yield pixels[..., None] if grey else pixels

    return Picture(width, height, 1 if grey else 4, "unorm8", bands)


def _check(width: int, height: int) -> None:
    check_size(width, height)
    if width * height > PICTURE_LIMIT:
        raise ValueError(f"it has {width} x {height} pixels, but at most {grouped(PICTURE_LIMIT)} are read")


def _open_webp(file: IO[bytes]) -> Any:
    """Open a WebP; its decoder reads only the header until pixels are requested."""
    from PIL.WebPImagePlugin import WebPImageFile

    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    picture = WebPImageFile(file)
    if picture.width * picture.height > _WEBP_RATIO * size:
        raise ValueError("it is truncated: it is too small for the size its header gives")
    return picture


def _of_floats(image: npt.NDArray[np.float32], alpha: npt.NDArray[np.float32] | None = None) -> Picture:
    """An image of floats, in half precision if that is lossless, and as one channel if all three are equal.

    With an alpha that is not 1 everywhere, it has four channels.
    """
    height, width, _ = image.shape
    _check(width, height)
    alpha = None if alpha is None or bool((alpha == 1.0).all()) else alpha
    grey, half = alpha is None, True
    for top in range(0, height, _BAND):
        band = image[top : top + _BAND]
        finite = np.isfinite(band).all(axis=2)
        if not finite.all():
            y, x = np.argwhere(~finite)[0]
            raise ValueError(f"its pixel ({x}, {top + y}) is no finite number")
        grey = grey and bool((band == band[..., :1]).all())
        with np.errstate(over="ignore"):
            half = half and bool((band.astype(np.float16) == band).all())
            if alpha is not None:
                covers = alpha[top : top + _BAND]
                half = half and bool((covers.astype(np.float16) == covers).all())

    def bands() -> Iterator[npt.NDArray[Any]]:
        for top in range(0, height, _BAND):
            rows = image[top : top + _BAND, :, : 1 if grey else 3]
            if alpha is not None:
                rows = np.concatenate([rows, alpha[top : top + _BAND, :, None]], axis=2)
            yield _padded(rows.astype(np.float16).view(np.uint16) if half else rows, 0x3C00 if half else 1)

    return Picture(width, height, 1 if grey else 4, "half" if half else "float", bands)


def _padded(rows: npt.NDArray[Any], opaque: int) -> npt.NDArray[Any]:
    """Rows with an opaque alpha channel added, if they have colours without one."""
    if rows.shape[2] != 3:
        return rows
    whole = np.empty((*rows.shape[:2], 4), rows.dtype)
    whole[..., :3], whole[..., 3] = rows, opaque
    return whole
