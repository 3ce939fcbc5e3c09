"""Every sample is done exactly once, whoever does it, in whatever order, and whoever dies; the film cannot tell."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from functools import cache, partial
from typing import Any, Final
from unittest.mock import patch

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from hypothesis import given, settings
from hypothesis import strategies as st

from clrender.errors import DeviceError, RenderError
from clrender.film import Film
from clrender.film.unit import BLOCK, Unit, UnitSums, slot_count, tile_side, tile_slots
from clrender.image.files import image_sha256
from clrender.scheduling.policy import Plan, Remaining
from clrender.scheduling.run import Tally, run
from clrender.scheduling.worker import Candidate

OnSlice = Callable[[int, int], None] | None
ShouldStop = Callable[[], bool] | None

TIME_LIMITS: Final = 30.0
"""Seconds after which a thread that still waits counts as hanging."""


def pixel_of(slot: int, width: int, tile: int) -> tuple[int, int]:
    """(column, row) of a slot, as `slot_block` and `slot_pixel` of kernels/film/slot.h say, number by number."""
    number, inside = divmod(slot, tile * tile)
    row, column = divmod(number, -(-width // tile))
    block_row, block_column = divmod(inside // 16, tile // 4)
    return column * tile + block_column * 4 + slot % 4, row * tile + block_row * 4 + slot // 4 % 4


@cache
def sample_words(x: int, y: int, sample: int) -> tuple[int, ...]:
    """What a sample adds to the three sums of its pixel: any 128-bit numbers of its own, of both signs."""
    mixed = [(x * 0x9E3779B97F4A7C15 + y * 0xC2B2AE3D27D4EB4F + sample * 0x165667B19E3779F9 + c) for c in range(3)]
    return tuple(((m * m) >> 7) % 2**118 - 2**117 for m in mixed)


def words_of(totals: Sequence[Sequence[int]]) -> npt.NDArray[np.uint32]:
    """128-bit numbers (n, 3), four words each."""
    data = b"".join((value % 2**128).to_bytes(16, "little") for slot in totals for value in slot)
    return np.frombuffer(data, "<u4").reshape(-1, 3, 4).astype(np.uint32)


class FakeWorker:
    """Does what a device does, in Python; `before` may delay, stop or kill it."""

    def __init__(self, plan: Plan, name: str = "fake", before: Callable[[int, Unit], None] | None = None) -> None:
        self.plan = plan
        self.name = name
        self.before = before
        self.done: list[Unit] = []
        self.asked = 0

    def render(self, unit: Unit, on_slice: OnSlice = None, should_stop: ShouldStop = None) -> UnitSums:
        """All samples of a unit, one sample of every pixel after the other, as far as it may."""
        self.asked += 1
        plan, rays = self.plan, 0
        inside = [
            (index, x, y)
            for index in range(unit.slot_count)
            for x, y in (pixel_of(unit.first_slot + index, plan.width, plan.tile),)
            if x < plan.width and y < plan.height
        ]
        totals = [[0, 0, 0] for _ in range(unit.slot_count)]
        counts, done = np.zeros(unit.slot_count, np.uint32), np.zeros(unit.slot_count // 16, np.uint32)
        for sample in range(unit.first_sample, unit.first_sample + unit.sample_count):
            if should_stop is not None and should_stop():
                break
            for index, x, y in inside:
                for channel, value in enumerate(sample_words(x, y, sample)):
                    totals[index][channel] += value
                counts[index] += 1
            done += 1
            rays += 3 * len(inside)
            if on_slice is not None:
                on_slice(len(inside), 3 * len(inside))
            if self.before is not None:
                self.before(self.asked, unit)
        if (done == unit.sample_count).all():
            self.done.append(unit)
        return UnitSums(words_of(totals), counts, done, rays, rays // 2, unit.first_sample + 1)


def go(
    plan: Plan,
    workers: Sequence[FakeWorker],
    film: Film,
    on_progress: Callable[[int, int], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
    check_share: float = 0.0,
) -> Tally:
    """Run a plan with these workers, all of which can be set up; nothing is done twice unless that is asked for."""
    candidates = [Candidate(worker.name, partial(lambda each: each, worker)) for worker in workers]
    return run(plan, candidates, film, on_progress, should_stop, None, check_share)


def plan_for(width: int, height: int, spp: int, tile: int = 64) -> Plan:
    return Plan(width, height, 0, spp, tile_side(tile, width, height))


@cache
def expected_sums(plan: Plan) -> npt.NDArray[np.uint64]:
    """(height, width, 3, 2) sums of all samples, straight from the definition."""
    result = np.empty((plan.height, plan.width, 3, 2), np.uint64)
    for y in range(plan.height):
        for x in range(plan.width):
            totals = np.sum(
                [[int(v) for v in sample_words(x, y, s)] for s in range(plan.sample_count)], axis=0, dtype=object
            )
            for channel, value in enumerate(totals):
                result[y, x, channel] = [int(value) & (2**64 - 1), (int(value) >> 64) & (2**64 - 1)]
    return result


def assert_whole(plan: Plan, film: Film) -> None:
    assert (film.counts == plan.sample_count).all()
    np.testing.assert_array_equal(np.concatenate(film.bands()), expected_sums(plan))


def small_units(plan: Plan, samples: int = 2) -> Iterator[Unit]:
    """The plan's work in many small pieces: single tiles, few samples."""
    area, stop = plan.tile * plan.tile, plan.first_sample + plan.sample_count
    for sample in range(plan.first_sample, stop, samples):
        for slot in range(0, slot_count(plan.width, plan.height, plan.tile), area):
            yield Unit(slot, area, sample, min(samples, stop - sample), plan.tile)


