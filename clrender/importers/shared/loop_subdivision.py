"""Loop's subdivision of triangle meshes, with points and normals of the limit surface.

The rules are those of Physically Based Rendering, 3rd edition, section 3.8: Loop's for the inside (Smooth Subdivision
Surfaces Based on Triangles, 1987), and those of a cubic B-spline for boundaries. Only the limit at boundaries is not
that of the spline, 1/6 of each neighbour, but 1/5 of each, as in pbrt: a difference that a level quarters.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.elementary import sines_cosines
from clrender.wording import counted

__all__ = ["MOST_TRIANGLES", "subdivided"]

MOST_TRIANGLES: Final = 2**23
"""Most triangles of a subdivided mesh."""
_NONE: Final = -1
_INWARD: Final = {2: (1.0, 1.0), 3: (0.0, 1.0, 0.0), 4: (-1.0, 2.0, 2.0, -1.0)}
"""Weights of the neighbours in the tangent from a boundary inward, by their number; others follow a formula."""

_Floats: TypeAlias = NDArray[np.float64]
_Indices: TypeAlias = NDArray[np.int64]


def subdivided(points: _Floats, triangles: _Indices, levels: int) -> tuple[_Floats, _Indices, _Floats, bool]:
    """Subdivide a mesh, and move its vertices to the limit surface.

    Parameters
    ----------
    points : (V, 3) float64
    triangles : (T, 3) int64
        Those with two equal corners are left out.
    levels : int
        Times to split every triangle into four.

    Returns
    -------
    points : (W, 3) float64
        On the limit surface.
    triangles : (4^levels T, 3) int64
    normals : (W, 3) float64
        Counter-clockwise, not of unit length; of the tangents that pbrt computes, from points of the limit surface.
        Zero at vertices without triangles.
    regular : bool
        Whether each edge is in at most two triangles, which pass it in opposite directions. Others are boundaries.

    Raises
    ------
    ValueError
        There would be more than `MOST_TRIANGLES`.
    """
    if len(triangles) * 4 ** min(levels, 16) > MOST_TRIANGLES:
        raise ValueError(
            f"{counted(len(triangles), 'triangle becomes', 'triangles become')} more than {MOST_TRIANGLES} in "
            f"{counted(levels, 'level')} of subdivision"
        )
    a, b, c = triangles.T
    mesh = _Mesh(points, triangles[(a != b) & (b != c) & (c != a)])
    regular = mesh.regular
    for _ in range(levels):
        mesh = _Mesh(*mesh.split())
    points = mesh.limit()
    return points, mesh.triangles, mesh.normals(points), regular


class _Mesh:
    """A mesh with its edges.

    Half-edge 3 t + k goes from corner k of triangle t to the next one.

    Attributes
    ----------
    points : (V, 3) float64
    triangles : (T, 3) int64
    starts, ends : (3 T,) int64
        Vertices of each half-edge.
    twins : (3 T,) int64
        The half-edge on the other side, or -1 at a boundary.
    edges : (3 T,) int64
        Number of the edge that each half-edge is on.
    first : (E,) int64
        A half-edge of each edge.
    regular : bool
        See `subdivided`.
    """

    def __init__(self, points: _Floats, triangles: _Indices) -> None:
        self.points, self.triangles = points, triangles
        self.starts, self.ends = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
        low, high = np.minimum(self.starts, self.ends), np.maximum(self.starts, self.ends)
        keys, order = _sorted(low * len(points) + high)
        new = np.concatenate([np.ones(min(len(keys), 1), bool), keys[1:] != keys[:-1]])
        number = np.cumsum(new) - 1
        self.edges = np.empty(len(keys), np.int64)
        self.edges[order] = number
        begin = np.flatnonzero(new)
        counts = np.diff(np.append(begin, len(keys)))
        self.first = order[begin]
        pairs = np.flatnonzero(counts == 2)
        one, other = order[begin[pairs]], order[begin[pairs] + 1]
        opposite = self.starts[one] == self.ends[other]
        self.twins = np.full(len(keys), _NONE)
        self.twins[one[opposite]], self.twins[other[opposite]] = other[opposite], one[opposite]
        self.regular = bool(opposite.all() and (counts <= 2).all())

    @cached_property
    def _neighbours(self) -> tuple[_Floats, _Floats, NDArray[np.bool_], _Floats, _Floats]:
        """For each vertex: the sum of its neighbours, their number, and whether it is at a boundary; those there."""
        count = len(self.points)
        tails, heads = self.starts[self.first], self.ends[self.first]
        open_edges = self.twins[self.first] == _NONE
        sums, numbers = self._around(tails, heads)
        edge_sums, edge_numbers = self._around(tails[open_edges], heads[open_edges])
        boundary = np.zeros(count, bool)
        boundary[tails[open_edges]] = boundary[heads[open_edges]] = True
        return sums, numbers, boundary, edge_sums, edge_numbers

    def _around(self, tails: _Indices, heads: _Indices) -> tuple[_Floats, _Floats]:
        """Sums and numbers of the vertices at the other ends of these edges."""
        count = len(self.points)
        here, there = np.concatenate([tails, heads]), np.concatenate([heads, tails])
        sums = [np.bincount(here, self.points[there, axis], count) for axis in range(3)]
        return np.stack(sums, axis=1).astype(np.float64), np.bincount(here, minlength=count).astype(np.float64)

    def _weighted(self, inside: _Floats, outside: float) -> _Floats:
        """Points moved towards their neighbours: `inside` is the weight of each one, `outside` that at boundaries."""
        sums, numbers, boundary, edge_sums, edge_numbers = self._neighbours
        shares = np.where(boundary, outside * 2.0 / np.maximum(edge_numbers, 1.0), inside)
        total = np.where(boundary, 2.0 * outside, numbers * inside)
        moved = np.where(boundary[:, None], edge_sums, sums)
        return np.asarray((1.0 - total)[:, None] * self.points + shares[:, None] * moved, np.float64)

    def split(self) -> tuple[_Floats, _Indices]:
        """Points and triangles of the next level: old vertices first, then one for each edge."""
        valences = self._neighbours[1]
        even = self._weighted(_beta(valences), 1.0 / 8.0)
        tails, heads, twins = self.starts[self.first], self.ends[self.first], self.twins[self.first]
        ends = self.points[tails] + self.points[heads]
        beyond = self.points[self._opposite(self.first)] + self.points[self._opposite(np.maximum(twins, 0))]
        odd = np.where((twins == _NONE)[:, None], ends / 2.0, 3.0 / 8.0 * ends + beyond / 8.0)
        (a, b, c), (ab, bc, ca) = self.triangles.T, len(self.points) + self.edges.reshape(-1, 3).T
        corners = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1)
        return np.concatenate([even, odd]), corners.reshape(-1, 3)

    def _opposite(self, half_edges: _Indices) -> _Indices:
        """The corner of each half-edge's triangle that is not on it."""
        return self.triangles[half_edges // 3, (half_edges + 2) % 3]

    def limit(self) -> _Floats:
        """The vertices' places on the limit surface."""
        valences = np.maximum(self._neighbours[1], 1.0)
        return self._weighted(1.0 / (valences + 3.0 / (8.0 * _beta(valences))), 1.0 / 5.0)

    def normals(self, points: _Floats) -> _Floats:
        """Normals at all vertices, from the ring of points around each."""
        _, valences, boundary, _, _ = self._neighbours
        used = np.flatnonzero(valences > 0.0)
        # A half-edge from each vertex: at boundaries the one that has no triangle on its other side
        start = np.full(len(self.points), _NONE)
        start[self.starts] = np.arange(len(self.starts))
        lone = np.flatnonzero(self.twins == _NONE)
        start[self.starts[lone]] = lone
        along, across = np.zeros((len(points), 3)), np.zeros((len(points), 3))
        now, steps = start[used], valences[used].astype(np.int64)
        order = np.argsort(-steps, kind="stable")
        used, now, steps = used[order], now[order], steps[order]
        kinds, which = np.unique(steps, return_inverse=True)
        for k in range(int(steps[0]) if len(steps) else 0):
            many = int(np.searchsorted(-steps, -k, side="left"))  # those of more than k neighbours
            used, now, steps, which = used[:many], now[:many], steps[:many], which[:many]
            inward = 3 * (now // 3) + (now + 2) % 3  # of the same triangle, towards the vertex
            # The last neighbour at a boundary is the start of the last triangle's half-edge towards the vertex
            edge = boundary[used]
            last = edge & (k == steps - 1)
            ring = points[np.where(last, self.starts[now], self.ends[now])]
            weights = _tangent_weights(k, kinds)[edge.astype(np.intp), :, which]
            along[used] += weights[:, :1] * ring
            across[used] += weights[:, 1:] * ring
            following = self.twins[inward]
            now = np.where(last, now, np.where(following == _NONE, inward, following))
        at_boundary = np.flatnonzero(boundary)
        across[at_boundary] -= _own_weight(valences[at_boundary])[:, None] * points[at_boundary]
        return np.asarray(np.cross(along, across), np.float64)


def _sorted(keys: _Indices) -> tuple[_Indices, _Indices]:
    order = np.argsort(keys, kind="stable")
    return keys[order], order


def _beta(valences: _Floats) -> _Floats:
    """Weight of each neighbour of an inner vertex."""
    return np.where(valences == 3.0, 3.0 / 16.0, 3.0 / (8.0 * np.maximum(valences, 1.0)))


def _tangent_weights(k: int, valences: _Indices) -> _Floats:
    """Weights of neighbour k in two tangents with a counter-clockwise product.

    Parameters
    ----------
    k : int
        Counter-clockwise; at a boundary from one of its edges to the other.
    valences : (n,) int64
        Numbers of neighbours.

    Returns
    -------
    (2, 2, n) float64
        Inside and at a boundary; the first and the second tangent.
    """
    n = valences.astype(np.float64)
    sines, cosines = sines_cosines(2.0 * np.pi * k / n)
    ends = np.full(len(n), k == 0), k == valences - 1
    along = np.where(ends[1], 1.0, np.where(ends[0], -1.0, 0.0))
    theta = np.pi / np.maximum(n - 1.0, 1.0)
    sine, cosine = sines_cosines(theta)
    inward = np.where(ends[0] | ends[1], -sine, (2.0 - 2.0 * cosine) * sines_cosines(k * theta)[0])
    for count, weights in _INWARD.items():
        if k < count:
            inward = np.where(valences == count, weights[k], inward)
    return np.array([[cosines, sines], [along, -inward]])


def _own_weight(valences: _Floats) -> _Floats:
    """Weight of a boundary vertex itself in its inward tangent."""
    return np.where(valences == 3.0, -1.0, np.where((valences == 2.0) | (valences == 4.0), -2.0, 0.0))
