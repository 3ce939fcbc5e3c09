"""Renders a benchmark scene with Mitsuba 3; run by a Python that has Mitsuba, not clrender. See peer_scene.py."""

from __future__ import annotations

import time
from typing import Any

import drjit
import mitsuba
import numpy as np
from peer_scene import Job, Part, answer, camera_of, job, parts_of, timed

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


def flat_mesh(part: Part) -> Any:
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict(material(part.material))
    properties["face_normals"] = True
    if part.emission is not None:
        properties["emitter"] = mitsuba.load_dict({"type": "area", "radiance": color(part.emission)})
    mesh = mitsuba.Mesh(part.name, len(part.vertices), len(part.faces), props=properties)
    arrays = mitsuba.traverse(mesh)
    arrays["vertex_positions"] = np.ascontiguousarray(part.vertices, np.float32).ravel()
    arrays["faces"] = np.ascontiguousarray(part.faces, np.uint32).ravel()
    arrays.update()
    return mesh


def load(one: Job) -> Any:
    camera = camera_of(one)
    transform = mitsuba.ScalarTransform4f().look_at(origin=camera["position"], target=camera["target"], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": one.width, "height": one.height, "pixel_format": "rgb"}
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": one.segments, "rr_depth": NO_ROULETTE},
        "sensor": {
            "type": "perspective", "fov": camera["vertical_fov"], "fov_axis": "y", "to_world": transform,
            "film": {**film, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": one.spp},
        },
    }  # fmt: skip
    parts, spheres = parts_of(one)
    for number, sphere in enumerate(spheres):
        scene[f"sphere{number}"] = {
            "type": "sphere", "center": sphere["center"], "radius": sphere["radius"],
            "bsdf": material(sphere["material"]),
        }  # fmt: skip
    for part in parts:
        scene[part.name] = flat_mesh(part) if part.file is None else {
            "type": "ply", "filename": str(part.file), "face_normals": part.normals is None,
            "bsdf": material(part.material),
        }  # fmt: skip
    return mitsuba.load_dict(scene)


def main() -> None:
    begin = time.perf_counter()
    one = job()
    mitsuba.set_variant(one.variant)
    scene = load(one)
    if not one.variant.startswith("scalar"):
        drjit.eval()
        drjit.sync_thread()
    mitsuba.render(scene, spp=1, seed=1).numpy()  # compiled, and the tree built
    setup = time.perf_counter() - begin
    image, wall, cpu = timed(lambda: mitsuba.render(scene, spp=one.spp, seed=2).numpy())
    answer(one, image, wall, cpu, mitsuba.__version__, setup)


if __name__ == "__main__":
    main()
