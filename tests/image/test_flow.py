"""Optical flow and scene flow against points that are moved and projected by the host."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError, UsageError
from clrender.scene.resting import opened
from clrender.scene.transforms import affine

if TYPE_CHECKING:
    import numpy.typing as npt

    from clrender.device import Device
    from clrender.scene import Scene

SIZE = (40, 32)
STEP = 0.25
MOTIONS: dict[Any, Any] = {
    ("shapes", 8, "motion"): [{"time": 0.0}, {"time": 1.0, "rotate_degrees": [0.0, 80.0, 0.0], "scale": 1.2}],
    ("shapes", 10, "motion"): [
        {"time": 0.0},
        {"time": 2.0, "translate": [0.6, 0.5, -0.2], "rotate_degrees": [0, 90, 0]},
    ],
    "camera.time": 0.25,
    "camera.flow_step": STEP,
}
LENSES: dict[str, dict[str, Any]] = {
    "perspective": {},
    "intrinsics": {"type": "intrinsics", "fx": 40.0, "resolution": SIZE,
                   "distortion": {"model": "brown-conrady", "k": [-0.1, 0.02], "p": [0.01, -0.01]}},
    "panoramic": {"type": "panoramic"},
}  # fmt: skip


def moving(lens: str) -> Scene:
    scene = clrender.load("room")
    camera = scene.camera
    x, y, z = camera.position
    keys = [{"time": 0.0}, {"time": 1.0, "position": [x + 0.2, y - 0.1, z], "target": [0.1, 1.0, 0.2]}]
    pose = {"position": camera.position, "target": camera.target, "up": camera.up}
    vertical = {} if LENSES[lens] else {"vertical_fov": camera.vertical_fov}
    return scene.changed({"camera": {**pose, **vertical, **LENSES[lens], "motion": keys}}).changed(MOTIONS)


def at(scene: Scene, time: float) -> Scene:
    return opened(scene.changed({"camera.time": time}))


def carried(scene: Scene, index: int, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Points of a shape at the time of the image, where they are after the step."""
    maps = []
    for time in (scene.camera.time, scene.camera.time + (scene.camera.flow_step or 0.0)):
        place = affine(at(scene, time).shapes[index].transform)
        maps.append(np.vstack([np.column_stack([place.linear, place.offset]), [0.0, 0.0, 0.0, 1.0]]))
    way = maps[1] @ np.linalg.inv(maps[0])
    there: npt.NDArray[np.float64] = points @ way[:3, :3].T + way[:3, 3]
    return there


@pytest.mark.parametrize(("lens", "step"), [*((lens, STEP) for lens in LENSES), ("perspective", -STEP)])
def test_flow_is_where_points_are_projected(device: Device, lens: str, step: float) -> None:
    scene = moving(lens).changed({"camera.flow_step": step})
    with clrender.Session(device.info.index) as session:
        layers = session.render(scene, size=SIZE, spp=1, aov=("position", "object", "flow", "scene_flow")).aovs
    before = layers["position"].astype(np.float64)
    after, objects = before.copy(), layers["object"][..., 0]
    for index in (8, 10):
        after[objects == index] = carried(scene, index, before[objects == index])
    assert all((objects == index).sum() > (0 if lens == "panoramic" else 10) for index in (8, 10))
    np.testing.assert_allclose(layers["scene_flow"], after - before, atol=2e-6)
    assert not layers["scene_flow"][(objects != 8) & (objects != 10)].any()
    first, last = (at(scene, time).camera for time in (0.25, 0.25 + step))
    flow = last.project(after, SIZE) - first.project(before, SIZE)
    if lens == "panoramic":
        flow[..., 0] = (flow[..., 0] + SIZE[0] / 2) % SIZE[0] - SIZE[0] / 2
    assert np.abs(flow).max() > 1.0
    np.testing.assert_allclose(layers["flow"], flow, atol=1e-3)


def test_flow_of_an_open_shutter(device: Device) -> None:
    """From its opening to its closing, the same as by a step from there; and an image with blur keeps its bits."""
    scene = moving("perspective")
    blurred = scene.changed({"camera.shutter": [-0.1, 0.15], "camera.flow_step": None})
    stepped = scene.changed({"camera.time": 0.15})
    how: dict[str, Any] = {"size": SIZE, "spp": 2, "aov": ("flow", "scene_flow")}
    with clrender.Session(device.info.index) as session:
        image, other = session.render(blurred, **how), session.render(stepped, **how)
        alone = session.render(blurred, size=SIZE, spp=2)
    for name in ("flow", "scene_flow"):
        np.testing.assert_allclose(image.aovs[name], other.aovs[name], atol=2e-3)
    assert image.stats["image_sha256"] == alone.stats["image_sha256"]


def test_what_rests_has_no_flow(device: Device) -> None:
    scene = clrender.load("room").changed({"camera.flow_step": 1.0})
    with clrender.Session(device.info.index) as session:
        layers = session.render(scene, size=SIZE, spp=4, aov=("flow", "scene_flow", "depth")).aovs
    seen = np.isfinite(layers["depth"][..., 0])
    assert seen.any() and not layers["flow"][seen].any() and not layers["scene_flow"][seen].any()
    assert np.isnan(layers["flow"][~seen]).all()


def test_flow_needs_two_times() -> None:
    with pytest.raises(UsageError, match="flow_step"):
        clrender.render(clrender.load("room"), size=(8, 8), spp=1, aov="flow")
    scene = clrender.load("room")
    with pytest.raises(SceneError, match="flow_step is 0, but must be above or below 0"):
        scene.changed({"camera.flow_step": 0.0})
    assert scene.changed({"camera.flow_step": 1.0}).sha256() == scene.sha256()


@pytest.mark.slow
@pytest.mark.parametrize("lens", list(LENSES))
def test_flow_has_the_same_bits_on_every_driver(all_devices: list[Device], lens: str) -> None:
    """But for rusticl, which does not end compiling programs of scenes with instances of motions."""
    scene, seen = moving(lens), dict[str, bytes]()
    for device in all_devices:
        if "rusticl" in device.info.platform.lower():
            continue
        with clrender.Session(device.info.index) as session:
            image = session.render(scene, size=SIZE, spp=3, aov=("flow", "scene_flow"))
        for name, layer in {**image.aovs, "image": image.linear}.items():
            assert seen.setdefault(name, layer.tobytes()) == layer.tobytes(), f"{name} on {device.info.title}"
    assert len(seen) == 3
