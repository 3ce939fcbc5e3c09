"""Build a program with a driver's compiler, or load the binary cached by an earlier run."""

from __future__ import annotations

import contextlib
import hashlib
import re
import warnings
from typing import TYPE_CHECKING, Any, Final

from clrender.device.driver_settings import driver_settings
from clrender.device.program_cache import load_binary, store_binary
from clrender.errors import DeviceError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pyopencl as cl

    from clrender.device.info import DeviceInfo
    from clrender.device.source import Source

__all__ = ["build", "first_errors", "program_key", "store"]

_UNNAMED: Final = re.compile(r"<\w+>:(\d+)")


def build(context: cl.Context, handle: cl.Device, info: DeviceInfo, options: str, source: Source) -> cl.Program:
    """Build, or load from the cache, the program of `source` for one device.

    Parameters
    ----------
    context, handle : pyopencl.Context, pyopencl.Device
    info : DeviceInfo
    options : str
        Options for the driver's compiler.
    source : Source

    Raises
    ------
    DeviceError
        When the compiler rejects the program; the message has its first errors.
    UsageError
        When it rejects a plugin of it.
    """
    import pyopencl as cl

    binary = load_binary(program_key(info, options, source))
    if binary is not None:
        try:
            return _built(_program(context, [handle], [binary]), options, handle)
        except cl.Error:
            pass  # made by a different driver version than it says; fall back to the source
    program = _program(context, source.text)
    try:
        program = _built(program, options, handle)
    except cl.Error as error:
        log = str(program.get_build_info(handle, cl.program_build_info.LOG) or "")
        reason = first_errors(log, source) or str(error)
        if wrong := _errors_of(reason, source.plugins):
            raise UsageError(f"{wrong}: the plugin cannot be compiled for {info.title}; correct it") from None
        raise DeviceError(f"{info.title} cannot build {source.entry}: {reason}; see `clrender doctor`") from error
    # PoCL would compile every kernel again for a binary. It keeps them itself, and finds them in some 25 ms a program.
    if "pocl" not in info.version.lower():
        store(info, options, source, program)
    return program


def _errors_of(reason: str, files: Sequence[str]) -> str:
    """Those of some errors that are in one of these files, beginning with their place; empty: there are none."""
    found = []
    for each in reason.split(" | "):
        for file in files:
            if f"{file}:" in each:
                found.append(file + each.partition(file)[2].replace(": error: ", ": "))
                break
    return " | ".join(found)


def _program(context: cl.Context, *parts: Any) -> Any:
    """pyopencl's internal program object if this version has it, else the public one.

    The public one adds an include folder of pyopencl to the options. Drivers parse it differently if its path has a
    space.
    """
    import pyopencl as cl

    return (_plain_program() or cl.Program)(context, *parts)


def _plain_program() -> Any:
    """A class that is not part of pyopencl's public interface, and may disappear in any version."""
    import pyopencl as cl

    plain = getattr(getattr(cl, "_cl", None), "_Program", None)
    return plain if hasattr(plain, "_build") else None


def _built(program: Any, options: str, handle: cl.Device) -> cl.Program:
    import pyopencl as cl

    if not isinstance(program, cl.Program):
        program._build(options.encode(), [handle])
        return cl.Program(program)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # compiler output for successful builds is of no use to users
        program.build(options, [handle])
    return program


def store(info: DeviceInfo, options: str, source: Source, program: cl.Program) -> None:
    """Cache the binary of a built program, so that later processes need not compile it.

    Parameters
    ----------
    info : DeviceInfo
    options : str
        Compiler options that it was built with.
    source : Source
    program : pyopencl.Program
    """
    import pyopencl as cl

    key = program_key(info, options, source)
    if "oclgrind" in info.version.lower() or load_binary(key) is not None:
        return  # an interpreter has no binary
    with contextlib.suppress(cl.Error):
        binaries: Any = program.get_info(cl.program_info.BINARIES)
        if binaries and binaries[0]:
            store_binary(key, bytes(binaries[0]))


def program_key(info: DeviceInfo, options: str, source: Source) -> str:
    """Cache key of a built program: a hash of everything that determines the compiler's output."""
    facts = [
        info.platform,
        info.version,
        info.name,
        info.driver,
        info.library,
        options,
        source.sha256,
        *driver_settings(),
    ]
    return hashlib.sha256("\0".join(facts).encode()).hexdigest()


def first_errors(log: str, source: Source, limit: int = 3) -> str:
    """First error lines of a compiler's log, joined into one line.

    Places such as ``<kernel>:401``, of compilers that pass over ``#line`` (NVIDIA's), become those in the files.
    """
    log = _UNNAMED.sub(lambda found: source.place(int(found[1])), log)
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()] or lines
    return " | ".join(errors[:limit])
