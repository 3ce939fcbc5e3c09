"""Means of emission textures, for the power of textured lights: kept from one edit of a scene to the next.

They are computed for the picture as it is, and multiplied by the light's strength. So that a light has the same bits
whether its strength was edited or read from a file, single precision decides: where rounding errors could change a
number in single precision, the mean is computed again from the scaled texels.
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.texel_table import wrap_period
from clrender.flatten.texture_means import MOST_POINTS, SUMMED, TextureMeans
from clrender.flatten.texture_rows import FlatTextures

__all__ = ["EmissionMeans"]

_Floats: TypeAlias = NDArray[np.float64]
_Arrays: TypeAlias = tuple[NDArray[Any], ...]
_KEPT_BYTES: Final = 64 << 20
_ROUNDING: Final = float(np.finfo(np.float64).eps)


class _Kept:
    """Results by the hash of what they were computed from; beyond a number of bytes the oldest ones are dropped."""

    def __init__(self, most: int) -> None:
        self._most, self._bytes = most, 0
        self._results: OrderedDict[bytes, _Arrays] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: bytes, compute: Callable[[], _Arrays]) -> _Arrays:
        with self._lock:
            if key in self._results:
                self._results.move_to_end(key)
                return self._results[key]
        result = compute()
        for array in result:
            array.flags.writeable = False
        with self._lock:
            if key not in self._results:
                self._results[key] = result
                self._bytes += sum(array.nbytes for array in result)
            while self._bytes > self._most:
                _, dropped = self._results.popitem(last=False)
                self._bytes -= sum(array.nbytes for array in dropped)
        return result


_KEPT: Final = _Kept(_KEPT_BYTES)


class EmissionMeans:
    """Means of one emission texture. In single precision they are those of `TextureMeans`, bit for bit.

    Parameters
    ----------
    textures : FlatTextures
        Textures of a scene.
    number : int
        Index of the texture.
    """

    def __init__(self, textures: FlatTextures, number: int) -> None:
        self._scaled = TextureMeans(textures, number)
        row = textures.rows[number]
        self._scale = row[12:15].astype(np.float64)
        rows = textures.rows.copy()
        rows[number, 12:15] = 1.0
        self._plain = TextureMeans(replace(textures, rows=rows), number)
        self._name = b"".join(
            (textures.sha256.encode(), row[:4].tobytes(), row[6:12].tobytes(), self._plain.table.decoding.tobytes())
        )

    @property
    def uv_set(self) -> int:
        """Index of the set of texture coordinates that it uses."""
        return self._plain.uv_set

    def whole(self) -> tuple[_Floats, float, float]:
        """Mean over the image, (3,), and its smallest and largest number."""
        plain, least, most, lit = self._whole()
        mean = plain * self._scale
        if _unsure(mean, 2.0 * _ROUNDING * (SUMMED + len(lit)) * mean).any():
            mean = self._scaled.whole()[0]
        bounds = np.concatenate([least * self._scale, most * self._scale])
        return mean, float(bounds.min()), float(bounds.max())

    def sphere(self) -> _Floats:
        """Mean over a sphere, (3,)."""
        return self._get(b"sphere", self._scale.tobytes(), lambda: (self._scaled.sphere(),))[0]

    def disk(self) -> _Floats:
        """Mean over the disk inscribed in the unit square, (3,)."""
        return self._get(b"disk", self._scale.tobytes(), lambda: (self._scaled.disk(),))[0]

    def triangles(self, corners: NDArray[np.float32]) -> _Floats:
        """Mean over each triangle, (T, 3), whose corners have these texture coordinates, (T, 3, 2)."""
        plain: _Floats = self._get(b"triangles", corners.tobytes(), lambda: (self._triangles(corners),))[0]
        most = float(self._whole()[2].max())
        means: _Floats = plain * self._scale
        # Of up to MOST_POINTS additions, and of the interpolation between texels; a sum of 0 is one of zeros only
        errors = np.where(plain == 0.0, 0.0, _ROUNDING * self._scale * (2.0 * MOST_POINTS * plain + 16.0 * most))
        unsure = _unsure(means, errors).any(axis=1) & bool((self._scale != 1.0).any())
        if unsure.any():
            means[unsure] = self._scaled.triangles(corners[unsure])
        return means

    def _triangles(self, corners: NDArray[np.float32]) -> _Floats:
        """Means without the scale. Many pictures are mostly black: triangles on black texels are not sampled."""
        means = np.zeros((len(corners), 3))
        lit = ~self._dark(corners.astype(np.float64))
        means[lit] = self._plain.triangles(corners[lit])
        return means

    def _dark(self, corners: _Floats) -> NDArray[np.bool_]:
        """Which triangles are surely on black texels only, by a summed-area table of the tiles that are not black."""
        lit, (across, down) = self._whole()[3], self._plain.table.tile
        width, height = self._plain.size
        tiles = lit.reshape(-(-height // down), -(-width // across))
        table = np.zeros((tiles.shape[0] + 1, tiles.shape[1] + 1), np.int64)
        table[1:, 1:] = np.cumsum(np.cumsum(tiles, axis=0, dtype=np.int64), axis=1)
        known = np.ones(len(corners), bool)
        ranges: list[NDArray[np.int64]] = []
        reach = 2.0 + self._plain.place_error(corners)  # a texel by the filter, and one by rounding
        for at, size, side, wrap in zip(
            self._plain.place(corners[..., 0], corners[..., 1]), (width, height), (across, down), self._plain.wraps,
            strict=True,
        ):  # fmt: skip
            low, high = at.min(axis=1) - reach, at.max(axis=1) + reach
            period = wrap_period(size, wrap)
            if period is None:
                low, high = np.clip(low, 0, size - 1), np.clip(high, 0, size - 1)
            elif period == size:
                turns = np.floor(low / size) * size
                low, high = low - turns, high - turns
            inside = (low >= 0) & (high < size)
            known &= inside
            ranges.append((np.where(inside, [low, high], 0.0) // side).astype(np.int64))
        (x0, x1), (y0, y1) = ranges
        count = table[y1 + 1, x1 + 1] - table[y0, x1 + 1] - table[y1 + 1, x0] + table[y0, x0]
        dark: NDArray[np.bool_] = known & (count == 0)
        return dark

    def _whole(self) -> _Arrays:
        return self._get(b"whole", b"", self._plain.whole)

    def _get(self, kind: bytes, more: bytes, compute: Callable[[], _Arrays]) -> _Arrays:
        return _KEPT.get(hashlib.sha256(b" ".join((kind, self._name, more))).digest(), compute)


def _unsure(means: _Floats, errors: _Floats) -> NDArray[np.bool_]:
    """Which numbers may have another value in single precision."""
    different: NDArray[np.bool_] = (means - errors).astype(np.float32) != (means + errors).astype(np.float32)
    return different
