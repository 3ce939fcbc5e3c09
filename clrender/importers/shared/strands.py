"""Curves of other formats, collected: those of one material become one shape, and ribbons one mesh."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.curves import CurveData
from clrender.exact.angles import root
from clrender.exact.matrices import determinant, inverse, times
from clrender.importers.draft import Draft
from clrender.importers.shared.matrices import Matrix, handedness, is_similarity
from clrender.meshes.data import MeshData

__all__ = ["StrandCollector", "has_inside", "placed_rows", "ribbon_mesh"]

_Floats = NDArray[np.float64]
_STEPS: Final = 8
"""Pairs of triangles of a curve of a ribbon."""
_UNEVEN: Final = "curves that a transform stretches unevenly keep round cross sections"


def placed_rows(draft: Draft, rows: _Floats, matrix: Matrix, *, scaled: bool = True) -> _Floats:
    """Control points under a transform, with their radii.

    Parameters
    ----------
    draft : Draft
        Gets a note if tubes would not stay round.
    rows : (N, 4) float64
        x, y, z and the radius.
    matrix : (4, 4) float64
    scaled : bool
        Whether the radii are scaled, too.
    """
    x, y, z, radii = rows.T
    points = [((a * x + b * y) + c * z) + d for a, b, c, d in matrix[:3].tolist()]
    if scaled:
        if not is_similarity(matrix):
            draft.note(_UNEVEN)
        radii = radii * root(abs(float(determinant(matrix[:3, :3]))), 3)
    return np.stack([*points, radii], axis=1)


def has_inside(draft: Draft, material: str | None) -> bool:
    """Whether light goes through a material, or through one that is mixed into it: curves have no inside."""
    parts = [material] if material is not None else []
    while parts:
        described = draft.description["materials"][parts.pop()]
        filled = described["type"] in ("dielectric", "subsurface") or described.get("transmission", 0.0) != 0.0
        if filled and not described.get("thin"):
            return True
        parts += described.get("materials", [])
    return False


class StrandCollector:
    """Collects strands until a file has been read.

    Parameters
    ----------
    draft : Draft
    source : str
        The scene's file, for messages.
    """

    def __init__(self, draft: Draft, source: str) -> None:
        self._draft, self._source = draft, source
        self._collected: dict[Hashable, tuple[str, list[_Floats]]] = {}
        self._ribbons: dict[Hashable, tuple[str, list[MeshData]]] = {}
        self._stretched: dict[tuple[str, bytes], tuple[str, Matrix]] = {}

    def add(self, key: Hashable, rows: _Floats, basis: str) -> dict[str, Any] | None:
        """Add a strand.

        Parameters
        ----------
        key : hashable
            Strands with equal keys belong to one shape.
        rows : (N, 4) float64
            Control points and radii.
        basis : str
            See `clrender.scene.shapes.Curves`; part of the key.

        Returns
        -------
        dict or None
            The description of the shape, if this is its first strand.
        """
        key = (key, basis)
        if key in self._collected:
            self._collected[key][1].append(rows)
            return None
        name = f"curves {len(self._collected) + 1}"
        self._collected[key] = name, [rows]
        return {"type": "curves", "file": name, "basis": basis}

    def add_ribbon(self, key: Hashable, ribbon: MeshData) -> dict[str, Any] | None:
        """Add a ribbon; for the parameters see `add`."""
        if key in self._ribbons:
            self._ribbons[key][1].append(ribbon)
            return None
        name = f"ribbons {len(self._ribbons) + 1}"
        self._ribbons[key] = name, [ribbon]
        return {"type": "mesh", "file": name}

    def stretched(self, name: str, matrix: Matrix) -> str:
        """The file of a shape's strands under a transform that is no similarity, which the shape itself cannot have.

        Parameters
        ----------
        name : str
            The shape's file, as `add` returned it.
        matrix : (4, 4) float64
        """
        new = f"{name}, stretched {len(self._stretched) + 1}"
        return self._stretched.setdefault((name, matrix.tobytes()), (new, matrix))[0]

    def finish(self) -> None:
        """Write all strands to the draft.

        Raises
        ------
        SceneError
            There are too many, or a number is not allowed.
        """
        for name, strands in self._collected.values():
            counts = np.array([len(each) for each in strands], np.int64)
            self._draft.curves[name] = CurveData.checked(np.concatenate(strands), counts, f"{self._source}: {name}")
        for (name, _), (new, matrix) in self._stretched.items():
            data = self._draft.curves[name]
            rows = placed_rows(self._draft, data.rows, matrix)
            self._draft.curves[new] = CurveData.checked(rows, data.counts, f"{self._source}: {new}")
        for name, ribbons in self._ribbons.values():
            self._draft.meshes[name] = _joined(ribbons)


def ribbon_mesh(controls: _Floats, widths: tuple[float, float], normals: _Floats, matrix: Matrix) -> MeshData:
    """A flat ribbon along cubic Bezier curves.

    Parameters
    ----------
    controls : (K, 4, 3) float64
        Their control points.
    widths : (float, float)
        At the beginning and the end, linear between them.
    normals : (K + 1, 3) float64
        At the ends of the curves; turned evenly between them.
    matrix : (4, 4) float64
        Acts on the ribbon.

    Returns
    -------
    MeshData
        With normals; u runs along the ribbon, v across it.
    """
    count = len(controls)
    u = np.arange(count * _STEPS + 1) / _STEPS
    segment = np.minimum(u.astype(np.int64), count - 1)
    t = (u - segment)[:, None]
    a, b, c, d = (controls[segment, k] for k in range(4))
    v = 1.0 - t
    middle = v * v * v * a + 3.0 * v * v * t * b + 3.0 * v * t * t * c + t * t * t * d
    slope = v * v * (b - a) + 2.0 * v * t * (c - b) + t * t * (d - c)
    slope = np.where((slope * slope).sum(axis=1, keepdims=True) > 0.0, slope, d - a)
    first, second = _unit(normals[segment]), _unit(normals[segment + 1])
    facing = _unit(first * v + second * t)
    across = _unit(np.cross(facing, slope))
    share = u / count
    half = ((widths[0] + (widths[1] - widths[0]) * share) / 2.0)[:, None]
    points = np.stack([middle - half * across, middle + half * across], axis=1).reshape(-1, 3)
    normal = np.repeat(_unit(np.cross(slope, across)), 2, axis=0)
    at = 2 * np.arange(len(u) - 1)[:, None]
    triangles = np.concatenate([at + np.array([0, 3, 1]), at + np.array([0, 2, 3])]).astype(np.uint32)
    uvs = np.stack([np.repeat(share, 2), np.tile([0.0, 1.0], len(u))], axis=1).astype(np.float32)
    x, y, z = points.T
    placed = np.stack([((p * x + q * y) + r * z) + o for p, q, r, o in matrix[:3].tolist()], axis=1)
    turned = _unit(times(inverse(matrix)[:3, :3].T, normal)) * handedness(matrix)
    return MeshData(placed, triangles, turned.astype(np.float32), uvs=uvs[triangles])


def _unit(vectors: _Floats) -> _Floats:
    size = np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
    return np.asarray(vectors / np.maximum(size, 1e-300))


def _joined(parts: list[MeshData]) -> MeshData:
    """Meshes as one; all have normals and texture coordinates."""
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    triangles = [part.triangles + np.uint32(first) for part, first in zip(parts, firsts.tolist(), strict=True)]
    normals = [part.normals for part in parts if part.normals is not None]
    uvs = [part.uvs for part in parts if part.uvs is not None]
    return MeshData(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate(triangles),
        np.concatenate(normals),
        uvs=np.concatenate(uvs),
    )