class GivenUnits:
    """Stands for what remains to be done: given units, whoever asks."""

    def __init__(self, units: Iterator[Unit]) -> None:
        self._units = deque(units)

    @property
    def is_empty(self) -> bool:
        return not self._units

    def take(self, worker: int) -> Unit | None:
        return self._units.popleft() if self._units else None

    def put_back(self, unit: Unit) -> None:
        self._units.appendleft(unit)

    def measured(self, worker: int, unit: Unit, seconds: float) -> None:
        """Speeds do not matter here."""

    def retire(self, worker: int) -> None:
        """Nor does who is left."""


def cut_as(units: Callable[[Plan], Iterator[Unit]]) -> AbstractContextManager[Any]:
    """While it lasts, plans are cut into these units."""
    return patch("clrender.scheduling.run.Remaining", lambda plan, workers: GivenUnits(units(plan)))


def no_threads_left(before: int) -> bool:
    end = time.monotonic() + TIME_LIMITS
    while threading.active_count() > before and time.monotonic() < end:
        time.sleep(0.01)
    return threading.active_count() <= before


# --- the plan --------------------------------------------------------------------------------------------------------

SIZES = [
    (1, 1, 1, 64),
    (1, 37, 5, 16),
    (53, 1, 17, 8),
    (48, 40, 33, 16),
    (20, 20, 16, 65536),
    (5, 3, 2, 1),
    (64, 64, 1, 64),
]


def taken(plan: Plan, rates: Sequence[float], cost: float = 0.0) -> list[tuple[int, Unit, float]]:
    """(worker, unit, second at which it is done) by workers of given speeds, slots times samples a second.

    A unit costs so many seconds beside its samples.
    """
    remaining, clock = Remaining(plan, len(rates)), [(0.0, worker) for worker in range(len(rates))]
    done = []
    while clock:
        clock.sort()
        now, worker = clock.pop(0)
        unit = remaining.take(worker)
        if unit is not None:
            seconds = unit.slot_count * unit.sample_count / rates[worker] + cost
            remaining.measured(worker, unit, seconds)
            done.append((worker, unit, now + seconds))
            clock.append((now + seconds, worker))
    return done


