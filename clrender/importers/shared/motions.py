"""What of the motions of other scene files our shapes and lights can follow."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from clrender.exact.matrices import inner, length, product, times
from clrender.importers.shared.matrices import Matrix, handedness, inverse, is_affine, is_similarity

__all__ = ["fault_of_motion", "light_motion", "motion_keys", "unflattened"]

_OF_ONE_SCALE: Final = ("sphere", "disk", "curves", "bsplinecurve", "linearcurve", "hair")
"""Shapes, as scene files and Mitsuba call them, that have radii."""
_THIN: Final = 2.0**-13
"""What remains of a shape that a motion flattens: the share of its size at the nearest time at which it is not flat."""


def fault_of_motion(shape: str, matrices: Sequence[Matrix]) -> str:
    """Why a shape cannot follow these transforms; empty if it can.

    Parameters
    ----------
    shape : str
        Its type.
    matrices : sequence of (4, 4) float64
        The transforms at the keys of its motion.
    """
    if not all(map(is_affine, matrices)) or any(
        handedness(a) != handedness(b) for a, b in itertools.pairwise(matrices)
    ):
        return "a motion makes a shape flat on its way"
    if shape in ("sphere", "disk", "curves", "bsplinecurve", "linearcurve", "hair") and not all(
        map(is_similarity, matrices)
    ):
        return "a motion stretches a sphere, disk or curve"
    return ""


def unflattened(matrices: Sequence[Matrix]) -> list[Matrix]:
    """Transforms of a motion, of which those that flatten leave a little of the size at the nearest that does not.

    Animations scale to zero what they hide. If all flatten, they stay as they are.

    Parameters
    ----------
    matrices : sequence of (4, 4) float64
        In the order of their times.
    """
    sound = [number for number, matrix in enumerate(matrices) if is_affine(matrix)]
    made = list(matrices)
    for number in sorted({*range(len(made))} - {*sound}) if sound else ():
        near = matrices[min(sound, key=lambda other: abs(other - number))]
        made[number] = matrices[number].copy()
        made[number][:3, :3] += _THIN * (near[:3, :3] - made[number][:3, :3])
    return made


def motion_keys(keys: Sequence[tuple[float, Matrix]]) -> list[dict[str, Any]]:
    """The value of ``motion`` of a shape.

    Parameters
    ----------
    keys : sequence of (float, (4, 4) float64)
        Times, seconds, and transforms.
    """
    return [{"time": time, "matrix": [[float(x) for x in row] for row in matrix]} for time, matrix in keys]


def light_motion(
    first: Matrix, keys: Sequence[tuple[float, Matrix]], place: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> list[dict[str, Any]]:
    """The value of ``motion`` of a light: what is rigid in its transforms, as its size changes nothing.

    Parameters
    ----------
    first : (4, 4) float64
        The transform with which the light is described.
    keys : sequence of (float, (4, 4) float64)
        Times, seconds, and transforms; all are invertible.
    place : (3,) float
        Where the light is before them.
    """
    back = inverse(_frame(first, place))
    return motion_keys([(time, product(_frame(matrix, place), back)) for time, matrix in keys])


def _frame(matrix: Matrix, place: tuple[float, float, float]) -> Matrix:
    """A rigid map with the same z axis, and an x axis as near as that leaves it."""
    z = matrix[:3, 2] / length(matrix[:3, 2])
    across = matrix[:3, 0] - float(inner(matrix[:3, 0], z)) * z
    x = across / length(across)
    made = np.eye(4)
    made[:3, 0], made[:3, 1], made[:3, 2] = x, np.cross(z, x), z
    made[:3, 3] = times(matrix[:3, :3], place) + matrix[:3, 3]
    return made
