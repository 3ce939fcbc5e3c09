"""Reads the file of measured reflectance that a scene names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from clrender.files.named import read_named_file
from clrender.measured.data import MeasuredFile

__all__ = ["MEASURED_ENDINGS", "read_measured"]

MEASURED_ENDINGS: Final = (".bsdf", ".binary")
"""Of files of the RGL and of the MERL database; which one it is of, its content says."""
_FILE_LIMIT: Final = 2**31


def read_measured(name: str, base_folder: Path, allow_paths: Sequence[Path], place: str) -> MeasuredFile:
    """Read measured reflectance named by a scene.

    Parameters
    ----------
    name, base_folder, allow_paths
        See `clrender.files.named.allowed_file`.
    place : str
        Location of the name in the scene, for error messages.

    Raises
    ------
    SceneError
        If it may not be read, or is no file of the RGL or the MERL database.
    """
    readers = dict.fromkeys(MEASURED_ENDINGS, _read)
    return read_named_file(name, base_folder, allow_paths, place, readers, "measured reflectance", _FILE_LIMIT)


def _read(file: BinaryIO, label: str) -> MeasuredFile:
    return MeasuredFile.checked(np.frombuffer(file.read(), np.uint8), label)
