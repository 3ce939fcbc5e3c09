"""The film adds exactly: against Python's integers and fractions, in any order, through files and merges."""

from __future__ import annotations

import itertools
import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clrender.errors import RenderError, UsageError
from clrender.film import Film
from clrender.film.fixed_point import fixed_point, to_float64
from clrender.film.ledger import UnitSet

Words = npt.NDArray[np.uint32]


def integer(words: npt.NDArray[Any]) -> int:
    """Python integer of one 128-bit two's complement number, whatever its word size."""
    bits = 8 * words.itemsize
    value = sum(int(word) << (bits * k) for k, word in enumerate(words.ravel()))
    return value - (value >> 127 << 128)


def expected(value: float) -> int:
    """Quanta of an accepted value: cut off towards zero."""
    return int(Fraction(value) * 2**64)


def add_values(film: Film, rows: npt.ArrayLike, columns: npt.ArrayLike, values: npt.NDArray[np.float32]) -> None:
    words, accepted = fixed_point(values)
    assert accepted.all()
    film.add(np.asarray(rows, np.int32), np.asarray(columns, np.int32), words, np.ones(len(values), np.uint32))


def wide_values(count: int, seed: int = 0) -> npt.NDArray[np.float32]:
    """Values of both signs between 1e-6 and 1e9 in magnitude."""
    rng = np.random.default_rng(seed)
    return (rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(-6, 9, count)).astype(np.float32)


def film_sum(film: Film, row: int, column: int, channel: int) -> int:
    band = film.bands()[row // film.band_rows]
    return integer(band[row % film.band_rows, column, channel])


# --- fixed point -----------------------------------------------------------------------------------------------------

EDGES = [0.0, -0.0, 1.0, -1.0, 2.0**-64, -(2.0**-64), 2.0**-65, 1.5 * 2.0**-64, -1.5 * 2.0**-64, 1e-45, 2.0**-126]
EDGES += [float(np.nextafter(np.float32(2.0**43), np.float32(0))), -(2.0**42.5), 2.0**-41 * 1.9999999, 1e-6, 1e9]


@pytest.mark.parametrize("value", EDGES)
def test_fixed_point_of_an_edge(value: float) -> None:
    words, accepted = fixed_point(np.float32(value))
    assert accepted
    assert integer(words) == expected(float(np.float32(value)))


@given(st.floats(width=32, allow_nan=True, allow_infinity=True))
def test_fixed_point_of_any_value(value: float) -> None:
    words, accepted = fixed_point(np.float32(value))
    inside = np.isfinite(value) and abs(value) < 2.0**43
    assert bool(accepted) == bool(inside)
    assert integer(words) == (expected(value) if inside else 0)


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 2.0**43, -(2.0**43), 3e38])
def test_values_out_of_range_are_not_accepted(value: float) -> None:
    words, accepted = fixed_point(np.array([[value, 1.0]], np.float32))
    assert accepted.tolist() == [[False, True]]
    assert not words[0, 0].any()


@given(st.integers(-(2**127), 2**127 - 1))
def test_sums_become_the_nearest_float64(total: int) -> None:
    unsigned = total % 2**128
    words = np.array([[unsigned % 2**64, unsigned >> 64]], np.uint64)
    assert to_float64(words)[0] == float(Fraction(total, 2**64))


@pytest.mark.parametrize("shift", range(73))
@pytest.mark.parametrize("tail", [0, 1, -1])
def test_ties_round_to_even_at_every_position(shift: int, tail: int) -> None:
    for significand in (2**53 + 1, 2**53 + 3, 2**54 - 1):  # the last bit is the half
        total = max((significand << shift) + tail, 0)
        words = np.array([[total % 2**64, total >> 64]], np.uint64)
        assert to_float64(words)[0] == float(Fraction(total, 2**64))


# --- adding ----------------------------------------------------------------------------------------------------------


def test_a_million_additions_in_any_order_give_the_exact_sum() -> None:
    values = wide_values(1_000_000)
    exact = sum(map(expected, values.astype(float).tolist()))
    # One pixel of three channels, a million units: by way of 1000 pixels of 1000 samples, then one by one.
    words, _ = fixed_point(values)
    order = np.random.default_rng(1).permutation(len(values))
    results = []
    for arrangement in (words, words[order]):
        film = Film(1000, 1)
        columns, rows = np.arange(1000), np.zeros(1000, np.int32)
        for unit in arrangement.reshape(1000, 1000, 4):
            film.add(rows, columns, np.repeat(unit[:, None], 3, axis=1), np.ones(1000, np.uint32))
        assert film.samples == 1_000_000
        results.append(sum(film_sum(film, 0, column, 1) for column in range(1000)))
    assert results == [exact, exact]


