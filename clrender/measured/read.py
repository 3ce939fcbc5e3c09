"""Reads the file of measured reflectance that a scene names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from clrender.errors import SceneError
from clrender.files.named import allowed_file, open_named_file
from clrender.measured.data import MeasuredFile
from clrender.wording import quoted

__all__ = ["MEASURED_ENDINGS", "read_measured"]

MEASURED_ENDINGS: Final = (".bsdf", ".binary")
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
    label = f"{place}: {quoted(name)}"
    if Path(name).suffix.lower() not in MEASURED_ENDINGS:
        allowed_file(name, base_folder, allow_paths, label)
        kinds = " (RGL) or ".join(MEASURED_ENDINGS) + " (MERL)"
        raise SceneError(f"{label} is of no kind that can be read; measured reflectance may be {kinds}")
    file, size = open_named_file(name, base_folder, allow_paths, label, _FILE_LIMIT)
    with file:
        try:
            data = file.read(size + 1)
        except OSError as error:
            raise SceneError(f"{label} cannot be read: {error.strerror or error}") from None
    return MeasuredFile.checked(np.frombuffer(data, np.uint8), label)
