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


def test_devices_lists_the_device_under_test(device: Device) -> None:
    done = run("devices", "--json")
    assert done.returncode == 0, done.stderr
    listed = json.loads(done.stdout)
    assert [list(each) for each in listed] == [KEYS] * len(listed)
    assert [each["index"] for each in listed] == list(range(len(listed)))
    assert {each["probe"] for each in listed} <= VERDICTS
    assert {"name": device.info.name, "probe": "ok"}.items() <= listed[device.info.index].items()
    assert all(each["compute_units"] > 0 and each["memory_bytes"] > 0 for each in listed)


def test_devices_as_a_table(device: Device) -> None:
    done = run("devices")
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stdout.splitlines() if line.startswith(f"{device.info.index} ")]
    assert device.info.name in line
    assert line.endswith("ok")


def test_python_prints_the_same(device: Device) -> None:
    import clrender

    assert clrender.devices() == json.loads(run("devices", "--json").stdout)


def test_doctor_is_content_with_one_good_driver(only_device: str) -> None:
    done = run("doctor", OCL_ICD_VENDORS=only_device)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("at least one device is ok\n")
    assert "FAULT" not in done.stdout


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
    code = "from clrender.device.probe import survey; print([report.fault for report in survey(refresh=True)])"
    root = str(Path(__file__).resolve().parents[2])
    command = [sys.executable, "-c", f"import os, sys; sys.path[0] = {root!r}; os.chdir({str(tmp_path)!r}); {code}"]
    env = {**os.environ, "OCL_ICD_VENDORS": only_device}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    assert done.stdout == "['']\n", done.stderr
