"""Drivers of GPUs are found by their libraries' names where no `.icd` file names them. PoCL stands in for them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from clrender.drivers import discover, vendor_libraries
from clrender.drivers.diagnose import diagnose_driver
from clrender.drivers.probe import DriverReport, ask_child

if TYPE_CHECKING:
    from clrender.device import Device


@pytest.fixture
def nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine without `.icd` files, linker cache and usual folders; gives a folder in LD_LIBRARY_PATH."""
    folder = tmp_path / "lib" / "some"
    folder.mkdir(parents=True)
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    monkeypatch.setenv("LD_LIBRARY_PATH", f"/nowhere::{folder}")
    monkeypatch.setattr(discover, "SYSTEM_FOLDER", tmp_path / "vendors")
    monkeypatch.setattr(discover, "_wheel_folders", list)
    monkeypatch.setattr(vendor_libraries, "_LINKER_CACHE", tmp_path / "ld.so.cache")
    monkeypatch.setattr(vendor_libraries, "_FOLDERS", ())
    monkeypatch.setattr(vendor_libraries, "_VENDOR_FOLDERS", (str(tmp_path / "vendor"),))
    return folder


@pytest.mark.parametrize("library", vendor_libraries.LIBRARIES)
def test_a_library_without_an_icd_file_lists_its_devices(device: Device, nothing_else: Path, library: str) -> None:
    """What is a link to PoCL is found, and loaded in a process of its own."""
    _link(device, nothing_else / library)
    (driver,) = discover.drivers()
    assert driver.library == driver.path == str(nothing_else / library)
    assert "found by its name" in driver.origin and str(nothing_else) in driver.origin
    answer = ask_child({"task": "list", "driver": asdict(driver)}, 60.0)
    assert answer.value is not None, answer.detail
    (platform,) = answer.value["platforms"]
    assert platform["name"] == "Portable Computing Language"
    assert [each["type"] for each in platform["devices"]] == ["cpu"]


def _link(device: Device, library: Path) -> None:
    """Make a link to the driver that the tests run on, which looks for parts of itself beside it."""
    name = Path(device.info.library).name.split(".so")[0]
    maps = Path("/proc/self/maps").read_text().splitlines()
    (real, *_) = {Path(line.split()[-1]) for line in maps if f"/{name}.so" in line}
    library.symlink_to(real)
    (library.parent / "pocl").symlink_to(real.parent / "pocl")
    share = library.parent.parent.parent / "share"  # as from /usr/lib/x86_64-linux-gnu
    share.mkdir(exist_ok=True)
    (share / "pocl").symlink_to(real.parent.parent.parent / "share" / "pocl")


def test_the_first_place_counts_and_known_drivers_do_not_come_twice(nothing_else: Path, tmp_path: Path) -> None:
    vendor, vendors = tmp_path / "vendor", tmp_path / "vendors"
    vendor.mkdir()
    vendors.mkdir()
    (vendor / "libigdrcl.so").touch()
    assert [driver.library for driver in discover.drivers()] == [str(vendor / "libigdrcl.so")]
    (nothing_else / "libigdrcl.so").touch()
    (nothing_else / "libamdocl64.so").touch()
    found = [str(nothing_else / name) for name in ("libamdocl64.so", "libigdrcl.so")]
    assert [driver.library for driver in discover.drivers()] == found
    # Named by an .icd file, with its folder, under another name, or without a folder
    (vendors / "a.icd").write_text(found[0])
    assert [driver.origin.endswith("a.icd") for driver in discover.drivers()] == [True, False]
    (nothing_else / "libother.so").symlink_to(found[1])
    (vendors / "b.icd").write_text(str(nothing_else / "libother.so"))
    assert [driver.origin.endswith(".icd") for driver in discover.drivers()] == [True, True]
    (vendors / "b.icd").write_text("libigdrcl.so")
    assert [driver.library for driver in discover.drivers()] == [found[0], "libigdrcl.so"]


