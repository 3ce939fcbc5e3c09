"""`clrender devices` and `clrender doctor`, run as a user does, on the real drivers and on broken ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from clrender.device import Device

KEYS = ["index", "name", "platform", "driver", "type", "compute_units", "memory_bytes", "probe"]
VERDICTS = {"ok", "cannot-build", "wrong-result", "crashed", "timeout"}


def run(*arguments: str, **changes: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "clrender", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **changes})


@pytest.fixture
def only_device(device: Device, tmp_path: Path) -> str:
    """A vendors folder with nothing but the driver under test."""
    (tmp_path / "only.icd").write_text(f"{device.info.library}\n")
    return str(tmp_path)


@pytest.mark.long  # probes all drivers
def test_devices_lists_the_device_under_test(device: Device) -> None:
    done = run("devices", "--json")
    assert done.returncode == 0, done.stderr
    listed = json.loads(done.stdout)
    assert [list(each) for each in listed] == [KEYS] * len(listed)
    assert [each["index"] for each in listed] == list(range(len(listed)))
    assert {each["probe"] for each in listed} <= VERDICTS
    assert {"name": device.info.name, "probe": "ok"}.items() <= listed[device.info.index].items()
    assert all(each["compute_units"] > 0 and each["memory_bytes"] > 0 for each in listed)


@pytest.mark.long  # probes all drivers
def test_devices_as_a_table(device: Device) -> None:
    done = run("devices")
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stdout.splitlines() if line.startswith(f"{device.info.index} ")]
    assert device.info.name in line
    assert line.endswith("ok")


@pytest.mark.long
def test_python_prints_the_same(device: Device) -> None:
    import clrender

    assert clrender.devices() == json.loads(run("devices", "--json").stdout)


def in_python(code: str, **changes: str) -> subprocess.CompletedProcess[str]:
    """Python in a process of its own, where no driver is loaded yet."""
    root = str(Path(__file__).resolve().parents[2])
    env = {**os.environ, "PYTHONPATH": root, **changes}
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=env)


RENDERS = """
import os, sys, clrender
before = dict(os.environ)
scene = clrender.load("room")
for device in sys.argv[1:] or DEVICES:
    notify = None if device.startswith("-") else print
    image = clrender.render(scene, size=(16, 16), spp=1, device=device.strip("-"), notify=notify)
    print("hash", image.stats["image_sha256"])
