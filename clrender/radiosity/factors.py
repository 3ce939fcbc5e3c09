"""Form factors: the fraction of the power leaving one side of a patch that arrives at another, as a sparse matrix."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import UsageError

__all__ = ["FormFactors", "factors_of_hits", "hemicube_cells"]

_CHUNK_ROWS: Final = 2048

_Floats = NDArray[np.float64]
_Uints = NDArray[np.uint32]


@dataclass(frozen=True)
class FormFactors:
    """A sparse matrix by rows: one row per side in use, one column per side and a last one for the environment.

    Attributes
    ----------
    sides : (r,) uint32
        Side of each row.
    row, column : (z,) int64
        Row and column of each entry; rows ascend, and columns within a row.
    value : (z,) float64
        F from the row's side to the column's.
    columns : int
        2 n + 1.
    """

    sides: _Uints
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    value: _Floats
    columns: int

    def gathered(self, sent: _Floats) -> _Floats:
        """Irradiance / π of each row from the radiance of the columns: F times a matrix.

        Sums go entry by entry in a fixed order, so the result is the same bits on every machine.

        Parameters
        ----------
        sent : (columns, channels) float64

        Returns
        -------
        (r, channels) float64
        """
        rows = len(self.sides)
        parts = [
            np.bincount(self.row, weights=self.value * channel[self.column], minlength=rows)
            for channel in np.ascontiguousarray(sent.T)
        ]
        return np.stack(parts, axis=1) if rows else np.zeros((0, sent.shape[1]))

    def row_sums(self) -> _Floats:
        """(r,) float64: total form factor to other sides; 1 where the environment is not visible."""
        inside = np.where(self.column < self.columns - 1, self.value, 0.0)
        return np.bincount(self.row, weights=inside, minlength=len(self.sides)).astype(np.float64)


def factors_of_hits(
    sides: _Uints, hits: _Uints, columns: int, weights: NDArray[np.float64] | None = None
) -> FormFactors:
    """Form factors from the hits of rays, counted.

    Parameters
    ----------
    sides : (r,) uint32
    hits : (r, rays) uint32
        Sides met, below `columns`.
    columns : int
    weights : (rays,) float64, optional
        Weight of each ray, summing to 1; default: equal weights.
    """
    rays = hits.shape[1]
    rows, cols, values = [], [], []
    for start in range(0, len(sides), _CHUNK_ROWS):
        some = hits[start : start + _CHUNK_ROWS].astype(np.int64)
        key = some + np.arange(start, start + len(some))[:, None] * columns
        if weights is None:
            key = np.sort(key, axis=1).ravel()  # rows are in order already, so this sorts the whole
            at = np.flatnonzero(np.diff(key, prepend=-1))
            amount = np.diff(at, append=key.size) / rays
        else:
            key, inverse = np.unique(key.ravel(), return_inverse=True)
            at = np.arange(len(key))
            amount = np.bincount(inverse.ravel(), weights=np.tile(weights, len(some)))
        rows.append(key[at] // columns)
        cols.append(key[at] % columns)
        values.append(amount)
    if not rows:
        empty = np.zeros(0, np.int64)
        return FormFactors(sides, empty, empty, np.zeros(0), columns)
    return FormFactors(sides, np.concatenate(rows), np.concatenate(cols), np.concatenate(values), columns)


def hemicube_cells(side: int) -> tuple[NDArray[np.float32], _Floats]:
    """Directions and form factors of the cells of a hemicube (Cohen & Greenberg 1985).

    Parameters
    ----------
    side : int
        Cells along an edge of the top face, even.

    Returns
    -------
    cells : (c, 4) float32
        Through the middle of each cell; z is the normal.
    factors : (c,) float64
        Their delta form factors, scaled to add up to 1.

    Raises
    ------
    UsageError
        If the number is odd or too small.
    """
    if side < 2 or side % 2:
        raise UsageError(f"a hemicube cannot have {side} cells along an edge; take an even number")
    middles = (np.arange(side) + 0.5) * 2.0 / side - 1.0
    x, y = (grid.ravel() for grid in np.meshgrid(middles, middles, indexing="ij"))
    area = 4.0 / (side * side)
    top = np.stack([x, y, np.ones_like(x)], axis=1)
    square = x * x + y * y + 1.0
    top_factors = area / (math.pi * (square * square))
    upper = y > 0.0
    along, z = x[upper], y[upper]
    square = along * along + z * z + 1.0
    side_factors = z * area / (math.pi * (square * square))
    one = np.ones_like(along)
    faces = [
        np.stack([one, along, z], 1),
        np.stack([-one, along, z], 1),
        np.stack([along, one, z], 1),
        np.stack([along, -one, z], 1),
    ]
    directions = np.concatenate([top, *faces])
    factors = np.concatenate([top_factors, *[side_factors] * 4])
    cells = np.zeros((len(directions), 4), np.float32)
    cells[:, :3] = directions
    return cells, factors / factors.sum()
