"""Reads OpenEXR files with the OpenEXR library; adds the checks that it lacks, and silences its output."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.exact.matrices import times
from clrender.image.colorimetry import rec_709_matrix
from clrender.image.display import PIXEL_LIMIT, check_size
from clrender.wording import counted

__all__ = ["exr_alpha", "exr_attribute", "exr_size", "read_exr"]

_Image = npt.NDArray[np.float32]
_RATIOS: Final[Mapping[str, int]] = {"NO": 1, "RLE": 64, "ZIPS": 1032, "ZIP": 1032, "PXR24": 1400, "PIZ": 512}
_RATIO: Final = 1 << 15
"""Largest compression ratio: a smaller file cannot contain the image that its header declares."""
_ROWS: Final = 256
_redirecting = threading.Lock()


def exr_attribute(file: IO[bytes], name: str) -> str | None:
    """A text of the header, or None if it has none of that name."""
    with _quiet():
        found = _openexr().File(file, header_only=True).header().get(name)
    return None if found is None else str(found)


def exr_size(file: IO[bytes], most: int = PIXEL_LIMIT) -> tuple[int, int]:
    """Width and height of the result of `read_exr`, from the header alone; `most` pixels at most.

    Raises
    ------
    ValueError, RuntimeError
        The header is damaged, or declares more than the file can contain.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    with _quiet():
        headers = [dict(part.header) for part in _openexr().File(file, header_only=True).parts]
    part, _ = _colour_part(headers)
    _check_sizes(headers, size, most)
    return _window(headers[part]["displayWindow"])[2:]


def read_exr(file: IO[bytes], most: int = PIXEL_LIMIT) -> _Image:
    """The image of a file: its display window, black outside the data window, in linear Rec. 709.

    It has `most` pixels at most. In a file of several parts, only one may have colours. A luminance channel alone
    becomes grey. Other primaries are converted, with their white adapted to D65 (`clrender.image.colorimetry`).

    Returns
    -------
    (H, W, 3) float32

    Raises
    ------
    ValueError, RuntimeError
        The file is damaged, too large, or contains no such image.
    """
    image = _planes(file, most)
    assert image is not None
    return image


def exr_alpha(file: IO[bytes], most: int = PIXEL_LIMIT) -> npt.NDArray[np.float32] | None:
    """The coverage beside the image that `read_exr` reads, (H, W) float32 from 0 to 1; None if there is none.

    Raises
    ------
    ValueError, RuntimeError
        See `read_exr`.
    """
    found = _planes(file, most, ("A",))
    return None if found is None else np.clip(np.nan_to_num(found[..., 0], nan=0.0), 0.0, 1.0)


def _planes(file: IO[bytes], most: int, wanted: Sequence[str] = ()) -> _Image | None:
    """Channels of the part with the image, its colours unless others are wanted; None if one is not there."""
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    library = _openexr()
    with _quiet():
        headers = [dict(part.header) for part in library.File(file, header_only=True).parts]
    part, names = _colour_part(headers)
    _check_sizes(headers, size, most)
    file.seek(0)
    with _quiet(), library.File(file, separate_channels=True) as picture:
        if len(picture.parts) != len(headers):
            raise ValueError("it is truncated or damaged")
        channels = picture.parts[part].channels
        if not {*wanted} <= {*channels}:
            return None
        planes = [np.asarray(channels[name].pixels) for name in wanted or names]
        return _displayed(planes, headers[part])


