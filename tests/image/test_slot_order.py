"""The kernels and the host agree on which pixel a slot is: film/slot.h against clrender/film/unit.py."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from clrender.film.unit import slot_count, tile_side, tile_slots
from clrender.settings import RenderSettings

if TYPE_CHECKING:
    from clrender.device import Device

ENTRY = Path(__file__).with_name("slot_order.cl")
WORK_GROUP = 16


@pytest.mark.parametrize("lanes", [1, 16])
@pytest.mark.parametrize(
    ("width", "height", "tile"),
    [(50, 39, 16), (64, 64, 64), (1, 70, 64), (70, 1, 4), (1, 1, 64), (3000, 5, 1024), (17, 33, 20)],
)
def test_every_pixel_has_the_slot_where_the_film_looks(
    device: Device, width: int, height: int, tile: int, lanes: int
) -> None:
    side = tile_side(tile, width, height)
    count = slot_count(width, height, side)
    settings = device.upload(RenderSettings(width=width, height=height).struct(side))
    pixels = device.empty(12 * count)
    program = device.program(ENTRY, {"LANES": lanes})
    size = -(-count // lanes // WORK_GROUP) * WORK_GROUP
    device.launch(program, "slot_order", size, WORK_GROUP, [settings, np.uint32(count), pixels])
    x, y, inside = result = np.empty((3, count), np.uint32)
    device.read(pixels, result)
    device.release(pixels)
    device.release(settings)

    assert (inside == ((x < width) & (y < height))).all()
    assert inside.sum() == width * height
    image = np.full((-(-height // side) * side, -(-width // side) * side), -1, np.int64)
    image[y, x] = np.arange(count)
    assert (image >= 0).all(), "every slot has a pixel of its own"
    order = tile_slots(side).reshape(side, side)
    across = image.shape[1] // side
    for row in range(0, image.shape[0], side):
        for column in range(0, image.shape[1], side):
            first = (row // side * across + column // side) * side * side
            np.testing.assert_array_equal(image[row : row + side, column : column + side], first + order)
