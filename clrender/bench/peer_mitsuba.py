"""Renders a benchmark scene with Mitsuba 3 and prints what it took; run by a Python that has Mitsuba, not clrender.

``python peer_mitsuba.py VARIANT SCENE.json WIDTH HEIGHT SPP SEGMENTS``
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import drjit
import mitsuba
import numpy as np

__all__: list[str] = []

NO_ROULETTE = 100_000


def color(values: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def material(described: dict[str, Any]) -> dict[str, Any]:
    if described["type"] == "dielectric":
        return {"type": "dielectric", "int_ior": described["ior"], "ext_ior": 1.0}
    if described["type"] == "mirror":
        one: dict[str, Any] = {
            "type": "conductor",
            "material": "none",
            "specular_reflectance": color(described["reflectance"]),
        }
    else:
        one = {"type": "diffuse", "reflectance": color(described["reflectance"])}
    return {"type": "twosided", "one": one}


def triangles(shape: dict[str, Any]) -> tuple[Any, Any]:
    """Vertices and faces of a quad, triangle or turned box."""
    if shape["type"] == "triangle":
        return np.array(shape["vertices"]), np.array([[0, 1, 2]])
    if shape["type"] == "quad":
        o, u, v = (np.array(shape[key]) for key in ("origin", "edge_u", "edge_v"))
        return np.array([o, o + u, o + u + v, o + v]), np.array([[0, 1, 2], [0, 2, 3]])
    turn = math.radians(shape["transform"]["rotate_degrees"][1])
    c, s = math.cos(turn), math.sin(turn)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * shape["size"]
    corners = corners @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T + shape["transform"]["translate"]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])


def flat_mesh(name: str, vertices: Any, faces: Any, bsdf: dict[str, Any], emission: Any) -> Any:
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict(bsdf)
    properties["face_normals"] = True
    if emission is not None:
        properties["emitter"] = mitsuba.load_dict({"type": "area", "radiance": color(emission)})
    mesh = mitsuba.Mesh(name, len(vertices), len(faces), props=properties)
    arrays = mitsuba.traverse(mesh)
    arrays["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
    arrays["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
    arrays.update()
    return mesh


def load(path: Path, width: int, height: int, spp: int, segments: int) -> Any:
    described = json.loads(path.read_text(encoding="utf-8"))
    camera, materials = described["camera"], described["materials"]
    transform = mitsuba.ScalarTransform4f().look_at(origin=camera["position"], target=camera["target"], up=[0, 1, 0])
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": segments, "rr_depth": NO_ROULETTE},
        "sensor": {
            "type": "perspective", "fov": camera["vertical_fov"], "fov_axis": "y", "to_world": transform,
            "film": {
                "type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent", "sample_count": spp},
        },
    }  # fmt: skip
    # Shapes of one material and emission as one mesh, as a person would model them.
    groups: dict[str, list[dict[str, Any]]] = {}
    for number, shape in enumerate(described["shapes"]):
        bsdf = material(materials[shape["material"]])
        if shape["type"] == "sphere":
            scene[f"shape{number}"] = {
                "type": "sphere",
                "center": shape["center"],
                "radius": shape["radius"],
                "bsdf": bsdf,
            }
        elif shape["type"] == "mesh":
            smooth = b"property float nx" in (path.parent / shape["file"]).open("rb").read(400)
            file = str(path.parent / shape["file"])
            scene[f"shape{number}"] = {"type": "ply", "filename": file, "face_normals": not smooth, "bsdf": bsdf}
        else:
            groups.setdefault(json.dumps([shape["material"], shape.get("emission")]), []).append(shape)
    for key, shapes in groups.items():
        name, emission = json.loads(key)
        parts = [triangles(shape) for shape in shapes]
        offsets = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
        vertices = np.concatenate([vertices for vertices, _ in parts])
        faces = np.concatenate([faces + offset for (_, faces), offset in zip(parts, offsets, strict=True)])
        scene[f"group {name}"] = flat_mesh(name, vertices, faces, material(materials[name]), emission)
    return mitsuba.load_dict(scene)


def main() -> None:
    begin = time.perf_counter()
    variant, path, *numbers = sys.argv[1:]
    width, height, spp, segments = map(int, numbers)
    mitsuba.set_variant(variant)
    scene = load(Path(path), width, height, spp, segments)
    vector = variant.startswith("llvm")
    if vector:
        drjit.eval()
        drjit.sync_thread()
    mitsuba.render(scene, spp=1, seed=1).numpy()  # compiled, and the tree built
    loaded = time.perf_counter()
    wall, cpu = time.perf_counter(), time.process_time()
    image = mitsuba.render(scene, spp=spp, seed=2).numpy()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    answer = {
        "wall_seconds": wall,
        "cpu_seconds": cpu,
        "version": mitsuba.__version__,
        "setup_seconds": round(loaded - begin, 4),
    }
    print(json.dumps({**answer, "mean": [round(float(x), 6) for x in image.mean((0, 1))]}))


if __name__ == "__main__":
    main()
