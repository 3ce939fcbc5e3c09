"""What is kept between runs: atomic to write, harmless to lose, and read only where no other user can write.

A compiled kernel is machine code that runs in this process, so where it lies is a question of trust: a checksum shows
damage, not who wrote it.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import os
import platform
import re
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

__all__ = [
    "ROOM_BYTES",
    "alive",
    "cache_folder",
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
"""Free space that a folder must have: PoCL writes what it compiles there, and ends the process where it cannot."""

_TEMPORARY_PLACES: Final = ("/tmp", "/var/tmp", "/dev/shm")


def cache_folder() -> Path | None:
    """Folder of what is kept between runs.

    ``$XDG_CACHE_HOME/clrender`` or ``~/.cache/clrender``; else, where that cannot be written, has no room or could be
    written by others, a folder in a temporary place. None where there is no such folder either.
    """
    return next((folder for folder in _candidates() if _usable(folder)), None)


def no_cache_reason() -> str:
    """Why the first choice of `cache_folder` is not used, in a few words; empty where it is."""
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
    # Relative paths are invalid there by the XDG specification, and would change with the working folder.
    base = os.environ.get("XDG_CACHE_HOME", "")
    folders = [Path(base) / "clrender"] if Path(base).is_absolute() else []
    if not folders:
        with contextlib.suppress(RuntimeError):  # no HOME, and a user the system does not know
            folders = [Path.home() / ".cache" / "clrender"]
    return folders + [place / f"clrender-cache-{os.geteuid()}" for place in _temporary_places()]


def _temporary_places() -> list[Path]:
    """Not `tempfile.gettempdir`, which ends at the working folder."""
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
    """Whether nobody but this user and root can put anything into a folder, or another in its place.

    It has to be a real folder of this user that no other may write. Those above it belong to them or to root, and
    are not writable by others unless they are sticky, as ``/tmp`` is.
    """
    try:
        own = folder.lstat()
        if not stat.S_ISDIR(own.st_mode) or own.st_uid != os.geteuid() or own.st_mode & 0o022:
            return False
        # Both ways: a link on it could be replaced where it lies.
        above = [parent.stat() for parent in (*folder.parents, *folder.resolve(strict=True).parents)]
    except OSError:
        return False
    return all(
        each.st_uid in (0, os.geteuid()) and (not each.st_mode & 0o022 or each.st_mode & stat.S_ISVTX) for each in above
    )


def _has_room(folder: Path) -> bool:
    free = os.statvfs(folder)
    nodes = free.f_favail > 1000 or free.f_files == 0  # some file systems count none
    return free.f_bavail * free.f_frsize >= ROOM_BYTES and nodes


_temporary: Final[set[Path]] = set()


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """A private folder for as long as the block runs. What a killed process left goes when the next is made.

    Raises
    ------
    OSError
        When there is no place for it.
    """
    folder = _make_temporary()
    try:
        yield folder
    finally:
        _remove(folder)


@functools.cache
def process_folder() -> Path | None:
    """A private folder with room that goes when the process ends; None where there is no place for it."""
    try:
        folder = _make_temporary()
    except OSError:
        return None
    atexit.register(_remove, folder)
    return folder


def remove_temporary_folders() -> None:
    """Remove all folders of this process, which is about to end without its exit handlers."""
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
    """Remove folders of processes of this user and machine that are no more."""
    for entry in place.glob(f"{prefix}*"):
        match = re.fullmatch(r"(\d+)-\w+", entry.name.removeprefix(prefix))
        with contextlib.suppress(OSError):
            if match and not alive(int(match[1])) and entry.lstat().st_uid == os.geteuid():
                shutil.rmtree(entry, ignore_errors=True)


def alive(pid: int) -> bool:
    """Whether there is a process of that number on this machine."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def write_atomically(path: Path, data: bytes) -> None:
    """Write beside `path`, then rename: nobody ever sees half a file. On a full disk the entry is lost, no more."""
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}.tmp")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()


def write_json(name: str, value: Any) -> None:
    """Keep `value` as JSON under a name relative to the cache folder."""
    folder = cache_folder()
    if folder is not None:
        write_atomically(folder / name, json.dumps(value, indent=1).encode())


def read_json(name: str) -> Any:
    """Value kept under a name, or None when there is none or it cannot be read."""
    folder = cache_folder()
    if folder is None:
        return None
    try:
        return json.loads((folder / name).read_bytes())
    except (OSError, ValueError):
        return None
