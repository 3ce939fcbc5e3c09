"""Renders a benchmark scene with Mitsuba 3; run by a Python that has Mitsuba, not clrender. See peer_scene.py."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import drjit
import mitsuba
import numpy as np
from peer_scene import Job, Part, answer, camera_of, instances_of, job, lights_of, media_of, parts_of, timed

__all__: list[str] = []

NO_ROULETTE = 100_000


def color(values: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def texture(value: Any, folder: Path) -> Any:
    """A constant colour, or a bitmap."""
    if isinstance(value, dict):
        raw = value.get("color_space") != "srgb"
        # The first row is at v = 0 there, and at v = 1 in clrender.
        upright = mitsuba.ScalarTransform4f().scale([1.0, -1.0, 1.0])
        between = {"linear": "bilinear", "nearest": "nearest"}[value.get("filter", "linear")]
        file = {"filename": str(folder / value["texture"]), "raw": raw, "filter_type": between}
        return {"type": "bitmap", **file, "to_uv": upright}
    return color(value)


def opacity(value: Any, folder: Path) -> Any:
    """A number, or one of the channels of a bitmap."""
    if not isinstance(value, dict):
        return value
    pixels = np.array(mitsuba.Bitmap(str(folder / value["texture"])))[..., "rgba".index(value["channel"])]
    alone = mitsuba.Bitmap(np.ascontiguousarray(pixels[..., None]), mitsuba.Bitmap.PixelFormat.Y)
    alone.set_srgb_gamma(False)
    made = {**texture({**value, "color_space": "linear"}, folder), "bitmap": alone}
    del made["filename"]
    return made


def material(described: dict[str, Any], folder: Path) -> dict[str, Any]:
    if "opacity" in described:
        whole = {key: value for key, value in described.items() if key != "opacity"}
        return {"type": "mask", "opacity": opacity(described["opacity"], folder), "nested": material(whole, folder)}
    kind = described["type"]
    if kind == "null":
        return {"type": "null"}
    alpha = described.get("roughness", 0.0) ** 2
    facets = {"distribution": described.get("microfacets", "ggx"), "alpha": alpha}
    if kind == "dielectric":
        if described.get("thin"):
            return {"type": "thindielectric", "int_ior": described["ior"], "ext_ior": 1.0}
        rough = {"type": "roughdielectric", **facets} if alpha else {"type": "dielectric"}
        return {**rough, "int_ior": described["ior"], "ext_ior": 1.0}
    if kind == "mirror":
        one: dict[str, Any] = {
            "type": "conductor",
            "material": "none",
            "specular_reflectance": color(described["reflectance"]),
        }
    elif kind == "conductor":
        one = {"type": "roughconductor", **facets} if alpha else {"type": "conductor"}
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
        # The weight is that of the second, as in clrender. Each part is two-sided itself
        return {"type": "blendbsdf", "weight": described["weight"], "first": first, "second": second}
    else:
        one = {"type": "diffuse", "reflectance": texture(described["reflectance"], folder)}
    if "normal_map" in described:
        bitmap = texture(described["normal_map"], folder)
        # Unlike clrender: a microsurface for the normal map (Schüssler et al. 2017).
        one = {"type": "normalmap", "normalmap": bitmap, "nested": one, "use_shadowing_function": False}
    return {"type": "twosided", "one": one}


GOLD = ((0.21, 0.43, 1.38), (3.272, 2.455, 1.914))


def index_of(described: dict[str, Any]) -> Any:
    """Complex index of refraction of a metal, as in clrender."""
    return GOLD if described.get("metal") == "Au" else (described["eta"], described["k"])


def medium(described: dict[str, Any]) -> Any:
    """A homogeneous medium with a Henyey-Greenstein phase function."""
    absorption, scattering = (np.broadcast_to(described.get(key, 0.0), 3) for key in ("absorption", "scattering"))
    extinction = absorption + scattering
    scale = max(float(extinction.max()), 1e-30)
    albedo = np.divide(scattering, extinction, out=np.zeros(3), where=extinction > 0.0)
    # The albedo of a volume is at most 1
    made = {"albedo": color(albedo.tolist()), "sigma_t": color((extinction / scale).tolist()), "scale": scale}
    return mitsuba.load_dict({"type": "homogeneous", **made, "phase": {"type": "hg", "g": described.get("g", 0.0)}})


def media_around(described: dict[str, Any], interior: str | None, media: dict[str, Any], fog: str | None) -> Any:
    """Media behind and in front of a surface that transmits light."""
    if interior is None and (fog is None or described["type"] not in ("dielectric", "null") or described.get("thin")):
        return {}
    around = {} if interior is None else {"interior": media[interior]}
    return around if fog is None else {**around, "exterior": media[fog]}


def flat_mesh(part: Part, folder: Path, around: dict[str, Any]) -> Any:
    properties = mitsuba.Properties()
    for name, filled in around.items():
        properties[name] = filled
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
    if described["type"] == "spot":
        return spot(described)
    if described["type"] == "sun_sky":
        return sky(described)
    if described["type"] != "environment":
        raise ValueError(f"a light of type {described['type']} has no equal in Mitsuba")
    if "file" in described:
        return {"type": "envmap", "filename": str(folder / described["file"])}
    return {"type": "constant", "radiance": color(described["radiance"])}


SKY_NANOMETRES = 106.75
"""Mitsuba divides the sky model's RGB radiance by this, clrender does not."""


