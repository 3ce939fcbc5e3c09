"""How work is cut into units: by each worker's measured speed, and smaller towards the end.

A slow worker beside a fast one must not hold a large unit when everything else is done. So a unit is meant to last
`UNIT_SECONDS` at its worker's speed, and no longer than that worker's share of what is left (guided self-scheduling,
Polychronopoulos and Kuck, IEEE Transactions on Computers C-36(12), 1987). No cut changes the image.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.film.ledger import Ledger, Ranges
from clrender.film.unit import BLOCK_SLOTS, Unit, slot_count

__all__ = ["Plan", "Remaining"]

UNIT_SECONDS: Final = 1.0
"""What a unit should last: long enough to hide what it costs beside its samples, short enough to lose."""

LONGEST_SECONDS: Final = 3.0
"""What a part of a sample should last at most where samples should stay whole, and work may be lost."""

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
    wanted : Ledger or None
        Which samples of which blocks of pixels are the work, all of them among those of the plan; None: all of the
        plan's. It must not change any more.
    short_units : bool
        Units of one worker last no longer than those of several: what is lost with a process that dies is a unit.
    deepest : int
        Samples of a pixel in a unit at most. The more there are, the fewer sums travel for as many samples.
    """

    width: int
    height: int
    first_sample: int
    sample_count: int
    tile: int
    sample_by_sample: bool = False
    rows: tuple[int, int] | None = None
    wanted: Ledger | None = field(default=None, compare=False)
    short_units: bool = False
    deepest: int = _UNIT_SAMPLES

    @property
    def samples(self) -> int:
        """Samples of all pixels together."""
        if self.wanted is not None:
            return self.wanted.samples
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
        self._bands = _whole_bands(plan) if plan.wanted is None else _wanted_bands(plan, plan.wanted)
        self._strips: deque[Unit] = deque()
        self._left = plan.tiles * self._area * plan.sample_count if plan.wanted is None else plan.samples

    def take(self, worker: int) -> Unit | None:
        """The next unit for a worker, or None when nothing is left."""
        while not self._strips:
            band = next(self._bands, None)
            if band is None:
                return None
            self._strips.extend(band)
        strip = self._strips.popleft()
        slots, samples = self._size(worker, strip)
        unit = Unit(strip.first_slot, slots, strip.first_sample, samples, strip.tile)
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
        """Slots and samples of the next unit of a worker, from this strip."""
        alone = self._workers <= 1
        if not self._plan.short_units and (alone or self._plan.sample_by_sample):
            return self._slots(strip, self._most_tiles), strip.sample_count
        if worker not in self._rates:
            return self._slots(strip, _FIRST_SLOTS // self._area), 1
        rate = self._rates[worker]
        if self._plan.sample_by_sample:
            return self._slots(strip, int(rate * LONGEST_SECONDS / self._area)), 1
        # Half of the worker's share of what is left: the other half makes up for what the next units are off
        share = self._left * rate / (2.0 * (sum(self._rates.values()) + 1e-9))
        wanted = rate * UNIT_SECONDS if alone else min(rate * UNIT_SECONDS, share)
        slots = self._slots(strip, int(wanted / (self._area * strip.sample_count)))
        return slots, max(1, min(strip.sample_count, int(wanted / slots)))

    def _slots(self, strip: Unit, tiles: int) -> int:
        """Slots of so many tiles, but one at least, of a strip; it may be a part of a tile, which stays together."""
        if strip.slot_count < self._area:
            return strip.slot_count
        return max(1, min(tiles, self._most_tiles, strip.slot_count // self._area)) * self._area


def _depths(plan: Plan) -> Iterator[tuple[int, int]]:
    """Ranges of samples that the image is refined by; none adds more than there are, once those are as many as fit."""
    sample, stop = plan.first_sample, plan.first_sample + plan.sample_count
    while sample < stop:
        depth = 1 if plan.sample_by_sample else max(_UNIT_SAMPLES, min(plan.deepest, sample - plan.first_sample))
        yield sample, min(sample + depth, stop)
        sample += depth


def _whole_bands(plan: Plan) -> Iterator[list[Unit]]:
    """Strips of all tiles, some samples after the other."""
    area = plan.tile * plan.tile
    for sample, end in _depths(plan):
        yield [Unit(plan.first_tile * area, plan.tiles * area, sample, end - sample, plan.tile)]


def _wanted_bands(plan: Plan, wanted: Ledger) -> Iterator[list[Unit]]:
    """The same of what is wanted alone: strips of neighbouring blocks that want the same samples."""
    area = plan.tile * plan.tile
    blocks = Unit(plan.first_tile * area, plan.tiles * area, 0, 1, plan.tile).blocks(plan.width, plan.height)
    # Outside the image, a block goes with the one before it; the first block of a tile is inside
    before = np.maximum.accumulate(np.where(blocks >= 0, np.arange(len(blocks)), 0))
    sets, numbers = wanted.sets_of(blocks[before])
    for sample, end in _depths(plan):
        parts = [_clipped(each, sample, end) for each in sets]
        distinct = {part: key for key, part in enumerate(dict.fromkeys(parts))}
        if any(distinct):
            yield _strips(plan, np.array([distinct[part] for part in parts])[numbers], list(distinct))


def _strips(plan: Plan, keys: npt.NDArray[np.int64], ranges: list[Ranges]) -> list[Unit]:
    """Strips of blocks of equal keys, each of which begins a tile or is a part of one.

    Parameters
    ----------
    plan : Plan
    keys : (n,) integers
        Of the plan's blocks, in the order of its slots: indices into `ranges`.
    ranges : list of Ranges
        The samples that blocks want.
    """
    along = plan.tile * plan.tile // BLOCK_SLOTS
    first_slot = plan.first_tile * plan.tile * plan.tile
    ends = [*(np.flatnonzero(np.diff(keys)) + 1).tolist(), len(keys)]
    strips, start = [], 0
    for end in ends:
        wanted = ranges[int(keys[start])]
        for a, b in pairwise(sorted({start, min(-(-start // along) * along, end), end})):
            slots = (first_slot + BLOCK_SLOTS * a, BLOCK_SLOTS * (b - a))
            strips += [Unit(*slots, low, high - low, plan.tile) for low, high in wanted]
        start = end
    return strips


def _clipped(ranges: Ranges, start: int, stop: int) -> Ranges:
    """The samples from `start` to `stop` among some."""
    clipped = ((max(low, start), min(high, stop)) for low, high in ranges)
    return tuple((low, high) for low, high in clipped if low < high)
