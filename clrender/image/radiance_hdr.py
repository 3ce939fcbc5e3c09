"""Radiance `.hdr` images (RGBE): three 8-bit mantissas that share an exponent.

Format: G. Ward, "Real Pixels", Graphics Gems II (1991), and "The RADIANCE Picture File Format" of the Radiance manual.
"""

from __future__ import annotations

import re
from typing import IO, Final

import numpy as np
import numpy.typing as npt

from clrender.exact.matrices import times
from clrender.image.colorimetry import rec_709_matrix
from clrender.image.display import PIXEL_LIMIT, check_size

__all__ = ["hdr_size", "read_hdr", "write_hdr"]

_HEADER_LIMIT: Final = 1 << 16
_ROWS: Final = 64  # written at a time


def write_hdr(file: IO[bytes], image: npt.NDArray[np.float32]) -> None:
    """Write an image, not run-length encoded.

    Parameters
    ----------
    file : binary file
    image : (H, W, 3) float32
        Linear Rec. 709; negative and NaN values are written as 0, values above the format's range (about 1.7e38) as its
        largest.
    """
    height, width, _ = image.shape
    file.write(b"#?RADIANCE\nSOFTWARE=clrender\nFORMAT=32-bit_rle_rgbe\n\n")
    file.write(f"-Y {height} +X {width}\n".encode())
    for top in range(0, height, _ROWS):
        file.write(_encode(image[top : top + _ROWS]).tobytes())


def read_hdr(file: IO[bytes], most: int = PIXEL_LIMIT) -> npt.NDArray[np.float32]:
    """Read an image, flat or run-length encoded, in any of the format's eight pixel orders, of `most` pixels at most.

    Returns
    -------
    (H, W, 3) float32
        Linear Rec. 709, as radiance: each channel is (mantissa + 1/2) 2^(exponent - 136), or 0 where the exponent is 0,
        divided by the factors `EXPOSURE` and `COLORCORR`; other `PRIMARIES` are converted.

    Raises
    ------
    ValueError, EOFError
        It is not such an image, or truncated.
    """
    scale, matrix, size = _read_start(file)
    lines, length = int(size[2]), int(size[4])
    check_size(length, lines, most)
    data = file.read(8 * lines * length + _HEADER_LIMIT)  # no valid file is longer
    # Lines are collected as they are read: a short file cannot request the memory of a large image.
    encoded, at = [], 0
    for _ in range(lines):
        line, at = _read_line(data, at, length)
        encoded.append(line)
    return _oriented(_decoded(encoded, length, scale, matrix), size[1].decode(), size[3].decode())


def hdr_size(file: IO[bytes]) -> tuple[int, int]:
    """Width and height of the result of `read_hdr`, from the header alone.

    Raises
    ------
    ValueError
        The header is damaged.
    """
    size = _read_start(file)[2]
    lines, length = int(size[2]), int(size[4])
    return (length, lines) if size[1].endswith(b"Y") else (lines, length)


def _read_start(
    file: IO[bytes],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64] | None, re.Match[bytes]]:
    """The result of `_read_header`, and the match of the resolution line."""
    if not file.readline(_HEADER_LIMIT).startswith(b"#?"):
        raise ValueError("it does not begin with #?RADIANCE")
    scale, matrix = _read_header(file)
    size = re.fullmatch(rb"([-+][XY]) (\d{1,9}) ([-+][XY]) (\d{1,9})\s*", file.readline(_HEADER_LIMIT))
    if size is None or size[1][1:] == size[3][1:]:
        raise ValueError("its size is not given as -Y height +X width")
    check_size(int(size[4]), int(size[2]))
    return scale, matrix, size


def _read_header(file: IO[bytes]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64] | None]:
    """Factors of R, G and B, and then the matrix to Rec. 709, if any."""
    divisor = np.ones(3)
    matrix = None
    taken = 0
    for line in iter(lambda: file.readline(_HEADER_LIMIT), b""):
        taken += len(line)
        if taken > _HEADER_LIMIT:
            raise ValueError("its header does not end")
        if not line.strip():
            break
        # Lines that begin with a blank are about images that this one was made from.
        name, _, value = line.decode("latin-1").partition("=")
        if name == "FORMAT" and value.strip() != "32-bit_rle_rgbe":
            raise ValueError(f"its format is {value.strip()[:40]}, not 32-bit_rle_rgbe; convert it to RGB")
        if name in ("EXPOSURE", "COLORCORR"):
            divisor = divisor * _numbers(name, value, 1 if name == "EXPOSURE" else 3)
            if not ((divisor > 1e-30) & (divisor < 1e30)).all():
                raise ValueError(f"its {name} is {value.strip()[:40]}, by which no radiance was ever multiplied")
        elif name == "PRIMARIES":
            primaries = _numbers(name, value, 8)
            matrix = rec_709_matrix(primaries.tolist()) if primaries.any() else None
    return 1.0 / divisor, matrix


