"""Opens the files that scenes name: only regular files of limited size in allowed folders."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from clrender.errors import SceneError
from clrender.files.access import UnreadableFile, open_regular

__all__ = ["allowed_file", "open_named_file", "open_scene_file"]


def open_scene_file(path: Path, label: str, limit: int, beneath: Path | None = None) -> tuple[BinaryIO, int]:
    """Open a regular file of limited size for reading.

    Parameters
    ----------
    path : pathlib.Path
    label : str
        Prefix of error messages.
    limit : int
        Largest size, bytes.
    beneath : pathlib.Path, optional
        See `clrender.files.access.open_regular`.

    Returns
    -------
    file, size

    Raises
    ------
    SceneError
        If it cannot be opened, or is a folder, a device, a pipe, a socket or too large.
    """
    try:
        file = open_regular(path, beneath)
    except UnreadableFile as error:
        raise SceneError(f"{label} {error}") from None
    size = os.fstat(file.fileno()).st_size
    if size > limit:
        file.close()
        raise SceneError(f"{label} has {size} bytes, but at most {limit} are read")
    return file, size


def allowed_file(name: str, base_folder: Path, allow_paths: Sequence[Path], label: str) -> tuple[Path, Path]:
    """Path of a file that a scene names, if it may be read.

    Parameters
    ----------
    name : str
        As the scene names it, relative to `base_folder` or absolute.
    base_folder : pathlib.Path
    allow_paths : sequence of pathlib.Path
        Folders besides `base_folder` whose files, and those of their subfolders, may be read; links are resolved first.
    label : str
        Prefix of error messages.

    Returns
    -------
    folder, path
        The allowed folder, and the path from there with all links resolved.

    Raises
    ------
    SceneError
        If it is in another folder, or the name is invalid.
    """
    try:
        folders = [folder.resolve() for folder in (base_folder, *allow_paths)]
        path = (base_folder / name).resolve()
    except (OSError, RuntimeError, ValueError) as error:
        reason = getattr(error, "strerror", None)
        if isinstance(error, RuntimeError):
            reason = "its links go round in a circle"
        raise SceneError(f"{label} cannot be opened: {reason or 'the name is not a valid path'}") from None
    folder = next((folder for folder in folders if path.is_relative_to(folder)), None)
    if folder is None:
        # Do not reveal whether such a file exists outside.
        cure = "move it there or allow its folder with --allow-path (allow_paths in Python)"
        raise SceneError(f"{label} lies outside the scene's own folder; {cure}")
    return folder, path.relative_to(folder)


def open_named_file(
    name: str, base_folder: Path, allow_paths: Sequence[Path], label: str, limit: int
) -> tuple[BinaryIO, int]:
    """Open a file that a scene names, if it is in an allowed folder.

    Parameters
    ----------
    name, base_folder, allow_paths, label
        See `allowed_file`.
    limit : int
        Largest size, bytes.

    Returns
    -------
    file, size

    Raises
    ------
    SceneError
        Like `allowed_file` and `open_scene_file`.
    """
    folder, path = allowed_file(name, base_folder, allow_paths, label)
    return open_scene_file(path, label, limit, folder)
