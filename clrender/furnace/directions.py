"""Directions for material tests: directions of incidence, and grids that resolve narrow lobes.

All are unit vectors in the surface's frame, (…, 3) float64, z along its normal, rounded to single precision as the
kernels receive them.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["NARROWEST", "Floats", "around", "incident", "jittered", "mirrored", "polar", "refracted"]

Floats = npt.NDArray[np.float64]

NARROWEST: Final = 1e-6
"""Angle in radians; single precision does not resolve much smaller ones."""


def incident(degrees: float, below: bool = False, turn: float = 0.1) -> Floats:
    """Direction at an angle from the normal, above or below the surface, rotated around it by a part of a circle."""
    tilt, angle = math.radians(degrees), 2.0 * math.pi * turn
    z = -math.cos(tilt) if below else math.cos(tilt)
    return _single(np.array([math.sin(tilt) * math.cos(angle), math.sin(tilt) * math.sin(angle), z]))


def mirrored(wo: Floats) -> Floats:
    """The direction of specular reflection."""
    return np.asarray(wo * np.array([-1.0, -1.0, 1.0]), np.float64)


def refracted(wo: Floats, eta: float) -> Floats:
    """The direction of refraction; under total internal reflection, along the surface on its other side.

    Parameters
    ----------
    wo : (3,) float64
    eta : float
        Index beyond the surface, relative to the index on the side of `wo`.
    """
    flat = -wo[:2] / eta
    sine = float(np.hypot(*flat))
    if sine >= 1.0:
        flat = flat / sine * math.sqrt(1.0 - 1e-8)
    return np.array([*flat, -math.copysign(math.sqrt(max(1.0 - float(flat @ flat), 1e-8)), wo[2])])


def around(pole: Floats, angle: Floats, turn: Floats) -> Floats:
    """Directions at a polar angle from `pole` and an azimuth around it, both in radians."""
    x, y = _across(pole)
    sine, toward = np.sin(angle), np.cos(angle)
    along, across = sine * np.cos(turn), sine * np.sin(turn)
    directions = np.empty((*sine.shape, 3))
    for k in range(3):
        directions[..., k] = _single(toward * pole[k] + along * x[k] + across * y[k])
    return directions


def polar(pole: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Inverse of `around`: polar angle from `pole`, and azimuth in 0 … 2π."""
    x, y = _across(pole)
    u, v, w = directions @ x, directions @ y, directions @ pole
    return np.arctan2(np.hypot(u, v), w), np.mod(np.arctan2(v, u), 2.0 * math.pi)


def jittered(rng: np.random.Generator, copies: int, side: int) -> Floats:
    """(2, copies, side²) numbers in [0, 1): stratified within each copy by a square grid, the copies independent."""
    column, row = np.meshgrid(np.arange(side), np.arange(side))
    corners = np.stack([column.ravel(), row.ravel()])[:, None, :]
    numbers: Floats = (corners + rng.random((2, copies, side * side))) / side
    return numbers


def _across(pole: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors perpendicular to `pole` and each other, the first in the plane of `pole` and the normal."""
    x = np.array([pole[0] * pole[2], pole[1] * pole[2], -(pole[0] ** 2 + pole[1] ** 2)])
    long = float(np.linalg.norm(x))
    x = x / long if long > 1e-9 else np.array([1.0, 0.0, 0.0])
    return x, np.cross(pole, x)


def _single(directions: Floats) -> Floats:
    return directions.astype(np.float32).astype(np.float64)
