"""Means of textures over triangles, spheres and disks, for the power of textured lights."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.angles import sin_cos_degrees
from clrender.scene.texels import tile_shape
from clrender.scene.texture_rows import FlatTextures

__all__ = ["TextureMeans"]

_Floats: TypeAlias = NDArray[np.float64]
_Ints: TypeAlias = NDArray[np.int64]
_MOST_STEPS: Final = 512
"""Most steps along an edge: larger textures are sampled."""
_CHUNK: Final = 2**19
"""Points at a time."""


def _wrapped(texel: _Ints, count: int, wrap: int) -> _Ints:
    if wrap == layout.TEXTURE_WRAPS["clamp"]:
        return np.clip(texel, 0, count - 1)
    if wrap == layout.TEXTURE_WRAPS["repeat"]:
        return np.mod(texel, count)
    twice = np.mod(texel, 2 * count)
    return np.where(twice < count, twice, 2 * count - 1 - twice)


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
                points = a + (b - a) * weights[:, :1] + (c - a) * weights[:, 1:]
                means[some] = _sums(self._values(points[..., 0], points[..., 1])) / len(weights)
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

    def whole(self) -> tuple[_Floats, float, float]:
        """Mean over the image, (3,), and its smallest and largest number."""
        row, bits = self._row, self._bits
        across, down = tile_shape(int(bits[3]) & 7)
        width, height = int(bits[1]), int(bits[2])
        count = -(-width // across) * -(-height // down)
        per_tile = across * down
        total, least, most = np.zeros(3), math.inf, 0.0
        at_once = max(1, _CHUNK // per_tile)
        for first in range(0, count, at_once):
            last = min(first + at_once, count)
            some = slice((int(bits[0]) + first) * per_tile, (int(bits[0]) + last) * per_tile)
            values = self._numbers(some) * row[12:15].astype(np.float64)  # zero beyond the image's edges
            total += np.cumsum(values, axis=0)[-1]
            least, most = min(least, float(values.min())), max(most, float(values.max()))
        return total / (width * height), least, most

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
                    mean = _sums(self._values(u[None], np.full((1, len(u)), middles[row])))[0] / len(u)
                    yield weight * mean, weight

        sums, weights = zip(*rows(), strict=True)
        mean: _Floats = np.array([math.fsum(column) for column in np.array(sums).T]) / math.fsum(weights)
        return mean

    def _values(self, u: _Floats, v: _Floats) -> _Floats:
        """Values at points, (..., 3)."""
        x, y = self.place(u, v)
        width, height = int(self._bits[1]), int(self._bits[2])
        if self.is_nearest:
            return self.texels(np.floor(x).astype(np.int64), np.floor(y).astype(np.int64), width, height)
        left, top = np.floor(x - 0.5), np.floor(y - 0.5)
        across, down = ((x - 0.5) - left)[..., None], ((y - 0.5) - top)[..., None]
        column, row = left.astype(np.int64), top.astype(np.int64)
        a, b, c, d = (self.texels(column + i, row + j, width, height) for j in (0, 1) for i in (0, 1))
        above, below = a + across * (b - a), c + across * (d - c)
        value: _Floats = above + down * (below - above)
        return value

    def texels(self, column: _Ints, row: _Ints, width: int, height: int) -> _Floats:
        """Values of texels, (..., 3), also beyond the edges of the image."""
        form = int(self._bits[3])
        x, y = (
            _wrapped(at, size, wrap) for at, size, wrap in zip((column, row), (width, height), self.wraps, strict=True)
        )
        across, down = tile_shape(form & 7)
        tile = int(self._bits[0]) + (y // down) * -(-width // across) + x // across
        return self._numbers((tile * down + y % down) * across + x % across) * self._row[12:15].astype(np.float64)

    def _numbers(self, index: _Ints | slice) -> _Floats:
        """Decoded values of texels, (..., 3), by their index among all texels of this size."""
        form = int(self._bits[3])
        four, floats = bool(form & layout.TEXEL_FOUR), bool(form & layout.TEXEL_FLOAT)
        size = (1 << (form & 7)) // (4 if four else 1)
        stored = self.textures.texels.reshape(-1).view({1: "u1", 2: "<u2", 4: "<f4"}[size])
        raw = stored.reshape(-1, 4 if four else 1)[index]
        channel = form >> 11 & 7
        is_alpha = channel == layout.TEXTURE_CHANNELS["a"]
        if is_alpha and not four:
            return np.ones((*raw.shape[:-1], 3))
        wanted, begins = (raw[..., 3:], self._bits[5]) if is_alpha else (raw[..., :3], self._bits[4])
        numbers = np.asarray(wanted if floats else self.textures.values[begins:][wanted], np.float64)
        if is_alpha or not four:
            return np.repeat(numbers, 3, axis=-1)
        if channel == layout.TEXTURE_CHANNELS["luminance"]:
            luminance = (numbers[..., :1] * 0.2126 + numbers[..., 1:2] * 0.7152) + numbers[..., 2:] * 0.0722
            return np.repeat(luminance, 3, axis=-1)
        return numbers if channel == 0 else np.repeat(numbers[..., channel - 1 : channel], 3, axis=-1)


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


def _sums(values: _Floats) -> _Floats:
    """Sums of (T, points, 3) over the points, (T, 3)."""
    return np.asarray(np.cumsum(values, axis=1)[:, -1])
