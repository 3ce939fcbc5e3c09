"""What work is made of: slots, units, and what a unit comes to. Numbers only, no device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

__all__ = ["Unit", "UnitSums", "Worker", "slot_count", "tile_side", "tile_slots"]

BLOCK = 4
"""Side of the blocks a tile is made of, ``kernels/film/slot.h``."""

LARGEST_TILE = 1024
"""A tile's sums take 52 bytes a pixel on the device and once more here, so a larger one would only cost memory."""


@dataclass(frozen=True)
class Unit:
    """Samples [first_sample, first_sample + sample_count) of slots [first_slot, first_slot + slot_count).

    Doing it twice gives the same bits, so a unit that was lost is done again. It covers whole tiles.
    """

    first_slot: int
    slot_count: int
    first_sample: int
    sample_count: int


@dataclass(frozen=True)
class UnitSums:
    """What a unit came to.

    Attributes
    ----------
    sums : (slot_count, 3, 4) uint32
        128-bit sums in quanta of 2**-64, least significant word first.
    counts : (slot_count,) uint32
        Accepted samples; slots outside the image have none.
    samples, rays, shadow_rays, deepest : int
        Paths traced, rays of all kinds, shadow rays, most scattering events of a path.
    complete : bool
        False when it was stopped before all samples were done.
    """

    sums: npt.NDArray[np.uint32]
    counts: npt.NDArray[np.uint32]
    samples: int
    rays: int
    shadow_rays: int
    deepest: int
    complete: bool


class Worker(Protocol):
    """Whatever can do a unit: all that scheduling knows of a device."""

    @property
    def name(self) -> str:
        """For messages and statistics."""

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        """Trace the samples of a unit.

        Parameters
        ----------
        unit : Unit
        on_slice : callable, optional
            Told now and then how many samples and rays were added since it was last told.
        should_stop : callable, optional
            When it says yes, what is done so far is returned.

        Raises
        ------
        ClrenderError
            When the device failed. The unit then counts as not done.
        """


def tile_side(tile: int, width: int, height: int) -> int:
    """Side of a tile that is really used: a multiple of `BLOCK`, no larger than the image needs nor `LARGEST_TILE`."""
    return -(-min(tile, max(width, height), LARGEST_TILE) // BLOCK) * BLOCK


def slot_count(width: int, height: int, tile: int) -> int:
    """Slots of an image: those of all its tiles."""
    return -(-width // tile) * -(-height // tile) * tile * tile


def tile_slots(tile: int) -> npt.NDArray[np.int64]:
    """Slots of a tile in the order of its pixels, row by row; the inverse of ``kernels/film/slot.h``.

    Returns
    -------
    (tile * tile,) int64
    """
    rows, columns = np.divmod(np.arange(tile * tile, dtype=np.int64), tile)
    block = rows // BLOCK * (tile // BLOCK) + columns // BLOCK
    slots: npt.NDArray[np.int64] = block * BLOCK * BLOCK + rows % BLOCK * BLOCK + columns % BLOCK
    return slots
