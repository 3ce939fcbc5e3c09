"""A lock file for a file that only one process may write; the lock ends with its process, however that ends."""

from __future__ import annotations

import errno
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from clrender.errors import UsageError

try:
    import fcntl
except ImportError:  # not on this system
    fcntl = None  # type: ignore[assignment]

__all__ = ["FileLock"]

_HELD: Final = (errno.EWOULDBLOCK, errno.EACCES, errno.EAGAIN)
_UNKNOWN: Final = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
"""Errors of file systems without locks."""
_POLL_SECONDS: Final = 0.05


class _HeldError(UsageError):
    """Another process holds the lock, or another render of this one."""


class FileLock:
    """Exclusive right to write a file.

    It is a `flock(2)` on a separate file, ``PATH.lock``, since `PATH` itself is replaced by renaming. The system
    releases the lock when the process ends, so a lock file left by a killed process locks nothing. `release` removes
    the file.

    Parameters
    ----------
    path : Path
        The file to write; links and other spellings of its name share the lock.
    problem : str
        Message if another process holds the lock; it follows the file's name.

    Attributes
    ----------
    works : bool
        Whether the system and the folder support locks. If not, the lock has no effect.
    """

    def __init__(self, path: Path, problem: str) -> None:
        self._named = path
        target = Path(os.path.realpath(path))
        self._path = target.with_name(f"{target.name}.lock")
        self._problem = problem
        self._descriptor: int | None = None
        self.works = fcntl is not None

    def take(self) -> None:
        """Acquire the lock without waiting.

        Raises
        ------
        UsageError
            When another process, or another render of this process, holds it, or no file can be created in the folder.
        """
        if fcntl is None:
            return
        try:
            while not self._taken():
                pass
        except OSError as error:
            raise UsageError(f"{self._path}: cannot be written ({error.strerror or error}); write elsewhere") from None

    def wait(self) -> None:
        """Acquire the lock, however long another process holds it.

        Raises
        ------
        UsageError
            When no file can be created in the folder.
        """
        while True:
            with suppress(_HeldError):
                return self.take()
            time.sleep(_POLL_SECONDS)

    def release(self) -> None:
        """Release the lock. A second call does nothing."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            with suppress(OSError):
                self._path.unlink()  # while it is still locked, so that no other process holds it
            os.close(descriptor)

    def _taken(self) -> bool:
        """Open and lock the file; returns False if its previous owner has just removed it."""
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            owner = os.read(descriptor, 40).decode("ascii", "replace").strip()
            os.close(descriptor)
            if error.errno in _HELD:
                raise _HeldError(f"{self._named}: {self._problem} (process {owner or 'unknown'})") from None
            if error.errno not in _UNKNOWN:
                raise
            self.works = False
            return True
        try:
            same = os.path.samestat(os.fstat(descriptor), self._path.stat())
        except FileNotFoundError:
            same = False
        if not same:
            os.close(descriptor)
            return False
        self._descriptor = descriptor
        with suppress(OSError):  # for example a full disk; the contents serve only messages
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode())
        return True
