"""The files that an exported scene names, and their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final, TypeAlias

from clrender.errors import UsageError
from clrender.files.access import atomic_write

__all__ = ["NamedFiles", "Write", "write_bytes"]

Write: TypeAlias = Callable[[IO[bytes]], None]
"""Writes the content of a file."""
_HASHED: Final = re.compile(r"-[0-9a-f]{8}\Z")


def write_bytes(file: IO[bytes], data: bytes) -> None:
    """Write a whole file."""
    file.write(data)


@dataclass
class NamedFiles:
    """Files of an exported scene.

    Attributes
    ----------
    files : dict of str to callable
        By path relative to the scene file, with ``/``; each writes its content to a binary file.
    """

    files: dict[str, Write] = field(default_factory=dict)
    _digests: dict[str, str] = field(default_factory=dict, repr=False)

    def add(self, folder: str, stem: str, ending: str, digest: str, write: Write) -> str:
        """Add a file; returns its name.

        Parameters
        ----------
        folder : str
        stem : str
            Its letters, digits, ``-`` and ``_`` become part of the name.
        ending : str
        digest : str
            Hash of the content, in hexadecimal: part of the name, so that different contents have different names, and
            the files of scenes exported earlier are kept.
        write : callable
        """
        plain = _HASHED.sub("", re.sub(r"[^A-Za-z0-9_-]+", "-", stem).strip("-").lower()[:60]) or "file"
        name = f"{folder}/{plain}-{digest[:8]}{ending}"
        if self._digests.setdefault(name, digest) != digest:
            name = f"{folder}/{plain}-{digest}{ending}"
        self.files.setdefault(name, write)
        return name

    @contextmanager
    def written(self, output: Path) -> Iterator[None]:
        """Write all files; if this or the block fails, files and folders that are new are removed again.

        Parameters
        ----------
        output : pathlib.Path
            The scene file, to be written in the block.

        Raises
        ------
        UsageError
            They cannot be written.
        """
        made: list[Path] = []
        try:
            for name, write in self.files.items():
                path = output.parent / name
                if not path.parent.exists():
                    path.parent.mkdir()
                    made.append(path.parent)
                if not path.exists():
                    made.append(path)
                with atomic_write(path) as file:
                    write(file)
            yield
        except OSError as error:
            _remove(made)
            raise UsageError(f"{output.stem}-files: cannot be made ({error.strerror}); write elsewhere.") from None
        except BaseException:
            _remove(made)
            raise


def _remove(made: list[Path]) -> None:
    for path in reversed(made):
        with suppress(OSError):
            path.rmdir() if path.is_dir() else path.unlink()
