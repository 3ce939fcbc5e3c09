"""Converts another renderer's camera to ours: its matrix, its angle and the axis of that angle."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from clrender.exact.angles import angle_of, tangent
from clrender.exact.matrices import length
from clrender.importers.shared.matrices import Matrix, handedness

__all__ = ["camera_keys", "vertical_angle"]

_LEAST: Final = 1e-3


def vertical_angle(degrees: float, axis: str, width: int, height: int) -> float:
    """Vertical field of view of an image, degrees.

    Parameters
    ----------
    degrees : float
        Field of view along the axis.
    axis : {"x", "y", "diagonal", "smaller", "larger"}
    width, height : int
        Pixels.
    """
    across = {
        "x": width,
        "y": height,
        "diagonal": math.sqrt(width * width + height * height),
        "smaller": min(width, height),
        "larger": max(width, height),
    }[axis]
    return math.degrees(2.0 * angle_of(tangent(math.radians(degrees) / 2.0) * height / across, 1.0))


def camera_keys(matrix: Matrix, rightward: bool, distance: float | None = None) -> dict[str, Any]:
    """Position, target and up vector of a camera that looks along its own +z, with +y up.

    Parameters
    ----------
    matrix : (4, 4) float64
        From camera space to world space; affine.
    rightward : bool
        Whether its +x points to the image's right, as in pbrt, or left, as in Mitsuba.
    distance : float, optional
        Distance of the plane of focus, along the view.
    """
    position, forward, up = matrix[:3, 3], matrix[:3, 2], matrix[:3, 1]
    forward = forward / length(forward)
    far = distance or 1.0
    target = position + far * forward
    if not (target - position).any():  # so far from the origin that a step of this length is lost to rounding
        target = position + forward * max(1.0, float(np.abs(position).max()) * _LEAST)
    keys: dict[str, Any] = {
        "position": [float(x) for x in position],
        "target": [float(x) for x in target],
        "up": [float(x) for x in up / length(up)],
    }
    # Our right is forward x up = z x y, which is -x of a right-handed camera
    if (handedness(matrix) > 0.0) == rightward:
        keys["mirrored"] = True
    return keys
