"""Writes the mesh files in scenes/; they are committed, and the same bytes come out on every machine.

Run ``python scripts/make_meshes.py`` to write them, with ``--check`` to compare them with what is committed.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from clrender.scene.angles import sin_cos_degrees  # noqa: E402

__all__ = ["bumpy_sphere", "geodesic", "lathe", "liquid", "main", "ply_bytes", "tumbler"]


def geodesic(frequency: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unit sphere of 20 f^2 triangles from an icosahedron, vertices shared, normals outward.

    Parameters
    ----------
    frequency : int
        Parts into which each edge of the icosahedron is cut.

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
        """Number of the point with these integer weights of corners; one point has one key from every face."""
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
        From the axis to the axis, anticlockwise, so that normals are outward; radius 0 at both ends alone.
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
    """What fills the tumbler to 85 mm: a cylinder that reaches to the middle of its walls and into its foot."""
    vertices, triangles = lathe([(0.0, 0.007), (0.0355, 0.007), (0.0355, 0.085), (0.0, 0.085)], 64)
    return vertices, None, triangles


def vertex_normals(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Unit means of the normals of the triangles around each vertex, by their areas."""
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


def main() -> int:
    """Write the files, or compare; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with the committed files instead of writing")
    check = parser.parse_args().check
    stale = 0
    for name, mesh in (("bumpy", bumpy_sphere(32)), ("tumbler", tumbler()), ("liquid", liquid())):
        path, data = ROOT / "scenes" / f"{name}.ply", ply_bytes(*mesh)
        if not check:
            path.write_bytes(data)
        elif not path.is_file() or path.read_bytes() != data:
            print(f"{path} is not what this script makes; run it again without --check", file=sys.stderr)
            stale = 1
    return stale


if __name__ == "__main__":
    sys.exit(main())
