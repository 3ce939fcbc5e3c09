"""Writes the grids of densities in scenes/, and where a sky has its clouds; the same bytes come out on every machine.

Run ``python scripts/make_clouds.py`` to write them, with ``--check`` to compare them with what is committed.
"""

from __future__ import annotations

import argparse
import io
import math
import random
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["GRIDS", "PLACES", "main"]

ROOT: Final = Path(__file__).resolve().parent.parent
_Floats = NDArray[np.float64]


def _hashed(x: NDArray[np.int64], y: NDArray[np.int64], z: NDArray[np.int64], seed: int) -> _Floats:
    """A number from 0 to 1 of each point of a lattice."""
    bits = (x * 73856093 ^ y * 19349663 ^ z * 83492791 ^ seed * 2654435761) & 0xFFFFFFFF
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        bits = ((bits ^ bits >> shift) * factor) & 0xFFFFFFFF
    hashed: _Floats = (bits ^ bits >> 16) / 4294967296.0
    return hashed


def noise(points: _Floats, seed: int) -> _Floats:
    """Smooth noise with one number a unit, from 0 to 1, at points (..., 3)."""
    cell = np.floor(points).astype(np.int64)
    share = points - cell
    share = share * share * (3.0 - 2.0 * share)
    total = np.zeros(points.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        weights = np.where(np.array(corner) == 1, share, 1.0 - share)
        x, y, z = (cell[..., axis] + corner[axis] for axis in range(3))
        total += weights[..., 0] * weights[..., 1] * weights[..., 2] * _hashed(x, y, z, seed)
    return total


def billows(points: _Floats, seed: int, octaves: int) -> _Floats:
    """Noise of several sizes, each half as large and half as strong: from 0 to 1."""
    total, weight = np.zeros(points.shape[:-1]), 1.0
    for octave in range(octaves):
        total += weight * noise(points * 2.0**octave + 17.0 * octave, seed + octave)
        weight *= 0.5
    return total / (2.0 - 2.0 * weight)


def _points(nx: int, ny: int, nz: int) -> _Floats:
    """(nz, ny, nx, 3) middles of the cells, the longest side from 0 to 1."""
    z, y, x = np.mgrid[:nz, :ny, :nx] + 0.5
    points: _Floats = np.stack([x, y, z], axis=-1) / max(nx, ny, nz)
    return points


_PUFFS: Final = (
    *((0.24, 0.10, 0.38, 0.15), (0.40, 0.13, 0.36, 0.18), (0.58, 0.12, 0.40, 0.19), (0.75, 0.10, 0.36, 0.15)),
    *((0.34, 0.12, 0.52, 0.16), (0.52, 0.12, 0.55, 0.16), (0.68, 0.11, 0.52, 0.14), (0.46, 0.24, 0.44, 0.16)),
    *((0.60, 0.27, 0.44, 0.15), (0.52, 0.39, 0.44, 0.12), (0.36, 0.24, 0.42, 0.11), (0.71, 0.21, 0.43, 0.11)),
    *((0.14, 0.07, 0.40, 0.08), (0.86, 0.07, 0.42, 0.08), (0.60, 0.40, 0.45, 0.09), (0.44, 0.42, 0.44, 0.08)),
)
"""Balls that a cumulus is made of: middle and radius."""


def cumulus() -> _Floats:
    """(72, 56, 96) densities of a fair-weather cloud with a flat base."""
    points = _points(96, 56, 72)
    warped = points + 0.05 * (np.stack([billows(points * 7.0, seed, 3) for seed in (11, 12, 13)], axis=-1) - 0.5)
    inside = np.full(points.shape[:-1], -1.0)
    for x, y, z, radius in _PUFFS:
        away = warped - np.array([x, y, z])
        inside = np.maximum(inside, radius - np.sqrt((away * away).sum(axis=-1)))
    lumps = 1.0 - np.abs(2.0 * billows(warped * 9.0, 3, 4) - 1.0) * 2.0
    edge = inside + 0.07 * (lumps - 0.62)
    base = np.clip((points[..., 1] - 0.03 - 0.02 * billows(points * 9.0, 5, 2)) * 30.0, 0.0, 1.0)
    densities: _Floats = np.clip(edge * 22.0, 0.0, 1.0) * base
    return densities


def plume() -> _Floats:
    """(60, 140, 60) densities of smoke that rises from a point, turns over itself and thins out."""
    points = _points(60, 140, 60)
    height = points[..., 1]
    sway = np.stack([billows(np.stack([0 * height + 3.7, height * 4.0 - 1.3, 0 * height + seed], axis=-1), seed, 2)
                     for seed in (21, 22)], axis=-1) - 0.5  # fmt: skip
    curl = np.stack([billows(points * 9.0, seed, 3) for seed in (23, 24)], axis=-1) - 0.5
    across = points[..., [0, 2]] - 0.214 + (0.16 * sway + 0.20 * curl) * height[..., None]
    away = np.sqrt((across * across).sum(axis=-1))
    width = 0.014 + 0.13 * height
    body = np.clip(1.0 - away / width, 0.0, 1.0)
    thin = 0.035 / (0.035 + height * height * 0.5)
    swept = np.stack([across[..., 0], height * 0.35, across[..., 1]], axis=-1) / (0.05 + 0.25 * height[..., None])
    strands = np.clip(1.0 - 5.0 * np.abs(billows(swept * 2.3 + curl[..., [0, 1, 0]] * 1.6, 31, 3) - 0.5), 0.0, 1.0)
    ends = np.clip((0.98 - height) * 5.0, 0.0, 1.0) * np.clip(height * 60.0, 0.0, 1.0)
    densities: _Floats = np.clip(
        body * body * (3.0 - 2.0 * body) * (0.05 + strands * strands) * thin * ends * 1.9, 0.0, 1.0
    )
    return densities


def flame() -> _Floats:
    """(72, 120, 72) heat of a fire whose tongues part as they rise."""
    points = _points(72, 120, 72)
    height = points[..., 1]
    rising = np.stack([points[..., 0] * 5.0, height * 2.2, points[..., 2] * 5.0], axis=-1)
    sway = np.stack([billows(rising + seed, seed, 3) for seed in (41, 42)], axis=-1) - 0.5
    across = points[..., [0, 2]] - 0.3 + 0.55 * sway * (0.1 + height)[..., None]
    away = np.sqrt((across * across).sum(axis=-1))
    width = 0.2 * np.sqrt(1.0 - height) * (1.0 - 0.45 * height) * (0.6 + 0.4 * np.clip(height * 6.0, 0.0, 1.0))
    body = np.clip(1.0 - away / width, 0.0, 1.0)
    licks = billows(np.stack([across[..., 0] * 11.0, height * 4.0, across[..., 1] * 11.0], axis=-1), 51, 4)
    torn = np.clip((licks - 0.36 - 0.34 * height) * 5.0, 0.0, 1.0)
    ends = np.clip((0.99 - height) * 6.0, 0.0, 1.0) * np.clip(height * 40.0, 0.0, 1.0)
    heat: _Floats = np.clip(np.sqrt(body) * torn * ends * (1.05 - 0.45 * height), 0.0, 1.0)
    return heat


GRIDS: Final[Mapping[str, _Floats]] = {"cumulus.npy": cumulus(), "flame.npy": flame(), "plume.npy": plume()}
"""By file name: densities from 0 to 1, of which files have 255 times as much in whole numbers."""


_EYE: Final = 9.0
"""Where the camera of the scene `cloud` is: it looks against z."""
_BASE: Final = 1.35
"""Height of the bases of its clouds, as that of `cumulus.npy` is 0.7: in hundreds of metres."""
_WIDTHS: Final = (0.45, 0.6, 0.9, 1.2, 1.7)


def _placed(scales: tuple[float, float, float], turn: float, to: tuple[float, float, float]) -> _Floats:
    """(3, 4) map: scaled, turned around the y axis, and moved. `turn`: tangent of half the angle."""
    over = 1.0 / (1.0 + turn * turn)
    cosine, sine = (1.0 - turn * turn) * over, 2.0 * turn * over
    turned = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    return np.round(np.concatenate([turned * np.array(scales), np.array(to)[:, None]], axis=1), 4)


def sky(count: int = 60) -> _Floats:
    """(count, 3, 4) maps of clouds that do not meet, the more the nearer to the horizon."""
    numbers, found = random.Random(7), list[_Floats]()
    taken: list[tuple[float, float, float]] = []
    while len(found) < count:
        share = numbers.random()
        z = 2.5 - 45.0 * share * math.sqrt(share)
        x = numbers.uniform(-1.0, 1.0) * (1.0 + 0.62 * (_EYE - z))
        width = numbers.choice(_WIDTHS) * numbers.uniform(0.85, 1.15)
        height = width * numbers.uniform(0.55, 0.8)
        turn = numbers.uniform(-2.0, 2.0)
        if all(math.hypot(x - a, z - b) > 0.85 * (width + other) for a, b, other in taken):
            taken.append((x, z, width))
            found.append(_placed((width, height, width), turn, (x, _BASE - 0.7 * height, z)))
    return np.stack(found)


def trees(count: int = 9) -> _Floats:
    """(count, 3, 4) maps of trees before the horizon."""
    numbers, found = random.Random(12), []
    for _ in range(count):
        away = numbers.choice((0.8, 1.1, 1.5, 2.2, 3.0)) * numbers.uniform(0.9, 1.1)
        x, size, turn = numbers.uniform(-0.55, 0.55) * away, numbers.uniform(0.7, 1.2), numbers.uniform(-2.0, 2.0)
        found.append(_placed((size, size, size), turn, (x, 0.0, _EYE - away)))
    return np.stack(found)


PLACES: Final[Mapping[str, _Floats]] = {"clouds.npy": sky(), "trees.npy": trees()}
"""By file name: (n, 3, 4) transforms of the instances of the scene `cloud`."""


def _contents() -> dict[str, NDArray[np.generic]]:
    grids = {name: np.floor(values * 255.0 + 0.5).astype(np.uint8) for name, values in GRIDS.items()}
    return {**grids, **{name: values.astype(np.float32) for name, values in PLACES.items()}}


def main(arguments: list[str] | None = None) -> int:
    """Write or check the files; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare with what is committed")
    check = parser.parse_args(arguments).check
    wrong = []
    for name, values in _contents().items():
        file = io.BytesIO()
        np.lib.format.write_array(file, values, version=(1, 0))
        path = ROOT / "scenes" / name
        if not check:
            path.write_bytes(file.getvalue())
        elif not path.is_file() or path.read_bytes() != file.getvalue():
            wrong.append(name)
    for name in wrong:
        print(f"{name} is not what scripts/make_clouds.py makes; run it")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
