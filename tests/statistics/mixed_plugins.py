"""Plugins in mixed scenes: BSDFs for Lambertian materials, textures in the place of any parameter, and lights."""

from __future__ import annotations

from typing import Final

from mixed_parts import Draw, Json, mapping, texture

from clrender.files.package_data import scenes_folder
from clrender.plugins import Plugin, plugin

__all__ = ["PLUGINS", "plugged"]

_HALFWAY: Final = """// A colour half-way between two others, for shapes with and without texture coordinates.
// [plugin]
// name = "halfway"
// kind = "texture"
// [parameters]
// low = { type = "color", default = [0.3, 0.4, 0.5] }
// high = { type = "color", default = [0.8, 0.7, 0.6] }
static vec3 halfway_value(const HalfwayParameters* p, vfloat u, vfloat v, vec3 position) {
    return along(p->low, sub(p->high, p->low), splat(0.5f) + u);
}
"""
_SIDED: Final = """// A light that is brighter to its right, and darker behind it.
// [plugin]
// name = "sided"
// kind = "light"
// [parameters]
// color = { type = "color", default = [1.0, 1.0, 1.0], max = 10.0 }
// behind = { type = "number", default = 0.3 }
static vec3 sided_intensity(const SidedParameters* p, vec3 direction) {
    const vfloat side = fma(direction.x, splat(0.5f), splat(1.0f));
    return scale(p->color, side * (direction.z > 0.0f ? splat(1.0f) : p->behind));
}
"""
_FILES: Final = (scenes_folder() / "plugins" / f"{name}.cl" for name in ("ashikhmin_shirley", "minnaert"))
PLUGINS: Final[tuple[Plugin, ...]] = (plugin(_HALFWAY), plugin(_SIDED), *map(plugin, _FILES))
"""Textures do not depend on the place, so that scenes can be moved."""
_COLORS: Final = ("reflectance", "base_color", "f0", "specular_color", "sheen_color")
_NUMBERS: Final = {
    "dielectric": ("roughness", "iridescence"),
    "oren_nayar": ("roughness",),
    "conductor": ("roughness", "anisotropy", "iridescence"),
    "principled": (
        *("metallic", "roughness", "specular", "diffuse_roughness", "coat", "coat_roughness"),
        *("sheen_roughness", "anisotropy", "transmission", "iridescence"),
    ),
    "mix": ("weight",),
}
"""Parameters that are numbers and may be textures, by type."""


def plugged(name: str, content: Json) -> None:
    """Give plugins to one scene in twelve, but no white one; by random numbers of their own.

    Parameters
    ----------
    name : str
        Of the scene.
    content : dict
        What a scene file says, which is changed.
    """
    draw = Draw(f"with plugins, {name}", white=False)
    if name.startswith("white") or not draw.chance(0.08):
        return
    materials = content.setdefault("materials", {})
    for key, material in list(materials.items()):
        if material["type"] == "lambert" and draw.chance(0.7) and not _is_bound(content, key):
            materials[key] = _made(draw, material)
        else:
            _textured(draw, material)
    # Of all, so that scenes share programs
    materials["all plugins"] = {**_gloss(draw), "parameters": {"diffuse": _halfway(draw)}}
    color = texture(draw, 0.1, 0.9, number=False)
    materials["a plugin"] = {"type": "plugin", "plugin": "minnaert", "parameters": {"reflectance": color}}
    _lit(Draw(f"lights of plugins, {name}", white=False), content["lights"])


def _lit(draw: Draw, lights: list[Json]) -> None:
    """Put lights of a plugin in the places of some; there is one that is black, at least."""
    for index, light in enumerate(lights):
        if light["type"] in ("point", "spot") and draw.chance(0.7):
            kept: Json = {key: light[key] for key in ("position", "motion", "light_group") if key in light}
            made: Json = {"type": "plugin", "plugin": "sided", "direction": light.get("direction", draw.direction())}
            if draw.chance(0.5):
                made |= {"scale": light["intensity"]}
            else:
                numbers = {"color": draw.color(0.3, 1.5), "behind": draw.between(0.0, 1.0)}
                made |= {"scale": draw.between(2.0, 6.0), "parameters": numbers}
            made |= {"up": draw.direction()} if draw.chance(0.5) else {}
            lights[index] = {**kept, **made}
    black: Json = {"type": "plugin", "plugin": "sided", "position": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0]}
    lights.append({**black, "scale": 0.0})


def _is_bound(content: Json, material: str) -> bool:
    """Whether vertex colours are to multiply its own, which plugins lack, or meshes have no texture coordinates."""
    groups = content.get("groups", {}).values()
    shapes = [*content["shapes"], *(shape for group in groups for shape in group["shapes"])]
    users = [each for each in shapes if each.get("material") == material]
    mixed = any(material in each.get("materials", ()) for each in content["materials"].values())
    bare = any("vertices" in each and "uvs" not in each for each in users)
    return mixed or bare or any("vertex_colors" in each or "colors" in each for each in users)


def _made(draw: Draw, material: Json) -> Json:
    """A plugin's material in the place of a Lambertian one."""
    kept = {key: value for key, value in material.items() if key not in ("type", "reflectance")}
    if draw.chance(0.2):
        kept["opacity"] = texture(draw, 0.1, 1.0, number=True)
    if draw.chance(0.5):
        return {**kept, **_gloss(draw)}
    color = _halfway(draw) if draw.chance(0.3) else material["reflectance"]
    parameters: Json = {"reflectance": color} | ({"k": draw.between(1.0, 3.0)} if draw.chance(0.7) else {})
    return {**kept, "type": "plugin", "plugin": "minnaert", "parameters": parameters}


def _gloss(draw: Draw) -> Json:
    made: Json = {"type": "plugin", "plugin": "ashikhmin_shirley"}
    made |= {"anisotropy_rotation": draw.between(-180, 180)} if draw.chance(0.5) else {}
    parameters: Json = {"n_u": draw.between(0.0, 20.0), "n_v": draw.between(0.0, 20.0)}
    if draw.chance(0.7):
        parameters["specular"] = draw.color(0.1, 0.6)
    if draw.chance(0.7):
        kinds = (draw.color(), texture(draw, 0.1, 0.9, number=False), _halfway(draw))
        parameters["diffuse"] = draw.one(kinds)
    return {**made, "parameters": parameters}


def _halfway(draw: Draw) -> Json:
    made: Json = {"plugin": "halfway", **mapping(draw)}
    return made | ({"parameters": {"low": draw.color(), "high": draw.color()}} if draw.chance(0.6) else {})


def _textured(draw: Draw, material: Json) -> None:
    """A plugin's texture for some parameters; values are at least 0.3, so that nothing gets too smooth."""
    if material["type"] == "subsurface":
        material |= {"ior": material.get("ior", 1.3), "roughness": {"plugin": "halfway", **mapping(draw)}}
    for key in (*_COLORS, *_NUMBERS.get(material["type"], ())):
        solid = key == "transmission" and not material.get("thin")
        if (key in material or key == "weight") and not solid and draw.chance(0.5):
            material[key] = {"plugin": "halfway", **mapping(draw)}
