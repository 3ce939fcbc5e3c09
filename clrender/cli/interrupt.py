"""Ctrl-C and SIGTERM: the first asks a render to stop and keep its image, the second ends the program."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from clrender.cli.crash_message import CrashMessage
from clrender.files.access import remove_temporaries

__all__ = ["INTERRUPTED", "TERMINATED", "Interrupt", "Terminated", "interruptible", "terminable"]

INTERRUPTED = 130
"""Exit code of a program ended by SIGINT (Ctrl-C)."""
TERMINATED = 143
"""Exit code of a program ended by SIGTERM."""

_PATIENCE = 0.6
"""Seconds that the program has to notice a signal before there is an image to keep."""


class Terminated(KeyboardInterrupt):
    """SIGTERM was received in a block of `terminable`."""


class Interrupt:
    """Whether the user has requested a stop.

    Attributes
    ----------
    has_picture : threading.Event
        Set by the renderer when there are samples worth keeping. Before that, a signal ends the program even in the
        middle of a compilation.
    exit_code : int
        Exit code of a program that ends because of the first signal.
    crash_message : CrashMessage
        Printed if a driver kills the process.
    """

    def __init__(self) -> None:
        self.has_picture = threading.Event()
        self.exit_code = INTERRUPTED
        self._wanted = threading.Event()
        self.crash_message = CrashMessage()

    def wanted(self) -> bool:
        """True from the first signal on."""
        return self._wanted.is_set()

    def take(self, number: int) -> None:
        """Handle a signal, by its number; called outside the main thread."""
        if self._wanted.is_set():
            self._end("interrupted twice; nothing more was written")
        self.exit_code = TERMINATED if number == signal.SIGTERM else INTERRUPTED
        self._wanted.set()
        # On a separate thread, so that the second signal is handled during the waiting time of the first.
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        if not self.has_picture.wait(_PATIENCE):
            self._end("interrupted before the first sample; nothing was written")

    def _end(self, message: str) -> None:
        """Exit at once, whatever the main thread is doing."""
        remove_temporaries()
        # Not imported here: the main thread may be importing it right now.
        leave = getattr(sys.modules.get("clrender.device.program_cache"), "leave", None)
        if leave is not None:
            leave()
        self.crash_message.cancel()
        sys.stderr.write(f"\nerror: {message}\n")
        sys.stderr.flush()
        os._exit(self.exit_code)


@contextmanager
def terminable() -> Iterator[None]:
    """Convert SIGTERM to `Terminated` while the block runs, so that clean-up code runs; only in the main thread."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def end(_number: int, _frame: FrameType | None) -> None:
        raise Terminated

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextmanager
def interruptible() -> Iterator[Interrupt]:
    """Convert SIGINT and SIGTERM to an `Interrupt` while the block runs; only in the main thread.

    Python runs its signal handlers in the main thread between two instructions, so not while that thread waits for a
    device. But the interpreter writes each signal's number to a socket at once, where another thread reads it.
    """
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        try:
            yield interrupt
        finally:
            interrupt.crash_message.cancel()
        return
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    # A signal that is ignored (a job in the background of a shell script) stays ignored.
    caught = [s for s in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(s) is not signal.SIG_IGN]

    def listen() -> None:
        while data := reader.recv(1):
            if data[0] in caught:
                interrupt.take(data[0])

    def python_handler(_number: int, _frame: FrameType | None) -> None:
        """Do nothing; only signals with a Python handler are written to the socket."""

    previous_descriptor = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    previous = {s: signal.signal(s, python_handler) for s in caught}
    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        yield interrupt
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(previous_descriptor)
        interrupt.has_picture.set()
        interrupt.crash_message.cancel()
        writer.close()
        listener.join()
        reader.close()
