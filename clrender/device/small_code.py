"""The choice between fast code and code that is compiled faster, for a program that does little work."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, TypeAlias

from clrender.device.compiler import program_key
from clrender.device.program_cache import has_run
from clrender.device.source import SMALL_CODE, load_source

if TYPE_CHECKING:
    from collections.abc import Mapping

    from clrender.device.info import DeviceInfo

__all__ = ["FEW_RAYS", "FEW_SAMPLES", "SmallCode"]

_Key: TypeAlias = "tuple[str, tuple[tuple[str, str], ...]]"
FEW_SAMPLES: Final = 1 << 21
"""Samples up to which small code takes no more time in all, compilation included."""
FEW_RAYS: Final = 1 << 25
"""Rays after which a render goes on with fast code, whatever it expected: paths may be long, and split."""


class SmallCode:
    """Which programs of a device are compiled to small code.

    A compiler that is asked for small code inlines less. With PoCL it takes about half the time, and the code, of which
    every result is the same, about a third more. Other drivers have not been measured.

    Parameters
    ----------
    info : DeviceInfo
    options : str
        Options that the device's programs are built with.
    """

    def __init__(self, info: DeviceInfo, options: str) -> None:
        self._info = info
        self._options = options
        self.possible = info.type == "cpu" and "pocl" in info.version.lower()
        self._taken: Counter[_Key] = Counter()
        self._small: dict[_Key, bool] = {}
        self._keys: dict[_Key, str] = {}
        self._there: set[str] = set()

    def macros(self, entry: str, macros: Mapping[str, str], samples: int | None) -> dict[str, str]:
        """Macros to build a program with that is to trace about `samples` more samples.

        For 0 they are those of small code, for None those of fast code. A program that is there as fast code, in the
        cache or in this process, or has traced many samples before, is not compiled to small code.
        """
        if samples == 0:
            return {**macros, SMALL_CODE: "1"}
        key = entry, tuple(sorted(macros.items()))
        if self.wants_fast(entry, macros, samples):
            self._small[key] = False
        elif key not in self._small:
            self._small[key] = not self.is_there(entry, macros)
        return {**macros, SMALL_CODE: "1"} if self._small[key] else dict(macros)

    def wants_fast(self, entry: str, macros: Mapping[str, str], samples: int | None) -> bool:
        """Whether fast code pays for a program that is to trace about `samples` more samples; None: many."""
        key = entry, tuple(sorted(macros.items()))
        self._taken[key] += samples or 0
        return samples is None or self._taken[key] > FEW_SAMPLES

    def is_there(self, entry: str, macros: Mapping[str, str]) -> bool:
        """Whether the program with these macros has been compiled, by this process or an earlier one."""
        program = entry, tuple(sorted(macros.items()))
        if program not in self._keys:  # a render of many units asks before each
            self._keys[program] = program_key(self._info, self._options, load_source(entry, macros))
        key = self._keys[program]
        if key not in self._there and has_run(key):
            self._there.add(key)
        return key in self._there
