"""Kernels for each stage of a path give the bits of those for whole paths, whatever a scene has."""

from __future__ import annotations

from typing import Any, Final

import pytest
from faulty_device import Fault, FaultyDevice
from image_support import SCENES, Cutting, render

from clrender.device import Device
from clrender.device.staged import StagedTracing
from clrender.errors import UsageError
from clrender.settings import RenderSettings

STAGED: Final = Cutting(kernels="staged")
LITTLE: Final[dict[str, Any]] = {"size": (34, 29), "spp": 5}
"""Fewer samples than may be under way at once; see `few_paths`."""
COUNTED: Final = ("image_sha256", "rays", "shadow_rays", "max_depth", "samples", "nonfinite_samples")


@pytest.fixture
def few_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    """So few paths are under way that others take the places of those which end."""
    monkeypatch.setattr("clrender.device.worker._staged_paths", lambda *_: 96)


def told(device: Device, scene: str, cutting: Cutting | None = None, **settings: Any) -> dict[str, Any]:
    image = render(scene, [device], cutting, **{**LITTLE, **settings})
    assert not image.interrupted
    return {name: image.stats[name] for name in COUNTED}


@pytest.mark.thorough
@pytest.mark.usefixtures("few_paths")
def test_a_room_has_the_same_bits_in_stages(device: Device) -> None:
    """And as many rays, of the same depth."""
    found = told(device, "room", STAGED)
    assert found == told(device, "room")
    assert found["max_depth"] > 4


def test_paths_may_all_be_under_way_at_once(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """The device decides how many are: here more than there are samples."""
    made = list[int]()
    trace = StagedTracing.trace

    def noted(self: StagedTracing, *arguments: Any) -> None:
        made.append(self.paths)
        trace(self, *arguments)

    monkeypatch.setattr(StagedTracing, "trace", noted)
    assert told(device, "room", STAGED, spp=1) == told(device, "room", spp=1)
    assert made and min(made) > 34 * 29


@pytest.mark.usefixtures("few_paths")
def test_work_in_stages_can_be_cut(device: Device) -> None:
    cut = Cutting(kernels="staged", tile=16, samples_per_pass=2, order="shuffled")
    assert told(device, "room", cut) == told(device, "room")


@pytest.mark.long
@pytest.mark.usefixtures("few_paths")
@pytest.mark.parametrize("scene", [*SCENES, "avenue", "foliage", "product", "leaves", "rich room", "matt textures"])
def test_every_scene_has_the_same_bits_in_stages(device: Device, scene: str) -> None:
    assert told(device, scene, STAGED) == told(device, scene)


@pytest.mark.long
@pytest.mark.usefixtures("few_paths")
@pytest.mark.parametrize("scene", ["drink", "leaves"])
@pytest.mark.parametrize(
    "settings",
    [
        {"integrator": "direct"},
        {"indirect_rays": 3},
        {"shadow_rays": 2},
        {"shadow_rays": 2, "indirect_rays": 2},
        {"specular_chains": "on"},
        {"filter": "mitchell"},
        {"replicate_spp": 1},
        {"max_depth": 2, "roulette": "constant"},
        {"code": "small"},
        {"code": "any"},
        {"work_group": 32},
    ],
    ids=str,
)
def test_every_setting_gives_the_same_bits_in_stages(device: Device, scene: str, settings: dict[str, Any]) -> None:
    assert told(device, scene, STAGED, **settings) == told(device, scene, **settings)


@pytest.mark.long
@pytest.mark.usefixtures("few_paths")
def test_other_drivers_give_the_same_bits_in_stages(all_devices: list[Device]) -> None:
    found = [told(device, "room", STAGED, size=(9, 8), spp=2) for device in all_devices]
    assert found == [told(all_devices[0], "room", size=(9, 8), spp=2)] * len(all_devices)


@pytest.mark.long
@pytest.mark.parametrize(("call", "after"), [("allocate", 36), ("launch", 58), ("read", 17)])
def test_a_device_that_fails_in_between_loses_nothing(device: Device, call: str, after: int) -> None:
    """At a launch of some stage, or where the host looks whether paths are left; set-up takes 38, 56 and 16 calls."""
    fault = Fault(call, after, how="gone")
    how: dict[str, Any] = {**LITTLE, "tile": 16, "samples_per_pass": 2, "spp": 8}
    good, bad = FaultyDevice(device, name="good", waits_for=fault), FaultyDevice(device, fault)
    image = render("room", [good, bad], STAGED, **how)
    assert fault.met and image.stats["devices"][1]["state"] == "failed"
    assert image.stats["image_sha256"] == render("room", [device], **how).stats["image_sha256"]


def test_integrators_without_stages_have_one_kernel(device: Device) -> None:
    assert told(device, "room", STAGED, integrator="whitted") == told(device, "room", integrator="whitted")


def test_stages_take_one_path_per_work_item() -> None:
    with pytest.raises(UsageError, match=r"lanes is 8, but staged kernels take one path per work-item; leave it out"):
        RenderSettings(kernels="staged", lanes=8)
    assert RenderSettings(kernels="staged", lanes=1).lanes == 1


@pytest.mark.usefixtures("few_paths")
def test_memory_is_given_back(device: Device) -> None:
    before = device.buffers
    told(device, "room", STAGED)
    assert device.buffers == before


@pytest.mark.usefixtures("small_program")
def test_stages_stay_within_a_limit_of_memory(device: Device) -> None:
    limited = told(device, "room", STAGED, max_memory=1 << 31)
    assert limited == told(device, "room")
