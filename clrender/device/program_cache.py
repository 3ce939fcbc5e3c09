"""Cache of compiled programs, by hash; entries that may have crashed a process are removed."""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import hashlib
import itertools
import json
import os
import platform
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from clrender.device import cache

__all__ = [
    "Sentinel",
    "compiler_folder",
    "has_run",
    "leave",
    "limit_compiler_folder",
    "load_binary",
    "note_run",
    "renew_compiler_folder",
    "store_binary",
]

_MAGIC: Final = b"clrender-binary-1\n"
_MOST_BYTES: Final = 1 << 30
"""Size above which the compiler folder is emptied: programs of old versions of kernels and drivers accumulate."""
_CLOCK_SECONDS: Final = 2.0
"""Tolerance for file times: file systems round them, and a server's clock may differ."""


def compiler_folder() -> Path | None:
    """Folder of the output of drivers' compilers, after removing entries that a crashed process may have damaged.

    If there is no cache folder, it is a folder of this process only; None if there is no space for it anywhere.
    """
    base = _base()
    return cache.process_folder() if base is None else _folder_of(base)


def _folder_of(base: Path) -> Path | None:
    Sentinel.collect(base)
    folder = base / str(_generation(base))
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return cache.process_folder()
    return folder


def _base() -> Path | None:
    folder = cache.cache_folder()
    return None if folder is None else folder / "compiled"


def _generation(base: Path) -> int:
    try:
        return int((base / "generation").read_text())
    except (OSError, ValueError):
        return 1


def renew_compiler_folder() -> None:
    """Create an empty compiler folder, which the next processes to start will use.

    The previous one is kept for the processes that still use it; older ones are removed.
    """
    base = _base()
    if base is None:
        return
    old = _generation(base)
    cache.write_atomically(base / "generation", str(old + 1).encode())
    for folder in _entries(base):
        if folder.name.isdigit() and int(folder.name) < old:
            shutil.rmtree(folder, ignore_errors=True)


def limit_compiler_folder() -> None:
    """Renew the compiler folder if it is too large."""
    size, folder = 0, compiler_folder()
    for parent, _, names in os.walk(folder) if folder is not None else ():  # passes over a folder that has gone
        for name in names:
            with contextlib.suppress(OSError):  # another process may remove it
                size += Path(parent, name).stat().st_size
    if size > _MOST_BYTES:
        renew_compiler_folder()


def store_binary(key: str, binary: bytes) -> None:
    """Store a built program with a checksum."""
    folder = compiler_folder()
    if folder is not None:
        data = _MAGIC + hashlib.sha256(binary).digest() + binary
        cache.write_atomically(folder / "programs" / key, data)


def load_binary(key: str) -> bytes | None:
    """The built program stored under `key`, or None if there is none or its checksum is wrong."""
    folder = compiler_folder()
    if folder is None:
        return None
    path = folder / "programs" / key
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, binary = data[len(_MAGIC) : len(_MAGIC) + 32], data[len(_MAGIC) + 32 :]
    if data.startswith(_MAGIC) and hashlib.sha256(binary).digest() == digest:
        return binary
    with contextlib.suppress(OSError):
        path.unlink()
    return None


def note_run(key: str) -> None:
    """Note that the program with this key was compiled and ran, for drivers that keep compiled programs themselves."""
    folder = compiler_folder()
    if folder is not None:
        cache.write_atomically(folder / "run" / key, b"")


def has_run(key: str) -> bool:
    """Whether the program with this key has been compiled and run with this compiler folder."""
    folder = _lately()
    return folder is not None and (folder / "run" / key).exists()


def _lately() -> Path | None:
    """The compiler folder of this second: to find it takes a dozen calls of the system."""
    return _folder_at(os.environ.get("XDG_CACHE_HOME"), int(time.monotonic()))


@lru_cache(maxsize=1)
def _folder_at(_home: str | None, _second: int) -> Path | None:
    return compiler_folder()


def leave() -> None:
    """Clean up for an interrupted process that ends at once, without its exit handlers."""
    Sentinel.interrupt_all()
    cache.remove_temporary_folders()


