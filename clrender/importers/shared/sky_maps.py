"""Converts other renderers' environment maps to our equirectangular ones.

Mitsuba's have the centres of their first and last rows at the poles, so that row k of H is at k / (H - 1) of the way
from pole to pole, where ours are at (k + 1/2) / H. pbrt-v4's are equal-area squares.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import angle_of, sin_cos
from clrender.exact.elementary import angles_of, arctangent, sines_cosines
from clrender.exact.matrices import inverse, length, lengths, times
from clrender.importers.asset_files import AssetFiles
from clrender.importers.shared.matrices import Matrix
from clrender.scene.environment import EnvironmentPicture

__all__ = [
    "height_in_square",
    "map_pixels",
    "picture_from_poles",
    "square_place",
    "turn_about_y",
    "turned_picture",
    "turned_pixels",
    "unfolded_picture",
]

_EVEN: Final = 1e-5
_LARGEST: Final = 4096
"""Most rows of a converted map."""


def turn_about_y(matrix: Matrix) -> float | None:
    """Degrees by which a matrix rotates about +y; None if it is not such a rotation (scale is ignored)."""
    linear = matrix[:3, :3] / length(matrix[:3, 1])
    angle = angle_of(float(linear[0, 2]), float(linear[0, 0]))
    sine, cosine = sin_cos(angle)
    expected = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]]
    if np.abs(linear - expected).max() > _EVEN:
        return None
    return math.degrees(angle) if abs(angle) > 1e-7 else 0.0


def _directions(height: int) -> NDArray[np.float64]:
    """Directions of the pixels of our maps, (height, 2 height, 3): middle column at +z, a quarter further at -x."""
    sin_theta, cos_theta = sines_cosines((np.arange(height) + 0.5) / height * np.pi)
    sin_phi, cos_phi = sines_cosines((np.arange(2 * height) + 0.5) / (2 * height) * 2.0 * np.pi)
    made = np.empty((height, 2 * height, 3))
    made[..., 0] = sin_theta[:, None] * sin_phi
    made[..., 1] = cos_theta[:, None]
    made[..., 2] = -sin_theta[:, None] * cos_phi
    return made


def _looked_up(pixels: NDArray[np.float32], x: Any, y: Any, around: bool) -> NDArray[np.float32]:
    """Bilinear lookup; x and y in pixels from the centre of the first one."""
    height, width = pixels.shape[:2]
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    total = np.zeros((*x.shape, 3), np.float64)
    for down in (0, 1):
        for right in (0, 1):
            weight = (1.0 - np.abs(x - left - right)) * (1.0 - np.abs(y - top - down))
            column = (left + right) % width if around else np.clip(left + right, 0, width - 1)
            total += weight[..., None] * pixels[np.clip(top + down, 0, height - 1), column]
    return total.astype(np.float32)


def picture_from_poles(files: AssetFiles, name: str, place: str) -> EnvironmentPicture:
    """A map of Mitsuba's, with as many rows as it has. For the parameters see `turned_picture`."""
    pixels = map_pixels(files, name, place)
    rows = len(pixels)
    made = np.empty_like(pixels)
    for row in range(rows):
        y = (row + 0.5) / rows * (rows - 1)
        top = min(int(y), max(rows - 2, 0))
        below = min(top + 1, rows - 1)
        made[row] = pixels[top] + np.float32(y - top) * (pixels[below] - pixels[top])
    return EnvironmentPicture.checked(made, f"{files.source}: {place}")


def turned_picture(files: AssetFiles, name: str, place: str, matrix: Matrix) -> EnvironmentPicture:
    """A map of Mitsuba's, rotated or mirrored by a matrix.

    Parameters
    ----------
    files : AssetFiles
    name : str
    place : str
        For messages.
    matrix : (4, 4) float64
        From the map's own directions to world space.
    """
    pixels = map_pixels(files, name, place)
    return turned_pixels(pixels, matrix, f"{files.source}: {place}", from_poles=True)


def turned_pixels(
    pixels: NDArray[np.float32], matrix: Matrix, label: str, *, from_poles: bool = False
) -> EnvironmentPicture:
    """A map by latitude and longitude, rotated or mirrored by a matrix.

    Parameters
    ----------
    pixels : (H, W, 3) float32
    matrix : (4, 4) float64
        From the map's own directions to world space.
    label : str
        Beginning of messages.
    from_poles : bool
        Whether the centres of the first and the last row are at the poles, as in Mitsuba; else half a row from them.
    """
    height, width = pixels.shape[:2]
    rows = min(height, _LARGEST)
    made = np.empty((rows, 2 * rows, 3), np.float32)
    back = inverse(matrix[:3, :3])
    directions = _directions(rows)
    for row in range(rows):
        own = times(back, directions[row])
        own /= lengths(own)[:, None]
        theta = angles_of(np.sqrt(own[:, 0] * own[:, 0] + own[:, 2] * own[:, 2]), own[:, 1])
        turns = angles_of(own[:, 0], -own[:, 2]) / (2.0 * np.pi) % 1.0
        y = theta / np.pi * (height - 1) if from_poles else theta / np.pi * height - 0.5
        made[row] = _looked_up(pixels, turns * width - 0.5, y, True)
    return EnvironmentPicture.checked(made, label)


def unfolded_picture(pixels: NDArray[np.float32], matrix: Matrix, label: str) -> EnvironmentPicture:
    """Convert a square environment map of Clarberg's equal-area mapping (JGT 13(1), 2008), as used by pbrt-v4.

    For the parameters see `turned_pixels`.
    """
    side = len(pixels)
    rows = max(min(side, _LARGEST), 16)
    made = np.empty((rows, 2 * rows, 3), np.float32)
    back = inverse(matrix[:3, :3])
    directions = _directions(rows)
    for row in range(rows):
        own = times(back, directions[row])
        own /= lengths(own)[:, None]
        u, v = square_place(own)
        made[row] = _looked_up(pixels, u * side - 0.5, v * side - 0.5, False)
    return EnvironmentPicture.checked(made, label)


def square_place(directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Map unit vectors to the square, each coordinate 0 to 1: +z is at the centre, -z at the corners."""
    x, y, z = np.abs(directions).T
    radius = np.sqrt(np.maximum(1.0 - z, 0.0))
    larger, smaller = np.maximum(x, y), np.minimum(x, y)
    ratio = np.divide(smaller, larger, out=np.zeros_like(larger), where=larger > 0.0)
    phi = arctangent(ratio) * 2.0 / np.pi
    phi = np.where(x < y, 1.0 - phi, phi)
    v = phi * radius
    u = radius - v
    below = directions[:, 2] < 0.0
    u, v = np.where(below, 1.0 - v, u), np.where(below, 1.0 - u, v)
    u, v = np.copysign(u, directions[:, 0]), np.copysign(v, directions[:, 1])
    return (u + 1.0) / 2.0, (v + 1.0) / 2.0


def height_in_square(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cosine of the angle from +z of the directions at places of that square, each coordinate 0 to 1."""
    from_edge = 1.0 - (np.abs(2.0 * u - 1.0) + np.abs(2.0 * v - 1.0))
    radius = 1.0 - np.abs(from_edge)
    return np.asarray(np.copysign(1.0 - radius * radius, from_edge), np.float64)


def map_pixels(files: AssetFiles, name: str, place: str) -> NDArray[np.float32]:
    """Pixels of a map, (H, W, 3) float32. For the parameters see `turned_picture`."""
    return EnvironmentPicture.read(name, files.folder, files.allow_paths, f"{files.source}: {place}").pixels
