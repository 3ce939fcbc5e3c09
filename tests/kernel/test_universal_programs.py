"""Programs that render any scene: that they change no bit, when they stand in for a scene's own, and what follows."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import clrender
from clrender import layout
from clrender.device import tracing_program
from clrender.device.compilation import Compilation
from clrender.device.device import Device
from clrender.device.kernel_build import KernelBuild
from clrender.device.launch import LaunchConfig
from clrender.device.small_code import FEW_RAYS, FEW_SAMPLES
from clrender.device.tracing_program import TracingProgram
from clrender.device.worker import DeviceWorker
from clrender.drivers import aside, select
from clrender.drivers.probe import Answer
from clrender.film.unit import Unit
from clrender.flatten.features import Features
from clrender.flatten.flat_scene import flatten
from clrender.integrators.path import INTEGRATOR
from clrender.scene import builtin_names
from clrender.settings import RenderSettings

ENTRY = INTEGRATOR.pipeline.entry
QUICK = ("room", "sky")
"""The environment of the second has an image, and a sun; the first has none of what kernels may take for granted."""


def test_what_is_stated() -> None:
    """Kernels with all features are told which of those that they would take for granted a scene has."""
    flags = [each.name for each in fields(Features) if each.name != "plugins"]
    assert {name for name in flags if not getattr(Features.all(), name)} == {
        *(
            "motion",
            "moving_lights",
            "deformation",
            "grids",
            "glowing_media",
            "curves",
            "hair",
            "measured",
            "dispersion",
            "iridescence",
        )
    }
    assert Features.all().plugins == () and Features.all((("a.h", "text"),)).plugins == (("a.h", "text"),)
    assert Features().stated(masked=False) == 0
    assert Features(opacity=True, sun=True).stated(masked=False) == layout.HAS_SUN
    assert Features(environment_map=True).stated(masked=True) == layout.HAS_ENVIRONMENT_MAP | layout.HAS_MASKED
    everything = layout.HAS_SUN | layout.HAS_MASKED | layout.HAS_ENVIRONMENT_MAP | layout.HAS_HIDDEN_ENVIRONMENT
    everything |= layout.HAS_STRAIGHT_SHADOWS | layout.HAS_LAMPS | layout.HAS_CAMERA_CUTS_MEDIA | layout.HAS_HOLES
    assert Features.all().stated(masked=True) == everything


@pytest.mark.parametrize(
    "scene", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in builtin_names()]
)
def test_they_change_no_bit(device: Device, scene: str) -> None:
    described = clrender.load(scene)
    own, universal = (
        clrender.render(described, device=device, size=(40, 30), spp=4, code=code).stats["image_sha256"]
        for code in (None, "any")
    )
    assert universal == own


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["whitted", "direct", "reuse", "photon", "bdpt"])
def test_of_other_integrators(device: Device, integrator: str) -> None:
    """Those that prepare something are compiled for the scene whatever is asked for."""
    more: dict[str, Any] = {"photon": {"photons": 2000}}.get(integrator, {})
    for scene in ("room", "lamps"):
        images = [
            clrender.render(
                clrender.load(scene), device=device, size=(40, 32), spp=2, integrator=integrator, code=code, **more
            )
            for code in ("fast", "any")
        ]
        assert images[0].stats["image_sha256"] == images[1].stats["image_sha256"]


@dataclass
class FakeDevice:
    """A device whose compiler takes no time, and which says what it was to compile.

    Attributes
    ----------
    there : set of (str, bool)
        Names of builds that are compiled, and whether to small code.
    """

    there: set[tuple[str, bool]] = field(default_factory=set)
    compiled: list[tuple[str, bool]] = field(default_factory=list)
    compile_aside: Callable[[Compilation], Any] | None = None
    prove_fast: Callable[[str], None] | None = None
    memory_limit: int | None = None
    compiles_small_code: bool = True
    title: str = "fake"

    @property
    def info(self) -> Any:
        return SimpleNamespace(title=self.title)

    def wants_fast(self, entry: str, defines: Mapping[str, Any], samples: int | None) -> bool:
        return samples is None or samples > FEW_SAMPLES

    def has_program(self, entry: str, defines: Mapping[str, Any], *, small: bool = False) -> bool:
        return (defines["NAME"], small) in self.there

    def program(self, entry: str, defines: Mapping[str, Any], samples: int | None = None) -> tuple[str, bool]:
        asked = defines["NAME"], samples is not None and samples <= FEW_SAMPLES
        if asked not in self.there:
            self.compiled.append(asked)
            self.there.add(asked)
        return asked


OWN, ANY = KernelBuild({"NAME": "own"}, 16, 8, 1), KernelBuild({"NAME": "any"}, 16, 8, 1)


@pytest.fixture
def new_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if nothing had been compiled in this process."""
    monkeypatch.setattr(tracing_program, "_COMPILED", type(tracing_program._COMPILED)(set))


