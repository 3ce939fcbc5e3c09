"""Opens the files that scenes name: only from allowed folders, only regular files, only of sane size."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from clrender.errors import SceneError
from clrender.files import UnreadableFile, open_regular

__all__ = ["allowed_file", "open_named_file", "open_scene_file"]


def open_scene_file(path: Path, label: str, limit: int, beneath: Path | None = None) -> tuple[BinaryIO, int]:
    """Open a file for reading if it is a regular one of sane size.

    Parameters
    ----------
    path : pathlib.Path
    label : str
        Start of the error message.
    limit : int
        Largest size, bytes.
    beneath : pathlib.Path, optional
        As of `clrender.files.open_regular`.

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
    """Where a file lies that a scene names, if it may be read.

    Parameters
    ----------
    name : str
        As the scene names it, relative to `base_folder` or absolute.
    base_folder : pathlib.Path
    allow_paths : sequence of pathlib.Path
        Folders besides `base_folder` from which, and from below which, files may come; links are followed first.
    label : str
        Start of the error message.

    Returns
    -------
    folder, path
        The folder in which it may be read, and the way from there with all links followed.

    Raises
    ------
    SceneError
        If it lies elsewhere, or the name is none.
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
        # Whether such a file exists outside is not told.
        cure = "move it there or allow its folder with --allow-path (allow_paths in Python)"
        raise SceneError(f"{label} lies outside the scene's own folder; {cure}")
    return folder, path.relative_to(folder)


def open_named_file(
    name: str, base_folder: Path, allow_paths: Sequence[Path], label: str, limit: int
) -> tuple[BinaryIO, int]:
    """Open a file that a scene names, if it lies where files may come from.

    Parameters
    ----------
    name, base_folder, allow_paths, label
        As of `allowed_file`.
    limit : int
        Largest size, bytes.

    Returns
    -------
    file, size

    Raises
    ------
    SceneError
        As of `allowed_file` and `open_scene_file`.
    """
    folder, path = allowed_file(name, base_folder, allow_paths, label)
    return open_scene_file(path, label, limit, folder)
