"""Standard errors and the stop by error, against Python's fractions: films with replicates, their files, the looks."""

from __future__ import annotations

import math
import threading
import tracemalloc
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import for_each
from hypothesis import given, settings
from hypothesis import strategies as st
from replicate_support import REQUEST, SIZE, Floats, film_of, same, samples_of, sums_of, words
from scipy import stats

from clrender.errors import RenderError, UsageError
from clrender.film import Film
from clrender.film.convergence import judge, level, looks
from clrender.film.fixed_point import add_words, subtract_words
from clrender.film.replicates import deviations, image_error, relative_error, replicate_counts, standard_error
from clrender.film.running import RunningFilm
from clrender.film.unit import Unit, UnitSums, slot_count, tile_side
from clrender.process.memory import ERROR_BYTES
from clrender.scheduling.policy import Plan, Remaining
from clrender.scheduling.run import run
from clrender.scheduling.tally import Tally
from clrender.scheduling.until_converged import run_until_converged
from clrender.scheduling.worker import Candidate
from clrender.settings import RenderSettings

# --- arithmetic ------------------------------------------------------------------------------------------------------

WIDE = st.integers(-(2**119), 2**119)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.one_of(WIDE, st.integers(-5, 5)), min_size=1, max_size=40), st.integers(0, 2**119))
def test_deviations_are_those_of_integers(values: list[int], offset: int) -> None:
    """Also of numbers that hardly differ and are large, where floating point would lose all digits."""
    values = [value // 2 + offset // 2 for value in values]
    total, squares, count = sum(values), sum(value**2 for value in values), len(values)
    if not -(2**127) <= total < 2**127 or squares >= 2**256:
        return
    exact = count * squares - total**2
    sums = np.array([[words(total % 2**128, 2)] * 3], np.uint64)
    found = deviations(sums, np.array([[words(squares, 4)] * 3], np.uint64), np.array([count]))
    assert found == pytest.approx(np.full((1, 3), float(Fraction(exact, 2**128))), rel=1e-14, abs=0.0)
    if len(set(values)) == 1:
        assert (found == 0.0).all()


def test_squares_that_cannot_be_are_refused() -> None:
    sums = np.array([[words(10 * 2**64, 2)] * 3], np.uint64)
    with pytest.raises(UsageError, match="smaller than their sums allow"):
        deviations(sums, np.zeros((1, 3, 4), np.uint64), np.array([4]))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(0, 2**256 - 1), min_size=2, max_size=2), st.sampled_from([2, 4]))
def test_words_are_added_and_subtracted(pair: list[int], count: int) -> None:
    a, b = (np.array([words(each % 2 ** (64 * count), count)], np.uint64) for each in pair)
    total = a.copy()
    add_words(total, b)
    assert total[0].tolist() == words(sum(pair) % 2 ** (64 * count), count)
    subtract_words(total, b)
    assert np.array_equal(total, a)


def test_standard_errors_are_those_of_replicates() -> None:
    values = samples_of(1, 30, 40)
    film = film_of(values, 6, 5, [8, 20, 40], REQUEST)
    replicates = values.reshape(10, SIZE, 30, 3).astype(np.float64).mean(axis=1)
    expected = replicates.std(axis=0, ddof=1) / math.sqrt(10)
    assert standard_error(film).reshape(30, 3) == pytest.approx(expected, rel=1e-12)
    assert (replicate_counts(film) == 10).all()
    whole = image_error(standard_error(film))
    assert whole == pytest.approx(np.sqrt((expected**2).sum(axis=0)) / 30, rel=1e-12)
    assert (image_error(standard_error(film), shares="block") >= whole).all()


def test_errors_of_pixels_in_step_are_no_smaller_than_that() -> None:
    """Where all pixels of a block have the same samples, the bound is what it is."""
    values = np.repeat(samples_of(2, 1, 40), 16, axis=1)
    film = film_of(values, 4, 4, [40], REQUEST)
    errors = standard_error(film)
    assert image_error(errors, shares="block") == pytest.approx(errors[0, 0], rel=1e-12)
    assert image_error(errors, shares="image") == pytest.approx(errors[0, 0], rel=1e-12)


def test_one_replicate_says_nothing_of_errors() -> None:
    film = film_of(samples_of(3, 16, SIZE), 4, 4, [SIZE], REQUEST)
    assert np.isnan(standard_error(film)).all()
    with pytest.raises(UsageError, match=r"no replicates.*--replicate-spp"):
        standard_error(Film(4, 4))


# --- in a word -------------------------------------------------------------------------------------------------------


