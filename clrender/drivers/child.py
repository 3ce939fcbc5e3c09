"""Child process that lists devices or probes one, because a driver may crash or hang it.

It is started as ``python -m clrender.drivers.child REQUEST`` with REQUEST in JSON. The answer is the last line of
stdout that begins with `MARK`, so that output of drivers is ignored.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clrender.device.program_cache import leave
from clrender.drivers.discover import Driver, load_platforms
from clrender.drivers.probe import MARK
from clrender.errors import ClrenderError, DeviceError

if TYPE_CHECKING:
    from clrender.device.info import DeviceInfo

__all__ = ["end_with_the_parent", "main"]


def main(argument: str) -> None:
    """Execute the request and print the answer."""
    request = json.loads(argument)
    if request.get("lifeline"):
        compiles = request["task"] == "compile"
        threading.Thread(target=end_with_the_parent, args=(compiles,), daemon=True).start()
    _be_the_first_to_die()
    driver = Driver(**{**request["driver"], "preload": tuple(request["driver"]["preload"])})
    if request["task"] == "list":
        answer = _list(driver)
    elif request["task"] == "probe":
        answer = _probe(driver, request["ordinal"], request.get("codes", ["fast", "small"]))
    else:
        answer = _compile(driver, request["ordinal"], request["compilation"])
    print(f"\n{MARK}{json.dumps(answer)}", flush=True)


def _be_the_first_to_die() -> None:
    """Limit this process to half of the memory and make it the first to be killed, in case a compiler runs away."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (memory // 2, memory // 2))
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def end_with_the_parent(on_purpose: bool = False) -> None:
    """Wait for the end of stdin, which comes when the parent ends in any way; then kill this process group.

    Parameters
    ----------
    on_purpose : bool
        Whether the parent may end before the answer: programs that were loaded meanwhile are then sound.
    """
    while os.read(0, 1):
        pass
    if on_purpose:
        leave()
    if os.getsid(0) == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _list(driver: Driver) -> dict[str, Any]:
    try:
        listed = [_platform(platform) for platform in load_platforms([driver])]
    except DeviceError as error:
        return {"platforms": [], "fault": str(error)}
    return {"platforms": listed, "fault": ""}


def _platform(platform: Any) -> dict[str, Any]:
    import pyopencl as cl

    kinds = ((cl.device_type.GPU, "gpu"), (cl.device_type.CPU, "cpu"))
    return {
        "name": platform.name.strip(),
        "version": platform.version.strip(),
        "devices": [
            {
                "name": device.name.strip(),
                "driver": device.driver_version.strip(),
                "type": next((name for bit, name in kinds if device.type & bit), "accelerator"),
                "compute_units": int(device.max_compute_units),
                "memory_bytes": int(device.global_mem_size),
            }
            for device in _handles(platform)
        ],
    }


def _found(driver: Driver, ordinal: int) -> tuple[Any, DeviceInfo]:
    """The driver's object for a device, and its description."""
    from clrender.device.info import DeviceInfo

    found = [
        (
            handle,
            DeviceInfo(0, platform=described["name"], version=described["version"], library=driver.library, **each),
        )
        for platform in load_platforms([driver])
        for described in (_platform(platform),)
        for handle, each in zip(_handles(platform), described["devices"], strict=True)
    ]
    return found[ordinal]


def _compile(driver: Driver, ordinal: int, compilation: dict[str, Any]) -> dict[str, Any]:
    from clrender.device.compilation import Compilation
    from clrender.device.device import Device
    from clrender.device.tracing_program import compile_tracing

    handle, info = _found(driver, ordinal)
    device = Device(info, handle)
    compile_tracing(device, Compilation(**compilation))
    return {"compile_seconds": device.compile_seconds}


def _probe(driver: Driver, ordinal: int, codes: list[str]) -> dict[str, Any]:
    from clrender.device.device import Device
    from clrender.device.worker import probe_hash
    from clrender.drivers.arithmetic import check

    handle, info = _found(driver, ordinal)
    stage = "open"
    try:
        device = Device(info, handle)
        stage = "arithmetic"
        differences = check(device)
        stage = "render"
        return {
            "hash": probe_hash(device, codes),
            "differences": differences,
            "compile_seconds": device.compile_seconds,
        }
    except ClrenderError as error:
        # A rejection by the compiler is a DeviceError, a failure of a launch a RenderError.
        return {"stage": stage, "refused": isinstance(error, DeviceError), "error": str(error)}


def _handles(platform: Any) -> list[Any]:
    import pyopencl as cl

    try:
        return list(platform.get_devices())
    except cl.Error:  # DEVICE_NOT_FOUND: a platform without a device is no error
        return []


if __name__ == "__main__":
    main(sys.argv[1])
