"""The promise: an image is a function of scene, settings and seed, to the bit; not of devices, or of how work is cut.

By default every pair of choices occurs on the first device for one scene, and the others take part where their
compilers are quick. The full product is slow, and `scripts/same_bits` prints it as a table.
"""

from __future__ import annotations

import itertools
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
import pytest
from image_support import (
    LANES,
    SCENES,
    SPP,
    TRAVERSALS,
    WIDTH_HEIGHT,
    Cutting,
    ShuffledUnits,
    covering,
    product,
    render,
    small_units,
)

import clrender
from clrender.aov import AOVS, FLOWS, OF_RENDERS
from clrender.device import Device
from clrender.device.launch import LaunchConfig
from clrender.device.worker import DeviceWorker
from clrender.film import Film
from clrender.film.unit import Unit, UnitSums, tile_side
from clrender.flatten.flat_scene import flatten
from clrender.image.files import image_sha256
from clrender.scheduling.policy import Plan
from clrender.scheduling.run import run
from clrender.scheduling.worker import Candidate
from clrender.settings import SETTINGS, RenderSettings

ROOT = Path(__file__).resolve().parents[2]
GPU_LIKE = "rusticl"
"""Its compiler needs minutes and gigabytes for anything but what it uses by itself: one lane, as a GPU.

A sample takes it a thousand times as long as others, hardly less in few pixels.
"""
LITTLE: Final[dict[str, Any]] = {"size": (33, 9), "spp": 3}
"""For it: two tiles of 32 pixels, and two launches of 2 samples."""


def sha(scene: str, devices: list[Device], cutting: Cutting | None = None, **settings: Any) -> str:
    image = render(scene, devices, cutting, **settings)
    assert not image.interrupted
    assert image.stats["nonfinite_samples"] == 0
    return str(image.stats["image_sha256"])


class Hashes(dict[str, str]):
    """The hash of each scene that is asked for, from one device left to itself."""

    def __init__(self, device: Device) -> None:
        super().__init__()
        self._device = device

    def __missing__(self, scene: str) -> str:
        self[scene] = sha(scene, [self._device])
        assert list(self.values()).count(self[scene]) == 1, "scenes differ"
        return self[scene]


@pytest.fixture(scope="module")
def expected(all_devices: list[Device]) -> Hashes:
    return Hashes(all_devices[0])


FEW = ("room", "bumpy", "S4")
"""Those that differ most among simple scenes: a small tree, a large one, many lights. `scripts/same_bits` has all."""

# --- how work is cut -------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    "scene", [pytest.param(scene, marks=pytest.mark.slow) if scene != "bumpy" else scene for scene in FEW]
)
@pytest.mark.parametrize("cutting", covering(), ids=str)
def test_every_pair_of_choices(all_devices: list[Device], expected: Hashes, scene: str, cutting: Cutting) -> None:
    assert sha(scene, all_devices[:1], cutting) == expected[scene]


