"""Opens the files that scenes name: only regular files of limited size in allowed folders."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, TypeVar

from clrender.errors import SceneError
from clrender.files.access import UnreadableFile, open_regular
from clrender.wording import counted, quoted

__all__ = ["allowed_file", "open_named_file", "open_scene_file", "read_named_file"]

_T = TypeVar("_T")


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
        raise SceneError(f"{label} has {counted(size, 'byte')}, but at most {limit} are read")
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


def read_named_file(
    name: str,
    base_folder: Path,
    allow_paths: Sequence[Path],
    place: str,
    readers: Mapping[str, Callable[[BinaryIO, str], _T]],
    what: str,
    limit: int,
    ending: str | None = None,
) -> _T:
    """Read a file that a scene names, by its ending.

    Parameters
    ----------
    name, base_folder, allow_paths
        See `allowed_file`.
    place : str
        Location of the name in the scene, for error messages.
    readers : mapping of str to callable
        By ending, such as ``.npy``: reads an open file. Its second argument begins error messages; a `ValueError` says
        why the file is none of its kind.
    what : str
        What such files hold, in the plural.
    limit : int
        Largest size, bytes.
    ending : str, optional
        What the file is, whatever its name ends with.

    Returns
    -------
    object
        As the reader returns it.

    Raises
    ------
    SceneError
        Like `open_named_file`; or there is no reader, or it cannot read the file.
    """
    label, ending = f"{place}: {quoted(name)}", ending or Path(name).suffix.lower()
    if ending not in readers:
        allowed_file(name, base_folder, allow_paths, label)
        raise SceneError(f"{label} is of no kind that can be read; {what} may be {', '.join(readers)}")
    file, _ = open_named_file(name, base_folder, allow_paths, label, limit)
    with file:
        try:
            return readers[ending](file, label)
        except ValueError as error:
            raise SceneError(f"{label} is no readable {ending} file: {error}") from None
        except OSError as error:
            raise SceneError(f"{label} cannot be read: {error.strerror or error}") from None