def sky(described: dict[str, Any]) -> dict[str, Any]:
    """The sky without sun or ground: the spectra of the sun's disc differ. Up is z there, y here."""
    if described["sun_scale"] != 0.0 or described["ground"]:
        raise ValueError("of a sun_sky only the sky has an equal in Mitsuba: give sun_scale = 0 and ground = false")
    made = {key: described[key] for key in ("sun_direction", "turbidity")}
    factor = described.get("sky_scale", 1.0) * described.get("scale", 1.0)
    upward = mitsuba.ScalarTransform4f().rotate([1.0, 0.0, 0.0], -90.0)
    scales = {"sky_scale": SKY_NANOMETRES * factor, "sun_scale": 0.0}
    return {"type": "sunsky", **made, **scales, "albedo": described["ground_albedo"], "to_world": upward}


def spot(described: dict[str, Any]) -> dict[str, Any]:
    """A spotlight with a texture of the smoothstep in the cosine, as Mitsuba's own falloff is in the angle."""
    half = described["cone_degrees"] / 2.0
    edge, blend, side = math.cos(math.radians(half)), described.get("blend", 0.15), 2048
    # The texture is perpendicular to the axis and fills the square around the cone
    at = ((np.arange(side) + 0.5) / side * 2.0 - 1.0) * math.tan(math.radians(half))
    cosine = 1.0 / np.sqrt(1.0 + at[:, None] ** 2 + at[None, :] ** 2)
    t = np.clip((cosine - edge) / max(blend * (1.0 - edge), 1e-12), 0.0, 1.0)
    fall = mitsuba.Bitmap((t * t * (3.0 - 2.0 * t)).astype(np.float32)[..., None], mitsuba.Bitmap.PixelFormat.Y)
    position, direction = np.array(described["position"]), np.array(described["direction"])
    upward = [1, 0, 0] if abs(direction[0]) < 0.9 * np.linalg.norm(direction) else [0, 1, 0]
    to_world = mitsuba.ScalarTransform4f().look_at(
        origin=position.tolist(), target=(position + direction).tolist(), up=upward
    )
    angles = {"cutoff_angle": half, "beam_width": 0.9999 * half}
    bitmap = {"type": "bitmap", "bitmap": fall, "raw": True, "wrap_mode": "clamp"}
    return {"type": "spot", "intensity": color(described["intensity"]), "texture": bitmap, **angles} | {
        "to_world": to_world
    }


def round_shape(described: dict[str, Any], folder: Path, around: dict[str, Any]) -> dict[str, Any]:
    made: dict[str, Any] = {"type": described["type"], "bsdf": material(described["material"], folder), **around}
    if described.get("emission") is not None:
        made["emitter"] = {"type": "area", "radiance": color(described["emission"])}
    center, radius = described["center"], described["radius"]
    if described["type"] == "sphere":
        if described["material"].get("anisotropy"):
            # The poles are on the z axis there, on y in clrender
            upright = mitsuba.ScalarTransform4f().translate(center).rotate([1.0, 0.0, 0.0], -90.0).scale(radius)
            return {**made, "to_world": upright}
        return {**made, "center": center, "radius": radius}
    normal = np.array(described["normal"]) / np.linalg.norm(described["normal"])
    upward = [1, 0, 0] if abs(normal[0]) < 0.9 else [0, 1, 0]
    turned = mitsuba.ScalarTransform4f().look_at(origin=center, target=(np.array(center) + normal).tolist(), up=upward)
    return {**made, "to_world": turned @ mitsuba.ScalarTransform4f().scale([radius, radius, 1.0])}


