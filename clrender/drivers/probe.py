"""List devices and test whether they compute correctly, without exposing this process to bad drivers.

Each driver is listed, and each device probed, in a child process with a time limit. Results are cached by driver
version and kernel hash, so that later starts need no probe. Failures for lack of memory or time are not cached, others
for a day and in the same environment.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from clrender.device import cache, program_cache
from clrender.device.info import DeviceInfo
from clrender.drivers.discover import Driver, driver_variables, drivers, fingerprint
from clrender.errors import DeviceError, RenderError
from clrender.files.kernel_hash import kernels_sha256
from clrender.process.elapsed import Elapsed, processor_seconds_of

if TYPE_CHECKING:
    from clrender.device.device import Device

__all__ = [
    "MARK",
    "Answer",
    "DriverReport",
    "ask",
    "ask_child",
    "child_command",
    "devices",
    "examine",
    "expected_hash",
    "inventory",
    "judge",
    "lacks_library",
    "passes_probe",
    "probe",
    "prove_fast",
    "survey",
]

MARK: Final = "@clrender "
"""Prefix of the line with a child process's answer, among the output of drivers."""

LIST_SECONDS: Final = 60.0
"""Time limit for the list of a driver's devices."""
OTHERS_SECONDS: Final = 3.0
"""The same where another device has passed the probe before, so that the render need not wait."""
PROBE_SECONDS: Final = 240.0
"""Default time limit of a probe (see ``CLRENDER_PROBE_SECONDS``). Interpreters and layered drivers are slow."""
_FAILED_SECONDS: Final = 86400.0
"""For how long a failure is believed, in the same environment."""
_PROVEN: Final = {"probe": "ok"}
"""Verdict on fast code."""
_PROVEN_HERE: Final[set[tuple[str, str]]] = set()
"""Devices on which this process has proven fast code, by title, and what it does."""
EXPECTED_FILE: Final = Path(__file__).with_name("expected_probe.txt")
_LOOK_SECONDS: Final = 0.1
_PACKAGE: Final = Path(__file__).resolve().parents[2]
# Platforms without a device on most machines. Any other driver without a device is queried again each time.
_OFTEN_EMPTY: Final = ("Clover",)
# Parts of a child's output that mean that it lacked memory, disk space or time, or was killed.
_SCARCE: Final = (
    "sigkill",
    "sigterm",
    "sigint",
    "sighup",
    "sigxcpu",
    "sigxfsz",
    "bad_alloc",
    "out of memory",
    "out_of_host_memory",
    "out_of_resources",
    "mem_object_allocation_failure",
    "memoryerror",
    "cannot allocate",
    "failed to map segment",
    "no space left",
    "disk quota exceeded",
    "too many open files",
    "temporarily unavailable",
    "can't start new thread",
)


@dataclass(frozen=True)
class Answer:
    """Outcome of a child process: its answer, or the reason why there is none.

    Attributes
    ----------
    value : dict or None
        Its answer.
    failure : str
        ``crashed`` or ``timeout`` if there is no answer.
    detail : str
        Signal or exit status, and the end of its output.
    """

    value: dict[str, Any] | None
    failure: str = ""
    detail: str = ""


@dataclass(frozen=True)
class DriverReport:
    """A driver, its platforms, and their devices in `inventory` order.

    Attributes
    ----------
    driver : Driver
    fault : str
        Reason why it offers nothing, or empty.
    platforms : tuple of (name, version, number of devices)
    devices : tuple of DeviceInfo
    """

    driver: Driver
    fault: str
    platforms: tuple[tuple[str, str, int], ...]
    devices: tuple[DeviceInfo, ...]


def ask(command: Sequence[str], seconds: float, changes: dict[str, str] | None = None) -> Answer:
    """Run a child process to its end or to the time limit, and return its answer.

    Parameters
    ----------
    command : sequence of str
    seconds : float
        Time limit, by `clrender.process.elapsed.Elapsed`, after which it and its descendants are killed.
    changes : dict, optional
        Environment variables that differ from this process.
    """
    with _running(command, changes) as answer:
        return answer(seconds)


