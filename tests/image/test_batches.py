"""A batch of cameras gives the images that each of them gives alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import clrender
from clrender.errors import SceneError, UsageError
from clrender.rendering.batch import batches
from clrender.scene import Camera

if TYPE_CHECKING:
    from clrender.device import Device

SIZE = (30, 20)
BARREL = {"model": "brown-conrady", "k": [-0.2, 0.05]}


def cameras(scene: clrender.Scene) -> list[Camera]:
    """Of all kinds, near that of the scene."""
    here = scene.camera
    near = {"position": here.position, "target": here.target, "up": here.up}
    kinds: list[dict[str, Any]] = [
        {},
        {"vertical_fov": 60.0},
        {"aperture_radius": 0.05},
        {"type": "orthographic", "height": 1.5},
        {"type": "fisheye", "vertical_fov": 150.0},
        {"type": "panoramic"},
        {"type": "intrinsics", "fx": 25.0, "resolution": SIZE, "distortion": BARREL},
    ]
    moved = [here.changed(position=tuple(x + 0.01 * n for x in here.position)) for n in range(5)]
    return [*(Camera(**{**near, **kind}) for kind in kinds), *moved]


def check(session: clrender.Session, scene: clrender.Scene, views: list[Camera], **how: Any) -> None:
    found = session.render_batch(scene, views, size=SIZE, spp=4, **how)
    assert found.shape[:3] == (len(views), SIZE[1], SIZE[0])
    for image, camera in zip(found, views, strict=True):
        alone = session.render(scene.with_checked(camera=camera), size=SIZE, spp=4, **how)
        np.testing.assert_array_equal(image[..., :3], alone.linear)
        if alone.alpha is not None:
            np.testing.assert_array_equal(image[..., 3], alone.alpha)


def test_a_batch_returns_all_that_is_asked_for(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Denoised images, and nothing that no array of images holds."""
    scene = clrender.load("room")
    with clrender.Session(device.info.index) as session:
        found = session.render_batch(scene, [scene.camera], size=(8, 8), spp=1)
        render = session.render

        def denoised(*arguments: Any, **how: Any) -> clrender.RenderedImage:
            image = render(*arguments, **how)
            image.denoised = image.linear + np.float32(1.0)
            return image

        monkeypatch.setattr(session, "render", denoised)
        np.testing.assert_array_equal(session.render_batch(scene, [scene.camera], size=(8, 8), spp=1), found + 1.0)
        more: list[dict[str, Any]] = [
            {"aov": ["alpha", "depth"]},
            {"light_groups": True},
            {"amodal": "all"},
            {"spectral": True, "spectrum": 4},
        ]
        for asked in more:
            with pytest.raises(UsageError, match=r"without .*(depth|light_groups|instance|spectrum); render those one"):
                session.render_batch(scene, [scene.camera], size=(8, 8), spp=1, **asked)


@pytest.mark.parametrize(
    "how",
    [
        {},
        pytest.param({"filter": "mitchell", "kernels": "staged"}, marks=pytest.mark.long),
        {"integrator": "whitted", "tile": 8},
    ],
    ids=str,
)
def test_a_batch_has_the_bits_of_each_image(device: Device, how: dict[str, Any]) -> None:
    scene = clrender.load("room")
    with clrender.Session(device.info.index) as session:
        check(session, scene, cameras(scene), **how)


def test_a_batch_of_what_moves(device: Device) -> None:
    """Images of three heights of blocks, so that blocks lie below the last one."""
    keys = [{"time": 0.0}, {"time": 1.0, "translate": [0.2, 0.0, 0.0]}]
    scene = clrender.load("room").changed({"camera.shutter": [0.0, 1.0], "shapes.6.motion": keys})
    views = [scene.camera.changed(vertical_fov=30.0 + 5.0 * number) for number in range(4)]
    with clrender.Session(device.info.index) as session:
        check(session, scene, views)


def test_a_batch_is_one_render(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = clrender.load("room")
    monkeypatch.setattr(clrender.Session, "render", None)
    with clrender.Session(device.info.index) as session:
        assert session.render_batch(scene, cameras(scene), size=SIZE, spp=1).std() > 0.0


@pytest.mark.long
@pytest.mark.parametrize(
    "how",
    [{"integrator": "bdpt"}, {"integrator": "reuse"}, {"aov": "alpha"}, {"crop": (2, 3, 9, 8)}, {"replicate_spp": 2},
     {"guiding": "on", "guiding_paths": 20000}, {"integrator": "photon", "photons": 500}, {"integrator": "direct"}],
    ids=str,
)  # fmt: skip
def test_what_cannot_be_together_is_rendered_alone(device: Device, how: dict[str, Any]) -> None:
    scene = clrender.load("room")
    with clrender.Session(device.info.index) as session:
        found = session.render_batch(scene, cameras(scene)[-2:], size=SIZE, spp=4, **how)
        for image, camera in zip(found, cameras(scene)[-2:], strict=True):
            alone = session.render(scene.with_checked(camera=camera), size=SIZE, spp=4, **how)
            np.testing.assert_array_equal(image[..., :3], alone.linear)


def test_cameras_far_apart_or_in_media(device: Device) -> None:
    """Where arrays depend on the camera, or paths begin in a medium."""
    scene = clrender.Scene(
        camera={"position": [0, 0, 4], "target": [0, 0, 0]},
        materials={"m": {"type": "lambert", "reflectance": [0.5, 0.5, 0.5]}},
        media={"water": {"absorption": [0.1, 0.2, 0.3]}},
        shapes=[
            {"type": "sphere", "radius": 0.5, "material": "m"},
            {"type": "sphere", "center": [0, 0, 4], "radius": 0.7, "interior": "water"},
        ],
        lights=[{"type": "environment", "radiance": [1, 1, 1]}],
    )
    here = scene.camera
    views = [here, here.changed(position=(0.0, 1.0, 3.0)), here.changed(position=(0.0, 5e6, 3.0)), here]
    with clrender.Session(device.info.index) as session:
        check(session, scene, views)


def test_keys_and_sizes(device: Device) -> None:
    scene = clrender.load("room")
    views: list[Any] = [{"vertical_fov": 30.0}, {"type": "panoramic"}, scene.camera]
    found = clrender.render_batch(scene, views, size=(12, 8), spp=1, device=device.info.index)
    assert found.shape == (3, 8, 12, 3) and found.dtype == np.float32
    odd = clrender.render_batch(scene, views, size=(9, 7), spp=1, device=device.info.index)
    assert odd.shape == (3, 7, 9, 3)
    assert clrender.render_batch(scene, [], size=(12, 8), spp=1, device=device.info.index).shape == (0, 8, 12, 3)
    with pytest.raises(SceneError, match=r"camera: vertical_fov is -1\.0"):
        clrender.render_batch(scene, [{"vertical_fov": -1.0}], size=(12, 8), spp=1)
    job = clrender.RenderJob.of(scene, size=(1024, 1024))
    assert [len(some) for some in batches(job, [scene.camera] * 9)] == [4, 4, 1]


@pytest.mark.parametrize("given", [3, None, "cameras.json", {"vertical_fov": 30.0}], ids=str)
def test_cameras_are_a_list(given: Any) -> None:
    with clrender.Session() as session, pytest.raises(UsageError, match="but must be a list of cameras"):
        session.render_batch(clrender.load("room"), given, spp=1, size=(4, 4))


def test_amodal_masks_are_of_names() -> None:
    with pytest.raises(UsageError, match="amodal is 3, but must be names of instances, or all"):
        clrender.RenderJob.of(clrender.load("room"), amodal=3)  # type: ignore[arg-type]
