"""The alias table, which picks one of any number of lights with two reads."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["alias_table"]

_FLOOR = 1e-6


def alias_table(
    power: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint32]]:
    """Light probabilities proportional to power, and the alias table that samples them.

    The table is Vose's (1991): entry k is kept if a uniform number is below its threshold; otherwise its alias is
    taken. One sweep over running sums fills it, instead of two stacks (Hübschle-Schneider and Sanders 2019, section
    4); NumPy does this for millions of lights at once. A light entry fills up from the first heavy entry that is not
    exhausted; an exhausted heavy entry becomes light and fills up from the next one.

    Parameters
    ----------
    power : (L,) float64
        Above 0, finite; at least one entry.

    Returns
    -------
    probability, threshold, alias : (L,) float64, (L,) float64, (L,) uint32
        Probabilities sum to 1. Powers are clamped to at least a millionth of the mean, so that every light can be
        sampled.
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
    # A light entry takes from the first heavy one that earlier light entries did not overdraw. A heavy entry that is
    # exactly exhausted still counts, as below: it gives once more and becomes light itself.
    before = np.concatenate([[0.0], lacking[:-1]])
    giver = np.minimum(np.searchsorted(spare, before, side="left"), len(heavy) - 1)
    threshold[light] = share[light]
    alias[light] = heavy[giver]
    # The first light entry that takes more than is left exhausts a heavy entry; the last one ends exactly at 1.
    taker = np.searchsorted(lacking, spare[:-1], side="right")
    used_up = taker < len(light)
    threshold[heavy[:-1][used_up]] = 1.0 + spare[:-1][used_up] - lacking[taker[used_up]]
    alias[heavy[:-1][used_up]] = heavy[1:][used_up]
    return probability, np.clip(threshold, 0.0, 1.0), alias
