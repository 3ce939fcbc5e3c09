"""Writes the mesh files in scenes/; they are committed, and the same bytes come out on every machine.

Run ``python scripts/make_meshes.py`` to write them, with ``--check`` to compare them with what is committed.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from clrender.exact.angles import sin_cos_degrees  # noqa: E402

__all__ = [
    "bumpy_sphere",
    "candle",
    "geodesic",
    "head",
    "lathe",
    "liquid",
    "ply_bytes",
    "tumbler",
    "water",
    "write_or_compare",
]


def geodesic(frequency: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unit sphere of 20 f^2 triangles from an icosahedron, vertices shared, normals outward.

    Parameters
    ----------
    frequency : int
        Number of parts into which each edge of the icosahedron is divided.

    Returns
    -------
    vertices : (10 f^2 + 2, 3) float64
    triangles : (20 f^2, 3) int64
    """
    g = (1.0 + math.sqrt(5.0)) / 2.0
    corners: list[tuple[float, float, float]] = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    corners += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2)]
    faces += [(10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5)]
    faces += [(2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    numbers: dict[tuple[tuple[int, int], ...], int] = {}
    points: list[tuple[float, ...]] = []

    def vertex(*weights: tuple[int, int]) -> int:
        """Index of the point with these integer weights of corners; a point has the same key from every face."""
        key = tuple(sorted((corner, weight) for corner, weight in weights if weight))
        if key not in numbers:
            numbers[key] = len(points)
            p = [sum(weight * corners[corner][axis] for corner, weight in key) for axis in range(3)]
            size = math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
            points.append(tuple(x / size for x in p))
        return numbers[key]

    triangles = []
    for a, b, c in faces:
        grid = {
            (i, j): vertex((a, frequency - i - j), (b, i), (c, j))
            for i in range(frequency + 1)
            for j in range(frequency + 1 - i)
        }
        for (i, j), here in grid.items():
            if i + j < frequency:
                triangles.append((here, grid[i + 1, j], grid[i, j + 1]))
            if i + j < frequency - 1:
                triangles.append((grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1]))
    return np.array(points), np.array(triangles)


def bumpy_sphere(
    frequency: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """A sphere of about radius 1 with bumps: vertices, unit normals, triangles."""
    points, triangles = geodesic(frequency)

    def wave(value: float, times: float, phase: float) -> float:
        return sin_cos_degrees(math.floor((value * times + phase) * 57.29577951308232 * 1024.0) / 1024.0)[0]

    def radius(x: float, y: float, z: float) -> float:
        return 1.0 + 0.08 * wave(x, 12.0, 0.0) * wave(y, 12.0, 1.0) * wave(z, 12.0, 2.0)

    vertices = points * np.array([radius(x, y, z) for x, y, z in points.tolist()])[:, None]
    return vertices, vertex_normals(vertices, triangles), triangles


def lathe(profile: Sequence[tuple[float, float]], segments: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A closed surface of revolution about the y axis.

    Parameters
    ----------
    profile : sequence of (radius, height)
        Counter-clockwise from axis to axis, so that normals are outward; radius 0 only at both ends.
    segments : int

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (t, 3) int64
    """
    turns = [sin_cos_degrees(360.0 * i / segments) for i in range(segments)]
    rings = [[(r * c, y, -r * s) for s, c in turns] for r, y in profile[1:-1]]
    vertices = [(0.0, profile[0][1], 0.0), *(p for ring in rings for p in ring), (0.0, profile[-1][1], 0.0)]
    triangles, last = [], 1 + segments * (len(rings) - 1)
    for i in range(segments):
        j = (i + 1) % segments
        triangles.append((0, 1 + j, 1 + i))
        for k in range(1, last, segments):
            triangles += [(k + i, k + j, k + segments + j), (k + i, k + segments + j, k + segments + i)]
        triangles.append((last + i, last + j, len(vertices) - 1))
    return np.array(vertices), np.array(triangles)


def tumbler() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """A drinking glass, 11 cm high: vertices, unit normals, triangles. Its inner wall is 34 mm from the axis."""

    def arc(x: float, y: float, radius: float, first: float, last: float, parts: int) -> list[tuple[float, float]]:
        angles = [sin_cos_degrees(first + (last - first) * i / parts) for i in range(parts + 1)]
        return [(x + radius * c, y + radius * s) for s, c in angles]

    profile = [(0.0, 0.0), (0.016, 0.0), (0.031, 0.0), *arc(0.033, 0.004, 0.004, -90.0, 0.0, 5), (0.037, 0.05)]
    profile += [*arc(0.0355, 0.1085, 0.0015, 0.0, 180.0, 8), (0.034, 0.05)]
    profile += [*arc(0.028, 0.016, 0.006, 0.0, -90.0, 6), (0.014, 0.01), (0.0, 0.01)]
    vertices, triangles = lathe(profile, 64)
    return vertices, vertex_normals(vertices, triangles), triangles


def liquid() -> tuple[NDArray[np.float64], None, NDArray[np.int64]]:
    """Liquid that fills the tumbler to 85 mm: a cylinder that extends to the middle of its walls and into its foot."""
    vertices, triangles = lathe([(0.0, 0.007), (0.0355, 0.007), (0.0355, 0.085), (0.0, 0.085)], 64)
    return vertices, None, triangles


def water() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """The water of a pool of 5 m by 3 m, 1.2 m deep: waves from all sides, and 2 cm more at its walls and its floor."""
    columns, rows, half_x, half_z, bottom = 64, 38, 2.52, 1.52, -1.22
    # Lengths of the waves, metres, and directions, degrees, spread by the golden angle
    waves = [(0.34 * 1.17**i, 137.50776405 * i) for i in range(10)]
    vertices, normals = [], []
    for j in range(rows + 1):
        for i in range(columns + 1):
            x, z = half_x * (2.0 * i / columns - 1.0), half_z * (2.0 * j / rows - 1.0)
            height, slope_x, slope_z = 0.0, 0.0, 0.0
            for length, direction in waves:
                sine, cosine = sin_cos_degrees(direction)
                across = 360.0 / length
                rise, along = sin_cos_degrees(across * (cosine * x + sine * z) + 50.0 * direction)
                height += 0.012 * length * rise
                steepness = 0.012 * length * math.radians(across) * along
                slope_x, slope_z = slope_x + steepness * cosine, slope_z + steepness * sine
            size = math.sqrt(slope_x * slope_x + 1.0 + slope_z * slope_z)
            vertices.append((x, height, z))
            normals.append((-slope_x / size, 1.0 / size, -slope_z / size))
    triangles = []
    for j in range(rows):
        for i in range(columns):
            a = j * (columns + 1) + i
            b, c, d = a + 1, a + columns + 2, a + columns + 1
            triangles += [(a, d, c), (a, c, b)]
    rim = [*range(columns), *(j * (columns + 1) + columns for j in range(rows))]
    rim += [rows * (columns + 1) + i for i in range(columns, 0, -1)]
    rim += [j * (columns + 1) for j in range(rows, 0, -1)]
    # Of vertices without a normal triangles are flat
    above = len(vertices)
    for y in (None, bottom):
        vertices += [(vertices[i][0], vertices[i][1] if y is None else y, vertices[i][2]) for i in rim]
    vertices.append((0.0, bottom, 0.0))
    normals += [(0.0, 0.0, 0.0)] * (len(vertices) - above)
    below = above + len(rim)
    for i in range(len(rim)):
        k = (i + 1) % len(rim)
        triangles += [(above + i, above + k, below + k), (above + i, below + k, below + i)]
        triangles.append((below + i, below + k, len(vertices) - 1))
    return np.array(vertices), np.array(normals), np.array(triangles)


def head(frequency: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """A head without hair, 21 cm high, that looks along +z: vertices, unit normals, triangles.

    An ellipsoid with bumps (1 - q)^3, where q < 1 is the squared distance from a bump's centre, in units of its size.
    """
    bumps = [  # centre and size, on a unit sphere; height in metres; those beside the centre line are mirrored
        ((0.0, 0.05, 1.0), (0.17, 0.36, 0.5), 0.012),  # bridge of the nose
        ((0.0, -0.20, 0.98), (0.21, 0.21, 0.4), 0.021),  # and its tip
        ((0.34, 0.10, 0.93), (0.30, 0.20, 0.5), -0.015),  # sockets of the eyes
        ((0.34, 0.09, 0.93), (0.18, 0.12, 0.4), 0.009),  # lids
        ((0.0, 0.34, 0.94), (0.75, 0.17, 0.6), 0.006),  # brow
        ((0.0, -0.46, 0.88), (0.34, 0.10, 0.4), 0.009),  # lips
        ((0.0, -0.61, 0.79), (0.30, 0.10, 0.4), 0.010),
        ((0.0, -0.535, 0.84), (0.36, 0.05, 0.3), -0.003),
        ((0.0, -0.84, 0.54), (0.36, 0.26, 0.5), 0.014),  # chin
        ((0.55, -0.22, 0.80), (0.42, 0.40, 0.5), 0.007),  # cheeks
        ((0.75, -0.55, 0.35), (0.60, 0.50, 0.6), 0.010),  # jaw
        ((0.97, 0.02, -0.22), (0.60, 0.36, 0.17), 0.019),  # ears
        ((0.99, 0.04, -0.13), (0.50, 0.24, 0.10), -0.010),
    ]
    points, triangles = geodesic(frequency)
    vertices = points * np.array([0.070, 0.108, 0.095])
    for middle, size, height in bumps:
        for side in (1.0, -1.0) if middle[0] else (1.0,):
            x, y, z = ((points - np.array(middle) * [side, 1.0, 1.0]) / np.array(size)).T
            left = np.maximum(1.0 - (x * x + y * y + z * z), 0.0)
            vertices += points * (height * left * left * left)[:, None]
    return vertices, vertex_normals(vertices, triangles), triangles


def candle() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """A candle, 10 cm high and 6 cm thick, hollow around its wick: vertices, unit normals, triangles."""

    def arc(x: float, y: float, radius: float, first: float, last: float, parts: int) -> list[tuple[float, float]]:
        angles = [sin_cos_degrees(first + (last - first) * i / parts) for i in range(parts + 1)]
        return [(x + radius * c, y + radius * s) for s, c in angles]

    profile = [(0.0, 0.0), (0.015, 0.0), *arc(0.028, 0.002, 0.002, -90.0, 0.0, 4), (0.03, 0.03), (0.03, 0.065)]
    profile += [
        *arc(0.0275, 0.0975, 0.0025, 0.0, 150.0, 8),
        (0.021, 0.095),
        (0.015, 0.0915),
        (0.007, 0.09),
        (0.0, 0.09),
    ]
    vertices, triangles = lathe(profile, 64)
    return vertices, vertex_normals(vertices, triangles), triangles


def vertex_normals(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Unit area-weighted means of the normals of the triangles around each vertex."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    (ux, uy, uz), (vx, vy, vz) = (b - a).T, (c - a).T
    flat = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], flat)
    x, y, z = normals.T
    unit: NDArray[np.float64] = normals / np.sqrt(x * x + y * y + z * z)[:, None]
    return unit


def ply_bytes(
    vertices: NDArray[np.float64], normals: NDArray[np.float64] | None, triangles: NDArray[np.int64]
) -> bytes:
    """A binary little-endian PLY file."""
    columns = vertices if normals is None else np.hstack([vertices, normals])
    names = ("x", "y", "z", "nx", "ny", "nz")[: columns.shape[1]]
    properties = "".join(f"property float {name}\n" for name in names)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{properties}"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    return header.encode() + columns.astype("<f4").tobytes() + faces.tobytes()


def write_or_compare(description: str, meshes: Mapping[str, Callable[[], bytes]]) -> int:
    """Write the mesh files of these names in scenes/, or with ``--check`` compare them; returns the exit code."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with the committed files instead of writing")
    check = parser.parse_args().check
    stale = 0
    for name, make in meshes.items():
        path, data = ROOT / "scenes" / f"{name}.ply", make()
        if not check:
            path.write_bytes(data)
        elif not path.is_file() or path.read_bytes() != data:
            print(f"{path} is not what this script makes; run it again without --check", file=sys.stderr)
            stale = 1
    return stale


MESHES: Final[Mapping[str, Callable[[], bytes]]] = {
    "bumpy": lambda: ply_bytes(*bumpy_sphere(32)),
    "tumbler": lambda: ply_bytes(*tumbler()),
    "liquid": lambda: ply_bytes(*liquid()),
    "head": lambda: ply_bytes(*head(36)),
    "candle": lambda: ply_bytes(*candle()),
    "water": lambda: ply_bytes(*water()),
}


if __name__ == "__main__":
    sys.exit(write_or_compare(__doc__ or "", MESHES))
