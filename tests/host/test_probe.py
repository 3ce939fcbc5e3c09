"""The probe against drivers that crash, hang, lie or are not there, each in a process of its own."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from clrender.device import cache, discover
from clrender.device import probe as probe_module
from clrender.device.device import DeviceInfo
from clrender.device.diagnose import diagnose, diagnose_device, diagnose_driver
from clrender.device.discover import Driver
from clrender.device.probe import MARK, Answer, DriverReport, ask, examine, inventory, judge, probe, survey

GOOD = "0" * 64
LISTING: dict[str, Any] = {
    "fault": "",
    "platforms": [
        {"name": "Twin", "version": "OpenCL 3.0", "devices": []},
        {
            "name": "Twin",
            "version": "OpenCL 1.2",
            "devices": [
                {"name": "one", "driver": "7", "type": "gpu", "compute_units": 4, "memory_bytes": 2**30},
                {"name": "one", "driver": "7", "type": "gpu", "compute_units": 4, "memory_bytes": 2**30},
            ],
        },
    ],
}


def script(answer: dict[str, Any] | None = None, before: str = "") -> list[str]:
    """A driver's child process: some Python, then an answer."""
    code = before + (f"\nprint({MARK + json.dumps(answer)!r})" if answer is not None else "")
    return [sys.executable, "-c", code]


@pytest.fixture(autouse=True)
def _own_cache_and_hash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("POCL_CACHE_DIR", raising=False)
    expected = tmp_path / "expected"
    expected.write_text(GOOD + "\n")
    monkeypatch.setattr(probe_module, "EXPECTED_FILE", expected)


@pytest.fixture
def fake_driver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """One driver whose children are scripts; the list holds what the next children are, the last for ever."""
    library = tmp_path / "libfake.so"
    library.touch()
    folder = tmp_path / "vendors"
    folder.mkdir()
    (folder / "fake.icd").write_text(f"{library}\n")
    monkeypatch.setenv("OCL_ICD_VENDORS", str(folder))
    scripts = [script(LISTING)]

    def ask_script(request: dict[str, Any], seconds: float, changes: dict[str, str] | None = None) -> Answer:
        command = scripts.pop(0) if len(scripts) > 1 else scripts[0]
        return ask(command, 5.0, changes)

    monkeypatch.setattr(probe_module, "ask_child", ask_script)
    return scripts


def test_an_answer_is_found_among_what_a_driver_prints() -> None:
    noise = "import sys; print('driver says hello'); print('warning', file=sys.stderr)"
    assert ask(script({"hash": "x"}, noise), 5.0) == Answer({"hash": "x"})


def test_a_child_that_dies_by_a_signal_has_crashed() -> None:
    answer = ask(script(before="import os, sys; print('boom', file=sys.stderr, flush=True); os.abort()"), 5.0)
    assert answer.failure == "crashed"
    assert "SIGABRT" in answer.detail
    assert "boom" in answer.detail


def test_a_child_that_ends_without_an_answer_has_crashed() -> None:
    assert ask(script(before="raise SystemExit(0)"), 5.0).failure == "crashed"
    assert "exit status 7" in ask(script(before="raise SystemExit(7)"), 5.0).detail


def test_a_child_that_hangs_is_killed_with_all_it_started() -> None:
    begin = time.monotonic()
    hang = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(60)'])"
    answer = ask(script(before=hang), 1.0)
    assert answer.failure == "timeout"
    assert time.monotonic() - begin < 10


def test_a_child_does_not_import_what_lies_in_the_users_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit('imported the wrong one')")
    monkeypatch.chdir(tmp_path)
    assert ask([sys.executable, "-c", f"import json; print({MARK + '{}'!r})"], 5.0) == Answer({})


@pytest.mark.parametrize(
    ("answer", "verdict", "reason"),
    [
        (Answer({"hash": GOOD, "differences": []}), "ok", ""),
        (Answer({"hash": GOOD, "differences": ["fma differs"]}), "ok", "fma differs"),
        (Answer({"hash": "other", "differences": ["/ differs"]}), "wrong-result", "/ differs"),
        (Answer({"hash": "other", "differences": []}), "wrong-result", "single operations are right"),
        (Answer({"stage": "render", "refused": True, "error": "no such target"}), "cannot-build", "no such target"),
        (Answer({"stage": "render", "refused": False, "error": "OUT_OF_RESOURCES"}), "crashed", "OUT_OF_RESOURCES"),
        (Answer(None, "crashed", "killed by SIGSEGV"), "crashed", "SIGSEGV"),
        (Answer(None, "timeout", "no answer after 5 s"), "timeout", "no answer"),
    ],
)
def test_verdicts(answer: Answer, verdict: str, reason: str) -> None:
    found, detail = judge(answer, GOOD)
    assert found == verdict
    assert reason in detail


