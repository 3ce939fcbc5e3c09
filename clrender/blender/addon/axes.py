"""Places and directions of Blender, where z is up, in scenes of clrender, where y is up."""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["Matrix", "Vector", "column", "length", "turned", "unit"]

Vector = tuple[float, float, float]
Matrix = Sequence[Sequence[float]]
"""(4, 4) or (3, 4), rows first; acts on columns."""


def turned(vector: Sequence[float]) -> Vector:
    """A vector of Blender's world in clrender's."""
    x, y, z = vector
    return (x, z, -y)


def column(matrix: Matrix, index: int) -> Vector:
    """A column of the transform of an object to Blender's world, in clrender's world; 3 is the position."""
    return turned([matrix[row][index] for row in range(3)])


def length(vector: Sequence[float]) -> float:
    """Length of a vector."""
    return math.sqrt(sum(x * x for x in vector))


def unit(vector: Sequence[float]) -> Vector:
    """The direction of a vector.

    Raises
    ------
    ValueError
        It has no length.
    """
    size = length(vector)
    if size == 0.0:
        raise ValueError("it has no direction")
    x, y, z = (x / size for x in vector)
    return (x, y, z)
