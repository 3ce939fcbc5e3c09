"""Spot checks: a small part of each unit is done again by another worker, and has to come out the same, bit by bit.

A part of every unit is better than some units whole: a device that spoils whole units is then found at the first of
them. What share of its results has to be wrong to be found with which probability is worked out in docs/devices.md.
"""

from __future__ import annotations

import hashlib
import math
import random
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.film.unit import BLOCK_SLOTS, Unit, UnitSums
from clrender.scheduling.policy import Plan

__all__ = ["SHARE", "Piece", "Sampler", "digest"]

SHARE: Final = 0.01
"""Of the samples, those that are done twice."""

_APART: Final = 100
"""Units from one check to the next where each of them needs something that is computed for all pixels of a sample."""


def digest(result: UnitSums | Piece) -> bytes:
    """What stands for a result: equal for equal bits."""
    squares = b"" if result.squares is None else result.squares.tobytes()
    return hashlib.sha256(result.sums.tobytes() + result.counts.tobytes() + squares).digest()


@dataclass(frozen=True, eq=False)
class Piece:
    """Some blocks of a unit, and what they came to.

    Attributes
    ----------
    unit : Unit
        Of these blocks alone; not of whole tiles.
    worker : int
        Who did it.
    samples : int
        Over the pixels of the image.
    sums, counts, squares : as of UnitSums
    """

    unit: Unit
    worker: int
    samples: int
    sums: npt.NDArray[np.uint32]
    counts: npt.NDArray[np.uint32]
    squares: npt.NDArray[np.uint32] | None = None

    @property
    def answer(self) -> bytes:
        """`digest` of what it came to."""
        return digest(self)

    def agrees(self, result: UnitSums) -> bool:
        """Whether another's result has the same bits."""
        return self.answer == digest(result)


def finished(unit: Unit, result: UnitSums) -> bool:
    """Whether every sample of a unit was taken."""
    return bool((result.done == unit.sample_count).all())


class Sampler:
    """Chooses what is done twice.

    Each block of a unit has the same chance. Of the first unit of each worker at least one block is checked, however
    small the unit; from then on the share holds.

    Parameters
    ----------
    plan : Plan
    share : float
        Of the samples.
    rng : random.Random, optional
    """

    def __init__(self, plan: Plan, share: float = SHARE, rng: random.Random | None = None) -> None:
        self._plan = plan
        self._share = share
        self._random = rng or random.Random()
        self._allowed: dict[int, float] = defaultdict(float)
        self._units: dict[int, int] = defaultdict(int)

    def piece(self, worker: int, unit: Unit, result: UnitSums, most: float = math.inf) -> Piece | None:
        """A part of what a worker has done, of `most` samples, or None where nothing is to be checked this time."""
        if not finished(unit, result) or self._share <= 0.0:
            return None
        pixels = unit.pixels(self._plan.width, self._plan.height)
        self._allowed[worker] += self._share * int(pixels.sum()) * unit.sample_count
        number = self._units[worker]
        self._units[worker] += 1
        if self._plan.sample_by_sample and number % _APART:
            return None
        blocks = int(min(self._allowed[worker], most) // (BLOCK_SLOTS * unit.sample_count))
        blocks = min(len(pixels), max(blocks, int(number == 0 and most > 0.0)))
        if blocks < 1 or not pixels.any():
            return None
        # The unit in runs of so many blocks, and one of these: near the edge of the image it may hold few pixels
        inside = sorted(set((np.flatnonzero(pixels) // blocks).tolist()))
        first = self._random.choice(inside) * blocks
        stop = min(first + blocks, len(pixels))
        samples = int(pixels[first:stop].sum()) * unit.sample_count
        self._allowed[worker] -= samples
        part, slots = slice(first * BLOCK_SLOTS, stop * BLOCK_SLOTS), (stop - first) * BLOCK_SLOTS
        again = replace(unit, first_slot=unit.first_slot + first * BLOCK_SLOTS, slot_count=slots)
        squares = None if result.squares is None else result.squares[part].copy()
        return Piece(again, worker, samples, result.sums[part].copy(), result.counts[part].copy(), squares)
