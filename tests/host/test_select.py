"""What each `--device` specification chooses, from a list of made-up devices."""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Sequence
from dataclasses import replace

import pytest
from cases import for_each

from clrender.device.info import DeviceInfo
from clrender.drivers import select as select_function
from clrender.drivers.discover import Driver
from clrender.drivers.probe import DriverReport
from clrender.drivers.select import choose
from clrender.errors import DeviceError, UsageError

POCL = "OpenCL 3.0 PoCL 3.1"
KNOWN = [
    DeviceInfo(0, "llvmpipe (LLVM 15)", "rusticl", "22.3", "cpu", 8, 2**31, "ok"),
    DeviceInfo(1, "pthread-EPYC", "Portable Computing Language", "3.0-rc2", "cpu", 64, 2**33, "cannot-build", "x", "w"),
    DeviceInfo(2, "pthread-EPYC", "Portable Computing Language", "3.1", "cpu", 2, 2**33, "ok", "", "s", version=POCL),
    DeviceInfo(3, "AMD EPYC", "Intel(R) OpenCL", "2026", "cpu", 2, 2**34, "ok"),
    DeviceInfo(4, "GeForce 9", "NVIDIA CUDA", "600", "gpu", 100, 2**34, "wrong-result", "/ differs"),
    DeviceInfo(5, "Radeon 1", "AMD APP", "3", "gpu", 40, 2**34, "ok"),
    DeviceInfo(6, "Radeon 2", "AMD APP", "3", "gpu", 60, 2**34, "ok"),
]


def chosen(*specs: str, known: Sequence[DeviceInfo] = KNOWN) -> list[int]:
    return [info.index for info in choose(specs, known, lambda info: info, lambda line: None)]


@for_each(
    ("specs", "indices"),
    [
        (["auto"], [6]),
        (["gpu"], [6]),
        (["cpu"], [2]),
        (["CPU"], [2]),
        (["all"], [0, 2, 3, 5, 6]),
        (["3"], [3]),
        (["radeon"], [6]),
        (["radeon 1"], [5]),
        (["pocl"], [2]),
        (["portable"], [2]),
        (["3", "0", "3", "cpu"], [3, 0, 2]),
    ],
)
def test_what_is_chosen(specs: list[str], indices: list[int]) -> None:
    assert chosen(*specs) == indices


@pytest.mark.parametrize("specs", [["auto"], ["cpu", "all"], ["0", "llvmpipe", "0"]])
def test_a_device_that_fails_is_asked_once(specs: list[str]) -> None:
    """A time-out is not kept, and may take minutes each time."""
    asked: list[int] = []

    def probe(info: DeviceInfo) -> DeviceInfo:
        asked.append(info.index)
        return replace(info, probe="timeout")

    known = [replace(info, probe="unknown") for info in KNOWN]
    with contextlib.suppress(DeviceError):
        choose(specs, known, probe, lambda line: None)
    assert asked
    assert len(set(asked)) == len(asked)


@pytest.mark.parametrize("spec", ["²", "+-3", "+", "0,1"])
def test_what_is_no_number_is_a_name(spec: str) -> None:
    with pytest.raises(UsageError, match="no device has that in its name"):
        chosen(spec)


def test_a_wrong_variable_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        sys.modules[choose.__module__], "survey", lambda **how: [DriverReport(Driver("a", "b"), "", (), tuple(KNOWN))]
    )
    monkeypatch.setenv("CLRENDER_DEVICE", "nonsuch")
    with pytest.raises(UsageError, match=r"^CLRENDER_DEVICE=nonsuch: no device has that in its name"):
        select_function()
    with pytest.raises(UsageError, match=r"^--device other: no device has that in its name"):
        select_function("other")


def test_auto_prefers_pocl_to_layered_drivers_whatever_they_say_of_their_size() -> None:
    assert chosen("auto", known=[info for info in KNOWN if info.type == "cpu"]) == [2]


def test_auto_takes_an_interpreter_last_though_it_says_it_is_a_gpu() -> None:
    interpreter = DeviceInfo(7, "Oclgrind Simulator", "Oclgrind", "21", "gpu", 1, 2**27, "ok")
    assert chosen("auto", known=[interpreter, KNOWN[0]]) == [0]
    assert chosen("auto", known=[interpreter]) == [7]


def test_auto_probes_no_more_than_it_must() -> None:
    probed: list[int] = []

    def probe(info: DeviceInfo) -> DeviceInfo:
        probed.append(info.index)
        return replace(info, probe="ok")

    choose(["auto"], [replace(info, probe="unknown") for info in KNOWN], probe, lambda line: None)
    assert probed == [4]


@pytest.mark.parametrize("spec", ["4", "geforce"])
def test_a_device_that_is_not_ok_is_used_only_by_name_and_with_a_warning(spec: str) -> None:
    lines: list[str] = []
    found = choose([spec], KNOWN, lambda info: info, lines.append)
    assert [info.index for info in found] == [4]
    assert len(lines) == 1
    assert re.search(r"warning: GeForce 9 .* did not pass the probe \(wrong-result: / differs\)", lines[0])
    with pytest.raises(DeviceError, match="no OpenCL GPU device can be used"):
        chosen("gpu", known=KNOWN[:5])


@pytest.mark.parametrize("spec", ["auto", "cpu", "all"])
def test_no_ok_device(spec: str) -> None:
    with pytest.raises(DeviceError, match=r"pthread-EPYC .*: cannot-build.*clrender doctor") as error:
        chosen(spec, known=[KNOWN[1]])
    assert error.value.exit_code == 3


def test_no_device_of_the_kind_and_none_at_all() -> None:
    with pytest.raises(DeviceError, match="no OpenCL GPU device can be used: there is none"):
        chosen("gpu", known=KNOWN[:4])
    with pytest.raises(DeviceError, match="no OpenCL device can be used: there is none"):
        chosen("auto", known=[])


@for_each(
    ("spec", "message"),
    [
        ("7", r"--device 7: there is no device with that index; there are 0 = llvmpipe"),
        ("-1", r"--device -1: there is no device with that index"),
        ("raedon", r"--device raedon: no device has that in its name; did you mean 'radeon'\?"),
        ("gpuu", r"did you mean 'gpu'\?"),
        ("zzzz", r"no device has that in its name; there are 0 = "),
    ],
)
def test_names_that_fit_nothing(spec: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as error:
        chosen(spec)
    assert error.value.exit_code == 2


def test_the_environment_sets_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.drivers.probe.drivers", list)
    monkeypatch.setenv("CLRENDER_DEVICE", "nonsense")
    with pytest.raises(DeviceError, match="no OpenCL device was found"):
        select_function()