@contextlib.contextmanager
def _running(command: Sequence[str], changes: dict[str, str] | None = None) -> Iterator[Callable[[float], Answer]]:
    """Start a child, yield a function that waits for its answer, and at the end kill it and its descendants."""
    env = {**os.environ, **driver_variables(), **(changes or {})}
    if env.get("OCL_ICD_VENDORS"):
        env["OCL_ICD_VENDORS"] = str(Path(env["OCL_ICD_VENDORS"]).resolve())
    # The child reads one end of the pipe, which is closed when this process ends in any way.
    lifeline, ours = os.pipe()
    # Our own folder as working directory, so that `-m` does not import modules from the user's.
    with (
        os.fdopen(ours, "wb"),
        os.fdopen(lifeline, "rb") as stdin,
        _scratch_file() as errors,
        subprocess.Popen(
            command,
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=errors,
            cwd=_PACKAGE,
            env=env,
            start_new_session=True,
        ) as process,
    ):
        try:
            yield lambda seconds: _answer(process, errors, seconds)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            if process.returncode is not None:
                program_cache.Sentinel.drop(process.pid)  # its programs are judged by the child's answer


def _answer(process: subprocess.Popen[bytes], errors: IO[bytes], seconds: float) -> Answer:
    elapsed, before = Elapsed(lambda: processor_seconds_of(process.pid)), time.monotonic()
    while True:
        try:
            output = process.communicate(timeout=min(_LOOK_SECONDS, seconds))[0].decode(errors="replace")
            break
        except subprocess.TimeoutExpired:
            now = time.monotonic()
            elapsed.add(now - before)
            before = now
            if elapsed.seconds >= seconds:
                return Answer(None, "timeout", f"no answer after {seconds:g} s")
    lines = [line[len(MARK) :] for line in output.splitlines() if line.startswith(MARK)]
    if process.returncode == 0 and lines:
        return Answer(json.loads(lines[-1]))
    errors.seek(0)
    tail = " | ".join(errors.read().decode(errors="replace").strip().splitlines()[-3:])
    code = process.returncode
    how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
    return Answer(None, "crashed", f"{how}{': ' + tail if tail else ''}")


def _scratch_file() -> IO[bytes]:
    """An anonymous temporary file, in memory if no disk has space."""
    try:
        return tempfile.TemporaryFile()
    except OSError:
        return os.fdopen(os.memfd_create("clrender"), "w+b")


def ask_child(request: dict[str, Any], seconds: float, changes: dict[str, str] | None = None) -> Answer:
    """`ask` the module `child` in a new Python process."""
    return ask(child_command(request), seconds, changes)


def child_command(request: dict[str, Any]) -> list[str]:
    """Command line to start the module `child` with a request; the child ends with this process."""
    argument = json.dumps({**request, "lifeline": True})
    return [sys.executable, "-m", "clrender.drivers.child", argument]


def survey(*, refresh: bool = False, any_device: bool = False) -> list[DriverReport]:
    """All drivers with their platforms and devices; devices have their cached verdict, or ``unknown``.

    Parameters
    ----------
    refresh : bool
        Query the drivers again instead of using the cache.
    any_device : bool
        Whether one good device is enough: a driver that is known to fail is not queried again, and one that does not
        answer is waited for only as long as no other device has passed the probe before.
    """
    reports: list[DriverReport] = []
    index = 0
    for driver, listing in _listings(refresh, any_device):
        infos = _infos(driver, listing, index)
        index += len(infos)
        platforms = tuple((p["name"], p["version"], len(p["devices"])) for p in listing["platforms"])
        reports.append(DriverReport(driver, listing["fault"], platforms, tuple(infos)))
    return reports


