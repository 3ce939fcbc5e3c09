"""Select devices by the user's specification, probe them if necessary, and open them."""

from __future__ import annotations

import contextlib
import difflib
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

from clrender.device.device import Device
from clrender.device.forked import refuse_forked
from clrender.device.info import DeviceInfo
from clrender.drivers import discover
from clrender.drivers.aside import compile_aside
from clrender.drivers.probe import DriverReport, lacks_library, probe, prove_fast, survey
from clrender.errors import DeviceError, UsageError

__all__ = ["choose", "open_devices", "select", "spare_cores"]

Notify = Callable[[str], None]
Probe = Callable[[DeviceInfo], DeviceInfo]


def select(spec: str | int | Sequence[str | int] | None = None, notify: Notify | None = None) -> list[Device]:
    """Open the devices of a `--device` specification. Only their drivers are loaded into this process.

    Parameters
    ----------
    spec : str, int, sequence of them, or None
        ``auto``, ``cpu``, ``gpu`` (the best of the kind), ``all`` (every device that is ok), an index of `clrender
        devices`, or a part of a name (the best that matches). None: ``CLRENDER_DEVICE``, else ``auto``.
    notify : callable, optional
        Called with one line of text for the chosen device, for warnings, and when a probe begins.

    Returns
    -------
    list of Device
        At least one, without duplicates.

    Raises
    ------
    UsageError
        When no device matches the specification.
    DeviceError
        When no matching device can be used.
    """
    refuse_forked()
    tell = notify or (lambda line: None)
    specs = _normalise(spec)
    for refresh in (False, True):
        reports = survey(refresh=refresh, any_device=specs == ["auto"])
        known = [info for report in reports for info in report.devices]
        if not known:
            raise _nothing_found(reports)
        for line in _unusable(reports):
            tell(f"warning: {line}; see `clrender doctor`")
        try:
            # Each probe only once: the verdict of a probe that timed out is not cached.
            chosen = choose(specs, known, cache(lambda info: probe(info, notify=tell)), tell)
        except UsageError as error:
            if not _from_environment(spec):
                raise
            raise UsageError(str(error).replace("--device ", "CLRENDER_DEVICE=", 1)) from None
        try:
            opened = open_devices(chosen, known)
        except DeviceError:
            # The cached listing is out of date; query the drivers once more.
            if refresh:
                raise
            continue
        for info in chosen:
            tell(f"device: {info.title}")
        return opened
    raise AssertionError("the second round returns or raises")


def _unusable(reports: Sequence[DriverReport]) -> list[str]:
    """Messages about installed drivers that fail, to explain missing devices."""
    lines = [
        f"{report.driver.library} cannot be used: {report.fault}"
        for report in reports
        # An .icd file without its library is irrelevant to a render
        if report.fault and not (report.driver.fault or lacks_library(report.driver, report.fault))
    ]
    for report in reports:
        if any("portable computing" in name.lower() and not count for name, _, count in report.platforms):
            where = f" with POCL_CACHE_DIR={os.environ['POCL_CACHE_DIR']}" if "POCL_CACHE_DIR" in os.environ else ""
            lines.append(f"{report.driver.library} offers no device{where}")
    return lines


def _nothing_found(reports: Sequence[DriverReport]) -> DeviceError:
    why = "; ".join(_unusable(reports))
    return DeviceError(
        f"no OpenCL device was found{f' ({why})' if why else ''}; see `clrender doctor` for how to install a driver"
    )


def _from_environment(spec: str | int | Sequence[str | int] | None) -> bool:
    """Whether there is no specification, except perhaps ``CLRENDER_DEVICE``."""
    return spec is None or (not isinstance(spec, int) and len(spec) == 0)


def _normalise(spec: str | int | Sequence[str | int] | None) -> list[str]:
    if spec is None or _from_environment(spec):
        spec = os.environ.get("CLRENDER_DEVICE", "").strip() or "auto"
    parts = [spec] if isinstance(spec, (str, int)) else list(spec)
    return [str(part).strip() or "auto" for part in parts]


def choose(specs: Sequence[str], known: Sequence[DeviceInfo], probe_one: Probe, notify: Notify) -> list[DeviceInfo]:
    """Devices that match specifications, without duplicates, in the order of the specifications.

    Parameters
    ----------
    specs : sequence of str
    known : sequence of DeviceInfo
    probe_one : callable
        Returns a device with its verdict.
    notify : callable
        Called with a warning for each device that is used although its verdict is not ``ok``.

    Raises
    ------
    UsageError, DeviceError
        See `select`.
    """
    verdicts: dict[int, DeviceInfo] = {}

    def once(info: DeviceInfo) -> DeviceInfo:
        """Probe a device only once, as a verdict that is not cached would take minutes again."""
        if info.index not in verdicts:
            verdicts[info.index] = probe_one(info)
        return verdicts[info.index]

    chosen: dict[int, DeviceInfo] = {}
    for spec in specs:
        for info in _one(spec, known, once, notify):
            chosen.setdefault(info.index, info)
    return list(chosen.values())


def _one(spec: str, known: Sequence[DeviceInfo], probe_one: Probe, notify: Notify) -> list[DeviceInfo]:
    word = spec.lower()
    ranked = sorted(known, key=_rank)
    if word in ("auto", "cpu", "gpu"):
        candidates = [info for info in ranked if word in ("auto", info.type)]
        best = _first_ok(candidates, probe_one)
        if best is None:
            raise _none_ok("device" if word == "auto" else f"{word.upper()} device", candidates, probe_one)
        return [best]
    if word == "all":
        good = [info for info in (probe_one(each) for each in known) if info.probe == "ok"]
        if not good:
            raise _none_ok("device", ranked, probe_one)
        return good
    named = _named(spec, ranked)
    best = _first_ok(named, probe_one)
    if best is None:
        best = probe_one(named[0])
        notify(f"warning: {best.title} did not pass the probe ({best.probe}: {best.detail}); its image may be wrong")
    return [best]


