"""The cache between runs: written atomically, harmless to lose, and used only in folders that no other user can write.

A compiled kernel is machine code that runs in this process, so its folder must be trusted: a checksum detects damage,
but not tampering.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import functools
import json
import os
import platform
import re
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

__all__ = [
    "ROOM_BYTES",
    "alive",
    "cache_folder",
    "held_alone",
    "is_private",
    "no_cache_reason",
    "process_folder",
    "read_json",
    "remove_temporary_folders",
    "temporary_folder",
    "write_atomically",
    "write_json",
]

ROOM_BYTES: Final = 64 << 20
"""Free space that a folder must have: PoCL writes its compiled code there, and aborts the process if it cannot."""

_TEMPORARY_PLACES: Final = ("/tmp", "/var/tmp", "/dev/shm")


def cache_folder() -> Path | None:
    """The cache folder.

    It is ``$XDG_CACHE_HOME/clrender`` or ``~/.cache/clrender``. If that cannot be written, has too little space or
    could be written by others, it is a folder in a temporary place. None if there is no such folder either.
    """
    return next((folder for folder in _candidates() if _usable(folder)), None)


def no_cache_reason() -> str:
    """A short reason why the first choice of `cache_folder` is not used; empty if it is used."""
    folder = next(iter(_candidates()), Path("/"))
    if _usable(folder):
        return ""
    if not folder.is_dir():
        return f"{folder} cannot be made"
    if not is_private(folder):
        return f"others than its user may write {folder}, or a folder above it"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"{folder} cannot be written"
    return f"less than {ROOM_BYTES >> 20} MiB are free at {folder}"


def _candidates() -> list[Path]:
    # Relative paths are invalid by the XDG specification, and would depend on the working directory.
    base = os.environ.get("XDG_CACHE_HOME", "")
    folders = [Path(base) / "clrender"] if Path(base).is_absolute() else []
    if not folders:
        with contextlib.suppress(RuntimeError):  # no HOME, and an unknown user
            folders = [Path.home() / ".cache" / "clrender"]
    return folders + [place / f"clrender-cache-{os.geteuid()}" for place in _temporary_places()]


def _temporary_places() -> list[Path]:
    """Folders for temporary files. Not `tempfile.gettempdir`, which falls back to the working directory."""
    named = (os.environ.get("TMPDIR", ""), *_TEMPORARY_PLACES)
    return [Path(name) for name in dict.fromkeys(named) if Path(name).is_absolute() and Path(name).is_dir()]


def _usable(folder: Path) -> bool:
    try:
        if not folder.parent.is_dir():
            folder.parent.mkdir(mode=0o700, parents=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        return is_private(folder) and os.access(folder, os.W_OK | os.X_OK) and _has_room(folder)
    except OSError:
        return False


def is_private(folder: Path) -> bool:
    """Whether only this user and root can write to a folder or replace it.

    It must be a real folder of this user that no other user may write. Its parents must belong to this user or to root,
    and must not be writable by others unless they are sticky, like ``/tmp``.
    """
    try:
        own = folder.lstat()
        if not stat.S_ISDIR(own.st_mode) or own.st_uid != os.geteuid() or own.st_mode & 0o022:
            return False
        # Parents of both the path and its target: a link in the path could be replaced.
        above = [parent.stat() for parent in {*folder.parents, *folder.resolve(strict=True).parents}]
    except OSError:
        return False
    return all(
        each.st_uid in (0, os.geteuid()) and (not each.st_mode & 0o022 or each.st_mode & stat.S_ISVTX) for each in above
    )


def _has_room(folder: Path) -> bool:
    free = os.statvfs(folder)
    nodes = free.f_favail > 1000 or free.f_files == 0  # some file systems do not count inodes
    return free.f_bavail * free.f_frsize >= ROOM_BYTES and nodes


_temporary: Final[set[Path]] = set()


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """Create a private folder that exists while the block runs. Leftovers of killed processes are removed first.

    Raises
    ------
    OSError
        When it cannot be created.
    """
    folder = _make_temporary()
    try:
        yield folder
    finally:
        _remove(folder)


@contextlib.contextmanager
def held_alone(name: str, seconds: float) -> Iterator[None]:
    """Hold a lock while the block runs, so that what several threads and processes need is made once.

    Parameters
    ----------
    name : str
        Path of what is made, below the cache folder.
    seconds : float
        Time to wait for another thread or process. Then the block runs without the lock, as it does if there is no
        cache folder, or its file system has no locks: work is done twice, and nothing is lost.
    """
    with contextlib.ExitStack() as stack:
        folder, end = cache_folder(), time.monotonic() + seconds
        with contextlib.suppress(OSError):
            if folder is not None:
                path = folder / "locks" / name
                path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                file = stack.enter_context(path.open("wb"))
                while time.monotonic() < end:
                    try:
                        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                        break
                    except BlockingIOError:
                        time.sleep(0.05)
        yield


@functools.cache
def process_folder() -> Path | None:
    """A private folder with enough space that is removed when the process ends; None if it cannot be created."""
    try:
        folder = _make_temporary()
    except OSError:
        return None
    atexit.register(_remove, folder)
    return folder


def remove_temporary_folders() -> None:
    """Remove all temporary folders of this process, before it ends without its exit handlers."""
    for folder in list(_temporary):
        _remove(folder)


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    _temporary.discard(folder)


def _make_temporary() -> Path:
    prefix = f"clrender-{platform.node()}-"
    for place in _temporary_places():
        try:
            _sweep(place, prefix)
            if _has_room(place):
                folder = Path(tempfile.mkdtemp(prefix=f"{prefix}{os.getpid()}-", dir=place))
                _temporary.add(folder)
                return folder
        except OSError:
            continue
    raise OSError(f"no temporary folder has {ROOM_BYTES >> 20} MiB of room")


def _sweep(place: Path, prefix: str) -> None:
    """Remove folders of ended processes of this user and machine."""
    for entry in place.glob(f"{prefix}*"):
        match = re.fullmatch(r"(\d+)-\w+", entry.name.removeprefix(prefix))
        with contextlib.suppress(OSError):
            if match and not alive(int(match[1])) and entry.lstat().st_uid == os.geteuid():
                shutil.rmtree(entry, ignore_errors=True)


def alive(pid: int) -> bool:
    """Whether a process with this id exists on this machine."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def write_atomically(path: Path, data: bytes) -> None:
    """Write a temporary file and rename it, so that no partial file is visible. A full disk only loses the entry."""
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}.tmp")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()


def write_json(name: str, value: Any) -> None:
    """Store `value` as JSON under a name relative to the cache folder."""
    folder = cache_folder()
    if folder is not None:
        write_atomically(folder / name, json.dumps(value, indent=1).encode())


def read_json(name: str) -> Any:
    """The value stored under a name, or None if there is none or it cannot be read."""
    folder = cache_folder()
    if folder is None:
        return None
    try:
        return json.loads((folder / name).read_bytes())
    except (OSError, ValueError):
        return None
