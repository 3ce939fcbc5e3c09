"""`clrender` and `python -m clrender`: the command line; Ctrl-C ends it quietly even while modules load."""

from __future__ import annotations

import gc
import os
import signal
import sys
from types import FrameType
from typing import Final

__all__ = ["main"]

COLLECT_EVERY: Final = 50_000
"""Threshold of the garbage collector, in new objects. CPython's 700 runs it often during imports, in vain."""


def main() -> None:
    """Load the command line and run it."""
    gc.set_threshold(COLLECT_EVERY)
    for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)
    try:
        from clrender.cli import main as command
        from clrender.cli.streams import guard_streams
        from clrender.process.heap import return_large_blocks

        return_large_blocks()
        guard_streams()
        command()
    except KeyboardInterrupt:
        sys.exit(130)
    except SystemExit as end:
        device = sys.modules.get("clrender.device.device")
        if device is not None and isinstance(end.code, int):
            device.leave_busy_drivers(end.code)
        raise
    finally:
        # If Ctrl-C interrupts code compiled from a string, as in dataclasses, CPython remembers it although it was
        # caught, and ends the process by the signal instead of the exit code. Running more such code resets this.
        exec("")


def _end(number: int, _frame: FrameType | None) -> None:
    """End the process by a signal. While modules load there is nothing to clean up, and an exception may be lost."""
    os._exit(128 + number)


if __name__ == "__main__":
    main()
