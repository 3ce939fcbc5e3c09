"""Lens distortion as camera calibration measures it: directions to places on the film, and back.

Places on the film are in units of the focal length, from the principal point, x to the right and y down.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from clrender.exact.elementary import angles_of, sines_cosines

__all__ = ["BrownConrady", "KannalaBrandt", "LensModel"]

_Floats = npt.NDArray[np.float64]

_HALVINGS: Final = 8
_NEWTON_STEPS: Final = 12
_PLANE_STEPS: Final = 8
_TOLERANCE: Final = 1e-11
"""Of a place that was found, relative to its distance from the principal point, plus 1."""
_WITHIN: Final = 0.98
_SPARE: Final = 1.1
"""Factor of bounds, for what is not radial."""
_FARTHEST: Final = 1e6
"""Bound of the radius where distortion increases it everywhere: 89.99994 degrees from the axis."""


class LensModel(Protocol):
    """A model of distortion."""

    @property
    def limit(self) -> float:
        """End of the field around the axis in which no two directions share a place on the film."""

    def bound(self, distance: float) -> float:
        """Bound of the radius without distortion, or of the angle from the axis, of places up to a distance."""

    def places(self, directions: _Floats) -> _Floats:
        """Places of directions.

        Parameters
        ----------
        directions : (..., 3) float64
            In the camera's frame: x right, y down, z forward; of any length.

        Returns
        -------
        (..., 2) float64
            NaN outside of the field.
        """

    def directions(self, places: _Floats) -> _Floats:
        """The inverse.

        Parameters
        ----------
        places : (..., 2) float64

        Returns
        -------
        (..., 3) float64
            Unit vectors; NaN where no direction of the field has this place.
        """


@dataclass(frozen=True)
class BrownConrady:
    """Radial distortion by a rational function of the radius, and decentering (Brown 1971; OpenCV's ``calib`` module).

    With x, y the place without distortion, r its distance from the principal point and q = r², the place is
    x R + 2 p1 x y + p2 (q + 2 x²), y R + p1 (q + 2 y²) + 2 p2 x y, with
    R = (1 + k1 q + k2 q² + k3 q³) / (1 + k4 q + k5 q² + k6 q³).

    Attributes
    ----------
    k : tuple of 6 float
    p : (float, float)
    """

    k: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    p: tuple[float, float] = (0.0, 0.0)

    def _terms(self, q: _Floats) -> tuple[_Floats, _Floats, _Floats, _Floats]:
        """Numerator and denominator of R, and their derivatives with respect to q."""
        k1, k2, k3, k4, k5, k6 = self.k
        above, below = 1.0 + q * (k1 + q * (k2 + q * k3)), 1.0 + q * (k4 + q * (k5 + q * k6))
        return above, below, k1 + q * (2.0 * k2 + q * (3.0 * k3)), k4 + q * (2.0 * k5 + q * (3.0 * k6))

    def _radial(self, r: _Floats) -> tuple[_Floats, _Floats]:
        """Distorted radius, and its derivative."""
        q = r * r
        above, below, d_above, d_below = self._terms(q)
        ratio = above / below
        return r * ratio, ratio + 2.0 * q * (d_above - ratio * d_below) / below

    @cached_property
    def limit(self) -> float:
        """Radius without distortion from which on the distorted one no longer grows; infinite if it always does."""

        def grows(q: _Floats) -> npt.NDArray[np.bool_]:
            above, below, d_above, d_below = self._terms(q)
            slope = above * below + 2.0 * q * (d_above * below - above * d_below)
            found: npt.NDArray[np.bool_] = (below > 0.0) & (slope > 0.0)
            return found

        square = _first_failure(grows, _FARTHEST * _FARTHEST)
        return math.sqrt(square)

    def _bent(self, x: _Floats, y: _Floats) -> tuple[_Floats, _Floats, tuple[_Floats, _Floats, _Floats]]:
        """Place with distortion, and its Jacobian: d/dx of the first, d/dy of it = d/dx of the second, d/dy of that."""
        p1, p2 = self.p
        q = x * x + y * y
        above, below, d_above, d_below = self._terms(q)
        ratio = above / below
        slope = 2.0 * (d_above - ratio * d_below) / below
        first = x * ratio + (2.0 * p1 * x * y + p2 * (q + 2.0 * x * x))
        second = y * ratio + (p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y)
        xx = ratio + x * x * slope + (2.0 * p1 * y + 6.0 * p2 * x)
        xy = x * y * slope + (2.0 * p1 * x + 2.0 * p2 * y)
        yy = ratio + y * y * slope + (6.0 * p1 * y + 2.0 * p2 * x)
        return first, second, (xx, xy, yy)

    def _in_field(self, x: _Floats, y: _Floats) -> npt.NDArray[np.bool_]:
        xx, xy, yy = self._bent(x, y)[2]
        found: npt.NDArray[np.bool_] = (x * x + y * y < self.limit * self.limit) & (xx * yy - xy * xy > 0.0)
        return found

    def bound(self, distance: float) -> float:
        """See `LensModel`."""
        return _bound(self._radial, distance, min(self.limit, _FARTHEST))

    def places(self, directions: _Floats) -> _Floats:
        """See `LensModel`."""
        x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
        with np.errstate(all="ignore"):
            x, y = x / z, y / z
            first, second, _ = self._bent(x, y)
            seen = (z > 0.0) & self._in_field(x, y)
        return np.where(seen[..., None], np.stack([first, second], axis=-1), np.nan)

    def directions(self, places: _Floats) -> _Floats:
        """See `LensModel`."""
        first, second = np.moveaxis(np.asarray(places, np.float64), -1, 0)
        with np.errstate(all="ignore"):
            radius = np.sqrt(first * first + second * second)
            # Just within the field, as what is not radial may have its end before that of what is
            start = np.minimum(_inverse(self._radial, radius, min(self.limit, _FARTHEST)), self.limit * _WITHIN)
            share = start / np.where(radius > 0.0, radius, 1.0)
            share = np.where(radius > 0.0, share, 1.0)
            x, y = first * share, second * share
            for _ in range(_PLANE_STEPS):
                bent_x, bent_y, (xx, xy, yy) = self._bent(x, y)
                off_x, off_y, area = bent_x - first, bent_y - second, xx * yy - xy * xy
                x, y = x - (yy * off_x - xy * off_y) / area, y - (xx * off_y - xy * off_x) / area
            bent_x, bent_y, _ = self._bent(x, y)
            error = np.maximum(np.abs(bent_x - first), np.abs(bent_y - second))
            seen = (error <= _TOLERANCE * (1.0 + radius)) & self._in_field(x, y)
            found = np.stack([x, y, np.ones_like(x)], axis=-1) / np.sqrt(x * x + y * y + 1.0)[..., None]
        return np.where(seen[..., None], found, np.nan)


@dataclass(frozen=True)
class KannalaBrandt:
    """Fisheye lenses: the distance from the principal point is a polynomial of the angle from the axis.

    It is t (1 + k1 t² + k2 t⁴ + k3 t⁶ + k4 t⁸) of the angle t (Kannala and Brandt 2006; OpenCV's ``fisheye`` module).

    Attributes
    ----------
    k : tuple of 4 float
    """

    k: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)

    def _radial(self, t: _Floats) -> tuple[_Floats, _Floats]:
        """Distance on the film, and its derivative."""
        k1, k2, k3, k4 = self.k
        q = t * t
        return (
            t * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4)))),
            1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * (7.0 * k3 + q * (9.0 * k4)))),
        )

    @cached_property
    def limit(self) -> float:
        """Angle from which on the distance no longer grows, at most π."""

        def grows(q: _Floats) -> npt.NDArray[np.bool_]:
            found: npt.NDArray[np.bool_] = self._radial(np.sqrt(q))[1] > 0.0
            return found

        return math.sqrt(min(_first_failure(grows, 16.0), math.pi * math.pi))

    def bound(self, distance: float) -> float:
        """See `LensModel`."""
        return _bound(self._radial, distance, self.limit)

    def places(self, directions: _Floats) -> _Floats:
        """See `LensModel`."""
        x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
        across = np.sqrt(x * x + y * y)
        with np.errstate(all="ignore"):
            angle = angles_of(across, z)
            share = np.where(across > 0.0, self._radial(angle)[0] / across, 0.0)
            seen = (angle < self.limit) & ((across > 0.0) | (z > 0.0))
        return np.where(seen[..., None], np.stack([x * share, y * share], axis=-1), np.nan)

    def directions(self, places: _Floats) -> _Floats:
        """See `LensModel`."""
        first, second = np.moveaxis(np.asarray(places, np.float64), -1, 0)
        with np.errstate(all="ignore"):
            radius = np.sqrt(first * first + second * second)
            angle = _inverse(self._radial, radius, self.limit)
            error = np.abs(self._radial(angle)[0] - radius)
            seen = (error <= _TOLERANCE * (1.0 + radius)) & (angle < self.limit)
            sine, cosine = sines_cosines(np.where(seen, angle, 0.0))
            share = np.where(radius > 0.0, sine / radius, 0.0)
        found = np.stack([first * share, second * share, cosine], axis=-1)
        return np.where(seen[..., None], found, np.nan)


def _bound(function: Callable[[_Floats], Sequence[_Floats]], distance: float, most: float) -> float:
    """The inverse of a function at a distance and a little more, at most `most`."""
    place = float(_inverse(function, np.array([distance * _SPARE]), most)[0])
    return min(place * _SPARE, most)


def _first_failure(holds: Callable[[_Floats], npt.NDArray[np.bool_]], most: float) -> float:
    """Where a condition on positive numbers first fails, up to `most`; infinite if it holds. It holds at 0."""
    octaves = range(-30, math.frexp(most)[1])
    grid = np.concatenate([np.ldexp(1.0 + np.arange(64) / 64.0, octave) for octave in octaves])
    failing = np.flatnonzero(~holds(grid))
    if not len(failing):
        return math.inf
    index = int(failing[0])
    low, high = float(grid[index - 1]) if index else 0.0, float(grid[index])
    for _ in range(60):
        middle = (low + high) / 2.0
        if bool(holds(np.array([middle]))[0]):
            low = middle
        else:
            high = middle
    return low


def _inverse(function: Callable[[_Floats], Sequence[_Floats]], values: _Floats, most: float) -> _Floats:
    """Where a function, which grows from 0 at 0, has these values: at most at `most`. By bisection, then by Newton."""
    low, high = np.zeros_like(values), np.full_like(values, most)
    # Without a bound: from where the value is exceeded
    start = np.maximum(2.0 * values, 1.0)
    high = np.where((start < high) & (function(start)[0] > values), start, high)
    for _ in range(_HALVINGS):
        middle = (low + high) * 0.5
        above = function(middle)[0] < values
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    place = (low + high) * 0.5
    for _ in range(_NEWTON_STEPS):
        value, slope = function(place)
        off = value - values
        low, high = np.where(off < 0.0, place, low), np.where(off < 0.0, high, place)
        ahead = place - off / np.where(slope > 1e-9, slope, 1e-9)
        middle = (low + high) * 0.5
        place = np.where((ahead >= low) & (ahead <= high), ahead, middle)
    return np.asarray(place)
