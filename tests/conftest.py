"""Fixtures of all tests: devices, and a cache folder of the session's own.

``CLRENDER_TEST_DEVICE`` names another device than PoCL for the tests that use one.
"""

from __future__ import annotations

import argparse
import gc
import os
import shutil
import signal
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from view_clients import EngineClient

    from clrender.device import Device
    from clrender.view import Engine

__all__: list[str] = []

PARTS = ("::test_many_mixed_scenes",)
"""Tests of minutes, which would leave one process with the last file."""

# No test depends on the load of the machine.
settings.register_profile("unhurried", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("unhurried")

# A shell that starts the tests in the background has them ignore Ctrl-C, and so would the programs they send it to.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _part(text: str) -> tuple[int, int]:
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise argparse.ArgumentTypeError(f"{text!r} is no part; the second of four is 2/4")
    return int(number), int(count)


def pytest_addoption(parser: pytest.Parser) -> None:
    what = "one of N parts of about the same size, for several machines or for one run after the other"
    parser.addoption("--part", metavar="K/N", type=_part, default=(1, 1), help=what)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the tests of ``--part``: by their names, so that all processes and machines agree on them."""
    for item in items:
        if " at 0x" in item.nodeid:
            raise pytest.UsageError(f"{item.nodeid} is another name in each process; give its cases ids")
    number, count = config.getoption("part")
    items[:] = [item for item in items if zlib.crc32(item.nodeid.encode()) % count == number - 1]


def pytest_collection_finish() -> None:
    """Spare the garbage collector what lives to the end, and run it as seldom as the command line does."""
    from clrender.__main__ import COLLECT_EVERY

    gc.collect()
    gc.freeze()
    gc.set_threshold(COLLECT_EVERY)


@pytest.fixture(autouse=True)
def own_random_numbers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a module's ``RNG`` begin anew in each test: what it draws depends on no test before it in its process."""
    import numpy as np

    if isinstance(getattr(request.module, "RNG", None), np.random.Generator):
        monkeypatch.setattr(request.module, "RNG", np.random.default_rng(zlib.crc32(request.node.nodeid.encode())))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep files together with ``--dist loadfile``, but not the parts of a test that are to run side by side."""
    if config.option.dist != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    scheduler = LoadFileScheduling(config, log)
    file_of = scheduler._split_scope
    scheduler._split_scope = lambda test: test if test.partition("[")[0].endswith(PARTS) else file_of(test)
    return scheduler


@pytest.fixture(scope="session", autouse=True)
def cache_folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache folder that no other session shares: no verdict or list of before can hide a fault.

    But what compilers made is kept from run to run, by hash of source, options and driver, in the user's own cache:
    it takes minutes to make. ``CLRENDER_TEST_COLD=1`` compiles all anew.

    And rusticl takes a third less to compile without LLVM's passes, which the slow tests have it run.
    """
    slow = "not slow" not in request.config.getoption("markexpr")
    alone, base = "PYTEST_XDIST_WORKER" not in os.environ, tmp_path_factory.getbasetemp()
    folder = (base if alone else base.parent) / "cache"  # one for all workers
    folder.mkdir(exist_ok=True)
    changes = {
        "XDG_CACHE_HOME": str(folder), "POCL_CACHE_DIR": None,
        "CLRENDER_CLUSTER_SECONDS": "120",  # of a scheduler on a machine that other tests keep busy
        **_kept_kernels(folder), **_kept_drivers(folder),
        **({} if slow or "GALLIVM_PERF" in os.environ else {"GALLIVM_PERF": "nopt"}),
    }  # fmt: skip
    before = {name: os.environ.get(name) for name in changes}
    _set(changes)
    yield folder
    _set(before)
    if alone:
        shutil.rmtree(folder, ignore_errors=True)


def _kept_kernels(folder: Path) -> dict[str, str | None]:
    """Link what compilers made for earlier sessions into a cache folder; variables that say the same to drivers."""
    from clrender.device import cache

    kept = cache.cache_folder()
    if kept is None or os.environ.get("CLRENDER_TEST_COLD"):
        return {}
    _copy_first(kept / "compiled", kept / "tests" / "compiled")
    for name in ("compiled", "mesa"):
        (kept / "tests" / name).mkdir(mode=0o700, parents=True, exist_ok=True)
    (folder / "clrender").mkdir(mode=0o700, exist_ok=True)
    with suppress(FileExistsError):  # of another worker
        (folder / "clrender" / "compiled").symlink_to(kept / "tests" / "compiled")
    return {"MESA_SHADER_CACHE_DIR": os.environ.get("MESA_SHADER_CACHE_DIR", str(kept / "tests" / "mesa"))}


def _copy_first(made: Path, kept: Path) -> None:
    """Begin with what set-up has just compiled to probe the device."""
    if kept.exists() or not made.is_dir():
        return
    kept.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    part = kept.with_name(f"compiled.{os.getpid()}.part")
    try:
        shutil.copytree(made, part)
        part.rename(kept)
    except OSError:  # another worker's is there; or a compiler at work has removed a file meanwhile
        shutil.rmtree(part, ignore_errors=True)


def _kept_drivers(folder: Path) -> dict[str, str | None]:
    """The machine's list of drivers as it is now: one that is installed or removed meanwhile changes no test."""
    from clrender.drivers import discover

    found = discover.drivers()
    if os.environ.get("OCL_ICD_VENDORS") or not all(driver.library for driver in found):
        return {}
    vendors = folder / "vendors"
    vendors.mkdir(exist_ok=True)
    for driver in found:
        named = Path(driver.origin if driver.origin.endswith(".icd") else f"{driver.library}.icd").name
        file = vendors / f"{os.getpid()}.part"
        file.write_text(f"{driver.library}\n")
        file.replace(vendors / named)
    return {"OCL_ICD_VENDORS": str(vendors)}


def _set(variables: dict[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


@pytest.fixture(scope="session", autouse=True)
def own_programs() -> Iterator[None]:
    """Every scene is rendered by its own program, as long renders are, whichever have been compiled before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("clrender.rendering.job_render.STAND_INS", False)
        yield


@pytest.fixture
def small_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process counts 8 MiB of a render's memory, not what earlier tests left in it: at times gigabytes."""
    monkeypatch.setattr("clrender.rendering.memory.process_bytes", lambda: 8 << 20)


@pytest.fixture(scope="session")
def all_devices(request: pytest.FixtureRequest, cache_folder: Path) -> list[Device]:
    """Every device that passes the probe, PoCL first where it is installed.

    Without the long tests, the device to test on alone: rusticl compiles for minutes, and the probe's tile has known
    bits, the same on every driver.
    """
    from clrender.drivers import select
    from clrender.drivers.probe import inventory

    if "not long" in request.config.getoption("markexpr"):
        return select(os.environ.get("CLRENDER_TEST_DEVICE", "pocl"))
    with pytest.MonkeyPatch.context() as patch:
        # Beside other tests rusticl's probe takes several times as long as alone.
        patch.setenv("CLRENDER_PROBE_SECONDS", os.environ.get("CLRENDER_PROBE_SECONDS", "1800"))
        chosen = select("all")
    late = [info.title for info in inventory() if info.probe == "unknown"]
    assert not late, f"the tests of {late} would fall away: no verdict of their probes was kept"
    return sorted(chosen, key=lambda device: "pocl" not in device.info.version.lower())


@pytest.fixture(scope="session")
def device(cache_folder: Path) -> Device:
    """The device to test on: PoCL, or the one that CLRENDER_TEST_DEVICE names."""
    from clrender.drivers import select

    return select(os.environ.get("CLRENDER_TEST_DEVICE", "pocl"))[0]


@pytest.fixture(scope="module")
def only_driver(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """No driver but that of the device to test on, in child processes too: a view probes all, which takes a minute."""
    folder = tmp_path_factory.mktemp("vendors")
    (folder / "only.icd").write_text(f"{device.info.library}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OCL_ICD_VENDORS", str(folder))
        yield


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium; without one the tests are skipped."""
    from view_browser import chromium

    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a scene of a ball on a table."""
    from view_browser import SCENE

    path = tmp_path_factory.mktemp("scene") / "ball.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def opened(device: Device) -> Iterator[Callable[..., tuple[Engine, EngineClient]]]:
    """Opens an engine of the live view, of a small image, with a client; ends it after the test."""
    from view_clients import EngineClient

    import clrender
    from clrender.view import Engine

    engines: list[Engine] = []

    def open_(scene: Any = "room", **options: Any) -> tuple[Engine, EngineClient]:
        description = clrender.load(scene) if isinstance(scene, (str, Path)) else scene
        engines.append(Engine(description, device=device, **{"width": 96, "height": 64, "spp": 4, **options}))
        return engines[-1], EngineClient(engines[-1])

    yield open_
    for engine in engines:
        engine.close()