def test_the_relative_error_is_that_of_the_pixels_looked_at() -> None:
    width, height = 21, 18
    film = film_of(samples_of(3, width * height, 3 * SIZE), width, height, [SIZE, 3 * SIZE], REQUEST)
    weights = np.array([0.2126, 0.7152, 0.0722])
    for most, step in ((width * height, 1), (100, 2), (42, 3), (1, 20)):
        errors, mean = standard_error(film)[::step, ::step], film.mean()[::step, ::step].astype(np.float64)
        wanted = (errors @ weights).sum() / (mean @ weights).sum()
        assert relative_error(film, most) == pytest.approx(wanted, rel=1e-6)


def test_the_relative_error_is_unknown_without_replicates_or_light() -> None:
    width, height = 9, 7
    values = samples_of(3, width * height, 3 * SIZE)
    assert relative_error(film_of(values, width, height, [SIZE], REQUEST)) is None  # one replicate
    assert relative_error(film_of(values * 0.0, width, height, [3 * SIZE], REQUEST)) is None
    assert relative_error(Film(width, height, {**REQUEST, "replicate_spp": None})) is None


# --- films -----------------------------------------------------------------------------------------------------------


def test_errors_take_no_more_memory_than_is_reckoned_with() -> None:
    """What they are computed with is of a few pixels at a time."""
    side = 512
    film = Film(side, side, REQUEST)
    unit = Unit(0, side * side, 0, 16 * SIZE, side)
    sums, squares = np.ones((side * side, 3, 4), np.uint32), np.full((side * side, 3, 8), 9, np.uint32)
    counts, done = np.full(side * side, 16 * SIZE, np.uint32), np.full(side * side // 16, 16 * SIZE, np.uint32)
    film.commit(unit, UnitSums(sums, counts, done, 0, 0, 0, squares))
    errors, peak = traced(lambda: standard_error(film))
    assert np.isfinite(errors).all() and (errors > 0.0).all()
    assert peak < errors.nbytes + 16 * side * side + (8 << 20)
    found, peak = traced(lambda: judge(film, asked(spp=1024)))
    assert found.errors.tobytes() == errors.tobytes() and peak < ERROR_BYTES * side * side


def traced(make: Callable[[], Any]) -> tuple[Any, int]:
    """What comes of it, and the most memory that NumPy and Python took for it, bytes."""
    tracemalloc.start()
    try:
        return make(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_any_cut_and_any_way_through_files_gives_the_same_film(tmp_path: Path) -> None:
    values = samples_of(4, 10 * 9, 24)
    whole = film_of(values, 10, 9, [24], REQUEST)
    assert same(whole, film_of(values, 10, 9, [4, 12, 20, 24], REQUEST))

    side, parts = tile_side(8, 10, 9), []
    for first in (0, 8, 16):
        part = Film(10, 9, REQUEST)
        for tile in (3, 0, 2, 1):
            unit = Unit(tile * side * side, side * side, first, 8, side)
            part.commit(unit, sums_of(unit, values, 10, 9))
        part.save(tmp_path / f"{first}.film")
        parts.append(Film.load(tmp_path / f"{first}.film"))
    merged = parts[2]
    merged.merge(parts[0])
    merged.merge(parts[1])
    assert same(merged, whole)
    merged.take_out(parts[0])
    merged.merge(parts[0])
    assert same(merged, whole)
    copy = RunningFilm(10, 9, REQUEST)
    merged.copy_to(copy)
    assert same(copy, whole)


def test_a_part_of_a_tile_comes_with_its_squares() -> None:
    values = samples_of(5, 64, 8)
    film = Film(8, 8, REQUEST)
    for first, slots in ((16, 32), (0, 16), (48, 16)):
        unit = Unit(first, slots, 0, 8, 8)
        film.commit(unit, sums_of(unit, values, 8, 8))
    assert same(film, film_of(values, 8, 8, [8], REQUEST))


def test_units_without_squares_or_with_parts_of_replicates_are_refused() -> None:
    values, film = samples_of(6, 16, 8), Film(4, 4, REQUEST)
    unit = Unit(0, 16, 0, 8, 4)
    good = sums_of(unit, values, 4, 4)
    with pytest.raises(RenderError, match="without the squares"):
        film.commit(unit, UnitSums(good.sums, good.counts, good.done, 0, 0, 0))
    with pytest.raises(RenderError, match="parts of replicates of 4"):
        film.commit(unit, UnitSums(good.sums, good.counts, good.done - 1, 0, 0, 0, good.squares))
    with pytest.raises(RenderError, match="parts of replicates of 4"):
        film.commit(Unit(0, 16, 2, 8, 4), good)
    assert film.samples == 0


@pytest.mark.parametrize("wrong", [0, "4", 4.0, True])
def test_a_file_whose_replicates_make_no_sense_is_refused(tmp_path: Path, wrong: object) -> None:
    film = film_of(samples_of(7, 16, 8), 4, 4, [8], REQUEST)
    film.request["replicate_spp"] = wrong
    film.save(tmp_path / "a.film")
    with pytest.raises(UsageError, match="not a whole clrender film"):
        Film.load(tmp_path / "a.film")


def test_a_file_with_parts_of_replicates_is_refused(tmp_path: Path) -> None:
    film = film_of(samples_of(7, 16, 8), 4, 4, [8], REQUEST)
    film.request["replicate_spp"] = 16
    film.save(tmp_path / "a.film")
    with pytest.raises(UsageError, match="parts of replicates"):
        Film.load(tmp_path / "a.film")


@for_each("size", [1, 4, 64])
@for_each("workers", [1, 3])
def test_no_unit_parts_a_replicate(size: int, workers: int) -> None:
    rng = np.random.default_rng(size + workers)
    remaining = Remaining(Plan(100, 60, 0, 192, 16, whole=size, short_units=True), workers)
    seen = np.zeros(192, np.int64)
    while (unit := remaining.take(worker := int(rng.integers(workers)))) is not None:
        assert unit.first_sample % size == unit.sample_count % size == 0
        seen[unit.first_sample : unit.first_sample + unit.sample_count] += unit.slot_count
        remaining.measured(worker, unit, float(rng.uniform(0.001, 3.0)))
    assert (seen == slot_count(100, 60, 16)).all()


# --- when it is enough -----------------------------------------------------------------------------------------------


def asked(**more: Any) -> RenderSettings:
    return RenderSettings(**{"width": 8, "height": 8, "error": 0.1, "spp": 4096, "replicate_spp": SIZE, **more})


def test_looks_are_planned() -> None:
    assert list(looks(asked(spp=1000))) == [64, 128, 256, 512, 1000]
    assert list(looks(asked(spp=512))) == [64, 128, 256, 512]
    assert list(looks(asked(spp=64))) == [64]
    assert level(asked(spp=64)) == level(asked(spp=4096)) == pytest.approx(0.05 / 15)
    assert level(asked(replicate_spp=16, confidence=0.9)) == pytest.approx(0.1 / 13)


def test_the_interval_is_students() -> None:
    values = samples_of(8, 64, 80)
    film = film_of(values, 8, 8, [80], REQUEST)
    found = judge(film, asked())
    replicates = values.reshape(20, SIZE, 64, 3).astype(np.float64).mean(axis=1)
    weights = np.array([0.2126, 0.7152, 0.0722])
    error = (replicates.std(axis=0, ddof=1) @ weights) / math.sqrt(20)
    luminance = values.astype(np.float64).mean(axis=0) @ weights
    scale = np.maximum(luminance, 0.1 * luminance.mean())
    square = np.pad(((error / scale) ** 2).reshape(8, 8), 1, mode="edge")
    around = [square[row : row + 3, column : column + 3].mean() for row in range(8) for column in range(8)]
    half = stats.t.ppf(1 - 0.05 / 15 / 2, 19) * np.maximum(error, np.sqrt(around) * scale)
    assert found.intervals.reshape(64) == pytest.approx(half, rel=1e-5)
    allowed = 0.1 * scale
    assert found.tolerances.reshape(64) == pytest.approx(allowed, rel=1e-5)
    assert np.array_equal(found.unconverged.reshape(64), half > allowed)
    floor = judge(film, asked(error_floor=50.0))
    assert floor.tolerances == pytest.approx(np.full((8, 8), 5.0))


def test_a_pixel_that_never_changed_waits_for_its_neighbours() -> None:
    """One pixel is noisy; around it nothing was found. Far from it, black is black."""
    values = np.ones((64, 64, 3), np.float32)
    values[::SIZE, 3 * 8 + 3] = 1.0 + 100.0 * np.arange(16)[:, None]
    found = judge(film_of(values, 8, 8, [64], REQUEST), asked())
    expected = np.zeros((8, 8), bool)
    expected[2:5, 2:5] = True
    assert np.array_equal(found.unconverged, expected)
    assert found.share == 1.0 - 9 / 64
    assert not found.reached
    assert judge(film_of(values, 8, 8, [64], REQUEST), asked(share=0.85)).reached


class Painter:
    """A worker whose samples are known; it stops, or fails, when it has done so many samples."""

    def __init__(self, values: Floats, width: int, height: int) -> None:
        self.values, self.width, self.height = values, width, height

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        return sums_of(unit, self.values, self.width, self.height)


class Liar(Painter):
    """One that is wrong, and each time otherwise."""

    def __init__(self, values: Floats, width: int, height: int, lied: threading.Event) -> None:
        super().__init__(values, width, height)
        self.lied = lied

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        self.values = self.values * np.float32(1.01)
        self.lied.set()
        return super().render(unit, on_slice, should_stop)


class Patient(Painter):
    """One that begins when the other has lied."""

    def __init__(self, values: Floats, width: int, height: int, lied: threading.Event) -> None:
        super().__init__(values, width, height)
        self.lied = lied

    def render(
        self, unit: Unit, on_slice: Callable[[int, int], None] | None, should_stop: Callable[[], bool] | None
    ) -> UnitSums:
        assert self.lied.wait(30.0)
        return super().render(unit, on_slice, should_stop)


@pytest.mark.parametrize("before", [0, 32])
def test_what_a_wrong_device_did_for_earlier_looks_is_done_again(before: int) -> None:
    """It is found at the second look alone. `before`: samples that were there when the render began."""
    values, lied = samples_of(12, 64, 256), threading.Event()
    film = film_of(values, 8, 8, [before] if before else [], REQUEST)
    wanted, shares = asked(spp=256, error=1e-6), iter([0.0])
    plan = Plan(8, 8, 0, wanted.spp, 4, whole=SIZE, short_units=True)
    candidates = [
        Candidate("liar", lambda: Liar(values, 8, 8, lied)),
        Candidate("honest", lambda: Patient(values, 8, 8, lied)),
    ]

    def take(part: Plan, able: list[Candidate], receiver: Film, on_progress: Callable[[int, int], None]) -> Tally:
        return run(part, able, receiver, on_progress, check_share=next(shares, 1.0))

    tally, _ = run_until_converged(plan, candidates, film, wanted, take)
    assert tally.complete and [each.state for each in tally.workers] == ["wrong", "ok"]
    assert same(film, film_of(values, 8, 8, [256], REQUEST))
    assert tally.workers[0].samples == 0 and tally.samples == 64 * (256 - before)


def stopped_at(values: Floats, film: Film, limit: int | None = None, **more: Any) -> int:
    """Samples at which a render of known samples stops; `limit`: it is interrupted after so many, over all pixels."""
    wanted = asked(**{"spp": 1024, **more})
    plan = Plan(8, 8, 0, wanted.spp, 8, whole=SIZE, short_units=True)
    candidates = [Candidate(f"painter {k}", lambda: Painter(values, 8, 8)) for k in range(2)]
    take = partial(run, should_stop=lambda: limit is not None and film.ledger.samples >= limit)
    tally, found = run_until_converged(plan, candidates, film, wanted, take)
    assert tally.complete is (limit is None)
    assert found.reached or limit is not None or film.ledger.holds(0, wanted.spp)
    return int(film.ledger.taken().max())


def test_a_render_stops_at_the_look_that_finds_enough() -> None:
    values = samples_of(9, 64, 1024) * 0.01 + 1.0
    film = Film(8, 8, REQUEST)
    stop = stopped_at(values, film, error=0.02)
    assert stop in (64, 128, 256, 512)
    assert film.ledger.holds(0, stop)
    assert same(film, film_of(values, 8, 8, [stop], REQUEST))
    for samples in looks(asked(spp=stop)):
        reached = judge(film_of(values, 8, 8, [samples], REQUEST), asked(error=0.02)).reached
        assert reached is (samples == stop)


def test_interruptions_change_no_stop() -> None:
    values = samples_of(10, 64, 1024) * 0.01 + 1.0
    whole = Film(8, 8, REQUEST)
    stop = stopped_at(values, whole, error=0.02)
    assert stop >= 128
    film = Film(8, 8, REQUEST)
    for limit in (100, 64 * 70, 64 * 100):
        stopped_at(values, film, limit, error=0.02)
    assert stopped_at(values, film, error=0.02) == stop
    assert same(film, whole)
    assert stopped_at(values, film, error=0.02) == stop  # and once more: nothing is to be done


def test_a_render_that_never_is_good_enough_takes_all_samples() -> None:
    values = samples_of(11, 64, 160)
    assert stopped_at(values, Film(8, 8, REQUEST), error=0.001, spp=160) == 160
