"""Triangle meshes with shared vertices, as stored in mesh files and scene files."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "COORDINATE_LIMIT",
    "CORNER_ARRAYS",
    "TRIANGLE_LIMIT",
    "MeshData",
    "crossed_warning",
    "filled",
    "inline_mesh",
]

_Float = TypeVar("_Float", bound=np.floating)

COORDINATE_LIMIT: Final = 1e12
"""Largest magnitude of a coordinate, metres: its cube, used in ray-triangle intersection, fits single precision."""
TRIANGLE_LIMIT: Final = 2**27
"""Most vertices, and most triangles, of a mesh and of a scene."""
CORNER_ARRAYS: Final = ("uvs", "uvs_1", "colors", "tangents")
"""Optional arrays of data for each triangle's corners."""


@dataclass(frozen=True)
class MeshData:
    """A triangle mesh as stored in a file, before any transform.

    Attributes
    ----------
    vertices : (V, 3) float32 or float64
        Finite, object space.
    triangles : (T, 3) uint32
        Indices below V.
    normals : (V, 3) float32 or float64, or None
        Finite, of any length; zero if the file has none.
    uvs, uvs_1 : (T, 3, 2) float32, or None
        Texture coordinates of each triangle's corners, finite; a second set.
    colors : (T, 3, 3) float32, or None
        Colours of each triangle's corners, linear, 0 to 1.
    tangents : (T, 3, 4) float32, or None
        Tangents of each triangle's corners, finite: the direction in which u of a normal map grows, of any length;
        then the sign, + if v grows along normal x tangent, - if against it. Zero: derive it from the coordinates.
    warning : str
        Warning about the mesh, for users; usually empty.
    forgiven, left_out : int
        Faults of its file that were forgiven, and those for which triangles were left out; the warning names them.
    """

    vertices: NDArray[np.floating]
    triangles: NDArray[np.uint32]
    normals: NDArray[np.floating] | None = None
    warning: str = ""
    uvs: NDArray[np.float32] | None = None
    uvs_1: NDArray[np.float32] | None = None
    colors: NDArray[np.float32] | None = None
    tangents: NDArray[np.float32] | None = None
    forgiven: int = 0
    left_out: int = 0

    def sha256(self) -> str:
        """Hash of the arrays (as float64, so that the precision in the file does not count)."""
        return self._sha256

    @cached_property
    def _sha256(self) -> str:
        digest = hashlib.sha256(f"{self.vertices.shape} {self.triangles.shape} {self.normals is None}".encode())
        arrays = [(self.vertices, "<f8"), (self.normals, "<f8"), (self.triangles, "<u4")]
        for name in CORNER_ARRAYS:
            corners = getattr(self, name)
            if corners is not None:
                digest.update(name.encode())
                arrays.append((corners, "<f4"))
        for array, kind in arrays:
            for start in range(0, 0 if array is None else len(array), 2**18):
                assert array is not None
                digest.update(np.ascontiguousarray(array[start : start + 2**18], dtype=kind).tobytes())
        return digest.hexdigest()


def filled(rows: NDArray[_Float]) -> tuple[NDArray[_Float], NDArray[np.bool_] | None]:
    """Rows with zeros in the place of those that are not finite.

    Parameters
    ----------
    rows : (..., n) float

    Returns
    -------
    (..., n) float
    (...) bool, or None
        Which rows are not finite; None if all are.
    """
    if not rows.size or (np.isfinite(rows.min()) and np.isfinite(rows.max())):
        return rows, None
    gaps: NDArray[np.bool_] = ~np.isfinite(rows).all(axis=-1)
    return np.where(gaps[..., None], rows.dtype.type(0), rows), gaps


def crossed_warning(count: int) -> str:
    """Warning about polygons whose outlines cross themselves."""
    what = "one polygon crosses its own outline" if count == 1 else f"{count} polygons cross their own outlines"
    return f"{what} and cannot be covered once; check the model there" if count else ""


def inline_mesh(
    vertices: Sequence[Sequence[float]],
    faces: Sequence[Sequence[int]],
    uvs: Sequence[Sequence[float]] = (),
    uvs_1: Sequence[Sequence[float]] = (),
    colors: Sequence[Sequence[float]] = (),
) -> MeshData:
    """A mesh in the scene file, with vertex texture coordinates and colours; the model has validated its indices."""
    corners = np.array(faces, dtype=np.uint32)
    first, second, third = (np.array(each, np.float32)[corners] if each else None for each in (uvs, uvs_1, colors))
    return MeshData(np.array(vertices, dtype=np.float64), corners, uvs=first, uvs_1=second, colors=third)
