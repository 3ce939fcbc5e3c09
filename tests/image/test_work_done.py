"""What a render asks of a driver: programs are built once a process, and launches are few."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import pytest
from faulty_device import FaultyDevice
from image_support import render

import clrender
from clrender.device import Device

if TYPE_CHECKING:
    import numpy.typing as npt

    from clrender.device.device import Buffer, Program, Reading


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
    """One to trace, one for all else; a large tree is traced by another one."""
    render("room", [device], code="fast")
    builds = device.builds
    for scene in ("room", "cornell", "room-glass"):
        render(scene, [device], code="fast")
    assert device.builds == builds
    render("bumpy", [device], code="fast")
    assert device.builds <= builds + 1
    builds = device.builds
    render("bumpy", [device], size=(100, 80), code="fast")
    assert device.builds == builds


@pytest.mark.parametrize("size", [(64, 64), (200, 100)])
def test_a_frame_is_a_few_launches(device: Device, launched: Counter[str], size: tuple[int, int]) -> None:
    """One to learn how fast the device is, then as many as make slices of a tenth of a second: not one a tile."""
    render("room", [device], size=size, spp=1, tile=8)
    frame = {name: n for name, n in launched.items() if not name.startswith(("build_", "rows_"))}
    of_film = {"film_clear": 2, "film_clear_words": 1, "film_add_unit": 1, "film_develop": 1}
    assert frame.keys() == {*of_film, "integrator_path", "film_accumulate"}
    assert {name: frame[name] for name in of_film} == of_film
    assert 1 <= frame["integrator_path"] == frame["film_accumulate"] <= 6


class Noted(FaultyDevice):
    """How many slices were on their way when one was waited for, and how many launches there were in all."""

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self.flying, self.seen = 0, Counter[int]()

    def begin_read(self, buffer: Buffer, array: npt.NDArray[Any]) -> Reading:
        self.flying += 1
        return super().begin_read(buffer, array)

    def end_read(self, reading: Reading) -> None:
        self.seen[self.flying] += 1
        self.flying -= 1
        super().end_read(reading)


@pytest.mark.parametrize(
    ("how", "most"),
    [
        ({}, 2),
        ({"samples_per_pass": 1}, 2),
        ({"integrator": "photon", "photons": 2000}, 1),
        ({"integrator": "bdpt"}, 1),
    ],
    ids=str,
)
def test_a_device_need_not_wait_for_the_host(device: Device, how: dict[str, Any], most: int) -> None:
    """Two slices are on their way, but for the first, and where something is computed for each sample."""
    noted = Noted(device)
    with clrender.Session(noted) as session:
        session.render(clrender.load("room"), size=(96, 96), spp=40 if most > 1 else 4, **how)
    assert noted.flying == 0 and max(noted.seen) == most
    slices = noted.seen.total()
    assert noted.seen[most] >= slices // 2 and slices >= 3


def test_launches_of_the_tree_grow_with_its_depth_only(device: Device, launched: Counter[str]) -> None:
    """A thousand times the triangles, some three times the launches."""
    counts = []
    for scene in ("room", "bumpy"):
        launched.clear()
        render(scene, [device], spp=1)
        counts.append(sum(n for name, n in launched.items() if name.startswith("build_")))
    assert counts[0] < 120
    assert counts[1] < 365
