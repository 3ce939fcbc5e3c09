"""Reads a grid from the file that a scene names, by its ending."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO, Final

from clrender.errors import SceneError
from clrender.files.named import open_named_file, read_named_file
from clrender.files.npy import read_npy_header, read_npy_items
from clrender.grids.data import VALUE_LIMIT, GridData
from clrender.grids.nanovdb import nanovdb_names, read_nanovdb
from clrender.grids.openvdb import read_openvdb, vdb_names
from clrender.grids.vol import read_vol
from clrender.wording import counted, grouped, quoted

__all__ = ["SPARSE_ENDINGS", "grid_names", "read_grid"]

SPARSE_ENDINGS: Final = (".nvdb", ".vdb")
"""Of files that may have several grids, each with a name."""
_FILE_LIMIT: Final = 2**33


def read_grid(
    name: str, base_folder: Path, allow_paths: Sequence[Path], place: str, within: str = "density"
) -> GridData:
    """Read a grid named by a scene.

    Parameters
    ----------
    name, base_folder, allow_paths
        See `clrender.files.named.allowed_file`.
    place : str
        Location of the name in the scene, for error messages.
    within : str
        Of an ``.nvdb`` or ``.vdb`` file, the name of the grid.

    Raises
    ------
    SceneError
        If it may not be read, or is no grid of numbers that are not below 0.
    """
    readers: dict[str, Callable[[BinaryIO, str], GridData]] = {
        ".npy": _numpy,
        ".vol": read_vol,
        ".nvdb": partial(read_nanovdb, name=within),
        ".vdb": partial(read_openvdb, name=within),
    }
    return read_named_file(name, base_folder, allow_paths, place, readers, "grids", _FILE_LIMIT)


def grid_names(name: str, base_folder: Path, allow_paths: Sequence[Path], place: str) -> tuple[str, ...]:
    """Names of the grids in a ``.nvdb`` or ``.vdb`` file; of others, and of unreadable ones, none. See `read_grid`."""
    label, ending = f"{place}: {quoted(name)}", Path(name).suffix.lower()
    if ending not in SPARSE_ENDINGS:
        return ()
    file, _ = open_named_file(name, base_folder, allow_paths, label, _FILE_LIMIT)
    with file:
        try:
            return nanovdb_names(file) if ending == ".nvdb" else vdb_names(file)
        except (OSError, ValueError):
            return ()


def _numpy(file: BinaryIO, label: str) -> GridData:
    header = read_npy_header(file)
    colors = len(header.shape) == 4 and header.shape[3] == 3
    if not (len(header.shape) == 3 or colors) or header.kind.kind not in "fiub":
        raise SceneError(f"{label} holds {header}, but must hold numbers of the shape (nz, ny, nx), or (nz, ny, nx, 3)")
    count = math.prod(header.shape)
    if count > VALUE_LIMIT:
        raise SceneError(
            f"{label} has {counted(count, 'number')}; at most {grouped(VALUE_LIMIT)} are possible; make the grid "
            "coarser"
        )
    return GridData.checked(read_npy_items(file, header), label)