@pytest.mark.slow
@pytest.mark.parametrize("traversal", TRAVERSALS)
@pytest.mark.parametrize("lanes", LANES)
def test_every_combination(all_devices: list[Device], expected: Hashes, lanes: int, traversal: str) -> None:
    for device in all_devices:
        slow = GPU_LIKE in device.info.platform
        if slow and (lanes, traversal) != (1, "packet"):
            continue
        # At one sample a work-item rusticl would need hours for the product; others are cut by the same code.
        how = LITTLE if slow else {}
        for scene in FEW if slow else SCENES:
            wanted = sha(scene, all_devices[:1], **how) if slow else expected[scene]
            every = scene in FEW and not slow
            for cutting in (product if every else covering)((lanes,), (traversal,)):
                assert sha(scene, [device], cutting, **how) == wanted, f"{scene}, {cutting}, {device.info.title}"


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        {"integrator": "whitted"},
        {"integrator": "direct", "shadow_rays": 3},
        {"indirect_rays": 3, "shadow_rays": 2, "max_depth": 4},
        {"roulette": "constant"},
        {"filter": "mitchell", "shadow_rays": 2},
        {"roulette": "none", "max_depth": 7, "sampling": "bsdf"},
        {"sampling": "light", "seed": 4294967295, "roulette": "constant", "termination": 0.25},
    ],
    ids=str,
)
@pytest.mark.parametrize("scene", ["room", pytest.param("bumpy", marks=pytest.mark.slow)])
def test_every_kind_of_path(all_devices: list[Device], scene: str, settings: dict[str, Any]) -> None:
    """Several rays from a hit, ends by roulette: what lanes do differently at a time must come to the same."""
    one = Cutting(1, "packet", 16, 1, 16, "shuffled")
    assert sha(scene, all_devices[:1], one, **settings) == sha(scene, all_devices[:1], **settings)


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        {"integrator": "reuse"},
        {"integrator": "reuse", "reuse": 4, "max_depth": 3},
        pytest.param({"integrator": "reuse", "filter": "mitchell"}, marks=pytest.mark.slow),
        {"integrator": "photon", "photons": 500, "max_depth": 3, "seed": 7},
        {"integrator": "bdpt", "filter": "mitchell"},
        {"guiding": "on", "guiding_paths": 20000, "filter": "mitchell"},
        {"specular_chains": "on"},
        pytest.param({"integrator": "photon", "photons": 3000}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_every_kind_of_sharing(all_devices: list[Device], settings: dict[str, Any]) -> None:
    """Pixels that share paths or photons, in a mesh with interpolated normals."""
    one = Cutting(1, "packet", 16, 1, 16, "shuffled")
    assert sha("bumpy", all_devices[:1], one, **settings) == sha("bumpy", all_devices[:1], **settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"shadow_rays": 2, "indirect_rays": 3},
        {"integrator": "direct"},
        {"integrator": "photon", "photons": 3000},
        {"integrator": "bdpt"},
        {"guiding": "on", "guiding_paths": 20000},
        {"specular_chains": "on"},
        {"integrator": "reuse"},
    ],
    ids=str,
)
def test_holes_in_every_number_of_lanes(all_devices: list[Device], settings: dict[str, Any]) -> None:
    """Hits one after the other, by rays together and alone."""
    wanted = sha("leaves", all_devices[:1], spp=4, **settings)
    every = itertools.product(LANES, TRAVERSALS)
    for lanes, traversal in [(1, "packet"), (8, "single")] if settings else every:
        cutting = Cutting(lanes, traversal, 16, 1, 16, "shuffled")
        assert sha("leaves", all_devices[:1], cutting, spp=4, **settings) == wanted, str(cutting)


FILTERS = [name for name in SETTINGS["filter"].domain.members if name != "box"]  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["room", "surfaces"])
def test_pixel_filters_in_every_number_of_lanes(all_devices: list[Device], scene: str) -> None:
    """Whose samples lie beyond their pixels, and whose signs travel with paths that are sorted and split."""
    for name in FILTERS:
        wanted = sha(scene, all_devices[:1], filter=name)
        for device in all_devices:
            if GPU_LIKE in device.info.platform:
                if (scene, name) == ("room", "mitchell"):  # the one whose program has all there is
                    assert sha(scene, [device], filter=name) == wanted, device.info.title
                continue
            for number, lanes in enumerate(LANES):
                cutting = Cutting(lanes, TRAVERSALS[number % 2], 16, 1, 16, "shuffled")
                assert sha(scene, [device], cutting, filter=name) == wanted, f"{name}, {cutting}, {device.info.title}"


@pytest.mark.long
def test_a_filter_is_another_image(all_devices: list[Device], expected: Hashes) -> None:
    hashes = {sha("room", all_devices[:1], filter=name) for name in FILTERS}
    assert len(hashes | {expected["room"]}) == len(FILTERS) + 1
    assert sha("room", all_devices[:1], filter="box") == expected["room"]


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [1, 4, 8, 16])
def test_lamps_that_a_tree_picks(all_devices: list[Device], lanes: int) -> None:
    cutting = Cutting(lanes, "packet", 16, 1, 16, "shuffled")
    by_tree = sha("lamps", all_devices[:1], cutting, light_sampler="bvh")
    assert by_tree == sha("lamps", all_devices[:1], light_sampler="bvh")


