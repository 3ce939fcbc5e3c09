"""The probe against drivers that crash, hang, lie or are not there, each in a process of its own."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cases import for_each

from clrender.device import cache, program_cache
from clrender.device.info import DeviceInfo
from clrender.drivers import discover
from clrender.drivers import probe as probe_module
from clrender.drivers.diagnose import diagnose, diagnose_device, diagnose_driver
from clrender.drivers.discover import Driver
from clrender.drivers.probe import MARK, Answer, DriverReport, ask, examine, inventory, judge, probe, survey
from clrender.drivers.select import select
from clrender.errors import DeviceError

GOOD = "0" * 64
ROOT = str(Path(cache.__file__).parents[2])
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


def cache_files(name: str) -> list[Path]:
    folder = cache.cache_folder()
    assert folder is not None
    return list((folder / name).iterdir()) if (folder / name).is_dir() else []


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

    def next_script(request: dict[str, Any]) -> Sequence[str]:
        return scripts.pop(0) if len(scripts) > 1 else scripts[0]

    monkeypatch.setattr(probe_module, "child_command", next_script)
    monkeypatch.setattr(probe_module, "LIST_SECONDS", 5.0)
    monkeypatch.setenv("CLRENDER_PROBE_SECONDS", "5")
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


def test_a_child_that_hangs_is_killed_with_all_it_started(tmp_path: Path) -> None:
    file = tmp_path / "number"
    hang = (
        "import subprocess, sys; from pathlib import Path\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
        f"Path({str(file)!r}).write_text(str(child.pid)); child.wait()"
    )
    for seconds in (1.0, 4.0, 16.0, 64.0):  # a busy machine may not get so far in a second
        assert ask(script(before=hang), seconds).failure == "timeout"
        if file.exists() and file.read_text():
            break
    status = Path(f"/proc/{file.read_text()}/stat")
    # A busy machine may take a while to end what was killed; without that it would sleep for ten minutes.
    for _ in range(3000):
        # Gone, or killed and not yet collected by whoever adopted it.
        with suppress(OSError):
            if status.read_text().rpartition(")")[2].split()[0] not in "ZX":
                time.sleep(0.1)
                continue
        break
    else:
        pytest.fail("what the child started was not killed")


def test_a_child_is_heard_where_no_disk_has_room(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room() -> None:
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(tempfile, "TemporaryFile", no_room)
    assert ask(script({"hash": "x"}), 5.0) == Answer({"hash": "x"})
    assert (
        "exit status 7: boom" in ask(script(before="print('boom', file=__import__('sys').stderr); exit(7)"), 5.0).detail
    )


def test_a_child_does_not_import_what_lies_in_the_users_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit('imported the wrong one')")
    monkeypatch.chdir(tmp_path)
    assert ask([sys.executable, "-c", f"import json; print({MARK + '{}'!r})"], 5.0) == Answer({})


@for_each(
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


def test_drivers_are_asked_side_by_side(fake_driver: list[list[str]], tmp_path: Path) -> None:
    second = tmp_path / "libother.so"
    second.touch()
    (tmp_path / "vendors" / "other.icd").write_text(f"{second}\n")

    def waits_for(other: str, own: str) -> list[str]:
        # Ends only while the other one runs, too.
        own_file, other_file = str(tmp_path / own), str(tmp_path / other)
        meeting = f"open({own_file!r}, 'w')\nwhile not os.path.exists({other_file!r}): time.sleep(0.01)"
        return script(LISTING, before=f"import os, time\n{meeting}")

    fake_driver[:] = [waits_for("b", "a"), waits_for("a", "b"), script(LISTING)]
    assert [len(report.devices) for report in survey()] == [2, 2]


def test_a_verdict_is_kept_until_the_driver_changes(fake_driver: list[list[str]], tmp_path: Path) -> None:
    first = inventory()[0]
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    assert probe(first).probe == "ok"
    fake_driver[:] = [script(before="raise SystemExit(1)")]
    assert [info.probe for info in inventory()] == ["ok", "unknown"]
    (tmp_path / "libfake.so").write_bytes(b"a new version")
    fake_driver[:] = [script(LISTING)]
    assert [info.probe for info in inventory()] == ["unknown", "unknown"]


def test_several_at_once_probe_once(fake_driver: list[list[str]], tmp_path: Path) -> None:
    """A driver compiles for a minute: ten that ask meanwhile wait for that, and do not compile beside it."""
    info, begun = inventory()[0], tmp_path / "begun"
    begun.mkdir()
    note = f"import os, time; open({str(begun)!r} + f'/{{os.getpid()}}', 'w'); time.sleep(0.5)"
    fake_driver[:] = [script({"hash": GOOD, "differences": []}, before=note)]
    with ThreadPoolExecutor(10) as pool:
        found = list(pool.map(lambda _: probe(info).probe, range(10)))
    assert found == ["ok"] * 10
    assert len(list(begun.iterdir())) == 1


def test_a_lock_that_is_never_released_holds_up_nobody_for_ever(
    fake_driver: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    info = inventory()[0]
    monkeypatch.setenv("CLRENDER_PROBE_SECONDS", "1")
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    driver = next(each for each in discover.drivers() if each.library == info.library)
    with cache.held_alone(probe_module._verdict_name(info, driver), 1.0):
        assert probe(info).probe == "ok"


@pytest.mark.parametrize(
    "failing",
    [
        script(before="import os; os.kill(os.getpid(), 9)"),
        script(before="import time; time.sleep(60)"),
        script(before="import sys; print('std::bad_alloc', file=sys.stderr, flush=True); import os; os.abort()"),
        script({"stage": "render", "refused": False, "error": "clEnqueueNDRangeKernel failed: OUT_OF_RESOURCES"}),
        script({"stage": "render", "refused": True, "error": "LLVM ERROR: IO failure: No space left on device"}),
    ],
    ids=["killed", "time", "memory", "resources", "disk"],
)
def test_what_failed_for_want_of_time_or_memory_is_tried_again(
    fake_driver: list[list[str]], monkeypatch: pytest.MonkeyPatch, failing: list[str]
) -> None:
    monkeypatch.setenv("CLRENDER_PROBE_SECONDS", "1")
    info = inventory()[0]
    fake_driver[:] = [failing]
    assert probe(info).probe != "ok"
    assert inventory()[0].probe == "unknown"
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    assert probe(inventory()[0]).probe == "ok"
    assert inventory()[0].probe == "ok"


@pytest.fixture
def _file_limit() -> Iterator[None]:
    """A limit that stops nothing here."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 40, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("_file_limit")
