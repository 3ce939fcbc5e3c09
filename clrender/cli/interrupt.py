"""Ctrl-C, SIGTERM and SIGHUP: the first one asks a render to stop and keep its image, the second ends the program.

Outside of renders a signal raises an exception, so that clean-up code runs. Python drops an exception that is raised
within a finalizer or a callback of the garbage collector, and a library may catch it; then the program is ended without
clean-up code.
"""

from __future__ import annotations

import _thread
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import NoReturn

from clrender.cli.crash_message import CrashMessage
from clrender.files.access import remove_temporaries

__all__ = ["ENDING", "Interrupt", "Terminated", "exit_code_of", "interruptible", "raising_signals"]

INTERRUPTED = 130
"""Exit code of a program ended by SIGINT (Ctrl-C). That of other signals is 128 and their number, too."""
ENDING = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))
"""Signals that end a program. SIGHUP comes when a terminal is closed, as by the loss of a connection by ssh."""
_HANGUP = getattr(signal, "SIGHUP", None)
"""Never the second signal that ends at once: both the shell and the system send it when a terminal is closed."""

_LOST = "interrupted; nothing was written"
_PATIENCE = 0.6
"""Seconds that the program has to notice a signal before there is an image to keep."""
_SLOW = 1.5
"""Seconds after which a stop that has an image to keep takes so long that the user is told what to do about it."""
_CLEAN_UP = 10.0
"""Seconds from the exception that a signal raises to the end of the command; views wait 5 s for a file or a device."""


class Terminated(KeyboardInterrupt):
    """SIGTERM or SIGHUP was received in a block of `raising_signals`.

    Attributes
    ----------
    exit_code : int
        Exit code of a program ended by the signal.
    """

    exit_code = 128 + signal.SIGTERM


class HungUp(Terminated):
    """SIGHUP was received in a block of `raising_signals`."""

    exit_code = 129


def exit_code_of(error: BaseException | type[BaseException] | None) -> int:
    """Exit code of a program that an exception of `raising_signals`, or one of its class, ends."""
    kind = error if isinstance(error, type) else type(error)
    return kind.exit_code if issubclass(kind, Terminated) else INTERRUPTED


class Interrupt:
    """Whether the user has requested a stop.

    Parameters
    ----------
    tells : bool
        Whether to tell on stderr, in plain words, that a stop takes long.
    lost : str
        What is said where there is nothing to keep.

    Attributes
    ----------
    lost : str
        As above; it may change with the work.
    has_picture : threading.Event
        Set by the renderer when there are samples worth keeping. Before that, a signal ends the program even in the
        middle of a compilation.
    exit_code : int
        Exit code of a program that ends because of the first signal.
    ended : threading.Event
        Set at the end of the block.
    crash_message : CrashMessage
        Printed if a driver kills the process.
    """

    def __init__(self, *, tells: bool = False, lost: str = _LOST) -> None:
        self.lost = lost
        self.has_picture = threading.Event()
        self.exit_code = INTERRUPTED
        self.ended = threading.Event()
        self._tells = tells
        self._wanted = threading.Event()
        self.crash_message = CrashMessage()

    def wanted(self) -> bool:
        """True from the first signal on."""
        return self._wanted.is_set()

    def take(self, number: int) -> None:
        """Handle a signal, by its number; called outside the main thread."""
        if self._wanted.is_set():
            if number == _HANGUP:
                return
            self._end("interrupted twice; nothing more was written")
        self.exit_code = 128 + number
        self._wanted.set()
        # On a separate thread, so that the second signal is handled during the waiting time of the first.
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        if not self.has_picture.wait(_PATIENCE):
            self._end(self.lost)
        # No call of a driver can be broken off, such as that of a compiler; and while it lasts, the device may hold
        # samples that belong to the image.
        if self._tells and not self.ended.wait(_SLOW):
            what = "stopping as soon as the driver lets go of the device"
            sys.stderr.write(f"\n{what}; interrupt again to end at once, without what is not written yet\n")
            sys.stderr.flush()

    def _end(self, message: str) -> NoReturn:
        self.crash_message.cancel()
        _leave(message, self.exit_code)


