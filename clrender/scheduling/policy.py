"""Divides the work into units, by each worker's measured speed, and smaller towards the end.

A slow worker must not hold a large unit when everything else is done. So the target duration of a unit is
`UNIT_SECONDS` at its worker's speed, but at most that worker's share of the remaining work (guided self-scheduling,
Polychronopoulos and Kuck, IEEE Transactions on Computers C-36(12), 1987).

The cost of merging a unit into the film depends on its pixels, not on its samples. So the first pass over the image
takes few samples, and each further pass twice as many, as long as all workers together finish a pass in about
`BAND_SECONDS`. The division into units never changes the image.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import islice, pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.film.ledger import Ledger, Ranges
from clrender.film.unit import BLOCK_SLOTS, Unit, slot_count

__all__ = ["Plan", "Remaining"]

UNIT_SECONDS: Final = 1.0
"""Target duration of a unit: long enough to amortize its overhead, short enough that losing it is cheap."""

LONGEST_SECONDS: Final = 3.0
"""Longest target duration of a unit if an integrator renders sample by sample and work may be lost."""

BAND_SECONDS: Final = 2.0
"""Target duration of a pass over the image by all workers, which sets its samples per pixel above the minimum."""

_PIXEL_SECONDS: Final = 5e-7
"""Target duration of a pass per pixel, if that is more in total: merging takes the host about 2e-8 s per pixel."""

_LEAST_SECONDS: Final = (0.01, 0.2)
"""Least duration of a unit: twice the shortest so far, clamped to these. Shorter units would be mostly overhead."""

_KNOWN_SECONDS: Final = 0.1
"""Duration from which a unit is long enough to lower the estimate of its worker's speed."""

_FILL_SECONDS: Final = 5e-4
"""Least time for one sample of all pixels of a unit: a parallel device needs enough paths to be fully occupied."""

_LOOKED_AT: Final = 16
"""Number of next strips among which a worker's unit is chosen."""

_UNIT_SLOTS: Final = 1 << 17
_LARGE_UNIT_SLOTS: Final = 1 << 20
"""Most slots of a unit: for slow workers, and for fast ones."""
_SLOT_SECONDS: Final = (1.0 / 64.0, 1.0 / 16.0)
"""Most slots of a unit per sample a second, for a single worker and for several; clamped to the two above."""
_WHOLE_UNIT_SLOTS: Final = 1 << 23
_UNIT_SAMPLES: Final = 16
_FIRST_SLOTS: Final = 1 << 14
"""Slots of a worker's first unit, if there are several workers, as its speed is still unknown."""


