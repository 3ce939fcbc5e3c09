"""Rays per second of Embree alone, one ray at a time, with rays recorded from diffuse paths in a benchmark scene.

Run by a Python that has embreex. There is no shading in the timed part, so it is an upper bound for renderers. See
peer_scene.py.
"""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from peer_scene import Job, answer, camera_of, job, parts_of, timed

__all__: list[str] = []

PATHS = 20_000
OFFSET = 1e-4


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
    parts, _ = parts_of(one)
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