def test_every_grouping_gives_the_same_bits() -> None:
    values = wide_values(12 * 600).reshape(600, 4, 3)  # 600 samples of a 2 x 2 image
    words, _ = fixed_point(values)
    whole = words.astype(object)
    rng = np.random.default_rng(2)
    pictures = []
    for _ in range(5):
        film = Film(2, 2)
        for sample in rng.permutation(600):
            chosen = rng.permutation(4)[: rng.integers(1, 5)]
            for part in (chosen, np.setdiff1d(np.arange(4), chosen)):
                film.add(part // 2, part % 2, words[sample, part], np.ones(len(part), np.uint32))
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
    monkeypatch.setattr("clrender.film._CHUNK", 5)
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
        exact = Fraction(sum(expected(float(v)) for v in values[:, column, channel]), 2**64)
        assert value == np.float32(float(exact) / 300)


def test_an_empty_film_is_black() -> None:
    assert not Film(3, 2).mean().any()


def test_pixels_without_a_sample_are_black_beside_others() -> None:
    film = Film(2, 1)
    add_values(film, [0], [1], np.ones((1, 3), np.float32))
    np.testing.assert_array_equal(film.mean(), [[[0, 0, 0], [1, 1, 1]]])


@pytest.mark.parametrize(
    ("rows", "columns"), [([0, 0], [1, 1]), ([2, 0], [0, 0]), ([0, -1], [0, 0]), ([0, 0], [0, 3]), ([0, 0], [0])]
)
def test_bad_pixels_are_refused_and_change_nothing(rows: list[int], columns: list[int]) -> None:
    film = Film(3, 2)
    with pytest.raises(RenderError):
        film.add(np.array(rows), np.array(columns), np.ones((2, 3, 4), np.uint32), np.ones(2, np.uint32))
    assert not film.samples and not film.mean().any()


def test_a_film_says_when_its_range_is_spent() -> None:
    film = Film(1, 1)
    words = np.zeros((1, 3, 4), np.uint32)
    words[..., 3] = 1 << 29  # 2^125 quanta of 2^19 samples
    film.add(np.zeros(1, np.int32), np.zeros(1, np.int32), words, np.array([1 << 19], np.uint32))
    with pytest.raises(RenderError, match="range of a film"):
        film.add(np.zeros(1, np.int32), np.zeros(1, np.int32), words, np.array([1 << 19], np.uint32))


def test_a_film_counts_no_more_samples_than_it_can() -> None:
    film = Film(1, 1)
    add = (np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros((1, 3, 4), np.uint32))
    film.add(*add, np.array([0xFFFFFFFF], np.uint32))
    with pytest.raises(RenderError, match="4294967295"):
        film.add(*add, np.array([1], np.uint32))


def test_sizes_must_be_positive() -> None:
    with pytest.raises(UsageError):
        Film(0, 5)


# --- files and merging -----------------------------------------------------------------------------------------------


def some_film(seed: int = 0, units: range = range(4)) -> Film:
    film = Film(5, 4, {"seed": 7, "scene_sha256": "ab"}, {"tile": 2})
    rows, columns = (axis.ravel() for axis in np.mgrid[0:4, 0:5])
    for unit in units:
        add_values(film, rows, columns, wide_values(60, 100 * seed + unit).reshape(20, 3))
        film.units.add(unit)
    return film


def assert_equal(first: Film, second: Film) -> None:
    for band, other in zip(first.bands(), second.bands(), strict=True):
        np.testing.assert_array_equal(band, other)
    np.testing.assert_array_equal(first.counts, second.counts)
    assert (first.units, first.request) == (second.units, second.request)


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


def test_merged_parts_are_the_whole() -> None:
    whole, first, second = some_film(units=range(6)), some_film(units=range(2)), some_film(units=range(2, 6))
    second.merge(first)
    assert_equal(whole, second)
    assert list(second.units.ranges()) == [(0, 6)]


def test_overlapping_units_are_refused() -> None:
    film, before = some_film(units=range(3)), some_film(units=range(3))
    with pytest.raises(UsageError, match="units 2 to 2 are in both"):
        film.merge(some_film(units=range(2, 5)))
    assert_equal(film, before)


@pytest.mark.parametrize("change", ["request", "size", "cut"])
def test_films_of_other_requests_are_refused(change: str) -> None:
    film = some_film(units=range(2))
    other = Film(
        6 if change == "size" else 5,
        4,
        {"seed": 8 if change == "request" else 7, "scene_sha256": "ab"},
        {"tile": 4 if change == "cut" else 2},
    )
    with pytest.raises(UsageError, match={"request": "seed 7 and 8", "size": "6 x 4", "cut": "tile"}[change]):
        film.merge(other)
    assert_equal(film, some_film(units=range(2)))


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
    some_film().save(good)
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
        "units": data.replace(b"[[0, 4]]", b"[[4, 0]]"),
    }
    for name, content in contents.items():
        (folder / f"{name}.film").write_bytes(content)
    np.savez_compressed(folder / "packed.npz", header=np.zeros(3), counts=np.zeros(3), sums=np.zeros(3))
    (folder / "packed.npz").rename(folder / "packed.film")
    return [folder / f"{name}.film" for name in (*contents, "packed", "missing")] + [folder]


def test_damaged_films_are_refused_in_one_sentence(tmp_path: Path) -> None:
    for path in damaged_films(tmp_path):
        with pytest.raises(UsageError) as caught:
            Film.load(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value), path


# --- the ledger ------------------------------------------------------------------------------------------------------


@given(st.lists(st.tuples(st.integers(0, 60), st.integers(1, 9)), max_size=30))
def test_the_ledger_is_a_set(pairs: list[tuple[int, int]]) -> None:
    ledger, reference = UnitSet(), set[int]()
    for start, length in pairs:
        units = set(range(start, start + length))
        if units & reference:
            with pytest.raises(UsageError):
                ledger.add(start, start + length)
        else:
            ledger.add(start, start + length)
            reference |= units
    assert {unit for start, stop in ledger.ranges() for unit in range(start, stop)} == reference
    assert len(ledger) == len(reference)
    assert all((unit in ledger) == (unit in reference) for unit in range(-1, 71))
    ranges = list(ledger.ranges())
    assert all(stop < start for (_, stop), (start, _) in itertools.pairwise(ranges))
    assert UnitSet.from_json(json.loads(json.dumps(ledger.to_json()))) == ledger
