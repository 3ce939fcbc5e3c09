"""The termination probability for which a render's deepest path has a desired depth."""

from __future__ import annotations

import math

__all__ = ["expected_deepest", "survival_for", "termination_for"]


def survival_for(deepest: int, paths: int) -> float:
    """Survival probability at a hit for which a deepest path of `deepest` scattering events is most probable.

    With survival probability s at each hit, a path has at least k scattering events, the last one by a shadow ray, with
    probability s^(k-1), and the deepest of n paths has k with probability about exp(-n s^k) - exp(-n s^(k-1)). Its one
    maximum is found by golden-section search.

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


def termination_for(deepest: int, paths: int, goes_on: float) -> float:
    """The roulette's probability, when a fraction `goes_on` of the paths it spares does not end on a light."""
    return min(max(1.0 - survival_for(deepest, paths) / goes_on, 0.0), 0.999)


def expected_deepest(survival: float, paths: int) -> float:
    """Approximate median of the deepest of this many paths, in scattering events."""
    return math.log(paths / math.log(2.0)) / -math.log(survival)