def begun(device: Any, samples: int | None, universal: KernelBuild | None = ANY) -> Any:
    return TracingProgram(device, INTEGRATOR.pipeline, OWN, universal, samples)


@pytest.mark.usefixtures("new_process")
@pytest.mark.parametrize(
    ("there", "samples", "program"),
    [
        ([], 1, ("own", True)),
        ([], None, ("own", False)),
        ([("any", True)], 1, ("any", True)),
        ([("any", True)], None, ("any", True)),
        ([("any", False), ("any", True)], 1, ("any", False)),
        ([("own", True), ("any", False)], 1, ("own", True)),
        ([("own", False), ("own", True)], 1, ("own", False)),
    ],
)
def test_the_best_that_is_there_begins(
    there: list[tuple[str, bool]], samples: int | None, program: tuple[str, bool]
) -> None:
    device = FakeDevice(set(there))
    tracing = begun(device, samples)
    assert tracing.program == program
    assert tracing.build == {"own": OWN, "any": ANY}[program[0]]
    assert device.compiled == ([] if there else [program])


@pytest.mark.usefixtures("new_process")
def test_the_second_scene_of_a_process_brings_the_universal_program() -> None:
    device = FakeDevice()
    begun(device, 1)
    begun(device, 1)
    assert device.compiled == [("own", True)]
    other = KernelBuild({"NAME": "other"}, 16, 8, 1)
    for _ in range(3):
        TracingProgram(device, INTEGRATOR.pipeline, other, ANY, 1)  # type: ignore[arg-type]
    assert device.compiled == [("own", True), ("any", True)]


@pytest.mark.usefixtures("new_process")
def test_where_none_may_stand_in() -> None:
    device = FakeDevice({("any", False)})
    assert begun(device, 1, universal=None).program == ("own", True)
    assert begun(replace(device, compiles_small_code=False), 1).program == ("own", True)


@dataclass
class FakeAside:
    """A compilation, or one that is asked for it.

    Attributes
    ----------
    ended : bool
    asked : list of Compilation
    """

    ended: bool = False
    asked: list[Compilation] = field(default_factory=list)

    def __call__(self, what: Compilation) -> FakeAside:
        self.asked.append(what)
        return self


@pytest.mark.usefixtures("new_process")
def test_own_fast_code_is_compiled_meanwhile_and_then_used() -> None:
    running = FakeAside()
    device = FakeDevice({("any", True)}, compile_aside=running)
    tracing = begun(device, None)
    for _ in range(3):
        tracing.improve(0)
        assert tracing.program == ("any", True)
    assert [(each.entry, each.macros, each.kernels, each.group) for each in running.asked] == [
        (ENTRY, OWN.tracing, [INTEGRATOR.pipeline.kernel], 1)
    ]
    running.ended = True
    device.there.add(("own", False))
    tracing.improve(0)
    assert tracing.program == ("own", False)
    assert tracing.build == OWN
    assert device.compiled == []


