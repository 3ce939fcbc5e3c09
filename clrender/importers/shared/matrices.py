"""Affine maps as 4x4 matrices of float64 that act on column vectors, for the transforms of other scene files."""

from __future__ import annotations

import math
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos
from clrender.exact.matrices import determinant, length, product
from clrender.exact.matrices import inverse as inverse_of

__all__ = [
    "Matrix",
    "frame_along",
    "handedness",
    "identity",
    "inverse",
    "is_affine",
    "is_identity",
    "is_similarity",
    "look_at",
    "rotation",
    "scaling",
    "transform_key",
    "translation",
]

Matrix: TypeAlias = NDArray[np.float64]
"""(4, 4) float64."""
_EVEN: Final = 1e-6


def identity() -> Matrix:
    """The identity."""
    return np.eye(4)


def translation(x: float, y: float, z: float) -> Matrix:
    """A translation."""
    made = np.eye(4)
    made[:3, 3] = x, y, z
    return made


def scaling(x: float, y: float, z: float) -> Matrix:
    """A scaling along each axis."""
    return np.diag([x, y, z, 1.0])


def rotation(axis: Any, degrees: float, as_given: bool = False) -> Matrix:
    """A right-handed rotation about an axis of any length above 0 (Rodrigues' formula).

    Parameters
    ----------
    axis : three floats
    degrees : float
    as_given : bool
        Whether the axis goes into the formula with its own length, as in Mitsuba 3, where the result of any but 1 is no
        rotation.

    Raises
    ------
    ValueError
        The axis is zero.
    """
    direction = np.asarray(axis, np.float64)
    size = length(direction)
    if not 0.0 < size < math.inf:
        raise ValueError("the axis of the rotation has no direction")
    stretched = as_given and abs(size - 1.0) > 1e-6
    x, y, z = direction if stretched else direction / size
    sine, cosine = sin_cos(math.radians(math.fmod(degrees, 360.0)))
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    made = np.eye(4)
    if stretched:
        made[:3, :3] = cosine * np.eye(3) + (1.0 - cosine) * direction[:, None] * direction[None, :] + sine * across
        return made
    made[:3, :3] += sine * across + (1.0 - cosine) * product(across, across)
    return made


def look_at(origin: Any, target: Any, up: Any) -> Matrix:
    """From the space of a camera that looks along its own +z, with +y up, to world space; its +x is up x forward.

    In right-handed world space, +x points to the left of the image.

    Raises
    ------
    ValueError
        The view is degenerate.
    """
    origin, target, up = (np.asarray(each, np.float64) for each in (origin, target, up))
    forward = target - origin
    across = np.cross(up, forward)
    sizes = length(forward), length(across)
    if not (0.0 < sizes[0] < math.inf and 0.0 < sizes[1] < math.inf):
        raise ValueError("the camera looks at its own place, or along its upward direction")
    forward, across = forward / sizes[0], across / sizes[1]
    made = np.eye(4)
    made[:3, 0], made[:3, 1], made[:3, 2], made[:3, 3] = across, np.cross(forward, across), forward, origin
    return made


def frame_along(origin: Any, direction: Any) -> Matrix:
    """A frame at `origin`, with +z along a direction of any length above 0; the identity for +z at the origin.

    Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1) 2017, as in Mitsuba.
    """
    x, y, z = np.asarray(direction, np.float64) / length(direction)
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    made = np.eye(4)
    made[:3, 0] = 1.0 + sign * x * x * a, sign * b, -sign * x
    made[:3, 1] = b, sign + y * y * a, -y
    made[:3, 2], made[:3, 3] = (x, y, z), origin
    return made


def inverse(matrix: Matrix) -> Matrix:
    """The inverse of an invertible matrix."""
    return inverse_of(matrix)


def is_affine(matrix: Matrix) -> bool:
    """Whether it is finite, has the last row 0 0 0 1, and is invertible."""
    if not np.isfinite(matrix).all() or not np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0], rtol=0.0, atol=1e-6):
        return False
    rows = matrix[:3, :3]
    sizes = np.sqrt((rows * rows).sum(axis=1))
    with np.errstate(over="ignore", invalid="ignore"):
        volume = abs(determinant(rows))
        return bool(volume > 1e-12 * float(sizes.prod()) and math.isfinite(volume))


def handedness(matrix: Matrix) -> float:
    """1, or -1 if the map mirrors."""
    return -1.0 if determinant(matrix[:3, :3]) < 0.0 else 1.0


def is_similarity(matrix: Matrix) -> bool:
    """Whether it scales uniformly."""
    gram = product(matrix[:3, :3].T, matrix[:3, :3])
    return bool(np.abs(gram - gram[0, 0] * np.eye(3)).max() <= _EVEN * gram[0, 0])


def is_identity(matrix: Matrix) -> bool:
    """Whether it is exactly the identity."""
    return bool((matrix == np.eye(4)).all())


def transform_key(matrix: Matrix) -> dict[str, Any]:
    """The key `transform` of a shape for this matrix; no key for the identity."""
    if is_identity(matrix):
        return {}
    rows = [[float(x) for x in row] for row in matrix[:3]]
    return {"transform": {"matrix": [*rows, [0.0, 0.0, 0.0, 1.0]]}}
