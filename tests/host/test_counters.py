"""Random numbers from counters, and the elementary functions beside them: published answers, and exactness."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chisquare

from clrender.exact.angles import exponential_of, logarithm_of, power_of_two
from clrender.exact.counters import Draws, key_of, philox, units
from clrender.exact.elementary import logarithm

KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
"""Counter, key and words of Philox4x32-10, from `kat_vectors` of Random123."""


@pytest.mark.parametrize(("counter", "key", "words"), KNOWN)
def test_published_words(
    counter: tuple[int, int, int, int], key: tuple[int, int], words: tuple[int, int, int, int]
) -> None:
    assert tuple(philox(key[0] | key[1] << 32, counter).tolist()) == words


def test_arrays_are_many_counters() -> None:
    many = philox(7, (np.arange(5), 2, 3, 4))
    assert many.shape == (4, 5)
    for n in range(5):
        assert many[:, n].tolist() == philox(7, (n, 2, 3, 4)).tolist()


def test_units_are_uniform() -> None:
    a, b = units(philox(key_of(1, "test"), (np.arange(1 << 16), 0, 0, 0)))
    for each in (a, b):
        assert each.min() >= 0.0 and each.max() < 1.0
        assert chisquare(np.histogram(each, 64, (0.0, 1.0))[0]).pvalue > 1e-6
        assert (each * 2.0**53 % 1.0 == 0.0).all()
    assert abs(np.corrcoef(a, b)[0, 1]) < 5.0 / 256.0


def test_draws_depend_on_name_and_index_only() -> None:
    first = Draws(3, "camera", 5)
    values = [first.unit() for _ in range(4)]
    assert len(set(values)) == 4
    again = Draws(3, "camera", 5)
    assert [again.unit() for _ in range(4)] == values
    for other in (
        Draws(4, "camera", 5),
        Draws(3, "lights", 5),
        Draws(3, "camera", 6),
        Draws(3, "camera", 5 + (1 << 32)),
    ):
        assert other.unit() != values[0]


def test_whole_numbers_below() -> None:
    draws = Draws(1, "dice", 0)
    counts = np.bincount([draws.below(6) for _ in range(3000)], minlength=6)
    assert len(counts) == 6 and chisquare(counts).pvalue > 1e-6
    assert {draws.below(1) for _ in range(3)} == {0}
    # More than half of all words would be above the largest multiple
    big = [draws.below((1 << 63) - 1) for _ in range(64)]
    assert max(big) > 1 << 61 and len(set(big)) == 64


def test_logarithms() -> None:
    random = np.random.default_rng(1)
    x = np.exp(random.uniform(-300.0, 300.0, 4000))
    x = np.concatenate([x, 1.0 + np.ldexp(random.uniform(-1.0, 1.0, 4000), random.integers(-50, -1, 4000))])
    exact = np.array([math.log(each) for each in x.tolist()])
    assert (np.abs(logarithm(x) - exact) <= 6e-16 * np.abs(exact)).all()
    assert logarithm(np.array([1.0])).tolist() == [0.0]


def test_functions_of_single_numbers() -> None:
    for x in (-3.75, -1.0, 0.0, 0.3, 1.0, 20.25):
        assert power_of_two(x) == pytest.approx(2.0**x, rel=3e-16)
        assert exponential_of(x) == pytest.approx(math.exp(x), rel=3e-16)
    assert power_of_two(3.0) == 8.0 and power_of_two(-2.0) == 0.25
    assert logarithm_of(10.0) == math.log(10.0)
