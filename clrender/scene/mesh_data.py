"""Triangles with shared vertices, as mesh files and scene files hold them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["TRIANGLE_LIMIT", "MeshData", "inline_mesh"]

TRIANGLE_LIMIT: Final = 2**27
"""Most vertices, and most triangles, of a mesh and of a scene."""


@dataclass(frozen=True)
class MeshData:
    """Triangles as a file holds them, before any transform.

    Attributes
    ----------
    vertices : (V, 3) float32 or float64
        Finite, object space.
    triangles : (T, 3) uint32
        Indices below V.
    normals : (V, 3) float32 or float64, or None
        Finite, of any length; zero where the file has none.
    """

    vertices: NDArray[np.floating]
    triangles: NDArray[np.uint32]
    normals: NDArray[np.floating] | None = None

    def sha256(self) -> str:
        """Hash of the three arrays (in float64, so that the width in the file does not count)."""
        return self._sha256

    @cached_property
    def _sha256(self) -> str:
        digest = hashlib.sha256(f"{self.vertices.shape} {self.triangles.shape} {self.normals is None}".encode())
        for array, kind in ((self.vertices, "<f8"), (self.normals, "<f8"), (self.triangles, "<u4")):
            for start in range(0, 0 if array is None else len(array), 2**18):
                assert array is not None
                digest.update(np.ascontiguousarray(array[start : start + 2**18], dtype=kind).tobytes())
        return digest.hexdigest()


def inline_mesh(vertices: Sequence[Sequence[float]], faces: Sequence[Sequence[int]]) -> MeshData:
    """A mesh written into the scene file; its indices have been checked by the model."""
    return MeshData(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.uint32))
