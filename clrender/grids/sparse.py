"""Numbers of a sparse tree, as the dense grid of the box that they are in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.exact.matrices import determinant
from clrender.grids.data import SIDE_LIMIT, VALUE_LIMIT, GridData
from clrender.wording import counted, quoted

__all__ = ["DenseBox", "chosen_grid"]


class _Named(Protocol):
    """What has a name."""

    @property
    def name(self) -> str:
        """Of a grid."""


_Entry = TypeVar("_Entry", bound=_Named)

_ALWAYS_TAKEN: Final = 2**24
_SPARSEST: Final = 1024
"""Numbers of a box for each that is stored; a damaged file may place a few of them far away."""


def chosen_grid(entries: Sequence[_Entry], floats: Sequence[_Entry], name: str, label: str) -> _Entry:
    """The grid of a name, or in the place of a missing density the first one.

    Parameters
    ----------
    entries : sequence
        All grids of a file, each with a `name`.
    floats : sequence
        Those of numbers.
    name : str
    label : str
        Beginning of error messages.

    Raises
    ------
    SceneError
        There is none.
    """
    found = [each for each in floats if each.name == name] or (floats[:1] if name == "density" else [])
    if not found:
        names = ", ".join(ascii(each.name) for each in entries)[:200] or "none"
        text = f"has no grid {quoted(name)} of floats; its grids are {names}"
        raise SceneError(f"{label} {text}; name one of floats, or convert it")
    return found[0]


class DenseBox:
    """A box of numbers, which are 0 until they are filled in, and zeros around it, to which densities fall.

    Parameters
    ----------
    low, high : (3,) int
        First and last coordinates of its numbers.
    stored : int
        About how many numbers the tree has.
    label : str
        Beginning of error messages.
    background : float
        In place of zeros.

    Raises
    ------
    SceneError
        It is too large, or nearly all of it is empty.
    """

    def __init__(
        self, low: Sequence[int], high: Sequence[int], stored: int, label: str, background: float = 0.0
    ) -> None:
        first, sides = np.array(low, np.int64), np.array(high, np.int64) - np.array(low, np.int64) + 1
        if (sides < 1).any() or (sides > SIDE_LIMIT).any() or int(np.prod(sides)) > VALUE_LIMIT:
            shape = " x ".join(str(side) for side in sides)
            raise SceneError(f"{label} has {shape} numbers; at most {VALUE_LIMIT} are possible; make the grid coarser")
        if int(np.prod(sides)) > max(_ALWAYS_TAKEN, _SPARSEST * stored):
            text = f"spreads {counted(stored, 'number')} over a box of {' x '.join(str(side) for side in sides)}"
            raise SceneError(f"{label} {text}; leave out what is far away, or divide the grid")
        self._label, self._low = label, first - 1
        self._values = np.full(sides + 2, background, np.float32)  # x, y, z, as trees count

    def fill(self, origin: NDArray[np.int64], side: int, value: float) -> None:
        """Fill a cube with one number."""
        self._values[self._overlap(origin, side)[0]] = value

    def put(self, origin: NDArray[np.int64], block: NDArray[np.float32]) -> None:
        """Put a cube of numbers where its first coordinates say; those outside of the box are left out."""
        into, out_of = self._overlap(origin, len(block))
        self._values[into] = block[out_of]

    def placed(self, matrix: NDArray[np.float64], vector: NDArray[np.float64]) -> GridData:
        """The grid, with an affine map from coordinates to metres. Numbers below 0, which solvers leave, count as 0.

        Raises
        ------
        SceneError
            A number is not allowed.
        ValueError
            The map cannot be inverted.
        """
        corner = (matrix * (self._low - 0.5)[None, :]).sum(axis=1) + vector
        placement = np.concatenate([matrix * np.array(self._values.shape)[None, :], corner[:, None]], axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            volume = abs(determinant(matrix))
        if not (np.isfinite(placement).all() and 1e-30 <= volume < math.inf):
            raise ValueError("its map to the world cannot be inverted")
        return GridData.checked(
            np.ascontiguousarray(np.maximum(self._values, 0.0).transpose(2, 1, 0)), self._label, placement
        )

    def _overlap(self, origin: NDArray[np.int64], side: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
        """The part of a cube that lies in the box: where in the box, and where in the cube."""
        at = origin - self._low
        begin, end = np.maximum(at, 0), np.minimum(at + side, np.array(self._values.shape))
        end = np.maximum(end, begin)
        into = tuple(slice(int(a), int(b)) for a, b in zip(begin, end, strict=True))
        return into, tuple(slice(int(a), int(b)) for a, b in zip(begin - at, end - at, strict=True))
