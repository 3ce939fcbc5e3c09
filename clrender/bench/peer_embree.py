"""Rays per second of Embree alone, one ray at a time, with rays recorded from diffuse paths in a benchmark scene.

Run by a Python that has embreex. There is no shading in the timed part, so it is an upper bound for renderers. See
peer_scene.py.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from peer_scene import Job, answer, job, timed

__all__: list[str] = []

PATHS = 20_000
OFFSET = 1e-4


@dataclass(frozen=True)
class Part:
    """Shapes of one material and emission as one mesh, as in an ordinary scene.

    Attributes
    ----------
    name : str
    material : dict
        As in the scene file.
    emission : list of float or None
    vertices, faces : (V, 3) float32, (F, 3) int32
    """

    name: str
    material: dict[str, Any]
    emission: list[float] | None
    vertices: Any
    faces: Any


def camera_of(one: Job) -> dict[str, Any]:
    """``position, target, vertical_fov``."""
    camera: dict[str, Any] = json.loads(one.scene.read_text(encoding="utf-8"))["camera"]
    return camera


def parts_of(one: Job) -> list[Part]:
    """The scene's meshes, which it has for spheres too."""
    described = json.loads(one.scene.read_text(encoding="utf-8"))
    materials = described["materials"]
    parts = []
    groups: dict[str, list[dict[str, Any]]] = {}
    for number, shape in enumerate(described["shapes"]):
        if shape["type"] == "mesh":
            mesh = _read_ply(one.scene.parent / shape["file"])
            parts.append(Part(f"mesh{number}", materials[shape["material"]], None, *mesh))
        elif shape["type"] != "instance":
            groups.setdefault(json.dumps([shape["material"], shape.get("emission")]), []).append(shape)
    for number, (key, shapes) in enumerate(groups.items()):
        name, emission = json.loads(key)
        pieces = [_triangles(shape) for shape in shapes]
        offsets = np.cumsum([0, *(len(vertices) for vertices, _ in pieces[:-1])])
        vertices = np.concatenate([vertices for vertices, _ in pieces]).astype(np.float32)
        faces = np.concatenate([faces + offset for (_, faces), offset in zip(pieces, offsets, strict=True)])
        parts.append(Part(f"group{number}_{name}", materials[name], emission, vertices, faces.astype(np.int32)))
    return parts


def _triangles(shape: dict[str, Any]) -> tuple[Any, Any]:
    """Vertices and faces of a quad, triangle or turned box."""
    if shape["type"] == "triangle":
        return np.array(shape["vertices"]), np.array([[0, 1, 2]])
    if shape["type"] == "quad":
        o, u, v = (np.array(shape[key]) for key in ("origin", "edge_u", "edge_v"))
        return np.array([o, o + u, o + u + v, o + v]), np.array([[0, 1, 2], [0, 2, 3]])
    transform = shape.get("transform", {"rotate_degrees": [0.0, 0.0, 0.0], "translate": shape.get("center")})
    turn = math.radians(transform["rotate_degrees"][1])
    c, s = math.cos(turn), math.sin(turn)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * shape["size"]
    corners = corners @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T + transform["translate"]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])


def _read_ply(path: Path) -> tuple[Any, Any]:
    """Vertices and faces of a PLY file that clrender.bench.scenes wrote."""
    raw = path.read_bytes()
    end = raw.index(b"end_header\n") + len(b"end_header\n")
    header = raw[:end].decode().split("\n")
    counts = [int(line.split()[-1]) for line in header if line.startswith("element")]
    columns = sum(line.startswith("property float") for line in header)
    points = np.frombuffer(raw, "<f4", counts[0] * columns, end).reshape(-1, columns)
    rows = np.frombuffer(raw, [("count", "u1"), ("corners", "<i4", 3)], counts[1], end + points.nbytes)
    return points[:, :3].copy(), rows["corners"].copy()


def cosine_directions(random: Any, normals: Any) -> Any:
    """Directions about the normals: a point on the unit sphere around the normal's tip."""
    around = random.normal(size=normals.shape)
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    out = normals + around
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def camera_rays(one: Job, random: Any) -> tuple[Any, Any]:
    camera = camera_of(one)
    origin, target = np.array(camera["position"]), np.array(camera["target"])
    forward = (target - origin) / np.linalg.norm(target - origin)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    at = (random.uniform(-1.0, 1.0, (PATHS, 2))) * np.tan(np.radians(camera["vertical_fov"] / 2.0))
    directions = forward + at[:, :1] * right * one.width / one.height + at[:, 1:] * np.cross(right, forward)
    return np.tile(origin, (PATHS, 1)), directions / np.linalg.norm(directions, axis=1, keepdims=True)


def main() -> None:
    begin = time.perf_counter()
    one = job()
    random = np.random.default_rng(1)
    parts = parts_of(one)
    mirrors = np.array([part.material["type"] != "lambert" for part in parts])
    scene = EmbreeScene()
    for part in parts:
        TriangleMesh(scene, np.ascontiguousarray(part.vertices[part.faces], np.float32))
    lights = np.concatenate([part.vertices[part.faces].mean(1) for part in parts if part.emission is not None])

    def find(rays: tuple[Any, ...], query: str) -> Any:
        origins, directions = (np.ascontiguousarray(array, np.float32) for array in rays)
        return scene.run(origins, directions, query=query, output=query == "INTERSECT" or None)

    _, _, build = timed(lambda: find((np.zeros((1, 3)), np.ones((1, 3))), "INTERSECT"))
    rays, nearest, shadow = camera_rays(one, random), [], []
    for _ in range(one.segments):
        nearest.append(rays)
        found = find(rays, "INTERSECT")
        hit = np.asarray(found["primID"]) >= 0
        origins, directions = (array[hit] for array in rays)
        normals = np.asarray(found["Ng"], np.float64)[hit]
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        cosine = (normals * directions).sum(1, keepdims=True)
        normals = np.where(cosine > 0.0, -normals, normals)
        points = origins + directions * np.asarray(found["tfar"], np.float64)[hit][:, None] + normals * OFFSET
        mirror = mirrors[np.asarray(found["geomID"])[hit]]
        to_light = lights[random.integers(len(lights), size=len(points))] - points
        lit = ~mirror & ((to_light * normals).sum(1) > 0.0)
        shadow.append((points[lit], to_light[lit]))
        reflected = directions - 2.0 * (directions * normals).sum(1, keepdims=True) * normals
        rays = points, np.where(mirror[:, None], reflected, cosine_directions(random, normals))
    frozen = [tuple(np.concatenate(arrays) for arrays in zip(*kind, strict=True)) for kind in (nearest, shadow)]
    setup = time.perf_counter() - begin
    _, wall_nearest, cpu_nearest = timed(lambda: find(frozen[0], "INTERSECT"))
    _, wall_shadow, cpu_shadow = timed(lambda: find(frozen[1], "OCCLUDED"))
    counts = [len(kind[0]) for kind in frozen]
    wall, cpu = wall_nearest + wall_shadow, cpu_nearest + cpu_shadow
    rates = {"nearest": round(counts[0] / cpu_nearest), "any": round(counts[1] / cpu_shadow)}
    more: dict[str, Any] = {"paths": PATHS, "rays": sum(counts), "rays_per_second": rates, "build_cpu_seconds": build}
    answer(one, None, wall, cpu, version("embreex"), setup, **more)


if __name__ == "__main__":
    main()
