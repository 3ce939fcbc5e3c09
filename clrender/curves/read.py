"""Reads strands from the file that a scene names, by its ending."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.curves.data import POINT_LIMIT, CurveData
from clrender.errors import SceneError
from clrender.files.named import read_named_file
from clrender.files.npy import read_npy_header, read_npy_items
from clrender.wording import counted

__all__ = ["COLUMNS", "CURVE_ENDINGS", "curves_of_array", "read_curves"]

CURVE_ENDINGS: Final = (".npy", ".txt")
COLUMNS: Final = (3, 4, 7)
"""Numbers of a control point: its place, its radius, and where a ribbon faces."""
_FILE_LIMIT: Final = 2**32
_ALLOWED: Final = re.compile(rb"[^0-9eE+\-. \t\r\n]")


def read_curves(
    name: str, base_folder: Path, allow_paths: Sequence[Path], place: str, ending: str | None = None
) -> CurveData:
    """Read strands named by a scene.

    Parameters
    ----------
    name, base_folder, allow_paths
        See `clrender.files.named.allowed_file`.
    place : str
        Location of the name in the scene, for error messages.
    ending : str, optional
        ``.npy`` or ``.txt``: what the file is, whatever its name ends with.

    Raises
    ------
    SceneError
        If it may not be read, or holds no strands.
    """
    readers = {".npy": _numpy, ".txt": _text}
    return read_named_file(name, base_folder, allow_paths, place, readers, "curves", _FILE_LIMIT, ending)


def _numpy(file: BinaryIO, label: str) -> CurveData:
    header = read_npy_header(file)
    if len(header.shape) not in (2, 3) or header.shape[-1] not in COLUMNS or header.kind.kind not in "fiu":
        raise SceneError(f"{label} holds {header}, but must hold numbers of the shape (points, 3, 4 or 7)")
    if np.prod(header.shape[:-1], dtype=np.float64) > 2 * POINT_LIMIT:
        raise SceneError(f"{label} has more than {counted(POINT_LIMIT, 'control point')}, which is the most; divide it")
    return curves_of_array(read_npy_items(file, header), label)


def curves_of_array(array: NDArray[Any], label: str) -> CurveData:
    """Strands of an array.

    Parameters
    ----------
    array : (strands, points, 3, 4 or 7) or (points, 3, 4 or 7) real
        Of the latter, rows of which a number is not a number part two strands.
    label : str
        Beginning of error messages.

    Raises
    ------
    SceneError
        The shape or a number is not allowed.
    """
    if array.ndim not in (2, 3) or array.shape[-1] not in COLUMNS or array.dtype.kind not in "fiu":
        text = f"holds {str(array.dtype)[:20]} {str(array.shape)[:60]}, but must hold numbers (points, 3, 4 or 7)"
        raise SceneError(f"{label} {text}")
    if array.ndim == 3:
        rows = array.reshape(-1, array.shape[-1])
        return CurveData.checked(rows, np.full(len(array), array.shape[1], np.int64), label)
    with np.errstate(invalid="ignore"):  # what is not a number parts strands, or is refused
        parts: NDArray[np.bool_] = np.asarray(np.isnan(array.astype(np.float64, copy=False)).all(axis=1))
    return CurveData.checked(array[~parts], _run_lengths(parts), label)


def _run_lengths(parts: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Lengths of the runs of rows between those that part them."""
    ends = np.flatnonzero(np.concatenate([[True], parts, [True]]))
    lengths = np.diff(ends) - 1
    return np.asarray(lengths[lengths > 0], np.int64)


def _text(file: BinaryIO, label: str) -> CurveData:
    """Lines of `x y z radius`, as Mitsuba 3 reads them; empty lines part the strands."""
    text = file.read()
    if (wrong := _ALLOWED.search(text)) is not None:
        line = text.count(b"\n", 0, wrong.start()) + 1
        raise ValueError(f"line {line} has {wrong.group()!r}; lines are of the numbers x y z radius")
    lines = text.split(b"\n")
    words = np.fromiter((len(line.split()) for line in lines), np.int64, len(lines))
    sizes = np.unique(words[words > 0]).tolist()
    if sizes not in ([3], [4], []):
        odd = int(np.flatnonzero((words > 0) & (words != (4 if 4 in sizes else 3)))[0])
        raise ValueError(
            f"line {odd + 1} has {counted(words[odd], 'number')}; each line has x y z and perhaps the radius"
        )
    if len(lines) > 2 * POINT_LIMIT:
        raise SceneError(f"{label} has more than {counted(POINT_LIMIT, 'control point')}, which is the most; divide it")
    try:
        rows = np.array(text.split(), np.float64).reshape(-1, sizes[0] if sizes else 3)
    except ValueError:
        raise ValueError("it has a word that is no number") from None
    return CurveData.checked(rows, _run_lengths(words == 0), label)
