"""Radiance `.hdr` pictures (RGBE): three 8-bit mantissas that share an exponent.

Format: G. Ward, "Real Pixels", Graphics Gems II (1991), and the Radiance reference manual.
"""

from __future__ import annotations

import re
from typing import IO, Final

import numpy as np
import numpy.typing as npt

__all__ = ["read_hdr", "write_hdr"]

_HEADER_LIMIT: Final = 1 << 16
_SIDE_LIMIT: Final = 1 << 16
_ROWS: Final = 64  # written at a time


def write_hdr(file: IO[bytes], image: npt.NDArray[np.float32]) -> None:
    """Write a picture, not run-length encoded.

    Parameters
    ----------
    file : binary file
    image : (H, W, 3) float32
        Linear Rec. 709; negative and not-a-number values are written as 0, what is above the format's range
        (about 1.7e38) as its largest.
    """
    height, width, _ = image.shape
    file.write(b"#?RADIANCE\nSOFTWARE=clrender\nFORMAT=32-bit_rle_rgbe\n\n")
    file.write(f"-Y {height} +X {width}\n".encode())
    for top in range(0, height, _ROWS):
        file.write(_encode(image[top : top + _ROWS]).tobytes())


def read_hdr(file: IO[bytes]) -> npt.NDArray[np.float32]:
    """Read a picture, flat or run-length encoded, rows from top to bottom.

    Returns
    -------
    (H, W, 3) float32
        Each channel is (mantissa + 1/2) 2^(exponent - 136), or 0 where the exponent is 0.

    Raises
    ------
    ValueError, EOFError
        Not such a picture, or only a part of one.
    """
    magic = file.readline(_HEADER_LIMIT)
    if not magic.startswith(b"#?"):
        raise ValueError("it does not begin with #?RADIANCE")
    taken = len(magic)
    for line in iter(lambda: file.readline(_HEADER_LIMIT), b""):
        taken += len(line)
        if taken > _HEADER_LIMIT:
            raise ValueError("its header does not end")
        if not line.strip():
            break
        if line.startswith(b"FORMAT=") and line.strip() != b"FORMAT=32-bit_rle_rgbe":
            raise ValueError(f"its format is {line.strip()[7:].decode(errors='replace')}, not 32-bit_rle_rgbe")
    size = re.fullmatch(rb"-Y (\d{1,9}) \+X (\d{1,9})\s*", file.readline(_HEADER_LIMIT))
    if size is None:
        raise ValueError("its size is not given as -Y height +X width")
    height, width = int(size[1]), int(size[2])
    if not (0 < height <= _SIDE_LIMIT and 0 < width <= _SIDE_LIMIT):
        raise ValueError(f"{width} x {height} pixels are not between 1 and {_SIDE_LIMIT} a side")
    # Rows are gathered as they come: a short file cannot ask for a large picture's memory.
    rows = [_decode(_read_row(file, width)) for _ in range(height)]
    return np.stack(rows)


def _encode(values: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    positive = np.nan_to_num(np.maximum(values, 0).astype(np.float64), nan=0.0, posinf=2.0**127)
    positive = np.minimum(positive, 255.0 / 256.0 * 2.0**127)
    largest = positive.max(axis=-1)
    exponent = np.frexp(largest)[1]
    exponent = np.where(largest >= 2.0**-128, exponent, -128)
    rgbe = np.empty((*values.shape[:-1], 4), np.uint8)
    # Cut off, not rounded: a reader adds one half.
    rgbe[..., :3] = np.floor(np.ldexp(positive, (8 - exponent)[..., None])) * (exponent > -128)[..., None]
    rgbe[..., 3] = exponent + 128
    return rgbe


def _decode(rgbe: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    exponent = rgbe[..., 3:].astype(np.int32)
    values = np.ldexp(rgbe[..., :3] + 0.5, exponent - 136)
    return np.where(exponent > 0, values, 0.0).astype(np.float32)


def _read_row(file: IO[bytes], width: int) -> npt.NDArray[np.uint8]:
    start = _take(file, 4)
    if not (8 <= width < 32768 and start[0] == 2 and start[1] == 2 and start[2] < 128):
        if start[:3] == b"\1\1\1":
            raise ValueError("it uses the run-length code of before 1991, which is not read")
        return np.frombuffer(start + _take(file, 4 * (width - 1)), np.uint8).reshape(width, 4)
    if start[2] << 8 | start[3] != width:
        raise ValueError("a row is not as wide as the picture")
    planes: npt.NDArray[np.uint8] = np.empty((4, width), np.uint8)
    for plane in planes:
        x = 0
        while x < width:
            count = _take(file, 1)[0]
            run = count > 128
            count -= 128 if run else 0
            if count == 0 or x + count > width:
                raise ValueError("a run is longer than its row")
            plane[x : x + count] = np.frombuffer(_take(file, 1 if run else count), np.uint8)
            x += count
    return np.stack(list(planes), axis=-1)


def _take(file: IO[bytes], count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        raise EOFError("the file ends too early")
    return data
