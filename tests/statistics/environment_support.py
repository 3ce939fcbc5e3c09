"""Pictures of the environment: some difficult ones, by float64 formulas and on the device."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from render_support import scene

from clrender.device.scene_arrays import SceneArrays, scene_array_names
from clrender.flatten.flat_scene import flatten
from clrender.scene.environment import EnvironmentPicture

if TYPE_CHECKING:
    from clrender.device import Device
    from clrender.device.device import Argument
    from clrender.scene import Scene

__all__ = ["PICTURES", "DevicePicture", "brighter", "cells", "irradiance", "luminance", "radiance", "under"]

Floats = npt.NDArray[np.float64]

SOURCE = Path(__file__).resolve().with_name("environment.cl")
LANES = 8
_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


def _one_bright(width: int, height: int) -> Floats:
    pixels = np.zeros((height, width, 3))
    pixels[height // 3, width // 4] = (3.0, 2.0, 1.0)
    return pixels


def _wild(width: int, height: int) -> Floats:
    rng = np.random.default_rng(width)
    pixels: Floats = 10.0 ** rng.uniform(-3.0, 1.0, (height, width, 3))
    pixels[rng.random((height, width)) < 0.2] = 0.0
    return pixels


def _sunny(width: int, height: int) -> Floats:
    up = np.linspace(1.0, -1.0, height)[:, None, None]
    pixels: Floats = np.where(up > 0.0, 0.4 + 0.6 * up, 0.2) * np.array([0.5, 0.7, 1.0]) * np.ones((height, width, 1))
    pixels[height // 4, width // 3] = (2e4, 1.8e4, 1.5e4)
    return pixels


PICTURES: dict[str, Floats] = {
    "one bright pixel": _one_bright(100, 10),
    "constant": np.full((100, 100, 3), 0.5),
    "constant 3 x 2": np.full((2, 3, 3), 2.0),
    "one pixel": np.full((1, 1, 3), 3.0),
    "wild": _wild(31, 17),
    "wild and flat": _wild(64, 1),
    "wild and narrow": _wild(1, 33),
    "sunny": _sunny(64, 32),
}


def luminance(colors: Floats) -> Floats:
    """Of (..., 3) colours."""
    bright: Floats = colors @ _WEIGHTS
    return bright


def _lines(height: int) -> Floats:
    """Cosines of the angle from +y: the pole, the centres of the rows, the other pole."""
    cosines: Floats = np.cos(np.concatenate([[0.0], (np.arange(height) + 0.5) / height * math.pi, [math.pi]]))
    return cosines


def _between(pixels: Floats, line: Any, down: Any, column: Any, right: Any) -> Floats:
    height, width, _ = pixels.shape
    upper, lower = np.clip(line - 1, 0, height - 1), np.clip(line, 0, height - 1)
    first, second = pixels[upper, column % width], pixels[upper, (column + 1) % width]
    third, fourth = pixels[lower, column % width], pixels[lower, (column + 1) % width]
    s, t = np.asarray(right)[..., None], np.asarray(down)[..., None]
    value: Floats = (first * (1 - s) + second * s) * (1 - t) + (third * (1 - s) + fourth * s) * t
    return value


def radiance(pixels: Floats, directions: Floats, degrees: float = 0.0) -> Floats:
    """Of a picture in (n, 3) directions."""
    height, width, _ = pixels.shape
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    lines = _lines(height)
    line = np.clip(np.searchsorted(-lines, -unit[:, 1], side="right") - 1, 0, height)
    down = (lines[line] - unit[:, 1]) / (lines[line] - lines[line + 1])
    place = (np.arctan2(unit[:, 0], 0.0 - unit[:, 2]) / (2.0 * math.pi) + degrees / 360.0) % 1.0 * width - 0.5
    column = np.floor(place).astype(np.int64)
    return _between(pixels, line, np.clip(down, 0.0, 1.0), column, place - column)


def cells(pixels: Floats) -> tuple[Floats, Floats, float]:
    """Between all lines and columns four cells, even in turns from the first pixel's centre on.

    Returns
    -------
    edges : (m + 1,) cosines, descending
    shares : (m, n) of the light
    total : float
        Integral of the luminance by solid angle.
    """
    height, width, _ = pixels.shape
    lines = _lines(height)
    edges = np.interp(np.arange(2 * height + 3) / 2.0, np.arange(height + 2), lines)
    line, column = np.arange(2 * (height + 1)) // 2, np.arange(2 * width) // 2
    down, right = np.arange(2 * (height + 1)) % 2 * 0.5 + 0.25, np.arange(2 * width) % 2 * 0.5 + 0.25
    middle = luminance(_between(pixels, line[:, None], down[:, None], column[None, :], right[None, :]))
    light = middle * -np.diff(edges)[:, None]
    return edges, light / light.sum(), float(light.sum()) * math.pi / width


def brighter(pixels: Floats) -> Floats:
    """How far the luminance of pixels is above the mean over all directions, as grey pixels."""
    bright = np.repeat(luminance(pixels)[..., None], 3, axis=2)
    grey: Floats = np.maximum(bright - cells(pixels)[2] / (4.0 * math.pi), 0.0)
    return grey


def irradiance(pixels: Floats, normal: tuple[float, ...], degrees: float = 0.0, fine: int = 8) -> Floats:
    """(3,) W/m2 on a surface with this normal: a sum over parts of pixels, each with its exact solid angle."""
    height, width, _ = pixels.shape
    theta = np.linspace(0.0, math.pi, fine * height + 1)
    middle, phi = (theta[1:] + theta[:-1]) / 2.0, (np.arange(fine * width) + 0.5) / (fine * width) * 2.0 * math.pi
    solid = (np.cos(theta[:-1]) - np.cos(theta[1:])) * 2.0 * math.pi / (fine * width)
    total = np.zeros(3)
    for angle, size in zip(middle, solid, strict=True):
        ring = np.full(len(phi), math.sin(angle))
        d = np.stack([ring * np.sin(phi), np.full(len(phi), math.cos(angle)), -ring * np.cos(phi)], axis=1)
        cosine = np.maximum(d @ np.asarray(normal), 0.0)
        total += size * (cosine @ radiance(pixels, d, degrees))
    return total


def under(pixels: Floats, what: Scene, **more: Any) -> Scene:
    """A scene whose environment is the file "sky", with these pixels in its place."""
    return what.with_files(environments={"sky": EnvironmentPicture(pixels.astype(np.float32))})


class DevicePicture:
    """A picture on the device.

    Parameters
    ----------
    device : Device
    pixels : (H, W, 3) float
    compensated : bool
        Sampled as far as it is brighter than its mean.
    more
        Of the environment light.
    """

    def __init__(self, device: Device, pixels: Floats, compensated: bool = False, **more: Any) -> None:
        what = under(pixels, scene([], [{"type": "environment", "file": "sky", **more}]))
        self.device, self.flat = device, flatten(what, 16, 16, compensated=compensated)
        self.arrays = SceneArrays(device, self.flat)

    def samples(self, u: Floats, v: Floats) -> Floats:
        """(11, n): direction, radiance, density; radiance and density that are found there."""
        bits = np.stack([u, v]) * 2.0**32
        return self._launch("environment_samples", bits.astype(np.uint32).view(np.float32), 11)

    def looks(self, directions: Floats) -> Floats:
        """(4, n): radiance, and the angle around y in turns."""
        return self._launch("environment_looks", directions.T.astype(np.float32), 4)

    def _launch(self, kernel: str, numbers: npt.NDArray[np.float32], outputs: int) -> Floats:
        count = numbers.shape[1]
        padded = -(-count // (16 * LANES)) * 16 * LANES
        numbers = np.ascontiguousarray(np.pad(numbers, ((0, 0), (0, padded - count)), mode="edge"))
        device = self.device
        buffers = [device.upload(np.zeros(64, np.uint32)), device.upload(numbers), device.empty(4 * outputs * padded)]
        named = {**self.arrays.buffers, "settings": buffers[0]}  # which nobody reads
        program = device.program(SOURCE, {"LANES": LANES, "ENVIRONMENT_MAP": 1})
        given: list[Argument] = [
            *(named[name] for name in scene_array_names()),
            buffers[1],
            np.uint32(padded),
            buffers[2],
        ]
        device.launch(program, kernel, padded // LANES, 16, given)
        out = np.empty((outputs, padded), np.float32)
        device.read(buffers[2], out)
        for buffer in buffers:
            device.release(buffer)
        return out[:, :count].astype(np.float64)