def test_two_platforms_of_one_name_and_one_without_a_device(fake_driver: list[list[str]]) -> None:
    (report,) = survey()
    assert report.platforms == (("Twin", "OpenCL 3.0", 0), ("Twin", "OpenCL 1.2", 2))
    assert [(info.index, info.ordinal, info.probe) for info in report.devices] == [(0, 0, "unknown"), (1, 1, "unknown")]


def test_a_verdict_is_kept_until_the_driver_changes(fake_driver: list[list[str]], tmp_path: Path) -> None:
    first = inventory()[0]
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    assert probe(first).probe == "ok"
    fake_driver[:] = [script(before="raise SystemExit(1)")]
    assert [info.probe for info in inventory()] == ["ok", "unknown"]
    (tmp_path / "libfake.so").write_bytes(b"a new version")
    fake_driver[:] = [script(LISTING)]
    assert [info.probe for info in inventory()] == ["unknown", "unknown"]


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"probe": "ok"}', b"\xff\xff"])
def test_a_damaged_verdict_is_no_verdict(fake_driver: list[list[str]], damage: bytes) -> None:
    info = inventory()[0]
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    probe(info)
    (kept,) = (cache.cache_folder() / "verdicts").iterdir()
    kept.write_bytes(damage)
    assert inventory()[0].probe == "unknown"


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b"{}"])
def test_a_damaged_listing_is_asked_for_again(fake_driver: list[list[str]], damage: bytes) -> None:
    before = inventory()
    (kept,) = (cache.cache_folder() / "drivers").iterdir()
    kept.write_bytes(damage)
    assert inventory() == before


def test_a_crash_that_an_empty_cache_cures_costs_the_cache_and_no_verdict(fake_driver: list[list[str]]) -> None:
    info = inventory()[0]
    before = cache.compiler_folder()
    fake_driver[:] = [script(before="import os; os.abort()"), script({"hash": GOOD, "differences": []})]
    assert probe(info).probe == "ok"
    assert cache.compiler_folder() != before


def test_a_crash_that_stays_is_a_crash(fake_driver: list[list[str]]) -> None:
    info = inventory()[0]
    before = cache.compiler_folder()
    fake_driver[:] = [script(before="import os; os.abort()")]
    assert probe(info).probe == "crashed"
    assert cache.compiler_folder() == before


def test_a_driver_that_crashes_when_listed_is_a_fault_with_a_cure(fake_driver: list[list[str]]) -> None:
    fake_driver[:] = [script(before="import os; os.abort()")]
    (report,) = examine()
    assert "SIGABRT" in report.fault
    assert "update or remove" in diagnose_driver(report)[0].cure


def test_broken_icd_files_are_named_and_harm_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "vendors"
    folder.mkdir()
    text = tmp_path / "libtext.so"
    text.write_text("this is no library")
    (folder / "1-empty.icd").touch()
    (folder / "2-missing.icd").write_text("/nowhere/libnvidia-opencl.so.1\n")
    (folder / "3-text.icd").write_text(f"{text}\n")
    (folder / "4-unknown.icd").write_text("libno-such-driver.so.1")
    (folder / "5-other.txt").write_text("not an icd file")
    monkeypatch.setenv("OCL_ICD_VENDORS", str(folder))
    reports = survey()
    assert [Path(report.driver.origin).name[0] for report in reports] == ["1", "2", "3", "4"]
    faults = [report.fault for report in reports]
    assert "empty" in faults[0]
    assert "does not exist" in faults[1]
    assert "cannot be loaded" in faults[2]
    assert "cannot be loaded" in faults[3]
    findings = diagnose(reports)
    assert "nvidia-opencl-icd" in findings[1].cure
    assert "unset OCL_ICD_VENDORS" in findings[-1].cure


def test_a_wheels_icd_file_with_a_placeholder_is_mended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vendors = tmp_path / "etc" / "OpenCL" / "vendors"
    vendors.mkdir(parents=True)
    (vendors / "intel-cpu.icd").write_text("/opt/placeholder/lib/libintelocl.so\n")
    (vendors / "intel-emulator.icd").write_text("/opt/placeholder/lib/libintelocl_emu.so\n")
    library = tmp_path / "lib" / "libintelocl.so"
    library.parent.mkdir()
    library.touch()
    (tmp_path / "lib" / "libtbb.so.12").touch()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(discover, "SYSTEM_FOLDER", tmp_path / "none")
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    found = [driver for driver in discover.drivers() if driver.origin.startswith(str(tmp_path))]
    assert [driver.library for driver in found] == [str(library)]
    assert found[0].preload == (str(tmp_path / "lib" / "libtbb.so.12"),)
    assert not found[0].fault


