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
_FAILED: Final[set[str]] = set()
"""Compilations that failed in this process; they are not tried again."""


class _Child:
    """A compilation in a child process, which ends with this one."""

    def __init__(self, info: DeviceInfo, compilation: Compilation) -> None:
        self._library = info.library
        self._request = {"task": "compile", "ordinal": info.ordinal, "compilation": asdict(compilation)}
        self._what = _name(info, compilation)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def ended(self) -> bool:
        """Whether the child has ended, in any way."""
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            driver = next((each for each in drivers() if each.library == self._library), None)
            if driver is None or ask_child({**self._request, "driver": asdict(driver)}, _SECONDS).value is None:
                _FAILED.add(self._what)
        finally:
            _ONE_AT_A_TIME.release()


def _name(info: DeviceInfo, compilation: Compilation) -> str:
    return f"{info.title} {compilation.entry} {compilation.macros}"


def compile_aside(info: DeviceInfo, compilation: Compilation) -> _Child | None:
    """Begin to compile a program for a device, so that the driver's cache has it.

    Parameters
    ----------
    info : DeviceInfo
    compilation : Compilation

    Returns
    -------
    _Child or None
        None: this process waits for another one already, or the same has failed before.
    """
    if _name(info, compilation) in _FAILED or not _ONE_AT_A_TIME.acquire(blocking=False):
        return None
    return _Child(info, compilation)
