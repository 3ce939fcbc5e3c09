"""Build a program with a driver's compiler, or take the binary kept from an earlier run."""

from __future__ import annotations

import contextlib
import hashlib
from typing import TYPE_CHECKING, Any

from clrender.device import cache
from clrender.device.discover import settings
from clrender.errors import DeviceError

if TYPE_CHECKING:
    import pyopencl as cl

    from clrender.device.device import DeviceInfo
    from clrender.device.source import Source

__all__ = ["build", "first_errors", "store"]


def build(context: cl.Context, handle: cl.Device, info: DeviceInfo, options: str, source: Source) -> cl.Program:
    """Program of `source` for one device.

    Parameters
    ----------
    context, handle : pyopencl.Context, pyopencl.Device
    info : DeviceInfo
    options : str
        For the driver's compiler.
    source : Source

    Raises
    ------
    DeviceError
        When the compiler refuses; the message holds its first errors.
    """
    import pyopencl as cl

    # The plain program object: pyopencl's own adds an include folder to the options and a cache of its own.
    binary = cache.load_binary(_key(info, options, source))
    if binary is not None:
        try:
            kept = cl._cl._Program(context, [handle], [binary])
            kept._build(options.encode(), [handle])
            return cl.Program(kept)
        except cl.Error:
            pass  # made by another version than it says; the source is always right
    built = cl._cl._Program(context, source.text)
    try:
        built._build(options.encode(), [handle])
    except cl.Error as error:
        log = str(built.get_build_info(handle, cl.program_build_info.LOG) or "")
        reason = first_errors(log) or str(error)
        raise DeviceError(f"{info.title} cannot build {source.entry}: {reason}; see `clrender doctor`") from error
    program = cl.Program(built)
    # PoCL compiles every kernel once more when asked for a binary; the probe does that, not a render.
    if "pocl" not in info.version.lower():
        store(info, options, source, program)
    return program


def store(info: DeviceInfo, options: str, source: Source, program: cl.Program) -> None:
    """Keep the binary of a built program, so that a later process need not compile it.

    Parameters
    ----------
    info : DeviceInfo
    options : str
        That it was built with.
    source : Source
    program : pyopencl.Program
    """
    import pyopencl as cl

    key = _key(info, options, source)
    if "oclgrind" in info.version.lower() or cache.load_binary(key) is not None:
        return  # an interpreter has nothing to keep
    with contextlib.suppress(cl.Error):
        binaries: Any = program.get_info(cl.program_info.BINARIES)
        if binaries and binaries[0]:
            cache.store_binary(key, bytes(binaries[0]))


def _key(info: DeviceInfo, options: str, source: Source) -> str:
    facts = [info.platform, info.version, info.name, info.driver, info.library, options, source.sha256, *settings()]
    return hashlib.sha256("\0".join(facts).encode()).hexdigest()


def first_errors(log: str, limit: int = 3) -> str:
    """First error lines of a compiler's log, joined into one line."""
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()] or lines
    return " | ".join(errors[:limit])
