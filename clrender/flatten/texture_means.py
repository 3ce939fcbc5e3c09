"""Means of textures over triangles, spheres and disks, for the power of textured lights."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.angles import sin_cos_degrees
from clrender.flatten.texel_table import TexelTable
from clrender.flatten.texture_rows import FlatTextures

__all__ = ["MOST_POINTS", "SUMMED", "TextureMeans"]

_Floats: TypeAlias = NDArray[np.float64]
_Ints: TypeAlias = NDArray[np.int64]
_MOST_STEPS: Final = 512
"""Most steps along an edge: larger textures are sampled."""
MOST_POINTS: Final = _MOST_STEPS * _MOST_STEPS
"""Most points in a triangle."""
_CHUNK: Final = 2**14
"""Points at a time, few enough that their arrays stay in the cache."""
SUMMED: Final = 2**19
"""Texels of an image that are summed at a time."""


@dataclass(frozen=True)
class TextureMeans:
    """One texture, evaluated like kernels/texture/, but in double precision and with all four texels around a point.

    Sums have a fixed order, for the same bits on every machine.

    Attributes
    ----------
    textures : FlatTextures
        Textures of a scene.
    number : int
        Index of the texture.
    """

    textures: FlatTextures
    number: int

    @property
    def uv_set(self) -> int:
        """Index of the set of texture coordinates that it uses."""
        return int(self._bits[3]) >> 14 & 1

    def triangles(self, corners: NDArray[np.float32]) -> _Floats:
        """Mean over each triangle, (T, 3), whose corners have these texture coordinates, (T, 3, 2)."""
        uv = corners.astype(np.float64)
        x, y = self.place(uv[..., 0], uv[..., 1])
        lengths = np.maximum(np.abs(x - np.roll(x, 1, axis=1)), np.abs(y - np.roll(y, 1, axis=1))).max(axis=1)
        steps = np.clip(_power_of_two(lengths / self._reach), 2, _MOST_STEPS)
        means = np.empty((len(uv), 3))
        for step in np.unique(steps).tolist():
            chosen = np.flatnonzero(steps == step)
            weights = _centroids(step)
            at_once = max(1, _CHUNK // len(weights))
            for first in range(0, len(chosen), at_once):
                some = chosen[first : first + at_once]
                a, b, c = (uv[some, corner, None, :] for corner in range(3))
                means[some] = self._sums(
                    *(
                        a[..., axis] + (b - a)[..., axis] * weights[:, 0] + (c - a)[..., axis] * weights[:, 1]
                        for axis in range(2)
                    )
                ) / len(weights)
        return means

    def sphere(self) -> _Floats:
        """Mean over a sphere, (3,)."""
        step = self._steps()
        lines = np.array([sin_cos_degrees(180.0 * line / step - 90.0)[0] for line in range(step + 1)])
        shares = np.diff(lines) / 2.0  # Archimedes: fraction of the area between two circles of latitude
        return self._mean_of_rows(step, lambda row, middles: (middles, shares[row]))

    def disk(self) -> _Floats:
        """Mean over the disk inscribed in the unit square, (3,)."""
        step = self._steps()

        def within(row: int, middles: _Floats) -> tuple[_Floats, float]:
            inside = middles[np.square(middles - 0.5) + np.square(middles[row] - 0.5) < 0.25]
            return inside, float(len(inside))

        return self._mean_of_rows(step, within)

    def whole(self) -> tuple[_Floats, _Floats, _Floats, NDArray[np.bool_]]:
        """Mean, smallest and largest numbers of the image, (3,) each, and which tiles may not be black, (tiles,)."""
        table = self.table
        total, least, most = np.zeros(3), np.full(3, math.inf), np.zeros(3)
        lit: list[NDArray[np.bool_]] = []
        at_once = max(1, SUMMED // table.per_tile) * table.per_tile
        for first in range(0, table.count, at_once):
            tiles = table.lit_tiles(first, min(first + at_once, table.count))
            lit.append(tiles)
            if not tiles.all():
                least = np.zeros(3)
            if not tiles.any():
                continue
            begins = np.flatnonzero(tiles) * table.per_tile + (table.first + first)
            channels = table.at((begins[:, None] + np.arange(table.per_tile)).reshape(-1))  # zero beyond the edges
            total += [np.cumsum(values)[-1] for values in channels]
            least = np.minimum(least, [values.min() for values in channels])
            most = np.maximum(most, [values.max() for values in channels])
        width, height = self.size
        return total / (width * height), least, most, np.concatenate(lit)

    def place_error(self, corners: _Floats) -> _Floats:
        """Most rounding error of columns and rows, texels, of points in triangles with these corners: (T,)."""
        row = np.abs(self._row.astype(np.float64))
        u, v = (np.abs(corners[..., axis]).max(axis=1) for axis in range(2))
        width, height = self.size
        across = (u * row[6] + v * row[7] + row[8]) * width
        down = (u * row[9] + v * row[10] + row[11]) * height
        error: _Floats = 16.0 * float(np.finfo(np.float64).eps) * np.maximum(across, down)
        return error

    @cached_property
    def table(self) -> TexelTable:
        return TexelTable(self.textures, self.number)

    @property
    def _row(self) -> NDArray[np.float32]:
        row: NDArray[np.float32] = self.textures.rows[self.number]
        return row

    @property
    def _bits(self) -> NDArray[np.uint32]:
        return self._row.view(np.uint32)

    def place(self, u: _Floats, v: _Floats) -> tuple[_Floats, _Floats]:
        """Texture coordinates as columns and rows of texels."""
        row = self._row.astype(np.float64)
        width, height = (float(size) for size in self._bits[1:3])
        return (u * row[6] + v * row[7] + row[8]) * width, (u * row[9] + v * row[10] + row[11]) * height

    @property
    def is_nearest(self) -> bool:
        """Whether a texel is constant; else values are interpolated between texel centres."""
        return int(self._bits[3]) >> 9 & 3 == layout.TEXTURE_FILTERS["nearest"]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, texels."""
        return int(self._bits[1]), int(self._bits[2])

    @property
    def wraps(self) -> tuple[int, int]:
        """`layout.TEXTURE_WRAPS` of columns and of rows."""
        form = int(self._bits[3])
        return form >> 5 & 3, form >> 7 & 3

    @property
    def _reach(self) -> float:
        """Texels that a point's filter covers along each axis."""
        return 1.0 if self.is_nearest else 2.0

    def _steps(self) -> int:
        """Steps along the unit square that are needed to sample all texels."""
        u, v = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
        x, y = self.place(u, v)
        lengths = np.array([max(abs(x[1] - x[0]) + abs(x[2] - x[0]), abs(y[1] - y[0]) + abs(y[2] - y[0]))])
        return int(np.clip(_power_of_two(lengths / self._reach), 64, _MOST_STEPS)[0])

    def _mean_of_rows(self, step: int, weighted: Callable[[int, _Floats], tuple[_Floats, float]]) -> _Floats:
        """Weighted mean of rows of points in the unit square, each with its own u and weight."""
        middles = (np.arange(step) + 0.5) / step

        def rows() -> Iterator[tuple[_Floats, float]]:
            for row in range(step):
                u, weight = weighted(row, middles)
                if len(u):
                    mean = self._sums(u[None], np.full((1, len(u)), middles[row]))[0] / len(u)
                    yield weight * mean, weight

        sums, weights = zip(*rows(), strict=True)
        mean: _Floats = np.array([math.fsum(column) for column in np.array(sums).T]) / math.fsum(weights)
        return mean

    def _sums(self, u: _Floats, v: _Floats) -> _Floats:
        """Sums of the values at points, (T, points), of each row: (T, 3)."""
        channels = self._values(u, v)
        sums = [np.cumsum(each, axis=1)[:, -1] for each in channels[: 1 if self.table.is_grey else 3]]
        return np.stack(sums * (3 // len(sums)), axis=-1)

    def _values(self, u: _Floats, v: _Floats) -> list[_Floats]:
        """Values at points, an array a channel."""
        x, y = self.place(u, v)
        if self.is_nearest:
            return self.table.at(self.table.position(np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)))
        left, top = np.floor(x - 0.5), np.floor(y - 0.5)
        across, down = (x - 0.5) - left, (y - 0.5) - top
        corners = self.table.corners(left.astype(np.int64), top.astype(np.int64))

        def between(a: _Floats, b: _Floats, c: _Floats, d: _Floats) -> _Floats:
            above, below = a + across * (b - a), c + across * (d - c)
            value: _Floats = above + down * (below - above)
            return value

        values = list(zip(*map(self.table.at, corners), strict=True))
        first = between(*values[0])
        return [first] * 3 if self.table.is_grey else [first, *(between(*each) for each in values[1:])]

    def texels(self, column: _Ints, row: _Ints) -> _Floats:
        """Values of texels, (..., 3), also beyond the edges of the image."""
        return np.stack(self.table.at(self.table.position(column, row)), axis=-1)


def _power_of_two(lengths: _Floats) -> _Ints:
    """The smallest power of two not less than each length."""
    return np.int64(1) << np.frexp(np.maximum(np.ceil(np.minimum(lengths, _MOST_STEPS)) - 1.0, 0.0))[1].astype(np.int64)


def _centroids(step: int) -> _Floats:
    """Barycentric weights of B and C, (step^2, 2), of the centroids of a triangle's equal parts."""
    i, j = (each.ravel() for each in np.meshgrid(np.arange(step), np.arange(step), indexing="ij"))
    upright, turned = i + j < step, i + j < step - 1
    points = [
        np.stack([i[upright] + 1 / 3, j[upright] + 1 / 3], 1),
        np.stack([i[turned] + 2 / 3, j[turned] + 2 / 3], 1),
    ]
    return np.concatenate(points) / step
