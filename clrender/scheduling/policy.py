"""How work is cut into units: by each worker's measured speed, and smaller towards the end.

A slow worker beside a fast one must not hold a large unit when everything else is done. So a unit is meant to last
`UNIT_SECONDS` at its worker's speed, and no longer than that worker's share of what is left (guided self-scheduling,
Polychronopoulos and Kuck, IEEE Transactions on Computers C-36(12), 1987).

Merging a unit into the film costs the host the same for each pixel however many samples it holds. So the image is
refined by few samples first, and then by twice as many each time, as long as all workers together do them in good time.
No cut changes the image.
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
"""What a unit should last: long enough to hide what it costs beside its samples, short enough to lose."""

LONGEST_SECONDS: Final = 3.0
"""What a part of a sample should last at most where samples should stay whole, and work may be lost."""

BAND_SECONDS: Final = 2.0
"""In what time all workers together should go over the image once, where that takes more samples than the least."""

_PIXEL_SECONDS: Final = 5e-7
"""Or in so long a time for each pixel, if that is more: merging takes the host some 2e-8 s for each."""

_LEAST_SECONDS: Final = (0.01, 0.2)
"""What a unit lasts at least: between these, twice the shortest so far. Most of a shorter one would be its overhead."""

_KNOWN_SECONDS: Final = 0.1
"""What a unit has to last to tell that its worker is slower than was thought."""

_FILL_SECONDS: Final = 5e-4
"""How long one sample of all pixels of a unit should take: a device with room for many paths has to be filled."""

_LOOKED_AT: Final = 16
"""Of the strips that come next, those among which a worker's next unit is chosen."""

_UNIT_SLOTS: Final = 1 << 17
_LARGE_UNIT_SLOTS: Final = 1 << 20
"""Slots of a unit at most: of slow workers, and of fast ones."""
_SLOT_SECONDS: Final = (1.0 / 64.0, 1.0 / 16.0)
"""Slots of a unit at most for each sample a second, of a lone worker and of several: between the two above."""
_WHOLE_UNIT_SLOTS: Final = 1 << 23
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
    most_slots : int or None
        Slots of a unit at most, where memory is limited; it is one tile at least.
    whole : int
        Samples of a pixel that no unit may part, counted from 0 on: those of a replicate.
    depth : int
        Samples of a pixel that a unit may have, however slow its worker is. The more there are, the fewer sums travel.
    gradual : bool
        The image is refined by one sample first, and then by twice as many each time: for whoever watches.
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
        self._rates: dict[int, float] = {}
        self._shortest: dict[int, float] = {}
        self._bands = (
            _whole_bands(plan, self._depth) if plan.wanted is None else _wanted_bands(plan, plan.wanted, self._depth)
        )
        self._strips: deque[Unit] = deque()
        self._left = plan.tiles * self._area * plan.sample_count if plan.wanted is None else plan.samples

    def take(self, worker: int) -> Unit | None:
        """The next unit for a worker, or None when nothing is left."""
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
        # What is cut off comes next: first the other samples of the same tiles, then the other tiles
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
        """Whether all of it is taken."""
        return not self._strips and self._left <= 0

    def put_back(self, unit: Unit) -> None:
        """A unit that was taken and will not be done by who took it: it comes next."""
        self._strips.appendleft(unit)
        self._left += unit.slot_count * unit.sample_count

    def measured(self, worker: int, unit: Unit, seconds: float) -> None:
        """A worker has done a unit in so many seconds."""
        rate, known = unit.slot_count * unit.sample_count / max(seconds, 1e-6), self._rates.get(worker, 0.0)
        self._rates[worker] = rate if seconds > _KNOWN_SECONDS else max(rate, known)
        self._shortest[worker] = min(seconds, self._shortest.get(worker, seconds))

    def retire(self, worker: int) -> None:
        """A worker takes no more work."""
        self._rates.pop(worker, None)
        self._workers -= 1

    def _size(self, worker: int, strip: Unit) -> tuple[int, int]:
        """Slots and samples of the next unit of a worker, from this strip."""
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
        """Samples of the next unit of a worker whose speed is known."""
        rate = self._rates[worker]
        if self._workers <= 1:
            return rate * UNIT_SECONDS
        # Half of the worker's share of what is left: the other half makes up for what the next units are off
        share = self._left * rate / (2.0 * (sum(self._rates.values()) + 1e-9))
        least, most = _LEAST_SECONDS
        return max(min(rate * UNIT_SECONDS, share), rate * min(max(2.0 * self._shortest[worker], least), most))

    def _fitting(self, worker: int) -> int:
        """Place of the strip to take from: the first, but leftovers of slow workers are no work for a fast one."""
        if worker not in self._rates or self._workers <= 1:
            return 0
        enough = self._wanted(worker) / 4.0
        some = enumerate(islice(self._strips, _LOOKED_AT))
        return next((place for place, strip in some if strip.slot_count * strip.sample_count >= enough), 0)

    def _most_slots(self, rate: float) -> int:
        """Slots of a unit of a worker at most: the more it does in a moment, the more it may hold."""
        if self._plan.sample_by_sample:
            return _WHOLE_UNIT_SLOTS
        return min(max(_UNIT_SLOTS, int(rate * _SLOT_SECONDS[self._workers > 1])), _LARGE_UNIT_SLOTS)

    def _slots(self, strip: Unit, slots: int) -> int:
        """Whole tiles of about so many slots, but one at least, of a strip; a part of a tile stays together."""
        if strip.slot_count < self._area:
            return strip.slot_count
        most = min(self._most_slots(max(self._rates.values(), default=0.0)), self._plan.most_slots or _WHOLE_UNIT_SLOTS)
        return max(1, min(slots, most, strip.slot_count) // self._area) * self._area

    def _depth(self, before: int) -> int:
        """Samples of the next strips, after some of so many (0: the first)."""
        if self._plan.sample_by_sample:
            return 1
        slots = self._plan.tiles * self._area
        rate = sum(self._rates.values()) * max(BAND_SECONDS, slots * _PIXEL_SECONDS) / slots
        least = 1 if self._plan.gradual else _UNIT_SAMPLES
        return max(least, min(2 * before, max(int(rate), self._plan.depth)))


def _ranges(plan: Plan, depth: Callable[[int], int]) -> Iterator[tuple[int, int]]:
    """The plan's samples in the order in which the image is refined: a first one, and one that comes after the last."""
    sample, stop, before = plan.first_sample, plan.first_sample + plan.sample_count, 0
    while sample < stop:
        before = -(-depth(before) // plan.whole) * plan.whole
        yield sample, min(sample + before, stop)
        sample += before


def _whole_bands(plan: Plan, depth: Callable[[int], int]) -> Iterator[list[Unit]]:
    """Strips of all tiles, some samples after the other."""
    area = plan.tile * plan.tile
    for sample, end in _ranges(plan, depth):
        yield [Unit(plan.first_tile * area, plan.tiles * area, sample, end - sample, plan.tile)]


def _wanted_bands(plan: Plan, wanted: Ledger, depth: Callable[[int], int]) -> Iterator[list[Unit]]:
    """The same of what is wanted alone: strips of neighbouring blocks that want the same samples."""
    area = plan.tile * plan.tile
    blocks = Unit(plan.first_tile * area, plan.tiles * area, 0, 1, plan.tile).blocks(plan.width, plan.height)
    # Outside the image, a block goes with the one before it; the first block of a tile is inside
    before = np.maximum.accumulate(np.where(blocks >= 0, np.arange(len(blocks)), 0))
    sets, numbers = wanted.sets_of(blocks[before])
    for sample, end in _ranges(plan, depth):
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