def test_the_users_own_vendors_are_the_only_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    assert discover.drivers() == []
    file = tmp_path / "single.icd"
    file.write_text("libsingle.so")
    assert [driver.library for driver in discover.drivers()] == ["libsingle.so"]
    monkeypatch.setenv("OCL_ICD_VENDORS", str(file))
    assert [driver.library for driver in discover.drivers()] == ["libsingle.so"]


def test_settings_of_the_user_win(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RUSTICL_ENABLE", "iris")
    monkeypatch.delenv("CL_CONFIG_CPU_VECTORIZER_MODE", raising=False)
    discover.environment()
    assert os.environ["RUSTICL_ENABLE"] == "iris"
    assert os.environ["CL_CONFIG_CPU_VECTORIZER_MODE"] == "1"


def test_a_process_that_died_in_a_compiler_costs_the_compiled_kernels() -> None:
    before = cache.compiler_folder()
    sentinel = cache.Sentinel()
    sentinel.put()
    assert cache.compiler_folder() == before, "this process lives"
    sentinel.take()
    child = (
        "import os, sys; sys.path.insert(0, sys.argv[1])\n"
        "from clrender.device.cache import Sentinel\nSentinel().put()\nos.kill(os.getpid(), 9)"
    )
    os.spawnv(os.P_WAIT, sys.executable, [sys.executable, "-c", child, str(Path(cache.__file__).parents[2])])
    assert cache.compiler_folder() != before
    assert cache.compiler_folder() == cache.compiler_folder()


@pytest.mark.parametrize(("most", "renews"), [(93_000, False), (92_000, True)])
def test_compiled_kernels_do_not_pile_up(
    fake_driver: list[list[str]], monkeypatch: pytest.MonkeyPatch, most: int, renews: bool
) -> None:
    """A probe looks after them. A generation stays for the processes that use it, and goes with the next."""
    monkeypatch.setattr(cache, "_MOST_BYTES", most)
    info = inventory()[0]
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    before = cache.compiler_folder()
    cache.store_binary("key", bytes(92_000))  # and a checksum
    assert probe(info).probe == "ok"
    assert (cache.compiler_folder() != before) == renews
    assert before.exists()
    cache.renew_compiler_folder()
    assert before.exists() != renews


def test_a_kept_binary_with_one_wrong_byte_is_not_used() -> None:
    cache.store_binary("key", b"binary")
    assert cache.load_binary("key") == b"binary"
    (path,) = (cache.compiler_folder() / "programs").iterdir()
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(bytes(data))
    assert cache.load_binary("key") is None
    assert cache.load_binary("key") is None


def test_a_cache_folder_that_cannot_be_written_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocker = tmp_path / "file"
    blocker.touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocker))
    assert os.access(cache.cache_folder(), os.W_OK)


def finding(info: DeviceInfo) -> str:
    (found,) = diagnose_device(info, Driver("libx.so", "/etc/OpenCL/vendors/x.icd"))
    return f"{found.cause} {found.cure}"


def test_cures_fit_causes(monkeypatch: pytest.MonkeyPatch) -> None:
    info = DeviceInfo(0, "d", "Portable Computing Language", "3.0", "cpu", 1, 1)
    assert not diagnose_device(DeviceInfo(0, "d", "p", "1", "cpu", 1, 1, "ok"), Driver("x", "y"))
    wheel = DeviceInfo(**{**vars(info), "probe": "cannot-build", "detail": "error: unknown target CPU 'generic'"})
    assert "apt-get install pocl-opencl-icd" in finding(wheel)
    monkeypatch.setenv("CL_CONFIG_CPU_VECTORIZER_MODE", "0")
    intel = DeviceInfo(**{**vars(info), "platform": "Intel(R) OpenCL", "probe": "wrong-result", "detail": "dark"})
    assert "set CL_CONFIG_CPU_VECTORIZER_MODE=1" in finding(intel)
    assert "CLRENDER_PROBE_SECONDS" in finding(DeviceInfo(**{**vars(info), "probe": "timeout"}))
    monkeypatch.setenv("RUSTICL_ENABLE", "iris")
    rusticl = DriverReport(Driver("libRusticlOpenCL.so.1", "rusticl.icd"), "", (("rusticl", "OpenCL 3.0", 0),), ())
    assert "unset RUSTICL_ENABLE" in diagnose_driver(rusticl)[0].cure
    clover = DriverReport(Driver("libMesaOpenCL.so.1", "mesa.icd"), "", (("Clover", "OpenCL 1.1", 0),), ())
    assert diagnose_driver(clover)[0].harmless
