"""Safe standard streams, which may be closed, on a full disk, or without a reader."""

from __future__ import annotations

import io
import os
import sys
import warnings
from contextlib import suppress
from typing import Any, Final

import click

from clrender.errors import ClrenderError

__all__ = ["OutputError", "ReaderLeft", "guard_streams", "tell"]

_STDOUT: Final = 1
_STDERR: Final = 2


class OutputError(ClrenderError):
    """Standard output cannot be written."""

    exit_code = 1


class ReaderLeft(Exception):
    """The reader of the output has closed the pipe; this is no error."""


def tell(line: str) -> None:
    """Print a line of a command that has more to do, or whose exit code says more, whether anyone reads it or not."""
    with suppress(ReaderLeft):
        click.echo(line)


def guard_streams() -> None:
    """Make the standard streams safe to write to; called once, when the program starts.

    A closed stream is redirected to the null device, so that no file that is opened later gets its descriptor. Failed
    writes to stdout raise `OutputError` or `ReaderLeft`. Failed writes to stderr are ignored: a render continues
    without its progress.
    """
    for descriptor in (0, _STDOUT, _STDERR):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the system assigns the lowest free descriptor: this one
    sys.stdout = _Output(_STDOUT, sys.stdout)
    sys.stderr = _Messages(_STDERR, sys.stderr)
    if not sys.warnoptions:
        # Warnings are for developers; users get errors and notices.
        warnings.simplefilter("ignore")


class _Guarded(io.TextIOWrapper):
    """A replacement for a stream that Python opened."""

    def __init__(self, descriptor: int, opened: Any) -> None:
        buffer = opened.buffer if opened is not None else open(descriptor, "wb", closefd=False)  # noqa: SIM115
        encoding = "utf-8" if opened is None or opened.encoding == "ascii" else opened.encoding
        # File names may contain bytes that cannot be encoded: they are written as escapes.
        super().__init__(buffer, encoding, "backslashreplace", line_buffering=descriptor == _STDERR)
        self._descriptor = descriptor

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError as error:
            self._fail(error)
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        # Discard the rest of the buffers, or Python would report an error again at exit.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._descriptor)
        os.close(nowhere)


class _Output(_Guarded):
    def _fail(self, error: OSError) -> None:
        super()._fail(error)
        if isinstance(error, BrokenPipeError):
            raise ReaderLeft from None
        raise OutputError(f"standard output cannot be written ({error.strerror})") from None


class _Messages(_Guarded):
    pass
