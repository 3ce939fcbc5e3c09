"""Lamps by direction as the kernels read them: intensities of IES files, and the distribution of emitted photons."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.angles import sin_cos_degrees
from clrender.flatten.plugin_lights import Emitted
from clrender.flatten.sky import Sun
from clrender.scene.ies import IesProfile

__all__ = ["LAMP_ROW", "Key", "LampTable", "LampTables", "lamp_table", "light_shares", "moved_words", "packed_words"]

LAMP_ROW: Final = 16
"""Words in a row."""
_FAINT: Final = 1e-30
"""Fraction of the largest intensity below which single precision is unreliable."""
_HEAD: Final = {name: at for name, at, _, _ in layout.ROWS["LAMP"]}

_Floats = NDArray[np.float64]
Key: TypeAlias = tuple[str | float | bool, ...]
"""What a table depends on: the name of the file first."""


@dataclass(frozen=True)
class LampTable:
    """One IES file, or the picture of one projector.

    Attributes
    ----------
    words : (N,) float32
        Layout of `kernels/light/lamp.h`, with offsets from the table's beginning; whole rows.
    peak : float
        The largest intensity, candela, or value of the picture; 0 if the lamp is dark.
    flux : float
        Integral of intensity / `peak` over solid angle, steradians.
    mean : (3,) float64
        Approximate mean direction of its light in the lamp's frame, whose axes are horizontal angle 0, 90, and down.
    least, most : float
        Cosines of the smallest and of the largest vertical angle of a direction with light.
    """

    words: NDArray[np.float32]
    peak: float
    flux: float
    mean: _Floats
    least: float
    most: float


@dataclass(frozen=True)
class LampTables:
    """Tables of a scene's IES files, projectors and lights of plugins, and the sun's, which is the first.

    Attributes
    ----------
    words : (N,) float32
        The tables, concatenated; a single zero if there are none.
    sun : Sun or None
    row : mapping of (str, ...) to int
        Row where each table begins, by the name of its file and what else it depends on.
    table : mapping of (str, ...) to LampTable
    profile : mapping of str to IesProfile
        By file name.
    given : mapping of int to (int, Emitted)
        Of lights of plugins, by their index: the row where theirs begin, and what they give.
    """

    words: NDArray[np.float32]
    sun: Sun | None
    row: Mapping[Key, int]
    table: Mapping[Key, LampTable]
    profile: Mapping[str, IesProfile]
    given: Mapping[int, tuple[int, Emitted]] = field(default_factory=dict)


def lamp_table(profile: IesProfile) -> LampTable:
    """Table of one IES file."""
    horizontal, candela = profile.horizontal, profile.candela
    if len(horizontal) == 1:
        horizontal, candela = np.array([0.0, 360.0]), np.repeat(candela, 2, axis=1)
    peak = float(candela.max())
    shares = candela / (peak if peak > 0.0 else 1.0)
    values = np.where(shares < _FAINT, 0.0, shares).astype(np.float32)
    polar, azimuth = (profile.vertical / 360.0).astype(np.float32), (horizontal / 360.0).astype(np.float32)
    turns = [np.array([sin_cos_degrees(360.0 * float(t)) for t in angles]) for angles in (polar, azimuth)]
    sines, cosines = turns[0].T
    half = np.array([sin_cos_degrees(180.0 * float(t))[0] for t in polar])
    drops = (2.0 * (half * half)).astype(np.float32)

    # Integrals over each cell between two vertical and two horizontal angles
    light = values.astype(np.float64)
    before, after = _weights(polar.astype(np.float64) * (2.0 * math.pi), sines, cosines)
    along = (light[:, :-1] + light[:, 1:]) * 0.5
    steps = np.diff(azimuth.astype(np.float64)) * (2.0 * math.pi)
    pieces = before[:, None] * along[:-1] + after[:, None] * along[1:]
    mass = np.where((np.diff(drops) > 0.0)[:, None], pieces * steps, 0.0)
    bands, cells, flux = light_shares(mass)
    mean = _mean(mass, sines, cosines, turns[1], steps)

    arrays = {
        "LINE": polar,
        "COLUMN": azimuth,
        "VALUE": values,
        "DROP": drops,
        "BAND": bands,
        "CELL": cells,
    }
    words = packed_words(arrays, values.shape)
    lit = np.flatnonzero((values > 0.0).any(axis=1))
    first, last = (max(int(lit[0]) - 1, 0), min(int(lit[-1]) + 1, len(polar) - 1)) if len(lit) else (0, len(polar) - 1)
    return LampTable(words, peak, flux, mean, float(cosines[first]), float(cosines[last]))


def light_shares(mass: _Floats) -> tuple[_Floats, _Floats, float]:
    """How the light of the cells between lines and columns is distributed.

    Parameters
    ----------
    mass : (H - 1, W - 1) float64
        Light of each cell.

    Returns
    -------
    bands : (H,) float64
        Share of all light before each line; zeros if there is none.
    cells : (H, W) float64
        Of the light from each line to the next, the share before each column. The last line has none.
    total : float
        All light.
    """
    along = np.cumsum(mass, axis=1)
    sums = np.append(0.0, np.cumsum(along[:, -1]))
    total = float(sums[-1])
    cells = np.zeros((len(mass) + 1, mass.shape[1] + 1))
    cells[:-1, 1:] = np.divide(along, along[:, -1:], out=np.zeros_like(along), where=along[:, -1:] > 0.0)
    return (sums / total if total > 0.0 else sums), cells, total


def packed_words(arrays: Mapping[str, NDArray[Any]], shape: tuple[int, ...], even: bool = False) -> NDArray[np.float32]:
    """A head of one row, which says where each of the arrays begins, and the arrays, in whole rows.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        By `LAMP_ROW_*`.
    shape : (int, int)
        Lines and columns.
    even : bool
        See `LAMP_ROW_EVEN`.
    """
    words = np.zeros(-(-(LAMP_ROW + sum(array.size for array in arrays.values())) // LAMP_ROW) * LAMP_ROW, np.float32)
    head, at = words[:LAMP_ROW].view(np.uint32), LAMP_ROW
    head[_HEAD["LINES"]], head[_HEAD["COLUMNS"]], head[_HEAD["EVEN"]] = *shape, even
    for name, array in arrays.items():
        head[_HEAD[name]] = at
        words[at : at + array.size] = array.reshape(-1)
        at += array.size
    return words


def moved_words(words: NDArray[np.float32], by: int) -> NDArray[np.float32]:
    """The words of a table that does not begin at 0, but `by` words later."""
    moved = words.copy()
    head = moved[:LAMP_ROW].view(np.uint32)
    for name in ("LINE", "COLUMN", "VALUE", "DROP", "BAND", "CELL"):
        head[_HEAD[name]] += by
    return moved


def _weights(angles: _Floats, sines: _Floats, cosines: _Floats) -> tuple[_Floats, _Floats]:
    """Integrals of the sine between adjacent angles, weighted linearly from 1 to 0, and from 0 to 1."""
    slope = np.diff(sines) / np.diff(angles)
    return np.maximum(cosines[:-1] - slope, 0.0), np.maximum(slope - cosines[1:], 0.0)


def _mean(mass: _Floats, sines: _Floats, cosines: _Floats, turns: _Floats, steps: _Floats) -> _Floats:
    """Approximate mean direction, where each cell has the mean of its edges."""
    total = float(np.cumsum(mass)[-1])
    if total == 0.0:
        return np.zeros(3)
    across, down = (sines[:-1] + sines[1:]) * 0.5, (cosines[:-1] + cosines[1:]) * 0.5
    x, y = np.diff(turns[:, 0]) / steps, -np.diff(turns[:, 1]) / steps
    parts = mass * across[:, None] * x, mass * across[:, None] * y, mass * down[:, None]
    return np.array([float(np.cumsum(part)[-1]) for part in parts]) / total