def _listings(refresh: bool, any_device: bool) -> list[tuple[Driver, dict[str, Any]]]:
    """All drivers with their platforms; those that are not in the cache are queried in parallel."""
    found = drivers()
    kept = {driver: _kept_listing(driver) for driver in found}
    seconds = OTHERS_SECONDS if any_device and any(map(_has_passed, kept.items())) else LIST_SECONDS
    if refresh:
        known = {driver for driver, listing in kept.items() if listing is not None and listing["fault"]}
        kept = {driver: kept[driver] if driver.fault or (any_device and driver in known) else None for driver in found}
    asked = [driver for driver in found if kept[driver] is None]
    with ThreadPoolExecutor(max(1, len(asked))) as threads, contextlib.ExitStack() as children:
        commands = [child_command({"task": "list", "driver": asdict(driver)}) for driver in asked]
        answers = [children.enter_context(_running(command)) for command in commands]
        listed = dict(zip(asked, threads.map(lambda answer: answer(seconds), answers), strict=True))
        return [(driver, kept[driver] or _listing(driver, listed[driver])) for driver in found]


def _has_passed(kept: tuple[Driver, dict[str, Any] | None]) -> bool:
    """Whether a device in a driver's cached listing has passed the probe."""
    driver, listing = kept
    return listing is not None and any(info.probe == "ok" for info in _infos(driver, listing, 0))


def _infos(driver: Driver, listing: dict[str, Any], index: int) -> list[DeviceInfo]:
    """The devices in a listing, with their cached verdicts; `index` is that of the first."""
    infos: list[DeviceInfo] = []
    for platform in listing["platforms"]:
        for device in platform["devices"]:
            place = len(infos)
            info = DeviceInfo(
                index=index + place,
                platform=platform["name"],
                version=platform["version"],
                library=driver.library,
                ordinal=place,
                **device,
            )
            infos.append(_with_verdict(info, driver))
    return infos


def _kept_listing(driver: Driver) -> dict[str, Any] | None:
    if driver.fault:
        return {"platforms": [], "fault": driver.fault}
    kept = cache.read_json(_listing_name(driver))
    return kept if isinstance(kept, dict) and "platforms" in kept and "fault" in kept else None


def _listing(driver: Driver, answer: Answer) -> dict[str, Any]:
    """The listing in a driver's answer.

    It is cached unless the failure may be temporary. A driver that hangs is remembered, and so is a missing library,
    until the driver changes or the user asks for all devices.
    """
    if answer.value is None:
        listing: dict[str, Any] = {
            "platforms": [],
            "fault": f"listing its devices failed ({answer.failure}: {answer.detail})",
        }
        keep = answer.failure == "timeout"
    else:
        listing = answer.value
        telling = any(each["devices"] or each["name"] in _OFTEN_EMPTY for each in listing["platforms"])
        keep = (telling and not listing["fault"]) or lacks_library(driver, listing["fault"])
    if keep and not _limited():
        cache.write_json(_listing_name(driver), listing)
    return listing


def lacks_library(driver: Driver, fault: str) -> bool:
    """Whether an `.icd` file names a library that is not installed: it was left behind by a removed driver."""
    return not driver.path and f"{driver.library}: cannot open shared object file" in fault


def _listing_name(driver: Driver) -> str:
    return f"drivers/{fingerprint(driver)}.json"


def _limited() -> bool:
    """Whether this process has resource limits, which may be the cause of a driver's failure."""
    kinds = (resource.RLIMIT_AS, resource.RLIMIT_DATA, resource.RLIMIT_CPU, resource.RLIMIT_FSIZE)
    if any(resource.getrlimit(kind)[0] != resource.RLIM_INFINITY for kind in kinds):
        return True
    files, stack = (resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_NOFILE, resource.RLIMIT_STACK))
    return 0 <= files < 256 or 0 <= stack < 4 << 20


def examine(notify: Callable[[str], None] | None = None) -> list[DriverReport]:
    """Query all drivers and probe all devices again, ignoring the cache.

    Parameters
    ----------
    notify : callable, optional
        Called with one line of text when a probe begins.
    """
    return [
        replace(report, devices=tuple(probe(info, again=True, notify=notify) for info in report.devices))
        for report in survey(refresh=True)
    ]


