"""Meshes for other renderers' shapes, and these renderers' conventions for mesh files."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.elementary import angles_of, sines_cosines
from clrender.exact.matrices import inner, lengths
from clrender.flatten.surfaces import SMALLEST
from clrender.meshes.data import MeshData

__all__ = [
    "cube_mesh",
    "cylinder_mesh",
    "disk_mesh",
    "faced_by_normals",
    "flipped_v",
    "quads_mesh",
    "smoothed",
    "sphere_mesh",
    "with_uvs",
    "without_area",
    "without_normals",
]

_Floats: TypeAlias = NDArray[np.float64]
_CUBE: Final = (
    ((1, -1, -1), (1, -1, 1), (-1, -1, 1), (-1, -1, -1)),
    ((1, 1, -1), (-1, 1, -1), (-1, 1, 1), (1, 1, 1)),
    ((1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)),
    ((1, -1, 1), (1, 1, 1), (-1, 1, 1), (-1, -1, 1)),
    ((-1, -1, 1), (-1, 1, 1), (-1, 1, -1), (-1, -1, -1)),
    ((1, 1, -1), (1, -1, -1), (-1, -1, -1), (-1, 1, -1)),
)
"""Corners of each face of Mitsuba's cube, facing outward, beginning at texture coordinates (0, 1)."""
_CUBE_UVS: Final = ((0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0))
_AROUND: Final = 128
_ALONG: Final = 64


def cube_mesh() -> MeshData:
    """A cube from -1 to 1 along each axis; each face shows the texture once, as in Mitsuba."""
    vertices = np.array(_CUBE, np.float64).reshape(-1, 3)
    return quads_mesh(vertices, np.arange(24).reshape(6, 4), np.array(_CUBE_UVS * 6, np.float64))


def quads_mesh(
    vertices: _Floats, quads: NDArray[np.int64], uvs: _Floats | None, normals: _Floats | None = None
) -> MeshData:
    """Split quadrilaterals into two triangles each.

    Parameters
    ----------
    vertices : (V, 3) float64
    quads : (Q, 4) integers
        Corners in order, counter-clockwise seen from the front.
    uvs : (V, 2) float64 or None
    normals : (V, 3) float64 or None
    """
    triangles = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.uint32)
    corners = None if uvs is None else uvs.astype(np.float32)[triangles]
    return MeshData(vertices, triangles, normals=normals, uvs=corners)


def _grid(across: int, along: int) -> NDArray[np.int64]:
    """Quads between (across + 1) columns and (along + 1) rows of vertices, row by row."""
    column, row = np.meshgrid(np.arange(across), np.arange(along))
    first = (row * (across + 1) + column).ravel()
    return np.stack([first, first + 1, first + across + 2, first + across + 1], axis=1)


def sphere_mesh(radius: float) -> MeshData:
    """A sphere about the origin, to be made an ellipsoid: u is the longitude about +z, v runs from +z to -z."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, _AROUND + 1), np.linspace(0.0, 1.0, _ALONG + 1))
    phi, theta = 2.0 * np.pi * u.ravel(), np.pi * v.ravel()
    (sin_phi, cos_phi), (sin_theta, cos_theta) = sines_cosines(phi), sines_cosines(theta)
    normals = np.stack([sin_theta * cos_phi, sin_theta * sin_phi, cos_theta], axis=1)
    uvs = np.stack([u.ravel(), v.ravel()], axis=1)
    return faced_by_normals(quads_mesh(radius * normals, _grid(_AROUND, _ALONG), uvs, normals))


def cylinder_mesh(radius: float, low: float, high: float) -> MeshData:
    """An open cylinder about +z: u runs around, v from `low` to `high`; the front is outside."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, _AROUND + 1), np.linspace(0.0, 1.0, 2))
    phi = 2.0 * np.pi * u.ravel()
    sines, cosines = sines_cosines(phi)
    normals = np.stack([cosines, sines, np.zeros(phi.size)], axis=1)
    vertices = radius * normals
    vertices[:, 2] = low + (high - low) * v.ravel()
    uvs = np.stack([u.ravel(), v.ravel()], axis=1)
    return faced_by_normals(quads_mesh(vertices, _grid(_AROUND, 1), uvs, normals))


