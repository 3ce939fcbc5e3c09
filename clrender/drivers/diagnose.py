"""Diagnose problems of OpenCL on a machine, each with its cause and exact cure."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from clrender.device import cache
from clrender.device.info import DeviceInfo
from clrender.drivers import vendor_libraries
from clrender.drivers.discover import SYSTEM_FOLDER, Driver
from clrender.drivers.probe import DriverReport

__all__ = ["INSTALL_ANY", "Finding", "diagnose", "diagnose_device", "diagnose_driver", "diagnose_machine"]

INSTALL_ANY: Final = (
    "sudo apt-get install pocl-opencl-icd (Debian, Ubuntu), or pip install pocl-binary-distribution, "
    "or pip install intel-opencl-rt intel-cmplr-lib-rt (650 MB, Intel's licence)"
)
# Part of a library's name -> the package that provides it.
_PACKAGES: Final = (
    ("pocl", "sudo apt-get install --reinstall pocl-opencl-icd"),
    ("mesaopencl", "sudo apt-get install --reinstall mesa-opencl-icd"),
    ("rusticl", "sudo apt-get install --reinstall mesa-opencl-icd"),
    ("nvidia-opencl", "install the OpenCL part of the NVIDIA driver (Debian: sudo apt-get install nvidia-opencl-icd)"),
    ("amdocl", "sudo apt-get install --reinstall rocm-opencl-runtime"),
    ("igdrcl", "sudo apt-get install --reinstall intel-opencl-icd"),
    ("intelocl", "pip install --force-reinstall intel-opencl-rt intel-cmplr-lib-rt"),
)  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """A problem, or a fact worth knowing.

    Attributes
    ----------
    subject : str
        Driver, platform or device.
    cause, cure : str
    harmless : bool
        Whether it can be ignored.
    """

    subject: str
    cause: str
    cure: str
    harmless: bool = False


def diagnose(reports: Sequence[DriverReport]) -> list[Finding]:
    """Findings about every driver, its devices, and the machine.

    Parameters
    ----------
    reports : sequence of DriverReport
        Reports whose devices have verdicts.
    """
    found = [finding for report in reports for finding in diagnose_driver(report)]
    found += [f for report in reports for info in report.devices for f in diagnose_device(info, report.driver)]
    return found + diagnose_machine(reports)


def diagnose_driver(report: DriverReport) -> list[Finding]:
    """Findings about a driver that offers no platform, or platforms without a device."""
    driver = report.driver
    if report.fault:
        return [Finding(driver.origin, report.fault, _driver_cure(driver, report.fault))]
    return [_empty_platform(name, version) for name, version, count in report.platforms if count == 0]


def _driver_cure(driver: Driver, fault: str) -> str:
    lower = driver.library.lower()
    package = next((cure for mark, cure in _PACKAGES if mark in lower), "")
    if "crashed" in fault or "timeout" in fault:
        named_by = driver.origin if driver.origin.endswith(".icd") else driver.library
        return f"update or remove this driver ({package or 'its package: dpkg -S ' + named_by})"
    if "needs a folder" in fault:
        return "free some space, or set XDG_CACHE_HOME or TMPDIR to a folder with enough space"
    if "cannot open shared object" in fault and driver.path:
        return f"install the libraries that `ldd {driver.path}` calls not found"
    if not driver.origin.endswith(".icd"):
        return package or "install the package that brings the library"
    remove = f"if the driver is no longer wanted: sudo rm {driver.origin}"
    return f"{package}; {remove}" if package else f"install the package that brings the library; {remove}"


def _empty_platform(name: str, version: str) -> Finding:
    subject = f"{name} ({version})"
    if name == "rusticl":
        value = os.environ.get("RUSTICL_ENABLE", "")
        return Finding(
            subject,
            f"it offers no device: RUSTICL_ENABLE={value} names no driver that has hardware here",
            "unset RUSTICL_ENABLE (then llvmpipe is used, on the processor), or name your GPU's driver, "
            "say RUSTICL_ENABLE=radeonsi, iris or nouveau",
        )
    if name == "Clover":
        return Finding(
            subject,
            "it offers no device: Mesa's old OpenCL implementation supports only some AMD GPUs",
            "nothing to do; another platform is used",
            harmless=True,
        )
    if "nvidia" in name.lower():
        return Finding(
            subject,
            "it offers no device: this process sees no NVIDIA GPU",
            "check nvidia-smi; in a container start it with --gpus all -e NVIDIA_DRIVER_CAPABILITIES=compute,utility",
        )
    return Finding(
        subject,
        "it offers no device: it finds none, or has no permission to open it",
        "give your user access to the GPU: sudo usermod -aG render,video $USER, then log in again",
    )


def diagnose_device(info: DeviceInfo, driver: Driver) -> list[Finding]:
    """Findings about one device, by its verdict."""
    if info.probe == "ok":
        if not info.detail:
            return []
        return [Finding(info.title, f"the image is correct, although {info.detail}", "nothing to do", harmless=True)]
    cause = f"{info.probe}: {info.detail}"
    if info.probe == "cannot-build":
        return [Finding(info.title, *_cannot_build(info, cause))]
    if info.probe == "wrong-result":
        return [Finding(info.title, cause, _wrong_result(info))]
    if info.probe == "timeout":
        slow = "set CLRENDER_PROBE_SECONDS to more seconds and run clrender doctor again, or use another driver"
        return [Finding(info.title, cause, slow)]
    return [Finding(info.title, cause, f"update this driver ({driver.origin}), or use another: {INSTALL_ANY}")]


def _cannot_build(info: DeviceInfo, cause: str) -> tuple[str, str]:
    if "unknown target CPU" in info.detail:
        return (
            f"{cause}. The compiler in this PoCL is older than the processor and does not know it",
            "use a newer PoCL: sudo apt-get install pocl-opencl-icd; "
            "or Intel's driver: pip install intel-opencl-rt intel-cmplr-lib-rt; "
            "the wheel does not work here: pip uninstall pocl-binary-distribution",
        )
    return cause, f"update this driver, or use another: {INSTALL_ANY}"


def _wrong_result(info: DeviceInfo) -> str:
    mode = os.environ.get("CL_CONFIG_CPU_VECTORIZER_MODE", "1")
    if "intel" in info.platform.lower() and info.type == "cpu" and mode != "1":
        return (
            f"CL_CONFIG_CPU_VECTORIZER_MODE is {mode}, and this driver's vectoriser miscompiles: "
            "unset it, or set CL_CONFIG_CPU_VECTORIZER_MODE=1"
        )
    return f"do not use this driver for rendering; update it, or use another: {INSTALL_ANY}"


def diagnose_machine(reports: Sequence[DriverReport]) -> list[Finding]:
    """Findings about hardware without a driver, and about a machine without any driver."""
    found: list[Finding] = []
    libraries = " ".join(report.driver.library for report in reports)
    devices = [info for report in reports for info in report.devices]
    if Path("/dev/nvidia0").exists() and "nvidia" not in libraries:
        found.append(
            Finding(
                "/dev/nvidia0",
                f"there is an NVIDIA GPU, but no .icd file in {SYSTEM_FOLDER} names its OpenCL driver, "
                f"and {vendor_libraries.LIBRARIES[0]} was not found",
                "sudo apt-get install nvidia-opencl-icd; start a container with --gpus all "
                "-e NVIDIA_DRIVER_CAPABILITIES=compute,utility; or name the library's folder in LD_LIBRARY_PATH",
            )
        )
    shut = [str(node) for node in Path("/dev/dri").glob("renderD*") if not os.access(node, os.R_OK | os.W_OK)]
    if shut:
        cure = "sudo usermod -aG render,video $USER, then log in again"
        found.append(Finding(", ".join(shut), "there is a GPU that your user has no permission to open", cure))
    why = cache.no_cache_reason()
    if why:
        place = cache.cache_folder()
        cause = (
            f"{why}, so compiled kernels are kept in {place}" if place else f"{why}, so compiled kernels are not kept"
        )
        cure = "fix that, or set XDG_CACHE_HOME to a folder that only you can write"
        found.append(Finding("the cache folder", cause, cure, harmless=True))
    if not devices:
        own = os.environ.get("OCL_ICD_VENDORS", "")
        cause = f"OCL_ICD_VENDORS={own} names no driver with an OpenCL device" if own else "there is no OpenCL device"
        cure = f"unset OCL_ICD_VENDORS, or {INSTALL_ANY}" if own else INSTALL_ANY
        found.append(Finding("this machine", cause, cure))
    return found
