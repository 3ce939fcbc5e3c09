"""Projections: points in a camera's frame to places in its image, and back.

All frames are x right, y down, z forward. Places are in widths and heights of the image, from its upper left corner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from clrender.cameras.distortion import LensModel
from clrender.exact.elementary import angles_of, sines_cosines

__all__ = ["Equidistant", "Intrinsics", "LatitudeLongitude", "Parallel", "Projection", "Rectilinear"]

_Floats = npt.NDArray[np.float64]


class Projection(Protocol):
    """A map from points to places in the image."""

    def places(self, points: _Floats) -> _Floats:
        """Places of points.

        Parameters
        ----------
        points : (n, 3) float64
            In the camera's frame.

        Returns
        -------
        (n, 2) float64
            NaN where the camera does not see the point, however large its image.
        """

    def rays(self, places: _Floats) -> tuple[_Floats, _Floats]:
        """Rays through places.

        Parameters
        ----------
        places : (n, 2) float64

        Returns
        -------
        origins, directions : (n, 3) float64
            In the camera's frame; unit directions, NaN where there is no ray.
        """


@dataclass(frozen=True)
class Rectilinear:
    """Perspective.

    Attributes
    ----------
    left, top, width, height : float
        The image's rectangle on the plane at distance 1; y down.
    """

    left: float
    top: float
    width: float
    height: float

    def places(self, points: _Floats) -> _Floats:
        """See `Projection`."""
        x, y, z = points.T
        with np.errstate(all="ignore"):
            found = np.stack([(x / z - self.left) / self.width, (y / z - self.top) / self.height], axis=1)
        return np.where((z > 0.0)[:, None], found, np.nan)

    def rays(self, places: _Floats) -> tuple[_Floats, _Floats]:
        """See `Projection`."""
        x, y = (self.left + places[:, 0] * self.width, self.top + places[:, 1] * self.height)
        return np.zeros((len(places), 3)), _unit(np.stack([x, y, np.ones_like(x)], axis=1))


@dataclass(frozen=True)
class Parallel:
    """Orthographic projection.

    Attributes
    ----------
    left, top, width, height : float
        The image's rectangle, metres; y down.
    """

    left: float
    top: float
    width: float
    height: float

    def places(self, points: _Floats) -> _Floats:
        """See `Projection`."""
        x, y, z = points.T
        found = np.stack([(x - self.left) / self.width, (y - self.top) / self.height], axis=1)
        return np.where((z > 0.0)[:, None], found, np.nan)

    def rays(self, places: _Floats) -> tuple[_Floats, _Floats]:
        """See `Projection`."""
        x, y = (self.left + places[:, 0] * self.width, self.top + places[:, 1] * self.height)
        zero = np.zeros_like(x)
        return np.stack([x, y, zero], axis=1), np.stack([zero, zero, zero + 1.0], axis=1)


@dataclass(frozen=True)
class LatitudeLongitude:
    """Panoramas: all directions."""

    def places(self, points: _Floats) -> _Floats:
        """See `Projection`."""
        x, y, z = points.T
        level = np.sqrt(x * x + z * z)
        turn, height = angles_of(x, z) / (2.0 * math.pi), angles_of(level, -y) / math.pi
        seen = (level > 0.0) | (y != 0.0)
        return np.where(seen[:, None], np.stack([turn + 0.5, height], axis=1), np.nan)

    def rays(self, places: _Floats) -> tuple[_Floats, _Floats]:
        """See `Projection`."""
        sine, cosine = sines_cosines((places[:, 0] - 0.5) * (2.0 * math.pi))
        level, up = sines_cosines(places[:, 1] * math.pi)
        return np.zeros((len(places), 3)), np.stack([level * sine, -up, level * cosine], axis=1)


@dataclass(frozen=True)
class Equidistant:
    """Fisheyes: the distance from the middle grows with the angle from the axis.

    Attributes
    ----------
    angle : float
        From the axis to the upper edge, radians.
    aspect : float
        Width over height of the image.
    """

    angle: float
    aspect: float

    def places(self, points: _Floats) -> _Floats:
        """See `Projection`."""
        x, y, z = points.T
        across = np.sqrt(x * x + y * y)
        away = angles_of(across, z)
        with np.errstate(all="ignore"):
            share = np.where(across > 0.0, away / across, 0.0) / self.angle
        seen = (away <= self.angle) & ((across > 0.0) | (z != 0.0))
        found = np.stack([0.5 + 0.5 * x * share / self.aspect, 0.5 + 0.5 * y * share], axis=1)
        return np.where(seen[:, None], found, np.nan)

    def rays(self, places: _Floats) -> tuple[_Floats, _Floats]:
        """See `Projection`."""
        x, y = (2.0 * places[:, 0] - 1.0) * self.aspect, 2.0 * places[:, 1] - 1.0
        away = np.sqrt(x * x + y * y)
        sine, cosine = sines_cosines(np.minimum(away, 1.0) * self.angle)
        with np.errstate(all="ignore"):
            share = np.where(away > 0.0, sine / away, 0.0)
        found = np.stack([x * share, y * share, cosine], axis=1)
        return np.zeros((len(places), 3)), np.where((away <= 1.0)[:, None], found, np.nan)


@dataclass(frozen=True)
class Intrinsics:
    """A calibrated camera.

    Attributes
    ----------
    focal : (float, float)
        Focal lengths along x and y, in widths and heights of the image.
    principal : (float, float)
        The principal point, likewise.
    skew : float
        What a step of one focal length down adds to x, in widths.
    lens : LensModel
    """

    focal: tuple[float, float]
    principal: tuple[float, float]
    skew: float
    lens: LensModel

    def places(self, points: _Floats) -> _Floats:
        """See `Projection`."""
        x, y = self.lens.places(points).T
        (across, down), (middle_x, middle_y) = self.focal, self.principal
        return np.stack([(across * x + self.skew * y) + middle_x, down * y + middle_y], axis=1)

    def on_film(self, places: _Floats) -> _Floats:
        """Places in units of the focal length, from the principal point.

        Parameters
        ----------
        places : (n, 2) float64

        Returns
        -------
        (n, 2) float64
        """
        y = (places[:, 1] - self.principal[1]) / self.focal[1]
        return np.stack([((places[:, 0] - self.principal[0]) - self.skew * y) / self.focal[0], y], axis=1)

    def rays(self, places: _Floats) -> tuple[_Floats, _Floats]:
        """See `Projection`."""
        return np.zeros((len(places), 3)), self.lens.directions(self.on_film(places))


def _unit(vectors: _Floats) -> _Floats:
    x, y, z = vectors.T
    return np.asarray(vectors / np.sqrt((x * x + y * y) + z * z)[:, None])
