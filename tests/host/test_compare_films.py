"""The test of two films: how often it finds what is not there, what it finds, and what it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from replicate_support import Floats, film_of

from clrender.agreement import compare_films
from clrender.cli import main
from clrender.errors import UsageError
from clrender.film import Film

SIDE, COUNT = 8, 24


def film(values: Floats, seed: int, **more: Any) -> Film:
    """Of samples that are replicates each."""
    side = round(values.shape[1] ** 0.5)
    request = {"replicate_spp": 1, "seed": seed, "integrator": "path", **more}
    return film_of(values, side, side, [len(values)], request)


def samples(rng: np.random.Generator, count: int = COUNT) -> Floats:
    """Radiance of mean 1 whose distribution has a tail; channels of a sample go together."""
    grey = rng.gamma(2.0, 0.5, (count, SIDE * SIDE, 1))
    return (grey * rng.uniform(0.9, 1.1, (count, SIDE * SIDE, 3))).astype(np.float32)


@pytest.mark.long
def test_it_seldom_finds_what_is_not_there() -> None:
    """Level 1 %: of 150 pairs more than 7 by chance in one of 5000 runs."""
    rng = np.random.default_rng(1)
    found = [compare_films(film(samples(rng), 0), film(samples(rng), 1)) for _ in range(150)]
    assert sum(not each["agree"] for each in found) <= 7
    errors = np.array([each["mean_difference"] for each in found]) / np.array([each["mean_error"] for each in found])
    assert float(errors.std()) == pytest.approx(1.0, abs=0.2)


def test_it_finds_a_pixel_and_a_shift_of_the_mean() -> None:
    rng = np.random.default_rng(2)
    first, second = samples(rng), samples(rng)
    second[:, 5 * SIDE + 3] *= 12.0
    numbers = compare_films(film(first, 0), film(second, 1))
    assert not numbers["agree"] and numbers["differing_pixels"] == 1 and numbers["first_differing"] == [3, 5]
    moved = compare_films(film(first, 0), film(samples(rng) * np.float32(1.2), 1))
    assert not moved["agree"] and moved["mean_differs"] and moved["differing_pixels"] == 0
    assert moved["mean_difference"] == pytest.approx([-0.2] * 3, abs=0.08)


def test_certain_pixels_may_differ_by_rounding_only() -> None:
    flat = np.full((4, SIDE * SIDE, 3), 0.7, np.float32)
    near = film(flat * np.float32(1.0 + 3e-7), 1)
    assert not np.array_equal(near.mean(), film(flat, 0).mean())
    assert compare_films(film(flat, 0), near)["agree"]
    off = compare_films(film(flat, 0), film(flat * np.float32(1.0001), 1))
    assert off["differing_pixels"] == SIDE * SIDE and off["mean_differs"]


def test_light_that_one_film_has_not_found_yet_is_no_difference() -> None:
    """A dark pixel that seems certain, among neighbours of which it is known that light is rare."""
    rng = np.random.default_rng(3)

    def rare() -> Floats:
        hit = rng.uniform(size=(COUNT, SIDE * SIDE, 1)) < 0.08
        return np.where(hit, 12.0, 0.1).repeat(3, axis=2).astype(np.float32)

    found = [compare_films(film(rare(), 0), film(rare(), 1)) for _ in range(20)]
    assert all(each["differing_pixels"] == 0 for each in found)


@pytest.mark.parametrize(
    ("second", "problem"),
    [
        ({"replicate_spp": None}, "b: has no replicates.*--replicate-spp"),
        ({"seed": 0, "filter": "gaussian"}, "a and b have the same seed.*another --seed"),
        ({"seed": 0}, "a and b have the same seed"),
        ({"integrator": "unknown"}, "b: does not record its integrator"),
    ],
    ids=str,
)
def test_what_cannot_be_tested_is_refused(second: dict[str, Any], problem: str) -> None:
    values = samples(np.random.default_rng(4), 4)
    other = film(values, 1)
    other.request |= second
    other.replicate_spp = other.request["replicate_spp"]
    with pytest.raises(UsageError, match=problem):
        compare_films(film(values, 0), other, ("a", "b"))


def test_other_sizes_and_too_few_replicates_are_refused() -> None:
    values = samples(np.random.default_rng(4), 4)
    with pytest.raises(UsageError, match="8 x 8 pixels and b 4 x 4"):
        compare_films(film(values, 0), film(values[:, :16], 1), ("a", "b"))
    with pytest.raises(UsageError, match="b: has pixels with fewer than two"):
        compare_films(film(values, 0), film(values[:1], 1), ("a", "b"))


def test_parts_of_one_render_are_independent() -> None:
    """Shards hold other samples of one seed."""
    rng = np.random.default_rng(6)
    values = samples(rng, 2 * COUNT)
    whole, half = film(values, 0), film(values[:COUNT], 0)
    rest = Film(SIDE, SIDE, whole.request)
    whole.copy_to(rest)
    rest.take_out(half)
    assert compare_films(half, rest)["pixels"] == SIDE * SIDE


def test_the_command_says_what_it_found(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    names = [str(tmp_path / f"{name}.film") for name in "abcd"]
    bright = samples(rng)
    bright[:, 9] += 9.0
    film(samples(rng), 0).save(names[0])
    film(samples(rng), 1).save(names[1])
    film(bright, 2).save(names[2])
    plain = film(samples(rng), 3)
    plain.request["replicate_spp"], plain.replicate_spp, plain._squares = None, None, []
    plain.save(names[3])

    def said(a: int, b: int) -> str:
        done = CliRunner().invoke(main, ["compare", names[a], names[b]])
        assert done.exit_code == 0
        return next(line for line in done.output.splitlines() if line.startswith("z-test"))

    assert "agree: no pixel of 64 differs" in said(0, 1)
    assert "differ, at the level 0.01: 1 of 64 pixels (most significant: column 1, row 1)" in said(0, 2)
    assert f"none: {names[3]}: has no replicates" in said(0, 3)
