"""film/accumulate.cl against Python's integers: exact sums of all finite samples, in whatever order and grouping."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from exact_sums import quanta

from clrender import layout
from clrender.film.unit import slot_count, tile_slots

if TYPE_CHECKING:
    from collections.abc import Sequence

    from clrender.device import Device

WIDTH, HEIGHT, TILE = 12, 6, 8
SLOTS = slot_count(WIDTH, HEIGHT, TILE)

Floats = npt.NDArray[np.float32]


class Sums:
    """The sums of an image's slots on a device, and launches that add samples to them."""

    def __init__(self, device: Device) -> None:
        self.device = device
        settings = np.zeros(1, layout.dtype("Settings"))
        settings["width"], settings["height"], settings["tile"] = WIDTH, HEIGHT, TILE
        self.settings = device.upload(settings)
        self.program = device.program("film/accumulate.cl", {"LANES": 1})
        self.sums, self.counts = (device.upload(np.full(n, 0xCD, np.uint8)) for n in (48 * SLOTS, 4 * SLOTS))
        device.launch(self.program, "film_clear", -(-SLOTS // 16) * 16, 16, [self.sums, self.counts, np.uint32(SLOTS)])

    def add(self, samples: Floats, first: int = 0, offset: int | None = None) -> None:
        """Add (sample, 3, slot) samples of the slots from `first` on; their sums are from `offset` on, else `first`."""
        count, _, slots = samples.shape
        buffer = self.device.upload(np.ascontiguousarray(samples))
        numbers = [np.uint32(n) for n in (first, slots, count, first if offset is None else offset)]
        arguments: list[Any] = [self.settings, buffer, *numbers, self.sums, self.counts]
        self.device.launch(self.program, "film_accumulate", -(-slots // 16) * 16, 16, arguments)
        self.device.finish()
        self.device.release(buffer)

    def read(self) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]:
        words, counts = np.empty((SLOTS, 3, 4), np.uint32), np.empty(SLOTS, np.uint32)
        self.device.read(self.sums, words)
        self.device.read(self.counts, counts)
        for buffer in (self.settings, self.sums, self.counts):
            self.device.release(buffer)
        return words, counts


def inside() -> npt.NDArray[np.bool_]:
    """Which slots lie in the image."""
    across, side = -(-WIDTH // TILE), TILE * TILE
    seen = np.zeros(SLOTS, bool)
    rows, columns = np.divmod(np.arange(side), TILE)
    for tile in range(SLOTS // side):
        x, y = tile % across * TILE + columns, tile // across * TILE + rows
        seen[tile * side + tile_slots(TILE)] = (x < WIDTH) & (y < HEIGHT)
    return seen


def expected(samples: Floats) -> tuple[list[list[int]], list[int]]:
    """Sums of quanta modulo 2^128, (slot, channel), and how many samples were taken."""
    sums, counts = [[0] * 3 for _ in range(SLOTS)], [0] * SLOTS
    for slot in np.flatnonzero(inside()):
        for sample in samples[:, :, slot]:
            if all(math.isfinite(x) and abs(float(x)) < 2.0**43 for x in sample):
                counts[slot] += 1
                for channel in range(3):
                    sums[slot][channel] = (sums[slot][channel] + quanta(sample[channel])) % 2**128
    return sums, counts


def as_integers(words: npt.NDArray[np.uint32]) -> list[list[int]]:
    return [[sum(int(word) << (32 * k) for k, word in enumerate(channel)) for channel in slot] for slot in words]


def all_of_float(rng: np.random.Generator, count: int) -> Floats:
    """Samples of any bits, half of them at the places where something changes."""
    samples = rng.integers(0, 2**32, (count, 3, SLOTS), dtype=np.uint32).view(np.float32)
    limit, quantum = np.float32(2.0**43), np.float32(2.0**-64)
    special = [0.0, -0.0, np.inf, -np.inf, np.nan, limit, -limit, np.nextafter(limit, np.float32(0)), 1e-45, -1e-45]
    special += [
        -np.nextafter(limit, np.float32(0)),
        quantum,
        -quantum,
        quantum / 2,
        np.nextafter(quantum, np.float32(0)),
    ]
    special += [quantum * np.float32(1.5), 2.0**-40, 2.0**-41, 2.0**-42, 1.0, -1.0, 2.0**23, 1.1754944e-38, -1e-38]
    special += [float(np.float32(s * 2.0**p * f)) for p in range(-70, 44) for f in (0.999, 1.999999) for s in (1, -1)]
    picked = np.array(special, np.float32)[rng.integers(len(special), size=samples.shape)]
    samples = np.where(rng.integers(0, 2, samples.shape) == 0, picked, samples)
    # One sample in three that is refused would leave little to add: most channels are tame.
    tame = rng.normal(size=samples.shape) * 10.0 ** rng.uniform(-25, 12.5, samples.shape)
    return np.where(rng.uniform(size=samples.shape) < 0.7, tame, samples).astype(np.float32)


def test_sums_are_exact_over_the_whole_range_of_floats(all_devices: list[Device]) -> None:
    samples = all_of_float(np.random.default_rng(8), 48)
    sums, counts = expected(samples)
    assert sum(counts) > 1000
    assert sum(counts) < 0.9 * 48 * inside().sum()
    for device in all_devices:
        film = Sums(device)
        film.add(samples)
        words, counted = film.read()
        assert counted.tolist() == counts, device.info.title
        assert as_integers(words) == sums, device.info.title


def test_one_sample_of_every_kind(device: Device) -> None:
    """Each alone, so that no error can hide behind another."""
    rng = np.random.default_rng(9)
    for _ in range(8):
        samples = all_of_float(rng, 1)
        samples[0, 1:] = 0.0
        film = Sums(device)
        film.add(samples)
        words, counted = film.read()
        assert (as_integers(words), counted.tolist()) == expected(samples)


def test_order_and_grouping_change_nothing(device: Device) -> None:
    """Launches of other sizes, of other slots first, and samples in another order, with sums that cancel and carry."""
    rng = np.random.default_rng(10)
    samples = all_of_float(rng, 40)
    samples[20:] = -samples[:20][rng.permutation(20)]
    whole = Sums(device)
    whole.add(samples)
    first = whole.read()

    def grouped(order: npt.NDArray[np.int64], cuts: Sequence[int], slot_cuts: Sequence[int]) -> None:
        film = Sums(device)
        for begin, end in itertools.pairwise(slot_cuts):
            for start, stop in itertools.pairwise(cuts):
                film.add(samples[order[start:stop], :, begin:end], begin)
        words, counts = film.read()
        assert np.array_equal(words, first[0])
        assert np.array_equal(counts, first[1])

    straight = np.arange(40)
    grouped(straight, range(41), [0, SLOTS])
    grouped(straight, [0, 7, 8, 33, 40], [0, 16, 48, SLOTS])
    grouped(straight[::-1], [0, 40], list(range(0, SLOTS + 1, 16)))
    grouped(rng.permutation(40), [0, 13, 40], [0, 112, SLOTS])


def test_a_million_of_the_largest_samples_fit(device: Device) -> None:
    """2^20 samples just below 2^43 are the most a sum has to hold: 2^127, with a sign."""
    most = np.nextafter(np.float32(2.0**43), np.float32(0))
    samples = np.full((2**14, 3, 16), most, np.float32)
    samples[:, 1] = -most
    film = Sums(device)
    for _ in range(2**6):
        film.add(samples)
    words, counts = film.read()
    assert (counts[:16][inside()[:16]] == 2**20).all()
    r, g, b = as_integers(words[:1])[0]
    assert r == b == 2**20 * quanta(most)
    assert r < 2**127
    assert g == 2**128 - r


def test_a_units_sums_begin_at_its_own_first_slot(device: Device) -> None:
    """Which slots lie in the image is a matter of the image's slots, where the sums are one of the unit's."""
    samples = np.ones((2, 3, 64), np.float32)
    film = Sums(device)
    film.add(samples, first=64, offset=16)
    counts = film.read()[1]
    assert np.array_equal(counts[16:80], np.where(inside()[64:128], 2, 0))
    assert not counts[:16].any()
    assert not counts[80:].any()


def test_statistics_are_summed_up(device: Device) -> None:
    """Those of more work-items than rows, of fewer, and of sums beyond 32 bits."""
    program, rows = device.program("film/accumulate.cl", {"LANES": 1}), 10
    for items in (3, 10, 1001):
        stats = np.random.default_rng(items).integers(2**30, 2**32, (items, 4), dtype=np.uint32)
        read, totals = device.upload(stats), device.empty(32 * rows)
        arguments: list[Any] = [read, np.uint32(items), totals, np.uint32(rows)]
        device.launch(program, "film_total_stats", 16, 16, arguments)
        made = np.empty((rows, 4), np.uint64)
        device.read(totals, made)
        assert made[:, :2].sum(axis=0).tolist() == stats[:, :2].sum(axis=0, dtype=np.uint64).tolist()
        assert made[:, 2].max() == stats[:, 2].max()
        for buffer in (read, totals):
            device.release(buffer)
