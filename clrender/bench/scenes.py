"""The benchmark's scenes: a closed room with a mirror sphere, and in each one a different load.

They are made anew by the same formulae everywhere, as scene files with meshes beside them that other programs read too.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import UsageError

__all__ = ["SCENES", "write_scene"]

SCENES: Final[Mapping[str, str]] = {
    "S1": "a closed room with two lights, a cube, a diffuse and a mirror sphere",
    "S1-tess": "S1, each sphere 5,120 smooth-shaded triangles",
    "S2": "S1 with a glass sphere",
    "S2-tess": "S2, each sphere 5,120 smooth-shaded triangles",
    "S3-10k": "S1 with a mesh of 9,680 triangles in place of the cube",
    "S3-100k": "the same with 100,820 triangles",
    "S3-1M": "the same with 1,003,520 triangles",
    "S3-4M": "the same with 3,996,180 triangles",
    "S4": "S1 lit by a thousand small triangles in place of the two lights",
}
_FREQUENCY: Final = {"S3-10k": 22, "S3-100k": 71, "S3-1M": 224, "S3-4M": 447}
_SPHERE_FREQUENCY: Final = 16
_LOW: Final = (-2.0, 0.0, -2.0)
_HIGH: Final = (2.0, 4.0, 6.0)
_COLORS: Final = {
    "white": (0.75, 0.75, 0.75),
    "red": (0.63, 0.065, 0.05),
    "green": (0.14, 0.45, 0.091),
    "blue": (0.25, 0.35, 0.65),
    "yellow": (0.7, 0.6, 0.25),
    "black": (0.0, 0.0, 0.0),
}

Points = npt.NDArray[np.float64]
Corners = npt.NDArray[np.int32]


def write_scene(name: str, folder: Path, triangles: bool = False) -> Path:
    """Write a benchmark scene: ``scene.json``, and its meshes as binary PLY files.

    Parameters
    ----------
    name : str
        One of `SCENES`.
    folder : Path
        Output folder; has to exist.
    triangles : bool
        Spheres as triangles in any scene, for renderers without analytic spheres.

    Returns
    -------
    Path
        The scene file.

    Raises
    ------
    UsageError
        When there is no such scene.
    """
    if name not in SCENES:
        raise UsageError(f"there is no benchmark scene {name!r}; choose one of {', '.join(SCENES)}")
    base, _, variant = name.partition("-")
    shapes = [*_walls(), *(_many_lights() if base == "S4" else _two_lights())]
    if base == "S3":
        points, faces = _geodesic(_FREQUENCY[name])
        _write_ply(folder / "body.ply", points * _bumps(points)[:, None] * 0.85 + [-0.85, 0.95, -0.6], faces)
        shapes.append({"type": "mesh", "file": "body.ply", "material": "blue"})
    else:
        turned = {"rotate_degrees": [0.0, 20.0, 0.0], "translate": [-0.9, 0.9, -0.7]}
        shapes.append({"type": "box", "size": [1.2, 1.8, 1.0], "transform": turned, "material": "blue"})
    first = "glass" if base == "S2" else "yellow"
    for number, (center, radius, material) in enumerate(
        (((0.9, 0.6, 0.9), 0.6, first), ((0.75, 0.8, -1.0), 0.8, "mirror"))
    ):
        if triangles or variant == "tess":
            points, faces = _geodesic(_SPHERE_FREQUENCY)
            _write_ply(folder / f"sphere{number}.ply", points * radius + center, faces, points)
            shapes.append({"type": "mesh", "file": f"sphere{number}.ply", "material": material})
        else:
            shapes.append({"type": "sphere", "center": center, "radius": radius, "material": material})
    materials: dict[str, Any] = {k: {"type": "lambert", "reflectance": color} for k, color in _COLORS.items()}
    materials["mirror"] = {"type": "mirror", "reflectance": [0.9] * 3}
    materials["glass"] = {"type": "dielectric", "ior": 1.5}
    camera = {"position": [0.0, 2.0, 5.6], "target": [0.0, 2.0, 0.0], "vertical_fov": 45.0}
    path = folder / "scene.json"
    path.write_text(json.dumps({"camera": camera, "materials": materials, "shapes": shapes}), encoding="utf-8")
    return path


def _quad(a: tuple[float, ...], b: tuple[float, ...], d: tuple[float, ...], **more: Any) -> dict[str, Any]:
    u, v = [y - x for x, y in zip(a, b, strict=True)], [y - x for x, y in zip(a, d, strict=True)]
    return {"type": "quad", "origin": list(a), "edge_u": u, "edge_v": v, **more}


def _walls() -> list[dict[str, Any]]:
    (x0, y0, z0), (x1, y1, z1) = _LOW, _HIGH
    return [
        _quad((x0, y0, z1), (x1, y0, z1), (x0, y0, z0), material="white"),
        _quad((x0, y1, z0), (x1, y1, z0), (x0, y1, z1), material="white"),
        _quad((x0, y0, z0), (x1, y0, z0), (x0, y1, z0), material="white"),
        _quad((x1, y0, z1), (x0, y0, z1), (x1, y1, z1), material="white"),
        _quad((x0, y0, z1), (x0, y0, z0), (x0, y1, z1), material="red"),
        _quad((x1, y0, z0), (x1, y0, z1), (x1, y1, z0), material="green"),
    ]


def _two_lights() -> list[dict[str, Any]]:
    y, more = _HIGH[1] - 0.01, {"material": "black", "emission": [17.0, 14.0, 10.0]}
    return [_quad((x - 0.5, y, -0.3), (x + 0.5, y, -0.3), (x - 0.5, y, 0.5), **more) for x in (-1.0, 1.0)]


def _many_lights() -> list[dict[str, Any]]:
    random, count = np.random.default_rng(7), 1000
    low, high = (-1.8, 2.9, -1.8), (1.8, 3.9, 3.0)
    center = np.stack([random.uniform(a, b, count) for a, b in zip(low, high, strict=True)], 1)
    out = random.normal(size=(count, 3, 3))
    out /= np.linalg.norm(out, axis=2, keepdims=True)
    corners = (center[:, None] + 0.03 * out).astype(np.float32).tolist()
    more = {"material": "black", "emission": [30.0, 26.0, 20.0]}
    return [{"type": "triangle", "vertices": each, **more} for each in corners]


def _geodesic(frequency: int) -> tuple[Points, Corners]:
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


def _bumps(p: Points) -> Points:
    """Radius of the displaced sphere relative to the sphere."""
    k = 24.0
    large = np.sin(k * p[:, 0]) * np.sin(k * p[:, 1] + 1.0) * np.sin(k * p[:, 2] + 2.0)
    small: Points = np.sin(6.0 * k * p).prod(1)
    return 1.0 + 0.08 * large + 0.01 * small


def _write_ply(path: Path, points: Points, faces: Corners, normals: Points | None = None) -> None:
    columns = points if normals is None else np.concatenate([points, normals], 1)
    names = "xyz" if normals is None else ("x", "y", "z", "nx", "ny", "nz")
    rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    path.write_bytes("\n".join(header).encode() + columns.astype("<f4").tobytes() + rows.tobytes())
