"""Values of a texture's texels, one array a channel, from positions that two small tables give for columns and rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.image.texel_tiles import tile_shape

if TYPE_CHECKING:
    from clrender.flatten.texture_rows import FlatTextures

__all__ = ["TexelTable", "wrap_period"]

_Floats: TypeAlias = NDArray[np.float64]
_Ints: TypeAlias = NDArray[np.int64]


class TexelTable:
    """Texels of one texture, in double precision, also beyond the edges of the image.

    A position is the index of a texel among all texels of its size. It is the sum of a term of the column and a term of
    the row, so that it takes no arithmetic of tiles for each texel.

    Parameters
    ----------
    textures : FlatTextures
        Textures of a scene.
    number : int
        Index of the texture.

    Attributes
    ----------
    first : int
        Position of the image's first tile.
    per_tile : int
        Texels in a tile.
    count : int
        Texels in all tiles of the image; those beyond its edges are 0.
    tile : (int, int)
        Columns and rows of a tile.
    decoding : (256,) or (65536,) float64
        Values of numbers of 8 and 16 bits; else empty.
    """

    def __init__(self, textures: FlatTextures, number: int) -> None:
        row = textures.rows[number]
        bits = row.view(np.uint32)
        form = int(bits[3])
        width, height = int(bits[1]), int(bits[2])
        across, down = self.tile = tile_shape(form & 7)
        self.per_tile, tiles_across = across * down, -(-width // across)
        self.first, self.count = int(bits[0]) * self.per_tile, tiles_across * -(-height // down) * self.per_tile
        self._columns = _Axis(width, form >> 5 & 3, lambda x: x // across * self.per_tile + x % across)
        self._rows = _Axis(
            height, form >> 7 & 3, lambda y: self.first + y // down * (tiles_across * self.per_tile) + y % down * across
        )
        self._numbers = 4 if form & layout.TEXEL_FOUR else 1
        size = (1 << (form & 7)) // self._numbers
        self._stored = textures.texels.reshape(-1).view({1: "u1", 2: "<u2", 4: "<f4"}[size])
        channel, self._scale = form >> 11 & 7, row[12:15].astype(np.float64)
        is_alpha = channel == layout.TEXTURE_CHANNELS["a"]
        self._ones = is_alpha and self._numbers == 1
        self._luminance = channel == layout.TEXTURE_CHANNELS["luminance"] and self._numbers == 4
        picked = [channel - 1] * 3 if channel in (1, 2, 3, 4) else [0, 1, 2]
        self._channels = [each % self._numbers for each in picked]
        self.decoding: _Floats = np.zeros(0)
        if not form & layout.TEXEL_FLOAT:
            begins = int(bits[5 if is_alpha else 4])
            with np.errstate(invalid="ignore"):  # halves that are no numbers
                self.decoding = textures.values[begins : begins + (1 << 8 * size)].astype(np.float64)

    def position(self, column: _Ints, row: _Ints) -> _Ints:
        """Positions of texels by column and row."""
        return self._columns.here(column) + self._rows.here(row)

    def corners(self, column: _Ints, row: _Ints) -> tuple[_Ints, _Ints, _Ints, _Ints]:
        """Positions of the texels at (column, row), right of it, below it, and right below it."""
        left, right = self._columns.pair(column)
        above, below = self._rows.pair(row)
        return left + above, right + above, left + below, right + below

    def at(self, position: _Ints) -> list[_Floats]:
        """Values at positions: a channel each, or the same array three times."""
        if self._ones:
            numbers = [np.ones(position.shape)] * 3
        elif self._luminance:
            r, g, b = (self._number(position, channel) for channel in range(3))
            numbers = [(r * 0.2126 + g * 0.7152) + b * 0.0722] * 3
        else:
            known = {channel: self._number(position, channel) for channel in set(self._channels)}
            numbers = [known[channel] for channel in self._channels]
        if self.is_grey:
            return [numbers[0] * self._scale[0]] * 3
        return [number * scale for number, scale in zip(numbers, self._scale, strict=True)]

    def lit_tiles(self, first: int, last: int) -> NDArray[np.bool_]:
        """Which tiles may hold a value other than 0, (tiles,), among texels `first` to `last` (exclusive) of the image.

        It is known from the stored bytes alone, without decoding them: most texels of many emission textures are black.
        """
        tiles = (last - first) // self.per_tile
        if self._ones or (len(self.decoding) and self.decoding[0] != 0.0):
            return np.ones(tiles, bool)
        used = [0, 1, 2] if self._luminance else self._channels
        mask = np.zeros((self.per_tile, self._numbers, self._stored.itemsize), np.uint8)
        mask[:, used] = 255
        begin = (self.first + first) * self._numbers
        words = self._stored[begin : begin + tiles * self.per_tile * self._numbers].view(np.uint64)
        lit = np.bitwise_or.reduce(words.reshape(tiles, -1) & mask.reshape(-1).view(np.uint64), axis=1)
        return np.asarray(lit != 0)

    @property
    def is_grey(self) -> bool:
        """Whether all channels are the same."""
        same = self._ones or self._luminance or len(set(self._channels)) == 1
        return same and len(set(self._scale.tolist())) == 1

    def _number(self, position: _Ints, channel: int) -> _Floats:
        """Decoded numbers of one channel, without the scale."""
        raw = self._stored.take(position if self._numbers == 1 else position * self._numbers + channel)
        return self.decoding.take(raw) if len(self.decoding) else raw.astype(np.float64)


def wrap_period(size: int, wrap: int) -> int | None:
    """Texels after which an axis repeats itself; None: it goes on as it ends.

    Parameters
    ----------
    size : int
        Texels of the image along it.
    wrap : int
        One of `layout.TEXTURE_WRAPS`.
    """
    modes = layout.TEXTURE_WRAPS
    return {modes["repeat"]: size, modes["mirror"]: 2 * size, modes["clamp"]: None}[wrap]


class _Axis:
    """Terms of positions along one axis, by column or row."""

    def __init__(self, count: int, wrap: int, term: Callable[[_Ints], _Ints]) -> None:
        period = wrap_period(count, wrap)
        self._count, self._clamped, self._period = count, period is None, period or count
        # Of a clamped axis from -1 on, whose neighbour is the first texel
        at = np.arange(-1 if self._clamped else 0, self._period + 1)
        at = np.clip(at, 0, count - 1) if self._clamped else at % self._period
        self._terms = term(np.where(at < count, at, 2 * count - 1 - at))

    def here(self, at: _Ints) -> _Ints:
        return self._terms.take(self._index(at))

    def pair(self, at: _Ints) -> tuple[_Ints, _Ints]:
        """Terms of these and of the next columns or rows."""
        index = self._index(at)
        return self._terms.take(index), self._terms.take(index + 1)

    def _index(self, at: _Ints) -> _Ints:
        if self._clamped:
            return np.clip(at, -1, self._count - 1) + 1
        if self._period & (self._period - 1) == 0:
            return at & (self._period - 1)
        index: _Ints = np.mod(at, self._period)
        return index
