"""Projectors: their picture on a screen, intensities, photons and flux, against formulas of their own."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from lamp_launches import Lamps, around, hammersley
from lamp_support import Slide
from render_support import Studio, lambert, quad, scene

from clrender.errors import SceneError

if TYPE_CHECKING:
    from clrender.device import Device

SHARE = 0.5
AXIS, UP = (0.3, -1.0, 0.5), (0.2, 0.1, 1.0)
RANDOM = np.random.default_rng(53).uniform(0.0, 2.0, (5, 8, 3)).astype(np.float32)
LONELY = np.zeros((6, 4, 3), np.float32)
LONELY[1, 2] = 3.0, 1.0, 2.0
SLIDES = {
    "even": Slide(RANDOM),
    "by direction": Slide(RANDOM, even=False),
    "wide": Slide(RANDOM, 150.0),
    "narrow": Slide(RANDOM, 0.5),
    "tall": Slide(np.ascontiguousarray(RANDOM.transpose(1, 0, 2)), 80.0),
    "one pixel": Slide(RANDOM[:1, :1], 60.0),
    "mostly black": Slide(LONELY, 70.0),
}


@pytest.mark.parametrize("name", SLIDES)
def test_intensity(device: Device, tmp_path: Path, name: str) -> None:
    slide, directions = SLIDES[name], around()
    if name == "narrow":  # few of those lie in it
        ahead = np.array(AXIS) / np.linalg.norm(AXIS)
        directions = ahead + 0.006 * directions
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    directions = directions.astype(np.float32)
    what = scene([], [slide.light(tmp_path, direction=AXIS, up=UP, scale=[2.0, 1.0, 1.0])]).placed("here", Path("/"))
    seen = Lamps(device, what).launch("lamp_looks", np.ascontiguousarray(directions.T), 0, 1)[0]
    exact = 2.0 * slide.intensity(directions, AXIS, UP)[:, 0]
    # A direction is known to 1e-7, and the picture is not continuous at its edges
    pixel = math.radians(slide.vertical_fov) / len(slide.pixels)
    off = np.abs(seen - exact) > 1e-5 * exact + 1e-6 / pixel * exact.max()
    assert off.sum() <= (2 if name == "narrow" else 0)
    assert (exact > 0.0).sum() > 30


@pytest.mark.parametrize("name", SLIDES)
def test_photons_start_where_it_shines(device: Device, tmp_path: Path, name: str) -> None:
    """Intensity over density has the flux for its mean, and that of a direction, the flux that goes there."""
    slide = SLIDES[name]
    what = scene([], [slide.light(tmp_path, direction=AXIS, up=UP)]).placed("here", Path("/"))
    x, y, z, pdf, intensity = Lamps(device, what).launch("lamp_samples", hammersley(20), 0, 5)
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, rtol=1e-6)
    assert (pdf > 0.0).all()
    weights = intensity / pdf
    # The formula's grid on the screen
    fine = 512
    top = math.tan(math.radians(slide.vertical_fov / 2.0))
    wide = top * slide.pixels.shape[1] / len(slide.pixels)
    at = (np.arange(fine) + 0.5) / fine * 2.0 - 1.0
    forward = np.array(AXIS) / np.linalg.norm(AXIS)
    right = np.cross(forward, UP)
    right /= np.linalg.norm(right)
    across, down = at[None, :, None] * wide * right, at[:, None, None] * top * np.cross(right, forward)
    screen = forward + across + down
    distance = np.linalg.norm(screen, axis=-1)
    there = slide.intensity(screen, AXIS, UP)[..., 0] / distance**3 * (2.0 * wide / fine) * (2.0 * top / fine)
    flux = float(there.sum())
    assert weights.mean() == pytest.approx(flux, rel=5e-4)
    for seen, axis in ((x, 0), (y, 1), (z, 2)):
        exact = float((there * screen[..., axis] / distance).sum())
        assert (weights * seen).mean() == pytest.approx(exact, abs=1e-3 * flux)
    assert weights.max() < 40.0 * flux


@pytest.mark.parametrize("even", [True, False])
def test_the_picture_on_a_screen(studio: Studio, tmp_path: Path, even: bool) -> None:
    """Upright and unmirrored, as a camera sees it that looks along the projector; each of its colours by itself."""
    blocks = 8
    slide = Slide(np.kron(RANDOM, np.ones((blocks, blocks, 1), np.float32)), 50.0, even)
    height, width, _ = slide.pixels.shape
    distance, scale = 3.0, np.array([4.0, 2.0, 1.0])
    screen = quad([-9.0, -9.0, -distance], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], material="white")
    camera = {"position": [0.0, 0.0, 0.0], "target": [0.0, 0.0, -1.0], "vertical_fov": 50.0}
    light = slide.light(tmp_path, scale=scale.tolist())
    what = scene([screen], [light], white=lambert(SHARE), camera=camera).placed("here", Path("/"))
    seen = studio.image(what, (width, height), spp=4)
    top = math.tan(math.radians(25.0))
    y, x = (((np.arange(n) + 0.5) / n * 2.0 - 1.0) * top for n in (height, width))
    cosine = 1.0 / np.sqrt(1.0 + (y * y)[:, None] + (x * x)[None, :] * (width / height) ** 2)
    fall = np.ones_like(cosine) if even else cosine**3
    exact = slide.pixels * scale * fall[..., None] / distance**2 * SHARE / math.pi
    middle = slice(blocks // 2, None, blocks)
    np.testing.assert_allclose(seen[middle, middle], exact[middle, middle], rtol=1e-5 if even else 0.02)


def test_what_is_refused(tmp_path: Path) -> None:
    light = Slide(RANDOM).light(tmp_path)
    for change, words in (
        ({"direction": [0.0, 0.0, 0.0]}, "direction has length zero"),
        ({"up": [0.0, 0.0, 2.0]}, "up lies along `direction`"),
        ({"vertical_fov": 171.0}, "vertical_fov"),
        ({"file": "/nowhere.exr"}, "does not exist"),
    ):
        with pytest.raises(SceneError, match=words):
            scene([], [{**light, **change}]).placed("here", Path("/")).read_named()
