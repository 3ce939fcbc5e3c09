"""The absorption that makes a render's deepest path as deep as wanted."""

from __future__ import annotations

import math

__all__ = ["absorption_for", "expected_deepest", "survival_for"]


def survival_for(deepest: int, paths: int) -> float:
    """Probability to go on from a hit that makes a deepest path of `deepest` scattering events likeliest.

    Going on with probability s from each hit, a path scatters k times or more, its last by a shadow ray, with
    probability s^(k-1), and the deepest of n paths is k with about exp(-n s^k) - exp(-n s^(k-1)): one maximum, searched
    by golden sections.

    Parameters
    ----------
    deepest : int
        At least 2.
    paths : int
    """

    def chance(s: float) -> float:
        return math.exp(-paths * s**deepest) - math.exp(-paths * s ** (deepest - 1))

    golden = (math.sqrt(5.0) - 1.0) / 2.0
    centre = float(paths) ** (-1.0 / (deepest - 0.5))  # where n s^(k - 1/2) = 1, near the maximum
    low, high = centre / 4.0, min(1.0, centre * 4.0)
    for _ in range(80):
        a, b = high - golden * (high - low), low + golden * (high - low)
        if chance(a) < chance(b):
            low = a
        else:
            high = b
    return float(low + high) / 2.0


def absorption_for(deepest: int, paths: int, goes_on: float) -> float:
    """The roulette's absorption, when of the paths it spares a share `goes_on` does not end otherwise (on a light)."""
    return min(max(1.0 - survival_for(deepest, paths) / goes_on, 0.0), 0.999)


def expected_deepest(survival: float, paths: int) -> float:
    """About the median of the deepest of so many paths, in scattering events."""
    return math.log(paths / math.log(2.0)) / -math.log(survival)
