"""Meshes for other renderers' shapes, and these renderers' conventions for mesh files."""

from __future__ import annotations

import dataclasses
import math
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
    "disk_part_mesh",
    "faced_by_normals",
    "flipped_v",
    "patches_mesh",
    "quads_mesh",
    "smoothed",
    "sphere_mesh",
    "sphere_part_mesh",
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
_TURN: Final = 512
"""Quads around a whole turn of cylinders and of parts of spheres and disks; their radius is off by 2e-5."""
_BENT: Final = 1e-4
"""How far triangles may be from a bilinear patch, of its size."""
_MOST_QUADS: Final = 1 << 20
"""Quads of all patches of a mesh, at most."""


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
    with np.errstate(over="ignore"):  # infinite, which is refused
        corners = None if uvs is None else uvs.astype(np.float32)[triangles]
    return MeshData(vertices, triangles, normals=normals, uvs=corners)


def _grid(across: int, along: int) -> NDArray[np.int64]:
    """Quads between (across + 1) columns and (along + 1) rows of vertices, row by row."""
    column, row = np.meshgrid(np.arange(across), np.arange(along))
    first = (row * (across + 1) + column).ravel()
    return np.stack([first, first + 1, first + across + 2, first + across + 1], axis=1)


def sphere_mesh(radius: float) -> MeshData:
    """A sphere about the origin, to be made an ellipsoid, with the texture coordinates of our own spheres.

    The longitude u grows from -z over -x, the latitude v from -y to y.
    """
    u, v = np.meshgrid(np.linspace(0.0, 1.0, _AROUND + 1), np.linspace(0.0, 1.0, _ALONG + 1))
    phi, theta = 2.0 * np.pi * u.ravel(), np.pi * v.ravel()
    (sin_phi, cos_phi), (sin_theta, cos_theta) = sines_cosines(phi), sines_cosines(theta)
    normals = np.stack([-sin_theta * sin_phi, -cos_theta, -sin_theta * cos_phi], axis=1)
    uvs = np.stack([u.ravel(), v.ravel()], axis=1)
    return faced_by_normals(quads_mesh(radius * normals, _grid(_AROUND, _ALONG), uvs, normals))


def _swept(across: int, along: int) -> tuple[_Floats, _Floats, NDArray[np.int64]]:
    """Texture coordinates (n, 2) and (n,) of v in [0, 1], and quads, of a grid over a parametric surface."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, across + 1), np.linspace(0.0, 1.0, along + 1))
    return np.stack([u.ravel(), v.ravel()], axis=1), v.ravel(), _grid(across, along)


def _quads_of(turn: float) -> int:
    return max(int(np.ceil(turn * _TURN)), 1)


def cylinder_mesh(radius: float, low: float, high: float, turn: float = 1.0) -> MeshData:
    """An open cylinder about +z: u runs around, v from `low` to `high`; the front is outside.

    Parameters
    ----------
    radius, low, high : float
        `high` above `low`.
    turn : float
        Part of a turn from +x, above 0 to 1.
    """
    uvs, v, quads = _swept(_quads_of(turn), 1)
    sines, cosines = sines_cosines(2.0 * np.pi * turn * uvs[:, 0])
    normals = np.stack([cosines, sines, np.zeros(len(uvs))], axis=1)
    vertices = radius * normals
    vertices[:, 2] = low + (high - low) * v
    return faced_by_normals(quads_mesh(vertices, quads, uvs, normals))


def sphere_part_mesh(radius: float, low: float, high: float, turn: float) -> MeshData:
    """The part of a sphere about the origin between two heights, and of a turn from +x; the front is outside.

    u runs around, v from `low` to `high`, evenly in the angle (PBR 4ed, 6.2).

    Parameters
    ----------
    radius, low, high, turn : float
        `low` and `high` within the radius, `high` above `low`; `turn` above 0 to 1.
    """
    heights = np.array([low, high]) / radius
    first, last = angles_of(np.sqrt(np.maximum(1.0 - heights * heights, 0.0)), heights).tolist()
    uvs, v, quads = _swept(_quads_of(turn), _quads_of(abs(last - first) / (2.0 * np.pi)))
    sin_phi, cos_phi = sines_cosines(2.0 * np.pi * turn * uvs[:, 0])
    sin_theta, cos_theta = sines_cosines(first + (last - first) * v)
    normals = np.stack([sin_theta * cos_phi, sin_theta * sin_phi, cos_theta], axis=1)
    return faced_by_normals(quads_mesh(radius * normals, quads, uvs, normals))


def disk_part_mesh(radius: float, inner_radius: float, height: float, turn: float) -> MeshData:
    """A ring, or a part of a disk, perpendicular to +z: u runs around, v from the rim inwards (PBR 4ed, 6.4).

    Parameters
    ----------
    radius, inner_radius, height, turn : float
        `inner_radius` of at least 0 below the radius; `turn` above 0 to 1.
    """
    uvs, v, quads = _swept(_quads_of(turn), 1)
    sines, cosines = sines_cosines(2.0 * np.pi * turn * uvs[:, 0])
    reach = radius + (inner_radius - radius) * v
    vertices = np.stack([reach * cosines, reach * sines, np.full(len(v), height)], axis=1)
    return faced_by_normals(quads_mesh(vertices, quads, uvs, np.tile([[0.0, 0.0, 1.0]], (len(v), 1))))


def patches_mesh(corners: _Floats, uvs: _Floats, normals: _Floats | None) -> MeshData:
    """Bilinear patches (PBR 4ed, 6.6), divided until triangles are close to them.

    Parameters
    ----------
    corners : (P, 4, 3) float64
        At u, v = 0, 0; 1, 0; 0, 1; 1, 1.
    uvs : (P, 4, 2) float64
        Texture coordinates of the corners.
    normals : (P, 4, 3) float64 or None
        Normals of the corners; by default those of the surface.
    """
    a, b, c, d = (corners[:, i] for i in range(4))
    bent = lengths(a + d - b - c)  # four times how far two triangles are from the middle of the patch
    size = np.maximum(np.maximum(lengths(d - a), lengths(c - b)), 1e-300)
    wanted = float(np.sqrt((bent / (4.0 * _BENT * size)).max()))
    pieces = max(min(int(np.ceil(wanted)), int(math.sqrt(_MOST_QUADS / len(corners)))), 1)
    if normals is None:
        # The product of both derivatives, of which one is linear in v and the other in u, is bilinear as well
        across, along = np.stack([b - a, b - a, d - c, d - c], 1), np.stack([c - a, d - b, c - a, d - b], 1)
        normals = np.cross(across, along)
    ends, _, quads = _swept(pieces, pieces)
    u, v = ends[:, 0], ends[:, 1]
    weights = np.stack([(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v])

    def between(values: _Floats) -> _Floats:
        parts = [values[:, i, None, :] * weights[i, None, :, None] for i in range(4)]
        return np.asarray(parts[0] + parts[1] + parts[2] + parts[3]).reshape(-1, values.shape[2])

    directions = between(normals)
    # Where corners coincide there is none of their own
    middle = np.repeat(normals.sum(axis=1), len(ends), axis=0)
    directions = np.where((lengths(directions) > 0.0)[:, None], directions, middle)
    numbers = np.arange(len(corners))[:, None, None] * len(ends) + quads
    return faced_by_normals(quads_mesh(between(corners), numbers.reshape(-1, 4), between(uvs), directions))


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
