"""Files of Mitsuba 0.6's shape `hair`: the points of strands, as lines of text or as floats."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.curves.data import POINT_LIMIT, CurveData
from clrender.errors import SceneError
from clrender.files.named import read_named_file
from clrender.wording import counted

__all__ = ["read_mitsuba_hair"]

_BINARY: Final = b"BINARY_HAIR"
_FILE_LIMIT: Final = 2**32
_TOO_MANY: Final = f"has more than {counted(POINT_LIMIT, 'point')}, which is the most; divide it"


def read_mitsuba_hair(name: str, base_folder: Path, allow_paths: Sequence[Path], place: str) -> CurveData:
    """Read strands, of which the file has no radii. Those of a single point are left out: they have no segment.

    Parameters
    ----------
    name, base_folder, allow_paths
        See `clrender.files.named.allowed_file`.
    place : str
        Location of the name in the scene, for error messages.

    Raises
    ------
    SceneError
        If it may not be read, or holds no strands.
    """
    ending = ".hair"  # they may be named anything
    return read_named_file(name, base_folder, allow_paths, place, {ending: _hair}, "hair", _FILE_LIMIT, ending)


def _hair(file: BinaryIO, label: str) -> CurveData:
    binary = file.read(len(_BINARY)) == _BINARY
    if not binary:
        file.seek(0)
    points, begins = (_floats if binary else _lines)(file, label)
    starts = np.flatnonzero(begins)
    counts = np.diff(np.append(starts, len(points)))
    kept = np.repeat(counts > 1, counts)
    return CurveData.checked(points[kept], counts[counts > 1], label)


def _floats(file: BinaryIO, label: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Points, and whether each begins a strand: an infinite number stands before it then."""
    head = file.read(4)
    if len(head) < 4:
        raise ValueError("it ends too early")
    (count,) = struct.unpack("<I", head)
    if count > POINT_LIMIT:
        raise SceneError(f"{label} {_TOO_MANY}")
    data = file.read(16 * count)
    numbers = np.frombuffer(data, "<f4", len(data) // 4)
    parts = np.isinf(numbers)
    before = np.flatnonzero(parts) - np.arange(np.count_nonzero(parts))  # coordinates before each infinite number
    if (before % 3).any():
        raise ValueError("a strand begins within a point")
    coordinates = numbers[~parts]
    if len(coordinates) < 3 * count:
        raise ValueError("it ends too early")
    begins = np.zeros(count, np.bool_)
    begins[:1] = True
    begins[before[before < 3 * count] // 3] = True
    with np.errstate(invalid="ignore"):  # what is not a number is refused later
        points = coordinates[: 3 * count].reshape(-1, 3).astype(np.float64)
    return points, begins


def _lines(file: BinaryIO, label: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Points, and whether each begins a strand: an empty line, or one of a comment, stands before it then."""
    points: list[tuple[float, float, float]] = []
    begins: list[bool] = []
    new = True
    for number, line in enumerate(file, 1):
        words = line.split()
        if not words or words[0].startswith(b"#"):
            new = True
            continue
        try:
            x, y, z = map(float, words[:3])
        except ValueError:
            raise ValueError(f"line {number} does not begin with the three numbers of a point") from None
        points.append((x, y, z))
        begins.append(new)
        new = False
        if len(points) > POINT_LIMIT:
            raise SceneError(f"{label} {_TOO_MANY}")
    return np.array(points, np.float64).reshape(-1, 3), np.array(begins, np.bool_)
