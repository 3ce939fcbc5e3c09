"""PoCL treated as a GPU is, with one lane and groups that the compiler knows in whole warps, gives the same image."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cases import for_each
from image_support import render

from clrender import layout
from clrender.device.device import Argument, Device, Program, whole_warps
from clrender.device.launch import LaunchConfig
from clrender.device.worker import DeviceWorker
from clrender.errors import RenderError
from clrender.film.unit import Unit
from clrender.flatten.flat_scene import flatten
from clrender.scene import load


class LikeGpu(Device):
    """The test's device with a GPU's ways; it remembers what was launched: kernel, work-items, group."""

    def __init__(self, device: Device) -> None:
        super().__init__(device.info, device._handle)
        self.is_cpu = False
        self.fixes_groups = True
        self._group = 0
        self.launched: list[tuple[str, int, int]] = []

    def launch(
        self, program: Program, kernel: str, global_size: int, local_size: int, args: Sequence[Argument]
    ) -> None:
        self.launched.append((kernel, global_size, local_size))
        super().launch(program, kernel, global_size, local_size, args)


@pytest.fixture
def gpu(device: Device) -> Iterator[LikeGpu]:
    like = LikeGpu(device)
    yield like
    like.close()


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "settings"),
    [
        ("room", {}),
        ("room", {"integrator": "reuse"}),
        ("room", {"integrator": "photon", "photons": 2000}),
        ("room", {"integrator": "bdpt"}),
        ("room", {"guiding": "on", "guiding_paths": 20000}),
        ("room", {"specular_chains": "on"}),
        pytest.param("room-diffuse", {"integrator": "radiosity", "patches": 400}, marks=pytest.mark.slow),
        pytest.param("bumpy", {"integrator": "whitted"}, marks=pytest.mark.slow),
    ],
)
def test_the_image_is_the_same(device: Device, gpu: LikeGpu, scene: str, settings: dict[str, Any]) -> None:
    wanted = render(scene, [device], **settings).stats["image_sha256"]
    assert render(scene, [gpu], **settings).stats["image_sha256"] == wanted
    assert gpu.group >= 64
    assert {local for _, _, local in gpu.launched} == {gpu.group}


@pytest.mark.long
def test_other_groups_may_be_asked_for(device: Device, gpu: LikeGpu) -> None:
    from image_support import Cutting

    wanted = render("room", [device]).stats["image_sha256"]
    assert render("room", [gpu], Cutting(work_group=32)).stats["image_sha256"] == wanted
    groups = {kernel: local for kernel, _, local in gpu.launched}
    assert groups["integrator_path"] == 32
    assert groups["film_accumulate"] == groups["rows_primitives"] == groups["build_scan"] == gpu.group


@pytest.mark.long
def test_the_compiler_was_told(gpu: LikeGpu) -> None:
    """A kernel that was compiled for groups of 64 runs in no others."""
    render("room", [gpu])
    program = next(each for each in gpu._programs.values() if "integrator_path" in each.kernels)
    kernel = program.kernels["integrator_path"]
    compiled_for = kernel.get_work_group_info(gpu._cl.kernel_work_group_info.COMPILE_WORK_GROUP_SIZE, gpu._handle)
    assert list(compiled_for) == [gpu.group, 1, 1]
    with pytest.raises(RenderError, match="INVALID_WORK_GROUP_SIZE"):
        gpu.launch(program, "integrator_path", 2 * gpu.group, 2 * gpu.group, [])


@pytest.fixture
def worker(gpu: LikeGpu) -> Iterator[DeviceWorker]:
    """Of a large image."""
    settings = np.zeros(1, layout.dtype("Settings"))
    settings["width"] = settings["height"] = 1024
    made = DeviceWorker(gpu, flatten(load("room"), 1024, 1024), settings)
    yield made
    made.release()


def test_launches_fill_a_gpu(worker: DeviceWorker) -> None:
    """Once the speed is known, a launch has a thread for each pixel of a large image, and not samples instead.

    What a launch would last at 10^9 samples a second is no limit then, whatever PoCL's speed.
    """
    slots, worker._rate = 1 << 20, 1e9
    passes = worker._passes(slots, 1000)
    assert passes == 64
    assert worker._slice_slots(slots, passes) >= 300_000
    worker._rate = 1e7  # 1.5 million samples are a launch: rather many pixels than many samples
    passes = worker._passes(slots, 64)
    assert worker._slice_slots(slots, passes) >= 300_000
    worker._rate = 1e9  # and where a sample's record takes ten times the memory of the sample
    worker._pipeline = replace(worker._pipeline, record_bytes=128)
    passes = worker._passes(slots, 64)
    assert 1 <= passes < 64
    assert worker._slice_slots(slots, passes) >= 250_000


def test_launches_of_the_same_samples_are_of_one_size(worker: DeviceWorker, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left for the last one would fill a GPU no more than for a moment."""
    worker._rate = 1e9
    monkeypatch.setattr("clrender.device.worker._SAMPLES_BYTES", (96 << 20, 96 << 20))
    sizes: dict[int, list[int]] = {}
    for part in worker._parts_of(Unit(0, 1 << 20, 0, 64, 64)):
        sizes.setdefault(part.first_sample, []).append(part.slot_count)
    assert any(len(each) > 2 for each in sizes.values())
    for each in sizes.values():
        assert max(each) - min(each) <= 16 * len(each)
        assert sum(each) == 1 << 20


