"""Sky, ground and sun as one environment map, for programs without the same sky."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.exact.elementary import sines_cosines
from clrender.flatten.sky import scene_sun, sky_picture
from clrender.scene import Scene, SunSkyLight

__all__ = ["sky_map"]

_SKY_TIMES: Final = 4
"""Pixels of a map with a sun for each of the sky's along a side, so that the disc is six pixels across."""
_SUN_SAMPLES: Final = 8
"""Points of a pixel along a side that decide how much of the sun it sees."""


def sky_map(scene: Scene, light: SunSkyLight) -> tuple[NDArray[np.float32], bool]:
    """The radiance of a scene's sky, with the sun above the middle column, and whether there is a sun.

    Parameters
    ----------
    scene : Scene
    light : SunSkyLight
        Its sky.

    Returns
    -------
    pixels : (H, 2 H, 3) float32
        Like the map of an environment light, to be turned by `SunSkyLight.sun_turn`.
    sunny : bool
        Whether the sun is drawn into it.
    """
    sun, sky = scene_sun(scene), sky_picture(light)
    pixels = np.zeros((512, 1024, 3), np.float32) if sky is None else sky.pixels
    if sun is not None:
        pixels = pixels.repeat(_SKY_TIMES, axis=0).repeat(_SKY_TIMES, axis=1)
        _draw_sun(pixels, light.sun_elevation, sun.spread, np.array(sun.mean))
    return pixels, sun is not None


def _draw_sun(pixels: NDArray[np.float32], elevation: float, spread: float, mean: NDArray[np.float64]) -> None:
    """Add the sun's disc, above the middle column, to a map; the sum of its light is exact.

    Parameters
    ----------
    pixels : (H, 2 H, 3) float32
        Changed.
    elevation : float
        Degrees.
    spread : float
        1 - cosine of its angular radius.
    mean : (3,) float64
        Its mean radiance.
    """
    height, width = pixels.shape[:2]
    finer = (np.arange(_SUN_SAMPLES) + 0.5) / _SUN_SAMPLES
    radius = math.degrees(2.0 * math.sqrt(spread / 2.0))
    top, bottom = (int((90.0 - elevation + side * 2.0 * radius) / 180.0 * height) for side in (-1.0, 1.0))
    rows = np.arange(max(top, 0), min(bottom + 1, height // 2))
    sin_polar, cos_polar = sines_cosines((rows[:, None] + finer).ravel() * (math.pi / height))
    _, cos_turn = sines_cosines(((np.arange(width)[:, None] + finer).ravel() / width - 0.5) * 2.0 * math.pi)
    rise, level = sin_cos_degrees(elevation)
    cosine = cos_polar[:, None] * rise + sin_polar[:, None] * cos_turn[None, :] * level
    seen = (cosine > 1.0 - spread) * sin_polar[:, None]
    share = seen.reshape(len(rows), _SUN_SAMPLES, width, _SUN_SAMPLES).mean(axis=(1, 3))
    solid = share.sum() * (math.pi / height) * (2.0 * math.pi / width)
    sines = sin_polar.reshape(len(rows), _SUN_SAMPLES).mean(axis=1)
    covered = share / sines[:, None] * (2.0 * math.pi * spread / solid)
    pixels[rows] += (covered[..., None] * mean).astype(np.float32)
