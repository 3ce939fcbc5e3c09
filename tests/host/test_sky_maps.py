"""Environments of other renderers, in our latitude and longitude: light comes from where it came from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from clrender.image.files import write_image
from clrender.importers.asset_files import AssetFiles
from clrender.importers.shared.sky_maps import (
    map_pixels,
    picture_from_poles,
    square_place,
    turned_picture,
    unfolded_picture,
)

AXES = [np.array(each, np.float64) for each in np.concatenate([np.eye(3), -np.eye(3)]).tolist()]


def seen(pixels: npt.NDArray[np.float32], direction: npt.NDArray[np.float64]) -> float:
    """The nearest pixel: +y is up, the middle column is at +z, and the one a quarter on at -x (docs/scenes.md)."""
    height, width = pixels.shape[:2]
    x, y, z = direction
    column = int(np.arctan2(x, -z) / (2.0 * np.pi) % 1.0 * width) % width
    return float(pixels[min(int(np.arccos(y) / np.pi * height), height - 1), column, 0])


def directions(height: int) -> npt.NDArray[np.float64]:
    """Of a picture's pixels, by the same words."""
    down = (np.arange(height)[:, None] + 0.5) / height * np.pi
    along = (np.arange(2 * height)[None] + 0.5) / height * np.pi
    return np.stack([np.sin(down) * np.sin(along), np.cos(down) + 0.0 * along, -np.sin(down) * np.cos(along)], axis=2)


@pytest.mark.parametrize("axis", range(6))
def test_a_square_is_unfolded(tmp_path: Path, axis: int) -> None:
    random = np.random.default_rng(1)
    some = random.normal(size=(200_000, 3))
    some /= np.sqrt((some * some).sum(axis=1))[:, None]
    square = np.zeros((64, 64, 3), np.float32)
    bright = some[some @ AXES[axis] > 0.7]
    u, v = (np.clip((each * 64).astype(int), 0, 63) for each in square_place(bright))
    square[v, u] = 1.0
    write_image(tmp_path / "square.exr", square, {})
    made = unfolded_picture(
        map_pixels(AssetFiles("scene", tmp_path), "square.exr", "line 1"), np.eye(4), "scene"
    ).pixels
    assert [seen(made, each) for each in AXES] == [float(number == axis) for number in range(6)]


@pytest.mark.parametrize("axis", range(6))
def test_a_picture_is_turned(tmp_path: Path, axis: int) -> None:
    turn = np.eye(4)
    turn[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]  # a quarter about z: x to y, y to -x
    around = directions(32)
    picture = (around @ AXES[axis] > 0.7).astype(np.float32)[:, :, None].repeat(3, axis=2)
    write_image(tmp_path / "sky.exr", picture, {})
    assert seen(picture, AXES[axis]) == 1.0
    files = AssetFiles("scene", tmp_path)
    same = turned_picture(files, "sky.exr", "line 1", np.eye(4)).pixels
    np.testing.assert_allclose(same, picture_from_poles(files, "sky.exr", "line 1").pixels, atol=1e-5)
    made = turned_picture(files, "sky.exr", "line 1", turn).pixels
    assert [seen(made, each) for each in AXES] == [seen(picture, turn[:3, :3].T @ each) for each in AXES]


@pytest.mark.parametrize("rows", [1, 2, 7, 64])
def test_rows_from_pole_to_pole(tmp_path: Path, rows: int) -> None:
    """A map that is linear in the angle stays so, with the values that Mitsuba 3.7 has for the directions."""
    picture = np.broadcast_to(np.arange(rows, dtype=np.float32)[:, None, None], (rows, 2 * rows, 3))
    write_image(tmp_path / "sky.exr", picture, {})
    made = picture_from_poles(AssetFiles("scene", tmp_path), "sky.exr", "line 1").pixels
    expected = (np.arange(rows) + 0.5) / rows * (rows - 1)
    np.testing.assert_allclose(made, np.broadcast_to(expected[:, None, None], made.shape), rtol=1e-5)
