"""Meshes of Wavefront OBJ files, from all faces or some of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.exact.matrices import lengths
from clrender.meshes.data import TRIANGLE_LIMIT, MeshData, crossed_warning
from clrender.meshes.obj_records import ObjRecords, read_records
from clrender.meshes.polygons import triangulate
from clrender.meshes.vertex_colors import VertexColors, linear_colors
from clrender.wording import counted, grouped

__all__ = ["ObjFaces", "Smoothing", "read_obj"]

_Whole = NDArray[np.int64]
_SOME_NORMALS: Final = "some corners have no normals, and got that of their face"


def read_obj(file: BinaryIO, size: int, label: str, colors: VertexColors | None = None) -> MeshData:
    """Read an OBJ file as one mesh, with polygons split into triangles.

    Parameters
    ----------
    file : binary file
        Positioned at its start.
    size : int
        Bytes.
    label : str
        Prefix of error messages.
    colors : VertexColors, optional
        Also read the colour after each position, as in ``v x y z r g b``, with this encoding; auto: sRGB.

    Raises
    ------
    SceneError
        If it is truncated, damaged or not a mesh.
    """
    del size
    return ObjFaces(read_records(file, label, colors is not None), label).mesh(colors=colors)


@dataclass(frozen=True)
class Smoothing:
    """Vertices of a file, each once for every smoothing group around it, and normals where meshes meet.

    Attributes
    ----------
    groups : (F,) int64
        Smoothing group of each face; 0: none.
    vertices : (n,) int64
        Indices of the vertices.
    corners : (C,) int64
        For each corner an index into `vertices`.
    normals : (n, 3) float64
        Unit normals of vertices that several meshes share; of all others zero: each mesh averages its own triangles.
    """

    groups: _Whole
    vertices: _Whole
    corners: _Whole
    normals: NDArray[np.float64]


@dataclass(frozen=True)
class ObjFaces:
    """The faces of an OBJ file, and the indices of their corners.

    Attributes
    ----------
    records : ObjRecords
    label : str
        Prefix of error messages.
    """

    records: ObjRecords
    label: str
    _linear: dict[VertexColors, NDArray[np.float32]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """Vertex positions, (V, 3) float64."""
        return np.concatenate([part[:, :3] for part in self.records.positions])

    @cached_property
    def colors(self) -> NDArray[np.float64] | None:
        """Vertex colours as in the file, (V, 3) float64; None if some vertices have none."""
        parts = self.records.positions
        return np.concatenate([part[:, 3:] for part in parts]) if all(part.shape[1] == 6 for part in parts) else None

    @cached_property
    def sizes(self) -> _Whole:
        """Number of corners of each face, (F,) int64."""
        return np.concatenate(self.records.sizes)

    @cached_property
    def _corners(self) -> tuple[_Whole, _Whole, _Whole]:
        """Indices of the vertex, texture coordinates and normal of each corner; -1 for missing ones."""
        found = self.records
        vertex, uv, normal = (
            np.concatenate(parts) for parts in (found.corners, found.corner_uvs, found.corner_normals)
        )
        return vertex, uv, normal

    @cached_property
    def _normals(self) -> NDArray[np.float64]:
        return np.concatenate(self.records.normals)

    @cached_property
    def _uv_table(self) -> NDArray[np.float32]:
        with np.errstate(over="ignore"):  # values too large for float32 become infinite and are rejected later
            return np.concatenate([np.empty((0, 2)), *self.records.uvs]).astype(np.float32)

    def _shades(self, colors: VertexColors) -> NDArray[np.float32]:
        """Linear colours of all vertices, cached for other meshes of the file."""
        if colors not in self._linear:
            assert self.colors is not None
            self._linear[colors] = linear_colors(self.colors, colors != "linear", self.label)
        return self._linear[colors]

    @cached_property
    def _firsts(self) -> _Whole:
        return np.cumsum(self.sizes) - self.sizes

    @cached_property
    def with_normals(self) -> NDArray[np.bool_]:
        """Which faces have normals at all corners, (F,) bool."""
        held = np.concatenate(self.records.corner_normals) >= 0
        if held.all() or not held.any():
            return np.full(len(self.sizes), held[0])
        return np.logical_and.reduceat(held, self._firsts)

    def mesh(
        self,
        faces: _Whole | None = None,
        colors: VertexColors | None = None,
        smoothing: Smoothing | None = None,
    ) -> MeshData:
        """Some of the faces as triangles.

        Parameters
        ----------
        faces : (n,) int64, optional
            Indices of the faces, whose vertices alone are kept; default: all faces and vertices.
        colors : VertexColors, optional
            Also read vertex colours, with this encoding; auto: sRGB.
        smoothing : Smoothing, optional
            Faces without normals then get averaged normals of their smoothing group: vertices are duplicated for each
            group, with rows of zeros as normals where no other mesh shares them.

        Raises
        ------
        SceneError
            There are too many triangles.
        """
        sizes = self.sizes if faces is None else self.sizes[faces]
        total = int(sizes.sum()) - 2 * len(sizes)
        if total > TRIANGLE_LIMIT:
            raise SceneError(
                f"{self.label} holds {counted(total, 'triangle')}, but at most {grouped(TRIANGLE_LIMIT)} are read"
            )
        at = self._places(faces, sizes)
        corners, corner_uvs, corner_normals = (each[at] for each in self._corners)
        uvs, warning = self._uvs(corner_uvs)
        triangles, crossed = None, 0
        if (sizes > 3).any():
            triangles, crossed = triangulate(self.positions, corners, sizes, self.label)
        shades = None if colors is None or self.colors is None else self._shades(colors).take(corners, axis=0)
        vertices, normals = self.positions, None
        held = (corner_normals >= 0).any()
        if smoothing is not None and not held and smoothing.groups[slice(None) if faces is None else faces].any():
            used, corners = _used(smoothing.corners[at])
            vertices, normals = vertices[smoothing.vertices[used]], smoothing.normals[used]
        elif faces is not None:
            used, corners = _used(corners)
            vertices = vertices[used]
        if held:
            table = self._normals
            if (corner_normals < 0).any():
                table = np.concatenate([table, np.zeros((1, 3))])
                corner_normals = np.where(corner_normals < 0, len(table) - 1, corner_normals)
                warning = "; ".join(each for each in (warning, _SOME_NORMALS) if each)
            vertices, normals, corners = _with_normals(vertices, table, corners, corner_normals)

        def by_triangle(values: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
            if values is None:
                return None
            return values.reshape(-1, 3, values.shape[1]) if triangles is None else values[triangles]

        return MeshData(
            vertices,
            (corners.reshape(-1, 3) if triangles is None else corners[triangles]).astype(np.uint32),
            normals,
            "; ".join(each for each in (*self.records.told, crossed_warning(crossed), warning) if each),
            by_triangle(uvs),
            colors=by_triangle(shades),
            forgiven=len(self.records.forgiven),
            left_out=len(self.records.faults),
        )

    def smoothing(self, groups: _Whole, parts: _Whole) -> Smoothing | None:
        """What faces without normals need to be smooth within their groups, also across meshes.

        Parameters
        ----------
        groups : (F,) int64
            Smoothing group of each face; 0: none.
        parts : (F,) int64
            Number of the mesh of each face.

        Returns
        -------
        Smoothing or None
            None: there are no such faces.
        """
        if not (groups[~self.with_normals]).any():
            return None
        of_face = _groups(groups)
        count = int(of_face.max()) + 1
        pairs, corners = np.unique(self._corners[0] * count + np.repeat(of_face, self.sizes), return_inverse=True)
        smoothing = Smoothing(groups, pairs // count, corners.reshape(-1), np.zeros((len(pairs), 3)))
        part_of_corner, part = np.repeat(parts, self.sizes), np.empty(len(pairs), np.int64)
        part[smoothing.corners] = part_of_corner
        shared = np.zeros(len(pairs), bool)
        shared[smoothing.corners[part[smoothing.corners] != part_of_corner]] = True
        if shared.any():
            around = np.flatnonzero(np.logical_or.reduceat(shared[smoothing.corners], self._firsts))
            smoothing.normals[shared] = self._averages(smoothing, around)[shared]
        return smoothing

    def _averages(self, smoothing: Smoothing, faces: _Whole) -> NDArray[np.float64]:
        """Unit normals of vertices from the triangles of some faces, by area, (n, 3); zero where they cancel out."""
        sizes = self.sizes[faces]
        at = self._places(faces, sizes)
        triangles, _ = triangulate(self.positions, self._corners[0][at], sizes, self.label)
        rows = smoothing.corners[at][triangles]
        a, b, c = (self.positions[smoothing.vertices[rows[:, corner]]] for corner in range(3))
        with np.errstate(over="ignore", invalid="ignore"):  # coordinates out of range are rejected later
            normals, count = np.cross(b - a, c - a), len(smoothing.vertices)
            around = np.repeat(normals, 3, axis=0)
            total = np.stack([np.bincount(rows.ravel(), each, count) for each in around.T], axis=1)
            size = lengths(total)
            return np.asarray(total / np.where(size > 0.0, size, 1.0)[:, None])

    def _places(self, faces: _Whole | None, sizes: _Whole) -> _Whole | slice:
        """Indices of the corners of some faces, or of all."""
        if faces is None:
            return slice(None)
        first = self._firsts[faces]
        return np.asarray(np.repeat(first - (np.cumsum(sizes) - sizes), sizes) + np.arange(int(sizes.sum())))

    def _uvs(self, index: _Whole) -> tuple[NDArray[np.float32] | None, str]:
        """Texture coordinates of corners, if any has them, and a warning about corners without."""
        table = self._uv_table
        if not len(table):
            return None, ""
        held = (index >= 0) & (index < len(table))
        if held.all():
            return table.take(index, axis=0), ""
        if not held.any():
            return None, ""
        uvs = table.take(np.where(held, index, 0), axis=0)
        uvs[~held] = 0.0
        missing = len(index) - int(np.count_nonzero(held))
        return uvs, f"{missing} corners of faces have no texture coordinates, and got (0, 0)"


def _used(corners: _Whole) -> tuple[_Whole, _Whole]:
    """Unique vertices of the corners, ascending, and the corners' indices into these."""
    low, span = int(corners.min()), int(np.ptp(corners)) + 1
    if span > 8 * len(corners):
        used, places = np.unique(corners, return_inverse=True)
        return used, places.reshape(-1)
    # Most objects have contiguous vertices: no need to sort
    held = np.zeros(span, bool)
    held[corners - low] = True
    return np.flatnonzero(held) + low, (np.cumsum(held) - 1).take(corners - low)


def _with_normals(
    vertices: NDArray[np.float64], normals: NDArray[np.float64], corners: _Whole, corner_normals: _Whole
) -> tuple[NDArray[np.float64], NDArray[np.float64], _Whole]:
    """Duplicate vertices with several normals, so that each has one."""
    normal_of = np.full(len(vertices), -1, np.int64)
    normal_of[corners] = corner_normals
    if (normal_of.take(corners) == corner_normals).all():
        chosen = normals.take(np.maximum(normal_of, 0), axis=0)
        chosen[normal_of < 0] = 0.0
        return vertices, chosen, corners
    pairs, corners = np.unique(corners * len(normals) + corner_normals, return_inverse=True)
    return vertices[pairs // len(normals)], normals[pairs % len(normals)], corners.reshape(-1)


def _groups(smoothing: _Whole) -> _Whole:
    """Consecutive group numbers of faces, from 0; each face without a group is a group of its own."""
    alone = smoothing == 0
    _, groups = np.unique(np.where(alone, 0, smoothing), return_inverse=True)
    groups = groups.reshape(-1).astype(np.int64)
    groups[alone] = int(groups.max()) + 1 + np.arange(int(alone.sum()))
    return groups
