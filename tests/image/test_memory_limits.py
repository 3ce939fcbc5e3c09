"""Renders keep to the memory that they are allowed, with the same bits; what cannot is refused before it is taken."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from faulty_device import FaultyDevice

import clrender
from clrender.device import Device
from clrender.errors import MemoryRefused, RenderError, UsageError
from clrender.rendering.rendered_image import RenderedImage

MIB = 1 << 20
SIZE = (480, 320)

pytestmark = pytest.mark.usefixtures("small_program")


class Watched:
    """Renders on devices of its own, and what limit each of them had meanwhile."""

    def __init__(self, device: Device, count: int = 1) -> None:
        self.devices = [FaultyDevice(device, name=f"device {number}") for number in range(count)]
        for each in self.devices:
            each.allocated_bytes = 0
        self.limits: set[int | None] = set()

    def render(self, scene: str, **how: Any) -> RenderedImage:
        def note(progress: Any) -> None:
            self.limits |= {each.memory_limit for each in self.devices}

        with clrender.Session(self.devices) as session:
            return session.render(clrender.load(scene), on_progress=note, **{"size": SIZE, **how})


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "how"),
    [
        ("room", {"spp": 40}),
        ("room", {"spp": 20, "tile": 1024}),
        ("room", {"spp": 3, "integrator": "photon", "photons": 2000}),
        ("room", {"spp": 3, "integrator": "bdpt"}),
        ("room", {"spp": 3, "guiding": "on", "guiding_paths": 20000, "guiding_memory": 4 << 20}),
        ("room", {"spp": 20, "integrator": "reuse"}),
        ("room", {"spp": 20, "aov": ("albedo", "crypto_object")}),
    ],
    ids=lambda value: "-".join(map(str, value.values())) if isinstance(value, dict) else value,
)
def test_a_limit_is_kept_and_changes_no_bit(device: Device, scene: str, how: dict[str, Any]) -> None:
    free, held = Watched(device), Watched(device)
    expected = free.render(scene, **how).stats["image_sha256"]
    assert free.limits == {None}
    # The host needs some 25 MiB for program, film and units; the device may have the rest
    image = held.render(scene, max_memory=40 * MIB, **how)
    assert image.stats["image_sha256"] == expected
    (limit,) = held.limits
    assert limit is not None and 0 < held.devices[0].allocated_bytes <= limit
    assert held.devices[0].memory_limit is None, "and it is over with the render"


@pytest.mark.long
def test_the_limit_decides_how_much_a_device_takes(device: Device) -> None:
    """Or the test above says nothing: without it, the sums of a unit alone take 6.5 MiB here."""
    free, held = Watched(device), Watched(device)
    expected = free.render("room", spp=4, size=(640, 480)).stats["image_sha256"]
    image = held.render("room", spp=4, size=(640, 480), max_memory=40 * MIB)
    assert image.stats["image_sha256"] == expected
    assert held.devices[0].allocated_bytes < 6.5 * MIB < free.devices[0].allocated_bytes


@pytest.mark.long
def test_several_devices_keep_to_it(device: Device) -> None:
    held = Watched(device, 2)
    expected = Watched(device).render("room", spp=40).stats["image_sha256"]
    image = held.render("room", spp=40, max_memory=48 * MIB)
    assert image.stats["image_sha256"] == expected
    assert all(0 < each.allocated_bytes <= max(limit or 0 for limit in held.limits) for each in held.devices)


def test_what_the_host_has_no_room_for_is_refused_before_anything_is_taken(device: Device) -> None:
    held = Watched(device)
    with pytest.raises(MemoryRefused, match=r"MiB for the film.*--max-memory \(max_memory\) allows .* MiB") as caught:
        held.render("room", spp=4, max_memory=17 * MIB, size=(640, 240))
    assert caught.value.exit_code == 2
    assert held.devices[0].allocated_bytes == 0 and held.devices[0].memory_limit is None
    with pytest.raises(
        UsageError, match=r"^an image of 20000 x 20000 pixels takes 23\.8 GiB of memory, 52 bytes a pix"
    ):
        held.render("room", spp=4, size=(20000, 20000), max_memory=1 << 30)


def test_what_a_device_has_no_room_for_is_refused(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene of 20,496 triangles takes 4 MB and more, and 2.5 MiB are left beside the film."""
    monkeypatch.setattr("clrender.rendering.memory.process_bytes", lambda: 11 * MIB)
    held = Watched(device)
    with pytest.raises(
        MemoryRefused, match=r"^the scene takes 3\.\d MiB and more on device 0 .*--max-memory"
    ) as caught:
        held.render("bumpy", size=(64, 64), spp=1, max_memory=16 * MIB)
    assert caught.value.exit_code == 2
    assert held.devices[0].allocated_bytes == 0
    with pytest.raises(MemoryRefused, match=r"^device 0 .* are in use and .* more are needed; raise --max-memory"):
        held.render("room", size=(64, 64), spp=1, integrator="photon", photons=30000, max_memory=16 * MIB)


