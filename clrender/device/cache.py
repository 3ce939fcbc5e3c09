"""What is kept between runs, in the user's cache folder: atomic to write, harmless to lose, never trusted blindly."""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import os
import platform
import shutil
import tempfile
from pathlib import Path
from typing import Any, Final

__all__ = [
    "Sentinel",
    "cache_folder",
    "compiler_folder",
    "limit_compiler_folder",
    "load_binary",
    "read_json",
    "renew_compiler_folder",
    "store_binary",
    "write_atomically",
    "write_json",
]

_MAGIC: Final = b"clrender-binary-1\n"
_MOST_BYTES: Final = 1 << 30
"""A compiler folder larger than this is begun anew: what every version of kernels and drivers leaves there adds up."""


def cache_folder() -> Path:
    """``$XDG_CACHE_HOME/clrender`` or ``~/.cache/clrender``; where neither can be written, a temporary one."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    folder = (Path(base) if base else Path.home() / ".cache") / "clrender"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    folder = Path(tempfile.gettempdir()) / f"clrender-cache-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


def write_atomically(path: Path, data: bytes) -> None:
    """Write beside `path`, then rename: nobody ever sees half a file. On a full disk the entry is lost, no more."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()


def write_json(path: Path, value: Any) -> None:
    """Keep `value` as JSON in `path`."""
    write_atomically(path, json.dumps(value, indent=1).encode())


def read_json(path: Path) -> Any:
    """Value kept in `path`, or None when there is none or it cannot be read."""
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None


def store_binary(key: str, binary: bytes) -> None:
    """Keep a built program with a checksum."""
    write_atomically(_binary_path(key), _MAGIC + hashlib.sha256(binary).digest() + binary)


def load_binary(key: str) -> bytes | None:
    """Built program kept under `key`, or None when there is none or its checksum does not hold."""
    path = _binary_path(key)
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


def _binary_path(key: str) -> Path:
    return compiler_folder() / "programs" / key


def compiler_folder() -> Path:
    """Folder of all that drivers' compilers made, begun anew when a process died with its sentinel up."""
    Sentinel.collect()
    base = cache_folder() / "compiled"
    folder = base / str(_generation(base))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _generation(base: Path) -> int:
    try:
        return int((base / "generation").read_text())
    except (OSError, ValueError):
        return 1


def renew_compiler_folder() -> None:
    """Begin an empty compiler folder, which the next process to start uses.

    The one before stays for the processes that still run with it; what is older goes.
    """
    base = cache_folder() / "compiled"
    old = _generation(base)
    write_atomically(base / "generation", str(old + 1).encode())
    for folder in base.iterdir():
        if folder.name.isdigit() and int(folder.name) < old:
            shutil.rmtree(folder, ignore_errors=True)


def limit_compiler_folder() -> None:
    """Renew the compiler folder where it has grown large."""
    size = 0
    for path in compiler_folder().rglob("*"):
        with contextlib.suppress(OSError):  # another process may take it away
            size += path.stat().st_size if path.is_file() else 0
    if size > _MOST_BYTES:
        renew_compiler_folder()


class Sentinel:
    """A file that exists while a driver compiles or first runs a kernel.

    One left by a process that died says that its compiler folder may hold an entry that kills whoever loads it.
    """

    def __init__(self) -> None:
        self._path = cache_folder() / "busy" / f"{platform.node()}.{os.getpid()}"
        self._up = False

    def put(self) -> None:
        """Put the file there."""
        if not self._up:
            write_atomically(self._path, b"")
            self._up = True
            atexit.register(self.take)  # whoever gets as far as that was not killed by a driver

    def take(self) -> None:
        """Take it away."""
        if self._up:
            self._up = False
            atexit.unregister(self.take)
            with contextlib.suppress(OSError):
                self._path.unlink()

    @staticmethod
    def drop(pid: int) -> None:
        """Take away the file of a process whose end is known and judged."""
        with contextlib.suppress(OSError):
            (cache_folder() / "busy" / f"{platform.node()}.{pid}").unlink()

    @staticmethod
    def collect() -> None:
        """Renew the compiler folder when a process of this machine died with its sentinel up."""
        died = False
        try:
            entries = list((cache_folder() / "busy").iterdir())
        except OSError:
            return
        for entry in entries:
            node, _, pid = entry.name.rpartition(".")
            if node == platform.node() and pid.isdigit() and not _alive(int(pid)):
                with contextlib.suppress(OSError):
                    entry.unlink()
                    died = True
        if died:
            renew_compiler_folder()


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
