"""Grids of densities as files that Mitsuba reads."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import IO

import numpy as np

from clrender.grids import GridData

__all__ = ["write_vol"]


def write_vol(file: IO[bytes], grid: GridData, factors: Sequence[float]) -> None:
    """Write a ``.vol`` file.

    Parameters
    ----------
    file : binary file
    grid : GridData
    factors : sequence of float
        One for each channel, by which its numbers are multiplied; of colours three.
    """
    nz, ny, nx = grid.sides
    file.write(struct.pack("<3sBi3ii6f", b"VOL", 3, 1, nx, ny, nz, len(factors), 0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
    for sheet in grid.values:
        numbers = [sheet] * len(factors) if sheet.ndim == 2 else [sheet[..., k] for k in range(len(factors))]
        channels = [each * np.float32(factor) for each, factor in zip(numbers, factors, strict=True)]
        file.write(np.ascontiguousarray(np.stack(channels, axis=-1), "<f4").data)
