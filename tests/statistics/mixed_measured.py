"""Measured reflectance in random scenes: in the place of opaque materials of some shapes."""

from __future__ import annotations

from typing import Any, Final

from mixed_parts import Draw, Json

__all__ = ["measured"]

_OPAQUE: Final = ("lambert", "oren_nayar", "conductor", "mirror")
_FILES: Final = ("paint.bsdf", "brushed.bsdf")


def measured(name: str, content: Json, white: bool, black: bool) -> None:
    """Give some shapes a measured material; by random numbers of their own.

    Parameters
    ----------
    name : str
        Of the scene.
    content : dict
        What a scene file says.
    white : bool
        Whether all radiance is the same, so that nothing may absorb light.
    black : bool
        Whether all light is outside of what may be walls, which are boxes and have no holes then.
    """
    draw = Draw(f"measured of {name}", white=False)
    if white or not draw.chance(0.15):
        return
    materials = content.get("materials", {})
    grouped = [shape for group in content.get("groups", {}).values() for shape in group["shapes"]]
    places = [shape for shape in [*content["shapes"], *grouped] if _may_be(materials, shape)]
    if not places:
        return
    made: Json = {"type": "measured", "file": draw.one(_FILES)}
    made |= {"two_sided": draw.chance(0.5)} if draw.chance(0.3) else {}
    made |= {"anisotropy_rotation": draw.between(-180.0, 180.0)} if draw.chance(0.4) else {}
    made |= {"termination": draw.between(0.05, 0.3)} if draw.chance(0.3) else {}
    textured = all(shape["type"] != "mesh" for shape in places)  # meshes may lack texture coordinates
    if textured and draw.chance(0.2):
        made["bump_map"] = {"texture": "heights.png", "scale": draw.between(0.005, 0.02)}
    elif textured and draw.chance(0.2):
        made["normal_map"] = {"texture": "bent.png"}
    if draw.chance(0.2):
        varied: tuple[Json, ...] = ({"ramp": [0.2, 0.9]}, {"checker": [0.3, 1.0]}, {"texture": "numbers.png"})
        made["opacity"] = draw.one((draw.between(0.3, 1.0), draw.one(varied if textured else (0.5,))))
        made |= {"opacity_cutoff": draw.between(0.2, 0.8)} if draw.chance(0.4) else {}
    materials["measured"] = made
    wanted = "measured"
    if "opacity" not in made and draw.chance(0.3):
        materials["half measured"] = {"type": "mix", "materials": ["measured", _plain(materials)], "weight": 0.4}
        wanted = "half measured"
    for shape in places:
        if shape is places[0] or draw.chance(0.4):
            shape["material"] = wanted
            if black and shape["type"] == "box" and "opacity" in made:
                materials["measured walls"] = {key: made[key] for key in made if not key.startswith("opacity")}
                shape["material"] = "measured walls"


def _may_be(materials: Json, shape: Json) -> bool:
    """Whether a shape may be of another opaque material."""
    kind: Any = materials.get(shape.get("material", ""), {}).get("type")
    colored = {"colors", "vertex_colors", "emission", "interior", "poses"} & shape.keys()
    return kind in _OPAQUE and not colored


def _plain(materials: Json) -> str:
    """A material without opacity, to be mixed with."""
    materials["plain"] = {"type": "oren_nayar", "reflectance": [0.6, 0.5, 0.4]}
    return "plain"