def test_memory_of_a_launch_is_a_share_of_the_devices(worker: DeviceWorker, gpu: LikeGpu) -> None:
    gpu.max_allocation_bytes = 1 << 40
    for memory, most in ((1 << 30, 96 << 20), (4 << 30, 256 << 20), (80 << 30, 512 << 20)):
        gpu.info = replace(gpu.info, memory_bytes=memory)
        assert worker._room() == most
    gpu.max_allocation_bytes = 1 << 27
    assert worker._room() == 1 << 27
    gpu.memory_limit = gpu.allocated_bytes + (1 << 20)
    assert worker._room() < 1 << 20


@pytest.mark.long
def test_only_processors_are_told_to_prefetch(device: Device, gpu: LikeGpu) -> None:
    """Compilers of GPUs refuse it, also where a work-item has several lanes."""
    settings = np.zeros(1, layout.dtype("Settings"))
    settings["width"] = settings["height"] = 16
    told = []
    for each in (device, gpu):
        made = DeviceWorker(each, flatten(load("bumpy"), 16, 16), settings, launch=LaunchConfig(lanes=4))
        told.append("PREFETCH" in made._own.macros)
        made.release()
    assert told == [True, False]


@pytest.mark.long
def test_statistics_of_many_work_items(gpu: LikeGpu, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are summed up on the device, and are what the host reads otherwise."""
    known = ("rays", "shadow_rays", "image_sha256")
    wanted = {name: value for name, value in render("room", [gpu]).stats.items() if name in known}
    assert len(wanted) == len(known)
    assert "film_total_stats" not in {kernel for kernel, _, _ in gpu.launched}
    monkeypatch.setattr("clrender.device.worker._TOTALS", 100)
    again = render("room", [gpu]).stats
    assert {name: again[name] for name in known} == wanted
    assert "film_total_stats" in {kernel for kernel, _, _ in gpu.launched}


@for_each(
    ("multiple", "most", "group"),
    [
        (32, 1024, 64),
        (64, 256, 64),
        (1, 1024, 64),
        (48, 512, 96),
        (8, 4096, 64),
        (128, 1024, 128),
        (32, 32, 32),
        (0, 16, 16),
    ],
)
def test_groups_are_whole_warps(multiple: int, most: int, group: int) -> None:
    assert whole_warps(multiple, most) == group
