"""Exact means of textures over triangles, by integrals along the edges.

By Green's theorem the integral of f over a triangle is that of F dy along its outline, where F is the integral of f
along the row from a fixed column. Between lines of the texel grid f is constant or bilinear, so that F is a polynomial
that two-point quadrature integrates exactly. So no texel is missed, and the work grows only with the outline.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.flatten.texel_table import wrap_period
from clrender.flatten.texture_means import TextureMeans

__all__ = ["reflectance_means"]

_Floats: TypeAlias = NDArray[np.float64]
_Ints: TypeAlias = NDArray[np.int64]
_MOST_LINES: Final = 2**13
"""Most grid lines that a triangle may span; larger ones repeat the image so often that point samples suffice."""
_LEAST_AREA: Final = 1e-9
"""Least area of a triangle, relative to its squared extent: that of thinner ones is lost to rounding."""
_MOST_PIECES: Final = 2**20
"""Edge pieces processed at a time; each batch reads its rows of texels again."""
_MOST_TEXELS: Final = 2**18
"""Texels of these rows processed at a time."""
_GAUSS: Final = (0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0)


def reflectance_means(texture: TextureMeans, corners: _Floats) -> _Floats:
    """Mean of a texture over triangles, with texels clamped to 0 to 1.

    Exact to rounding, except for triangles that have no area in texture coordinates or span more than some thousand
    texels: those use a grid of points (`TextureMeans.triangles`).

    Parameters
    ----------
    texture : TextureMeans
    corners : (T, 3, 2) float64
        Texture coordinates.

    Returns
    -------
    (T, 3) float64
    """
    x, y = texture.place(corners[..., 0], corners[..., 1])
    means = np.empty((len(corners), 3))
    extent = np.maximum(np.ptp(x, axis=1), np.ptp(y, axis=1))
    area = _cross(x, y)
    exact = (np.abs(area) > _LEAST_AREA * extent * extent) & (extent <= _MOST_LINES)
    means[~exact] = texture.triangles(corners[~exact].astype(np.float32))
    where = np.flatnonzero(exact)
    pieces = np.cumsum(np.ceil(2.0 * np.ptp(x, axis=1) + 2.0 * np.ptp(y, axis=1))[where] + 3.0)
    chunk = (pieces // _MOST_PIECES).astype(np.int64)
    for number in np.unique(chunk).tolist():
        some = where[chunk == number]
        means[some] = _integrals(texture, x[some], y[some]) / (area[some, None] / 2.0)
    bounded: _Floats = np.clip(means, 0.0, 1.0)
    return bounded


def _cross(x: _Floats, y: _Floats) -> _Floats:
    """Twice the signed area of triangles."""
    area: _Floats = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    return area


@dataclass(frozen=True)
class _Pieces:
    """Pieces of edges that do not cross grid lines: triangle, start, extent and cell."""

    triangle: _Ints
    x: _Floats
    y: _Floats
    step_x: _Floats
    step_y: _Floats
    column: _Ints
    row: _Ints


def _integrals(texture: TextureMeans, x: _Floats, y: _Floats) -> _Floats:
    """Integrals of texels over triangles, (T, 3), negative for clockwise corners."""
    wraps, (width, height) = texture.wraps, texture.size
    half = 0.0 if texture.is_nearest else 0.5  # otherwise the grid lines run through texel centres
    x = x - half - _turns(x.min(axis=1), width, wraps[0])[:, None]
    y = y - half - _turns(y.min(axis=1), height, wraps[1])[:, None]
    pieces = _pieces(x, y)
    totals = np.zeros((len(x), 3))
    for low, high, chosen in _bands(pieces.row, width):
        band = _Band(texture, low, high - low + 2)
        p = pieces
        sums = np.zeros((len(chosen), 3))
        for t in _GAUSS:
            at_x, at_y = p.x[chosen] + t * p.step_x[chosen], p.y[chosen] + t * p.step_y[chosen]
            sums += band.running(at_x, at_y, p.column[chosen], p.row[chosen])
        sums *= p.step_y[chosen, None] / 2.0
        for channel in range(3):
            totals[:, channel] += np.bincount(p.triangle[chosen], sums[:, channel], len(x))
    return totals


def _turns(least: _Floats, count: int, wrap: int) -> _Floats:
    """Translation that moves triangles close to the image, by multiples of its wrapping period."""
    period = wrap_period(count, wrap)
    if period is None:
        return np.zeros(len(least))
    moved: _Floats = np.floor(least / period) * period
    return moved


def _pieces(x: _Floats, y: _Floats) -> _Pieces:
    """All edges, split at grid lines."""
    begin_x, begin_y = x.ravel(), y.ravel()
    step_x, step_y = (np.roll(x, -1, axis=1) - x).ravel(), (np.roll(y, -1, axis=1) - y).ravel()
    edges = np.arange(len(begin_x))
    owners, cuts = [edges], [np.zeros(len(edges))]
    for begin, step in ((begin_x, step_x), (begin_y, step_y)):
        first = np.floor(np.minimum(begin, begin + step)).astype(np.int64) + 1
        count = np.maximum(np.ceil(np.maximum(begin, begin + step)).astype(np.int64) - first, 0)
        owner = np.repeat(edges, count)
        line = first[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        owners.append(owner)
        cuts.append((line - begin[owner]) / step[owner])
    owner, cut = np.concatenate(owners), np.clip(np.concatenate(cuts), 0.0, 1.0)
    order = np.lexsort((cut, owner))
    owner, cut = owner[order], cut[order]
    last = np.append(owner[1:] != owner[:-1], True)
    end = np.where(last, 1.0, np.append(cut[1:], 1.0))
    long = end > cut
    owner, cut, length = owner[long], cut[long], (end - cut)[long]
    middle = cut + length / 2.0
    return _Pieces(
        owner // 3,
        begin_x[owner] + cut * step_x[owner],
        begin_y[owner] + cut * step_y[owner],
        length * step_x[owner],
        length * step_y[owner],
        np.floor(begin_x[owner] + middle * step_x[owner]).astype(np.int64),
        np.floor(begin_y[owner] + middle * step_y[owner]).astype(np.int64),
    )


def _bands(row: _Ints, width: int) -> Iterator[tuple[int, int, _Ints]]:
    """Bands of rows that fit into memory: first and last row, and the pieces in them."""
    high = max(1, _MOST_TEXELS // width)
    number = row // high
    order = np.argsort(number, kind="stable")
    starts = np.flatnonzero(np.diff(number[order], prepend=np.iinfo(np.int64).min))
    for start, stop in zip(starts, [*starts[1:], len(order)], strict=True):
        chosen = order[start:stop]
        yield int(row[chosen].min()), int(row[chosen].max()), chosen


class _Band:
    """Rows of a texture, and their prefix sums."""

    def __init__(self, texture: TextureMeans, first: int, count: int) -> None:
        width = texture.size[0]
        self._first, self._nearest = first, texture.is_nearest
        self._clamped = texture.wraps[0] == layout.TEXTURE_WRAPS["clamp"]
        self._period = wrap_period(width, texture.wraps[0]) or width
        columns, rows = np.arange(self._period)[None], np.arange(first, first + count)[:, None]
        self._values = np.clip(texture.texels(columns, rows), 0.0, 1.0)
        self._sums = np.zeros((count, self._period + 1, 3))
        np.cumsum(self._values, axis=1, out=self._sums[:, 1:])

    def running(self, x: _Floats, y: _Floats, column: _Ints, row: _Ints) -> _Floats:
        """Integral along the row from column 0 to x, at height y, for points in these cells."""
        along, down = (x - column)[:, None], (y - row)[:, None]
        here = self._row(along, column, row - self._first)
        if self._nearest:
            return here
        return here + down * (self._row(along, column, row + 1 - self._first) - here)

    def _row(self, along: _Floats, column: _Ints, row: _Ints) -> _Floats:
        value = self._value(column, row)
        before = self._before(column, row)
        if self._nearest:
            return before + along * value
        # Trapezoidal rule between texel centres: correct for half of the first texel and half of this one
        before = before + (value - self._value(np.zeros_like(column), row)) / 2.0
        return before + along * (value + along / 2.0 * (self._value(column + 1, row) - value))

    def _value(self, column: _Ints, row: _Ints) -> _Floats:
        place = np.clip(column, 0, self._period - 1) if self._clamped else np.mod(column, self._period)
        value: _Floats = self._values[row, place]
        return value

    def _before(self, column: _Ints, row: _Ints) -> _Floats:
        """Sum of the texels from column 0 up to, but excluding, this one."""
        if self._clamped:
            inside = np.clip(column, 0, self._period)
            beyond = (column - inside)[:, None].astype(np.float64)
            return self._sums[row, inside] + beyond * self._value(column, row)
        turns, place = np.divmod(column, self._period)
        sums: _Floats = self._sums[row, place] + turns[:, None].astype(np.float64) * self._sums[row, -1]
        return sums
