"""What of the motions of other scene files our shapes can follow."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, Final

from clrender.importers.shared.matrices import Matrix, handedness, is_affine, is_similarity

__all__ = ["fault_of_motion", "motion_keys"]

_OF_ONE_SCALE: Final = ("sphere", "disk", "curves", "bsplinecurve", "linearcurve", "hair")
"""Shapes, as scene files and Mitsuba call them, that have radii."""


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


def motion_keys(keys: Sequence[tuple[float, Matrix]]) -> list[dict[str, Any]]:
    """The value of ``motion`` of a shape.

    Parameters
    ----------
    keys : sequence of (float, (4, 4) float64)
        Times, seconds, and transforms.
    """
    return [{"time": time, "matrix": [[float(x) for x in row] for row in matrix]} for time, matrix in keys]