def sensor(camera: dict[str, Any]) -> dict[str, Any]:
    """A camera that both renderers support: perspective, with or without a lens, or orthographic."""
    transform = mitsuba.ScalarTransform4f().look_at(
        origin=camera["position"], target=camera["target"], up=camera.get("up", [0, 1, 0])
    )
    if camera.get("type") == "orthographic":
        half = camera["height"] / 2.0
        return {"type": "orthographic", "to_world": transform @ mitsuba.ScalarTransform4f().scale([half, half, 1.0])}
    made = {"type": "perspective", "fov": camera["vertical_fov"], "fov_axis": "y", "to_world": transform}
    if not camera.get("aperture_radius"):
        return made
    return {
        **made,
        "type": "thinlens",
        "aperture_radius": camera["aperture_radius"],
        "focus_distance": camera["focus_distance"],
    }


def load(one: Job) -> Any:
    film = {"type": "hdrfilm", "width": one.width, "height": one.height, "pixel_format": "rgb"}
    described_media, fog = media_of(one)
    media = {name: medium(described) for name, described in described_media.items()}
    parts, round_shapes = parts_of(one)
    masked = any("opacity" in each for each in (*(p.material for p in parts), *(r["material"] for r in round_shapes)))
    # The shadow rays of its `path` treat alpha masks as opaque
    kind = one.variant.partition(":")[2] or ("volpath" if media or masked else "path")
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": kind, "max_depth": one.segments, "rr_depth": NO_ROULETTE if one.segments > 0 else 8},
        "sensor": {
            **sensor(camera_of(one)),
            "film": {**film, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": one.spp},
        },
    }
    if fog is not None:
        scene["sensor"]["medium"] = media[fog]
    folder = one.scene.parent
    for number, described in enumerate(lights_of(one)):
        scene[f"light{number}"] = light(described, folder)
    for number, shape in enumerate(round_shapes):
        around = media_around(shape["material"], shape.get("interior"), media, fog)
        scene[f"round{number}"] = round_shape(shape, folder, around)
    for part in parts:
        around = media_around(part.material, part.interior, media, fog)
        scene[part.name] = flat_mesh(part, folder, around) if part.file is None else {
            "type": "ply", "filename": str(part.file), "face_normals": part.normals is None,
            "bsdf": material(part.material, folder), **around,
        }  # fmt: skip
    # Version 3.9.1 omits merged meshes from the scene's bounding box, and shadow rays to a sky then end too early
    sky = any(described["type"] in ("environment", "sun_sky") for described in lights_of(one))
    return mitsuba.load_dict({**scene, **placed(one)}, optimize=not sky)


def placed(one: Job) -> dict[str, Any]:
    """Shape groups and their instances."""
    groups, instances = instances_of(one)
    scene: dict[str, Any] = {}
    for name, parts in groups.items():
        scene[f"group_{name}"] = {"type": "shapegroup"} | {
            part.name: {
                "type": "ply", "filename": str(part.file), "face_normals": part.normals is None,
                "bsdf": material(part.material, one.scene.parent),
            }
            for part in parts
        }  # fmt: skip
    for group, maps in instances:
        for rows in maps:
            to_world = mitsuba.ScalarTransform4f(np.concatenate([rows, [[0.0, 0.0, 0.0, 1.0]]]))
            reference = {"type": "ref", "id": f"group_{group}"}
            scene[f"instance{len(scene)}"] = {"type": "instance", "shapegroup": reference, "to_world": to_world}
    return scene


def main() -> None:
    begin = time.perf_counter()
    one = job()
    mitsuba.set_variant(one.variant.partition(":")[0])
    scene = load(one)
    if not one.variant.startswith("scalar"):
        drjit.eval()
        drjit.sync_thread()
    mitsuba.render(scene, spp=1, seed=one.seed + 1).numpy()  # compile, and build the BVH
    setup = time.perf_counter() - begin
    image, wall, cpu = timed(lambda: mitsuba.render(scene, spp=one.spp, seed=one.seed).numpy())
    answer(one, image, wall, cpu, mitsuba.__version__, setup)


if __name__ == "__main__":
    main()