@for_each("rates", [[1e6], [1e6, 1e6], [1e7, 3e5, 40.0]])
@for_each(("width", "height", "spp", "tile"), SIZES)
def test_units_cover_every_sample_of_every_slot_once(
    width: int, height: int, spp: int, tile: int, rates: list[float]
) -> None:
    plan = dataclasses.replace(plan_for(width, height, spp, tile), first_sample=3)
    seen = np.zeros((slot_count(width, height, plan.tile), spp + 4), int)
    for _, unit, _ in taken(plan, rates):
        assert unit.first_slot % plan.tile**2 == 0 and unit.slot_count % plan.tile**2 == 0, "whole tiles"
        assert unit.sample_count >= 1 and unit.slot_count >= 1
        seen[unit.first_slot : unit.first_slot + unit.slot_count, unit.first_sample :][:, : unit.sample_count] += 1
    assert (seen[:, 3 : 3 + spp] == 1).all() and seen.sum() == seen[:, 3 : 3 + spp].size


def test_units_refine_the_whole_image_and_stay_small() -> None:
    units = [unit for _, unit, _ in taken(Plan(8192, 8192, 0, 40, 64), [1e7])]
    assert [unit.first_sample for unit in units] == sorted(unit.first_sample for unit in units)
    assert max(52 * unit.slot_count for unit in units) <= 8 << 20, "bytes a unit's sums take"


@pytest.mark.parametrize("slow", [1e5, 1e4])
def test_a_slow_device_does_not_hold_up_a_fast_one(slow: float) -> None:
    """800 x 800 at 64 samples on a device of 10 M samples a second and a slow one: 4.1 seconds without the slow one."""
    plan = Plan(800, 800, 0, 64, 64)
    rates = [1e7, slow]
    done = taken(plan, rates)
    work = sum(unit.slot_count * unit.sample_count for _, unit, _ in done)
    ends = [max((end for worker, _, end in done if worker == each), default=0.0) for each in (0, 1)]
    # One tile of one sample is the least that anybody can be given
    assert max(ends) <= work / sum(rates) * 1.1 + 4096 / slow
    assert len(done) < 600, "and units do not become too small for what each costs"


SPEEDS: Final = [
    *([1.0, 1.0], [1.0, 0.1], [1.0, 0.02], [1.0, 0.01], [4.0, 1.0], [1.0, 0.5, 0.1], [1.0, 0.1, 0.01]),
    *([1.0, 1.0, 1.0, 1.0], [1.0, 0.3, 0.03, 0.01]),
]
"""Of two to four devices, as parts of one's speed."""


def share_of_the_sum(plan: Plan, rates: Sequence[float], cost: float) -> float:
    """How fast devices are together, as a part of the sum of their speeds."""
    done = taken(plan, rates, cost)
    work = sum(unit.slot_count * unit.sample_count for _, unit, _ in done)
    return work / sum(rates) / max(end for _, _, end in done)


@for_each("rate", [4.4e6, 1.37e6])
@for_each("speeds", SPEEDS)
def test_several_devices_are_as_fast_as_the_sum_of_their_speeds(rate: float, speeds: list[float]) -> None:
    """800 x 800 at 64 samples, by devices of a part of the speed that two cores have, and 2 ms beside each unit."""
    assert share_of_the_sum(Plan(800, 800, 0, 64, 64), [rate * speed for speed in speeds], 0.002) >= 0.95


@for_each(("rate", "spp"), [(4.4e7, 256), (5e8, 1024)])
@for_each("speeds", SPEEDS)
def test_several_fast_devices_are(rate: float, spp: int, speeds: list[float]) -> None:
    """1920 x 1080: a second and more of work, in which what each unit costs is not to show."""
    assert share_of_the_sum(Plan(1920, 1080, 0, spp, 64), [rate * speed for speed in speeds], 0.002) >= 0.95


@for_each("rate", [4.4e6, 5e8])
@for_each("speeds", SPEEDS)
def test_several_distant_devices_are(rate: float, speeds: list[float]) -> None:
    """50 ms beside each unit, as over a network, where there is work for a minute."""
    spp = int(60.0 * rate * sum(speeds) / (1920 * 1080))
    assert share_of_the_sum(Plan(1920, 1080, 0, spp, 64), [rate * speed for speed in speeds], 0.05) >= 0.9


