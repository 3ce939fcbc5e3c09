"""Compiles programs in a child process while this one renders, as a driver's compiler may hold up its launches."""

from __future__ import annotations

import threading
from dataclasses import asdict
from typing import TYPE_CHECKING, Final

from clrender.drivers.discover import drivers
from clrender.drivers.probe import ask_child

if TYPE_CHECKING:
    from clrender.device.compilation import Compilation
    from clrender.device.info import DeviceInfo

__all__ = ["compile_aside"]

_SECONDS: Final = 600.0
"""Time limit of a compilation."""
_ONE_AT_A_TIME: Final = threading.Lock()


class _Child:
    """A compilation in a child process, which ends with this one."""

    def __init__(self, info: DeviceInfo, compilation: Compilation) -> None:
        self._request = {"ordinal": info.ordinal, "library": info.library, "compilation": asdict(compilation)}
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def ended(self) -> bool:
        """Whether the child has ended, in any way."""
        return not self._thread.is_alive()

    def _run(self) -> None:
        library = self._request.pop("library")
        try:
            driver = next((each for each in drivers() if each.library == library), None)
            if driver is not None:
                ask_child({"task": "compile", "driver": asdict(driver), **self._request}, _SECONDS)
        finally:
            _ONE_AT_A_TIME.release()


def compile_aside(info: DeviceInfo, compilation: Compilation) -> _Child | None:
    """Begin to compile a program for a device, so that the driver's cache has it.

    Parameters
    ----------
    info : DeviceInfo
    compilation : Compilation

    Returns
    -------
    _Child or None
        None: this process waits for another one already.
    """
    return _Child(info, compilation) if _ONE_AT_A_TIME.acquire(blocking=False) else None