@pytest.mark.usefixtures("new_process")
def test_few_samples_are_not_worth_it_until_their_paths_are_long() -> None:
    running = FakeAside()
    device = FakeDevice({("any", True)}, compile_aside=running)
    tracing = begun(device, 1)
    tracing.improve(FEW_RAYS)
    assert not running.asked
    tracing.improve(FEW_RAYS + 1)
    assert len(running.asked) == 1


@pytest.mark.usefixtures("new_process")
def test_a_compilation_that_fails_is_not_tried_again() -> None:
    failed = FakeAside(ended=True)
    device = FakeDevice({("any", True)}, compile_aside=failed)
    tracing = begun(device, None)
    for _ in range(4):
        tracing.improve(0)
    assert len(failed.asked) == 1
    assert tracing.program == ("any", True)


@pytest.mark.usefixtures("new_process")
@pytest.mark.parametrize("how", ["busy", "none", "limit"])
def test_where_nothing_can_be_compiled_meanwhile(how: str) -> None:
    """Another compilation runs, the device has none who compiles, or memory is limited."""
    asked: list[Compilation] = []
    device = FakeDevice(
        {("any", True)},
        compile_aside=None if how == "none" else asked.append,
        memory_limit=1 if how == "limit" else None,
    )
    tracing = begun(device, None)
    for _ in range(3):
        tracing.improve(0)
    assert tracing.program == ("any", True)
    tracing.improve(FEW_RAYS + 1)
    assert tracing.program == (("any", True) if how == "busy" else ("own", False))
    assert len(asked) == (4 if how == "busy" else 0)


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


@pytest.fixture
def pocl(device: Device) -> Iterator[Device]:
    """PoCL as another device of this process, which shares no programs with the tests' own."""
    if not device.compiles_small_code:
        pytest.skip("the device has no small code")
    opened = select(str(device.info.index))[0]
    yield opened
    opened.close()


