"""A message for the case that the process dies without printing one: inside a driver, or killed."""

from __future__ import annotations

import contextlib
import os
import subprocess
from typing import Final

__all__ = ["CrashMessage"]

_SENTENCE: Final = (
    "error: the process was terminated by a crash in an OpenCL driver, by lack of memory or by another process; no "
    "image was written (`--resume` continues from a checkpoint); `clrender doctor` checks the drivers, `--device` "
    "selects another"
)
# `read` fails at the end of its input, which comes when the process at the other end is gone.
_WAIT: Final = 'trap "" INT TERM HUP; read -r word || printf "\\n%s\\n" "$0" >&2'


class CrashMessage:
    """A shell that waits for the end of this process and then prints a message, unless it was cancelled before.

    A driver is native code: if it crashes, no Python code runs any more.
    """

    def __init__(self) -> None:
        reader, self._writer = os.pipe()
        self._shell: subprocess.Popen[bytes] | None = None
        try:
            # In a separate session, so that Ctrl-C at the terminal does not reach it.
            command = ["/bin/sh", "-c", _WAIT, _SENTENCE]
            self._shell = subprocess.Popen(command, stdin=reader, stdout=subprocess.DEVNULL, start_new_session=True)
        except OSError:
            pass  # without a shell there is no message
        finally:
            os.close(reader)

    def cancel(self) -> None:
        """Cancel the message. It may be called repeatedly, and by any thread."""
        shell, self._shell = self._shell, None
        if shell is not None:
            with contextlib.suppress(OSError):
                os.write(self._writer, b"\n")
            os.close(self._writer)
            shell.wait()
