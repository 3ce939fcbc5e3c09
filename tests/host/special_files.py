"""Names in a folder behind which no regular file lies."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

__all__ = ["special"]


@contextmanager
def special(path: Path, kind: str) -> Iterator[None]:
    """Put a pipe, a socket, a device or a folder there; whoever waits for it for ten seconds fails."""

    def hangs(number: int, frame: FrameType | None) -> None:
        raise AssertionError(f"reading a {kind} hangs")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(10)
    here = Path.cwd()
    listener = socket.socket(socket.AF_UNIX)
    try:
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "socket":
            os.chdir(path.parent)  # names of sockets are short
            listener.bind(path.name)
        elif kind == "device":
            path.symlink_to("/dev/zero")
        else:
            path.mkdir()
        yield
    finally:
        os.chdir(here)
        listener.close()
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