def inventory(*, refresh: bool = False) -> list[DeviceInfo]:
    """All devices of all drivers, with cached verdicts, or ``unknown`` if there is none."""
    return [info for report in survey(refresh=refresh) for info in report.devices]


def devices(notify: Callable[[str], None] | None = None) -> list[dict[str, Any]]:
    """The output of `clrender devices --json`: all devices, probed if necessary.

    Parameters
    ----------
    notify : callable, optional
        Called with one line of text when a probe begins, since the first may take a minute.

    Returns
    -------
    list of dict
        Keys of `clrender devices`; JSON values.
    """
    return [probe(info, notify=notify).public() for info in inventory(refresh=True)]


def expected_hash() -> str:
    """Expected hash of the probe's tile.

    Raises
    ------
    RenderError
        When the installation lacks it.
    """
    found = _kept_hash()
    if not found:
        raise RenderError(f"{EXPECTED_FILE} cannot be read, so no device can be checked; install clrender again")
    return found


def _kept_hash() -> str:
    try:
        return EXPECTED_FILE.read_text().strip()
    except OSError:
        return ""


def _verdict_name(info: DeviceInfo, driver: Driver, *more: str) -> str:
    facts = [info.name, info.driver, info.platform, info.version, str(info.ordinal)]
    facts += [fingerprint(driver), kernels_sha256(), _kept_hash(), *more]
    return f"verdicts/{hashlib.sha256(chr(0).join(facts).encode()).hexdigest()}.json"


def _with_verdict(info: DeviceInfo, driver: Driver) -> DeviceInfo:
    found = [_kept_verdict(_verdict_name(info, driver, *more)) for more in ((), _environment())]
    latest = max(found, key=lambda kept: kept["time"])
    return replace(info, probe=str(latest["probe"]), detail=str(latest["detail"])) if latest["time"] >= 0.0 else info


def _kept_verdict(name: str) -> dict[str, Any]:
    """A verdict in the cache; its time is below 0 if there is none, or if it is a failure of long ago."""
    kept = cache.read_json(name)
    whole = isinstance(kept, dict) and {"probe", "detail"} <= kept.keys() and isinstance(kept.get("time"), float)
    if whole and (kept["probe"] == "ok" or time.time() - kept["time"] <= _FAILED_SECONDS):
        return dict(kept)
    return {"time": -1.0}


def _environment() -> tuple[str, ...]:
    """What a device may have failed for that is no fault of its own: drivers start compilers, and load libraries."""
    return "failed", *(os.environ.get(name, "") for name in ("PATH", "LD_LIBRARY_PATH", "HOME"))


def probe(info: DeviceInfo, *, again: bool = False, notify: Callable[[str], None] | None = None) -> DeviceInfo:
    """Return the device with a verdict: the cached one, or that of a new probe.

    Parameters
    ----------
    info : DeviceInfo
    again : bool
        Probe even if there is a cached verdict.
    notify : callable, optional
        Called with one line of text when a probe begins.
    """
    if info.probe != "unknown" and not again:
        return info
    driver = next(each for each in drivers() if each.library == info.library)
    if notify:
        notify(f"probing {info.title}{'' if again else ': first use of this driver with these kernels'}")
    # Several that begin with a new driver at once would compile the same programs, each in the time of all
    with cache.held_alone(_verdict_name(info, driver), _probe_seconds()):
        kept = _with_verdict(info, driver)
        return _new_verdict(info, driver, thorough=again) if again or kept.probe == "unknown" else kept


