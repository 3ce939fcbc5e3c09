"""Node transforms as 4 x 4 matrices, row by row, in plain Python, whose bits do not depend on a BLAS."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

__all__ = ["IDENTITY", "Matrix", "composed", "from_columns", "product"]

Matrix: TypeAlias = tuple[tuple[float, ...], ...]
IDENTITY: Matrix = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def from_columns(numbers: Sequence[float]) -> Matrix:
    """A matrix from sixteen numbers, column by column."""
    return tuple(tuple(float(numbers[4 * column + row]) for column in range(4)) for row in range(4))


def composed(translation: Sequence[float], rotation: Sequence[float], scale: Sequence[float]) -> Matrix:
    """Scale, then rotation by a quaternion (x, y, z, w) of any length, then translation."""
    size = math.sqrt(sum(q * q for q in rotation)) or 1.0
    x, y, z, w = (q / size for q in rotation)
    turn = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )
    rows = tuple(
        (*(a * float(s) for a, s in zip(row, scale, strict=True)), float(move))
        for row, move in zip(turn, translation, strict=True)
    )
    return (*rows, IDENTITY[3])


def product(a: Matrix, b: Matrix) -> Matrix:
    """Composition of affine maps: first `b`, then `a`."""
    rows = []
    for p, q, r, s in a[:3]:
        rows.append(
            (
                p * b[0][0] + q * b[1][0] + r * b[2][0],
                p * b[0][1] + q * b[1][1] + r * b[2][1],
                p * b[0][2] + q * b[1][2] + r * b[2][2],
                p * b[0][3] + q * b[1][3] + r * b[2][3] + s,
            )
        )
    return (*rows, IDENTITY[3])
