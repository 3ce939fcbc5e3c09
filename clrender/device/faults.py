"""A device that fails when and how it is told to, for tests: every call of the driver passes through here."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from clrender.device.compiled import Sentinel
from clrender.device.device import Buffer, Device

__all__ = ["CALLS", "Fault", "FaultyDevice", "Lie"]

_T = TypeVar("_T")

CALLS: Final = ("build", "allocate", "write", "launch", "read", "finish")
"""Kinds of calls of a driver."""

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
    """Which calls fail.

    Attributes
    ----------
    call : str
        One of `CALLS`.
    after : int
        So many of its kind succeed before.
    how : str
        ``error``: the driver returns an error; ``hang``: it does not return until `released`, and then fails;
        ``gone``: this call and all others after it fail.
    times : int
        How many calls in a row fail; later ones succeed.
    met : int
        How many did fail.
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

    def meets(self, kind: str) -> bool:
        """Count a call, and say whether it fails."""
        if self.how == "gone" and self.met:
            self.met += 1
            return True
        if kind != self.call:
            return False
        self._seen += 1
        hit = self.after < self._seen and (self.how == "gone" or self._seen <= self.after + self.times)
        self.met += hit
        return hit


@dataclass
class Lie:
    """Which results are wrong, without a word from the driver.

    Attributes
    ----------
    share : float
        Of the units, those with wrong sums.
    blocks : float
        Of the blocks of such a unit, those with a wrong pixel; one at least.
    constant : bool
        Every time the same error, as of a wrong program; else another one each time, as of a broken part.
    after : int
        So many reads of sums are right before.
    told : int
        How many reads came back wrong.
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

    def change(self, array: npt.NDArray[Any]) -> None:
        """Make sums, (slots, 3, 4) uint32, wrong; leave anything else as it is."""
        if array.ndim != 3 or array.shape[1:] != (3, 4):
            return
        self._seen += 1
        if self._seen <= self.after or self._random.random() >= self.share:
            return
        self.told += 1
        blocks = len(array) // 16
        chosen = range(blocks)
        if self.blocks < 1.0:
            chosen = self._random.sample(chosen, max(1, round(self.blocks * blocks)))  # type: ignore[assignment]
        for block in chosen:
            slot = 16 * block + (3 if self.constant else self._random.randrange(16))
            array[slot, 1, 2] ^= np.uint32(1 if self.constant else 1 << self._random.randrange(8))


class FaultyDevice(Device):
    """A real device, seen through faults. It shares the other's context, but none of its programs and buffers.

    Parameters
    ----------
    device : Device
    *faults : Fault or Lie
    name : str, optional
        What messages call it.
    """

    def __init__(self, device: Device, *faults: Fault | Lie, name: str = "") -> None:
        self.__dict__.update(device.__dict__)
        self._programs, self._buffers, self._held_bytes = {}, set(), 0
        self._sentinel = Sentinel()
        self.faults = [each for each in faults if isinstance(each, Fault)]
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
        """As of the real one, but for the lies."""
        super().read(buffer, array)
        for lie in self.lies:
            lie.change(array)