@pytest.mark.parametrize(("size", "rate", "spp"), [((1920, 1080), 2e9, 4096), ((7680, 4320), 2e9, 1024)])
def test_the_faster_the_devices_the_more_samples_come_in_at_once(size: tuple[int, int], rate: float, spp: int) -> None:
    """The host merges pixels, so it is no limit where each comes with many samples; but the image is there early."""
    units = [unit for _, unit, _ in taken(Plan(*size, 0, spp, 64), [rate / 4.0] * 4, 0.002)]
    pixels = size[0] * size[1]
    first = next(number for number, unit in enumerate(units) if unit.first_sample >= 16)
    assert sum(unit.slot_count * unit.sample_count for unit in units[:first]) <= 32 * pixels, "all have 16 at first"
    merged = sum(unit.slot_count for unit in units)
    assert spp * pixels / merged >= 100.0


def test_a_slow_device_refines_the_image_by_few_samples() -> None:
    units = [unit for _, unit, _ in taken(Plan(1920, 1080, 0, 128, 64), [4e6])]
    assert max(unit.sample_count for unit in units) == 16


def test_where_memory_is_limited_units_are_small() -> None:
    plan = Plan(1920, 1080, 0, 64, 64, most_slots=3 * 4096 + 7)
    assert {unit.slot_count for _, unit, _ in taken(plan, [1e9, 1e9])} <= {4096, 8192, 12288}


def test_no_unit_is_longer_than_it_should_be_where_devices_share() -> None:
    done = taken(Plan(4096, 4096, 0, 64, 64), [3e7, 1e6])
    longest = max(unit.slot_count * unit.sample_count / (3e7, 1e6)[worker] for worker, unit, _ in done)
    assert longest <= 1.0


@for_each(("tile", "width", "height", "side"), [
    (64, 800, 600, 64), (1, 800, 600, 4), (6, 800, 600, 8), (64, 5, 3, 8), (64, 1, 1, 4), (65536, 100, 7, 100),
])  # fmt: skip
def test_side_of_a_tile(tile: int, width: int, height: int, side: int) -> None:
    assert tile_side(tile, width, height) == side


@pytest.mark.parametrize(("width", "height"), [(8192, 8192), (65536, 16), (16, 65536), (65536, 65536)])
def test_a_tile_never_takes_much_memory(width: int, height: int) -> None:
    """However large the tile that is asked for: a unit is at least one tile, and nothing of the image depends on it."""
    assert 52 * tile_side(65536, width, height) ** 2 <= 64 << 20


