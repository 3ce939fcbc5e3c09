"""`clrender` and `python -m clrender`: the command line, which Ctrl-C also ends quietly while it is being loaded."""

from __future__ import annotations

import gc
import sys
from typing import Final

__all__ = ["main"]

COLLECT_EVERY: Final = 50_000
"""New objects from one search for garbage to the next: CPython's own 700 search often while modules load, in vain."""


def main() -> None:
    """Load the command line and run it."""
    gc.set_threshold(COLLECT_EVERY)
    try:
        from clrender.cli import main as command
        from clrender.cli.streams import guard_streams

        guard_streams()
        command()
    except KeyboardInterrupt:
        sys.exit(130)
    except SystemExit as end:
        device = sys.modules.get("clrender.device.device")
        if device is not None and isinstance(end.code, int):
            device.leave_lost_devices(end.code)
        raise
    finally:
        # Where Ctrl-C came in code made from a string, as dataclasses make theirs, CPython remembers it although it
        # was caught, and ends the process by the signal in place of the exit code. It forgets when more such code runs.
        exec("")


if __name__ == "__main__":
    main()