class Sentinel:
    """A file that exists while a device's driver compiles or first runs kernels; each device has its own.

    It lists the programs concerned. If a process crashes and leaves it, the entries that the process wrote or loaded
    may be damaged or crash any process that loads them; only these are removed. A process that was interrupted on
    purpose did not crash from a loaded entry, so only entries that it may have written partially are removed.
    """

    _serial = itertools.count()
    _up: Final[set[Sentinel]] = set()

    def __init__(self) -> None:
        self._number = next(self._serial)
        self._pid = os.getpid()
        self._keys: list[str] = []
        self._since = 0.0
        self._path: Path | None = None
        self._generation = ""

    def put(self, key: str) -> None:
        """Create the file, or add the program stored under `key` to it."""
        if key in self._keys:
            return
        if self._path is None:
            base = _base()
            folder = None if base is None else _folder_of(base)
            if base is None or folder is None:
                return  # nothing is cached, so nothing can be damaged
            self._path = base / "busy" / f"{platform.node()}.{self._pid}.{self._number}"
            self._since, self._generation = time.time(), folder.name
            self._up.add(self)
            atexit.register(self.take)  # a process that reaches its exit handlers was not killed by a driver
        self._keys.append(key)
        with _locked(self._path.parents[1]):
            self._write(interrupted=False)

    def _write(self, interrupted: bool) -> None:
        if self._path is not None:
            record = {"keys": self._keys, "since": self._since, "generation": self._generation}
            cache.write_atomically(self._path, json.dumps({**record, "interrupted": interrupted}).encode())

    def take(self) -> None:
        """Remove the file, as the programs ran."""
        if self._path is None or os.getpid() != self._pid:  # a forked child must not remove it
            return
        with contextlib.suppress(OSError):
            self._path.unlink()
        atexit.unregister(self.take)
        self._up.discard(self)
        self._path, self._keys = None, []

    @classmethod
    def interrupt_all(cls) -> None:
        """Note in every file of this process that it was interrupted on purpose."""
        for sentinel in list(cls._up):
            sentinel._write(interrupted=True)

    @staticmethod
    def drop(pid: int) -> None:
        """Remove the files of a process whose end has already been evaluated."""
        base = _base()
        for entry in _entries(base / "busy") if base is not None else ():
            if entry.name.startswith(f"{platform.node()}.{pid}."):
                with contextlib.suppress(OSError):
                    entry.unlink()

    @classmethod
    def collect(cls, base: Path) -> None:
        """Remove entries that processes of this machine, which died and left their files, may have damaged.

        It does nothing while another process compiles, as new entries could belong to that process; a later call then
        does the work. No other process can start meanwhile, as it needs the lock to create its file.
        """
        if _entries(base / "busy"):
            with _locked(base):
                cls._collect(base)

    @classmethod
    def _collect(cls, base: Path) -> None:
        own = {sentinel._path for sentinel in list(cls._up)}  # threads of other devices may create files meanwhile
        dead = []
        for entry in _entries(base / "busy"):
            node, pid = _owner(entry)
            if node != platform.node():
                continue
            # Process ids are reused: in a container every process may have the same id.
            if cache.alive(pid) and (pid != os.getpid() or entry in own):
                return
            dead.append(entry)
        for entry in dead:
            _purge(base, _record(entry))
            with contextlib.suppress(OSError):
                entry.unlink()


@contextmanager
def _locked(base: Path) -> Iterator[None]:
    """Hold an exclusive lock on the programs of all generations, if the file system supports locks."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            base.mkdir(mode=0o700, parents=True, exist_ok=True)
            fcntl.flock(stack.enter_context((base / "lock").open("wb")), fcntl.LOCK_EX)
        yield


def _entries(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        return []


def _owner(entry: Path) -> tuple[str, int]:
    """Machine and process id of a sentinel's file; an empty machine name if it is no such file."""
    node, _, numbers = entry.name.rpartition(".")
    node, _, pid = node.rpartition(".")
    return (node, int(pid)) if pid.isdigit() and numbers.isdigit() else ("", 0)


def _record(entry: Path) -> dict[str, Any]:
    try:
        record = json.loads(entry.read_bytes())
        assert isinstance(record["interrupted"], bool)
        keys = [str(key) for key in record["keys"]]
        return {**record, "keys": keys, "since": float(record["since"]), "generation": str(int(record["generation"]))}
    except (OSError, ValueError, KeyError, TypeError, AssertionError):
        return {}


def _purge(base: Path, record: dict[str, Any]) -> None:
    """Remove the entries that a process may have damaged; all, if the record cannot be read.

    Those that a living process has mapped are sound: it runs them, as nobody who compiles or loads is left.
    """
    if not record:
        renew_compiler_folder()
        return
    folder = base / record["generation"]
    for key in record["keys"]:
        with contextlib.suppress(OSError):
            (folder / "programs" / Path(key).name).unlink()
        with contextlib.suppress(OSError):
            (folder / "run" / Path(key).name).unlink()
    used = _mapped(folder / "pocl")
    for entry in _pocl_entries(folder / "pocl"):
        if (
            entry.resolve() not in used
            and _newest(entry, loaded=not record["interrupted"]) >= record["since"] - _CLOCK_SECONDS
        ):
            shutil.rmtree(entry, ignore_errors=True)


def _mapped(folder: Path) -> set[Path]:
    """Folders of programs in PoCL's cache of which living processes have a file in their memory."""
    folder = folder.resolve()
    used = set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        with contextlib.suppress(OSError):  # it has ended, or is another user's
            names = re.findall(re.escape(os.fsencode(folder)) + rb"/([^/\n]+/[^/\n]+)/", maps.read_bytes())
            used |= {folder / os.fsdecode(name) for name in names}
    return used


def _pocl_entries(folder: Path) -> Iterator[Path]:
    """Folders of programs in PoCL's cache, at its second level; unfinished files at the first level are removed."""
    for entry in _entries(folder):
        if entry.is_dir():
            yield from _entries(entry)
        else:
            with contextlib.suppress(OSError):
                entry.unlink()


def _newest(entry: Path, loaded: bool) -> float:
    """Time when a program of PoCL's cache was last written or, with `loaded`, also loaded; seconds since 1970."""
    newest = 0.0
    for path in entry.rglob("*"):
        if loaded or path.name != "last_accessed":  # PoCL touches that file on loading
            with contextlib.suppress(OSError):
                newest = max(newest, path.lstat().st_mtime)
    return newest
