"""Light of models that have none: what is white stands out from what is behind it, and clips nowhere."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import clrender
from clrender.device import Device
from clrender.importers.studio import studio_light
from clrender.scene import Camera, EnvironmentLight, Lambert, Scene, Sphere
from clrender.scene.environment import EnvironmentPicture

SIZE = 96


def ball(device: Device, reflectance: float, camera: Camera) -> npt.NDArray[np.float64]:
    """A matt ball of radius 1 about the origin in the light that its camera gets."""
    light = EnvironmentLight(type="environment", file="studio light")
    material = Lambert(type="lambert", reflectance=(reflectance,) * 3)
    scene = Scene(
        camera=camera,
        materials={"matt": material},
        shapes=(Sphere(type="sphere", radius=1.0, material="matt"),),
        lights=(light,),
    ).with_files(environments={"studio light": studio_light(camera)})
    image = clrender.render(scene, device=device.info.index, size=(SIZE, SIZE), spp=64)
    return np.asarray(image.linear, np.float64)[..., 1]


def test_a_white_ball_is_seen_all_around_and_clips_nowhere(device: Device) -> None:
    """From the front and a little above, as models are framed: by the formula of `clrender.importers.studio`, too."""
    toward = np.array((0.45, 0.35, 1.0)) / math.sqrt(0.45**2 + 0.35**2 + 1.0)
    distance = 1.3 / math.sin(math.radians(17.5))
    x, y, z = (float(each) for each in distance * toward)
    image = ball(device, 1.0, Camera(position=(x, y, z), target=(0.0, 0.0, 0.0), vertical_fov=35.0))
    rows, columns = (np.indices((SIZE, SIZE)) + 0.5 - SIZE / 2.0) / (SIZE / 2.0)
    radius = np.hypot(rows, columns) * math.tan(math.radians(17.5)) * math.sqrt(distance**2 - 1.0)
    inside, rim, around = radius < 0.9, (radius > 0.85) & (radius < 0.93), (radius > 1.05) & (radius < 1.2)
    assert image[inside].max() < 1.0
    turn = np.arctan2(-rows, columns)
    for start in np.arange(-math.pi, math.pi, math.pi / 8.0):
        part = (turn >= start) & (turn < start + math.pi / 8.0)
        assert image[rim & part].mean() > 1.5 * image[around & part].mean(), math.degrees(start)
    assert 0.08 < image[around].mean() < 0.25
    # Brightest at the upper left, darkest at the lower right
    quarters = [image[inside & (rows * a > 0) & (columns * b > 0)].mean() for a in (-1, 1) for b in (-1, 1)]
    assert np.argmax(quarters) == 0 and np.argmin(quarters) == 3
    # Straight on, d against the view: 0.4 + (2/3) (0.2 u.n + 0.2), and the key light by its integral over the sphere
    assert image[SIZE // 2 - 2 : SIZE // 2 + 2, SIZE // 2 - 2 : SIZE // 2 + 2].mean() == _matt(toward, -toward)


def _matt(normal: npt.NDArray[np.float64], forward: npt.NDArray[np.float64]) -> Any:
    """What a white surface returns, by a sum over directions that know nothing of pictures."""
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    key = -0.55 * right + 0.65 * np.cross(right, forward) - 0.8 * forward
    key /= np.linalg.norm(key)
    cosine, turn = np.meshgrid((np.arange(400) + 0.5) / 200.0 - 1.0, (np.arange(800) + 0.5) * math.pi / 400.0)
    sine = np.sqrt(1.0 - cosine**2)
    d = np.stack([sine * np.cos(turn), cosine, sine * np.sin(turn)], -1)
    radiance = 0.4 + 0.2 * d[..., 1] - 0.2 * (d @ forward) + 3.5 * np.maximum(d @ key, 0.0) ** 16
    return pytest.approx(float((radiance * np.maximum(d @ normal, 0.0)).mean() * 4.0), rel=0.02)


def test_it_follows_the_camera_and_is_a_picture_of_radiance() -> None:
    front = studio_light(Camera(position=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0)))
    side = studio_light(Camera(position=(5.0, 0.0, 0.0), target=(0.0, 0.0, 0.0)))
    # The column a quarter of the width from the left is at +x, the middle one at +z
    np.testing.assert_allclose(np.roll(side.pixels, 32, axis=1), front.pixels, atol=1e-6)
    EnvironmentPicture.checked(front.pixels, "studio")
    assert front.pixels.min() > 0.1
    row, column = np.unravel_index(int(front.pixels[..., 0].argmax()), (64, 128))
    assert row < 30 and 64 < column < 96  # above, and between +z and -x
    mirrored = studio_light(Camera(position=(0.0, 0.0, 5.0), target=(0.0, 0.0, 0.0), mirrored=True))
    np.testing.assert_allclose(mirrored.pixels[:, ::-1], front.pixels, atol=1e-6)


def test_models_without_light_get_it_and_converted_ones_keep_it(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = clrender.load(tmp_path / "a.obj")
    picture = scene.environment_picture()
    assert picture is not None and picture.sha256() == studio_light(scene.camera).sha256()
