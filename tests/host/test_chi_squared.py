"""Pearson's test, held against SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats
from cases import for_each

from clrender.statistics.chi_squared import goodness_of_fit, survival


@for_each("freedom", [1, 2, 3, 10, 100, 719, 5000])
def test_the_distribution_is_that_of_scipy(freedom: int) -> None:
    for share in (1e-3, 0.1, 0.5, 0.9, 0.99, 1.0, 1.01, 1.1, 1.5, 2.0, 10.0):
        x = share * freedom
        exact = float(scipy.stats.chi2.sf(x, freedom))
        assert survival(x, freedom) == pytest.approx(exact, rel=1e-9, abs=1e-290)


def test_the_ends_of_the_distribution() -> None:
    assert survival(0.0, 5) == survival(-1.0, 5) == 1.0
    assert survival(math.inf, 5) == survival(1e9, 5) == 0.0
    assert survival(1e-300, 1) == pytest.approx(1.0)


def test_counts_are_tested_as_scipy_tests_them() -> None:
    rng = np.random.default_rng(600)
    chances = 0.1 + rng.random(40)
    chances /= chances.sum()
    counts = rng.multinomial(10_000, chances)
    fit, exact = goodness_of_fit(counts, chances), scipy.stats.chisquare(counts, chances * counts.sum())
    assert fit.freedom == 39
    assert (fit.statistic, fit.p) == pytest.approx((exact.statistic, exact.pvalue), rel=1e-9)


def test_cells_with_few_events_are_united() -> None:
    chances = np.array([0.5, 0.4995, 2e-4, 2e-4, 1e-4])
    fit = goodness_of_fit([500, 499, 1, 0, 0], chances)
    assert fit.freedom == 1  # 0.2 + 0.2 + 0.1 events are too few even together, and take the smaller of the others in
    assert fit.p > 0.5
    assert goodness_of_fit([0, 0, 0, 0, 1000], chances).p < 1e-100
    assert goodness_of_fit([1000], [1.0]).freedom == 0 and goodness_of_fit([1000], [1.0]).p == 1.0


def test_probabilities_that_do_not_add_up_to_one_fail() -> None:
    even = np.full(64, 1.0 / 64.0)
    counts = np.full(64, 2000)
    assert goodness_of_fit(counts, even).p == 1.0
    assert goodness_of_fit(counts, 1.05 * even).p < 1e-10
    assert goodness_of_fit(counts, 0.95 * even).p < 1e-10