def test_one_device_without_room_leaves_the_work_to_the_other(device: Device) -> None:
    both = Watched(device, 2)
    both.devices[0].max_allocation_bytes = MIB
    image = both.render("bumpy", spp=2, size=(64, 64))
    assert image.stats["image_sha256"] == Watched(device).render("bumpy", spp=2, size=(64, 64)).stats["image_sha256"]
    assert [each["state"] for each in image.stats["devices"]] == ["failed", "ok"]


@pytest.mark.parametrize("largest", [20496 * 64 - 1, MIB])
def test_an_array_beyond_one_allocation_is_named(device: Device, largest: int) -> None:
    held = Watched(device)
    held.devices[0].max_allocation_bytes = largest
    fault = r"^the scene is too large for device 0 .*: its primitive rows take 1\.3 MiB, .* more than the 1\.[03] MiB"
    with pytest.raises(RenderError, match=fault):
        held.render("bumpy", spp=1)
    assert held.devices[0].allocated_bytes == 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("how", "largest"),
    [({}, 1), ({"integrator": "photon", "photons": 500, "photon_radius": 0.2}, 2), ({"aov": ("crypto_object",)}, 1)],
    ids=str,
)
def test_a_film_beyond_one_allocation_is_done_in_parts(device: Device, how: dict[str, Any], largest: int) -> None:
    """Sums of 480 x 320 pixels take 7 MiB: units are smaller where the largest buffer is."""
    held = Watched(device)
    held.devices[0].max_allocation_bytes = largest * MIB
    image = held.render("room", spp=3, **how)
    assert image.stats["image_sha256"] == Watched(device).render("room", spp=3, **how).stats["image_sha256"]
    assert image.stats["devices"][0]["units"] * largest >= 7


def clrender_command(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "clrender", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.long
def test_the_command_keeps_to_it(tmp_path: Path) -> None:
    words = ("render", "room", "-o", "a.png", "--size", "160x120", "--spp", "4", "--quiet")
    done = clrender_command(*words, "--max-memory", "1.5G", "--stats", "s.json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "s.json").read_text())["peak_rss_bytes"] <= 1.5 * 2**30
    (tmp_path / "a.png").unlink()
    done = clrender_command(*words, "--max-memory", "20M", folder=tmp_path)
    assert done.returncode == 2 and not (tmp_path / "a.png").exists()
    assert done.stderr.count("\n") == 1 and "--max-memory (max_memory) allows 20.0 MiB" in done.stderr
    for wrong in ("2X", "-1", "1K", "nan", ""):
        done = clrender_command(*words, "--max-memory", wrong, folder=tmp_path)
        assert done.returncode == 2 and "must be a number of bytes" in done.stderr and "Traceback" not in done.stderr
