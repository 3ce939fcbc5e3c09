"""Thin films in random scenes: on some metals, glass and principled materials."""

from __future__ import annotations

from typing import Final

from mixed_parts import Draw, Json, mapping, texture

__all__ = ["filmed"]

_KINDS: Final = ("conductor", "dielectric", "principled")


def filmed(name: str, content: Json, white: bool) -> None:
    """Give some materials a thin film; by random numbers of their own.

    Parameters
    ----------
    name : str
        Of the scene.
    content : dict
        What a scene file says.
    white : bool
        Whether all radiance is the same, so that nothing may lose light. A film on what is neither metal nor smooth
        glass does, by up to some per cent.
    """
    draw = Draw(f"films of {name}", white=False)
    if not draw.chance(0.25):
        return
    for key, material in content.get("materials", {}).items():
        if material["type"] not in _KINDS or not draw.chance(0.6):
            continue
        if white and not _conserves(material):
            continue
        textured = _has_uvs(content, key)
        material["iridescence"] = draw.one((1.0, draw.between(0.1, 1.0)))
        if textured and draw.chance(0.4):
            material["iridescence"] = _first_set(texture(draw, 0.1, 1.0, number=True))
        if draw.chance(0.8):
            material["iridescence_ior"] = draw.between(1.05, 2.4)
        if draw.chance(0.3) and textured:
            thin = draw.between(0.0, 400.0)
            picture: Json = {"texture": "numbers.png", "range": [thin, draw.between(thin, 1200.0)]}
            picture |= _first_set(mapping(draw))
            picture |= {"channel": draw.one(("r", "g", "b", "a", "luminance"))} if draw.chance(0.5) else {}
            picture |= {"wrap": draw.one(("mirror", "repeat", "clamp"))} if draw.chance(0.5) else {}
            picture |= {"filter": draw.one(("nearest", "linear"))} if draw.chance(0.5) else {}
            material["iridescence_thickness"] = picture
        elif draw.chance(0.8):
            material["iridescence_thickness"] = draw.one((draw.between(50.0, 1000.0), draw.between(1000.0, 9000.0)))


def _first_set(made: Json) -> Json:
    """The same texture; many shapes have no second set of texture coordinates."""
    return made | ({"uv_set": 0} if "uv_set" in made else {})


def _conserves(material: Json) -> bool:
    if material["type"] == "dielectric":
        return not material.get("roughness")
    return bool(material["type"] == "conductor")


def _has_uvs(content: Json, name: str) -> bool:
    """Whether all shapes that may show a material have texture coordinates."""
    grouped = [shape for group in content.get("groups", {}).values() for shape in group["shapes"]]
    mixed = any(name in material.get("materials", ()) for material in content["materials"].values())
    shapes = [*content["shapes"], *grouped]
    return not mixed and all(
        shape["type"] not in ("mesh", "curves") for shape in shapes if shape.get("material") == name
    )
