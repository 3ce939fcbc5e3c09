"""Writes scenes of `cross_check.py` as Mitsuba's XML and as pbrt's files, for tests of their readers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np

__all__ = ["as_pbrt_has_it", "mitsuba_xml", "pbrt_text"]

_BOX_QUADS: Final = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def _words(values: Any) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(values, np.float64).ravel())


def _element(tag: str, inside: str = "", **attributes: str) -> str:
    head = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
    return f"<{tag}{head}>{inside}</{tag}>\n" if inside else f"<{tag}{head}/>\n"


def _value(tag: str, name: str, value: Any) -> str:
    text = str(value).lower() if isinstance(value, bool) else value if isinstance(value, str) else _words(value)
    return _element(tag, name=name, value=text)


def _to_world(matrix: Any) -> str:
    return _element("transform", _element("matrix", value=_words(matrix)), name="to_world")


def _frame(x: Any, y: Any, z: Any, origin: Any) -> Any:
    made = np.eye(4)
    made[:3, 0], made[:3, 1], made[:3, 2], made[:3, 3] = x, y, z, origin
    return made


def _quad_frame(shape: dict[str, Any]) -> Any:
    """Of a square from -1 to 1, to a parallelogram."""
    origin, u, v = (np.array(shape[key]) for key in ("origin", "edge_u", "edge_v"))
    normal = np.cross(u, v)
    return _frame(u / 2.0, v / 2.0, normal / np.linalg.norm(normal), origin + (u + v) / 2.0)


def _disk_frame(shape: dict[str, Any]) -> Any:
    normal = np.array(shape["normal"]) / np.linalg.norm(shape["normal"])
    across = np.cross(np.eye(3)[int(np.abs(normal).argmin())], normal)
    across /= np.linalg.norm(across)
    radius = shape["radius"]
    return _frame(radius * across, radius * np.cross(normal, across), normal, shape["center"])


# --- Mitsuba


def _bitmap(texture: dict[str, Any], name: str) -> str:
    upright = _element("transform", _element("scale", x="1", y="-1", z="1"), name="to_uv")
    between = "nearest" if texture.get("filter") == "nearest" else "bilinear"
    inside = _value("string", "filename", texture["texture"]) + upright + _value("string", "filter_type", between)
    inside += _value("boolean", "raw", texture.get("color_space") != "srgb")
    return _element("texture", inside, type="bitmap", name=name)


def _mitsuba_material(described: dict[str, Any], name: str) -> str:
    named = {"id": name} if name else {}
    kind, alpha = described["type"], described.get("roughness", 0.0) ** 2
    rough = (_value("string", "distribution", "ggx") + _value("float", "alpha", alpha)) if alpha else ""
    if kind == "dielectric":
        inside = _value("float", "int_ior", described["ior"]) + _value("float", "ext_ior", 1.0) + rough
        return _element("bsdf", inside, type="roughdielectric" if alpha else "dielectric", **named)
    if kind == "mirror":
        inside, plugin = _value("rgb", "specular_reflectance", described["reflectance"]), "conductor"
    elif kind == "conductor":
        inside = _value("rgb", "eta", described["eta"]) + _value("rgb", "k", described["k"]) + rough
        plugin = "roughconductor" if alpha else "conductor"
    else:
        reflectance, plugin = described["reflectance"], "diffuse"
        texture = isinstance(reflectance, dict)
        inside = _bitmap(reflectance, "reflectance") if texture else _value("rgb", "reflectance", reflectance)
    one = _element("bsdf", inside, type=plugin)
    if "normal_map" in described:
        # What clrender has not: a microsurface of the map's own
        plain = _value("boolean", "use_shadowing_function", False)
        one = _element("bsdf", _bitmap(described["normal_map"], "normalmap") + one + plain, type="normalmap")
    return _element("bsdf", one, type="twosided", **named)


def _ply(path: Path, shape: dict[str, Any]) -> None:
    rows = [f"{_words(p)} {_words(uv)}" for p, uv in zip(shape["vertices"], ((0, 0), (1, 0), (0, 1)), strict=True)]
    head = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyzuv")]
    head += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    path.write_text("\n".join([*head, *rows, "3 0 1 2", ""]), encoding="ascii")


def _mitsuba_shape(shape: dict[str, Any], number: int, folder: Path) -> str:
    inside = _element("ref", id=shape["material"])
    if "emission" in shape:
        inside += _element("emitter", _value("rgb", "radiance", shape["emission"]), type="area")
    kind = shape["type"]
    if kind == "sphere":
        x, y, z = map(repr, shape["center"])
        center = _element("point", name="center", x=x, y=y, z=z)
        return _element("shape", inside + center + _value("float", "radius", shape["radius"]), type="sphere")
    if kind == "triangle":
        _ply(folder / f"triangle{number}.ply", shape)
        flat = _value("boolean", "face_normals", True)
        inside += _value("string", "filename", f"triangle{number}.ply") + flat
        return _element("shape", inside, type="ply")
    if kind == "box":
        half = np.array(shape["size"]) / 2.0
        x, y, z = np.diag(half)
        frame = _frame(x, y, z, shape["center"])
        return _element("shape", inside + _to_world(frame), type="cube")
    if kind == "disk":
        return _element("shape", inside + _to_world(_disk_frame(shape)), type="disk")
    return _element("shape", inside + _to_world(_quad_frame(shape)), type="rectangle")


def _mitsuba_light(light: dict[str, Any]) -> str:
    kind = light["type"]
    if kind == "point":
        x, y, z = map(repr, light["position"])
        inside = _element("point", name="position", x=x, y=y, z=z) + _value("rgb", "intensity", light["intensity"])
        return _element("emitter", inside, type="point")
    if kind == "directional":
        x, y, z = map(repr, light["direction"])
        inside = _element("vector", name="direction", x=x, y=y, z=z) + _value("rgb", "irradiance", light["irradiance"])
        return _element("emitter", inside, type="directional")
    if "file" in light:
        return _element("emitter", _value("string", "filename", light["file"]), type="envmap")
    return _element("emitter", _value("rgb", "radiance", light["radiance"]), type="constant")


def mitsuba_xml(scene: dict[str, Any], folder: Path, side: int, spp: int) -> str:
    """A scene as Mitsuba 3 reads it; its triangles go into files beside it.

    Parameters
    ----------
    scene : dict
        As a scene file of ours.
    folder : pathlib.Path
        Where the file will lie.
    side : int
        Of the image, pixels.
    spp : int
    """
    camera = scene["camera"]
    at = {key: ", ".join(map(repr, camera.get(name, (0.0, 1.0, 0.0)))) for key, name in _LOOK}
    parts = [_element("integrator", _element("integer", name="max_depth", value="-1"), type="path")]
    film = "".join(_element("integer", name=name, value=str(side)) for name in ("width", "height"))
    film += _value("string", "pixel_format", "rgb") + _element("rfilter", type="box")
    inside = _element("transform", _element("lookat", **at), name="to_world") + _value("string", "fov_axis", "y")
    inside += _value("float", "fov", camera["vertical_fov"])
    inside += _element("sampler", _element("integer", name="sample_count", value=str(spp)), type="independent")
    parts.append(_element("sensor", inside + _element("film", film, type="hdrfilm"), type="perspective"))
    parts += [_mitsuba_material(described, name) for name, described in scene["materials"].items()]
    parts += [_mitsuba_shape(shape, number, folder) for number, shape in enumerate(scene["shapes"])]
    parts += [_mitsuba_light(light) for light in scene["lights"]]
    return f'<scene version="3.0.0">\n{"".join(parts)}</scene>\n'


_LOOK: Final = (("origin", "position"), ("target", "target"), ("up", "up"))

# --- pbrt


def _pbrt_material(described: dict[str, Any], name: str) -> list[str]:
    kind, alpha = described["type"], described.get("roughness", 0.0) ** 2
    rough = f'"float roughness" {alpha!r} "bool remaproughness" false'
    lines = []
    if kind == "dielectric":
        rest = f'"string type" "dielectric" "float eta" {described["ior"]!r} {rough}'
    elif kind == "conductor":
        eta, k = _words(described["eta"]), _words(described["k"])
        rest = f'"string type" "conductor" "rgb eta" [{eta}] "rgb k" [{k}] {rough}'
    elif isinstance(described["reflectance"], dict):
        texture = described["reflectance"]
        between = "point" if texture.get("filter") == "nearest" else "bilinear"
        file = f'"string filename" "{texture["texture"]}" "string filter" "{between}"'
        lines.append(f'Texture "{name}" "spectrum" "imagemap" {file}')
        rest = f'"string type" "diffuse" "texture reflectance" "{name}"'
    else:
        rest = f'"string type" "diffuse" "rgb reflectance" [{_words(described["reflectance"])}]'
    if "normal_map" in described:
        rest += f' "string normalmap" "{described["normal_map"]["texture"]}"'
    return [*lines, f'MakeNamedMaterial "{name}" {rest}']


def _pbrt_shape(shape: dict[str, Any]) -> str:
    kind = shape["type"]
    points: Any
    uvs: Any
    corners: Any
    if kind == "sphere":
        return f'Translate {_words(shape["center"])} Shape "sphere" "float radius" {shape["radius"]!r}'
    if kind == "disk":
        matrix = _disk_frame(shape)
        return f'ConcatTransform [{_words(matrix.T)}] Shape "disk"'
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
    given = f'"point2 uv" [{_words(uvs)}]' if uvs else ""
    indices = " ".join(str(int(i)) for i in np.array(corners).ravel())
    return f'Shape "trianglemesh" "point3 P" [{_words(points)}] "integer indices" [{indices}] {given}'


def _pbrt_light(light: dict[str, Any]) -> str:
    kind = light["type"]
    if kind == "point":
        return f'LightSource "point" "point3 from" [{_words(light["position"])}] "rgb I" [{_words(light["intensity"])}]'
    if kind == "directional":
        where = f'"point3 from" [0 0 0] "point3 to" [{_words(light["direction"])}]'
        return f'LightSource "distant" {where} "rgb L" [{_words(light["irradiance"])}]'
    if "radiance" in light:
        return f'LightSource "infinite" "rgb L" [{_words(light["radiance"])}]'
    raise ValueError("pbrt has other pictures of environments: `as_pbrt_has_it` replaces them")


def as_pbrt_has_it(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene without what pbrt has not: metals for mirrors, and an even environment for a picture in latitude and longitude."""  # noqa: E501
    materials = {}
    for name, described in scene["materials"].items():
        if described["type"] == "mirror":
            k = [2.0 * (min(x, 0.9999) / (1.0 - min(x, 0.9999))) ** 0.5 for x in described["reflectance"]]
            described = {"type": "conductor", "eta": [1.0] * 3, "k": k, "roughness": 0.0}
        if "normal_map" in described:  # always linear between texels
            normals = {key: value for key, value in described["normal_map"].items() if key != "filter"}
            described = {**described, "normal_map": normals}
        materials[name] = described
    even = {"type": "environment", "radiance": [0.5, 0.6, 0.7]}
    return {**scene, "materials": materials, "lights": [even if "file" in each else each for each in scene["lights"]]}


