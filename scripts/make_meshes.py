"""Writes the mesh files in scenes/; they are committed, and the same bytes come out on every machine.

Run ``python scripts/make_meshes.py`` to write them, with ``--check`` to compare them with what is committed.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from clrender.scene.angles import sin_cos_degrees  # noqa: E402

__all__ = ["bumpy_sphere", "geodesic", "main", "ply_bytes"]


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
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    (ux, uy, uz), (vx, vy, vz) = (b - a).T, (c - a).T
    flat = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], flat)
    x, y, z = normals.T
    return vertices, normals / np.sqrt(x * x + y * y + z * z)[:, None], triangles


def ply_bytes(vertices: NDArray[np.float64], normals: NDArray[np.float64], triangles: NDArray[np.int64]) -> bytes:
    """A binary little-endian PLY file."""
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{properties}"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    return header.encode() + np.hstack([vertices, normals]).astype("<f4").tobytes() + faces.tobytes()


def main() -> int:
    """Write the files, or compare; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with the committed files instead of writing")
    check = parser.parse_args().check
    path, data = ROOT / "scenes" / "bumpy.ply", ply_bytes(*bumpy_sphere(32))
    if not check:
        path.write_bytes(data)
    elif not path.is_file() or path.read_bytes() != data:
        print(f"{path} is not what this script makes; run it again without --check", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