@pytest.mark.parametrize("tile", [4, 8, 20, 64])
def test_slots_of_a_tile_are_those_of_the_kernels(tile: int) -> None:
    order = tile_slots(tile)
    assert sorted(order.tolist()) == list(range(tile * tile))
    for place, slot in enumerate(order.tolist()):
        assert pixel_of(slot, tile, tile) == (place % tile, place // tile)
    assert BLOCK == 4


# --- doing it --------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("count", [1, 2, 3, 7])
@pytest.mark.parametrize(("width", "height", "spp", "tile"), SIZES)
def test_any_number_of_workers_gives_the_same_film(width: int, height: int, spp: int, tile: int, count: int) -> None:
    plan, before = plan_for(width, height, spp, tile), threading.active_count()
    workers = [FakeWorker(plan, f"fake {number}") for number in range(count)]
    film = Film(width, height)
    with cut_as(small_units):
        tally = go(plan, workers, film)
    assert_whole(plan, film)
    done = [unit for worker in workers for unit in worker.done]
    assert sorted(done, key=repr) == sorted(small_units(plan), key=repr), "each unit once"
    assert tally.complete and tally.failures == []
    assert (tally.samples, tally.rays) == (width * height * spp, 3 * width * height * spp)
    assert tally.deepest == max(unit.first_sample for unit in done) + 1
    assert [each.name for each in tally.workers] == [worker.name for worker in workers]
    assert sum(each.samples for each in tally.workers) == tally.samples
    assert [each.units for each in tally.workers] == [len(worker.done) for worker in workers]
    assert no_threads_left(before)


def test_the_units_of_the_plan_itself_do_as_well() -> None:
    plan = plan_for(37, 11, 20, 8)
    film = Film(37, 11)
    assert go(plan, [FakeWorker(plan)], film).complete
    assert_whole(plan, film)


@settings(max_examples=25, deadline=None)
@given(
    size=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    spp=st.integers(1, 5),
    tile=st.integers(1, 40),
    workers=st.integers(1, 4),
    seed=st.integers(0, 2**32 - 1),
)
def test_shuffled_units_merge_to_the_same_film(
    size: tuple[int, int], spp: int, tile: int, workers: int, seed: int
) -> None:
    plan = plan_for(*size, spp, tile)
    rng = np.random.default_rng(seed)

    def shuffled(plan: Plan) -> Iterator[Unit]:
        units = list(small_units(plan, int(rng.integers(1, spp + 1))))
        rng.shuffle(units)
        return iter(units)

    film = Film(*size)
    with cut_as(shuffled):
        go(plan, [FakeWorker(plan) for _ in range(workers)], film)
    assert_whole(plan, film)


def test_two_films_of_half_the_units_merge_to_the_whole() -> None:
    plan = plan_for(23, 14, 9, 8)
    units = list(small_units(plan))
    halves = []
    for start in (0, 1):
        film = Film(23, 14)
        with cut_as(lambda plan, start=start: iter(units[start::2])):  # type: ignore[misc]
            tally = go(plan, [FakeWorker(plan)], film)
        assert not tally.complete, "some samples of the plan are missing"
        halves.append(film)
    halves[0].merge(halves[1])
    assert_whole(plan, halves[0])


# --- workers that die ------------------------------------------------------------------------------------------------


def dies_at(number: int, error: Exception) -> Callable[[int, Unit], None]:
    def before(asked: int, unit: Unit) -> None:
        if asked >= number:
            raise error

    return before


@pytest.mark.parametrize("number", [1, 2, 5])
@pytest.mark.parametrize("error", [RenderError("out of resources"), DeviceError("cannot build")])
def test_units_of_a_dead_worker_are_done_by_the_others(number: int, error: Exception) -> None:
    plan, before = plan_for(30, 22, 6, 8), threading.active_count()
    together = threading.Barrier(2)

    def in_step(asked: int, unit: Unit) -> None:
        if asked <= number:
            with suppress(threading.BrokenBarrierError):
                together.wait(TIME_LIMITS)

    def badly(asked: int, unit: Unit) -> None:
        in_step(asked, unit)
        if asked == number:
            together.abort()
            raise error

    good, bad = FakeWorker(plan, "good", in_step), FakeWorker(plan, "bad", badly)
    film = Film(30, 22)
    with cut_as(lambda plan: small_units(plan, 1)):
        tally = go(plan, [bad, good], film)
    assert_whole(plan, film)
    assert tally.complete
    assert [str(each) for each in tally.failures] == [str(error)]
    assert [(each.name, each.requeued) for each in tally.workers] == [("bad", 1), ("good", 0)]
    assert len(bad.done) == number - 1
    assert no_threads_left(before)


def test_idle_workers_wait_for_units_that_may_come_back() -> None:
    """The last unit is held by one that dies late: by then the other has nothing to do, and must not have left."""
    plan = plan_for(8, 8, 1, 4)
    began, other_idle = threading.Event(), threading.Event()

    def dies_last(asked: int, unit: Unit) -> None:
        began.set()
        other_idle.wait(TIME_LIMITS)
        time.sleep(0.05)
        raise RenderError("at last")

    def does_the_rest(asked: int, unit: Unit) -> None:
        began.wait(TIME_LIMITS)
        if asked == 3:
            other_idle.set()

    bad, good = FakeWorker(plan, "bad", dies_last), FakeWorker(plan, "good", does_the_rest)
    film = Film(8, 8)
    with cut_as(lambda plan: small_units(plan, 1)):
        tally = go(plan, [bad, good], film)
    assert_whole(plan, film)
    assert tally.complete and [str(each) for each in tally.failures] == ["at last"]
    assert len(good.done) == 4


def test_when_all_are_dead_what_was_finished_is_in_the_film() -> None:
    plan, before = plan_for(30, 22, 6, 8), threading.active_count()
    workers = [FakeWorker(plan, f"{n}", dies_at(n + 3, RenderError(f"reason {n}"))) for n in (1, 2, 3)]
    film = Film(30, 22)
    with cut_as(small_units):
        tally = go(plan, workers, film)
    assert tally.all_failed and not tally.complete
    assert sorted(str(each) for each in tally.failures) == ["reason 1", "reason 2", "reason 3"]
    with pytest.raises(RenderError, match=r"^reason \d$"):
        tally.raise_failure()
    finished = [unit for worker in workers for unit in worker.done]
    assert film.samples == tally.samples == film.ledger.samples > 0 and len(finished) >= 3
    assert no_threads_left(before)


@pytest.mark.parametrize("error", [RenderError("no memory"), DeviceError("cannot build")])
def test_a_device_that_cannot_be_set_up_leaves_the_work_to_the_others(error: Exception) -> None:
    plan, film, before = plan_for(30, 22, 6, 8), Film(30, 22), threading.active_count()

    def broken() -> FakeWorker:
        raise error

    good = FakeWorker(plan, "good")
    tally = run(plan, [Candidate("bad", broken), Candidate("good", lambda: good)], film)
    assert_whole(plan, film)
    assert tally.complete and tally.failures == [error]
    assert [(each.name, each.requeued, each.units > 0) for each in tally.workers] == [
        ("bad", 0, False),
        ("good", 0, True),
    ]
    assert no_threads_left(before)
    alone = run(plan, [Candidate("bad", broken)], Film(30, 22))
    assert alone.all_failed and alone.samples == 0


def test_a_fault_of_the_program_is_not_taken_for_a_dead_device() -> None:
    plan, before = plan_for(30, 22, 6, 8), threading.active_count()
    workers = [FakeWorker(plan, "a", dies_at(2, ZeroDivisionError("a bug"))), FakeWorker(plan, "b")]
    with cut_as(small_units), pytest.raises(ZeroDivisionError, match="a bug"):
        go(plan, workers, Film(30, 22))
    assert no_threads_left(before)


@pytest.mark.parametrize("stops_after", [None, 2])
def test_progress_is_told_last_when_the_film_has_all_that_was_done(stops_after: int | None) -> None:
    plan = plan_for(16, 16, 8, 8)
    film = Film(16, 16)
    told: list[tuple[int, int, int]] = []
    with cut_as(lambda plan: small_units(plan, 4)):
        tally = go(
            plan,
            [FakeWorker(plan, "a")],
            film,
            lambda samples, rays: told.append((samples, rays, film.ledger.samples)),
            None if stops_after is None else lambda: len(told) >= stops_after,
        )
    assert tally.complete == (stops_after is None)
    assert told[-1] == (tally.samples, tally.rays, tally.samples)


def test_progress_never_counts_what_was_lost() -> None:
    plan = plan_for(16, 16, 8, 8)
    told: list[tuple[int, int]] = []
    tell = lambda samples, rays: told.append((samples, rays))  # noqa: E731
    bad, good = FakeWorker(plan, "bad", dies_at(3, RenderError("gone"))), FakeWorker(plan, "good")
    with cut_as(lambda plan: small_units(plan, 4)):
        tally = go(plan, [bad, good], Film(16, 16), tell)
    assert tally.complete
    assert told[-1] == (tally.samples, tally.rays) == (16 * 16 * 8, 3 * 16 * 16 * 8)
    assert max(told) == told[-1]


# --- stopping --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("after", [0, 1, 7, 60])
def test_stopped_in_the_middle_the_film_holds_what_is_reported(workers: int, after: int) -> None:
    plan, before = plan_for(21, 18, 40, 8), threading.active_count()
    slices = 0

    def tell(samples: int, rays: int) -> None:
        nonlocal slices
        slices += 1

    film = Film(21, 18)
    with cut_as(lambda plan: small_units(plan, 16)):
        tally = go(plan, [FakeWorker(plan) for _ in range(workers)], film, tell, lambda: slices >= after)
    assert not tally.complete
    assert film.samples == tally.samples < 21 * 18 * 40
    assert (tally.samples == 0) == (after == 0)
    # Whatever is there is right: in each pixel, the sums of as many of its first samples in each block as were done.
    counts = film.counts
    assert counts.max() <= 40
    for y, x in np.argwhere(counts == 40):
        np.testing.assert_array_equal(np.concatenate(film.bands())[y, x], expected_sums(plan)[y, x])
    assert no_threads_left(before)


def test_a_stop_that_comes_with_the_last_sample_is_no_interruption() -> None:
    plan = plan_for(8, 8, 4, 8)
    done = 0

    def tell(samples: int, rays: int) -> None:
        nonlocal done
        done = samples

    tally = go(plan, [FakeWorker(plan)], Film(8, 8), tell, lambda: done >= 8 * 8 * 4)
    assert tally.complete


@pytest.mark.parametrize("calls", [0, 3])
def test_an_exception_of_whoever_is_asked_to_stop_ends_all_threads(calls: int) -> None:
    plan, before = plan_for(30, 22, 400, 8), threading.active_count()
    asked = 0

    def stops() -> bool:
        nonlocal asked
        asked += 1
        if asked > calls:
            raise ZeroDivisionError("in the callback")
        return False

    with cut_as(small_units), pytest.raises(ZeroDivisionError, match="in the callback"):
        go(plan, [FakeWorker(plan) for _ in range(3)], Film(30, 22), None, stops)
    assert no_threads_left(before)


def test_an_exception_of_whoever_watches_ends_all_threads() -> None:
    plan, before = plan_for(30, 22, 400, 8), threading.active_count()

    def tell(samples: int, rays: int) -> None:
        raise KeyboardInterrupt

    with cut_as(small_units), pytest.raises(KeyboardInterrupt):
        go(plan, [FakeWorker(plan) for _ in range(3)], Film(30, 22), tell)
    assert no_threads_left(before)


# --- memory ----------------------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_workers_wait_for_a_film_that_is_slower_than_they(monkeypatch: pytest.MonkeyPatch) -> None:
    """Results that wait to be added take memory: a fast device must not pile up a whole image of them."""
    plan, before = plan_for(64, 64, 4, 4), threading.active_count()
    film = Film(64, 64)
    lock, waiting, most = threading.Lock(), 0, 0
    commit = film.commit

    def slow_commit(*arguments: Any) -> int:
        nonlocal waiting
        time.sleep(0.002)
        with lock:
            waiting -= 1
        return commit(*arguments)

    class Counted(FakeWorker):
        def render(self, unit: Unit, on_slice: OnSlice = None, should_stop: ShouldStop = None) -> UnitSums:
            nonlocal waiting, most
            result = super().render(unit, on_slice, should_stop)
            with lock:
                waiting += 1
                most = max(most, waiting)
            return result

    monkeypatch.setattr(film, "commit", slow_commit)
    with cut_as(lambda plan: small_units(plan, 2)):
        tally = go(plan, [Counted(plan), Counted(plan)], film)
    assert tally.complete
    assert len(list(small_units(plan, 2))) == 512
    assert most <= 16
    assert_whole(plan, film)
    assert no_threads_left(before)


def test_the_hash_of_the_image_does_not_depend_on_the_cut() -> None:
    hashes = set()
    for tile, workers in ((4, 1), (16, 2), (64, 3)):
        plan = plan_for(19, 33, 5, tile)
        film = Film(19, 33)
        go(plan, [FakeWorker(plan) for _ in range(workers)], film)
        hashes.add(image_sha256(film.mean()))
    assert len(hashes) == 1
