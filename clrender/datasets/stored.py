"""Files of a data set that may have been changed: read without trusting names, sizes or contents."""

from __future__ import annotations

import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from clrender.datasets.files import channels_sha256, decoded
from clrender.datasets.writers.webdataset import END
from clrender.files.access import UnreadableFile, open_regular
from clrender.wording import grouped

__all__ = ["StoredFiles"]

_LIMIT: Final = 1 << 32
"""Largest file that is read, bytes."""


class StoredFiles:
    """The files of a data set by name; archives are read one after the other.

    Parameters
    ----------
    folder : Path
        Of the data set: no names, and no links, lead out of it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._name, self._members = "", dict[str, tuple[int, int]]()

    def bytes_of(self, name: str) -> bytes | None:
        """A file, or a member ``ARCHIVE#MEMBER``; None if it is not there."""
        archive, _, member = name.partition("#")
        path = Path(archive)
        if path.is_absolute() or ".." in path.parts:
            return None
        try:
            with open_regular(path, beneath=self._folder) as file:
                if not member:
                    data = file.read(_LIMIT + 1)
                    return data if len(data) <= _LIMIT else None
                if archive != self._name:
                    self._name, self._members = archive, {}
                    with tarfile.open(fileobj=file, mode="r:") as opened:
                        self._members = {each.name: (each.offset_data, each.size) for each in opened}
                begin, size = self._members[member]
                file.seek(begin)
                return file.read(min(size, _LIMIT))
        except (UnreadableFile, OSError, ValueError, KeyError, tarfile.TarError):
            return None

    def has_more(self, archive: str, members: int) -> bool:
        """Whether an archive that can be read has other members than so many, or bytes behind its end."""
        path = Path(archive)
        if path.is_absolute() or ".." in path.parts:
            return False
        try:
            with open_regular(path, beneath=self._folder) as file:
                with tarfile.open(fileobj=file, mode="r:") as opened:
                    entries = opened.getmembers()
                end = max((each.offset_data + -(-each.size // 512) * 512 for each in entries), default=0)
                file.seek(min(end, _LIMIT))
                return len(entries) != members or file.read(len(END) + 1) != END
        except (UnreadableFile, OSError, ValueError, tarfile.TarError):
            return False  # its members are said to be missing

    def pixels_sha256(self, name: str) -> str | None:
        """Hash of what a file holds; None if it is missing or damaged."""
        data = self.bytes_of(name)
        try:
            return None if data is None else channels_sha256(decoded(name, data))
        except Exception:  # of damaged files, libraries raise almost any exception
            return None

    def difference(self, name: str, arrays: Mapping[str, Any] | None) -> str:
        """A sentence about a file that is not what the manifest says.

        Parameters
        ----------
        name : str
        arrays : mapping of str to ndarray, or None
            What it holds when its image is rendered again; None if there is no such file then.
        """
        data = self.bytes_of(name)
        if data is None:
            return f"{name}: is missing"
        if not name.endswith((".png", ".exr")):
            return f"{name}: its bytes are not those of the manifest"
        try:
            there = decoded(name, data)
        except Exception:  # see above
            return f"{name}: is damaged and cannot be read"
        shapes = {each: array.shape for each, array in there.items()}
        if arrays is None or shapes != {each: array.shape for each, array in arrays.items()}:
            return f"{name}: has another size or other channels than the manifest says"
        some = next(iter(arrays.values()))
        differs = np.zeros(some.shape[:2], bool)
        for each, array in arrays.items():
            here = np.ascontiguousarray(array)
            other = np.ascontiguousarray(there[each].astype(here.dtype))
            differs |= (here.view(np.uint8) != other.view(np.uint8)).reshape(*here.shape[:2], -1).any(axis=2)
        places = np.argwhere(differs)
        if not len(places):
            return f"{name}: its numbers are of another kind than the manifest says"
        row, column = places[0].tolist()
        what = "1 pixel differs" if len(places) == 1 else f"{grouped(len(places))} pixels differ, the first"
        return f"{name}: {what} from the manifest, in column {column} of row {row}"
