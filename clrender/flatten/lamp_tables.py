"""IES files as the kernels read them: intensities by direction, and the distribution of emitted photons."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.angles import sin_cos_degrees
from clrender.flatten.sky import Sun, scene_sun
from clrender.scene.ies import IesProfile

if TYPE_CHECKING:
    from clrender.scene.description import Scene

__all__ = ["LampTable", "LampTables", "lamp_table", "lamp_tables"]

_ROW: Final = 16
_WORD_LIMIT: Final = 2**28
_FAINT: Final = 1e-30
"""Fraction of the largest intensity below which single precision is unreliable."""
_HEAD: Final = {name: at for name, at, _, _ in layout.ROWS["LAMP"]}

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LampTable:
    """One IES file.

    Attributes
    ----------
    words : (N,) float32
        Layout of `kernels/light/lamp.h`, with offsets from the table's beginning; whole rows.
    peak : float
        The largest intensity, candela; 0 if the lamp is dark.
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
    """Tables of a scene's IES files, and the sun's, which is the first.

    Attributes
    ----------
    words : (N,) float32
        The tables, concatenated; a single zero if there are none.
    sun : Sun or None
    row : mapping of str to int
        Row where each table begins, by file name.
    table : mapping of str to LampTable
    profile : mapping of str to IesProfile
    """

    words: NDArray[np.float32]
    sun: Sun | None
    row: Mapping[str, int]
    table: Mapping[str, LampTable]
    profile: Mapping[str, IesProfile]


def lamp_tables(scene: Scene) -> LampTables:
    """The tables of all IES files that a scene names, and of its sun.

    Raises
    ------
    SceneError
        If a file cannot be read.
    """
    rows: dict[str, int] = {}
    tables: dict[str, LampTable] = {}
    profiles: dict[str, IesProfile] = {}
    sun = scene_sun(scene)
    parts: list[NDArray[np.float32]] = [] if sun is None else [sun.words]
    total = sum(len(words) for words in parts)
    for index, light in scene.ies_lights():
        if light.file in tables:
            continue
        profile = scene.ies_profile(index)
        table = lamp_table(profile)
        if total + len(table.words) > _WORD_LIMIT:
            raise SceneError(f"{scene.source}: lights[{index}].file: more intensities than fit; name fewer IES files")
        tables[light.file], profiles[light.file], rows[light.file] = table, profile, total // _ROW
        words = table.words.copy()
        head = words[:_ROW].view(np.uint32)
        for name in ("POLAR", "AZIMUTH", "VALUE", "DROP", "BAND", "CELL"):
            head[_HEAD[name]] += total
        parts.append(words)
        total += len(words)
    return LampTables(np.concatenate(parts) if parts else np.zeros(1, np.float32), sun, rows, tables, profiles)


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
    bands = np.cumsum(mass, axis=1)
    sums = np.append(0.0, np.cumsum(bands[:, -1]))
    flux = float(sums[-1])
    cells = np.zeros((len(polar), len(azimuth)))
    cells[:-1, 1:] = np.divide(bands, bands[:, -1:], out=np.zeros_like(bands), where=bands[:, -1:] > 0.0)
    mean = _mean(mass, sines, cosines, turns[1], steps)

    arrays = {
        "POLAR": polar,
        "AZIMUTH": azimuth,
        "VALUE": values,
        "DROP": drops,
        "BAND": sums / flux if flux > 0.0 else sums,
        "CELL": cells,
    }
    words = np.zeros(-(-(_ROW + sum(array.size for array in arrays.values())) // _ROW) * _ROW, np.float32)
    head, at = words[:_ROW].view(np.uint32), _ROW
    head[_HEAD["LINES"]], head[_HEAD["COLUMNS"]] = values.shape
    for name, array in arrays.items():
        head[_HEAD[name]] = at
        words[at : at + array.size] = array.reshape(-1)
        at += array.size
    lit = np.flatnonzero((values > 0.0).any(axis=1))
    first, last = (max(int(lit[0]) - 1, 0), min(int(lit[-1]) + 1, len(polar) - 1)) if len(lit) else (0, len(polar) - 1)
    return LampTable(words, peak, flux, mean, float(cosines[first]), float(cosines[last]))


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
