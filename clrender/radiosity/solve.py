"""Solvers of the radiosity equations: gathering, and shooting the largest unshot power first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clrender.radiosity.factors import FormFactors

__all__ = ["Balance", "Progress", "gather", "shoot"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Balance:
    """The terms of the radiosity equations.

    Attributes
    ----------
    factors : FormFactors
    reflectance : (r, 3) float64
        Reflectance of each row's side, divided by its uncovered fraction.
    direct : (r, 3) float64
        Reflected direct light from shadow rays, by row.
    sent : (columns, 3) float64
        Emitted radiance that form factors carry; the last is the environment's.
    areas : (columns,) float64
        Area of each side.
    """

    factors: FormFactors
    reflectance: _Floats
    direct: _Floats
    sent: _Floats
    areas: _Floats

    def first(self) -> _Floats:
        """(r, 3): radiance reflected once."""
        return self.direct + self.reflectance * self.factors.gathered(self.sent)

    def power(self, radiance: _Floats) -> float:
        """Power of a radiance by row: the sum over area and channels, in arbitrary units."""
        return float((np.abs(radiance).sum(axis=1) * self.areas[self.factors.sides]).sum())

    def spread(self, radiance: _Floats) -> _Floats:
        """Radiance by row as radiance by column."""
        wide = np.zeros((self.factors.columns, 3))
        wide[self.factors.sides] = radiance
        return wide


@dataclass(frozen=True)
class Progress:
    """The state of an iteration.

    Attributes
    ----------
    steps : int
    reflected : (r, 3) float64
        Radiance, by row, so far.
    unshot : (r, 3) float64
        Part of it that has not been shot.
    ambient : (3,) float64
        Estimated missing irradiance / π of every side.
    """

    steps: int
    reflected: _Floats
    unshot: _Floats
    ambient: _Floats


def gather(balance: Balance, tolerance: float = 1e-5, most: int = 2000) -> Progress:
    """Jacobi iteration: every side gathers from all others, until the unshot power is small.

    Parameters
    ----------
    balance : Balance
    tolerance : float
        Fraction of the power that may remain unshot.
    most : int
        Largest number of steps.
    """
    unshot = balance.first()
    reflected, steps = unshot.copy(), 0
    while steps < most and balance.power(unshot) > tolerance * balance.power(reflected):
        unshot = balance.reflectance * balance.factors.gathered(balance.spread(unshot))
        reflected += unshot
        steps += 1
    return Progress(steps, reflected, unshot, np.zeros(3))


def shoot(
    balance: Balance,
    tolerance: float = 1e-5,
    most: int = 100_000,
    on_step: Callable[[Progress], None] | None = None,
) -> Progress:
    """Progressive refinement (Cohen, Chen, Wallace & Greenberg 1988): the sides with most unshot power shoot first.

    A step shoots from all sides with at least half of the largest unshot power. The matrix is that of `gather`, so
    both end at the same solution.

    Parameters
    ----------
    balance, tolerance, most
        As for `gather`.
    on_step : callable, optional
        Called after each step; `Progress.ambient` makes an early solution presentable.
    """
    factors = balance.factors
    areas = balance.areas[factors.sides]
    row_of = np.full(factors.columns, -1)
    row_of[factors.sides] = np.arange(len(factors.sides))
    order = np.argsort(factors.column, kind="stable")
    start = np.searchsorted(factors.column[order], np.arange(factors.columns + 1))
    unshot = balance.first()
    reflected, steps = unshot.copy(), 0
    while steps < most and balance.power(unshot) > tolerance * balance.power(reflected):
        power = np.abs(unshot).sum(axis=1) * areas
        shooters = np.flatnonzero(power >= 0.5 * power.max())
        entries = np.concatenate([order[start[side] : start[side + 1]] for side in factors.sides[shooters]])
        rows, amounts = factors.row[entries], factors.value[entries]
        from_rows = row_of[factors.column[entries]]
        arriving = [np.bincount(rows, amounts * channel[from_rows], len(areas)) for channel in unshot.T]
        gained = balance.reflectance * np.stack(arriving, axis=1)
        unshot[shooters] = 0.0
        unshot += gained
        reflected += gained
        steps += 1
        if on_step is not None:
            on_step(Progress(steps, reflected.copy(), unshot.copy(), _ambient(balance, unshot)))
    return Progress(steps, reflected, unshot, _ambient(balance, unshot))


def _ambient(balance: Balance, unshot: _Floats) -> _Floats:
    """Unshot power distributed uniformly and reflected infinitely often (Cohen et al. 1988, eq. 11-13)."""
    areas = balance.areas[balance.factors.sides][:, None]
    total = areas.sum()
    mean = (balance.reflectance * areas).sum(axis=0) / total
    ambient: _Floats = (unshot * areas).sum(axis=0) / total / np.maximum(1.0 - mean, 1e-6)
    return ambient