def test_an_icd_file_may_name_what_the_linker_does_not_find(nothing_else: Path, tmp_path: Path) -> None:
    for folder in ("vendor", "vendors"):
        (tmp_path / folder).mkdir()
    (tmp_path / "vendors" / "nvidia.icd").write_text("libnvidia-opencl.so.1\n")
    library = tmp_path / "vendor" / "libnvidia-opencl.so.1"
    assert [driver.path for driver in discover.drivers()] == [""]
    for name in ("libnvidia-opencl.so.1", "libcuda.so.1", "libnvidia-nvvm.so.4", "libnvidia-gpucomp.so.570.1"):
        (tmp_path / "vendor" / name).touch()
    (driver,) = discover.drivers()
    assert driver.library == driver.path == str(library)
    beside = ("libcuda.so.1", "libnvidia-nvvm.so.4", "libnvidia-gpucomp.so.570.1")
    assert driver.preload == tuple(str(library.parent / name) for name in beside)


def test_the_linkers_cache_is_read(nothing_else: Path, tmp_path: Path) -> None:
    library = tmp_path / "somewhere" / "libamdocl64.so"
    library.parent.mkdir()
    library.touch()
    text = f"glibc-ld.so.cache1.1\0\1\2libamdocl64.so\0{library}\0/gone/libigdrcl.so\0{library}.1\0"
    (tmp_path / "ld.so.cache").write_bytes(text.encode())
    assert [driver.library for driver in discover.drivers()] == [str(library)]
    assert vendor_libraries.linker_looks_in(library)


def test_the_real_cache_knows_the_c_library() -> None:
    assert any(path.is_file() for path in vendor_libraries._cached("libc.so.6"))


def test_whoever_names_places_is_asked_nowhere_else(nothing_else: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (nothing_else / "libamdocl64.so").touch()
    monkeypatch.setenv("OCL_ICD_VENDORS", str(nothing_else))
    assert discover.drivers() == []


def test_what_is_found_and_no_driver_has_a_cure(nothing_else: Path) -> None:
    (nothing_else / "libnvidia-opencl.so.1").write_text("no library")
    (driver,) = discover.drivers()
    answer = ask_child({"task": "list", "driver": asdict(driver)}, 60.0)
    fault = str(answer.detail or answer.value)
    assert "cannot be loaded" in fault
    (finding,) = diagnose_driver(DriverReport(driver, fault, (), ()))
    assert "nvidia-opencl-icd" in finding.cure and "rm" not in finding.cure.split()


WITHOUT_ICD_FILES = (
    "import pathlib, sys; from clrender.drivers import discover; discover.SYSTEM_FOLDER = pathlib.Path('/nowhere'); "
    "discover._wheel_folders = list; from clrender.__main__ import main; main()"
)


@pytest.mark.long
def test_commands_use_what_was_found(device: Device, tmp_path: Path) -> None:
    """`doctor` says where it was, the probe passes, and an image is rendered."""
    library = tmp_path / "lib" / "some" / "libamdocl64.so"
    library.parent.mkdir(parents=True)
    _link(device, library)
    environment = {**os.environ, "LD_LIBRARY_PATH": str(library.parent)}
    environment.pop("OCL_ICD_VENDORS", None)

    def clrender(*arguments: str) -> str:
        command = [sys.executable, "-c", WITHOUT_ICD_FILES, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return done.stdout

    (told,) = json.loads(clrender("doctor", "--json"))["drivers"]
    assert told["library"] == str(library)
    assert told["origin"] == f"found by its name in {library.parent}; no .icd file names it"
    assert [info["probe"] for info in told["devices"]] == ["ok"]
    assert str(library.parent) in clrender("doctor")
    assert "a.png: 16x16" in clrender("render", "room", "--size", "16x16", "--spp", "1", "-o", "a.png")
