"""What runs in a process of its own, because a driver may crash or hang it: list devices, or probe one.

``python -m clrender.device.child REQUEST`` with REQUEST in JSON; the answer is the last line of stdout that begins with
`MARK`, so that what drivers print does no harm.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import resource
import sys
from pathlib import Path
from typing import Any

from clrender.device.discover import Driver, load_platforms
from clrender.device.probe import MARK
from clrender.errors import ClrenderError, DeviceError

__all__ = ["main"]


def main(argument: str) -> None:
    """Do what the request says and print the answer."""
    _be_the_first_to_die()
    request = json.loads(argument)
    driver = Driver(**{**request["driver"], "preload": tuple(request["driver"]["preload"])})
    answer = _list(driver) if request["task"] == "list" else _probe(driver, request["ordinal"])
    print(f"\n{MARK}{json.dumps(answer)}", flush=True)


def _be_the_first_to_die() -> None:
    """Give a compiler that explodes half of the memory at most, and let the system end it before anything else."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (memory // 2, memory // 2))
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def _list(driver: Driver) -> dict[str, Any]:
    try:
        platforms = load_platforms([driver])
    except DeviceError as error:
        return {"platforms": [], "fault": _why_not_loaded(driver) or str(error)}
    listed = [_platform(platform) for platform in platforms]
    return {"platforms": listed, "fault": "" if listed else _why_not_loaded(driver) or "it offers no platform"}


def _why_not_loaded(driver: Driver) -> str:
    """The dynamic linker's reason, which the loader swallows."""
    if driver.library:
        try:
            ctypes.CDLL(driver.library)
        except OSError as error:
            return f"its library cannot be loaded: {error}"
    return ""


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


def _probe(driver: Driver, ordinal: int) -> dict[str, Any]:
    from clrender.device.arithmetic import check
    from clrender.device.device import Device, DeviceInfo
    from clrender.device.worker import probe_hash

    found = [
        (
            handle,
            DeviceInfo(0, platform=described["name"], version=described["version"], library=driver.library, **each),
        )
        for platform in load_platforms([driver])
        for described in (_platform(platform),)
        for handle, each in zip(_handles(platform), described["devices"], strict=True)
    ]
    handle, info = found[ordinal]
    stage = "open"
    try:
        device = Device(info, handle)
        stage = "arithmetic"
        differences = check(device)
        stage = "render"
        answer = {"hash": probe_hash(device), "differences": differences, "compile_seconds": device.compile_seconds}
        device.keep_binaries()
        return answer
    except ClrenderError as error:
        # Whatever a compiler refuses is a DeviceError, whatever fails in a launch a RenderError.
        return {"stage": stage, "refused": isinstance(error, DeviceError), "error": str(error)}


def _handles(platform: Any) -> list[Any]:
    import pyopencl as cl

    try:
        return list(platform.get_devices())
    except cl.Error:  # DEVICE_NOT_FOUND: a platform without a device is no fault of the program
        return []


if __name__ == "__main__":
    main(sys.argv[1])
