"""Control points of strands."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.meshes.data import COORDINATE_LIMIT

__all__ = ["POINT_LIMIT", "CurveData"]

POINT_LIMIT: Final = 2**26
"""Most control points of a file."""


@dataclass(frozen=True)
class CurveData:
    """Control points of strands, one strand after the other.

    Attributes
    ----------
    points : (N, 3) float64
        Metres.
    radii : (N,) float64, or None
        At each control point, metres, not below 0; None: the shape says them.
    counts : (S,) int64
        Control points of each strand.
    """

    points: NDArray[np.float64]
    radii: NDArray[np.float64] | None
    counts: NDArray[np.int64]

    def sha256(self) -> str:
        """Hash of the strands."""
        return self._sha256

    @cached_property
    def _sha256(self) -> str:
        digest = hashlib.sha256(np.ascontiguousarray(self.points, "<f8").tobytes())
        digest.update(b"" if self.radii is None else np.ascontiguousarray(self.radii, "<f8").tobytes())
        digest.update(np.ascontiguousarray(self.counts, "<i8").tobytes())
        return digest.hexdigest()

    @classmethod
    def checked(cls, rows: NDArray[Any], counts: NDArray[np.int64], label: str) -> CurveData:
        """Strands of these control points.

        Parameters
        ----------
        rows : (N, 3 or 4) real
            x, y, z, and the radius if there is a fourth number.
        counts : (S,) int64
            Control points of each strand; together N.
        label : str
            Beginning of error messages.

        Raises
        ------
        SceneError
            There are no points, too many, or a number is not allowed.
        """
        if not len(rows):
            raise SceneError(f"{label} has no control points")
        if len(rows) > POINT_LIMIT:
            raise SceneError(f"{label} has {len(rows)} control points; at most {POINT_LIMIT} are possible; divide it")
        points = np.ascontiguousarray(rows[:, :3], np.float64)
        good = np.abs(points) <= COORDINATE_LIMIT
        if not good.all():
            number, axis = np.argwhere(~good)[0].tolist()
            text = f"has {points[number, axis]:g} in point {number}; coordinates are up to {COORDINATE_LIMIT:g} metres"
            raise SceneError(f"{label} {text}")
        radii = np.ascontiguousarray(rows[:, 3], np.float64) if rows.shape[1] == 4 else None
        if radii is not None and not ((radii >= 0.0) & (radii <= COORDINATE_LIMIT)).all():
            number = int(np.flatnonzero(~((radii >= 0.0) & (radii <= COORDINATE_LIMIT)))[0])
            text = (
                f"has the radius {radii[number]:g} at point {number}; radii are from 0 to {COORDINATE_LIMIT:g} metres"
            )
            raise SceneError(f"{label} {text}")
        return cls(points, radii, np.asarray(counts, np.int64))
