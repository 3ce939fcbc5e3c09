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
from clrender.wording import counted, grouped

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
    normals : (N, 3) float64, or None
        Where ribbons face at each control point; None: the shape says them, or nothing does.
    """

    points: NDArray[np.float64]
    radii: NDArray[np.float64] | None
    counts: NDArray[np.int64]
    normals: NDArray[np.float64] | None = None

    @property
    def rows(self) -> NDArray[np.float64]:
        """What `checked` takes: (N, 3, 4 or 7)."""
        columns = [self.points, *([] if self.radii is None else [self.radii[:, None]])]
        return np.concatenate([*columns, *([] if self.normals is None else [self.normals])], axis=1)

    def sha256(self) -> str:
        """Hash of the strands."""
        return self._sha256

    @cached_property
    def _sha256(self) -> str:
        digest = hashlib.sha256(np.ascontiguousarray(self.points, "<f8").tobytes())
        digest.update(b"" if self.radii is None else np.ascontiguousarray(self.radii, "<f8").tobytes())
        digest.update(np.ascontiguousarray(self.counts, "<i8").tobytes())
        digest.update(b"" if self.normals is None else np.ascontiguousarray(self.normals, "<f8").tobytes())
        return digest.hexdigest()

    @classmethod
    def checked(cls, rows: NDArray[Any], counts: NDArray[np.int64], label: str) -> CurveData:
        """Strands of these control points.

        Parameters
        ----------
        rows : (N, 3, 4 or 7) real
            x, y, z, then if there are more numbers the radius, and then where ribbons face.
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
            raise SceneError(
                f"{label} has {counted(len(rows), 'control point')}; at most {grouped(POINT_LIMIT)} are possible; "
                "divide it"
            )
        with np.errstate(invalid="ignore"):  # what is not a number is refused below
            rows = np.asarray(rows, np.float64)
        points = np.ascontiguousarray(rows[:, :3])
        good = np.abs(points) <= COORDINATE_LIMIT
        if not good.all():
            number, axis = np.argwhere(~good)[0].tolist()
            text = f"has {points[number, axis]:g} in point {number}; coordinates are up to {COORDINATE_LIMIT:g} metres"
            raise SceneError(f"{label} {text}")
        radii = np.ascontiguousarray(rows[:, 3]) if rows.shape[1] > 3 else None
        if radii is not None and not ((radii >= 0.0) & (radii <= COORDINATE_LIMIT)).all():
            number = int(np.flatnonzero(~((radii >= 0.0) & (radii <= COORDINATE_LIMIT)))[0])
            text = (
                f"has the radius {radii[number]:g} at point {number}; radii are from 0 to {COORDINATE_LIMIT:g} metres"
            )
            raise SceneError(f"{label} {text}")
        normals = np.ascontiguousarray(rows[:, 4:]) if rows.shape[1] > 4 else None
        if normals is not None:
            faces = (np.abs(normals) <= COORDINATE_LIMIT).all(axis=1) & normals.any(axis=1)
            if not faces.all():
                text = f"has no direction as the normal of point {int(np.flatnonzero(~faces)[0])}"
                raise SceneError(f"{label} {text}; give finite numbers, not all 0")
        return cls(points, radii, np.asarray(counts, np.int64), normals)
