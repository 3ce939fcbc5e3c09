"""Vertex normals for meshes that have none: which corners of triangles share one, by the angles between faces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.meshes.data import MeshData

__all__ = ["smoothed"]

_Whole = NDArray[np.int64]


def smoothed(mesh: MeshData, angle: float) -> MeshData:
    """A mesh whose faces are shaded as one curved surface where they meet at no more than an angle.

    Two triangles join along an edge if no other has it, both have their fronts on one side of it, and the angle between
    their normals is small enough. Around a vertex, those that are joined, also by way of others, share one vertex.
    Vertices in the same place count as one, as in files that list the corners of each triangle.

    Parameters
    ----------
    mesh : MeshData
        Its normals are not used.
    angle : float
        Degrees, above 0 up to 180.

    Returns
    -------
    MeshData
        A vertex for each group of corners, in the order of their first corners, with a row of zeros as its normal: that
        stands for the mean of the triangles around it, by their areas. Applied again, it gives the same mesh.
    """
    corners = _welded(mesh.vertices)[mesh.triangles.astype(np.int64)]
    first, second = _edges_between(corners)
    _, least = sin_cos_degrees(angle)
    normals = _unit_normals(mesh, corners)
    a, b = normals[first // 3], normals[second // 3]
    cosine = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]) + a[:, 2] * b[:, 2]
    joined = cosine >= least if angle < 180.0 else np.ones(len(first), bool)
    first, second = first[joined], second[joined]
    # The edges run against each other: where one begins, the other ends
    group = _components(corners.size, np.concatenate([first, _next(first)]), np.concatenate([_next(second), second]))
    leads = group == np.arange(len(group))
    vertices = mesh.vertices[mesh.triangles.reshape(-1)[leads]]
    triangles = (np.cumsum(leads) - 1)[group].reshape(-1, 3).astype(np.uint32)
    return replace(mesh, vertices=vertices, triangles=triangles, normals=np.zeros_like(vertices))


def _next(corner: _Whole) -> _Whole:
    """The next corner of the same triangle."""
    return np.asarray(corner + np.where(corner % 3 == 2, -2, 1))


def _welded(vertices: NDArray[np.floating]) -> _Whole:
    """A number for each vertex, which those in the same place share."""
    order = np.lexsort((vertices[:, 2], vertices[:, 1], vertices[:, 0]))
    placed = vertices[order]
    begins = np.ones(len(order), bool)
    begins[1:] = (placed[1:] != placed[:-1]).any(axis=1)
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(begins) - 1
    return numbers


def _unit_normals(mesh: MeshData, corners: _Whole) -> NDArray[np.float64]:
    """Unit normals of triangles, (T, 3); of those without an area, zero."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]].astype(np.float64) for corner in range(3))
    u, v = b - a, c - a
    n = np.stack(
        [
            u[:, 1] * v[:, 2] - u[:, 2] * v[:, 1],
            u[:, 2] * v[:, 0] - u[:, 0] * v[:, 2],
            u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0],
        ],
        axis=1,
    )
    size = np.sqrt((n[:, 0] * n[:, 0] + n[:, 1] * n[:, 1]) + n[:, 2] * n[:, 2])
    return np.asarray(n / np.where(size > 0.0, size, 1.0)[:, None])


def _edges_between(corners: _Whole) -> tuple[_Whole, _Whole]:
    """Edges that exactly two triangles have, as the corner from which each of them runs along it, one way and back."""
    begin = corners.reshape(-1)
    end = corners[:, [1, 2, 0]].reshape(-1)
    key = np.minimum(begin, end) * (int(begin.max(initial=0)) + 1) + np.maximum(begin, end)
    order = np.argsort(key, kind="stable")
    key = key[order]
    same = np.zeros(len(key) + 1, bool)
    same[1:-1] = key[1:] == key[:-1]
    at = np.flatnonzero(same[1:-1] & ~same[:-2] & ~same[2:])
    first, second = order[at], order[at + 1]
    against = (begin[first] == end[second]) & (begin[first] != end[first])
    return first[against], second[against]


def _components(count: int, first: _Whole, second: _Whole) -> _Whole:
    """The least member of the component of each of `count` nodes of a graph, by its edges."""
    least = np.arange(count)
    while True:
        a, b = least[first], least[second]
        apart = a != b
        if not apart.any():
            return least
        first, second, a, b = first[apart], second[apart], a[apart], b[apart]
        np.minimum.at(least, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(below := least[least], least):
            least = below
