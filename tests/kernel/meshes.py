"""Closed meshes, wound so that the front is outside, and rays aimed at their most delicate places."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["CLOSED", "aimed", "box", "bumpy", "house", "icosphere", "inside", "needle", "tube", "uv_sphere"]

Points = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]


def box(size: npt.ArrayLike = (1.0, 1.0, 1.0)) -> tuple[Points, Faces]:
    """Axis-aligned box around the origin, two triangles a side."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return corners * np.asarray(size), np.array(faces)


def house() -> tuple[Points, Faces]:
    """Walls and a floor that are rectangles, in two triangles each, gables of three, and a roof of parallelograms."""
    x, y, z, top = 0.9, 0.6, 0.7, 1.1
    low = [(-x, -y, -z), (x, -y, -z), (x, -y, z), (-x, -y, z)]
    high = [(-x, y, -z), (x, y, -z), (x, y, z), (-x, y, z)]
    points = np.array([*low, *high, (-x, top, 0.1), (x, top, 0.1)])
    quads = [(0, 1, 2, 3), (2, 6, 7, 3), (4, 5, 1, 0), (0, 3, 7, 4), (6, 2, 1, 5), (7, 6, 9, 8), (8, 9, 5, 4)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return points, np.array([*faces, (4, 7, 8), (6, 5, 9)])


def icosphere(subdivisions: int = 3) -> tuple[Points, Faces]:
    """Unit sphere of almost equal triangles, convex."""
    g = (1 + 5**0.5) / 2
    base = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g)]
    points = np.array([*base, (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)], np.float64)
    rows = "0 11 5 0 5 1 0 1 7 0 7 10 0 10 11 1 5 9 5 11 4 11 10 2 10 7 6 7 1 8 3 9 4 3 4 2 3 2 6 3 6 8 3 8 9"
    faces = np.array(f"{rows} 4 9 5 2 4 11 6 2 10 8 6 7 9 8 1".split(), np.int64).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, number = np.unique(edges, axis=0, return_inverse=True)
        middle = points[unique].sum(axis=1)
        m = number.reshape(-1, 3) + len(points)
        points = np.vstack([points, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
        a, b, c = faces.T
        ab, bc, ca = m.T
        faces = np.vstack([np.stack(x, 1) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return points, faces


def uv_sphere(rings: int = 24, segments: int = 48) -> tuple[Points, Faces]:
    """Unit sphere of rings, with a fan of slender triangles at each pole."""
    theta = np.linspace(0, np.pi, rings + 1)[1:-1, None]
    phi = np.linspace(0, 2 * np.pi, segments, endpoint=False)[None, :]
    z = np.broadcast_to(np.cos(theta), (rings - 1, segments))
    body = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), z], -1).reshape(-1, 3)
    points = np.vstack([[0.0, 0.0, 1.0], body, [0.0, 0.0, -1.0]])
    i, j = np.meshgrid(np.arange(rings - 2), np.arange(segments), indexing="ij")
    a, b = 1 + i * segments + j, 1 + i * segments + (j + 1) % segments
    c, d = a + segments, b + segments
    around = np.arange(segments)
    following, last = (around + 1) % segments, len(points) - 1
    top = np.stack([np.zeros_like(around), 1 + around, 1 + following], 1)
    start = last - segments
    bottom = np.stack([np.full_like(around, last), start + following, start + around], 1)
    sides = [np.stack([x.ravel() for x in t], 1) for t in ((a, c, d), (a, d, b))]
    return points, np.vstack([top, *sides, bottom])


def bumpy(subdivisions: int = 4) -> tuple[Points, Faces]:
    """A sphere with dents, seen whole from its centre."""
    points, faces = icosphere(subdivisions)
    x, y, z = points.T
    return points * (1.0 + 0.2 * np.sin(9 * x) * np.sin(8 * y + 1) * np.sin(7 * z + 2))[:, None], faces


def needle(length: float = 1000.0) -> tuple[Points, Faces]:
    """An irregular double pyramid, far longer than it is thick."""
    ring = np.array([(0.9, 0.1, 0.3), (0.2, 1.1, -0.4), (-0.8, 0.5, 0.1), (-0.6, -0.9, -0.2), (0.5, -0.7, 0.25)])
    points = np.vstack([ring, [[0.11, 0.07, length], [-0.05, 0.13, -length]]])
    k = np.arange(5)
    up = np.stack([k, (k + 1) % 5, np.full(5, 5)], 1)
    down = np.stack([(k + 1) % 5, k, np.full(5, 6)], 1)
    return points, np.vstack([up, down])


def tube(sides: int = 200, length: float = 1000.0) -> tuple[Points, Faces]:
    """A long thin prism. Its edges are far longer than the boxes around its sides are wide."""
    k = np.arange(sides)
    angle = 2 * np.pi * (k + 0.37) / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    ends = [np.c_[ring, np.full(sides, z)] for z in (length, -length)]
    points = np.vstack([*ends, [(0.0, 0.0, length), (0.0, 0.0, -length)]])
    following = (k + 1) % sides
    sides_of = [(k, k + sides, following), (following, k + sides, following + sides)]
    caps = [(np.full(sides, 2 * sides), k, following), (np.full(sides, 2 * sides + 1), following + sides, k + sides)]
    return points, np.vstack([np.stack(columns, 1) for columns in (*sides_of, *caps)])


CLOSED = {
    "box": box(),
    "house": house(),
    "long box": box((1.0, 0.5, 1000.0)),
    "icosphere": icosphere(),
    "uv sphere": uv_sphere(),
    "bumpy": bumpy(),
    "needle": needle(),
    "tube": tube(),
}
"""Each holds all points within 1/4 of the origin."""


def inside(count: int, rng: np.random.Generator) -> Points:
    """Points within 1/4 of the origin."""
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points: Points = 0.25 * directions * rng.uniform(size=(count, 1)) ** (1 / 3)
    return points


def aimed(points: Points, faces: Faces, origins: Points, kind: str, rng: np.random.Generator) -> Points:
    """Directions from inside a closed mesh, of any length.

    Parameters
    ----------
    points, faces : the mesh
    origins : (n, 3)
    kind : str
        ``random``, ``vertices``, or ``edges`` by as little as a part in a billion, up to a thousandth.
    rng : numpy.random.Generator
    """
    n = len(origins)
    if kind == "random":
        return rng.normal(size=(n, 3))
    corners = faces[rng.integers(len(faces), size=n)]
    side = rng.integers(3, size=n)
    start, end = points[corners[np.arange(n), side]], points[corners[np.arange(n), (side + 1) % 3]]
    if kind == "vertices":
        return start - origins
    # Half of the places where edges come nearest, half anywhere along them.
    along = end - start
    nearest = ((origins - start) * along).sum(1, keepdims=True) / (along**2).sum(1, keepdims=True)
    t = rng.uniform(size=(n, 1))
    near = np.clip(nearest + (t - 0.5) * 0.01, 0, 1)
    target = start + along * np.where(rng.integers(0, 2, (n, 1)) == 0, t, near)
    direction = target - origins
    aside = rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-9, -3, (n, 1))
    return np.asarray(direction + aside * np.linalg.norm(direction, axis=1, keepdims=True), np.float64)