def _colour_part(headers: list[dict[str, Any]]) -> tuple[int, tuple[str, str, str]]:
    """Index of the part with the image, and its channels."""
    names = [{channel.name: channel for channel in header["channels"]} for header in headers]
    for wanted in (("R", "G", "B"), ("Y", "Y", "Y")):
        found = [i for i, channels in enumerate(names) if set(wanted) <= set(channels)]
        if len(found) > 1:
            parts = ", ".join(str(headers[i].get("name", i)) for i in found[:8])
            raise ValueError(
                f"it holds {counted(len(found), 'image')}, the parts {parts}: export the one that is meant"
            )
        if found:
            channels = names[found[0]]
            if {"RY", "BY"} & set(channels) or any(
                (channels[n].xSampling, channels[n].ySampling) != (1, 1) for n in wanted
            ):
                raise ValueError("its colours are subsampled (luminance and chroma): export it as R, G, B")
            if "deep" in str(headers[found[0]].get("type")):
                raise ValueError("it is a deep image, with many values a pixel: flatten it")
            return found[0], wanted
    every = sorted({name for channels in names for name in channels})
    raise ValueError(f"its channels are {', '.join(every[:12]) or 'none'}, not R, G, B")


def _check_sizes(headers: list[dict[str, Any]], size: int, most_pixels: int) -> None:
    """Refuse windows that are too large, or too large for the file's size, before memory is allocated."""
    for header in headers:
        pixels = []
        for window in ("displayWindow", "dataWindow"):
            width, height = _window(header[window])[2:]
            check_size(width, height, most_pixels)
            pixels.append(width * height)
        compression = str(header["compression"]).split(".")[-1].split("_COMPRESSION")[0]
        most = 2 * size * _RATIOS.get(compression, _RATIO) + 4096
        if 4 * len(header["channels"]) * pixels[1] > most or pixels[0] > max(64 * pixels[1], 1 << 20):
            raise ValueError("it is truncated or damaged: it is too small for the size its header gives")


def _window(window: Any) -> tuple[int, int, int, int]:
    """Left, top, width, height."""
    (left, top), (right, bottom) = ([int(x) for x in corner] for corner in window)
    return left, top, right - left + 1, bottom - top + 1


def _displayed(planes: list[npt.NDArray[Any]], header: dict[str, Any]) -> _Image:
    """The display window of an image whose planes (R, G, B, or one alone) cover the data window."""
    left, top, width, height = _window(header["displayWindow"])
    x, y, columns, rows = _window(header["dataWindow"])
    if any(plane.shape != (rows, columns) for plane in planes):
        raise ValueError("it is damaged: its channels are not as large as its data window")
    image = np.zeros((height, width, len(planes)), np.float32)
    across = slice(max(left, x) - left, max(min(left + width, x + columns) - left, 0))
    down = slice(max(top, y) - top, max(min(top + height, y + rows) - top, 0))
    if across.start < across.stop and down.start < down.stop:
        inside = np.s_[down.start + top - y : down.stop + top - y, across.start + left - x : across.stop + left - x]
        for channel, plane in enumerate(planes):
            image[down, across, channel] = plane[inside]
    matrix = rec_709_matrix(header["chromaticities"]) if "chromaticities" in header and len(planes) == 3 else None
    if matrix is not None:
        for first in range(0, height, _ROWS):
            image[first : first + _ROWS] = times(matrix, image[first : first + _ROWS])
    return image


def _openexr() -> Any:
    """The OpenEXR library, which has no type hints and is only loaded for `.exr` files."""
    return importlib.import_module("OpenEXR")


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Hide what the library prints, and raise an error if it writes to standard error.

    Its C++ part writes to file descriptor 2, for some damaged files without any other error; its Python part prints.
    Neither can be turned off.
    """
    with _redirecting, contextlib.redirect_stdout(io.StringIO()), tempfile.TemporaryFile() as heard:
        if sys.stderr is None:  # the program has no standard error, and file descriptor 2 may be another file
            yield
            return
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.flush()
        before = os.dup(2)
        try:
            os.dup2(heard.fileno(), 2)
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)
        heard.seek(0)
        words = heard.read(4096).decode("utf-8", "replace").strip()
        if words:
            raise ValueError(f"it is truncated or damaged: {words.splitlines()[0].split(': ', 1)[-1][:200]}")
