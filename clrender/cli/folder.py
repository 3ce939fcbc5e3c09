"""A folder for what a command makes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from clrender.errors import UsageError
from clrender.files import check_writable

__all__ = ["output_folder"]


@contextmanager
def output_folder(folder: Path, first: str) -> Iterator[None]:
    """Make the folder; what fails before there is anything in it takes it away again.

    Parameters
    ----------
    folder : Path
    first : str
        A file that will be written there, to see whether that can be done.

    Raises
    ------
    UsageError
        When the folder cannot be made, or the file not be written.
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
