"""File access: atomic writes, and errors on opening that say what to do."""

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
except ImportError:  # not on this system
    fcntl = None  # type: ignore[assignment]

__all__ = ["UnreadableFile", "atomic_write", "check_writable", "open_input", "open_regular", "remove_temporaries"]


class UnreadableFile(Exception):
    """A file that cannot be read; the message follows the file's name: "is a folder; …"."""


_PART: Final = re.compile(r"\.clrender-\d+-[0-9a-f]{12}\.part")
"""Names of temporary files of writes in progress."""
_temporaries: set[Path] = set()
_tidied: set[Path] = set()
"""Folders that were already searched for temporary files of killed processes."""
_beginning = threading.Lock()


def check_writable(path: str | Path) -> None:
    """Check, before any work is done, that `path` can be written.

    A temporary file is created beside it and removed: permissions alone are not enough (root, read-only or full disks).

    Raises
    ------
    UsageError
        When the folder does not exist or cannot be written.
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
def atomic_write(path: str | Path, beside: str | None = None, *, durable: bool = True) -> Iterator[IO[bytes]]:
    """Open a binary file that replaces `path` if the block succeeds and is removed if it fails.

    The data is written to a temporary file beside `path`, flushed to disk and renamed. So `path` is either the complete
    old or the complete new file, even if the program or the machine crashes.

    Parameters
    ----------
    path : path
    beside : str, optional
        Name of the temporary file, for a caller that knows that no one else uses it. A file left there by a killed
        process is replaced, so at most one remains. By default each temporary file has a unique name.
    durable : bool
        Whether to wait for the disk. Otherwise only a killed program, and no crash of the machine, leaves the old or
        the new file whole: for many small files whose content is proved before it is used.

    Raises
    ------
    RenderError
        When the file cannot be written (no space, no permission, …).
    UsageError
        When `path` is a pipe or a device, which a rename would destroy.
    """
    path = Path(path)
    try:
        _refuse_special(path)
        with _beside(path, beside) as (file, temporary):
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
            # The target of a link is replaced, not the link.
            target = Path(os.path.realpath(path))
            if target.exists():
                temporary.chmod(target.stat().st_mode & 0o7777)
            temporary.replace(target)
            if durable:
                _sync_folder(target.parent)
    except OSError as error:
        raise RenderError(_reason(path, error)) from None


def open_regular(path: str | Path, beneath: Path | None = None) -> BinaryIO:
    """Open an existing regular file for reading, without ever blocking.

    Pipes and devices are refused: opening a pipe blocks until a writer appears, and a device may never end.

    Parameters
    ----------
    path : path
    beneath : Path, optional
        A folder. `path` must then be relative to it, without `..`. Symbolic links in the path are refused, so that it
        cannot be redirected out of the folder between a check and the opening.

    Raises
    ------
    UnreadableFile
        When the file is missing, a folder, a device, a pipe or a socket, or permission is denied.
    """
    try:
        descriptor = _open_beneath(beneath, Path(path)) if beneath is not None else os.open(path, _READ)
    except FileNotFoundError:
        raise UnreadableFile("does not exist (no such file); check its name and folder") from None
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno == errno.ENXIO:  # from opening a socket
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
    """Open a file below `folder` one path component at a time, without following links; returns its descriptor."""
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
    """Open an existing regular file for reading.

    Raises
    ------
    UsageError
        When it cannot be opened or read, or is empty, a folder, a device, a pipe or a socket.
    """
    try:
        with open_regular(path) as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise UsageError(f"{path}: the file is empty; make it again, or name another.")
            yield file
    except UnreadableFile as error:
        raise UsageError(f"{path}: {error}.") from None
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror or error}).") from None


def remove_temporaries() -> None:
    """Remove the temporary files of unfinished `atomic_write` calls; only for a program that exits without cleanup."""
    # Never released, so that no other thread starts a write. The timeout is for a thread that is blocked by its disk.
    _beginning.acquire(timeout=1.0)
    for temporary in list(_temporaries):
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def _beside(path: Path, name: str | None = None) -> Iterator[tuple[IO[bytes], Path]]:
    """Create a file in the real folder of `path`; it is removed at the end unless it was renamed."""
    folder = Path(os.path.realpath(path)).parent
    _tidy(folder)
    temporary = folder / (name or f".clrender-{os.getpid()}-{secrets.token_hex(6)}.part")
    try:
        with _beginning:
            _temporaries.add(temporary)
            if name is not None:
                temporary.unlink(missing_ok=True)  # removed instead of truncated: it may be a link
            descriptor = _new_locked(temporary)
        with os.fdopen(descriptor, "wb") as file:
            yield file, temporary
    finally:
        with suppress(OSError):
            temporary.unlink()
        _temporaries.discard(temporary)


def _new_locked(path: Path) -> int:
    """Create a file, locked while this process writes it, so that `_tidy` keeps it; returns its descriptor."""
    while True:
        # Not `tempfile`: the final file should have the permissions of the user's umask.
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            _lock(descriptor)
            if os.fstat(descriptor).st_nlink:
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # another process removed it as a leftover before it was locked


def _lock(descriptor: int) -> None:
    """Lock a new file, if its file system supports locks."""
    if fcntl is None:
        return
    for _ in range(100):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:  # `_tidy` of another process is about to remove it
            time.sleep(0.01)
        except OSError:
            return


def _tidy(folder: Path) -> None:
    """Remove temporary files that killed processes of this user left in a folder; once for each folder.

    A lock ends with the process that holds it, on any machine. Without locks in the file system nothing is removed, as
    leftovers cannot be told from files in use.
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
    """Remove a temporary file, unless a process still writes it."""
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
    """Flush a folder to disk so that a rename persists; file systems without such a call are skipped."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _reason(path: Path, error: OSError) -> str:
    folder = Path(os.path.realpath(path)).parent
    if error.errno == errno.ENOENT and folder.is_dir():  # the error of /proc for new files
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