@pytest.mark.long
@pytest.mark.usefixtures("new_process", "empty_cache")
def test_a_render_changes_to_its_own_program(pocl: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process compiles it; the units before and after have the same bits."""
    flat, unit = flatten(clrender.load("sky"), 16, 16), Unit(0, 256, 0, 2, 16)
    settings = RenderSettings(width=16, height=16, spp=4).struct(16)
    monkeypatch.setattr("clrender.device.tracing_program.FEW_RAYS", 1)
    worker = DeviceWorker(pocl, flat, settings, launch=LaunchConfig(samples=1, stand_ins=True))
    begin = worker.render(unit)
    assert isinstance(worker._tracing, TracingProgram)
    small = worker._tracing.program
    assert "SMALL_CODE" in small.source.text
    deadline = time.monotonic() + 300.0
    while worker._tracing.program is small and time.monotonic() < deadline:
        assert (worker.render(unit).sums == begin.sums).all()
        time.sleep(0.2)
    assert worker._tracing.program is not small
    assert "SMALL_CODE" not in worker._tracing.program.source.text
    assert (worker.render(unit).sums == begin.sums).all()
    worker.release()


def waited_for(compilation: Any) -> bool:
    """Whether there is one; returns when it has ended."""
    while compilation is not None and not compilation.ended:
        time.sleep(0.01)
    return compilation is not None


def test_one_compilation_at_a_time(pocl: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[dict[str, Any]] = []
    go_on = threading.Event()

    def answer(request: dict[str, Any], seconds: float) -> Answer:
        started.append(request)
        assert go_on.wait(60.0)
        return Answer({})

    monkeypatch.setattr(aside, "ask_child", answer)
    what = Compilation(ENTRY, {"LANES": 16}, [INTEGRATOR.pipeline.kernel], 1, False)
    assert pocl.compile_aside is not None
    first = pocl.compile_aside(what)
    assert first is not None
    assert pocl.compile_aside(what) is None
    go_on.set()
    assert waited_for(first)
    assert waited_for(pocl.compile_aside(what))
    assert [each["task"] for each in started] == ["compile", "compile"]
    assert started[0]["compilation"]["macros"] == {"LANES": 16}


def test_what_another_process_cannot_compile_is_tried_once(pocl: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aside, "_FAILED", set())
    monkeypatch.setattr(aside, "ask_child", lambda request, seconds: Answer(None, "crashed"))
    assert pocl.compile_aside is not None
    what = Compilation(ENTRY, {"LANES": 16}, [INTEGRATOR.pipeline.kernel], 1, False)
    assert waited_for(pocl.compile_aside(what))
    assert pocl.compile_aside(what) is None
    assert waited_for(pocl.compile_aside(replace(what, macros={"LANES": 8})))


LOOP = """
import json, sys
import clrender
with clrender.Session() as session:
    for name in sys.argv[1:]:
        image = session.render(clrender.load(name), size=(24, 16), spp=2)
        device = session._residency.devices[0]
        programs = [macros for entry, macros in device._programs if entry == "integrator/path.cl"]
        print(json.dumps([name, image.stats["image_sha256"], len(programs)]), flush=True)
"""


@pytest.mark.long
@pytest.mark.usefixtures("empty_cache")
def test_a_loop_of_scenes_soon_compiles_nothing(device: Device, tmp_path: Path) -> None:
    """The first scene's own program, and one for all others, whose images have the same bits."""
    if not device.compiles_small_code:
        pytest.skip("the device has no small code")
    names = ["cornell", "bumpy", "drink", "candles", "foliage"]
    root = str(Path(clrender.__file__).parents[1])
    env = {**os.environ, "PYTHONPATH": root, "CLRENDER_DEVICE": str(device.info.index)}
    done = subprocess.run(
        [sys.executable, "-c", LOOP, *names], capture_output=True, text=True, env=env, cwd=tmp_path, check=True
    )
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    # The device check has compiled the first one's program, or it is compiled here; and so with the second
    programs = [row[2] for row in rows]
    assert programs[2:] == [programs[2]] * 3
    assert programs[2] <= 3
    for name, found, _ in rows:
        image = clrender.render(clrender.load(name), device=device, size=(24, 16), spp=2)
        assert image.stats["image_sha256"] == found


LEAVE = """
import json
from pathlib import Path
import clrender
from clrender.device import tracing_program
tracing_program.FEW_RAYS = 0
with clrender.Session() as session:
    render = lambda code: session.render(clrender.load("drink"), size=(64, 64), spp=64, code=code, tile=16)
    render("any")
    device, begun = session._residency.devices[0], []
    begin = device.compile_aside
    device.compile_aside = lambda what: begun.append(what.entry) or begin(what)
    image = render(None)
    tasks = Path("/proc/self/task").glob("*/children")
    children = [int(pid) for task in tasks for pid in task.read_text().split()]
    print(json.dumps([image.stats["image_sha256"], begun, children]))
"""


@pytest.mark.long
@pytest.mark.usefixtures("empty_cache")
def test_a_process_that_ends_takes_the_compilation_with_it(device: Device, tmp_path: Path) -> None:
    """And what it had begun to write harms nobody who comes later."""
    if not device.compiles_small_code:
        pytest.skip("the device has no small code")
    root = str(Path(clrender.__file__).parents[1])
    env = {**os.environ, "PYTHONPATH": root, "CLRENDER_DEVICE": str(device.info.index)}
    hashes: list[str] = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", LEAVE], capture_output=True, text=True, env=env, cwd=tmp_path, check=True
        )
        found, begun, children = json.loads(done.stdout.splitlines()[-1])
        hashes.append(found)
        assert begun or len(hashes) > 1  # on a slow machine the first may have ended by itself, and is used then
        deadline = time.monotonic() + 60.0
        while any(Path(f"/proc/{pid}").exists() for pid in children) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not any(Path(f"/proc/{pid}").exists() for pid in children)
    image = clrender.render(clrender.load("drink"), device=device, size=(64, 64), spp=64)
    assert hashes == [image.stats["image_sha256"]] * 2
