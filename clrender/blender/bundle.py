"""Packs the add-on into the file from which Blender installs it."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import IO, Final

__all__ = ["FOLDER", "NAME", "write_addon"]

FOLDER: Final = Path(__file__).with_name("addon")
NAME: Final = "clrender_blender"
"""Folder in the archive, which becomes the name of the module in Blender."""
_ENDINGS: Final = (".py", ".toml")
_DATE: Final = (1980, 1, 1, 0, 0, 0)
"""Earliest time that an archive can hold; the same for all files, so that equal files make equal archives."""
_READABLE: Final = 0o644 << 16


def write_addon(file: IO[bytes]) -> int:
    """Write the archive; gives the number of its files.

    Parameters
    ----------
    file : binary file

    Returns
    -------
    int
        Its bytes depend on the add-on's files only.
    """
    paths = sorted(path for path in FOLDER.iterdir() if path.suffix in _ENDINGS)
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for path in paths:
            entry = zipfile.ZipInfo(f"{NAME}/{path.name}", _DATE)
            entry.compress_type, entry.external_attr, entry.create_system = zipfile.ZIP_DEFLATED, _READABLE, 3
            archive.writestr(entry, path.read_bytes())
    return len(paths)
