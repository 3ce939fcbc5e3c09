"""Shared by the peers' scripts: command line, scene as meshes, result. Needs NumPy, not clrender."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

__all__ = [
    "Job",
    "Part",
    "answer",
    "camera_of",
    "job",
    "parts_of",
    "refuse_rich",
    "timed",
]


@dataclass(frozen=True)
class Job:
    """One render: scene, size, samples per pixel, segments of a path, seed, output path.

    `variant` is the peer's, with further options after a colon.
    """

    variant: str
    scene: Path
    width: int
    height: int
    spp: int
    segments: int
    seed: int
    image: Path


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
    normals : (V, 3) float32 or None
        Vertex normals of smooth meshes.
    """

    name: str
    material: dict[str, Any]
    emission: list[float] | None
    vertices: Any
    faces: Any
    normals: Any = None


def job() -> Job:
    """The command line: ``VARIANT SCENE.json WIDTH HEIGHT SPP SEGMENTS SEED IMAGE.npy``."""
    variant, scene, *numbers, image = sys.argv[1:]
    width, height, spp, segments, seed = (int(number) for number in numbers)
    return Job(variant, Path(scene), width, height, spp, segments, seed, Path(image))


def camera_of(one: Job) -> dict[str, Any]:
    """``position, target, vertical_fov``."""
    camera: dict[str, Any] = json.loads(one.scene.read_text(encoding="utf-8"))["camera"]
    return camera


def refuse_rich(one: Job, name: str) -> None:
    """Exit with a message if the scene contains more than Lambert, mirrors and smooth glass."""
    described = json.loads(one.scene.read_text(encoding="utf-8"))
    if any(described.get(key) for key in ("lights", "media", "groups")):
        sys.exit(f"{name} has no translation of this scene's materials here; compare it with mitsuba")


def parts_of(one: Job) -> tuple[list[Part], list[dict[str, Any]]]:
    """The scene's meshes, and its spheres as in the scene file, with their materials."""
    described = json.loads(one.scene.read_text(encoding="utf-8"))
    materials = described["materials"]
    parts, spheres = [], []
    groups: dict[str, list[dict[str, Any]]] = {}
    for number, shape in enumerate(described["shapes"]):
        if shape["type"] == "sphere":
            spheres.append({**shape, "material": materials[shape["material"]]})
        elif shape["type"] == "mesh":
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
    return parts, spheres


def timed(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """The result of `work`, and its elapsed and CPU seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def answer(one: Job, image: Any, wall: float, cpu: float, version: str, setup: float, **more: Any) -> None:
    """Save the image, (height, width, 3) with the top row first, and print the line that the benchmark reads."""
    if image is not None:
        np.save(one.image, np.ascontiguousarray(image, np.float32))
        more["mean"] = [round(float(x), 6) for x in image.mean((0, 1))]
    line = {"wall_seconds": wall, "cpu_seconds": cpu, "version": version, "setup_seconds": round(setup, 4), **more}
    print("\n" + json.dumps(line), flush=True)


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


def _read_ply(path: Path) -> tuple[Any, Any, Any]:
    """Vertices, faces and normals of a PLY file that clrender.bench.scenes wrote."""
    raw = path.read_bytes()
    end = raw.index(b"end_header\n") + len(b"end_header\n")
    header = raw[:end].decode().split("\n")
    counts = [int(line.split()[-1]) for line in header if line.startswith("element")]
    columns = sum(line.startswith("property float") for line in header)
    points = np.frombuffer(raw, "<f4", counts[0] * columns, end).reshape(-1, columns)
    rows = np.frombuffer(raw, [("count", "u1"), ("corners", "<i4", 3)], counts[1], end + points.nbytes)
    return points[:, :3].copy(), rows["corners"].copy(), points[:, 3:].copy() if columns == 6 else None
