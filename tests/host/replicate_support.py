"""Films with replicates made of samples that are known, by Python's fractions."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from clrender.film import Film
from clrender.film.unit import Unit, UnitSums, slot_count, tile_side, tile_slots

__all__ = ["REQUEST", "SIZE", "Floats", "film_of", "same", "samples_of", "sums_of", "words"]

SIZE = 4
Floats = npt.NDArray[np.float32]


def words(value: int, count: int) -> list[int]:
    return [(value >> (64 * k)) % 2**64 for k in range(count)]


def samples_of(seed: int, pixels: int, count: int) -> Floats:
    """(count, pixels, 3) samples whose spread is known to nobody."""
    rng = np.random.default_rng(seed)
    return rng.lognormal(0.0, 1.5, (count, pixels, 3)).astype(np.float32)


def sums_of(unit: Unit, values: Floats, width: int, height: int, size: int = SIZE) -> UnitSums:
    """What a device makes of samples (all samples, H * W, 3): the unit's are among them, in whole replicates."""
    area = unit.tile * unit.tile
    across = -(-width // unit.tile)
    place = np.full(slot_count(width, height, unit.tile), -1)
    for tile in range(len(place) // area):
        rows, columns = np.divmod(np.arange(area), unit.tile)
        y, x = tile // across * unit.tile + rows, tile % across * unit.tile + columns
        place[tile * area + tile_slots(unit.tile)] = np.where((x < width) & (y < height), y * width + x, -1)
    place = place[unit.first_slot : unit.first_slot + unit.slot_count]
    sums = np.zeros((unit.slot_count, 3, 2), np.uint64)
    squares = np.zeros((unit.slot_count, 3, 4), np.uint64)
    stop = unit.first_sample + unit.sample_count
    for slot in np.flatnonzero(place >= 0):
        for channel in range(3):
            quanta = [int(Fraction(float(v)) * 2**64) for v in values[unit.first_sample : stop, place[slot], channel]]
            parts = [sum(quanta[k : k + size]) for k in range(0, len(quanta), size)]
            sums[slot, channel] = words(sum(parts), 2)
            squares[slot, channel] = words(sum(part * part for part in parts), 4)
    counts = np.where(place >= 0, unit.sample_count, 0).astype(np.uint32)
    done = np.full(unit.slot_count // 16, unit.sample_count, np.uint32)
    return UnitSums(sums.view(np.uint32), counts, done, 0, 0, 0, squares.view(np.uint32))


def film_of(values: Floats, width: int, height: int, cuts: Iterable[int], request: dict[str, Any]) -> Film:
    """A film of all samples, in units that end at some of them."""
    film = Film(width, height, request)
    side = tile_side(8, width, height)
    begin = 0
    for end in cuts:
        unit = Unit(0, slot_count(width, height, side), begin, end - begin, side)
        film.commit(unit, sums_of(unit, values, width, height, request["replicate_spp"]))
        begin = end
    return film


REQUEST = {"replicate_spp": SIZE}


def same(a: Film, b: Film) -> bool:
    pairs = zip([*a.bands(), *a.square_bands()], [*b.bands(), *b.square_bands()], strict=True)
    return a.ledger == b.ledger and np.array_equal(a.counts, b.counts) and all(np.array_equal(x, y) for x, y in pairs)