@dataclass(frozen=True)
class Plan:
    """The work of a render.

    Attributes
    ----------
    width, height : int
        Pixels.
    first_sample, sample_count : int
        Range of samples of each pixel.
    tile : int
        Side of a tile, a multiple of 4 (`clrender.film.unit.tile_side`).
    sample_by_sample : bool
        Whether the integrator computes something once per sample for all pixels. Units are then as large as memory
        allows.
    rows : (int, int) or None
        Half-open range of the image's rows of tiles; None: all.
    wanted : Ledger or None
        The samples of each block of pixels to render, a subset of the plan's; None: all of the plan's. It must not be
        modified later.
    short_units : bool
        Whether a single worker also gets short units, so that a process that dies loses only one short unit.
    most_slots : int or None
        Most slots of a unit, if memory is limited; a unit is at least one tile.
    whole : int
        Samples of a pixel, in groups counted from 0, that no unit may split: those of a replicate.
    depth : int
        Samples per pixel that a unit may have even for a slow worker. More samples mean fewer sums to transfer.
    gradual : bool
        Whether the first pass over the image takes one sample per pixel and each further one twice as many, for display
        during the render.
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
    most_slots: int | None = None
    whole: int = 1
    depth: int = _UNIT_SAMPLES
    gradual: bool = False

    @property
    def samples(self) -> int:
        """Total number of samples of all pixels."""
        if self.wanted is not None:
            return self.wanted.samples
        first, end = (0, self.height) if self.rows is None else (row * self.tile for row in self.rows)
        return self.width * (min(end, self.height) - first) * self.sample_count

    @property
    def first_tile(self) -> int:
        """Index of the first tile."""
        return 0 if self.rows is None else self.rows[0] * -(-self.width // self.tile)

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        if self.rows is not None:
            return (self.rows[1] - self.rows[0]) * -(-self.width // self.tile)
        return slot_count(self.width, self.height, self.tile) // (self.tile * self.tile)


class Remaining:
    """The work that no worker has taken yet, in the order in which it is taken.

    Ranges of samples are taken one after another, so that the whole image is refined. Each range is one pass over the
    image, tile by tile. Not thread-safe.

    Parameters
    ----------
    plan : Plan
    workers : int
        Number of workers that share the work.
    """

    def __init__(self, plan: Plan, workers: int) -> None:
        self._plan = plan
        self._workers = workers
        self._area = plan.tile * plan.tile
        self._rates: dict[int, float] = {}
        self._shortest: dict[int, float] = {}
        self._bands = (
            _whole_bands(plan, self._depth) if plan.wanted is None else _wanted_bands(plan, plan.wanted, self._depth)
        )
        self._strips: deque[Unit] = deque()
        self._left = plan.tiles * self._area * plan.sample_count if plan.wanted is None else plan.samples

    def take(self, worker: int) -> Unit | None:
        """Take the next unit for a worker; None if nothing is left."""
        while not self._strips:
            band = next(self._bands, None)
            if band is None:
                return None
            self._strips.extend(band)
        place = self._fitting(worker)
        strip = self._strips[place]
        del self._strips[place]
        slots, samples = self._size(worker, strip)
        samples = min(strip.sample_count, -(-samples // self._plan.whole) * self._plan.whole)
        unit = Unit(strip.first_slot, slots, strip.first_sample, samples, strip.tile)
        # The remainder of the strip comes next: first the other samples of the same tiles, then the other tiles
        if rest := strip.slot_count - unit.slot_count:
            self._strips.insert(
                place,
                Unit(strip.first_slot + unit.slot_count, rest, strip.first_sample, strip.sample_count, strip.tile),
            )
        if later := strip.sample_count - samples:
            self._strips.insert(
                place, Unit(strip.first_slot, unit.slot_count, strip.first_sample + samples, later, strip.tile)
            )
        self._left -= unit.slot_count * unit.sample_count
        return unit

    @property
    def is_empty(self) -> bool:
        """Whether all work is taken."""
        return not self._strips and self._left <= 0

    def put_back(self, unit: Unit) -> None:
        """Put back a unit that its worker will not finish; it is taken next."""
        self._strips.appendleft(unit)
        self._left += unit.slot_count * unit.sample_count

    def measured(self, worker: int, unit: Unit, seconds: float) -> None:
        """Record the time that a worker took for a unit."""
        rate, known = unit.slot_count * unit.sample_count / max(seconds, 1e-6), self._rates.get(worker, 0.0)
        self._rates[worker] = rate if seconds > _KNOWN_SECONDS else max(rate, known)
        self._shortest[worker] = min(seconds, self._shortest.get(worker, seconds))

    def retire(self, worker: int) -> None:
        """Note that a worker takes no more work."""
        self._rates.pop(worker, None)
        self._workers -= 1

    def _size(self, worker: int, strip: Unit) -> tuple[int, int]:
        """Number of slots and of samples per pixel of a worker's next unit, from this strip."""
        plan, alone, rate = self._plan, self._workers <= 1, self._rates.get(worker, 0.0)
        if not plan.short_units and (alone or plan.sample_by_sample):
            slots = self._slots(strip, self._most_slots(rate))
            return slots, min(strip.sample_count, max(_UNIT_SAMPLES, int(rate * UNIT_SECONDS / slots)))
        if worker not in self._rates:
            return self._slots(strip, _FIRST_SLOTS), 1
        if plan.sample_by_sample:
            return self._slots(strip, int(rate * LONGEST_SECONDS)), 1
        wanted = self._wanted(worker)
        slots = self._slots(strip, int(max(wanted / strip.sample_count, rate * _FILL_SECONDS)))
        return slots, max(1, min(strip.sample_count, int(wanted / slots)))

    def _wanted(self, worker: int) -> float:
        """Target number of samples of the next unit of a worker whose speed is known."""
        rate = self._rates[worker]
        if self._workers <= 1:
            return rate * UNIT_SECONDS
        # Half of the worker's share of the remaining work: the other half absorbs errors of the estimates
        share = self._left * rate / (2.0 * (sum(self._rates.values()) + 1e-9))
        least, most = _LEAST_SECONDS
        return max(min(rate * UNIT_SECONDS, share), rate * min(max(2.0 * self._shortest[worker], least), most))

    def _fitting(self, worker: int) -> int:
        """Index of the strip to take from: the first large enough, so that fast workers skip small remainders."""
        if worker not in self._rates or self._workers <= 1:
            return 0
        enough = self._wanted(worker) / 4.0
        some = enumerate(islice(self._strips, _LOOKED_AT))
        return next((place for place, strip in some if strip.slot_count * strip.sample_count >= enough), 0)

    def _most_slots(self, rate: float) -> int:
        """Most slots of a worker's unit; faster workers may have larger units."""
        if self._plan.sample_by_sample:
            return _WHOLE_UNIT_SLOTS
        return min(max(_UNIT_SLOTS, int(rate * _SLOT_SECONDS[self._workers > 1])), _LARGE_UNIT_SLOTS)

    def _slots(self, strip: Unit, slots: int) -> int:
        """About this many slots of a strip, rounded to whole tiles, at least one; a partial tile is not split."""
        if strip.slot_count < self._area:
            return strip.slot_count
        most = min(self._most_slots(max(self._rates.values(), default=0.0)), self._plan.most_slots or _WHOLE_UNIT_SLOTS)
        return max(1, min(slots, most, strip.slot_count) // self._area) * self._area

    def _depth(self, before: int) -> int:
        """Samples per pixel of the next pass, given those of the previous one (0: this is the first)."""
        if self._plan.sample_by_sample:
            return 1
        slots = self._plan.tiles * self._area
        rate = sum(self._rates.values()) * max(BAND_SECONDS, slots * _PIXEL_SECONDS) / slots
        least = 1 if self._plan.gradual else _UNIT_SAMPLES
        return max(least, min(2 * before, max(int(rate), self._plan.depth)))


def _ranges(plan: Plan, depth: Callable[[int], int]) -> Iterator[tuple[int, int]]:
    """Half-open ranges of the plan's samples, one for each pass over the image."""
    sample, stop, before = plan.first_sample, plan.first_sample + plan.sample_count, 0
    while sample < stop:
        before = -(-depth(before) // plan.whole) * plan.whole
        yield sample, min(sample + before, stop)
        sample += before


def _whole_bands(plan: Plan, depth: Callable[[int], int]) -> Iterator[list[Unit]]:
    """For each pass, one strip of all tiles."""
    area = plan.tile * plan.tile
    for sample, end in _ranges(plan, depth):
        yield [Unit(plan.first_tile * area, plan.tiles * area, sample, end - sample, plan.tile)]


def _wanted_bands(plan: Plan, wanted: Ledger, depth: Callable[[int], int]) -> Iterator[list[Unit]]:
    """For each pass, strips of adjacent blocks that need the same samples, of the wanted ones only."""
    area = plan.tile * plan.tile
    blocks = Unit(plan.first_tile * area, plan.tiles * area, 0, 1, plan.tile).blocks(plan.width, plan.height)
    # A block outside the image is treated like the one before it; the first block of a tile is always inside
    before = np.maximum.accumulate(np.where(blocks >= 0, np.arange(len(blocks)), 0))
    sets, numbers = wanted.sets_of(blocks[before])
    for sample, end in _ranges(plan, depth):
        parts = [_clipped(each, sample, end) for each in sets]
        distinct = {part: key for key, part in enumerate(dict.fromkeys(parts))}
        if any(distinct):
            yield _strips(plan, np.array([distinct[part] for part in parts])[numbers], list(distinct))


def _strips(plan: Plan, keys: npt.NDArray[np.int64], ranges: list[Ranges]) -> list[Unit]:
    """Strips of consecutive blocks with equal keys; each starts at a tile boundary or lies within one tile.

    Parameters
    ----------
    plan : Plan
    keys : (n,) integers
        For each of the plan's blocks, in the order of its slots, an index into `ranges`.
    ranges : list of Ranges
        The samples that the blocks need.
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
    """The part of some ranges between `start` and `stop`."""
    clipped = ((max(low, start), min(high, stop)) for low, high in ranges)
    return tuple((low, high) for low, high in clipped if low < high)
