"""Code that is compiled in less time for renders of few samples: when it is chosen, and that it changes no bit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from unittest.mock import patch

import pytest

import clrender
from clrender.device.compiler import program_key
from clrender.device.device import Device, Program
from clrender.device.info import DeviceInfo
from clrender.device.launch import LaunchConfig
from clrender.device.program_cache import note_run
from clrender.device.scene_arrays import SceneArrays
from clrender.device.small_code import FEW_SAMPLES, SmallCode
from clrender.device.source import SMALL_CODE, load_source
from clrender.device.worker import DeviceWorker, probe_hash
from clrender.drivers import select
from clrender.drivers.probe import expected_hash, passes_probe, prove_fast
from clrender.errors import DeviceError
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
    """The test's device with a compiler that spoils small code, or fast code: no path of it is finite.

    Parameters
    ----------
    device : Device
    spoils_small : bool
    """

    def __init__(self, device: Device, *, spoils_small: bool) -> None:
        super().__init__(device.info, device._handle)
        self._spoils_small = spoils_small

    def program(
        self, entry: str | Path, defines: Mapping[str, int | str] | None = None, samples: int | None = None
    ) -> Program:
        spoilt: dict[str, int | str] = {}
        if (samples == 0) == self._spoils_small and entry == "integrator/path.cl":
            spoilt = {"INVARIANTS": 1, "INVARIANT_SLACK": "-1.0f"}
        return super().program(entry, {**(defines or {}), **spoilt}, samples)


@pytest.mark.long
@pytest.mark.parametrize("spoils_small", [False, True])
def test_the_probe_finds_a_driver_that_spoils_code(device: Device, spoils_small: bool) -> None:
    """The first one only in the code that it renders the tile with, which is small code where there is such."""
    assert probe_hash(device) == expected_hash()
    other = Miscompiling(device, spoils_small=spoils_small)
    assert passes_probe(other) == (spoils_small and not other.compiles_small_code)
    assert (probe_hash(other, ("small",)) == expected_hash()) == (spoils_small != other.compiles_small_code)
    other.close()


@pytest.mark.long
@pytest.mark.usefixtures("empty_cache")
def test_fast_code_is_proven_before_it_traces(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once: then it is known of this driver, and other processes need not."""
    if not device.compiles_small_code:
        pytest.skip("its probe renders with fast code")
    monkeypatch.setattr("clrender.drivers.probe._PROVEN_HERE", set())
    other = Miscompiling(device, spoils_small=False)
    other.prove_fast = partial(prove_fast, other)
    settings = RenderSettings(width=16, height=16, spp=4).struct(16)
    flat = flatten(clrender.load("sky"), 16, 16)
    DeviceWorker(other, flat, settings, launch=LaunchConfig(code="small")).release()
    for _ in range(2):
        with pytest.raises(DeviceError, match=r"renders the test tile wrongly with fast code.*--code small \(code\)"):
            DeviceWorker(other, flat, settings, launch=LaunchConfig(code="fast"))
    other.close()

    proven = list[Sequence[str]]()

    def noted(opened: Device, codes: Sequence[str]) -> str:
        proven.append(codes)
        return probe_hash(opened, codes)

    for _ in range(2):
        opened = Device(device.info, device._handle)
        opened.prove_fast = partial(prove_fast, opened)
        with patch("clrender.device.worker.probe_hash", noted):
            DeviceWorker(opened, flat, settings, launch=LaunchConfig(code="fast")).release()
        opened.close()
        monkeypatch.setattr("clrender.drivers.probe._PROVEN_HERE", set())  # another process reads it from the cache
    assert proven == [("fast",)]


@pytest.mark.long
@pytest.mark.usefixtures("empty_cache")
def test_large_scenes_build_their_tree_by_fast_code(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """And all after them; it is proven, too, by the tile with what else is small code."""
    if not device.compiles_small_code:
        pytest.skip("it has one kind of code")
    opened, proven = Device(device.info, device._handle), list[str]()
    opened.prove_fast = proven.append
    flat = flatten(clrender.load("sky"), 16, 16)
    arrays = SceneArrays(opened, flat)
    assert opened.common_program().is_small and not proven
    monkeypatch.setattr("clrender.device.scene_arrays._MANY_PRIMITIVES", 0)
    others = SceneArrays(opened, flat)
    assert not opened.common_program().is_small
    assert proven == ["common"]
    for tree in (arrays, others):
        tree.release()
    opened.close()
    again = Device(device.info, device._handle)
    assert not again.common_program().is_small, "it is compiled"
    again.close()


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