@pytest.mark.slow
@pytest.mark.parametrize("packets", [1, 3])
def test_packets_that_take_turns(all_devices: list[Device], expected: Hashes, packets: int) -> None:
    """Other numbers of them than devices choose, where rays part or paths are sorted by material.

    With another pool of samples to a work-item each.
    """
    built, defined = Device.program, []

    def program(device: Device, entry: str | Path, defines: Any = None, samples: int | None = None) -> Any:
        defined.append((entry, (defines or {}).get("PACKETS")))
        return built(device, entry, defines, samples)

    others: dict[str, Any] = {"indirect_rays": 2, "shadow_rays": 2, "roulette": "constant"}
    other = sha("bumpy", all_devices[:1], Cutting(8), **others)
    with patch("clrender.device.kernel_build._packets", lambda *_: packets), patch.object(Device, "program", program):
        for scene in ("bumpy", "surfaces"):
            assert sha(scene, all_devices[:1], Cutting(8)) == expected[scene]
        assert sha("bumpy", all_devices[:1], Cutting(8, samples_per_pass=3), **others) == other
    assert ("integrator/path.cl", packets) in defined


@pytest.mark.thorough
@pytest.mark.parametrize("scene", ["room", pytest.param("bumpy", marks=pytest.mark.long)])
@pytest.mark.parametrize("size", [(1, 1), (1, 70), (130, 1), (3, 5)], ids=str)
def test_odd_sizes(all_devices: list[Device], scene: str, size: tuple[int, int]) -> None:
    hashes = {
        sha(scene, all_devices[:1], cutting, size=size)
        for cutting in (Cutting(), Cutting(16, "packet", 4, 1, 16, "shuffled"), Cutting(1, "packet", 65536, 16, 16))
    }
    assert len(hashes) == 1


def test_another_seed_or_scene_or_size_is_another_image(all_devices: list[Device], expected: Hashes) -> None:
    changes: list[dict[str, Any]] = [{"seed": 1}, {"spp": SPP - 1}, {"size": (39, 50)}, {"max_depth": 3}]
    hashes = {sha("room", all_devices[:1], **change) for change in changes}
    assert len(hashes | {expected["room"]}) == len(changes) + 1


# --- drivers and devices ---------------------------------------------------------------------------------------------


@pytest.mark.slow  # rusticl takes a minute to compile it
def test_several_rays_on_every_driver(all_devices: list[Device]) -> None:
    """Each shadow ray of a vertex has the sampler that the vertex has, also where a compiler shares parameters."""
    assert len({sha("room", [device], size=(16, 16), spp=2, shadow_rays=3) for device in all_devices}) == 1


SELDOM = {"drink", "haze", "candles", "lamps", "sundial"}
"""Programs that take long to build for every driver, and whose parts other tests have."""


def _mark(scene: str) -> pytest.MarkDecorator:
    return pytest.mark.slow if scene in SELDOM else pytest.mark.long


