"""Tangents of normal maps from positions, normals and texture coordinates, by the method of MikkTSpace.

M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008): at each vertex, the directions in which u grows on its
triangles are averaged, weighted by the triangles' angles there. The average is over fans of triangles that are
connected by edges, have the same position, normal and texture coordinates at the vertex, and have the same handedness.
Programs that bake normal maps use it, and glTF 2.0 (3.7.2.1) recommends it for files without tangents.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from clrender.exact.elementary import arctangent

__all__ = ["mikktspace"]

_Vectors = NDArray[np.float64]


def mikktspace(
    positions: NDArray[np.floating],
    normals: NDArray[np.floating],
    uvs: NDArray[np.floating],
    triangles: NDArray[np.uint32],
) -> NDArray[np.float32]:
    """Tangents of the corners of triangles.

    Parameters
    ----------
    positions, normals : (V, 3) floating
        Normals of any length.
    uvs : (V, 2) floating
        For each vertex, with v upward from the bottom edge of the image.
    triangles : (T, 3) uint32

    Returns
    -------
    (T, 3, 4) float32
        See `clrender.meshes.data.MeshData`. Triangles without a direction take that of others at the same vertex,
        or zero if there are none.
    """
    vertex = _welded(positions, normals, uvs)[triangles]
    corners = positions.astype(np.float64)[triangles]
    along, kept_round, sound = _directions(corners, uvs.astype(np.float64)[triangles])
    normal = _unit(normals.astype(np.float64)[triangles])
    across = along[:, None] - normal * _inner(along[:, None], normal)
    weight = np.where(sound[:, None], _angles(corners, normal), 0.0)
    parts = (_unit(across) * weight[..., None]).reshape(-1, 3)
    fans = _fans(vertex, kept_round, sound)
    tangents = _unit(_summed(parts, fans, len(parts))[fans]).reshape(-1, 3, 3)
    if not sound.all():
        others = _unit(_summed(parts, vertex.ravel(), int(vertex.max()) + 1)[vertex[~sound]])
        tangents[~sound] = others
    made = np.empty((len(triangles), 3, 4), np.float32)
    made[..., :3] = tangents
    made[..., 3] = np.where(kept_round, 1.0, -1.0)[:, None]
    return made


def _welded(
    positions: NDArray[np.floating], normals: NDArray[np.floating], uvs: NDArray[np.floating]
) -> NDArray[np.int64]:
    """Ids of vertices, equal if all attributes are. Uses a 64-bit hash, which sorts several times as fast."""
    words = np.concatenate([positions, normals, uvs], axis=1, dtype=np.float32) + np.float32(0.0)  # -0 is 0
    mixed = np.zeros(len(words), np.uint64)
    for column in np.ascontiguousarray(words).view(np.uint32).T:
        mixed = (mixed ^ column) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return np.asarray(np.unique(mixed, return_inverse=True)[1], np.int64).ravel()


def _directions(corners: _Vectors, uvs: _Vectors) -> tuple[_Vectors, NDArray[np.bool_], NDArray[np.bool_]]:
    """For triangles: the direction in which u grows, whether the image is unmirrored, and whether both are defined."""
    b, c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    u, v = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    along = v[:, 1, None] * b - u[:, 1, None] * c
    upward = u[:, 0, None] * c - v[:, 0, None] * b
    solid = (_cross(b, c) != 0.0).any(axis=1)
    sound = solid & (np.abs(area) > 1e-38) & (along != 0.0).any(axis=1) & (upward != 0.0).any(axis=1)
    return _unit(np.where(area < 0.0, -1.0, 1.0)[:, None] * along), area >= 0.0, sound


def _angles(corners: _Vectors, normal: _Vectors) -> NDArray[np.float64]:
    """Angles of triangles at their corners, projected along the normals there, radians."""
    angles = np.empty(corners.shape[:2])
    for k in range(3):
        n = normal[:, k]
        sides = [corners[:, (k + step) % 3] - corners[:, k] for step in (1, 2)]
        one, two = (_unit(side - n * _inner(side, n)) for side in sides)
        cosine = np.clip(_inner(one, two)[:, 0], -1.0, 1.0)
        sine = np.sqrt(1.0 - cosine * cosine)
        size = np.abs(cosine)
        small = arctangent(np.minimum(size, sine) / np.maximum(size, sine))
        angle = np.where(sine > size, math.pi / 2.0 - small, small)
        angles[:, k] = np.where(cosine < 0.0, math.pi - angle, angle)
    return angles


def _fans(vertex: NDArray[np.int64], kept_round: NDArray[np.bool_], sound: NDArray[np.bool_]) -> NDArray[np.int64]:
    """For each corner, triangle by triangle, the index of one corner in its fan, the same for the whole fan."""
    start, end = vertex.ravel(), np.roll(vertex, -1, axis=1).ravel()
    corner = np.arange(len(start))
    following = corner - corner % 3 + (corner + 1) % 3
    lower = start < end
    low, high = np.where(lower, start, end), np.where(lower, end, start)
    usable = np.repeat(sound, 3) & (low != high)
    edges = np.flatnonzero(usable)
    keys = ((low * (int(start.max()) + 1) + high) * 2 + np.repeat(kept_round, 3))[edges]
    order = np.argsort(keys, kind="stable")
    same = keys[order][1:] == keys[order][:-1]
    one, two = edges[order][:-1][same], edges[order][1:][same]
    at_low, at_high = np.where(lower, corner, following), np.where(lower, following, corner)
    return _connected(
        np.concatenate([at_low[one], at_high[one]]), np.concatenate([at_low[two], at_high[two]]), len(start)
    )


def _connected(a: NDArray[np.int64], b: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Connected components of the graph with edges (a, b) and `count` nodes: the smallest node of each."""
    label = np.arange(count)
    while len(a):
        one, two = label[a], label[b]
        apart = one != two
        a, b, one, two = a[apart], b[apart], one[apart], two[apart]
        np.minimum.at(label, np.maximum(one, two), np.minimum(one, two))
        while (label[label] != label).any():
            label = label[label]
    return label


def _summed(vectors: _Vectors, groups: NDArray[np.int64], count: int) -> _Vectors:
    """Sums of vectors by group."""
    return np.stack([np.bincount(groups, column, count) for column in vectors.T], axis=1)


def _inner(a: _Vectors, b: _Vectors) -> _Vectors:
    products = a * b
    sums: _Vectors = (products[..., 0] + products[..., 1]) + products[..., 2]
    return sums[..., None]


def _cross(a: _Vectors, b: _Vectors) -> _Vectors:
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def _unit(a: _Vectors) -> _Vectors:
    size = np.sqrt(_inner(a, a))
    return np.divide(a, size, out=np.zeros_like(a), where=size > 0.0)
