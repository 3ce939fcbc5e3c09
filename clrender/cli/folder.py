"""Output folder of a command."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from clrender.errors import UsageError
from clrender.files.access import check_writable

__all__ = ["output_folder"]


@contextmanager
def output_folder(folder: Path, first: str) -> Iterator[None]:
    """Create the folder; it is removed again if the block fails while it is empty.

    Parameters
    ----------
    folder : Path
    first : str
        A file that will be written there, to check that it can be written.

    Raises
    ------
    UsageError
        When the folder cannot be created, or the file cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder}: is a file; name a folder.")
    new = not folder.exists()
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be made ({error.strerror}); name a folder in one that exists.") from None
    try:
        check_writable(folder / first)
        yield
    except BaseException:
        if new:
            with suppress(OSError):
                folder.rmdir()
        raise
