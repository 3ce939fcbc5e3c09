"""Spectra in random scenes: in the place of colours of some materials and lights, and of the index of some glass."""

from __future__ import annotations

from typing import Any, Final

from mixed_moves import FAR_LAMP
from mixed_parts import Draw, Json

from clrender.spectra.glasses import GLASSES
from clrender.spectra.illuminants import ILLUMINANTS

__all__ = ["spectral"]

_KEYS: Final = ("reflectance", "base_color", "specular_color", "sheen_color", "f0")


def spectral(name: str, content: Json, white: bool) -> None:
    """Give some colours a spectrum, and some glass a dispersion; by random numbers of their own.

    Parameters
    ----------
    name : str
        Of the scene.
    content : dict
        What a scene file says.
    white : bool
        Whether all radiance is the same, so that nothing may absorb light.
    """
    draw = Draw(f"colours of {name}", white=False)
    if not draw.chance(0.3):
        return
    for material in content.get("materials", {}).values():
        solid = material["type"] == "dielectric" or material.get("transmission", 0.0) != 0.0
        if solid and not material.get("thin") and draw.chance(0.7):
            _disperse(draw, material)
        if not white and material["type"] == "conductor" and "f0" not in material and draw.chance(0.5):
            material.pop("metal", None)
            for key, most in (("eta", 3.0), ("k", 6.0)):
                material[key] = _table(draw, most)
        for key in _KEYS:
            if not white and _is_color(material.get(key)) and draw.chance(0.4):
                material[key] = _table(draw, max(material[key]))
        if not white and _is_color(material.get("emission")) and draw.chance(0.7):
            material["emission"] = _light(draw, max(material["emission"]))
    if white:
        return
    for light in content["lights"]:
        for key in ("intensity", "irradiance", "radiance"):
            if _is_color(light.get(key)) and light[key] != FAR_LAMP and draw.chance(0.4):
                light[key] = _light(draw, max(light[key]))
    grouped = [shape for group in content.get("groups", {}).values() for shape in group["shapes"]]
    for shape in [*content["shapes"], *grouped]:
        if _is_color(shape.get("emission")) and draw.chance(0.7):
            shape["emission"] = _light(draw, max(shape["emission"]))
    for light in content["lights"]:
        if light["type"] in ("ies", "plugin") and light.get("scale") != 0.0 and draw.chance(0.4):
            scale = light.get("scale", 1.0)
            light["scale"] = _light(draw, max(scale) if isinstance(scale, list) else scale)
    for medium in content.get("media", {}).values():
        for key in ("absorption", "scattering"):
            if _is_color(medium.get(key)) and draw.chance(0.3):
                medium[key] = _table(draw, max(medium[key]))
        if _is_color(medium.get("emission")) and draw.chance(0.5):
            medium["emission"] = _light(draw, max(medium["emission"]))


def _is_color(value: Any) -> bool:
    return isinstance(value, list) and max(value) > 0.0


def _disperse(draw: Draw, material: Json) -> None:
    """Let the index of a glass depend on the wavelength; its index stays about the same."""
    ior = material.pop("ior", 1.5)
    way = draw.one(("glass", "glass", "glass", "abbe", "cauchy", "sellmeier", "table"))
    if way == "abbe" or "priority" in material:
        material["ior"], material["dispersion"] = ior, {"abbe": draw.between(15.0, 80.0)}
    elif way == "glass":
        material["dispersion"] = {"glass": draw.one(tuple(GLASSES))}
    elif way == "cauchy":
        material["dispersion"] = {"cauchy": [max(ior, 1.05), draw.between(0.001, 0.02)]}
    elif way == "table":
        indices = [round(max(ior, 1.05) + more, 4) for more in (0.06, 0.02, 0.0)]
        material["dispersion"] = {"wavelengths": [400.0, 500.0, 700.0], "values": indices}
    else:
        material["dispersion"] = {"sellmeier": [max(ior * ior - 1.0, 0.1), draw.between(0.005, 0.02)]}


def _table(draw: Draw, most: float) -> Json:
    return {
        "wavelengths": [420.0, 480.0, 560.0, 600.0, 680.0],
        "values": [round(draw.between(0.02, 1.0) * most, 4) for _ in range(5)],
    }


def _light(draw: Draw, most: float) -> Json:
    scale = round(0.5 * most, 4)
    if draw.chance(0.15):
        return {"blackbody": round(draw.between(1800.0, 9000.0)), "scale": scale}
    if draw.chance(0.8):
        return {"illuminant": draw.one(ILLUMINANTS), "scale": scale}
    values = [round(draw.between(0.1, 1.0), 4) for _ in range(4)]
    return {"wavelengths": [400.0, 500.0, 600.0, 700.0], "values": values, "scale": scale}
