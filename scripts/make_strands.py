"""Writes the strands in scenes/; they are committed, and the same bytes come out on every machine.

Run ``python scripts/make_strands.py`` to write them, with ``--check`` to compare them with what is committed.
"""

from __future__ import annotations

import argparse
import io
import sys
from pathlib import Path
from typing import Final

import numpy as np
from make_clouds import noise
from numpy.typing import NDArray

__all__ = ["UNIT", "down", "main"]

ROOT: Final = Path(__file__).resolve().parent.parent
UNIT: Final = 5e-6
"""Metres that 1 stands for: files hold numbers of 16 bits."""
_Floats = NDArray[np.float64]
_STRANDS: Final = 9000
_POINTS: Final = 5
_BALL: Final = 0.098


def _unit(vectors: _Floats) -> _Floats:
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    units: _Floats = vectors / np.sqrt((x * x + y * y) + z * z)[..., None]
    return units


def _ways(count: int) -> _Floats:
    """(count, 3) unit vectors, evenly spread: points of a ball in which a lattice of low discrepancy fills the cube."""
    numbers = np.arange(1, 3 * count + 1, dtype=np.float64)
    # Powers of one over the root of x^4 = x + 1 (Roberts's generalised golden ratio)
    lattice = np.stack(
        [(numbers * share) % 1.0 for share in (0.8191725133961645, 0.6710436067037893, 0.5497004779019703)], -1
    )
    cube = 2.0 * lattice - 1.0
    square = (cube[:, 0] * cube[:, 0] + cube[:, 1] * cube[:, 1]) + cube[:, 2] * cube[:, 2]
    return _unit(cube[(square < 1.0) & (square > 0.04)][:count])


def down() -> _Floats:
    """(strands, points, 4) of the down of a ball: they lean over in tufts and hang, thinner at their tips; metres."""
    way = _ways(_STRANDS)
    bend = np.stack([noise(way * 5.0 + 40.0, seed) for seed in (31, 32, 33)], axis=-1) - 0.5
    loose = np.stack([noise(way * 90.0 + 400.0, seed) for seed in (41, 42, 43)], axis=-1) - 0.5
    length = 0.0062 + 0.0035 * noise(way * 30.0 + 90.0, 51) + 0.001 * way[:, 1]
    # Bare where the eyes and the bill are
    face = (way[:, 2] > 0.75) & (way[:, 1] > 0.05) & (way[:, 1] < 0.6)
    length = np.where(face, 0.55 * length, length)
    rows = np.zeros((_STRANDS, _POINTS, 4))
    place, direction = way * _BALL, _unit(way + 0.9 * bend + 0.5 * loose)
    for number in range(_POINTS):
        rows[:, number, :3] = place
        rows[:, number, 3] = 0.00021 * (1.0 - 0.8 * number / (_POINTS - 1))
        direction = _unit(direction + 0.22 * bend + np.array([0.0, -0.14, 0.0]))
        place = place + length[:, None] * direction
    return rows


def main(arguments: list[str] | None = None) -> int:
    """Write or check the file; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare with what is committed")
    check = parser.parse_args(arguments).check
    file, path = io.BytesIO(), ROOT / "scenes" / "down.npy"
    np.lib.format.write_array(file, np.floor(down() / UNIT + 0.5).astype("<i2"), version=(1, 0))
    if not check:
        path.write_bytes(file.getvalue())
    elif not path.is_file() or path.read_bytes() != file.getvalue():
        print("down.npy is not what scripts/make_strands.py makes; run it")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