assert dict(os.environ) == before, set(os.environ.items()) ^ set(before.items())
"""


@pytest.mark.long
@pytest.mark.parametrize("quiet", ["", "-"], ids=["told", "quiet"])
def test_one_driver_after_another_in_one_process(all_devices: list[Device], quiet: str) -> None:
    """Whatever else is asked for; and the process keeps its environment."""
    libraries = {device.info.library: device.info for device in all_devices}
    if len(libraries) < 2:
        pytest.skip("one driver only")
    names = [f"{quiet}{info.index}" for info in libraries.values()]
    done = in_python(RENDERS.replace("DEVICES", repr([*names, names[0]])))
    assert done.returncode == 0, done.stderr
    hashes = [line for line in done.stdout.splitlines() if line.startswith("hash")]
    assert len(hashes) == len(names) + 1
    assert len(set(hashes)) == 1


@pytest.mark.long
def test_another_program_may_have_used_pyopencl_before(device: Device) -> None:
    code = "import pyopencl; pyopencl.get_platforms()\n" + RENDERS.replace("DEVICES", repr([str(device.info.index)]))
    done = in_python(code)
    assert done.returncode == 0, done.stderr
    assert "hash" in done.stdout


@pytest.mark.long  # two drivers
def test_only_the_drivers_that_are_wanted_are_loaded(all_devices: list[Device]) -> None:
    libraries = list({device.info.library: device.info for device in all_devices}.values())
    if len(libraries) < 2:
        pytest.skip("one driver only")
    wanted, other = libraries[0], libraries[-1]
    code = f"from clrender.drivers import select; select('{wanted.index}'); print(open('/proc/self/maps').read())"
    done = in_python(code)
    assert done.returncode == 0, done.stderr
    assert Path(wanted.library).name in done.stdout
    assert Path(other.library).name not in done.stdout


def test_a_home_that_cannot_be_written(device: Device, cache_folder: Path, tmp_path: Path) -> None:
    """Kernels and verdicts then lie in the temporary folder."""
    own = tmp_path / f"clrender-cache-{os.geteuid()}"
    own.mkdir(mode=0o700)
    for name in ("compiled", "drivers", "verdicts"):  # or all would be compiled once more
        (own / name).symlink_to(cache_folder / "clrender" / name)
    changes = {"HOME": "/proc", "XDG_CACHE_HOME": "", "TMPDIR": str(tmp_path)}
    output = str(tmp_path / "a.png")
    done = run("render", "room", "--size", "16x16", "--spp", "1", "-o", output, "-d", str(device.info.index), **changes)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert Path(output).exists()
    told = json.loads(run("doctor", "--json", OCL_ICD_VENDORS=str(tmp_path), **changes).stdout)
    (finding,) = [finding for finding in told["findings"] if finding["subject"] == "the cache folder"]
    assert finding["cause"] == f"/proc/.cache/clrender cannot be made, so compiled kernels are kept in {own}"


def test_a_program_is_built_by_the_public_interface_too(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """For a pyopencl without the class that is no part of its interface: from source, from a binary, and not at all."""
    from clrender.device import compiler
    from clrender.device.source import Source
    from clrender.errors import DeviceError

    monkeypatch.setattr(compiler, "_plain_program", lambda: None)
    text = f"kernel void answer(global int* a) {{ a[get_global_id(0)] = {os.getpid()}; }}"
    good, bad = Source("good.cl", text, f"good-{os.getpid()}"), Source("bad.cl", "kernel void x( {", "bad")
    context, handle = device._context, device._handle
    for _ in range(2):
        program = compiler.build(context, handle, device.info, device.options, good)
        assert [kernel.function_name for kernel in program.all_kernels()] == ["answer"]
        compiler.store(device.info, device.options, good, program)
    with pytest.raises(DeviceError, match=r"cannot build bad.cl: .*error"):
        compiler.build(context, handle, device.info, device.options, bad)


def test_doctor_is_content_with_one_good_driver(only_device: str) -> None:
    done = run("doctor", OCL_ICD_VENDORS=only_device)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("at least one device is ok\n")
    assert "FAULT" not in done.stdout


@pytest.mark.long
def test_doctor_names_a_missing_library_beside_a_good_driver(only_device: str) -> None:
    Path(only_device, "broken.icd").write_text("/nowhere/libpocl.so.9\n")
    done = run("doctor", "--json", OCL_ICD_VENDORS=only_device)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["ok"] is True
    assert [finding["subject"] for finding in told["findings"] if not finding["harmless"]] == [
        f"{only_device}/broken.icd"
    ]
    assert "--reinstall pocl-opencl-icd" in told["findings"][0]["cure"]


def test_without_a_driver(tmp_path: Path) -> None:
    empty = str(tmp_path)
    done = run("doctor", OCL_ICD_VENDORS=empty)
    assert done.returncode == 3
    assert "unset OCL_ICD_VENDORS" in done.stdout
    assert "no device is ok" in done.stdout
    assert json.loads(run("devices", "--json", OCL_ICD_VENDORS=empty).stdout) == []
    assert "clrender doctor" in run("devices", OCL_ICD_VENDORS=empty).stdout


def test_nothing_is_read_from_the_users_folder(only_device: str, tmp_path: Path) -> None:
    for name in ("numpy", "pyopencl", "clrender"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('imported the wrong one')")
    code = "from clrender.drivers.probe import survey; print([report.fault for report in survey(refresh=True)])"
    root = str(Path(__file__).resolve().parents[2])
    command = [sys.executable, "-c", f"import os, sys; sys.path[0] = {root!r}; os.chdir({str(tmp_path)!r}); {code}"]
    env = {**os.environ, "OCL_ICD_VENDORS": only_device}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    assert done.stdout == "['']\n", done.stderr
