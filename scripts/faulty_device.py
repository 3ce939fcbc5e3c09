"""Fault injection for tests and `scripts/gpu_check`: a device whose driver calls fail when and how they are told to."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from clrender.device.device import Buffer, Device
from clrender.device.program_cache import Sentinel

__all__ = ["CALLS", "Fault", "FaultyDevice", "Lie"]

_T = TypeVar("_T")

CALLS: Final = ("build", "allocate", "write", "launch", "read", "finish")
"""Kinds of driver calls."""

_PATIENCE: Final = 120.0
"""Seconds that a device waits for the first lie of another; a unit takes less than one."""
_SAYS: Final = {
    "build": "clBuildProgram failed: OUT_OF_HOST_MEMORY",
    "allocate": "clCreateBuffer failed: MEM_OBJECT_ALLOCATION_FAILURE",
    "write": "clEnqueueWriteBuffer failed: OUT_OF_RESOURCES",
    "launch": "clEnqueueNDRangeKernel failed: OUT_OF_RESOURCES",
    "read": "clEnqueueReadBuffer failed: OUT_OF_HOST_MEMORY",
    "finish": "clFinish failed: OUT_OF_RESOURCES",
}


@dataclass
class Fault:
    """A fault: which driver calls fail, and how.

    Attributes
    ----------
    call : str
        One of `CALLS`.
    after : int
        Number of calls of this kind that succeed before.
    how : str
        ``error``: the driver returns an error; ``hang``: it does not return until `released`, and then fails;
        ``gone``: this call and all others after it fail.
    times : int
        Number of consecutive calls that fail; later ones succeed.
    met : int
        Number of calls that failed so far.
    released : threading.Event
        Lets calls that hang return.
    """

    call: str
    after: int = 0
    how: str = "error"
    times: int = 1
    met: int = 0
    released: threading.Event = field(default_factory=threading.Event)
    _seen: int = 0
    _first: threading.Event = field(default_factory=threading.Event)

    def wait(self) -> None:
        """Wait for the first call that fails."""
        if not self._first.wait(_PATIENCE):
            raise TimeoutError("no call failed")

    def meets(self, kind: str) -> bool:
        """Count a call, and return whether it fails."""
        if self.how == "gone" and self.met:
            self.met += 1
            return True
        if kind != self.call:
            return False
        self._seen += 1
        hit = self.after < self._seen and (self.how == "gone" or self._seen <= self.after + self.times)
        self.met += hit
        if hit:
            self._first.set()
        return hit


@dataclass
class Lie:
    """Silent errors: which results are wrong without an error of the driver.

    Attributes
    ----------
    share : float
        Fraction of the units with wrong sums.
    blocks : float
        Fraction of the blocks of such a unit that have a wrong pixel; at least one block.
    constant : bool
        Whether the error is always the same, like that of a miscompiled program, or varies, like that of broken
        hardware.
    after : int
        Number of reads of sums that are correct before.
    told : int
        Number of wrong reads so far.
    """

    share: float = 1.0
    blocks: float = 1.0
    constant: bool = False
    after: int = 0
    told: int = 0
    seed: int = 0
    _seen: int = 0

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)
        self._first = threading.Event()

    def wait(self) -> None:
        """Wait for the first wrong read."""
        if not self._first.wait(_PATIENCE):
            raise TimeoutError("no wrong results were read")

    def change(self, array: npt.NDArray[Any]) -> None:
        """Corrupt sums, (slots, 3, 4) uint32; leave other arrays unchanged."""
        if not _holds_sums(array):
            return
        self._seen += 1
        if self._seen <= self.after or self._random.random() >= self.share:
            return
        self.told += 1
        self._first.set()
        blocks = len(array) // 16
        chosen = range(blocks)
        if self.blocks < 1.0:
            chosen = self._random.sample(chosen, max(1, round(self.blocks * blocks)))  # type: ignore[assignment]
        for block in chosen:
            slot = 16 * block + (3 if self.constant else self._random.randrange(16))
            array[slot, 1, 2] ^= np.uint32(1 if self.constant else 1 << self._random.randrange(8))


def _holds_sums(array: npt.NDArray[Any]) -> bool:
    return array.ndim == 3 and array.shape[1:] == (3, 4)


class FaultyDevice(Device):
    """A real device with injected faults. It shares the real one's context, but not its programs and buffers.

    Parameters
    ----------
    device : Device
    *faults : Fault or Lie
    name : str, optional
        Name in messages.
    waits_for : Fault or Lie, optional
        Another device's, which has to come before this device returns sums: on a busy machine one of several devices
        may otherwise have no work left.
    """

    def __init__(
        self, device: Device, *faults: Fault | Lie, name: str = "", waits_for: Fault | Lie | None = None
    ) -> None:
        self.__dict__.update(device.__dict__)
        self._programs, self._buffers, self._held_bytes = {}, {}, 0
        self._sentinel = Sentinel()
        self.faults = [each for each in faults if isinstance(each, Fault)]
        self._waits_for = waits_for
        self.lies = [each for each in faults if isinstance(each, Lie)]
        if name:
            self.info = replace(device.info, name=name)

    def _call(self, kind: str, what: str, function: Callable[[], _T]) -> _T:
        met = [each for each in self.faults if each.meets(kind)]
        return super()._call(kind, what, lambda: self._fail(kind, met[0]) if met else function())

    def _fail(self, kind: str, fault: Fault) -> Any:
        if fault.how == "hang":
            fault.released.wait()
        raise self._cl.RuntimeError(_SAYS.get(kind, "INVALID_CONTEXT"))

    def read(self, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        """Read as from the real device, and then apply the silent errors."""
        super().read(buffer, array)
        if self._waits_for is not None and _holds_sums(array):
            self._waits_for.wait()
        for lie in self.lies:
            lie.change(array)