def _first_ok(candidates: Sequence[DeviceInfo], probe_one: Probe) -> DeviceInfo | None:
    return next((info for info in map(probe_one, candidates) if info.probe == "ok"), None)


def _none_ok(kind: str, candidates: Sequence[DeviceInfo], probe_one: Probe) -> DeviceError:
    tried = list(map(probe_one, candidates))
    verdicts = "; ".join(
        f"{info.title}: {info.probe}{f', {info.detail}' if info.probe == 'timeout' else ''}" for info in tried
    )
    found = f"none of those found passes the probe ({verdicts})" if verdicts else "there is none"
    return DeviceError(f"no OpenCL {kind} can be used: {found}; see `clrender doctor`")


def _named(spec: str, ranked: Sequence[DeviceInfo]) -> list[DeviceInfo]:
    """Devices that match an index or a part of a name, best first."""
    listed = ", ".join(f"{info.index} = {info.title}" for info in sorted(ranked, key=lambda info: info.index))
    if re.fullmatch(r"[+-]?\d+", spec):
        by_index = [info for info in ranked if info.index == int(spec)]
        if not by_index:
            raise UsageError(f"--device {spec}: there is no device with that index; there are {listed}")
        return by_index
    word = spec.lower()
    fits = [info for info in ranked if any(word in text.lower() for text in _names(info))]
    if fits:
        return fits
    words = {part for info in ranked for text in _names(info) for part in text.lower().split()}
    near = difflib.get_close_matches(word, sorted(words | {"auto", "cpu", "gpu", "all"}), n=1)
    hint = f"; did you mean {near[0]!r}?" if near else f"; there are {listed}"
    raise UsageError(f"--device {spec}: no device has that in its name{hint}")


def _names(info: DeviceInfo) -> tuple[str, ...]:
    return (info.name, info.platform, info.version, info.driver)


def _rank(info: DeviceInfo) -> tuple[int, int, int, int, int]:
    """Sort key, smaller is better: GPUs before CPUs, native drivers before layered ones, then by size."""
    text = f"{info.platform} {info.name}".lower()
    # Oclgrind reports a GPU, but is an interpreter.
    kind = 3 if "oclgrind" in text else {"gpu": 0, "cpu": 1}.get(info.type, 2)
    # llvmpipe was measured to be several times slower than PoCL on the same processor.
    driver = 2 if "llvmpipe" in text else 1 if "rusticl" in text or "clover" in text else 0
    native = 0 if "pocl" in info.version.lower() else 1
    return (kind, driver, native if kind else 0, -info.compute_units, info.index)


def open_devices(chosen: Sequence[DeviceInfo], known: Sequence[DeviceInfo]) -> list[Device]:
    """Open devices in this process, and load only their drivers.

    Parameters
    ----------
    chosen : sequence of DeviceInfo
    known : sequence of DeviceInfo
        All devices of the inventory.

    Raises
    ------
    DeviceError
        When a driver no longer offers a device, or cannot open it.
    """
    libraries = {info.library for info in chosen}
    wanted = [driver for driver in discover.drivers() if driver.library in libraries]
    platforms = discover.load_platforms(wanted)
    loaded = [info for info in known if info.library in libraries]
    handles = [_handle(info, platforms, loaded) for info in chosen]
    opened = [Device(replace(info), handle) for info, handle in spare_cores(chosen, handles)]
    for device in opened:
        device.compile_aside = partial(compile_aside, device.info)
        device.prove_fast = partial(prove_fast, device)
    return opened


def spare_cores(chosen: Sequence[DeviceInfo], handles: Sequence[Any]) -> list[tuple[DeviceInfo, Any]]:
    """Reserve a core for the threads that feed GPUs: CPU devices beside a GPU get one core less, if the driver can.

    Parameters
    ----------
    chosen : sequence of DeviceInfo
    handles : sequence of pyopencl.Device

    Returns
    -------
    list of (DeviceInfo, pyopencl.Device)
        A partitioned CPU is replaced by the sub-device with all cores except one.
    """
    import pyopencl as cl

    fed = any(info.type != "cpu" for info in chosen)
    opened = []
    for info, handle in zip(chosen, handles, strict=True):
        left = info.compute_units - 1
        if fed and info.type == "cpu" and left >= 1:
            by_counts = cl.device_partition_property.BY_COUNTS
            end = cl.device_partition_property.BY_COUNTS_LIST_END
            with contextlib.suppress(cl.Error):  # the driver cannot partition: leave it to the system's scheduler
                (handle,) = handle.create_sub_devices([by_counts, left, end])
                info = replace(info, compute_units=left)
        opened.append((info, handle))
    return opened


def _handle(info: DeviceInfo, platforms: Sequence[Any], known: Sequence[DeviceInfo]) -> Any:
    """The driver's object for a device: among identical devices, the one at the same position as in the inventory."""
    import pyopencl as cl

    def identity(each: DeviceInfo) -> tuple[str, str, str, str]:
        return (each.platform, each.version, each.name, each.driver)

    alike = []
    for platform in platforms:
        try:
            handles = platform.get_devices()
        except cl.Error:
            continue
        where = (platform.name.strip(), platform.version.strip())
        alike += [h for h in handles if (*where, h.name.strip(), h.driver_version.strip()) == identity(info)]
    place = sum(identity(each) == identity(info) and each.index < info.index for each in known)
    if place >= len(alike):
        raise DeviceError(f"{info.title} is not among the devices this process has loaded; see `clrender devices`")
    return alike[place]
