"""The alias table that picks one of many lights with two numbers read, however many there are."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["alias_table"]

_FLOOR = 1e-6


def alias_table(
    power: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint32]]:
    """Probabilities in proportion to power, and the table that draws from them.

    The table is Vose's (1991): entry k is kept when a uniform number is below its threshold, else its alias is taken.
    Instead of two stacks it is filled by one sweep over running sums (Hübschle-Schneider and Sanders 2019, section
    4), which numpy does for millions of lights at once: a light entry takes what it lacks from the first heavy entry
    that is not used up; a heavy entry used up becomes light and takes what it lacks from the next.

    Parameters
    ----------
    power : (L,) float64
        Above 0, finite; at least one entry.

    Returns
    -------
    probability, threshold, alias : (L,) float64, (L,) float64, (L,) uint32
        Probabilities add up to 1. No power counts for less than a millionth of the mean, so that nothing that shines
        is out of reach.
    """
    count = len(power)
    power = np.maximum(power, _FLOOR * (math.fsum(power) / count))
    probability = power / math.fsum(power)
    share = probability * count
    threshold = np.ones(count)
    alias = np.arange(count, dtype=np.uint32)
    light, heavy = np.flatnonzero(share < 1.0), np.flatnonzero(share >= 1.0)
    if len(light) == 0 or len(heavy) == 0:
        return probability, threshold, alias
    lacking = np.cumsum(1.0 - share[light])
    spare = np.cumsum(share[heavy] - 1.0)
    # A light entry meets the first heavy one that the light ones before it did not overdraw. One used up exactly
    # still counts, as it does below: it gives once more and becomes light itself.
    before = np.concatenate([[0.0], lacking[:-1]])
    giver = np.minimum(np.searchsorted(spare, before, side="left"), len(heavy) - 1)
    threshold[light] = share[light]
    alias[light] = heavy[giver]
    # A heavy entry is used up by the first light one that takes more than is left; the last one ends exactly at 1.
    taker = np.searchsorted(lacking, spare[:-1], side="right")
    used_up = taker < len(light)
    threshold[heavy[:-1][used_up]] = 1.0 + spare[:-1][used_up] - lacking[taker[used_up]]
    alias[heavy[:-1][used_up]] = heavy[1:][used_up]
    return probability, np.clip(threshold, 0.0, 1.0), alias
