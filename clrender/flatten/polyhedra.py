"""Shapes with flat faces as triangles: quads, triangles, boxes and tetrahedra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from clrender.meshes.data import MeshData
from clrender.scene.shapes import Box, Quad, Tetrahedron, Triangle
from clrender.scene.values import cross

__all__ = ["polyhedron"]

_BOX_TRIANGLES = [
    corner
    for a, b, c, d in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    for corner in ((a, b, c), (a, c, d))
]


def polyhedron(shape: Quad | Triangle | Box | Tetrahedron) -> MeshData:
    """Vertices and triangles of a shape with flat faces, before its transform.

    Returns
    -------
    MeshData
        Shared vertices; triangles are counter-clockwise seen from the front.
    """
    triangles: Sequence[Sequence[int]]
    if isinstance(shape, Triangle):
        vertices, triangles = np.array(shape.vertices), [(0, 1, 2)]
    elif isinstance(shape, Quad):
        o, u, v = (np.array(x, dtype=np.float64) for x in (shape.origin, shape.edge_u, shape.edge_v))
        vertices, triangles = np.stack([o, o + u, o + u + v, o + v]), [(0, 1, 2), (0, 2, 3)]
    elif isinstance(shape, Box):
        half = np.array(shape.size) / 2.0
        signs = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
        vertices, triangles = np.array(shape.center) + signs * half, _BOX_TRIANGLES
    else:
        vertices, triangles = np.array(shape.vertices), [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
        a, b, c = (tuple(row) for row in (vertices[1:] - vertices[0]).tolist())
        n = cross(b, c)
        if (a[0] * n[0] + a[1] * n[1]) + a[2] * n[2] < 0.0:
            triangles = [(i, k, j) for i, j, k in triangles]
    return MeshData(vertices.astype(np.float64), np.array(triangles, dtype=np.uint32))