def _leave(message: str, exit_code: int) -> NoReturn:
    """Exit at once, whatever the main thread is doing, and even if it is writing to stderr in this very moment."""
    try:
        remove_temporaries()
        # Not imported here: the main thread may be importing it right now.
        for name in ("clrender.device.program_cache", "clrender.cluster.local"):
            leave = getattr(sys.modules.get(name), "leave", None)
            if leave is not None:
                leave()
        sys.stderr.write(f"\nerror: {message}\n")
        sys.stderr.flush()
    finally:
        os._exit(exit_code)


@contextmanager
def raising_signals() -> Iterator[None]:
    """Convert SIGINT to KeyboardInterrupt, SIGTERM and SIGHUP to `Terminated` in the block; only in the main thread.

    The block must end soon after the exception, or the process is ended: at once if Python reports that it dropped the
    exception, otherwise after some seconds.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    done, raised = threading.Event(), threading.Event()

    def watch(exit_code: int) -> None:
        if not done.wait(_CLEAN_UP):
            _leave("interrupted.", exit_code)

    def handle(number: int, _frame: FrameType | None) -> None:
        if raised.is_set() and number == _HANGUP:
            return
        raised.set()
        # A `threading.Thread` takes locks that the interrupted code may hold.
        with suppress(RuntimeError):
            _thread.start_new_thread(watch, (128 + number,))
        raise {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated}.get(signal.Signals(number), HungUp)

    def dropped(unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            _leave("interrupted.", exit_code_of(unraisable.exc_type))
        report(unraisable)

    report = sys.unraisablehook
    with _handlers(handle):
        sys.unraisablehook = dropped
        try:
            yield
        finally:
            sys.unraisablehook = report
            done.set()


@contextmanager
def _handlers(handler: Callable[[int, FrameType | None], None]) -> Iterator[list[signal.Signals]]:
    """Handle the signals that end a program by a function while the block runs, which is given those not ignored.

    A signal that is ignored (a job in the background of a shell script, or one of `nohup`) stays ignored.
    """
    caught = [s for s in ENDING if signal.getsignal(s) not in (signal.SIG_IGN, None)]
    previous = {s: signal.signal(s, handler) for s in caught}
    try:
        yield caught
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


@contextmanager
def interruptible(*, tells: bool = False, lost: str = _LOST) -> Iterator[Interrupt]:
    """Convert SIGINT, SIGTERM and SIGHUP to an `Interrupt` while the block runs; only in the main thread.

    Python runs its signal handlers in the main thread between two instructions, so not while that thread waits for a
    device. But the interpreter writes each signal's number to a socket at once, where another thread reads it.
    For `tells` and `lost` see `Interrupt`.
    """
    interrupt = Interrupt(tells=tells, lost=lost)
    if threading.current_thread() is not threading.main_thread():
        try:
            yield interrupt
        finally:
            interrupt.crash_message.cancel()
        return
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def listen(caught: Sequence[int]) -> None:
        while data := reader.recv(1):
            if data[0] in caught:
                interrupt.take(data[0])

    def python_handler(_number: int, _frame: FrameType | None) -> None:
        """Do nothing; only signals with a Python handler are written to the socket."""

    previous_descriptor = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    listener = None
    try:
        with _handlers(python_handler) as caught:
            listener = threading.Thread(target=listen, args=(caught,), daemon=True)
            listener.start()
            yield interrupt
    finally:
        signal.set_wakeup_fd(previous_descriptor)
        interrupt.ended.set()
        interrupt.has_picture.set()
        interrupt.crash_message.cancel()
        writer.close()
        if listener is not None:
            listener.join()
        reader.close()
