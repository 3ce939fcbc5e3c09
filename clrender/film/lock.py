"""A lock beside a file that only one process may write, which ends with its process, however that ends."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path
from typing import Final

from clrender.errors import UsageError

try:
    import fcntl
except ImportError:  # a system without
    fcntl = None  # type: ignore[assignment]

__all__ = ["FileLock"]

_HELD: Final = (errno.EWOULDBLOCK, errno.EACCES, errno.EAGAIN)
_UNKNOWN: Final = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
"""What file systems say that know no locks."""


class FileLock:
    """The right to write a file, for one at a time.

    It is `flock(2)` on a file of its own, ``PATH.lock``, since `PATH` itself is replaced by renaming. The system takes
    it back when the process ends, so that a lock file that is left behind by a kill locks nothing; whoever ends well
    removes it.

    Parameters
    ----------
    path : Path
        The file that is written; links and other spellings of its name have the same lock.
    problem : str
        What the message says when another process has it: goes on from the file's name.

    Attributes
    ----------
    works : bool
        Whether this system and folder know locks. Where not, nobody is kept out.
    """

    def __init__(self, path: Path, problem: str) -> None:
        self._named = path
        target = Path(os.path.realpath(path))
        self._path = target.with_name(f"{target.name}.lock")
        self._problem = problem
        self._descriptor: int | None = None
        self.works = fcntl is not None

    def take(self) -> None:
        """Take the lock, without waiting.

        Raises
        ------
        UsageError
            Another process, or another render of this one, has it; or the folder takes no files.
        """
        if fcntl is None:
            return
        try:
            while not self._taken():
                pass
        except OSError as error:
            raise UsageError(f"{self._path}: cannot be written ({error.strerror or error}); write elsewhere") from None

    def release(self) -> None:
        """Give it back. A second call does nothing."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            with suppress(OSError):
                self._path.unlink()  # while it is locked: nobody else can have it yet
            os.close(descriptor)

    def _taken(self) -> bool:
        """Open and lock the file; not, where whoever had it before has just removed it."""
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            owner = os.read(descriptor, 40).decode("ascii", "replace").strip()
            os.close(descriptor)
            if error.errno in _HELD:
                raise UsageError(f"{self._named}: {self._problem} (process {owner or 'unknown'})") from None
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
        with suppress(OSError):  # a full disk; it is for messages alone
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode())
        return True
