"""File access for importers: all files that a scene names, on disk or embedded."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, Final
from urllib.parse import unquote, unquote_to_bytes

from clrender.errors import SceneError
from clrender.files.named import open_named_file, open_scene_file
from clrender.wording import counted, quoted

__all__ = ["AssetFiles"]

_LIMIT: Final = 2**32
"""Largest file that is read into memory, bytes."""


class AssetFiles:
    """Files that a scene names, from its own folder and allowed ones.

    Parameters
    ----------
    source : str
        Name of the scene file, for messages.
    folder : pathlib.Path
        The scene file's folder.
    allow_paths : sequence of pathlib.Path
    strict : bool
        Whether faults of the scene that could be forgiven, or left out, refuse it; see `Draft`.

    Attributes
    ----------
    opened : list of pathlib.Path
        Files that were read besides the scene's own.
    """

    def __init__(self, source: str, folder: Path, allow_paths: Sequence[Path] = (), strict: bool = False) -> None:
        self.source, self.folder, self.allow_paths, self.strict = source, folder, tuple(allow_paths), strict
        self.opened: list[Path] = []
        self._searched: list[str] = []

    def search(self, folder: str) -> None:
        """Look up further names in this folder first, then as before.

        Parameters
        ----------
        folder : str
            Relative to the scene's folder, or absolute. What is read there has to be allowed like any other file.
        """
        self._searched.insert(0, folder)

    def scene(self, path: Path, limit: int = _LIMIT) -> bytes:
        """The content of the scene file itself."""
        file, size = self.open_scene(path, limit)
        with file:
            return file.read(size)

    def open_scene(self, path: Path, limit: int = _LIMIT) -> tuple[BinaryIO, int]:
        """The open scene file, which the caller must close, and its size in bytes."""
        return open_scene_file(path, f"{self.source}: the scene file", limit)

    def open(self, name: str, place: str, limit: int = _LIMIT) -> tuple[BinaryIO, int]:
        """Open a file by its plain name, without escapes; returns it and its size in bytes.

        Parameters
        ----------
        name, place, limit
            See `read`.

        Raises
        ------
        SceneError
            See `clrender.files.named.open_named_file`.
        """
        label = f"{self.source}: {place}: {quoted(name)}"
        found = open_named_file(name, self.folder, self.allow_paths, label, limit)
        self.opened.append(self.folder / name)
        return found

    def read(self, uri: str, place: str, limit: int = _LIMIT) -> bytes:
        """Content of a URI: a file relative to the scene, or embedded data.

        Parameters
        ----------
        uri : str
            Relative, possibly with percent escapes, or ``data:``.
        place : str
            Location of the name in the scene, for messages, such as a JSON pointer or a line.
        limit : int
            Largest size, bytes.

        Raises
        ------
        SceneError
            Like `clrender.files.named.open_named_file`, or the data are not base64, or it is on the network.
        """
        label = f"{self.source}: {place}"
        if uri[:5].lower() == "data:":
            return _data(uri, label, limit)
        label = f"{label}: {quoted(uri)}"
        name = self.name(uri, place)
        file, size = open_named_file(name, self.folder, self.allow_paths, label, limit)
        self.opened.append(self.folder / name)
        with file:
            return file.read(size)

    def name(self, uri: str, place: str) -> str:
        """The file name of a URI, relative to the scene's folder; in the first folder of `search` that has it.

        Raises
        ------
        SceneError
            It does not name a file.
        """
        label = f"{self.source}: {place}: {quoted(uri)}"
        scheme, colon, _ = uri.partition(":")
        if colon and "/" not in scheme and len(scheme) > 1:
            raise SceneError(f"{label} is no file beside the scene, and nothing is fetched; save it there and name it")
        name = unquote(uri)
        if not name or "\0" in name:
            raise SceneError(f"{label} is no name of a file")
        # A file whose own name has a percent sign comes before what the escape stands for
        folders = (*(f"{at}/" for at in self._searched), "")
        found = (f"{at}{each}" for at in folders for each in dict.fromkeys((uri, name)))
        return next((each for each in found if self._exists(each)), name)

    def _exists(self, name: str) -> bool:
        try:
            return (self.folder / name).is_file()
        except (OSError, ValueError):
            return False


def _data(uri: str, label: str, limit: int) -> bytes:
    head, comma, body = uri[5:].partition(",")
    if not comma:
        raise SceneError(f"{label}: the data URI has no comma between its kind and its data")
    if len(body) > 2 * limit + 4:
        raise SceneError(
            f"{label}: the data URI has {counted(len(body), 'character')}, which is too much; keep it in a file"
        )
    if not head.lower().endswith(";base64"):
        return unquote_to_bytes(body)
    try:
        return base64.b64decode(unquote(body), validate=True)
    except (binascii.Error, ValueError):
        raise SceneError(f"{label}: the data URI is not valid base64; export it again") from None
