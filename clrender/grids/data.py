"""Numbers on a regular grid in a box."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError

__all__ = ["SIDE_LIMIT", "VALUE_LIMIT", "GridData"]

VALUE_LIMIT: Final = 2**30
"""Most numbers of a grid: 1024 along each side."""
SIDE_LIMIT: Final = 2**14
"""Most numbers along a side."""
_LARGEST: Final = 1e12


def _unit_box() -> NDArray[np.float64]:
    return np.eye(4)[:3]


@dataclass(frozen=True)
class GridData:
    """Numbers at the centres of the equal cells of a box.

    Attributes
    ----------
    values : (nz, ny, nx) or (nz, ny, nx, 3) float32
        Finite, not below 0; numbers, or colours.
    placement : (3, 4) float64
        Affine map of the unit cube, whose x runs along the last index, to where the file places the box, metres.
    """

    values: NDArray[np.float32]
    placement: NDArray[np.float64] = field(default_factory=_unit_box)

    @property
    def sides(self) -> tuple[int, int, int]:
        """Numbers along z, y and x."""
        nz, ny, nx = self.values.shape[:3]
        return nz, ny, nx

    @property
    def channels(self) -> int:
        """1 for numbers, 3 for colours."""
        return 1 if self.values.ndim == 3 else 3

    def sha256(self) -> str:
        """Hash of the numbers."""
        return self._sha256

    @cached_property
    def _sha256(self) -> str:
        digest = hashlib.sha256(f"{self.values.shape}".encode())
        for sheet in self.values:
            digest.update(np.ascontiguousarray(sheet, "<f4").data)
        return digest.hexdigest()

    @classmethod
    def checked(cls, values: NDArray[Any], label: str, placement: NDArray[np.float64] | None = None) -> GridData:
        """A grid of these numbers.

        Parameters
        ----------
        values : (nz, ny, nx) or (nz, ny, nx, 3) real
        label : str
            Beginning of error messages.
        placement : (3, 4) float64, optional
            See the class.

        Raises
        ------
        SceneError
            The shape or a number is not allowed.
        """
        colors = values.ndim == 4 and values.shape[-1] == 3
        if not (values.ndim == 3 or colors) or 0 in values.shape or values.dtype.kind not in "fiub":
            text = f"holds {str(values.dtype)[:20]} {str(values.shape)[:60]}, but must hold numbers (nz, ny, nx)"
            raise SceneError(f"{label} {text}")
        if values.size > VALUE_LIMIT or max(values.shape[:3]) > SIDE_LIMIT:
            shape = " x ".join(str(side) for side in values.shape)
            text = f"has {shape} numbers; at most {VALUE_LIMIT} are possible, and {SIDE_LIMIT} along a side"
            raise SceneError(f"{label} {text}; make the grid coarser")
        with np.errstate(over="ignore"):  # infinite, which is refused
            numbers = np.ascontiguousarray(values, np.float32)
        for z, sheet in enumerate(numbers):
            least, most = float(sheet.min()), float(sheet.max())
            if not (least >= 0.0 and most <= _LARGEST):
                bad = np.argwhere(~((sheet >= 0.0) & (sheet <= _LARGEST)))[0].tolist()
                text = f"has {float(sheet[tuple(bad)]):g} at {[z, *bad]}"
                text += f", but numbers of grids are from 0 to {_LARGEST:g}; change the file"
                raise SceneError(f"{label} {text}")
        return cls(numbers, _unit_box() if placement is None else placement)
