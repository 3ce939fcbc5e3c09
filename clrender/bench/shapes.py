"""Building blocks of the benchmark's scenes: parallelograms, triangulated spheres, bumps, and PLY files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["bumpy_body", "geodesic", "quad", "torus", "write_ply"]

Points = npt.NDArray[np.float64]
Corners = npt.NDArray[np.int32]


def quad(a: tuple[float, ...], b: tuple[float, ...], d: tuple[float, ...], **more: Any) -> dict[str, Any]:
    """The parallelogram with corner `a` and its neighbours `b` and `d`."""
    u, v = [y - x for x, y in zip(a, b, strict=True)], [y - x for x, y in zip(a, d, strict=True)]
    return {"type": "quad", "origin": list(a), "edge_u": u, "edge_v": v, **more}


def geodesic(frequency: int) -> tuple[Points, Corners]:
    """Unit sphere of 20 `frequency`² triangles: an icosahedron, subdivided and projected onto the sphere."""
    t = (1.0 + 5.0**0.5) / 2.0
    signs = [(a, b) for a in (-1.0, 1.0) for b in (-t, t)]
    corners = np.array([p for a, b in signs for p in ((0.0, a, b), (a, b, 0.0), (b, 0.0, a))])
    side = np.linalg.norm(corners[:, None] - corners[None], axis=2)
    near = np.isclose(side, 2.0)
    faces = [
        (i, j, k) if np.linalg.det(corners[[i, j, k]]) > 0.0 else (i, k, j)
        for i in range(12) for j in range(i + 1, 12) for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]  # fmt: skip
    i, j = np.meshgrid(np.arange(frequency + 1), np.arange(frequency + 1), indexing="ij")
    inside = i + j <= frequency
    number = np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1)
    lower = (i + j < frequency)[:-1, :-1]
    upper = (i + j < frequency - 1)[:-1, :-1]
    grid = np.concatenate([
        np.stack([number[:-1, :-1][lower], number[1:, :-1][lower], number[:-1, 1:][lower]], 1),
        np.stack([number[1:, :-1][upper], number[1:, 1:][upper], number[:-1, 1:][upper]], 1),
    ])  # fmt: skip
    weights = np.stack([frequency - i - j, i, j], -1)[inside] / frequency
    points = np.concatenate([weights @ corners[list(face)] for face in faces])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    count = len(weights)
    return points, np.concatenate([grid + count * k for k in range(len(faces))]).astype(np.int32)


def torus(radius: float, tube: tuple[float, float], around: int, along: int) -> tuple[Points, Corners, Points]:
    """A torus around the y axis, of 2 `around` `along` triangles, with normals.

    `radius` is that of the circle in the middle of the tube, which is an ellipse of the semi-axes `tube`, outward and
    upward.
    """
    turn = np.arange(around)[:, None] * (2.0 * np.pi / around)
    tilt = np.arange(along)[None, :] * (2.0 * np.pi / along)
    out, up = tube[0] * np.cos(tilt), tube[1] * np.sin(tilt)
    slope = np.stack([np.cos(tilt) / tube[0], np.sin(tilt) / tube[1]]) / np.sqrt(
        (np.cos(tilt) / tube[0]) ** 2 + (np.sin(tilt) / tube[1]) ** 2
    )

    def turned(outward: Points, upward: Points) -> Points:
        whole = np.broadcast_arrays(outward * np.cos(turn), upward, outward * np.sin(turn))
        return np.stack(whole, axis=-1).reshape(-1, 3)

    i, j = np.meshgrid(np.arange(around), np.arange(along), indexing="ij")
    a, b = i * along + j, (i + 1) % around * along + j
    c, d = (i + 1) % around * along + (j + 1) % along, i * along + (j + 1) % along
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    return turned(radius + out, up), faces.astype(np.int32), turned(slope[0], slope[1])


def bumpy_body(frequency: int) -> tuple[Points, Corners]:
    """The displaced sphere that stands in the room, of 20 `frequency`² triangles."""
    points, faces = geodesic(frequency)
    return points * _bumps(points)[:, None] * 0.85 + [-0.85, 0.95, -0.6], faces


def _bumps(p: Points) -> Points:
    """Radius of the displaced sphere relative to the sphere."""
    k = 24.0
    large = np.sin(k * p[:, 0]) * np.sin(k * p[:, 1] + 1.0) * np.sin(k * p[:, 2] + 2.0)
    small: Points = np.sin(6.0 * k * p).prod(1)
    return 1.0 + 0.08 * large + 0.01 * small


def write_ply(
    path: Path, points: Points, faces: Corners, normals: Points | None = None, coordinates: Points | None = None
) -> None:
    """A binary PLY file of vertices (V, 3), triangles (F, 3), vertex normals (V, 3) or texture coordinates (V, 2)."""
    names, columns = ["x", "y", "z"], [points]
    for more, values in ((("nx", "ny", "nz"), normals), (("s", "t"), coordinates)):
        if values is not None:
            names += more
            columns.append(values)
    rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    path.write_bytes("\n".join(header).encode() + np.concatenate(columns, 1).astype("<f4").tobytes() + rows.tobytes())
