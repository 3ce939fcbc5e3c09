"""How work is cut into units: by each worker's measured speed, and smaller towards the end.

A slow worker beside a fast one must not hold a large unit when everything else is done. So a unit is meant to last
`UNIT_SECONDS` at its worker's speed, and no longer than that worker's share of what is left (guided self-scheduling,
Polychronopoulos and Kuck, IEEE Transactions on Computers C-36(12), 1987). No cut changes the image.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

from clrender.film.unit import Unit, slot_count

__all__ = ["Plan", "Remaining"]

UNIT_SECONDS: Final = 1.0
"""What a unit should last: long enough to hide what it costs beside its samples, short enough to lose."""

_UNIT_SLOTS: Final = 1 << 17
_LARGE_UNIT_SLOTS: Final = 1 << 23
_UNIT_SAMPLES: Final = 16
_FIRST_SLOTS: Final = 1 << 14
"""Slots of the first unit of one of several workers, whose speed nobody knows yet."""


@dataclass(frozen=True)
class Plan:
    """The work of a render.

    Attributes
    ----------
    width, height : int
        Pixels.
    first_sample, sample_count : int
        Samples of each pixel.
    tile : int
        Side of a tile, a multiple of 4 (`clrender.film.unit.tile_side`).
    sample_by_sample : bool
        Units of one sample, as large as memory allows: the integrator computes something for all pixels of a sample.
    rows : (int, int) or None
        Of the image's rows of tiles, the first and the first that is not part of the work; None: all.
    """

    width: int
    height: int
    first_sample: int
    sample_count: int
    tile: int
    sample_by_sample: bool = False
    rows: tuple[int, int] | None = None

    @property
    def samples(self) -> int:
        """Samples of all pixels together."""
        first, end = (0, self.height) if self.rows is None else (row * self.tile for row in self.rows)
        return self.width * (min(end, self.height) - first) * self.sample_count

    @property
    def first_tile(self) -> int:
        """Number of the first tile."""
        return 0 if self.rows is None else self.rows[0] * -(-self.width // self.tile)

    @property
    def tiles(self) -> int:
        """Tiles of the work."""
        if self.rows is not None:
            return (self.rows[1] - self.rows[0]) * -(-self.width // self.tile)
        return slot_count(self.width, self.height, self.tile) // (self.tile * self.tile)


class Remaining:
    """The work that nobody has taken yet, in the order in which it is taken.

    Blocks of samples come one after the other, so that the whole image refines, and each goes over the image tile by
    tile. Not thread-safe.

    Parameters
    ----------
    plan : Plan
    workers : int
        How many share the work.
    """

    def __init__(self, plan: Plan, workers: int) -> None:
        self._plan = plan
        self._workers = workers
        self._area = plan.tile * plan.tile
        self._most_tiles = max(1, (_LARGE_UNIT_SLOTS if plan.sample_by_sample else _UNIT_SLOTS) // self._area)
        self._rates: dict[int, float] = {}
        depth, stop = 1 if plan.sample_by_sample else _UNIT_SAMPLES, plan.first_sample + plan.sample_count
        self._strips = deque(
            Unit(plan.first_tile * self._area, plan.tiles * self._area, sample, min(depth, stop - sample), plan.tile)
            for sample in range(plan.first_sample, stop, depth)
        )
        self._left = sum(strip.slot_count * strip.sample_count for strip in self._strips)

    def take(self, worker: int) -> Unit | None:
        """The next unit for a worker, or None when nothing is left."""
        if not self._strips:
            return None
        strip = self._strips.popleft()
        tiles, samples = self._size(worker, strip)
        unit = Unit(strip.first_slot, tiles * self._area, strip.first_sample, samples, strip.tile)
        # What is cut off comes next: first the other samples of the same tiles, then the other tiles
        if rest := strip.slot_count - unit.slot_count:
            self._strips.appendleft(
                Unit(strip.first_slot + unit.slot_count, rest, strip.first_sample, strip.sample_count, strip.tile)
            )
        if later := strip.sample_count - samples:
            self._strips.appendleft(
                Unit(strip.first_slot, unit.slot_count, strip.first_sample + samples, later, strip.tile)
            )
        self._left -= unit.slot_count * unit.sample_count
        return unit

    def put_back(self, unit: Unit) -> None:
        """A unit that was taken and will not be done by who took it: it comes next."""
        self._strips.appendleft(unit)
        self._left += unit.slot_count * unit.sample_count

    def measured(self, worker: int, unit: Unit, seconds: float) -> None:
        """A worker has done a unit in so many seconds."""
        self._rates[worker] = unit.slot_count * unit.sample_count / max(seconds, 1e-6)

    def retire(self, worker: int) -> None:
        """A worker takes no more work."""
        self._rates.pop(worker, None)
        self._workers -= 1

    def _size(self, worker: int, strip: Unit) -> tuple[int, int]:
        """Tiles and samples of the next unit of a worker, from this strip."""
        tiles = min(strip.slot_count // self._area, self._most_tiles)
        if self._workers <= 1 or self._plan.sample_by_sample:
            return tiles, strip.sample_count
        if worker not in self._rates:
            return min(tiles, max(1, _FIRST_SLOTS // self._area)), 1
        rate = self._rates[worker]
        # Half of the worker's share of what is left: the other half makes up for what the next units are off
        share = self._left * rate / (2.0 * (sum(self._rates.values()) + 1e-9))
        wanted = min(rate * UNIT_SECONDS, share)
        tiles = min(tiles, max(1, int(wanted / (self._area * strip.sample_count))))
        return tiles, max(1, min(strip.sample_count, int(wanted / (self._area * tiles))))
