"""Spot checks: another worker renders a small part of each unit again, and the results must be bit-identical.

Checking a part of every unit is better than checking some whole units: a device that corrupts whole units is then
detected at the first of them. docs/devices.md derives the probability of detection from the fraction of wrong results.
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
"""Fraction of the samples that are rendered twice."""

_APART: Final = 100
"""Units between two checks if each check needs something that is computed for all pixels of a sample."""


def digest(result: UnitSums | Piece) -> bytes:
    """Hash of a result: equal for bit-identical results."""
    squares = b"" if result.squares is None else result.squares.tobytes()
    return hashlib.sha256(result.sums.tobytes() + result.counts.tobytes() + squares).digest()


@dataclass(frozen=True, eq=False)
class Piece:
    """Some blocks of a unit, and their result.

    Attributes
    ----------
    unit : Unit
        A unit of these blocks only; it need not hold whole tiles.
    worker : int
        The worker that rendered it.
    samples : int
        Number of samples, over the pixels of the image.
    sums, counts, squares : see UnitSums
    """

    unit: Unit
    worker: int
    samples: int
    sums: npt.NDArray[np.uint32]
    counts: npt.NDArray[np.uint32]
    squares: npt.NDArray[np.uint32] | None = None

    @property
    def answer(self) -> bytes:
        """`digest` of the result."""
        return digest(self)

    def agrees(self, result: UnitSums) -> bool:
        """Whether another worker's result is bit-identical."""
        return self.answer == digest(result)


def finished(unit: Unit, result: UnitSums) -> bool:
    """Whether every sample of a unit was taken."""
    return bool((result.done == unit.sample_count).all())


class Sampler:
    """Chooses the pieces that are rendered twice.

    Each block of a unit has the same probability. At least one block of each worker's first unit is checked, however
    small the unit; after that, the share holds.

    Parameters
    ----------
    plan : Plan
    share : float
        Fraction of the samples that are checked.
    rng : random.Random, optional
    """

    def __init__(self, plan: Plan, share: float = SHARE, rng: random.Random | None = None) -> None:
        self._plan = plan
        self._share = share
        self._random = rng or random.Random()
        self._allowed: dict[int, float] = defaultdict(float)
        self._units: dict[int, int] = defaultdict(int)

    def piece(self, worker: int, unit: Unit, result: UnitSums, most: float = math.inf) -> Piece | None:
        """A part of a worker's unit with at most `most` samples; None if nothing is to be checked this time."""
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
        # Divide the unit into runs of this many blocks and choose one: near the image's edge it may hold few pixels
        inside = sorted(set((np.flatnonzero(pixels) // blocks).tolist()))
        first = self._random.choice(inside) * blocks
        stop = min(first + blocks, len(pixels))
        samples = int(pixels[first:stop].sum()) * unit.sample_count
        self._allowed[worker] -= samples
        part, slots = slice(first * BLOCK_SLOTS, stop * BLOCK_SLOTS), (stop - first) * BLOCK_SLOTS
        again = replace(unit, first_slot=unit.first_slot + first * BLOCK_SLOTS, slot_count=slots)
        squares = None if result.squares is None else result.squares[part].copy()
        return Piece(again, worker, samples, result.sums[part].copy(), result.counts[part].copy(), squares)