def pbrt_text(scene: dict[str, Any], side: int, spp: int) -> str:
    """A scene as pbrt-v4 reads it.

    Parameters
    ----------
    scene : dict
        As a scene file of ours, and of `as_pbrt_has_it`.
    side : int
        Of the image, pixels.
    spp : int
    """
    camera = scene["camera"]
    view = [camera[key] for key in ("position", "target")] + [camera.get("up", (0.0, 1.0, 0.0))]
    lines = [
        "Scale -1 1 1",  # right-handed
        f"LookAt {_words(view)}",
        f'Camera "perspective" "float fov" {camera["vertical_fov"]!r}',
        f'Film "rgb" "integer xresolution" {side} "integer yresolution" {side}',
        f'Sampler "independent" "integer pixelsamples" {spp}',
        'Integrator "path" "integer maxdepth" 100000',
        'PixelFilter "box"',
        "WorldBegin",
    ]
    for name, described in scene["materials"].items():
        lines += _pbrt_material(described, name)
    for shape in scene["shapes"]:
        light = f'AreaLightSource "diffuse" "rgb L" [{_words(shape["emission"])}]' if "emission" in shape else ""
        lines += ["AttributeBegin", light, f'NamedMaterial "{shape["material"]}"', _pbrt_shape(shape), "AttributeEnd"]
    lines += [_pbrt_light(light) for light in scene["lights"]]
    return "\n".join(lines) + "\n"
