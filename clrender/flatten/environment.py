"""Environment maps as the table that kernels sample."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.values import Color

__all__ = ["HEAD_WORDS", "EnvironmentTable", "environment_table", "without_light"]

HEAD_WORDS: Final = 16
_CHUNK: Final = 2**19
"""Pixels processed at a time."""
_MANTISSA: Final = 19
_BIAS: Final = 64
_HEAD: Final = {name: at for name, at, _, _ in layout.ROWS["ENVIRONMENT"]}
_BAND: Final = {name: at for name, at, _, _ in layout.ROWS["BAND"]}
_EVEN: Final = 1e-6
"""If the share of luminance above the mean is this small, it may be due to rounding."""
_POWERS: Final = np.ldexp(1.0, np.arange(128) - _BIAS)
"""Unit of the mantissas, by stored exponent."""

_Floats = NDArray[np.float64]
_Number = TypeVar("_Number", float, _Floats)


@dataclass(frozen=True)
class EnvironmentTable:
    """The environment as kernels read it.

    Attributes
    ----------
    radiance : (3,) float
        Mean over all directions, W/(sr m²); black if there is no environment.
    sampled : float
        Share of its luminance that light samples are proportional to; 0 if they must not choose it.
    words : (N,) float32
        As `kernels/light/environment.h` says; a single zero if the radiance is constant.
    """

    radiance: Color
    sampled: float
    words: NDArray[np.float32]

    @classmethod
    def even(cls, radiance: Color, compensated: bool) -> EnvironmentTable:
        """Table of a constant environment; none of it is brighter than the mean."""
        return cls(radiance, 0.0 if compensated else 1.0, np.zeros(1, np.float32))


def environment_table(
    picture: EnvironmentPicture, turn: float, scale: Color, compensated: bool = False
) -> EnvironmentTable:
    """The sampling table of an environment map.

    Parameters
    ----------
    picture : EnvironmentPicture
    turn : float
        Fraction of a turn by which it is rotated about +y, right-handed: from +z towards +x.
    scale : (3,) float
        Factor of its radiance.
    compensated : bool
        Whether light samples leave directions darker than the mean to samples of the BSDF (MIS compensation).

    Returns
    -------
    EnvironmentTable
        About 16 bytes for each pixel.
    """
    height, width, _ = picture.pixels.shape
    table = _Arrays.empty(height, width)
    colors = np.zeros((height, 3))
    for rows in table.chunks():
        held = _packed(picture.pixels[rows], scale, table.pixels[rows, :width, 1:])
        for channel, values in enumerate(held):
            colors[rows, channel] = np.cumsum(values, axis=1)[:, -1]
    table.pixels[:, width, 1:] = table.pixels[:, 0, 1:]
    drops = _drops(height)
    red, green, blue = (float(np.cumsum(_bands(sums, drops))[-1]) / (2.0 * width) for sums in colors.T)
    mean = _luminance(red, green, blue)
    if mean == 0.0:
        return EnvironmentTable.even((0.0, 0.0, 0.0), compensated)
    sampled = _distribute(table, drops, np.float32(mean if compensated else 0.0)) / mean
    table.words[_HEAD["TURN"]] = np.float32(turn) % np.float32(1.0)
    return EnvironmentTable((red, green, blue), sampled if sampled > _EVEN else 0.0, table.words)


def without_light(words: NDArray[np.float32]) -> NDArray[np.float32]:
    """A copy of the table of an environment map that has no radiance, but samples the same directions.

    Parameters
    ----------
    words : (n,) float32
        See `environment_table`.

    Returns
    -------
    (n,) float32
    """
    width, height = (int(words[_HEAD[name] : _HEAD[name] + 1].view(np.uint32)[0]) for name in ("WIDTH", "HEIGHT"))
    dark = _Arrays.of(words.copy(), height, width)
    dark.pixels[..., 1:] = 0
    return dark.words


def _luminance(red: _Number, green: _Number, blue: _Number) -> _Number:
    return (0.2126 * red + 0.7152 * green) + 0.0722 * blue


def _bands(sums: _Floats, drops: NDArray[np.float32]) -> _Floats:
    """Integrals between circles of latitude, weighted by the cosine of the latitude, from the sums of the rows."""
    lines = _lines(sums)
    between: _Floats = (lines[:-1] + lines[1:]) * (0.5 * np.diff(drops.astype(np.float64)))
    return between


def _lines(sums: _Floats) -> _Floats:
    """Sums along circles of latitude; the poles take those of the adjacent rows."""
    return np.concatenate((sums[:1], sums, sums[-1:]))


def _distribute(table: _Arrays, drops: NDArray[np.float32], compensation: np.float32) -> float:
    """Write the sampling distribution; returns its mean over all directions.

    Parameters
    ----------
    table : _Arrays
        Its pixels are already written.
    drops : (H + 2,) float32
    compensation : float32
        Luminance that is subtracted from pixels, down to 0.
    """
    height, width = table.guide.shape[0], table.pixels.shape[1] - 1
    row_sums = np.zeros(height)
    for rows in table.chunks():
        weight = np.maximum(_luminance(*_unpacked(table.pixels[rows, :width, 1:])) - float(compensation), 0.0)
        sums = np.cumsum((weight + np.roll(weight, -1, axis=1)) * 0.5, axis=1)
        table.sums[rows, 1:] = sums
        row_sums[rows] = sums[:, -1]
    line_sums = _lines(row_sums)
    before = np.cumsum(_bands(row_sums, drops))
    if before[-1] == 0.0:
        return 0.0
    shares = np.append(0.0, before / before[-1])
    nearer = np.minimum(np.arange(height + 1), np.arange(height + 1)[::-1])
    for name, first, second in (
        ("SHARE", shares[:-1], shares[1:]),
        ("SUM", line_sums[:-1], line_sums[1:]),
        ("DROP", drops[nearer], drops[nearer + 1]),
    ):
        table.bands[:, _BAND[name]], table.bands[:, _BAND[f"NEXT_{name}"]] = first, second
    _guide(table.bands[:, _BAND["SHARE"]], np.float32(1.0), table.band_guide)
    for sums, guide in zip(table.sums, table.guide, strict=True):
        _guide(sums[:-1], sums[-1], guide)
    mean: float = before[-1] / (2.0 * width)
    table.words[_HEAD["INVERSE"]] = 1.0 / (mean * 4.0 * math.pi)
    table.words[_HEAD["COMPENSATION"]] = compensation
    return mean


@dataclass(frozen=True)
class _Arrays:
    """Views of the parts of a table."""

    words: NDArray[np.float32]
    bands: NDArray[np.float32]
    band_guide: NDArray[np.uint32]
    pixels: NDArray[np.uint32]
    guide: NDArray[np.uint32]

    @property
    def sums(self) -> NDArray[np.float32]:
        """The first word of each pixel: the sum of the luminance before its centre."""
        return self.pixels[..., 0].view(np.float32)

    def chunks(self) -> Iterator[slice]:
        """Slices of rows to process at a time."""
        height, width = self.guide.shape[0], self.pixels.shape[1] - 1
        step = max(1, _CHUNK // width)
        return (slice(top, top + step) for top in range(0, height, step))

    @classmethod
    def empty(cls, height: int, width: int) -> _Arrays:
        return cls.of(np.zeros(sum(map(math.prod, _shapes(height, width))), np.float32), height, width)

    @classmethod
    def of(cls, words: NDArray[np.float32], height: int, width: int) -> _Arrays:
        """Views of a table, whose size is written into it."""
        shapes = _shapes(height, width)
        parts = np.split(words, np.cumsum([math.prod(shape) for shape in shapes[:-1]]))
        head, bands, band_guide, pixels, guide = (
            part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)
        )
        sizes_at = [_HEAD[name] for name in ("WIDTH", "HEIGHT", "BAND_GUIDES", "GUIDES")]
        head.view(np.uint32)[sizes_at] = width, height, len(band_guide) - 1, guide.shape[1] - 1
        return cls(words, bands, band_guide.view(np.uint32), pixels.view(np.uint32), guide.view(np.uint32))


def _shapes(height: int, width: int) -> tuple[tuple[int, ...], ...]:
    """Of the parts of a table."""
    band_guides, guides = _power_of_two(height + 1), _power_of_two(width)
    return (HEAD_WORDS,), (height + 1, 8), (band_guides + 1,), (height, width + 1, 3), (height, guides + 1)


def _power_of_two(count: int) -> int:
    """The largest power of two up to `count`."""
    return 1 << (count.bit_length() - 1)


def _guide(sums: NDArray[np.float32], total: np.float32, guide: NDArray[np.uint32]) -> None:
    """Write a guide table: for each of its fractions of `total`, the last of the ascending `sums` not above it."""
    count = len(guide) - 1
    sought = (np.arange(count + 1) / count).astype(np.float32) * total
    guide[:] = np.maximum(np.searchsorted(sums, sought, side="right"), 1) - 1


def _packed(pixels: NDArray[np.float32], scale: Color, packed: NDArray[np.uint32]) -> list[_Floats]:
    """Write pixels as two words each; returns the radiance that these represent, an array for each channel.

    Three mantissas of 19 bits share an exponent of 7: the error is below 2^-19 of the largest channel.
    """
    channels = [pixels[..., i].astype(np.float64) * scale[i] for i in range(3)]
    largest = np.maximum(np.maximum(channels[0], channels[1]), channels[2])
    # Just below a power of two, a mantissa would round up to 2^19.
    exponent = np.maximum(np.frexp(largest * (1.0 + 2.0**-19))[1], _MANTISSA - _BIAS)
    unit = _POWERS[exponent + (_BIAS - _MANTISSA)]
    for values in channels:
        np.rint(np.divide(values, unit, out=values), out=values)
    red, green, blue = (values.astype(np.uint32) for values in channels)
    shift = (exponent + (_BIAS - _MANTISSA)).astype(np.uint32)
    packed[..., 0] = red | (green << np.uint32(19))
    packed[..., 1] = (green >> np.uint32(13)) | (blue << np.uint32(6)) | (shift << np.uint32(25))
    for values in channels:
        values *= unit
    return channels


def _unpacked(packed: NDArray[np.uint32]) -> list[_Floats]:
    """The radiance that two words represent, an array for each channel."""
    low, high = packed[..., 0], packed[..., 1]
    unit = _POWERS[(high >> np.uint32(25)).astype(np.intp)]
    mask = np.uint32(2**_MANTISSA - 1)
    green = (low >> np.uint32(19)) | ((high << np.uint32(13)) & mask)
    return [values.astype(np.float64) * unit for values in (low & mask, green, (high >> np.uint32(6)) & mask)]


def _drops(height: int) -> NDArray[np.float32]:
    """1 - cosine of the angle from the first pole, for the poles and the rows' centres, (height + 2,).

    Uses a series because NumPy's sine differs between machines.
    """
    half = (height + 1) // 2
    x = (np.arange(half) + 0.5) * (math.pi / (2.0 * height))
    square, sine = x * x, np.ones(half)
    for n in range(19, 1, -2):
        sine = 1.0 - sine * square / (n * (n - 1))
    sine *= x
    near = 2.0 * sine * sine
    drops = np.zeros(height + 2, np.float32)
    drops[1 : half + 1] = near
    drops[height + 1 - half : height + 1] = (2.0 - near)[::-1]
    drops[height + 1] = 2.0
    return drops
