"""Poses of cameras as matrices, in the conventions of other programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.exact.matrices import determinant, inner, inverse, lengths, times

__all__ = ["CONVENTIONS", "pose_matrix", "pose_of"]

_Floats = npt.NDArray[np.float64]
_TOLERANCE: Final = 2e-3
"""Of lengths and right angles of a rotation; files often have six digits, or three."""

CONVENTIONS: Final[Mapping[str, tuple[tuple[float, ...], ...]]] = {
    "opencv": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "opengl": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
    "ros": ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
}
"""What the image's right, its down, and forward are along the camera's own axes.

``opencv``: x right, y down, z forward. ``opengl``, also Blender's: x right, y up, z backward. ``ros``: x forward,
y left, z up (REP 103).
"""


def pose_of(matrix: npt.ArrayLike, convention: str, to_camera: bool) -> tuple[_Floats, _Floats, _Floats]:
    """Position, forward and up direction of a camera.

    Parameters
    ----------
    matrix : (3, 4) or (4, 4) floats
        From camera space to world space, acting on columns.
    convention : str
        One of `CONVENTIONS`.
    to_camera : bool
        Whether it is from world space to camera space instead.

    Returns
    -------
    position, forward, up : (3,) float64
        World space; metres, and unit vectors.

    Raises
    ------
    ValueError
        It is not a rotation and a translation; the message says why, to follow the matrix's name.
    """
    values = np.asarray(matrix, np.float64)
    if values.shape == (4, 4) and not (values[3] == (0.0, 0.0, 0.0, 1.0)).all():
        raise ValueError("has a last row that is not 0, 0, 0, 1; write vectors as columns")
    rotation = values[:3, :3]
    sizes = lengths(rotation.T)
    products = [float(inner(rotation[:, i], rotation[:, j])) for i, j in ((0, 1), (1, 2), (2, 0))]
    if not (np.abs(sizes - 1.0) < _TOLERANCE).all() or not all(abs(each) < _TOLERANCE for each in products):
        raise ValueError("is not a rotation and a translation; take scale and shear out of it")
    if determinant(rotation) < 0.0:
        raise ValueError("turns right into left; take the reflection out of it, or see `mirrored`")
    whole = np.vstack([values[:3], [[0.0, 0.0, 0.0, 1.0]]])
    whole = inverse(whole) if to_camera else whole
    _, down, forward = (times(whole[:3, :3], axis) for axis in np.asarray(CONVENTIONS[convention]))
    # Without negative zeros, so that equal poses are equal in hashes
    return whole[:3, 3] + 0.0, forward / float(lengths(forward)) + 0.0, 0.0 - down / float(lengths(down))


def pose_matrix(position: npt.ArrayLike, axes: npt.ArrayLike, convention: str) -> _Floats:
    """The pose of a camera as a matrix from camera space to world space: the inverse of `pose_of`.

    Parameters
    ----------
    position : (3,) floats
        World space, metres.
    axes : (3, 3) floats
        Rows: image right, image down and forward; unit vectors of world space.
    convention : str
        One of `CONVENTIONS`.

    Returns
    -------
    (4, 4) float64
    """
    matrix = np.eye(4)
    # axes = convention · camera axes, and the convention is a rotation
    turned = np.asarray(CONVENTIONS[convention]).T[:, :, None] * np.asarray(axes, np.float64)[None, :, :]
    matrix[:3, :3] = ((turned[:, 0] + turned[:, 1]) + turned[:, 2]).T
    matrix[:3, 3] = position
    return matrix