def _numbers(name: str, value: str, count: int) -> npt.NDArray[np.float64]:
    words = value.split()
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(f"its {name} is {value.strip()[:40]!r}, not {count} number{'s' if count > 1 else ''}")
    return numbers


def _encode(values: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    positive = np.nan_to_num(np.maximum(values, 0).astype(np.float64), nan=0.0, posinf=2.0**127)
    positive = np.minimum(positive, 255.0 / 256.0 * 2.0**127)
    largest = positive.max(axis=-1)
    exponent = np.frexp(largest)[1]
    exponent = np.where(largest >= 2.0**-128, exponent, -128)
    rgbe = np.empty((*values.shape[:-1], 4), np.uint8)
    # Truncate, do not round: a reader adds one half.
    rgbe[..., :3] = np.floor(np.ldexp(positive, (8 - exponent)[..., None])) * (exponent > -128)[..., None]
    rgbe[..., 3] = exponent + 128
    return rgbe


def _decoded(
    lines: list[npt.NDArray[np.uint8]],
    length: int,
    scale: npt.NDArray[np.float64],
    matrix: npt.NDArray[np.float64] | None,
) -> npt.NDArray[np.float32]:
    """Decode lines of (length, 4) uint8; each line is freed once decoded."""
    image = np.empty((len(lines), length, 3), np.float32)
    lines.reverse()
    for row in image:
        rgbe = lines.pop()
        exponent = rgbe[:, 3:].astype(np.int32)
        values = np.where(exponent > 0, np.ldexp(rgbe[:, :3] + 0.5, exponent - 136), 0.0) * scale
        with np.errstate(over="ignore"):
            row[:] = values if matrix is None else times(matrix, values)
    return image


def _oriented(image: npt.NDArray[np.float32], outer: str, inner: str) -> npt.NDArray[np.float32]:
    """Reorder the file's lines to rows from top to bottom; a file may begin in any corner, with rows or columns."""
    image = image[::-1] if outer in ("+Y", "-X") else image
    image = image[:, ::-1] if inner in ("+Y", "-X") else image
    return np.ascontiguousarray(image if outer[1] == "Y" else image.transpose(1, 0, 2))


def _read_line(data: bytes, at: int, length: int) -> tuple[npt.NDArray[np.uint8], int]:
    """One line, and the offset of the next."""
    start = data[at : at + 4]
    if not (8 <= length < 32768 and start[:2] == b"\2\2" and start[2:3] < b"\x80"):
        return _read_flat_line(data, at, length)
    if len(start) < 4 or start[2] << 8 | start[3] != length:
        raise ValueError("a line is not as long as the picture's")
    at += 4
    planes = np.empty((4, length), np.uint8)
    for plane in planes:
        x = 0
        while x < length:
            if at >= len(data):
                raise EOFError("the file ends too early")
            count = data[at]
            if count > 128:
                count -= 128
                some, at = data[at + 1 : at + 2] * count, at + 2
            else:
                some, at = data[at + 1 : at + 1 + count], at + 1 + count
            if count == 0 or x + count > length:
                raise ValueError("a run is longer than its line")
            if len(some) != count:
                raise EOFError("the file ends too early")
            plane[x : x + count] = np.frombuffer(some, np.uint8)
            x += count
    return np.ascontiguousarray(planes.T), at


def _read_flat_line(data: bytes, at: int, length: int) -> tuple[npt.NDArray[np.uint8], int]:
    """A line of whole pixels; in the encoding before 1991, a pixel 1, 1, 1, n repeats the previous one n times."""
    some = np.frombuffer(data[at : at + 4 * length], np.uint8)
    some = some[: len(some) // 4 * 4].reshape(-1, 4)
    if len(some) == length and not (some[:, :3] == 1).all(axis=1).any():
        return some, at + 4 * length
    line = np.empty((length, 4), np.uint8)
    x = shift = 0
    while x < length:
        pixel = data[at : at + 4]
        if len(pixel) < 4:
            raise EOFError("the file ends too early")
        at += 4
        if pixel[:3] == b"\1\1\1":
            count = pixel[3] << shift
            if x == 0 or x + count > length:
                raise ValueError("a run is longer than its line")
            line[x : x + count] = line[x - 1]
            x, shift = x + count, min(shift + 8, 32)
        else:
            line[x] = np.frombuffer(pixel, np.uint8)
            x, shift = x + 1, 0
    return line, at
