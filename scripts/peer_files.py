"""Writes scenes of `cross_check.py` as pbrt files, for tests of the importer."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from peer_parts import pbrt_camera, pbrt_interface, pbrt_medium, pbrt_spot, words

__all__ = ["as_pbrt_has_it", "pbrt_text"]

_FILTERS: Final = {"box": '"box"', "tent": '"triangle" "float xradius" 1 "float yradius" 1'}
_BOX_QUADS: Final = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def _frame(x: Any, y: Any, z: Any, origin: Any) -> Any:
    made = np.eye(4)
    made[:3, 0], made[:3, 1], made[:3, 2], made[:3, 3] = x, y, z, origin
    return made


def _disk_frame(shape: dict[str, Any]) -> Any:
    normal = np.array(shape["normal"]) / np.linalg.norm(shape["normal"])
    across = np.cross(np.eye(3)[int(np.abs(normal).argmin())], normal)
    across /= np.linalg.norm(across)
    radius = shape["radius"]
    return _frame(radius * across, radius * np.cross(normal, across), normal, shape["center"])


def _pbrt_material(described: dict[str, Any], name: str) -> list[str]:
    kind, alpha = described["type"], described.get("roughness", 0.0) ** 2
    rough = f'"float roughness" {alpha!r} "bool remaproughness" false'
    lines = []
    if kind == "dielectric":
        rest = f'"string type" "dielectric" "float eta" {described["ior"]!r} {rough}'
    elif kind == "conductor":
        eta, k = words(described["eta"]), words(described["k"])
        rest = f'"string type" "conductor" "rgb eta" [{eta}] "rgb k" [{k}] {rough}'
    elif isinstance(described["reflectance"], dict):
        texture = described["reflectance"]
        between = "point" if texture.get("filter") == "nearest" else "bilinear"
        file = f'"string filename" "{texture["texture"]}" "string filter" "{between}"'
        lines.append(f'Texture "{name}" "spectrum" "imagemap" {file}')
        rest = f'"string type" "diffuse" "texture reflectance" "{name}"'
    else:
        rest = f'"string type" "diffuse" "rgb reflectance" [{words(described["reflectance"])}]'
    if "normal_map" in described:
        rest += f' "string normalmap" "{described["normal_map"]["texture"]}"'
    return [*lines, f'MakeNamedMaterial "{name}" {rest}']


def _pbrt_shape(shape: dict[str, Any]) -> str:
    kind = shape["type"]
    points: Any
    uvs: Any
    corners: Any
    if kind == "sphere":
        return f'Translate {words(shape["center"])} Shape "sphere" "float radius" {shape["radius"]!r}'
    if kind == "disk":
        matrix = _disk_frame(shape)
        return f'ConcatTransform [{words(matrix.T)}] Shape "disk"'
    if kind == "mesh":  # `cross_check.py` has no others
        matrix = np.array(shape["transform"]["matrix"])
        return f'ConcatTransform [{words(matrix.T)}] Shape "cylinder" "float zmin" 0 "float zmax" 1'
    if kind == "triangle":
        points, uvs, corners = shape["vertices"], ((0, 0), (1, 0), (0, 1)), [[0, 1, 2]]
    elif kind == "box":
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        points = np.array(shape["center"]) + signs * np.array(shape["size"]) / 2.0
        corners = [c for a, b, c_, d in _BOX_QUADS for c in ((a, b, c_), (a, c_, d))]
        uvs = ()
    else:
        o, u, v = (np.array(shape[key]) for key in ("origin", "edge_u", "edge_v"))
        points, uvs, corners = [o, o + u, o + u + v, o + v], ((0, 0), (1, 0), (1, 1), (0, 1)), [[0, 1, 2], [0, 2, 3]]
    given = f'"point2 uv" [{words(uvs)}]' if uvs else ""
    indices = " ".join(str(int(i)) for i in np.array(corners).ravel())
    return f'Shape "trianglemesh" "point3 P" [{words(points)}] "integer indices" [{indices}] {given}'


def _pbrt_light(light: dict[str, Any]) -> str:
    kind = light["type"]
    if kind == "point":
        return f'LightSource "point" "point3 from" [{words(light["position"])}] "rgb I" [{words(light["intensity"])}]'
    if kind == "directional":
        where = f'"point3 from" [0 0 0] "point3 to" [{words(light["direction"])}]'
        return f'LightSource "distant" {where} "rgb L" [{words(light["irradiance"])}]'
    if kind == "spot":
        return pbrt_spot(light)
    if "radiance" in light:
        return f'LightSource "infinite" "rgb L" [{words(light["radiance"])}]'
    raise ValueError("pbrt has other pictures of environments: `as_pbrt_has_it` replaces them")


def as_pbrt_has_it(scene: dict[str, Any]) -> dict[str, Any]:
    """Replace features of the scene that pbrt, or our importer of it, lacks.

    Mirrors become metals, Beckmann facets GGX, plastics diffuse, textured roughness 0.2, skies and environment maps a
    constant environment, and textured opacity one half.
    """
    materials = {}
    for name, described in scene["materials"].items():
        if described["type"] == "mirror":
            k = [2.0 * (min(x, 0.9999) / (1.0 - min(x, 0.9999))) ** 0.5 for x in described["reflectance"]]
            described = {"type": "conductor", "eta": [1.0] * 3, "k": k, "roughness": 0.0}
        if described["type"] == "principled":
            described = {"type": "lambert", "reflectance": described["base_color"]}
        if isinstance(described.get("roughness"), dict):
            described = {**described, "roughness": 0.2}
        if "microfacets" in described:
            described = {**described, "microfacets": "ggx"}
        if "normal_map" in described:  # always interpolated linearly
            normals = {key: value for key, value in described["normal_map"].items() if key != "filter"}
            described = {**described, "normal_map": normals}
        if isinstance(described.get("opacity"), dict):
            described = {**described, "opacity": 0.5}
        materials[name] = described
    even = {"type": "environment", "radiance": [0.5, 0.6, 0.7]}
    return {
        **scene,
        "materials": materials,
        "lights": [even if "file" in each or each["type"] == "sun_sky" else each for each in scene["lights"]],
    }


def pbrt_text(scene: dict[str, Any], side: int, spp: int) -> str:
    """A scene in pbrt-v4's format.

    Parameters
    ----------
    scene : dict
        In the form of our scene files, from `as_pbrt_has_it`.
    side : int
        Side of the image, pixels.
    spp : int
    """
    camera = scene["camera"]
    view = [camera[key] for key in ("position", "target")] + [camera.get("up", (0.0, 1.0, 0.0))]
    fog, materials = scene.get("fog"), scene["materials"]
    lines = [pbrt_medium(described, name) for name, described in scene.get("media", {}).items()]
    lines += [
        *([] if fog is None else [f'MediumInterface "" "{fog}"']),
        "Scale -1 1 1",  # right-handed
        f"LookAt {words(view)}",
        pbrt_camera(camera),
        f'Film "rgb" "integer xresolution" {side} "integer yresolution" {side}',
        f'Sampler "independent" "integer pixelsamples" {spp}',
        'Integrator "path" "integer maxdepth" 100000',
        f"PixelFilter {_FILTERS[scene.get('render', {}).get('filter', 'box')]}",
        "WorldBegin",
    ]
    for name, described in materials.items():
        lines += _pbrt_material(described, name)
    for shape in scene["shapes"]:
        light = f'AreaLightSource "diffuse" "rgb L" [{words(shape["emission"])}]' if "emission" in shape else ""
        named = shape.get("material")
        material = 'Material "interface"' if named is None else f'NamedMaterial "{named}"'
        alpha = materials[named].get("opacity") if named is not None else None
        solid = _pbrt_shape(shape) + ("" if alpha is None else f' "float alpha" {alpha!r}')
        lines += ["AttributeBegin", light, pbrt_interface(shape, fog), material, solid, "AttributeEnd"]
    lines += [_pbrt_light(light) for light in scene["lights"]]
    return "\n".join(lines) + "\n"