def test_under_a_limit_only_success_is_kept(fake_driver: list[list[str]]) -> None:
    info = inventory()[0]
    assert cache_files("drivers") == []
    fake_driver[:] = [script({"stage": "render", "refused": True, "error": "no such target"})]
    assert probe(info).probe == "cannot-build"
    assert cache_files("verdicts") == []
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    assert probe(info).probe == "ok"
    assert len(cache_files("verdicts")) == 1


@pytest.mark.parametrize(
    "listing",
    [
        {"fault": "its library cannot be loaded", "platforms": []},
        {"fault": "", "platforms": []},
        {"fault": "", "platforms": [{"name": "Portable Computing Language", "version": "3", "devices": []}]},
    ],
    ids=["fault", "no platform", "no device"],
)
def test_a_list_without_a_device_is_not_kept(fake_driver: list[list[str]], listing: dict[str, Any]) -> None:
    fake_driver[:] = [script(listing), script(LISTING)]
    assert inventory() == []
    assert len(inventory()) == 2


def test_a_list_without_a_device_is_kept_where_that_is_normal(fake_driver: list[list[str]]) -> None:
    """Else every start would ask Clover, which nearly nobody has hardware for."""
    fake_driver[:] = [script({"fault": "", "platforms": [{"name": "Clover", "version": "1", "devices": []}]})]
    assert inventory() == []
    assert len(cache_files("drivers")) == 1


