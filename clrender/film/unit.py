"""Units of work: blocks of pixels, tiles, units, and the sums of a unit. Only data, independent of devices.

Pixels are numbered by slots. A tile is a square of pixels. Its slots are consecutive, in blocks of 4 x 4 pixels, so
each aligned group of sixteen slots is one block. Tiles are numbered row by row (``kernels/film/slot.h``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = [
    "BLOCK",
    "BLOCK_SLOTS",
    "Unit",
    "UnitSums",
    "blocks_across",
    "slot_count",
    "tile_rows",
    "tile_side",
    "tile_slots",
]

BLOCK: Final = 4
"""Side of the blocks of pixels in a tile."""

BLOCK_SLOTS: Final = BLOCK * BLOCK

LARGEST_TILE: Final = 1024
"""Largest side of a tile: its sums take 52 bytes per pixel on the device and again on the host."""


@dataclass(frozen=True)
class Unit:
    """Samples [first_sample, first_sample + sample_count) of slots [first_slot, first_slot + slot_count).

    It covers whole tiles of side `tile`, or whole blocks of one tile. Rendering it twice gives the same bits, so a lost
    unit is simply rendered again.
    """

    first_slot: int
    slot_count: int
    first_sample: int
    sample_count: int
    tile: int

    def blocks(self, width: int, height: int) -> npt.NDArray[np.int64]:
        """The blocks of pixels that the unit covers, of an image of `width` by `height` pixels.

        Returns
        -------
        (slot_count / BLOCK_SLOTS,) int64
            Indices in the image's grid of blocks, row by row, in the order of the unit's slots; -1 outside the image.
            The array is shared and not writeable.
        """
        return _blocks(self, width, height)

    def pixels(self, width: int, height: int) -> npt.NDArray[np.int64]:
        """Number of pixels of each of its blocks inside the image: (slot_count / BLOCK_SLOTS,) int64."""
        blocks = self.blocks(width, height)
        row, column = np.divmod(blocks, blocks_across(width))
        pixels = np.minimum(BLOCK, width - column * BLOCK) * np.minimum(BLOCK, height - row * BLOCK)
        inside: npt.NDArray[np.int64] = np.where(blocks >= 0, pixels, 0)
        return inside


@lru_cache(maxsize=8)
def _blocks(unit: Unit, width: int, height: int) -> npt.NDArray[np.int64]:
    """`Unit.blocks`, cached because rendering, committing and checking a unit all need it."""
    along = unit.tile // BLOCK
    number, block = np.divmod(
        np.arange(unit.first_slot // BLOCK_SLOTS, (unit.first_slot + unit.slot_count) // BLOCK_SLOTS),
        along * along,
    )
    across = -(-width // unit.tile)
    row = number // across * along + block // along
    column = number % across * along + block % along
    inside = (row * BLOCK < height) & (column * BLOCK < width)
    grid: npt.NDArray[np.int64] = np.where(inside, row * blocks_across(width) + column, -1)
    grid.flags.writeable = False
    return grid


@dataclass(frozen=True)
class UnitSums:
    """Result of a unit, complete or stopped early.

    Attributes
    ----------
    sums : (slot_count, 3, 4) uint32
        128-bit sums in quanta of 2**-64, least significant word first.
    counts : (slot_count,) uint32
        Accepted samples; slots outside the image have none.
    done : (slot_count / BLOCK_SLOTS,) uint32
        Number of samples taken of each block, starting at the unit's first; fewer than the unit's if it was stopped.
    rays, shadow_rays, deepest : int
        Rays of all kinds, shadow rays, largest number of scattering events of a path.
    squares : (slot_count, 3, 8) uint32 or None
        With replicates: sums of the squared sums of the replicates, 256 bits in quanta of 2**-128, least significant
        word first. `done` then counts whole replicates only.
    samples : (sample_count, 3, slot_count) float32 or None
        Of pipelines whose samples are kept `apart`: each of them, NaN where there is none. There are no sums and counts
        then.
    records : (sample_count, record words) uint32 or None
        Of pipelines whose records the host reads.
    splats : (sample_count, 3, 4) uint32 or None
        Of those of them that splat: what light paths bring to the pixel in each sample, as `sums`.
    listed : (n, 1 + `SPLAT_WORDS`) uint32 or None
        And each of these light paths: the number of the sample, and a row ``SPLAT`` of `clrender.layout`.
    """

    sums: npt.NDArray[np.uint32]
    counts: npt.NDArray[np.uint32]
    done: npt.NDArray[np.uint32]
    rays: int
    shadow_rays: int
    deepest: int
    squares: npt.NDArray[np.uint32] | None = None
    samples: npt.NDArray[np.float32] | None = None
    records: npt.NDArray[np.uint32] | None = None
    splats: npt.NDArray[np.uint32] | None = None
    listed: npt.NDArray[np.uint32] | None = None

    @classmethod
    def nothing(cls, unit: Unit) -> UnitSums:
        """Result of a unit that was stopped before any sample was taken."""
        slots = unit.slot_count
        sums, counts = np.zeros((slots, 3, 4), np.uint32), np.zeros(slots, np.uint32)
        return cls(sums, counts, np.zeros(slots // BLOCK_SLOTS, np.uint32), 0, 0, 0)


def tile_side(tile: int, width: int, height: int) -> int:
    """Effective side of a tile: a multiple of `BLOCK`, not larger than the image needs or `LARGEST_TILE`."""
    return -(-min(tile, max(width, height), LARGEST_TILE) // BLOCK) * BLOCK


def slot_count(width: int, height: int, tile: int) -> int:
    """Number of slots of an image: those of all its tiles."""
    return -(-width // tile) * -(-height // tile) * tile * tile


def tile_rows(unit: Unit, width: int, height: int) -> range:
    """The rows of the image in which the tiles of a unit lie."""
    area, across = unit.tile * unit.tile, -(-width // unit.tile)
    first, last = unit.first_slot // area // across, (unit.first_slot + unit.slot_count - 1) // area // across
    return range(first * unit.tile, min((last + 1) * unit.tile, height))


def blocks_across(width: int) -> int:
    """Number of blocks in a row of the image's grid; blocks at the right and bottom edges may exceed the image."""
    return -(-width // BLOCK)


@lru_cache(maxsize=8)
def tile_slots(tile: int) -> npt.NDArray[np.int64]:
    """Slots of a tile in the order of its pixels, row by row; the inverse of ``kernels/film/slot.h``.

    Returns
    -------
    (tile * tile,) int64
    """
    rows, columns = np.divmod(np.arange(tile * tile, dtype=np.int64), tile)
    block = rows // BLOCK * (tile // BLOCK) + columns // BLOCK
    slots: npt.NDArray[np.int64] = block * BLOCK_SLOTS + rows % BLOCK * BLOCK + columns % BLOCK
    slots.flags.writeable = False
    return slots
