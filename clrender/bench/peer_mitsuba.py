"""Renders a benchmark scene with Mitsuba 3; run by a Python that has Mitsuba, not clrender. See peer_scene.py."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import drjit
import mitsuba
import numpy as np
from peer_scene import Job, Part, answer, camera_of, job, lights_of, parts_of, timed

__all__: list[str] = []

NO_ROULETTE = 100_000


def color(values: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def texture(value: Any, folder: Path) -> Any:
    """A constant colour, or a bitmap."""
    if isinstance(value, dict):
        raw = value.get("color_space") != "srgb"
        # The first row lies at v = 0 there, and at v = 1 in clrender.
        upright = mitsuba.ScalarTransform4f().scale([1.0, -1.0, 1.0])
        between = {"linear": "bilinear", "nearest": "nearest"}[value.get("filter", "linear")]
        file = {"filename": str(folder / value["texture"]), "raw": raw, "filter_type": between}
        return {"type": "bitmap", **file, "to_uv": upright}
    return color(value)


def material(described: dict[str, Any], folder: Path) -> dict[str, Any]:
    kind = described["type"]
    alpha = described.get("roughness", 0.0) ** 2
    if kind == "dielectric":
        if described.get("thin"):
            return {"type": "thindielectric", "int_ior": described["ior"], "ext_ior": 1.0}
        rough = {"type": "roughdielectric", "distribution": "ggx", "alpha": alpha} if alpha else {"type": "dielectric"}
        return {**rough, "int_ior": described["ior"], "ext_ior": 1.0}
    if kind == "mirror":
        one: dict[str, Any] = {
            "type": "conductor",
            "material": "none",
            "specular_reflectance": color(described["reflectance"]),
        }
    elif kind == "conductor":
        one = {"type": "roughconductor", "distribution": "ggx", "alpha": alpha} if alpha else {"type": "conductor"}
        if described.get("anisotropy"):
            del one["alpha"]
            # Rougher around the y axis, where `round_shape` puts the poles
            one |= {"alpha_u": alpha + (1.0 - alpha) * described["anisotropy"] ** 2, "alpha_v": alpha}
        one |= {key: color(value) for key, value in zip(("eta", "k"), index_of(described), strict=True)}
    elif kind == "principled":
        one = {"type": "principled", "base_color": texture(described["base_color"], folder), "specular": 0.5}
        one |= {
            "metallic": described.get("metallic", 0.0),
            "roughness": described["roughness"],
            "clearcoat": described.get("coat", 0.0),
        }
        one |= {"clearcoat_gloss": 1.0 - described.get("coat_roughness", 0.0)}
    elif kind == "mix":
        first, second = (material(part, folder) for part in described["materials"])
        # The weight is that of the second, as in clrender. Each part has its two sides itself
        return {"type": "blendbsdf", "weight": described["weight"], "first": first, "second": second}
    else:
        one = {"type": "diffuse", "reflectance": texture(described["reflectance"], folder)}
    if "normal_map" in described:
        bitmap = texture(described["normal_map"], folder)
        # What clrender has not: a microsurface of the map's own (Schüssler et al. 2017).
        one = {"type": "normalmap", "normalmap": bitmap, "nested": one, "use_shadowing_function": False}
    return {"type": "twosided", "one": one}


GOLD = ((0.21, 0.43, 1.38), (3.272, 2.455, 1.914))


def index_of(described: dict[str, Any]) -> Any:
    """Complex index of refraction of a metal, as clrender has it."""
    return GOLD if described.get("metal") == "Au" else (described["eta"], described["k"])


def flat_mesh(part: Part, folder: Path) -> Any:
    properties = mitsuba.Properties()
    properties["bsdf"] = mitsuba.load_dict(material(part.material, folder))
    properties["face_normals"] = True
    if part.emission is not None:
        properties["emitter"] = mitsuba.load_dict({"type": "area", "radiance": color(part.emission)})
    textured = part.coordinates is not None and any(isinstance(value, dict) for value in part.material.values())
    mesh = mitsuba.Mesh(part.name, len(part.vertices), len(part.faces), has_vertex_texcoords=textured, props=properties)
    arrays = mitsuba.traverse(mesh)
    arrays["vertex_positions"] = np.ascontiguousarray(part.vertices, np.float32).ravel()
    arrays["faces"] = np.ascontiguousarray(part.faces, np.uint32).ravel()
    if textured:
        arrays["vertex_texcoords"] = np.ascontiguousarray(part.coordinates, np.float32).ravel()
    arrays.update()
    return mesh


def light(described: dict[str, Any], folder: Path) -> dict[str, Any]:
    if described["type"] == "point":
        return {"type": "point", "position": described["position"], "intensity": color(described["intensity"])}
    if described["type"] == "directional":
        values = {"direction": described["direction"], "irradiance": color(described["irradiance"])}
        return {"type": "directional", **values}
    if described["type"] != "environment":
        raise ValueError(f"a light of type {described['type']} has no equal in Mitsuba")
    if "file" in described:
        return {"type": "envmap", "filename": str(folder / described["file"])}
    return {"type": "constant", "radiance": color(described["radiance"])}


def round_shape(described: dict[str, Any], folder: Path) -> dict[str, Any]:
    made: dict[str, Any] = {"type": described["type"], "bsdf": material(described["material"], folder)}
    if described.get("emission") is not None:
        made["emitter"] = {"type": "area", "radiance": color(described["emission"])}
    center, radius = described["center"], described["radius"]
    if described["type"] == "sphere":
        if described["material"].get("anisotropy"):
            # Its poles are on the z axis there, on y in clrender
            upright = mitsuba.ScalarTransform4f().translate(center).rotate([1.0, 0.0, 0.0], -90.0).scale(radius)
            return {**made, "to_world": upright}
        return {**made, "center": center, "radius": radius}
    normal = np.array(described["normal"]) / np.linalg.norm(described["normal"])
    upward = [1, 0, 0] if abs(normal[0]) < 0.9 else [0, 1, 0]
    turned = mitsuba.ScalarTransform4f().look_at(origin=center, target=(np.array(center) + normal).tolist(), up=upward)
    return {**made, "to_world": turned @ mitsuba.ScalarTransform4f().scale([radius, radius, 1.0])}


def load(one: Job) -> Any:
    camera = camera_of(one)
    transform = mitsuba.ScalarTransform4f().look_at(
        origin=camera["position"], target=camera["target"], up=camera.get("up", [0, 1, 0])
    )
    film = {"type": "hdrfilm", "width": one.width, "height": one.height, "pixel_format": "rgb"}
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": one.segments, "rr_depth": NO_ROULETTE if one.segments > 0 else 8},
        "sensor": {
            "type": "perspective", "fov": camera["vertical_fov"], "fov_axis": "y", "to_world": transform,
            "film": {**film, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": one.spp},
        },
    }  # fmt: skip
    parts, round_shapes = parts_of(one)
    folder = one.scene.parent
    for number, described in enumerate(lights_of(one)):
        scene[f"light{number}"] = light(described, folder)
    for number, shape in enumerate(round_shapes):
        scene[f"round{number}"] = round_shape(shape, folder)
    for part in parts:
        scene[part.name] = flat_mesh(part, folder) if part.file is None else {
            "type": "ply", "filename": str(part.file), "face_normals": part.normals is None,
            "bsdf": material(part.material, folder),
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
    mitsuba.render(scene, spp=1, seed=one.seed + 1).numpy()  # compiled, and the tree built
    setup = time.perf_counter() - begin
    image, wall, cpu = timed(lambda: mitsuba.render(scene, spp=one.spp, seed=one.seed).numpy())
    answer(one, image, wall, cpu, mitsuba.__version__, setup)


if __name__ == "__main__":
    main()
