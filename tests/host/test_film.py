"""The film adds exactly: against Python's integers and fractions, in any order, through files and merges."""

from __future__ import annotations

import gc
import itertools
import json
import threading
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from cases import for_each
from exact_sums import fixed_point, quanta
from hypothesis import given, settings
from hypothesis import strategies as st

from clrender.errors import RenderError, UsageError
from clrender.film import Film
from clrender.film.fixed_point import to_float64
from clrender.film.ledger import Ledger
from clrender.film.merge import merge_films
from clrender.film.unit import Unit, UnitSums, slot_count, tile_side, tile_slots
from clrender.process.huge_pages import LARGE_BYTES

Words = npt.NDArray[np.uint32]


def integer(words: npt.NDArray[Any]) -> int:
    """Python integer of one 128-bit two's complement number, whatever its word size."""
    bits = 8 * words.itemsize
    value = sum(int(word) << (bits * k) for k, word in enumerate(words.ravel()))
    return value - (value >> 127 << 128)


def unit_of(film: Film, sample: int) -> Unit:
    """One sample of every pixel of a small film, as one tile."""
    side = tile_side(1024, film.width, film.height)
    return Unit(0, side * side, sample, 1, side)


def add_words(
    film: Film, rows: npt.ArrayLike, columns: npt.ArrayLike, words: Words, counts: npt.ArrayLike = 1, sample: int = -1
) -> int:
    """Commit (n, 3, 4) sums of some pixels as the film's next sample, or a given one; other pixels' is rejected."""
    held = film.ledger.ranges(0, 0)
    unit = unit_of(film, sample if sample >= 0 else held[-1][1] if held else 0)
    slots = tile_slots(unit.tile).reshape(unit.tile, unit.tile)[np.asarray(rows, int), np.asarray(columns, int)]
    sums, counted = np.zeros((unit.slot_count, 3, 4), np.uint32), np.zeros(unit.slot_count, np.uint32)
    sums[slots], counted[slots] = words, np.asarray(counts, np.uint32)
    return film.commit(unit, UnitSums(sums, counted, np.ones(unit.slot_count // 16, np.uint32), 0, 0, 0))


def add_values(
    film: Film, rows: npt.ArrayLike, columns: npt.ArrayLike, values: npt.NDArray[np.float32], sample: int = -1
) -> None:
    add_words(film, rows, columns, fixed_point(values), 1, sample)


def wide_values(count: int, seed: int = 0) -> npt.NDArray[np.float32]:
    """Values of both signs between 1e-6 and 1e9 in magnitude."""
    rng = np.random.default_rng(seed)
    return (rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(-6, 9, count)).astype(np.float32)


def film_sum(film: Film, row: int, column: int, channel: int) -> int:
    band = film.bands()[row // film.band_rows]
    return integer(band[row % film.band_rows, column, channel])


# --- fixed point -----------------------------------------------------------------------------------------------------


@given(st.integers(-(2**127), 2**127 - 1))
def test_sums_become_the_nearest_float64(total: int) -> None:
    unsigned = total % 2**128
    words = np.array([[unsigned % 2**64, unsigned >> 64]], np.uint64)
    assert to_float64(words)[0] == float(Fraction(total, 2**64))


@for_each("shift", range(73))
@for_each("tail", [0, 1, -1])
def test_ties_round_to_even_at_every_position(shift: int, tail: int) -> None:
    for significand in (2**53 + 1, 2**53 + 3, 2**54 - 1):  # the last bit is the half
        total = max((significand << shift) + tail, 0)
        words = np.array([[total % 2**64, total >> 64]], np.uint64)
        assert to_float64(words)[0] == float(Fraction(total, 2**64))


# --- adding ----------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_many_additions_in_any_order_give_the_exact_sum() -> None:
    values = wide_values(250_000)
    exact = sum(map(quanta, values.astype(float).tolist()))
    # One pixel of three channels, 250,000 units: by way of 500 pixels of 500 samples, then one by one.
    words = fixed_point(values)
    order = np.random.default_rng(1).permutation(len(values))
    results = []
    for arrangement in (words, words[order]):
        film = Film(500, 1)
        columns, rows = np.arange(500), np.zeros(500, np.int32)
        for unit in arrangement.reshape(500, 500, 4):
            add_words(film, rows, columns, np.repeat(unit[:, None], 3, axis=1))
        assert film.samples == 250_000
        results.append(sum(film_sum(film, 0, column, 1) for column in range(500)))
    assert results == [exact, exact]


@pytest.mark.long
def test_every_grouping_gives_the_same_bits() -> None:
    values = wide_values(12 * 600).reshape(600, 4, 3)  # 600 samples of a 2 x 2 image
    words = fixed_point(values)
    whole = words.astype(object)
    rng = np.random.default_rng(2)
    pictures = []
    for _ in range(5):
        film = Film(2, 2)
        for sample in rng.permutation(600):
            chosen = rng.permutation(4)[: rng.integers(1, 5)]
            for part in (chosen, np.setdiff1d(np.arange(4), chosen)):
                add_words(film, part // 2, part % 2, words[sample, part])
        pictures.append(film.mean())
        for pixel in range(4):
            for channel in range(3):
                total = sum(integer(w.astype(np.uint32)) for w in whole[:, pixel, channel])
                assert film_sum(film, pixel // 2, pixel % 2, channel) == total
    assert len({picture.tobytes() for picture in pictures}) == 1
    means = values.astype(object).sum(axis=0) / 600  # rough; exactness is tested above
    np.testing.assert_allclose(pictures[0].reshape(4, 3), means.astype(float), rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("shuffled", [False, True])
def test_pixels_land_where_they_belong_across_bands(shuffled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.film.film._BAND_BYTES", 48 * 7 * 3)
    monkeypatch.setattr("clrender.film.film._CHUNK", 5)
    film = Film(7, 10)
    assert len(film.bands()) == 4
    rows, columns = (axis.ravel() for axis in np.mgrid[1:9, 2:6])
    order = np.random.default_rng(3).permutation(len(rows)) if shuffled else np.arange(len(rows))
    rows, columns = rows[order], columns[order]
    values = np.stack([rows, columns, -rows * columns / 8], axis=1).astype(np.float32)
    for _ in range(3):
        add_values(film, rows, columns, values)
    picture = np.zeros((10, 7, 3), np.float32)
    picture[rows, columns] = values
    np.testing.assert_array_equal(film.mean(), picture)
    assert film.counts[1:9, 2:6].min() == 3 and film.samples == 3 * 32
    np.testing.assert_array_equal(film.develop(), picture)
    assert film.developed and film.samples == 3 * 32


def test_the_mean_is_the_rounded_exact_mean() -> None:
    values = wide_values(300 * 21).reshape(300, 7, 3)
    film = Film(7, 1)
    for sample in values:
        add_values(film, np.zeros(7), np.arange(7), sample)
    for (_, column, channel), value in np.ndenumerate(film.mean()):
        exact = Fraction(sum(quanta(float(v)) for v in values[:, column, channel]), 2**64)
        assert value == np.float32(float(exact) / 300)


def test_an_empty_film_is_black() -> None:
    assert not Film(3, 2).mean().any()


def test_pixels_without_a_sample_are_black_beside_others() -> None:
    film = Film(2, 1)
    add_values(film, [0], [1], np.ones((1, 3), np.float32))
    np.testing.assert_array_equal(film.mean(), [[[0, 0, 0], [1, 1, 1]]])


@pytest.mark.parametrize("fault", ["sums", "counts", "blocks", "too many samples"])
def test_sums_of_another_unit_are_refused_and_change_nothing(fault: str) -> None:
    film = Film(3, 2)
    unit = unit_of(film, 0)
    slots = unit.slot_count
    result = UnitSums(
        np.ones((slots + (fault == "sums"), 3, 4), np.uint32),
        np.ones(slots + (fault == "counts"), np.uint32),
        np.full(slots // 16 + (fault == "blocks"), 1 + (fault == "too many samples"), np.uint32),
        0,
        0,
        0,
    )
    with pytest.raises(RenderError):
        film.commit(unit, result)
    assert not film.samples and not film.mean().any() and film.ledger.samples == 0


def test_a_film_says_when_its_range_is_spent() -> None:
    film = Film(1, 1)
    words = np.zeros((1, 3, 4), np.uint32)
    words[..., 3] = 1 << 29  # 2^125 quanta of 2^19 samples
    add_words(film, [0], [0], words, 1 << 19)
    with pytest.raises(RenderError, match="range of a film"):
        add_words(film, [0], [0], words, 1 << 19)


def test_a_film_counts_no_more_samples_than_it_can() -> None:
    film = Film(1, 1)
    words = np.zeros((1, 3, 4), np.uint32)
    add_words(film, [0], [0], words, 0xFFFFFFFF)
    with pytest.raises(RenderError, match="4294967295"):
        add_words(film, [0], [0], words, 1)


def test_sizes_must_be_positive() -> None:
    with pytest.raises(UsageError):
        Film(0, 5)


# --- the ledger ------------------------------------------------------------------------------------------------------


@settings(max_examples=200)
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5), st.integers(0, 12), st.integers(1, 5)), max_size=25))
def test_the_ledger_is_a_set_of_samples_for_each_block(steps: list[tuple[int, int, int, int]]) -> None:
    """Against Python's sets, one for each of the six blocks of an image of 11 x 7 pixels."""
    ledger, reference = Ledger(11, 7), [set[int]() for _ in range(6)]
    for first, last, start, count in steps:
        blocks = np.arange(min(first, last), max(first, last) + 1)
        wanted = set(range(start, start + count))
        if any(wanted & reference[block] for block in blocks):
            with pytest.raises(UsageError, match="counts once"):
                ledger.add(blocks, start, np.full(len(blocks), count))
        else:
            ledger.add(blocks, start, np.full(len(blocks), count))
            for block in blocks:
                reference[block] |= wanted
    pixels = [16, 16, 12, 12, 12, 9]
    assert ledger.samples == sum(n * len(held) for n, held in zip(pixels, reference, strict=True))
    for number, held in enumerate(reference):
        ranges = ledger.ranges(4 * (number // 3), 4 * (number % 3))
        assert {n for start, stop in ranges for n in range(start, stop)} == held
        assert all(stop < start for (_, stop), (start, _) in itertools.pairwise(ranges))
    table, numbers = ledger.to_file()
    assert Ledger.from_file(11, 7, json.loads(json.dumps(table)), numbers.copy()) == ledger


def test_the_ledger_forgets_the_sets_that_no_block_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.film.ledger._MOST_SETS", 4)
    ledger = Ledger(400, 4)
    for sample in range(50):
        for block in np.random.default_rng(sample).permutation(100):
            ledger.add(np.array([block]), sample, np.array([1]))
    assert ledger.holds(0, 50) and len(ledger.to_file()[0]["sets"]) == 1


def test_the_ledger_does_not_know_how_the_work_was_cut() -> None:
    ledgers = []
    for tile, depth in ((4, 3), (8, 1), (20, 5)):
        film = Film(19, 10)
        slots = slot_count(19, 10, tile)
        for sample in range(0, 15, depth):
            for first in range(0, slots, tile * tile):
                unit = Unit(first, tile * tile, sample, depth, tile)
                zeros = np.zeros((tile * tile, 3, 4), np.uint32), np.zeros(tile * tile, np.uint32)
                film.commit(unit, UnitSums(*zeros, np.full(tile * tile // 16, depth, np.uint32), 0, 0, 0))
        ledgers.append(film.ledger)
    assert ledgers[0] == ledgers[1] == ledgers[2] and ledgers[0].holds(0, 15)


def test_a_unit_stopped_half_way_is_recorded_as_what_it_is() -> None:
    film, unit = Film(8, 4), Unit(0, 64, 4, 3, 8)
    sums, counts = np.zeros((64, 3, 4), np.uint32), np.zeros(64, np.uint32)
    sums[:16], counts[:16] = 5, 2
    stopped = UnitSums(sums, counts, np.array([2, 0, 0, 0], np.uint32), 0, 0, 0)
    assert film.commit(unit, stopped) == 32
    assert film.ledger.ranges(0, 0) == ((4, 6),) and film.ledger.ranges(0, 4) == ()
    before = film.mean()
    with pytest.raises(UsageError, match="samples 4 to 5 of some pixels are held already"):
        film.commit(unit, stopped)
    assert film.samples == 32 and (film.mean() == before).all()
    assert (
        film.commit(Unit(0, 64, 6, 1, 8), UnitSums(sums, counts // 2, np.array([1, 0, 0, 0], np.uint32), 0, 0, 0)) == 16
    )
    assert film.ledger.ranges(3, 3) == ((4, 7),)


# --- watching --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("most", [1, 3, 5, 8, 100])
def test_a_snapshot_is_every_nth_pixel(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clrender.film.film._BAND_BYTES", 48 * 13 * 4)
    film = Film(13, 11)
    rows, columns = (axis.ravel() for axis in np.mgrid[0:11, 0:13])
    add_values(film, rows, columns, wide_values(3 * len(rows)).reshape(-1, 3))
    step = -(-13 // most) if most < 13 else 1
    np.testing.assert_array_equal(film.snapshot(most), film.mean()[::step, ::step])


def test_snapshots_and_commits_from_many_threads_agree() -> None:
    """Each pixel's sum is 3 times its count: a snapshot in between would show another mean."""
    film = Film(40, 40)
    rows, columns = (axis.ravel() for axis in np.mgrid[0:40, 0:40])
    words = fixed_point(np.full((1600, 3), 3.0, np.float32))
    faults: list[str] = []

    def watch() -> None:
        while film.ledger.samples < 1600 * 40:
            seen = np.unique(film.snapshot(16))
            if not set(seen.tolist()) <= {0.0, 3.0}:
                faults.append(f"{seen}")

    watchers = [threading.Thread(target=watch) for _ in range(2)]
    makers = [
        threading.Thread(target=lambda part=part: [add_words(film, rows, columns, words, 1, n) for n in part])
        for part in (range(20), range(20, 40))
    ]
    for thread in (*watchers, *makers):
        thread.start()
    for thread in (*watchers, *makers):
        thread.join(30.0)
    assert not faults and film.ledger.holds(0, 40) and (film.mean() == 3.0).all()


# --- files and merging -----------------------------------------------------------------------------------------------


def some_film(salt: int = 0, units: range = range(4), **request: Any) -> Film:
    film = Film(5, 4, {"seed": 7, "scene_sha256": "ab", **request})
    rows, columns = (axis.ravel() for axis in np.mgrid[0:4, 0:5])
    for unit in units:
        add_values(film, rows, columns, wide_values(60, 100 * salt + unit).reshape(20, 3), unit)
    return film


def assert_equal(first: Film, second: Film) -> None:
    for band, other in zip(first.bands(), second.bands(), strict=True):
        np.testing.assert_array_equal(band, other)
    np.testing.assert_array_equal(first.counts, second.counts)
    assert (first.ledger, first.request) == (second.ledger, second.request)


def test_a_film_survives_its_file(tmp_path: Path) -> None:
    film = some_film()
    film.save(tmp_path / "a.film", {"spp": 4, "title": "čaj"})
    loaded = Film.load(tmp_path / "a.film")
    assert_equal(film, loaded)
    assert loaded.provenance == {"spp": 4, "title": "čaj"}
    loaded.save(tmp_path / "b.film")
    assert (tmp_path / "a.film").read_bytes() == (tmp_path / "b.film").read_bytes()


def test_numpy_reads_a_film_file(tmp_path: Path) -> None:
    film = some_film()
    film.save(tmp_path / "a.film")
    with np.load(tmp_path / "a.film") as archive:
        assert archive["sums"].shape == (4, 5, 3, 2)
        np.testing.assert_array_equal(archive["counts"], film.counts)
        assert json.loads(archive["header"].tobytes())["format"] == "clrender film 1"


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_merged_parts_are_the_whole(order: tuple[int, ...]) -> None:
    parts = [some_film(units=range(2)), some_film(units=range(2, 5)), some_film(units=range(5, 6))]
    merged = Film(5, 4, parts[0].request)
    for number in order:
        merged.merge(parts[number])
    assert_equal(some_film(units=range(6)), merged)
    assert merged.ledger.holds(0, 6)


def test_overlapping_films_are_refused_by_name() -> None:
    film, before = some_film(units=range(3)), some_film(units=range(3))
    for other in (some_film(units=range(2, 5)), some_film(units=range(3)), film):
        with pytest.raises(UsageError, match=r"a\.film and b\.film (overlap: samples|are the same)"):
            film.merge(other, "a.film", "b.film")
    assert_equal(film, before)


@pytest.mark.parametrize("change", ["seed", "kernel_sha256", "size"])
def test_films_of_other_requests_are_refused_by_name(change: str) -> None:
    film = some_film(units=range(2))
    other = Film(6, 4, film.request) if change == "size" else some_film(units=range(2, 3), **{change: 8})
    with pytest.raises(UsageError, match=rf"a\.film .*b\.film .*({change} .* and 8|6 x 4)"):
        film.merge(other, "a.film", "b.film")
    assert_equal(film, some_film(units=range(2)))


@for_each("paths", ["a.film", Path("a.film"), b"a.film", 3])
def test_films_to_merge_are_a_list(paths: Any) -> None:
    with pytest.raises(UsageError, match=r"paths is .*, but must be a list of film files"):
        merge_films(paths)


def test_a_developed_film_has_no_sums_left(tmp_path: Path) -> None:
    film = some_film()
    film.develop()
    with pytest.raises(RenderError, match="developed"):
        film.save(tmp_path / "a.film")
    with pytest.raises(RenderError, match="developed"):
        film.mean()
    with pytest.raises(RenderError, match="developed"):
        add_values(film, [0], [0], np.ones((1, 3), np.float32))
    assert list(tmp_path.iterdir()) == []


def damaged_films(folder: Path) -> list[Path]:
    """Files that are no whole film, each in its way."""
    good = folder / "good.film"
    film = some_film()
    film.save(good)
    data = good.read_bytes()
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 1
    contents = {
        "empty": b"",
        "text": b"not a film\n",
        "short": data[: len(data) // 2],
        "tail": data[:-1],
        "flipped": bytes(flipped),
        "header": data.replace(b'"width": 5', b'"width": 9'),
        "negative": data.replace(b'"width": 5', b'"width":-5'),
        "format": data.replace(b"clrender film 1", b"clrender film 7"),
        "ledger": data.replace(b"[[[0, 4]]]", b"[[[4, 0]]]"),
    }
    for name, content in contents.items():
        assert content != data
        (folder / f"{name}.film").write_bytes(content)
    np.savez_compressed(folder / "packed.npz", header=np.zeros(3), counts=np.zeros(3), sums=np.zeros(3))
    (folder / "packed.npz").rename(folder / "packed.film")
    film.counts[1, 1] += 1
    film.save(folder / "forged.film")
    return [folder / f"{name}.film" for name in (*contents, "packed", "forged", "missing")] + [folder]


def test_damaged_films_are_refused_in_one_sentence(tmp_path: Path) -> None:
    for path in damaged_films(tmp_path):
        with pytest.raises(UsageError) as caught:
            Film.load(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value), path


@pytest.mark.skipif(not Path("/sys/kernel/mm/transparent_hugepage").exists(), reason="this system has no large pages")
def test_a_film_that_is_gone_leaves_no_preference_for_large_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small blocks that take its place would each occupy one."""
    calls: list[tuple[str, int, int]] = []
    for name in ("prefer_large_pages", "withdraw_preference"):
        monkeypatch.setattr(f"clrender.film.film.{name}", lambda *block, name=name: calls.append((name, *block)))
    film = Film(600, 400, {})
    (preferred,) = calls
    assert preferred[0] == "prefer_large_pages" and preferred[2] >= LARGE_BYTES
    del film
    gc.collect()
    assert calls[1:] == [("withdraw_preference", *preferred[1:])]
