"""What a render asks of a driver: programs are built once a process, and launches are few."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import pytest
from image_support import render

from clrender.device import Device

if TYPE_CHECKING:
    from clrender.device.device import Program


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each kernel was launched since it was cleared."""
    counter: Counter[str] = Counter()
    launch = Device.launch

    def counting(self: Device, program: Program, kernel: str, *arguments: Any) -> None:
        counter[kernel] += 1
        launch(self, program, kernel, *arguments)

    monkeypatch.setattr(Device, "launch", counting)
    return counter


def test_programs_are_built_once_a_process(device: Device) -> None:
    """Three for the tree, one for rows, one to trace, one for the film; a large tree is traced by another one."""
    render("room", [device])
    builds = device.builds
    for scene in ("room", "cornell", "room-glass"):
        render(scene, [device])
    assert device.builds == builds
    render("bumpy", [device])
    assert device.builds <= builds + 1
    builds = device.builds
    render("bumpy", [device], size=(100, 80))
    assert device.builds == builds


@pytest.mark.parametrize("size", [(64, 64), (200, 100)])
def test_a_frame_is_a_few_launches(device: Device, launched: Counter[str], size: tuple[int, int]) -> None:
    """One to learn how fast the device is, then as many as make slices of a tenth of a second: not one a tile."""
    render("room", [device], size=size, spp=1, tile=8)
    frame = {name: n for name, n in launched.items() if not name.startswith(("build_", "rows_"))}
    assert frame.keys() == {"film_clear", "integrator_path", "film_accumulate"}
    assert frame["film_clear"] == 1
    assert 1 <= frame["integrator_path"] == frame["film_accumulate"] <= 6


def test_launches_of_the_tree_grow_with_its_depth_only(device: Device, launched: Counter[str]) -> None:
    """A thousand times the triangles, some three times the launches."""
    counts = []
    for scene in ("room", "bumpy"):
        launched.clear()
        render(scene, [device], spp=1)
        counts.append(sum(n for name, n in launched.items() if name.startswith("build_")))
    assert counts[0] < 120
    assert counts[1] < 365
