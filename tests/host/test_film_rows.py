"""Units of any shape land in the film as slots are numbered, whatever pieces they are added in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clrender.film import Film, accumulate
from clrender.film.unit import BLOCK_SLOTS, Unit, UnitSums, slot_count, tile_slots

MASK = (1 << 128) - 1


def random_result(unit: Unit, rng: np.random.Generator) -> UnitSums:
    """Any 128-bit numbers, many of them near a carry."""
    sums = rng.integers(0, 2**32, (unit.slot_count, 3, 4), dtype=np.uint32)
    sums[rng.random(sums.shape) < 0.3] = 0xFFFFFFFF
    counts = rng.integers(0, 5, unit.slot_count, dtype=np.uint32)
    return UnitSums(sums, counts, np.full(unit.slot_count // BLOCK_SLOTS, unit.sample_count, np.uint32), 0, 0, 0)


def place_of(unit: Unit, width: int) -> dict[int, tuple[int, int]]:
    """Row and column of each of a unit's slots, from the order of one tile alone."""
    area, across = unit.tile * unit.tile, -(-width // unit.tile)
    inside = {slot: divmod(place, unit.tile) for place, slot in enumerate(tile_slots(unit.tile).tolist())}
    places = {}
    for slot in range(unit.first_slot, unit.first_slot + unit.slot_count):
        row, column = divmod(slot // area, across)
        y, x = inside[slot % area]
        places[slot] = row * unit.tile + y, column * unit.tile + x
    return places


@settings(max_examples=60, deadline=None)
@given(
    size=st.tuples(st.integers(1, 45), st.integers(1, 37)),
    side=st.sampled_from([4, 8, 12, 20]),
    chunk=st.sampled_from([1, 50, 1 << 13]),
    band=st.integers(1, 40),
    part=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_unit_lands_where_its_slots_are(
    size: tuple[int, int], side: int, chunk: int, band: int, part: tuple[float, float], seed: int
) -> None:
    (width, height), rng = size, np.random.default_rng(seed)
    blocks = slot_count(width, height, side) // BLOCK_SLOTS
    first, last = sorted(int(share * (blocks - 1)) for share in part)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(accumulate, "_CHUNK", chunk)
        patch.setattr("clrender.film.film._BAND_BYTES", 48 * width * band)
        film = Film(width, height)
        totals = np.zeros((height, width, 3), object)
        counts = np.zeros((height, width), np.int64)
        for number in range(3):
            unit = Unit(first * BLOCK_SLOTS, (last - first + 1) * BLOCK_SLOTS, 7 * number, 7, side)
            result = random_result(unit, rng)
            film.commit(unit, result)
            for slot, (y, x) in place_of(unit, width).items():
                if y < height and x < width:
                    words = result.sums[slot - unit.first_slot].tolist()
                    totals[y, x] += [sum(word << 32 * k for k, word in enumerate(channel)) for channel in words]
                    counts[y, x] += int(result.counts[slot - unit.first_slot])
    np.testing.assert_array_equal(film.counts, counts)
    sums = np.concatenate(film.bands()).astype(object)
    np.testing.assert_array_equal(sums[..., 0] + (sums[..., 1] << 64), totals & MASK)
