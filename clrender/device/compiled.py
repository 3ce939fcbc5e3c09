"""What drivers' compilers made, kept by hash, and how a process that dies by a damaged entry is the last to do so."""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import hashlib
import itertools
import json
import os
import platform
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from clrender.device import cache

__all__ = [
    "Sentinel",
    "compiler_folder",
    "leave",
    "limit_compiler_folder",
    "load_binary",
    "renew_compiler_folder",
    "store_binary",
]

_MAGIC: Final = b"clrender-binary-1\n"
_MOST_BYTES: Final = 1 << 30
"""A compiler folder larger than this is begun anew: what every version of kernels and drivers leaves there adds up."""
_CLOCK_SECONDS: Final = 2.0
"""File systems round times, and a server's clock may be another."""


def compiler_folder() -> Path | None:
    """Folder of all that drivers' compilers made, without what a process that died may have damaged.

    One of this process alone where there is no cache folder; None where there is no room for it anywhere.
    """
    base = _base()
    if base is None:
        return cache.process_folder()
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
    """Begin an empty compiler folder, which the next process to start uses.

    The one before stays for the processes that still run with it; what is older goes.
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
    """Renew the compiler folder where it has grown large."""
    size, folder = 0, compiler_folder()
    for path in folder.rglob("*") if folder is not None else ():
        with contextlib.suppress(OSError):  # another process may take it away
            size += path.stat().st_size if path.is_file() else 0
    if size > _MOST_BYTES:
        renew_compiler_folder()


def store_binary(key: str, binary: bytes) -> None:
    """Keep a built program with a checksum."""
    folder = compiler_folder()
    if folder is not None:
        data = _MAGIC + hashlib.sha256(binary).digest() + binary
        cache.write_atomically(folder / "programs" / key, data)


def load_binary(key: str) -> bytes | None:
    """Built program kept under `key`, or None when there is none or its checksum does not hold."""
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


def leave() -> None:
    """Tidy up for a process that somebody interrupts, and that ends at once and without its exit handlers."""
    Sentinel.interrupt_all()
    cache.remove_temporary_folders()


class Sentinel:
    """A file that exists while a device's driver compiles or first runs kernels; every device has its own.

    It names the programs in question. Left by a process that died, it says that what that process wrote or loaded may
    be damaged or kill whoever loads it: just that is removed, the rest stays. A process that was interrupted on
    purpose loaded nothing that harms, so only what it may have left unfinished goes.
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
        """Put the file there for the program kept under `key` too, beside those it names already."""
        if key in self._keys:
            return
        if self._path is None:
            base, folder = _base(), compiler_folder()
            if base is None or folder is None:
                return  # nothing is kept, so nothing can be damaged
            self._path = base / "busy" / f"{platform.node()}.{self._pid}.{self._number}"
            self._since, self._generation = time.time(), folder.name
            self._up.add(self)
            atexit.register(self.take)  # whoever gets as far as that was not killed by a driver
        self._keys.append(key)
        with _locked(self._path.parents[1]):
            self._write(interrupted=False)

    def _write(self, interrupted: bool) -> None:
        if self._path is not None:
            record = {"keys": self._keys, "since": self._since, "generation": self._generation}
            cache.write_atomically(self._path, json.dumps({**record, "interrupted": interrupted}).encode())

    def take(self) -> None:
        """Take the file away: the programs ran."""
        if self._path is None or os.getpid() != self._pid:  # a fork's end is not ours
            return
        with contextlib.suppress(OSError):
            self._path.unlink()
        atexit.unregister(self.take)
        self._up.discard(self)
        self._path, self._keys = None, []

    @classmethod
    def interrupt_all(cls) -> None:
        """Say in every file of this process that it ends because somebody wants it to, now."""
        for sentinel in list(cls._up):
            sentinel._write(interrupted=True)

    @staticmethod
    def drop(pid: int) -> None:
        """Take away the files of a process whose end is known and judged."""
        base = _base()
        for entry in _entries(base / "busy") if base is not None else ():
            if entry.name.startswith(f"{platform.node()}.{pid}."):
                with contextlib.suppress(OSError):
                    entry.unlink()

    @classmethod
    def collect(cls, base: Path) -> None:
        """Remove what processes of this machine that died with their sentinels up may have damaged.

        Not while another process compiles: what is new could be its own, and it waits until that one is done. Nor may
        one begin meanwhile: to put its file there it waits for the lock.
        """
        if _entries(base / "busy"):
            with _locked(base):
                cls._collect(base)

    @classmethod
    def _collect(cls, base: Path) -> None:
        own = {sentinel._path for sentinel in list(cls._up)}  # other devices' threads put theirs up meanwhile
        dead = []
        for entry in _entries(base / "busy"):
            node, pid = _owner(entry)
            if node != platform.node():
                continue
            # A number comes again: in a container every process may have the same.
            if cache.alive(pid) and (pid != os.getpid() or entry in own):
                return
            dead.append(entry)
        for entry in dead:
            _purge(base, _record(entry))
            with contextlib.suppress(OSError):
                entry.unlink()


@contextmanager
def _locked(base: Path) -> Iterator[None]:
    """Have the compiled programs of all generations to oneself, where the file system knows locks."""
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
    """Machine and process of a sentinel's file; a machine without a name where it is none."""
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
    """Remove what a process may have damaged; all, where that is not known."""
    if not record:
        renew_compiler_folder()
        return
    folder = base / record["generation"]
    for key in record["keys"]:
        with contextlib.suppress(OSError):
            (folder / "programs" / Path(key).name).unlink()
    for entry in _pocl_entries(folder / "pocl"):
        if _newest(entry, loaded=not record["interrupted"]) >= record["since"] - _CLOCK_SECONDS:
            shutil.rmtree(entry, ignore_errors=True)


def _pocl_entries(folder: Path) -> Iterator[Path]:
    """Programs in PoCL's cache lie in folders of folders; beside them lie files it was writing."""
    for entry in _entries(folder):
        if entry.is_dir():
            yield from _entries(entry)
        else:
            with contextlib.suppress(OSError):
                entry.unlink()


def _newest(entry: Path, loaded: bool) -> float:
    """When a program of PoCL's cache was last written or, with `loaded`, loaded, in seconds since 1970."""
    newest = 0.0
    for path in entry.rglob("*"):
        if loaded or path.name != "last_accessed":  # PoCL touches that one
            with contextlib.suppress(OSError):
                newest = max(newest, path.lstat().st_mtime)
    return newest
