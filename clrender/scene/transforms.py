"""Affine transforms of points and directions, in IEEE arithmetic of a fixed order for reproducible bits.

NumPy's matrix products are avoided: they call a BLAS whose last bit depends on the processor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.scene.shapes import Transform
from clrender.scene.values import Vector, cross, length

__all__ = ["Affine", "affine", "combined"]

_CHUNK = 2**18


@dataclass(frozen=True)
class Affine:
    """The affine map x -> linear x + offset.

    Attributes
    ----------
    linear : three rows of three floats
    offset : three floats
    """

    linear: tuple[Vector, Vector, Vector]
    offset: Vector

    @cached_property
    def determinant(self) -> float:
        """Determinant of the linear part; negative if the transform mirrors."""
        return _dot(self.linear[0], cross(self.linear[1], self.linear[2]))

    @cached_property
    def covector(self) -> tuple[Vector, Vector, Vector]:
        """Inverse transpose, up to a positive factor: keeps normals on the same side, also under mirroring."""
        a, b, c = self.linear
        sign = -1.0 if self.determinant < 0.0 else 1.0
        rows = (cross(b, c), cross(c, a), cross(a, b))
        size = max(abs(x) for row in rows for x in row)
        return tuple(tuple(sign * x / size for x in row) for row in rows)  # type: ignore[return-value]

    @property
    def scale(self) -> float:
        """Scale factor of lengths, of a similarity."""
        return length((self.linear[0][0], self.linear[1][0], self.linear[2][0]))

    def point(self, p: Vector) -> Vector:
        """A transformed point."""
        return tuple(_dot(row, p) + o for row, o in zip(self.linear, self.offset, strict=True))  # type: ignore[return-value]

    def vector(self, v: Vector) -> Vector:
        """A transformed direction, as long as the map makes it."""
        return tuple(_dot(row, v) for row in self.linear)  # type: ignore[return-value]

    def normal(self, n: Vector) -> Vector:
        """A transformed unit normal."""
        carried: Vector = tuple(_dot(row, n) for row in self.covector)  # type: ignore[assignment]
        size = length(carried)
        return tuple(x / size for x in carried)  # type: ignore[return-value]

    def points_into(self, points: NDArray[np.floating], out: NDArray[np.float32]) -> None:
        """Transform points, computed in float64 and rounded once.

        Parameters
        ----------
        points : (n, 3) floating
        out : (n, 3) float32
            Written.
        """
        _map_rows(points, out, self.linear, self.offset)

    def normals_into(self, normals: NDArray[np.floating], out: NDArray[np.float32]) -> None:
        """Transform normals to unit length; zero stays zero. Shapes as in `points_into`."""
        self._units_into(normals, out, self.covector)

    def directions_into(self, directions: NDArray[np.floating], out: NDArray[np.float32]) -> None:
        """Transform tangent directions to unit length; zero stays zero. Shapes as in `points_into`."""
        size = max(abs(x) for row in self.linear for x in row) or 1.0
        linear = tuple(tuple(x / size for x in row) for row in self.linear)
        self._units_into(directions, out, linear)  # type: ignore[arg-type]

    @staticmethod
    def _units_into(
        normals: NDArray[np.floating], out: NDArray[np.float32], linear: tuple[Vector, Vector, Vector]
    ) -> None:
        for start in range(0, len(normals), _CHUNK):
            rows = np.asarray(normals[start : start + _CHUNK], dtype=np.float64)
            size = np.abs(rows).max(axis=1, initial=0.0)
            rows = rows / np.where(size > 0.0, size, 1.0)[:, None]
            carried = np.empty_like(rows)
            _map_rows(rows, carried, linear, (0.0, 0.0, 0.0))
            x, y, z = carried.T
            norm = np.sqrt(x * x + y * y + z * z)
            out[start : start + _CHUNK] = carried / np.where(norm > 0.0, norm, 1.0)[:, None]


def _map_rows(
    points: NDArray[np.floating],
    out: NDArray[np.floating],
    linear: tuple[Vector, Vector, Vector],
    offset: Vector,
) -> None:
    for start in range(0, len(points), _CHUNK):
        x, y, z = np.asarray(points[start : start + _CHUNK], dtype=np.float64).T
        for axis, (a, b, c) in enumerate(linear):
            out[start : start + _CHUNK, axis] = ((a * x + b * y) + c * z) + offset[axis]


def _dot(a: Vector, b: Vector) -> float:
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def _product(a: Sequence[Vector], b: Sequence[Vector]) -> tuple[Vector, Vector, Vector]:
    columns = list(zip(*b, strict=True))
    return tuple(tuple(_dot(row, column) for column in columns) for row in a)  # type: ignore[return-value]


@lru_cache(maxsize=1024)  # most shapes of a large scene share the identity
def affine(transform: Transform) -> Affine:
    """The map of a scene file's transform: scale, then x, y, z rotation, then translation."""
    if transform.matrix is not None:
        rows = transform.matrix[:3]
        return Affine(
            tuple((r[0], r[1], r[2]) for r in rows),  # type: ignore[arg-type]
            (rows[0][3], rows[1][3], rows[2][3]),
        )
    (sx, cx), (sy, cy), (sz, cz) = (sin_cos_degrees(angle) for angle in transform.rotate_degrees)
    about_x = ((1.0, 0.0, 0.0), (0.0, cx, -sx), (0.0, sx, cx))
    about_y = ((cy, 0.0, sy), (0.0, 1.0, 0.0), (-sy, 0.0, cy))
    about_z = ((cz, -sz, 0.0), (sz, cz, 0.0), (0.0, 0.0, 1.0))
    rotation = _product(about_z, _product(about_y, about_x))
    u, v, w = transform.scale
    return Affine(tuple((row[0] * u, row[1] * v, row[2] * w) for row in rotation), transform.translate)  # type: ignore[arg-type]


def combined(outer: Affine, inner: Affine) -> Affine:
    """The composition: `inner` first, then `outer`."""
    return Affine(_product(outer.linear, inner.linear), outer.point(inner.offset))