@pytest.mark.thorough
@pytest.mark.parametrize("scene", [pytest.param(s, marks=_mark(s)) if s != "room" else s for s in SCENES])
def test_every_driver(all_devices: list[Device], expected: Hashes, scene: str) -> None:
    """Each device as it would render by itself; those that carry lanes also with other numbers of them."""
    for device in all_devices:
        other, how, wanted = Cutting(4, "single", 16, 4, 16, "shuffled"), {}, expected[scene]
        if GPU_LIKE in device.info.platform:
            if scene != "room":
                continue  # it is slow; see test_every_combination, and test_rich_scenes_on_rusticl
            other, how = Cutting(tile=32, samples_per_pass=2, work_group=64), LITTLE
            wanted = sha(scene, all_devices[:1], **how)
        for cutting in (Cutting(), other):
            assert sha(scene, [device], cutting, **how) == wanted, f"{cutting} on {device.info.title}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "gigabytes"),
    [("sky", 4), ("drink", 4), ("haze", 5), ("candles", 5), ("matt textures", 5), ("metals", 14)],
)
def test_rich_scenes_on_rusticl(
    all_devices: list[Device], scene: str, gigabytes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without LLVM's passes, which take longer than all else: whether to run them, the driver asks once in its life.

    Mesa's compiler recurses, for `metals` beyond the 8 MiB that threads usually have.
    """
    if not any(GPU_LIKE in device.info.platform for device in all_devices):
        pytest.skip(f"{GPU_LIKE} is not installed")
    if (free := free_memory()) < gigabytes * 2**30:
        pytest.skip(f"its compiler takes up to {gigabytes} GiB for {scene}, and {free / 2**30:.1f} are free")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{Path(__file__).parent}")
    monkeypatch.setenv("GALLIVM_PERF", "nopt")
    settings = "size=(16, 16), spp=1"
    code = (
        "from clrender.drivers import select; from image_support import *; "
        f"print(render({scene!r}, select('llvmpipe'), {settings}).stats['image_sha256'])"
    )
    command = ["bash", "-c", 'ulimit -S -s 1048576; exec "$@"', "bash", sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == sha(scene, all_devices[:1], size=(16, 16), spp=1)


def free_memory() -> int:
    """Bytes that a process could take."""
    lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith("MemAvailable"))


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param(
            {"aov": sorted(AOVS.keys() - FLOWS - OF_RENDERS), "max_depth": 2, "replicate_spp": 1, "error": 0.5},
            marks=pytest.mark.slow,
        ),
        pytest.param({"integrator": "whitted"}, marks=pytest.mark.slow),
        pytest.param({"integrator": "reuse"}, marks=pytest.mark.slow),
        pytest.param({"integrator": "photon", "photons": 500}, marks=pytest.mark.slow),
        pytest.param({"integrator": "bdpt"}, marks=pytest.mark.slow),
        pytest.param({"guiding": "on", "guiding_paths": 20000}, marks=pytest.mark.slow),
        pytest.param({"specular_chains": "on"}, marks=pytest.mark.slow),
        pytest.param({"integrator": "bdpt", "specular_chains": "on"}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_every_integrator_on_every_driver(all_devices: list[Device], settings: dict[str, Any]) -> None:
    if len(all_devices) == 1:
        pytest.skip("there is no second driver to compare with")
    first = render("room-glass", all_devices[:1], **settings)
    for device in all_devices[1:]:
        image = render("room-glass", [device], **settings)
        if "specular_chains" in settings and image.stats["nonfinite_samples"]:
            # Rusticl's llvmpipe ends loops after 65,535 iterations, which a few walks need: it must be known which
            assert GPU_LIKE in device.info.platform
            continue
        assert image.stats["image_sha256"] == first.stats["image_sha256"], device.info.title
        assert image.aovs.keys() == first.aovs.keys()
        for name, layer in image.aovs.items():
            np.testing.assert_array_equal(layer, first.aovs[name], f"{name} on {device.info.title}")


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"integrator": "photon", "photons": 2000},
        {"integrator": "bdpt"},
        {"integrator": "reuse"},
        {"guiding": "on", "guiding_paths": 20000, "indirect_rays": 2},
        {"guiding": "on", "guiding_paths": 20000, "specular_chains": "on"},
        {"integrator": "bdpt", "specular_chains": "on"},
    ],
    ids=str,
)
@pytest.mark.parametrize("scene", ["rich room", "textures"])
def test_rich_scenes_by_those_that_share(all_devices: list[Device], scene: str, settings: dict[str, Any]) -> None:
    """Rough materials and textures by integrators whose pixels have work in common, in every number of lanes."""
    wanted = sha(scene, all_devices[:1], spp=5, **settings)
    assert wanted != sha(scene, all_devices[:1], spp=5), "pixels have something in common"
    for device in all_devices:
        if GPU_LIKE in device.info.platform:
            continue  # over rough materials its compiler takes minutes
        for number, lanes in enumerate(LANES):
            cutting = Cutting(lanes, TRAVERSALS[number % 2], 16, 1, 16, "shuffled")
            assert sha(scene, [device], cutting, spp=5, **settings) == wanted, f"{cutting} on {device.info.title}"


@pytest.mark.long  # two drivers
def test_no_more_lanes_than_a_driver_can_compile(all_devices: list[Device]) -> None:
    """Where its compiler would go on until memory ends, an error says so at once."""
    limited = [device for device in all_devices if GPU_LIKE in device.info.platform]
    if not limited:
        pytest.skip(f"{GPU_LIKE} is not installed")
    with pytest.raises(clrender.UsageError, match=r"lanes is 4; .*takes at most 1: leave it out"):
        clrender.render(clrender.load("room"), device=limited[0].info.index, size=(8, 8), spp=1, lanes=4)


def test_all_drivers_share_one_image(all_devices: list[Device], expected: Hashes) -> None:
    image = render("room", all_devices, Cutting(tile=8, order="shuffled"))
    assert image.stats["image_sha256"] == expected["room"]
    assert len(image.stats["devices"]) == len(all_devices)
    assert sum(each["samples"] for each in image.stats["devices"]) == SPP * WIDTH_HEIGHT[0] * WIDTH_HEIGHT[1]


def test_two_devices_of_one_driver_share_an_image(all_devices: list[Device], expected: Hashes) -> None:
    """Both halves of the processor as devices of their own where the driver can split it, else the device twice."""
    halves = [Device(all_devices[0].info, handle) for handle in split(all_devices[0])]
    for half in halves:  # with its kernels at hand neither begins when the other has done all
        render("room-glass", [half], Cutting(tile=8))
    image = render("room-glass", halves, Cutting(tile=8, order="shuffled"))
    assert image.stats["image_sha256"] == expected["room-glass"]
    assert [each["units"] > 0 for each in image.stats["devices"]] == [True, True]


def split(device: Device) -> list[Any]:
    """Two handles to open."""
    import pyopencl as cl

    handle: Any = device._handle
    equally: Any = cl.device_partition_property.EQUALLY
    if device.info.compute_units >= 2 and equally in (handle.partition_properties or []):
        return list(handle.create_sub_devices([equally, device.info.compute_units // 2]))[:2]
    return [handle, handle]


SHARED = """
import sys
import clrender
image = clrender.render(clrender.load("bumpy"), device="all", size=({width}, {height}), spp={spp}, tile=16)
assert len(image.stats["devices"]) == 2, image.stats["devices"]
print(image.stats["image_sha256"])
"""


@pytest.mark.slow
def test_two_drivers_inside_pocl(
    all_devices: list[Device], expected: Hashes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PoCL's device with threads beside the one without, in a process of its own: they are chosen before it loads."""
    library = next(device.info.library for device in all_devices if "pocl" in device.info.version.lower())
    (tmp_path / "pocl.icd").write_text(f"{library}\n")
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    monkeypatch.setenv("POCL_DEVICES", "pthread basic")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    code = SHARED.format(width=WIDTH_HEIGHT[0], height=WIDTH_HEIGHT[1], spp=SPP)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [expected["bumpy"]]


@pytest.mark.slow
@pytest.mark.oclgrind
@pytest.mark.skipif(shutil.which("oclgrind") is None, reason="Oclgrind is not installed")
def test_oclgrind(all_devices: list[Device], monkeypatch: pytest.MonkeyPatch) -> None:
    """An interpreter, so that nothing of the hardware's can help: small images, as it would render and in one lane.

    Of a rich scene it compiles for minutes; tests/kernel/test_oclgrind.py has the programs of those in small scenes.
    """
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{Path(__file__).parent}")
    settings = "size=(32, 32), spp=1"
    for scene in FEW:
        for cutting in ("Cutting()", "Cutting(1, 'single', 16, 1, 16)"):
            code = (
                "from clrender.drivers import select; from image_support import *; "
                f"print(render({scene!r}, select('oclgrind'), {cutting}, {settings}).stats['image_sha256'])"
            )
            command = ["oclgrind", sys.executable, "-W", "ignore", "-c", code]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            assert done.stdout.split()[-1] == sha(scene, all_devices[:1], size=(32, 32), spp=1), f"{scene}, {cutting}"


# --- parts of an image -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "which",
    [lambda number, unit: number % 2, lambda number, unit: unit.first_sample >= SPP // 2],
    ids=["every other unit", "first and second half of the samples"],
)
def test_two_renders_merged_as_films(
    all_devices: list[Device], expected: Hashes, which: Callable[[int, Unit], int]
) -> None:
    whole = small_units

    def part(wanted: int) -> Callable[[Plan], Iterator[Unit]]:
        return lambda plan: (unit for number, unit in enumerate(whole(plan)) if which(number, unit) == wanted)

    films = []
    for wanted in (1, 0):
        with patch("image_support.small_units", part(wanted)):
            image = render("cornell", all_devices[:1], Cutting(tile=16, order="shuffled"))
        assert image.interrupted, "some samples are missing"
        films.append(image.film)
    films[0].merge(films[1])
    assert image_sha256(films[0].mean()) == expected["cornell"]


def test_a_film_goes_through_a_file(all_devices: list[Device], expected: Hashes, tmp_path: Path) -> None:
    image = render("room", all_devices[:1])
    image.save(tmp_path / "room.film")
    film = Film.load(tmp_path / "room.film")
    assert image_sha256(film.mean()) == expected["room"] == film.provenance["image_sha256"]
    assert image_sha256(film.develop()) == expected["room"]


class _Recording:
    """A worker that remembers which units it finished."""

    def __init__(self, worker: DeviceWorker) -> None:
        self.worker = worker
        self.finished: list[Unit] = []

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        """As the worker; a unit here is a single launch, so it is finished or not begun."""
        sums = self.worker.render(unit, on_slice, should_stop)
        assert (sums.done == sums.done[0]).all() and sums.done[0] in (0, unit.sample_count)
        if sums.done[0]:
            self.finished.append(unit)
        return sums


def test_an_interrupted_render_ended_later(all_devices: list[Device], expected: Hashes) -> None:
    settings = RenderSettings(spp=SPP, width=WIDTH_HEIGHT[0], height=WIDTH_HEIGHT[1])
    tile = tile_side(16, settings.width, settings.height)
    plan = Plan(settings.width, settings.height, 0, SPP, tile)
    units = list(small_units(plan))
    film = Film(settings.width, settings.height)
    flat = flatten(clrender.load("bumpy"), settings.width, settings.height)
    slices = 0

    def tell(samples: int, rays: int) -> None:
        nonlocal slices
        slices += 1

    def after(stop: int) -> Callable[[], bool]:
        return lambda: slices >= stop

    while units:
        worker = DeviceWorker(all_devices[0], flat, settings.struct(tile), launch=LaunchConfig(None, 16, 16))
        recording = _Recording(worker)
        candidates = [Candidate("recording", partial(lambda each: each, recording))]
        with (
            patch("image_support.small_units", return_value=units),
            patch("clrender.scheduling.run.Remaining", ShuffledUnits),
        ):
            run(plan, candidates, film, tell, after(slices + 11))
        worker.release()
        assert recording.finished, "each go gets somewhere"
        units = [unit for unit in units if unit not in recording.finished]
    assert slices > 40
    assert np.unique(film.counts).tolist() == [SPP] and film.ledger.holds(0, SPP)
    assert image_sha256(film.mean()) == expected["bumpy"]


@pytest.mark.long
def test_shards_on_two_drivers_merge_to_the_image(all_devices: list[Device]) -> None:
    job = clrender.RenderJob.of(clrender.load("room"), **LITTLE)
    films = []
    for number in (1, 2, 3):
        with clrender.Session(all_devices[number % len(all_devices)]) as session:
            films.append(session.render(job.shard(number, 3)).film)
    wanted = sha("room", all_devices[:1], **LITTLE)
    for order in itertools.permutations(range(3)):
        merged = Film(films[0].width, films[0].height, films[0].request)
        for number in order:
            merged.merge(films[number])
        assert merged.ledger.holds(0, LITTLE["spp"])
        assert image_sha256(merged.mean()) == wanted
