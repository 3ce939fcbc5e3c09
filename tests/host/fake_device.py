"""A device without OpenCL, for host tests: kernels are Python functions, and failures can be injected."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clrender.device.device import BUSY, Buffer, Device, Program, Reading
from clrender.device.info import DeviceInfo
from clrender.errors import DeviceError, RenderError
from clrender.process.exclusive import Turn

__all__ = ["FakeDevice", "FakeKernel"]

FakeKernel = Callable[[int, int, Sequence[Any]], None]
"""Called with global size, local size and arguments; a buffer is passed as a writable (n,) uint8 array."""


class FakeDevice(Device):
    """A substitute for a device on machines without OpenCL.

    Parameters
    ----------
    kernels : mapping, optional
        Functions by kernel name; a kernel without one does nothing.
    name : str
    fail_from : int, optional
        Index of the first launch that fails; all later ones fail too, as on a device that died.
    fail_build : bool
        Whether every build fails.
    seconds : float
        Duration of a launch.
    memory_bytes : int
        Memory of the device; allocations beyond it fail.
    """

    def __init__(
        self,
        kernels: Mapping[str, FakeKernel] | None = None,
        *,
        name: str = "fake",
        fail_from: int | None = None,
        fail_build: bool = False,
        seconds: float = 0.0,
        memory_bytes: int = 2**30,
    ) -> None:
        self.info = DeviceInfo(0, name, "Fake", "1", "cpu", 1, memory_bytes, probe="ok")
        self.is_cpu = True
        self.max_allocation_bytes = memory_bytes
        self.max_work_group = 256
        self.fixes_groups = False
        self._group = 16
        self.options = ""
        self.compile_seconds = 0.0
        self.allocated_bytes = 0
        self.memory_limit = None
        self.launches = 0
        self.builds = 0
        self.turn = Turn(BUSY)
        self.lost = False
        self._calls = 0
        self._compiling = False
        self.kernels = dict(kernels or {})
        self.fail_from = fail_from
        self.fail_build = fail_build
        self.seconds = seconds
        self._held_bytes = 0
        self._buffers: set[Buffer] = set()
        self._programs: dict[Any, Program] = {}

    def program(self, entry: str | Path, defines: Mapping[str, int | str] | None = None) -> Program:
        """Return a program with this name; no file is read."""
        from clrender.device.source import Source

        if self.fail_build:
            raise DeviceError(f"{self.info.title} cannot build {entry}: it was told to fail")
        key = (str(entry), tuple(sorted((name, str(value)) for name, value in (defines or {}).items())))
        if key not in self._programs:
            self.builds += 1
            self._programs[key] = Program(Source(str(entry), "", ""), "", None)
        return self._programs[key]

    def empty(self, nbytes: int) -> Buffer:
        """Create a buffer in host memory, filled with a pattern, as contents are undefined."""
        self._check_size(nbytes)
        if self._held_bytes + nbytes > self.max_allocation_bytes:
            raise RenderError(f"{self.info.title} has no {nbytes} bytes left")
        size = max(nbytes, 16)
        self._held_bytes += size
        self.allocated_bytes = max(self.allocated_bytes, self._held_bytes)
        buffer = Buffer(np.full(size, 0xA5, np.uint8), size)
        self._buffers.add(buffer)
        return buffer

    def release(self, buffer: Buffer) -> None:
        """Count the memory as free."""
        self._buffers.discard(buffer)
        self._held_bytes -= buffer.nbytes

    def launch(
        self,
        program: Program,
        kernel: str,
        global_size: int,
        local_size: int,
        args: Sequence[Buffer | np.generic | npt.NDArray[Any]],
    ) -> None:
        """Call the kernel's function, or fail."""
        number = self.launches
        self.launches += 1
        if self.fail_from is not None and number >= self.fail_from:
            raise RenderError(f"{self.info.title} failed at kernel {kernel}: it was told to fail")
        if global_size % local_size:
            raise RenderError(f"{self.info.title}: {global_size} work-items are no multiple of {local_size}")
        time.sleep(self.seconds)
        if kernel in self.kernels:
            values = [arg.handle if isinstance(arg, Buffer) else arg for arg in args]
            self.kernels[kernel](global_size, local_size, values)

    def read(self, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        """Copy the start of `buffer` into all of `array`."""
        array.reshape(-1).view(np.uint8)[...] = buffer.handle[: array.nbytes]

    def begin_read(self, buffer: Buffer, array: npt.NDArray[Any]) -> Reading:
        """Read at once, as launches are synchronous."""
        self.read(buffer, array)
        return Reading(array, None)

    def end_read(self, reading: Reading) -> None:
        """Do nothing, as the copy is already complete."""

    def write(self, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        """Copy `array` to the start of `buffer`."""
        buffer.handle[: array.nbytes] = np.ascontiguousarray(array).reshape(-1).view(np.uint8)

    def close(self) -> None:
        """Discard the programs."""
        self._programs.clear()

    def finish(self) -> None:
        """Do nothing, as launches are synchronous."""
