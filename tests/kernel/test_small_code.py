"""Code that is compiled in less time for renders of few samples: when it is chosen, and that it changes no bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

import clrender
from clrender.device.compiler import program_key
from clrender.device.device import Device, Program
from clrender.device.info import DeviceInfo
from clrender.device.launch import LaunchConfig
from clrender.device.program_cache import note_run
from clrender.device.small_code import FEW_SAMPLES, SmallCode
from clrender.device.source import SMALL_CODE, load_source
from clrender.device.worker import DeviceWorker, probe_hash
from clrender.drivers import select
from clrender.drivers.probe import expected_hash, passes_probe
from clrender.film.unit import Unit
from clrender.flatten.flat_scene import flatten
from clrender.scene import builtin_names
from clrender.settings import RenderSettings

ENTRY = "film/accumulate.cl"
MACROS = {"LANES": "1"}
POCL = DeviceInfo(0, "CPU", "Portable Computing Language", "3.1", "cpu", 2, 1 << 30, version="OpenCL 2.0 pocl 3.1")


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def small(choice: SmallCode, samples: int) -> bool:
    macros = choice.macros(ENTRY, MACROS, samples)
    assert {**macros, SMALL_CODE: "1"} == {**MACROS, SMALL_CODE: "1"}
    return SMALL_CODE in macros


@pytest.mark.usefixtures("empty_cache")
def test_few_samples_get_small_code() -> None:
    choice = SmallCode(POCL, "-w")
    assert small(choice, 1)
    assert small(choice, FEW_SAMPLES - 1)
    assert not small(choice, 1), "renders add up"
    assert not small(choice, 1), "and fast code that is there is used"
    assert small(choice, 0), "where it was asked for"


@pytest.mark.usefixtures("empty_cache")
def test_many_samples_get_fast_code() -> None:
    choice = SmallCode(POCL, "-w")
    assert not small(choice, FEW_SAMPLES + 1)
    assert not small(choice, 1)


@pytest.mark.usefixtures("empty_cache")
def test_fast_code_of_this_process_is_used() -> None:
    choice = SmallCode(POCL, "-w")
    assert small(choice, 1)
    assert choice.macros(ENTRY, MACROS, None) == MACROS
    assert not small(choice, 1)


@pytest.mark.usefixtures("empty_cache")
def test_fast_code_of_an_earlier_process_is_used() -> None:
    note_run(program_key(POCL, "-w", load_source(ENTRY, MACROS)))
    assert not small(SmallCode(POCL, "-w"), 1)
    assert small(SmallCode(POCL, "-w -another"), 1)


@pytest.mark.parametrize(
    ("version", "type", "possible"),
    [
        ("OpenCL 3.0 PoCL 3.1", "cpu", True),
        ("OpenCL 3.0 PoCL 5.0", "gpu", False),
        ("OpenCL 3.0 CUDA 12", "gpu", False),
        ("OpenCL 3.0 LINUX", "cpu", False),
        ("OpenCL 1.2 (Oclgrind 21.10)", "cpu", False),
    ],
)
def test_only_where_it_was_measured(version: str, type: str, possible: bool) -> None:
    assert SmallCode(replace(POCL, version=version, type=type), "").possible == possible


@pytest.mark.parametrize(("code", "compiled_for"), [(None, 7), ("small", 0), ("fast", None), ("any", None)])
def test_a_render_may_ask_for_either(code: str | None, compiled_for: int | None) -> None:
    settings = RenderSettings(code=code)
    assert LaunchConfig(samples=7, code=settings.code).compiled_for == compiled_for
    with pytest.raises(clrender.UsageError, match="code is 'quick', but must be fast, small or any"):
        RenderSettings(code="quick")


class Miscompiling(Device):
    """The test's device with a compiler that spoils small code: no path of it is finite."""

    def program(
        self, entry: str | Path, defines: Mapping[str, int | str] | None = None, samples: int | None = None
    ) -> Program:
        spoilt: dict[str, int | str] = {} if samples is None else {"INVARIANTS": 1, "INVARIANT_SLACK": "-1.0f"}
        return super().program(entry, {**(defines or {}), **spoilt}, samples)


@pytest.mark.long
def test_the_probe_finds_a_driver_that_spoils_small_code(device: Device) -> None:
    assert probe_hash(device) == expected_hash()
    other = Miscompiling(device.info, device._handle)
    assert passes_probe(other) != other.compiles_small_code
    other.close()


@pytest.mark.long
@pytest.mark.usefixtures("empty_cache")
@pytest.mark.parametrize("code", [None, "small"])
def test_long_paths_go_on_in_fast_code(device: Device, monkeypatch: pytest.MonkeyPatch, code: str | None) -> None:
    """From the next unit on, and unless small code was asked for; so do later renders."""
    opened = Device(device.info, device._handle)
    settings = RenderSettings(width=16, height=16, spp=4).struct(16)
    flat, unit, launch = (
        flatten(clrender.load("sky"), 16, 16),
        Unit(0, 256, 0, 2, 16),
        LaunchConfig(samples=1, code=code),
    )
    worker = DeviceWorker(opened, flat, settings, launch=launch)
    first, few = worker.render(unit), opened.builds
    assert (worker.render(unit).sums == first.sums).all()
    assert opened.builds == few
    monkeypatch.setattr("clrender.device.tracing_program.FEW_RAYS", first.rays)
    assert (worker.render(unit).sums == first.sums).all()
    worker.release()
    assert opened.builds == few + (code is None and opened.compiles_small_code)
    DeviceWorker(opened, flat, settings, launch=launch).release()
    assert opened.builds == few + (code is None and opened.compiles_small_code)
    opened.close()


@pytest.mark.parametrize(
    "scene",
    [name if name == "room" else pytest.param(name, marks=pytest.mark.slow) for name in builtin_names()],
)
def test_both_give_the_same_bits(device: Device, scene: str) -> None:
    opened = select(str(device.info.index))[0]
    described = clrender.load(scene)
    hashes: set[str] = set()
    builds: list[int] = []
    for code in ("fast", "small", None):
        before = opened.builds
        image = clrender.render(described, device=opened, size=(40, 30), spp=4, code=code)
        hashes.add(image.stats["image_sha256"])
        builds.append(opened.builds - before)
    opened.close()
    assert len(hashes) == 1
    assert builds[2] == 0, "what was compiled is used"
    assert (builds[1] > 0) == opened.compiles_small_code
