"""Rotations from quaternions and rotation vectors, with the same bits on every machine."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from clrender.exact.angles import sin_cos

__all__ = ["rotation_of", "rotation_of_quaternion"]

_Floats = npt.NDArray[np.float64]


def rotation_of(vector: npt.ArrayLike) -> _Floats:
    """Matrix of a rotation vector (Rodrigues): its direction is the axis, and its length the angle, radians.

    Parameters
    ----------
    vector : (3,) floats

    Returns
    -------
    (3, 3) float64
    """
    x, y, z = np.asarray(vector, np.float64).tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return np.eye(3)
    sine, cosine = sin_cos(0.5 * angle)
    return rotation_of_quaternion([cosine, sine * x / angle, sine * y / angle, sine * z / angle])


def rotation_of_quaternion(quaternion: Sequence[float]) -> _Floats:
    """Matrix of a quaternion w, x, y, z of any length but zero.

    Parameters
    ----------
    quaternion : sequence of 4 float

    Returns
    -------
    (3, 3) float64

    Raises
    ------
    ValueError
        Its length is zero, or not finite.
    """
    size = math.sqrt(sum(each * each for each in quaternion))
    if not 0.0 < size < math.inf:
        raise ValueError("is a quaternion of length zero")
    w, x, y, z = (each / size for each in quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
