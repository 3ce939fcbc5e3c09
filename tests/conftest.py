"""Fixtures of all tests: devices, and a cache folder of the session's own.

``CLRENDER_TEST_DEVICE`` names another device than PoCL for the tests that use one.
"""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from clrender.device import Device

__all__: list[str] = []

# A shell that starts the tests in the background has them ignore Ctrl-C, and so would the programs they send it to.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache folder that no other session shares: neither verdicts nor compiled kernels of before can hide a fault."""
    alone, base = "PYTEST_XDIST_WORKER" not in os.environ, tmp_path_factory.getbasetemp()
    folder = (base if alone else base.parent) / "cache"  # one for all workers
    folder.mkdir(exist_ok=True)
    before = {name: os.environ.get(name) for name in ("XDG_CACHE_HOME", "POCL_CACHE_DIR")}
    os.environ["XDG_CACHE_HOME"] = str(folder)
    os.environ.pop("POCL_CACHE_DIR", None)
    yield folder
    for name, value in before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    if alone:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def all_devices(cache_folder: Path) -> list[Device]:
    """Every device that passes the probe, PoCL first where it is installed."""
    from clrender.device import select

    return sorted(select("all"), key=lambda device: "pocl" not in device.info.version.lower())


@pytest.fixture(scope="session")
def device(cache_folder: Path) -> Device:
    """The device to test on: PoCL, or the one that CLRENDER_TEST_DEVICE names."""
    from clrender.device import select

    return select(os.environ.get("CLRENDER_TEST_DEVICE", "pocl"))[0]
