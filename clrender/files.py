"""Files on disk: written whole or not at all, opened with errors that say what to do."""

from __future__ import annotations

import errno
import os
import re
import secrets
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, BinaryIO, Final

from clrender.errors import RenderError, UsageError

try:
    import fcntl
except ImportError:  # a system without
    fcntl = None  # type: ignore[assignment]

__all__ = ["UnreadableFile", "atomic_write", "check_writable", "open_input", "open_regular", "remove_temporaries"]


class UnreadableFile(Exception):
    """A file that cannot be read; the message goes on from its name: "is a folder; …"."""


_PART: Final = re.compile(r"\.clrender-\d+-[0-9a-f]{12}\.part")
"""Names of files that are being written."""
_temporaries: set[Path] = set()
_tidied: set[Path] = set()
"""Folders that were looked through for what killed processes have left."""
_beginning = threading.Lock()


def check_writable(path: str | Path) -> None:
    """Make sure, before any work is done, that `path` can be written.

    A file beside it is really created and removed: permissions alone do not tell (root, read-only or full disks).

    Raises
    ------
    UsageError
        No such folder, or a place that cannot be written.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise UsageError(f"{path}: is a folder; name a file in it.")
        _refuse_special(path)
        if path.exists() and not os.access(path, os.W_OK):
            raise UsageError(f"{path}: is write-protected; remove it or choose another name.")
        with _beside(path) as (file, _):
            file.write(b"\0")
    except OSError as error:
        raise UsageError(_reason(path, error)) from None


@contextmanager
def atomic_write(path: str | Path, beside: str | None = None) -> Iterator[IO[bytes]]:
    """Binary file that takes the place of `path` when the block ends well, and vanishes when it does not.

    The data is written beside, flushed to the disk and renamed, so that `path` is the old or the new file, whole,
    whenever the program or the machine dies.

    Parameters
    ----------
    path : path
    beside : str, optional
        Name of the file until then, for a caller who knows that nobody else uses it: what a killed process has left
        there is replaced, so that no more than one such file is ever left. By default no two are called alike.

    Raises
    ------
    RenderError
        The file cannot be written (no room, no permission, …).
    UsageError
        `path` is a pipe or a device, which a rename would destroy.
    """
    path = Path(path)
    try:
        _refuse_special(path)
        with _beside(path, beside) as (file, temporary):
            yield file
            file.flush()
            os.fsync(file.fileno())
            # A link is written through, not replaced.
            target = Path(os.path.realpath(path))
            if target.exists():
                temporary.chmod(target.stat().st_mode & 0o7777)
            temporary.replace(target)
            _sync_folder(target.parent)
    except OSError as error:
        raise RenderError(_reason(path, error)) from None


def open_regular(path: str | Path, beneath: Path | None = None) -> BinaryIO:
    """Open an existing regular file for reading, without ever waiting for it.

    Opening a pipe waits until somebody writes to it, and a device may never end; both are refused.

    Parameters
    ----------
    path : path
    beneath : Path, optional
        A folder. `path` must then be relative to it, without `..`; links on the way are refused, so that nobody can
        lead the way out of the folder between a check of the path and its opening.

    Raises
    ------
    UnreadableFile
        Missing, a folder, a device, a pipe, a socket, or without permission.
    """
    try:
        descriptor = _open_beneath(beneath, Path(path)) if beneath is not None else os.open(path, _READ)
    except FileNotFoundError:
        raise UnreadableFile("does not exist (no such file); check its name and folder") from None
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno == errno.ENXIO:  # what opening a socket says
            raise UnreadableFile(_SPECIAL) from None
        if isinstance(error, OSError) and error.errno == errno.ELOOP:
            raise UnreadableFile("cannot be opened: its links go round in a circle") from None
        reason = getattr(error, "strerror", None) or "the name is not a valid path"
        raise UnreadableFile(f"cannot be opened: {reason}") from None
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        raise UnreadableFile("is a folder; name a file in it" if stat.S_ISDIR(mode) else _SPECIAL)
    return os.fdopen(descriptor, "rb")


_SPECIAL = "is a socket, a device or a pipe; only regular files are read"
_READ = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY


def _open_beneath(folder: Path, path: Path) -> int:
    """Descriptor of a file reached from `folder` step by step, through real folders only."""
    step = os.O_DIRECTORY | os.O_CLOEXEC | getattr(os, "O_PATH", os.O_RDONLY)
    here = os.open(folder, step)
    try:
        for name in path.parts[:-1]:
            there = os.open(name, step | os.O_NOFOLLOW, dir_fd=here)
            os.close(here)
            here = there
        return os.open(path.name, _READ | os.O_NOFOLLOW, dir_fd=here)
    finally:
        os.close(here)


@contextmanager
def open_input(path: str | Path) -> Iterator[IO[bytes]]:
    """Existing regular file for reading.

    Raises
    ------
    UsageError
        It cannot be opened or read, or is a folder, a device, a pipe or a socket.
    """
    try:
        with open_regular(path) as file:
            yield file
    except UnreadableFile as error:
        raise UsageError(f"{path}: {error}.") from None
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror or error}).") from None


def remove_temporaries() -> None:
    """Remove what `atomic_write` has begun and not ended; only for a program about to exit without cleaning up."""
    # For good: another thread would begin one behind our back. But one that waits for its disk does not keep us.
    _beginning.acquire(timeout=1.0)
    for temporary in list(_temporaries):
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def _beside(path: Path, name: str | None = None) -> Iterator[tuple[IO[bytes], Path]]:
    """New file in the folder where `path` really lies, removed at the end unless it was renamed."""
    folder = Path(os.path.realpath(path)).parent
    _tidy(folder)
    temporary = folder / (name or f".clrender-{os.getpid()}-{secrets.token_hex(6)}.part")
    try:
        with _beginning:
            _temporaries.add(temporary)
            if name is not None:
                temporary.unlink(missing_ok=True)  # not opened and emptied: it may be a link
            descriptor = _new_locked(temporary)
        with os.fdopen(descriptor, "wb") as file:
            yield file, temporary
    finally:
        with suppress(OSError):
            temporary.unlink()
        _temporaries.discard(temporary)


def _new_locked(path: Path) -> int:
    """Descriptor of a new file, locked for as long as this process writes it: whoever tidies up sees that it lives."""
    while True:
        # Not `tempfile`: the final file shall have the rights that the user's umask gives.
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            _lock(descriptor)
            if os.fstat(descriptor).st_nlink:
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # somebody took it for one that was left behind, before it was locked


def _lock(descriptor: int) -> None:
    """Lock a new file, where its file system knows locks."""
    if fcntl is None:
        return
    for _ in range(100):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:  # whoever tidies up is about to remove it
            time.sleep(0.01)
        except OSError:
            return


def _tidy(folder: Path) -> None:
    """Remove what killed processes of this user were writing in a folder; once for each folder.

    A lock ends with the process that has it, on whatever machine that runs. Where a file system knows no locks nothing
    is removed, for nobody can tell.
    """
    if fcntl is None or folder in _tidied:
        return
    _tidied.add(folder)
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _PART.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                with suppress(OSError):
                    _remove_if_left(Path(entry.path))


def _remove_if_left(part: Path) -> None:
    """Remove a file that is being written, unless somebody still does."""
    descriptor = os.open(part, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(descriptor).st_uid == os.geteuid():
            part.unlink()
    finally:
        os.close(descriptor)


def _refuse_special(path: Path) -> None:
    if path.exists() and not path.is_file() and not path.is_dir():
        raise UsageError(f"{path}: is not a regular file; write to one.")


def _sync_folder(folder: Path) -> None:
    """Make a rename last; some file systems know no such call, and then there is nothing to do."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _reason(path: Path, error: OSError) -> str:
    folder = Path(os.path.realpath(path)).parent
    if error.errno == errno.ENOENT and folder.is_dir():  # as /proc says of new files
        return f"{path}: the folder {str(folder)!r} takes no files; write elsewhere."
    match error.errno:
        case errno.ENOSPC | errno.EDQUOT | errno.EFBIG:
            return f"{path}: cannot be written, no room is left ({error.strerror}); make room or write elsewhere."
        case errno.ENOENT | errno.ENOTDIR:
            return f"{path}: there is no folder {str(folder)!r}; create it first."
        case errno.EACCES | errno.EPERM | errno.EROFS:
            return f"{path}: the folder {str(folder)!r} cannot be written ({error.strerror}); write elsewhere."
        case _:
            return f"{path}: cannot be written ({error.strerror or error})."