@for_each(
    "name",
    ["POCL_CACHE_DIR", "POCL_DEVICES", "RUSTICL_ENABLE", "CL_CONFIG_X", "OCL_X", "OPENCL_LAYERS", "LD_LIBRARY_PATH",
     "LD_PRELOAD", "MESA_SHADER_CACHE_DIR", "GALLIVM_PERF", "CUDA_VISIBLE_DEVICES", "ROCR_VISIBLE_DEVICES",
     "ZE_AFFINITY_MASK"],
)  # fmt: skip
def test_variables_that_steer_a_driver_are_part_of_what_is_known_of_it(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = Driver("libx.so", "x.icd")
    before = discover.fingerprint(driver)
    monkeypatch.setenv(name, "/elsewhere")
    assert discover.fingerprint(driver) != before


def test_a_driver_that_fails_is_named_when_another_takes_its_place(
    fake_driver: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "vendors" / "other.icd").write_text(f"{tmp_path / 'libfake.so'}.2\n")
    (tmp_path / "libfake.so.2").touch()
    broken = {"fault": "", "platforms": [{"name": "Portable Computing Language", "version": "3", "devices": []}]}
    fake_driver[:] = [script(LISTING), script(broken), script({"hash": GOOD, "differences": []})]
    monkeypatch.setenv("POCL_CACHE_DIR", "/nowhere")
    monkeypatch.setattr(sys.modules["clrender.drivers.select"], "open_devices", lambda chosen, known: list(chosen))
    told: list[str] = []
    select("auto", told.append)
    assert f"{tmp_path / 'libfake.so.2'} offers no device with POCL_CACHE_DIR=/nowhere" in told[0]
    monkeypatch.setenv("POCL_CACHE_DIR", "/elsewhere")  # so what was kept of both no longer counts
    fake_driver[:] = [script(before="import os; os.abort()")]
    with pytest.raises(DeviceError, match=r"no OpenCL device was found .*SIGABRT"):
        select("auto", told.append)


def test_a_probe_ends_with_whoever_asked_for_it(tmp_path: Path) -> None:
    """Also where that one is killed, and with all that the probe started."""
    (tmp_path / "child.py").write_text(
        "import os, subprocess, sys, threading\n"
        f"sys.path.insert(0, {ROOT!r})\n"
        "from clrender.drivers.child import end_with_the_parent\n"
        "threading.Thread(target=end_with_the_parent, daemon=True).start()\n"
        "tool = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        f"open({str(tmp_path / 'new')!r}, 'w').write(f'{{os.getpid()}} {{tool.pid}}')\n"
        f"os.rename({str(tmp_path / 'new')!r}, {str(tmp_path / 'pids')!r})\n"
        "import time; time.sleep(60)\n"
    )
    asking = (
        f"import sys; sys.path.insert(0, {ROOT!r})\n"
        "from clrender.drivers.probe import ask\n"
        f"ask([sys.executable, {str(tmp_path / 'child.py')!r}], 60.0)\n"
    )
    with subprocess.Popen([sys.executable, "-c", asking]) as parent:
        try:
            wait_until((tmp_path / "pids").exists, 30.0)
        finally:
            parent.kill()
    for pid in map(int, (tmp_path / "pids").read_text().split()):
        wait_until(lambda pid=pid: not running(pid), 10.0)  # type: ignore[misc]


def wait_until(condition: Callable[[], bool], seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)


def running(pid: int) -> bool:
    """Whether a process still does anything: one that ended may wait for a parent to hear of it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"probe": "ok"}', b"\xff\xff"])
def test_a_damaged_verdict_is_no_verdict(fake_driver: list[list[str]], damage: bytes) -> None:
    info = inventory()[0]
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    probe(info)
    (kept,) = cache_files("verdicts")
    kept.write_bytes(damage)
    assert inventory()[0].probe == "unknown"


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b"{}"])
def test_a_damaged_listing_is_asked_for_again(fake_driver: list[list[str]], damage: bytes) -> None:
    before = inventory()
    (kept,) = cache_files("drivers")
    kept.write_bytes(damage)
    assert inventory() == before


def test_a_crash_that_an_empty_cache_cures_costs_the_cache_and_no_verdict(fake_driver: list[list[str]]) -> None:
    info = inventory()[0]
    before = program_cache.compiler_folder()
    fake_driver[:] = [script(before="import os; os.abort()"), script({"hash": GOOD, "differences": []})]
    assert probe(info).probe == "ok"
    assert program_cache.compiler_folder() != before


def test_a_crash_that_stays_is_a_crash(fake_driver: list[list[str]]) -> None:
    info = inventory()[0]
    before = program_cache.compiler_folder()
    fake_driver[:] = [script(before="import os; os.abort()")]
    assert probe(info).probe == "crashed"
    assert program_cache.compiler_folder() == before


def test_a_failure_is_kept_for_a_day_and_its_environment(
    fake_driver: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    info, path = inventory()[0], os.environ["PATH"]
    fake_driver[:] = [script(before="import os; os.abort()")]
    monkeypatch.setenv("PATH", "")
    assert probe(info).probe == inventory()[0].probe == "crashed"
    monkeypatch.setenv("PATH", path)
    assert inventory()[0].probe == "unknown"
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    assert probe(info).probe == inventory()[0].probe == "ok"
    monkeypatch.setenv("PATH", "")
    assert inventory()[0].probe == "ok", "what was proven later"
    fake_driver[:] = [script(before="import os; os.abort()")]
    assert probe(info, again=True).probe == inventory()[0].probe == "crashed"
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 86500.0)
    assert inventory()[0].probe == "ok"


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


def test_variables_of_the_user_win_and_ours_stay_out_of_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RUSTICL_ENABLE", "iris")
    monkeypatch.delenv("CL_CONFIG_CPU_VECTORIZER_MODE", raising=False)
    before = dict(os.environ)
    ours = discover.driver_variables()
    assert "RUSTICL_ENABLE" not in ours
    assert ours["CL_CONFIG_CPU_VECTORIZER_MODE"] == "1"
    code = f"import os; print({MARK!r} + '{{\"mode\": ' + os.environ['CL_CONFIG_CPU_VECTORIZER_MODE'] + '}}')"
    assert ask([sys.executable, "-c", code], 5.0) == Answer({"mode": 1})
    assert dict(os.environ) == before


@pytest.mark.parametrize(("most", "renews"), [(93_000, False), (92_000, True)])
def test_compiled_kernels_do_not_pile_up(
    fake_driver: list[list[str]], monkeypatch: pytest.MonkeyPatch, most: int, renews: bool
) -> None:
    """A probe looks after them. A generation stays for the processes that use it, and goes with the next."""
    monkeypatch.setattr(program_cache, "_MOST_BYTES", most)
    info = inventory()[0]
    fake_driver[:] = [script({"hash": GOOD, "differences": []})]
    before = program_cache.compiler_folder()
    program_cache.store_binary("key", bytes(92_000))  # and a checksum
    assert probe(info).probe == "ok"
    assert (program_cache.compiler_folder() != before) == renews
    assert before is not None and before.exists()
    program_cache.renew_compiler_folder()
    assert before.exists() != renews


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


# --- drivers that hang while they are listed, and those that are gone ------------------------------------------------

HANGS = script(before="import time; time.sleep(600)")


def test_a_driver_that_hangs_costs_once(fake_driver: list[list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probe_module, "LIST_SECONDS", 0.3)
    fake_driver[:] = [HANGS]
    (report,) = survey(any_device=True)
    assert "timeout: no answer after 0.3 s" in report.fault
    fake_driver[:] = [script(LISTING)]
    for refresh in (False, True):
        assert survey(refresh=refresh, any_device=True) == [report], "it is remembered"
    assert len(survey(refresh=True)[0].devices) == 2, "until all devices are asked for"
    assert len(survey()[0].devices) == 2


def test_a_driver_that_hangs_is_not_waited_for_where_another_device_has_passed(
    fake_driver: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_driver[:] = [script(LISTING), script({"hash": GOOD, "differences": []})]
    assert probe(inventory()[0]).probe == "ok"
    (tmp_path / "libnew.so").touch()
    (tmp_path / "vendors" / "new.icd").write_text(f"{tmp_path / 'libnew.so'}\n")
    monkeypatch.setattr(probe_module, "LIST_SECONDS", 500.0)
    monkeypatch.setattr(probe_module, "OTHERS_SECONDS", 0.3)
    monkeypatch.setattr(sys.modules["clrender.drivers.select"], "open_devices", lambda chosen, known: list(chosen))
    fake_driver[:] = [HANGS]
    for _ in range(2):
        told: list[str] = []
        select("auto", told.append)
        assert told[0] == (
            f"warning: {tmp_path / 'libnew.so'} cannot be used: listing its devices failed (timeout: no answer after "
            "0.3 s); see `clrender doctor`"
        )
        fake_driver[:] = [script(before="raise SystemExit(9)")]


def test_who_asks_for_a_device_waits_for_all_drivers(
    fake_driver: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may be one of a driver that is slow."""
    seen: list[float] = []

    def answer(process: object, errors: object, seconds: float) -> Answer:
        seen.append(seconds)
        return Answer(LISTING)

    monkeypatch.setattr(probe_module, "_has_passed", lambda kept: True)
    monkeypatch.setattr(probe_module, "_answer", answer)
    survey(refresh=True)
    survey(refresh=True, any_device=True)
    assert seen == [probe_module.LIST_SECONDS, probe_module.OTHERS_SECONDS]


def test_an_icd_file_that_was_left_behind_is_no_reason_to_warn(
    fake_driver: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "libgone-driver.so.1"
    (tmp_path / "vendors" / "gone.icd").write_text(f"{name}\n")
    fault = f"its library cannot be loaded: {name}: cannot open shared object file: No such file or directory"
    monkeypatch.setattr(sys.modules["clrender.drivers.select"], "open_devices", lambda chosen, known: list(chosen))
    fake_driver[:] = [script(LISTING), script({"fault": fault, "platforms": []}), script({"hash": GOOD})]
    for _ in range(2):
        told: list[str] = []
        select("auto", told.append)
        assert not [line for line in told if "gone" in line]
        fake_driver[:] = [script(before="raise SystemExit(9)")]  # nobody is asked again
    assert [report.fault for report in survey() if report.fault] == [fault], "`clrender doctor` still tells"


def test_a_probe_without_an_answer_says_how_to_wait_longer(
    fake_driver: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    inventory()
    monkeypatch.setenv("CLRENDER_PROBE_SECONDS", "0.3")
    fake_driver[:] = [HANGS]
    with pytest.raises(DeviceError, match=r"timeout, no answer after 0\.3 s; CLRENDER_PROBE_SECONDS allows more"):
        select("auto")


def test_a_child_that_gets_little_of_a_processor_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time counts only as far as the child computed, or slept while this process could look."""
    clock = iter(range(10**9))
    late = SimpleNamespace(monotonic=lambda: 0.5 * next(clock))  # each look is
    monkeypatch.setattr(probe_module, "time", late)
    assert ask(script({"hash": "x"}, before="import time; time.sleep(0.5)"), 0.4) == Answer({"hash": "x"})


def test_the_list_of_drivers_is_the_suites_own(cache_folder: Path) -> None:
    """What is installed or removed while the tests run changes none of them."""
    if not os.environ["OCL_ICD_VENDORS"].startswith(str(cache_folder)):
        pytest.skip("OCL_ICD_VENDORS was set")
    origins = [Path(driver.origin) for driver in discover.drivers()]
    assert origins and {path.parent for path in origins} == {cache_folder / "vendors"}
