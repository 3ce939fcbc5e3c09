"""One OpenCL device: context, queue, programs, buffers, launches. It is independent of rendering."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from clrender.device.compiler import build, program_key
from clrender.device.forked import refuse_forked
from clrender.device.info import DeviceInfo
from clrender.device.program_cache import Sentinel, leave, note_run
from clrender.device.registers import register_options
from clrender.device.small_code import SmallCode
from clrender.device.source import SMALL_CODE, Source, load_source
from clrender.errors import DeviceError, DeviceFailure, MemoryRefused, RenderError
from clrender.process.driver_threads import wait_for_driver_threads
from clrender.process.exclusive import Turn
from clrender.process.heap import return_free_pages
from clrender.process.huge_pages import LARGE_BYTES, prefer_large_pages, withdraw_preference

if TYPE_CHECKING:
    import pyopencl as cl

    from clrender.device.compilation import Aside, Compilation

__all__ = ["PROGRAM_LIMIT", "Argument", "Buffer", "Device", "Program", "Reading", "leave_busy_drivers", "whole_warps"]

_T = TypeVar("_T")
_ROUNDED: Final = "-cl-fp32-correctly-rounded-divide-sqrt"
_CORRECTED: Final = "-D CORRECT_DIVIDE=1"
"""Option for GPUs whose divisions and roots are not correctly rounded: ``kernels/core/quotient.h`` corrects them."""
_CPU_GROUP: Final = 16
_GPU_GROUP: Final = 64
"""Least default number of work-items in a group on a GPU, rounded up to whole warps."""
_LEAST_BYTES: Final = 16
"""Of a buffer."""
_WORTH_SHARING: Final = 1 << 16
"""Size, bytes, from which avoiding a copy is worthwhile."""
BUSY: Final = (
    "the device is rendering; a callback of that render cannot use it: open it again, or wait for the render to end"
)
PROGRAM_LIMIT: Final = 64
"""Programs that a device keeps. With PoCL one takes 2 to 9 MB, and 0.2 s to load again from the cache of binaries."""
_COMPILED_SECONDS: Final = 0.5
"""A first launch that took longer compiled the program, and did not load it."""
_EXIT_SECONDS: Final = 0.2
"""To wait, at the exit of a command, for threads that return from a driver."""
_KEPT: Final[list[Any]] = []
"""Objects of lost devices, kept alive because their destructors would call the driver."""


@dataclass(frozen=True, eq=False)
class Buffer:
    """Memory on a device."""

    handle: Any
    nbytes: int


@dataclass(frozen=True, eq=False)
class Reading:
    """A copy in progress from a device to `array`, which must not be used until `Device.end_read`."""

    array: npt.NDArray[Any]
    event: Any


Argument: TypeAlias = "Buffer | np.generic | npt.NDArray[Any]"
"""A kernel argument: a buffer, a number, or an array passed by value, as a vector or a struct."""


class Program:
    """A built program; its kernel objects are created once and kept."""

    def __init__(self, source: Source, options: str, handle: cl.Program | None) -> None:
        self.source = source
        self.options = options
        self.handle = handle
        self.kernels: dict[str, cl.Kernel] = {}
        self.launched: set[tuple[str, int]] = set()

    @cached_property
    def is_small(self) -> bool:
        """Whether it is small code."""
        return f"#define {SMALL_CODE} " in self.source.text


class Device:
    """An OpenCL device ready for work: in-order queue, programs cached by entry and definitions.

    Parameters
    ----------
    info : DeviceInfo
    handle : pyopencl.Device

    Attributes
    ----------
    is_cpu : bool
    max_allocation_bytes : int
        Largest single buffer.
    max_work_group : int
    vector_width : int
        Numbers of single precision that the processor computes at once.
    fixes_groups : bool
        Whether path tracing kernels are compiled for a fixed work-group size.
    compile_seconds : float
        Time spent in the driver's compiler so far, including the first launches of kernels.
    allocated_bytes : int
        Peak memory of all buffers.
    memory_limit : int or None
        Bytes that all its buffers together may take.
    launches, builds : int
        Number of kernel launches and of program builds.
    turn : Turn
        Lock of the threads that share the device; a render holds it.
    on_compile : callable or None
        Called with True when the driver's compiler begins, and with False when it has ended.
    compile_aside : callable or None
        Begins to compile a program in another process, so that this one has it later, and returns the `Aside`; None
        if it cannot now.
    prove_fast : callable or None
        Called before fast code is used, where the device also has small code, with ``path`` for that which traces
        samples, and ``common`` for all other; raises `DeviceError` if the driver compiles it wrongly.
    lost : bool
        Whether a driver call did not return. Further calls might not return either, so none is made.

    Raises
    ------
    DeviceError
        When the driver cannot create a context or a queue.
    """

    def __init__(self, info: DeviceInfo, handle: cl.Device) -> None:
        import pyopencl as cl

        self._cl = cl
        self._handle = handle
        self.info = info
        self.is_cpu = info.type == "cpu"
        self.fixes_groups = not self.is_cpu
        self._group = _CPU_GROUP if self.is_cpu else 0
        try:
            self._context, self._queue = self._opened()
            self.max_allocation_bytes = int(handle.max_mem_alloc_size)
            self.max_work_group = int(handle.max_work_group_size)
            self.vector_width = int(handle.native_vector_width_float)
            rounded = int(handle.single_fp_config) & int(cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT)
        except cl.Error as error:
            raise DeviceError(
                f"{info.title} lists itself but cannot be opened ({error}); see `clrender doctor`"
            ) from error
        # Options that change the rounding would make results differ between drivers.
        # -w: some drivers write warnings to the user's stderr.
        # CPUs round divisions and roots correctly, even if their driver does not promise it (rusticl).
        self.options = " ".join(
            ["-cl-std=CL1.2 -w", _ROUNDED if rounded else "" if self.is_cpu else _CORRECTED]
        ).strip()
        if "oclgrind" in info.platform.lower():
            self.options += " -cl-opt-disable"  # the interpreter does not support all of its optimizer's output
        self.compile_seconds = 0.0
        self.allocated_bytes = 0
        self.memory_limit: int | None = None
        self.launches = 0
        self.builds = 0
        self.turn = Turn(BUSY)
        self.on_compile: Callable[[bool], None] | None = None
        self.compile_aside: Callable[[Compilation], Aside | None] | None = None
        self.prove_fast: Callable[[str], None] | None = None
        self._fast_common: bool | None = None
        self.lost = False
        self._calls = 0
        self._compiling = False
        self._held_bytes = 0
        self._buffers: dict[Buffer, object] = {}  # by their owners
        self._owner: object = None
        self._large: dict[cl.Buffer, int] = {}  # addresses of buffers on huge pages
        self._sentinel = Sentinel()
        self._programs: dict[tuple[str, tuple[tuple[str, str], ...]], Program] = {}
        self._small_code = SmallCode(info, self.options)

    def _opened(self) -> tuple[cl.Context, cl.CommandQueue]:
        context = self._cl.Context([self._handle])
        profiling = self._cl.command_queue_properties.PROFILING_ENABLE
        return context, self._cl.CommandQueue(context, self._handle, properties=profiling)

    def reopen(self) -> None:
        """Discard context, programs and buffers, and create a new context, as the old one may be unusable.

        Raises
        ------
        DeviceFailure
            When the driver cannot create another.
        """
        self._programs.clear()
        self.release_but(())
        self._context, self._queue = self._call("open", "opening it again", self._opened)

    def lose(self) -> None:
        """Mark the device as lost after a driver call did not return; the driver is not called again."""
        self.lost = True
        _KEPT.append(self)

    def pulse(self) -> tuple[int, bool]:
        """Number of driver calls begun or ended so far, and whether the compiler is running.

        Any thread may read it. If it does not change, a call has not returned.
        """
        return self._calls, self._compiling

    @property
    def compiles_small_code(self) -> bool:
        """Whether programs that trace few samples are compiled in less time, to slower code."""
        return self._small_code.possible

    def program(
        self, entry: str | Path, defines: Mapping[str, int | str] | None = None, samples: int | None = None
    ) -> Program:
        """Build a kernel file, or return the program of an earlier call, if it is among the last `PROGRAM_LIMIT` used.

        Parameters
        ----------
        entry : str or Path
            Name below the kernels folder, or an absolute path.
        defines : mapping, optional
            Macros set before the first line.
        samples : int, optional
            About how many samples the program is to trace. For few it may be compiled in less time, to slower code with
            the same results; for 0 it is wherever the device can. By default it is compiled to fast code.

        Raises
        ------
        RenderError
            When a source file is missing.
        DeviceError
            When the driver's compiler rejects the program; the message has its first errors.
        """
        macros = {name: str(value) for name, value in (defines or {}).items()}
        if self.compiles_small_code:
            macros = self._small_code.macros(str(entry), macros, samples)
        key = (str(entry), tuple(sorted(macros.items())))
        program = self._programs.pop(key, None)
        if program is None:
            program = self._build(load_source(entry, macros), register_options(self.info, str(entry), macros))
        self._programs[key] = program  # behind all that were used before
        if len(self._programs) > PROGRAM_LIMIT:
            del self._programs[next(iter(self._programs))]
        return program

    def common_program(self, *, large: bool = False) -> Program:
        """The program of the kernels that every render needs besides its integrator (``kernels/common.cl``).

        Where it can be, it is small code, until something large is asked for, or if fast code was compiled before.

        Parameters
        ----------
        large : bool
            Whether so much is to be done that fast code pays; from then on it is used for all.

        Raises
        ------
        RenderError, DeviceError
            See `program`; or the driver compiles fast code wrongly.
        """
        macros = {"LANES": 1}
        if not self.compiles_small_code:
            return self.program("common.cl", macros)
        if not self._fast_common and (large or (self._fast_common is None and self.has_program("common.cl", macros))):
            self._fast_common = True
            if self.prove_fast is not None:
                try:
                    self.prove_fast("common")
                except BaseException:
                    self._fast_common = False
                    raise
        self._fast_common = bool(self._fast_common)
        return self.program("common.cl", macros, None if self._fast_common else 0)

    def has_program(self, entry: str, defines: Mapping[str, int | str], *, small: bool = False) -> bool:
        """Whether `program` need not compile a program: it was compiled by this process or an earlier one.

        Only known where small code is possible.

        Parameters
        ----------
        entry, defines
            See `program`.
        small : bool
            Whether small code is meant.
        """
        macros = {name: str(value) for name, value in defines.items()} | ({SMALL_CODE: "1"} if small else {})
        kept = self._programs.get((entry, tuple(sorted(macros.items()))))
        return (kept is not None and bool(kept.launched)) or self._small_code.is_there(entry, macros)

    def wants_fast(self, entry: str, defines: Mapping[str, int | str], samples: int | None) -> bool:
        """Whether fast code pays for a program that is to trace about `samples` more samples; None: many."""
        return self._small_code.wants_fast(entry, {name: str(value) for name, value in defines.items()}, samples)

    def _build(self, source: Source, more_options: str) -> Program:
        begin = time.perf_counter()
        self._set_compiling(True)
        try:
            try:
                program = self._built(source, f"{self.options} {more_options}".strip())
            except DeviceError:
                if not more_options:
                    raise
                program = self._built(source, self.options)  # an older driver does not know them
        finally:
            self._set_compiling(False)
            self.compile_seconds += time.perf_counter() - begin
        self.builds += 1
        return program

    def _built(self, source: Source, options: str) -> Program:
        self._sentinel.put(program_key(self.info, options, source))
        what = f"building {source.entry}"
        handle = self._call("build", what, lambda: build(self._context, self._handle, self.info, options, source))
        return Program(source, options, handle)

    def _set_compiling(self, compiling: bool) -> None:
        self._compiling = compiling
        if self.on_compile is not None:
            self.on_compile(compiling)

    def upload(self, array: npt.NDArray[Any]) -> Buffer:
        """Create a buffer with a copy of `array`.

        Raises
        ------
        RenderError
            When the device lacks the memory.
        """
        if self.is_cpu and _LEAST_BYTES <= array.nbytes < LARGE_BYTES:
            # One call that waits for no queue: an eighth of the time of two
            self._check_size(array.nbytes)
            flags = self._cl.mem_flags.READ_WRITE | self._cl.mem_flags.COPY_HOST_PTR
            what = f"a write of {_mib(array.nbytes)}"
            make = partial(self._cl.Buffer, self._context, flags, hostbuf=array)
            return self._held(self._call("write", what, make), array.nbytes)
        buffer = self.empty(array.nbytes)
        self.write(buffer, array)
        return buffer

    def share(self, array: npt.NDArray[Any]) -> Buffer:
        """Create a read-only buffer with `array`; a CPU's driver may use the host memory directly, without a copy.

        The array must not change while the buffer is in use.

        Raises
        ------
        RenderError
            See `empty`.
        """
        if not self.is_cpu or array.nbytes < _WORTH_SHARING or "oclgrind" in self.info.platform.lower():
            return self.upload(array)
        self._check_size(array.nbytes)
        flags = self._cl.mem_flags.READ_ONLY | self._cl.mem_flags.USE_HOST_PTR
        handle = self._call(
            "allocate",
            f"a buffer of {_mib(array.nbytes)}",
            lambda: self._cl.Buffer(self._context, flags, hostbuf=array),
        )
        return self._held(handle, array.nbytes)

    def empty(self, nbytes: int) -> Buffer:
        """Create a buffer of `nbytes` bytes with undefined contents.

        Raises
        ------
        RenderError
            When it is larger than the device allows, or the device lacks the memory.
        """
        self._check_size(nbytes)
        size = max(nbytes, _LEAST_BYTES)  # OpenCL has no empty buffers
        return self._held(self._call("allocate", f"a buffer of {_mib(size)}", lambda: self._create(size)), size)

    @property
    def free_bytes(self) -> float:
        """Bytes that buffers may still take within the memory limit; infinite without a limit."""
        return math.inf if self.memory_limit is None else max(0, self.memory_limit - self._held_bytes)

    def _check_size(self, nbytes: int) -> None:
        if nbytes > self.max_allocation_bytes:
            raise RenderError(
                f"{self.info.title} allows {_mib(self.max_allocation_bytes)} in one buffer, {_mib(nbytes)} are needed; "
                "take a smaller scene or tile, or another device"
            )
        if nbytes > self.free_bytes:
            raise MemoryRefused(
                f"{self.info.title} may use {_mib(self.memory_limit or 0)} of memory, {_mib(self._held_bytes)} are in "
                f"use and {_mib(nbytes)} more are needed; raise --max-memory (max_memory), take a smaller scene or "
                "tile, or another device"
            )

    def _held(self, handle: cl.Buffer, size: int) -> Buffer:
        self._held_bytes += size
        self.allocated_bytes = max(self.allocated_bytes, self._held_bytes)
        buffer = Buffer(handle, size)
        self._buffers[buffer] = self._owner
        return buffer

    def _create(self, size: int) -> cl.Buffer:
        handle = self._cl.Buffer(self._context, self._cl.mem_flags.READ_WRITE, size)
        if self.is_cpu and size >= LARGE_BYTES:
            # Buffers of a CPU device are memory of this process
            flags, dtype = self._cl.map_flags.WRITE, np.dtype(np.uint8)
            memory, _ = self._cl.enqueue_map_buffer(self._queue, handle, flags, 0, (size,), dtype)
            self._large[handle] = memory.ctypes.data
            prefer_large_pages(memory.ctypes.data, size)
            memory.base.release(self._queue)
        return handle

    def release(self, buffer: Buffer) -> None:
        """Release a buffer, which must not be used again.

        Errors of the driver are ignored: they are expected from a device that failed.
        """
        self._buffers.pop(buffer, None)
        self._held_bytes -= buffer.nbytes
        address = self._large.pop(buffer.handle, None)
        if self.lost:
            _KEPT.append(buffer.handle)
            return
        if address is not None:
            withdraw_preference(address, buffer.nbytes)
        with contextlib.suppress(self._cl.Error):
            buffer.handle.release()

    @property
    def buffers(self) -> frozenset[Buffer]:
        """The buffers that are not released yet."""
        return frozenset(self._buffers)

    def release_but(self, kept: Collection[Buffer]) -> None:
        """Release all buffers except `kept`, to clean up after an error."""
        for buffer in self.buffers - set(kept):
            self.release(buffer)

    @contextlib.contextmanager
    def owned_by(self, owner: object) -> Iterator[None]:
        """Context in which all buffers that are created belong to `owner`, which has its `turn`."""
        self._owner = owner
        try:
            yield
        finally:
            self._owner = None

    def release_of(self, owner: object) -> None:
        """Release the buffers of one owner; others may share the device."""
        for buffer in [buffer for buffer, each in list(self._buffers.items()) if each is owner]:
            self.release(buffer)

    def launch(
        self,
        program: Program,
        kernel: str,
        global_size: int,
        local_size: int,
        args: Sequence[Argument],
    ) -> None:
        """Enqueue a one-dimensional launch.

        Parameters
        ----------
        program : Program
        kernel : str
            Name of the entry point.
        global_size, local_size : int
            Total number of work-items, a multiple of the second; number of work-items in a group.
        args : sequence
            Buffers, NumPy scalars, or arrays of one struct passed by value.

        Raises
        ------
        RenderError
            When the driver returns an error; the message names kernel and sizes.
        """
        what = f"kernel {kernel} of {program.source.entry} with {global_size} work-items in groups of {local_size}"

        def enqueue() -> cl.Event:
            function = program.kernels.get(kernel)
            if function is None:
                function = program.kernels[kernel] = self._cl.Kernel(program.handle, kernel)
            for position, value in enumerate(args):
                function.set_arg(position, value.handle if isinstance(value, Buffer) else value)
            event: cl.Event = self._cl.enqueue_nd_range_kernel(self._queue, function, (global_size,), (local_size,))
            return event

        if (kernel, local_size) in program.launched:
            self._call("launch", what, enqueue)
        else:
            self._set_compiling(True)
            try:
                self._call("launch", what, lambda: self._first_launch(program, enqueue))
            finally:
                self._set_compiling(False)
            program.launched.add((kernel, local_size))
        self.launches += 1

    def _first_launch(self, program: Program, enqueue: Callable[[], cl.Event]) -> None:
        """Launch and wait. Drivers compile for a work-group size at its first use, which counts as compile time."""
        key = program_key(self.info, program.options, program.source)
        self._sentinel.put(key)
        self._queue.finish()
        begin = time.perf_counter()
        event = enqueue()
        event.wait()
        running = (event.profile.end - event.profile.start) * 1e-9
        compiling = max(time.perf_counter() - begin - running, 0.0)
        self.compile_seconds += compiling
        self._sentinel.take()
        if self.compiles_small_code:
            note_run(key)
        if compiling > _COMPILED_SECONDS:
            return_free_pages()  # of this compilation, and of programs that were dropped since the last one

    @property
    def group(self) -> int:
        """Default number of work-items in a group: on a GPU whole warps, so that no lane is idle.

        Raises
        ------
        DeviceError, RenderError
            When the driver fails.
        """
        if not self._group:
            # Queried for a small kernel that every render needs: OpenCL 1.2 has no such property of a device
            program = self.common_program()
            kind = self._cl.kernel_work_group_info.PREFERRED_WORK_GROUP_SIZE_MULTIPLE
            kernel = self._call("build", "kernel film_clear", lambda: self._cl.Kernel(program.handle, "film_clear"))
            self._group = whole_warps(int(kernel.get_work_group_info(kind, self._handle)), self.max_work_group)
        return self._group

    def launch_each(self, program: Program, kernel: str, count: int, args: Sequence[Argument]) -> None:
        """Launch a kernel over at least `count` work-items, in groups of `group`."""
        self.launch(program, kernel, -(-count // self.group) * self.group, self.group, args)

    def read(self, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        """Wait for the queue and copy the start of `buffer` into all of `array` (C-contiguous).

        Raises
        ------
        RenderError
            When the copy or earlier work in the queue fails.
        """
        if array.nbytes:
            self._call(
                "read",
                f"a read of {_mib(array.nbytes)}",
                lambda: self._cl.enqueue_copy(self._queue, array, buffer.handle, is_blocking=True),
            )
            self._sentinel.take()

    def begin_read(self, buffer: Buffer, array: npt.NDArray[Any]) -> Reading:
        """Enqueue a copy of the start of `buffer` into all of `array` (C-contiguous), and flush the queue.

        Raises
        ------
        RenderError
            When the driver returns an error.
        """

        def enqueue() -> cl.Event:
            event: cl.Event = self._cl.enqueue_copy(self._queue, array, buffer.handle, is_blocking=False)
            self._queue.flush()
            return event

        return Reading(array, self._call("read", f"a read of {_mib(array.nbytes)}", enqueue))

    def end_read(self, reading: Reading) -> None:
        """Wait until a copy is complete; later work in the queue may continue meanwhile.

        Raises
        ------
        RenderError
            When the copy or earlier work in the queue fails.
        """
        self._call("read", f"a read of {_mib(reading.array.nbytes)}", reading.event.wait)
        self._sentinel.take()

    def write(self, buffer: Buffer, array: npt.NDArray[Any]) -> None:
        """Copy `array` (C-contiguous) to the start of `buffer`, and wait for it.

        Raises
        ------
        RenderError
            When the copy or earlier work in the queue fails.
        """
        if array.nbytes:
            self._call(
                "write",
                f"a write of {_mib(array.nbytes)}",
                lambda: self._cl.enqueue_copy(self._queue, buffer.handle, array, is_blocking=True),
            )

    def finish(self) -> None:
        """Wait until all work in the queue is done.

        Raises
        ------
        RenderError
            When work in the queue fails.
        """
        self._call("finish", "waiting for its queue", self._queue.finish)
        self._sentinel.take()

    def close(self) -> None:
        """Release programs, queue and context; the device must not be used again."""
        if self.lost:
            _KEPT.extend((self._programs, self._queue, self._context))
            self._programs = {}
        self._programs.clear()
        del self._queue, self._context
        if not self.lost:
            return_free_pages()

    def _call(self, kind: str, what: str, function: Callable[[], _T]) -> _T:
        """Make a driver call that may fail; all such calls go through here.

        Parameters
        ----------
        kind : str
            ``open``, ``build``, ``allocate``, ``write``, ``launch``, ``read`` or ``finish``.
        what : str
            For messages.
        function : callable
        """
        refuse_forked()
        self._calls += 1
        try:
            return function()
        except self._cl.Error as error:
            raise DeviceFailure(f"{self.info.title} failed at {what}: {error}{_hint(str(error))}") from error
        finally:
            self._calls += 1


def whole_warps(multiple: int, most: int) -> int:
    """Work-group size: the smallest multiple of a warp that is at least 64, limited to the device's maximum."""
    warp = max(multiple, 1)
    return max(1, min(-(-_GPU_GROUP // warp) * warp, most // warp * warp or most))


def leave_busy_drivers(code: int) -> None:
    """End the process, without finalization, if a device was lost or a thread still calls a driver.

    Exit handlers of a driver whose device was lost might never return.
    """
    if _KEPT or not wait_for_driver_threads(_EXIT_SECONDS):
        leave()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _mib(nbytes: int) -> str:
    return f"{nbytes / 2**20:.1f} MiB" if nbytes >= 2**20 else f"{nbytes} bytes"


def _hint(message: str) -> str:
    for mark, cure in (
        ("MEM_OBJECT_ALLOCATION_FAILURE", "; its memory is full: take a smaller scene, or another device"),
        ("OUT_OF_RESOURCES", "; try --lanes 1, or a smaller --work-group or --tile"),
        ("OUT_OF_HOST_MEMORY", "; the machine's memory is full"),
        ("INVALID_WORK_GROUP_SIZE", "; try a smaller --work-group"),
    ):
        if mark in message:
            return cure
    return ""