def _new_verdict(info: DeviceInfo, driver: Driver, *, thorough: bool) -> DeviceInfo:
    codes = ("fast", "small") if thorough else ("small",)  # fast code is proven where it is used first
    request = {"task": "probe", "driver": asdict(driver), "ordinal": info.ordinal, "codes": codes}
    verdict, detail = judge(ask_child(request, _probe_seconds()), expected_hash())
    if verdict == "timeout":
        detail += "; CLRENDER_PROBE_SECONDS allows more"
    if verdict == "crashed" and not _scarce(detail):
        verdict, detail = _without_cache(request, verdict, detail)
    program_cache.limit_compiler_folder()  # done here because few processes probe
    if verdict == "ok" or not (verdict == "timeout" or _scarce(detail) or _limited()):
        name = _verdict_name(info, driver, *(() if verdict == "ok" else _environment()))
        kept = {"probe": verdict, "detail": detail, "device": info.title, "time": time.time()}
        cache.write_json(name, kept)
    return replace(info, probe=verdict, detail=detail)


def _scarce(detail: str) -> bool:
    """Whether a child failed for lack of memory, disk space or time, so that a retry may succeed."""
    return any(mark in detail.lower() for mark in _SCARCE)


def _without_cache(request: dict[str, Any], verdict: str, detail: str) -> tuple[str, str]:
    """Probe again with an empty cache, as a damaged entry of the driver's own cache may have caused the crash."""
    try:
        with cache.temporary_folder() as empty:
            changes = {"XDG_CACHE_HOME": str(empty), "POCL_CACHE_DIR": str(empty / "pocl")}
            (empty / "pocl").mkdir()
            second = judge(ask_child(request, _probe_seconds(), changes), expected_hash())
    except OSError:
        return verdict, detail
    if second[0] == "crashed":
        return verdict, detail
    program_cache.renew_compiler_folder()
    return second


def _probe_seconds() -> float:
    try:
        return float(os.environ["CLRENDER_PROBE_SECONDS"])
    except (KeyError, ValueError):
        return PROBE_SECONDS


def prove_fast(device: Device, what: str) -> None:
    """Check once for each driver and version of clrender that with fast code the probe's tile is rendered correctly.

    The probe renders it with small code where there is such, which takes less time to compile and is what renders of
    few samples run.

    Parameters
    ----------
    device : Device
    what : str
        Whether fast code traces the samples (``path``) or does the rest (``common``; see `Device.common_program`).

    Raises
    ------
    RenderError, DeviceError
        When it is not, or rendering fails.
    """
    from clrender.device.worker import probe_hash

    if (device.info.title, what) in _PROVEN_HERE:
        return
    driver = next((each for each in drivers() if each.library == device.info.library), None)
    name = _verdict_name(device.info, driver, "fast", what) if driver else ""
    if driver and cache.read_json(name) == _PROVEN:
        _PROVEN_HERE.add((device.info.title, what))
        return
    proof, device.prove_fast = device.prove_fast, None  # the tile is rendered by that code, too
    try:
        found = probe_hash(device, ("fast" if what == "path" else "small",))
    finally:
        device.prove_fast = proof
    if found != expected_hash():
        raise DeviceError(
            f"{device.info.title} renders the test tile wrongly with fast code, and with small code as it should be: "
            "its compiler changes what the kernels compute; render with --code small (code), or choose another device"
        )
    _PROVEN_HERE.add((device.info.title, what))
    if driver:
        cache.write_json(name, _PROVEN)


def passes_probe(device: Device) -> bool:
    """Whether an open device of this process renders the probe's tile correctly, with every kind of code.

    Raises
    ------
    RenderError, DeviceError
        When rendering fails, or the installation lacks the tile's hash.
    """
    from clrender.device.worker import probe_hash

    return probe_hash(device) == expected_hash()


def judge(answer: Answer, expected: str) -> tuple[str, str]:
    """Verdict on a probe's answer, and the reason if it is not ``ok``."""
    value = answer.value
    if value is None:
        return answer.failure, answer.detail
    if "error" in value:
        return "cannot-build" if value.get("refused") else "crashed", str(value["error"])
    differences = "; ".join(value.get("differences", []))
    if value.get("hash") != expected:
        reason = differences or "single operations are right, so its compiler changes what the kernels compute"
        return "wrong-result", f"the test tile differs ({reason})"
    return "ok", differences