def disk_mesh(radius: float) -> MeshData:
    """A disk about the origin perpendicular to +z, to be made an ellipse, with planar texture coordinates."""
    phi = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    sines, cosines = sines_cosines(phi)
    rim = np.stack([cosines, sines, np.zeros(_AROUND)], axis=1)
    vertices = np.concatenate([np.zeros((1, 3)), rim])
    first = np.arange(_AROUND)
    triangles = np.stack([np.zeros(_AROUND, np.int64), 1 + first, 1 + (first + 1) % _AROUND], axis=1).astype(np.uint32)
    uvs = ((vertices[:, :2] + 1.0) / 2.0).astype(np.float32)
    return MeshData(radius * vertices, triangles, uvs=uvs[triangles])


def without_normals(mesh: MeshData) -> MeshData:
    """The mesh without normals."""
    return dataclasses.replace(mesh, normals=None)


def flipped_v(mesh: MeshData) -> MeshData:
    """The mesh with v replaced by 1 - v."""
    if mesh.uvs is None:
        return mesh
    uvs = mesh.uvs.copy()
    uvs[..., 1] = np.float32(1.0) - uvs[..., 1]
    return dataclasses.replace(mesh, uvs=uvs)


def with_uvs(mesh: MeshData, corners: Sequence[tuple[float, float]]) -> MeshData:
    """The mesh, with the same texture coordinates of the three corners on each triangle if it has none."""
    if mesh.uvs is not None:
        return mesh
    uvs = np.broadcast_to(np.array(corners, np.float32), (len(mesh.triangles), 3, 2)).copy()
    return dataclasses.replace(mesh, uvs=uvs)


def _face_normals(mesh: MeshData) -> _Floats:
    a, b, c = (np.asarray(mesh.vertices, np.float64)[mesh.triangles[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a), np.float64)


def faced_by_normals(mesh: MeshData) -> MeshData:
    """The mesh with triangles flipped that face away from their vertices' normals."""
    if mesh.normals is None:
        return mesh
    toward = np.asarray(mesh.normals, np.float64)[mesh.triangles].sum(axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        wrong = inner(_face_normals(mesh), toward) < 0.0
    if not wrong.any():
        return mesh

    def turned(corners: Any) -> Any:
        if corners is None:
            return None
        new = corners.copy()
        new[wrong] = new[wrong][:, ::-1]
        return new

    return dataclasses.replace(
        mesh,
        triangles=turned(mesh.triangles),
        uvs=turned(mesh.uvs),
        uvs_1=turned(mesh.uvs_1),
        colors=turned(mesh.colors),
    )


def smoothed(mesh: MeshData) -> MeshData:
    """The mesh with Mitsuba's default vertex normals: the angle-weighted mean of the adjacent triangles.

    Vertices are shared only if their texture coordinates are equal. (Thürmer and Wüthrich, "Computing Vertex
    Normals from Polygonal Facets", JGT 3(1) 1998.)
    """
    mesh = _split_at_seams(mesh)
    corners = [np.asarray(mesh.vertices, np.float64)[mesh.triangles[:, i]] for i in range(3)]
    faces = _face_normals(mesh)
    sizes = lengths(faces)
    sound = sizes > 0.0
    units = np.where(sound[:, None], faces / np.where(sound, sizes, 1.0)[:, None], 0.0)
    normals = np.zeros((len(mesh.vertices), 3))
    for i in range(3):
        to, fro = corners[(i + 1) % 3] - corners[i], corners[(i + 2) % 3] - corners[i]
        angles = angles_of(lengths(np.cross(to, fro)), inner(to, fro))
        np.add.at(normals, mesh.triangles[:, i], units * angles[:, None])
    return dataclasses.replace(mesh, normals=normals)


def _split_at_seams(mesh: MeshData) -> MeshData:
    if mesh.uvs is None:
        return mesh
    keys = np.concatenate(
        [mesh.triangles.reshape(-1, 1).astype(np.float64), mesh.uvs.reshape(-1, 2).astype(np.float64)], axis=1
    )
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    kept = mesh.triangles.reshape(-1)[first]
    triangles = which.reshape(-1, 3).astype(np.uint32)
    return dataclasses.replace(mesh, vertices=mesh.vertices[kept], triangles=triangles)


def without_area(positions: NDArray[np.floating], triangles: NDArray[np.integer]) -> bool:
    """Whether no triangle has an area in single precision; usually the first few disprove it."""
    for start in (0, 64):
        some = triangles[start : 64 if start == 0 else None]
        with np.errstate(over="ignore", invalid="ignore"):  # what is out of range is refused elsewhere
            a, b, c = (positions[some[:, i]].astype(np.float32) for i in range(3))
            if len(some) and not np.abs(np.cross(b - a, c - a)).max() < SMALLEST:
                return False
    return True
