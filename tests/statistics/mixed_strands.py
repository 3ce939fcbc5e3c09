"""Strands in random scenes: curves of all bases, in a group or not, of hair or of an opaque material."""

from __future__ import annotations

from typing import Any, Final

from mixed_parts import Draw, Json

__all__ = ["stranded"]

_OPAQUE: Final = ("lambert", "oren_nayar", "conductor", "mirror")
_LEAST: Final = {"bspline": (4, 5, 7), "bezier": (4, 7), "catmull-rom": (2, 3, 5), "linear": (2, 4)}
"""Points that a strand of each basis may have."""


def stranded(name: str, content: Json, white: bool) -> None:
    """Add strands to some scenes; by random numbers of their own.

    Parameters
    ----------
    name : str
        Of the scene.
    content : dict
        What a scene file says.
    white : bool
        Whether all radiance is the same, so that nothing may absorb light.
    """
    draw = Draw(f"strands of {name}", white=white)
    if not draw.chance(0.3):
        return
    shape = _shape(draw)
    materials = content.setdefault("materials", {})
    known = [each for each, made in materials.items() if made["type"] in _OPAQUE and "normal_map" not in made]
    if known and draw.chance(0.5):
        shape["material"] = draw.one(tuple(known))
    else:
        materials["hair of strands"] = _hair(draw, white)
        shape["material"] = "hair of strands"
    shape |= {"visible_to_camera": False} if draw.chance(0.1) else {}
    shape |= {"name": "tuft", "category": "hair"} if draw.chance(0.2) else {}
    shape |= {"light_group": "a"} if draw.chance(0.1) else {}
    if not white and "visible_to_camera" not in shape and draw.chance(0.1):
        shape["shadow_catcher"] = True
    if draw.chance(0.4):
        content.setdefault("groups", {})["tuft of strands"] = {"shapes": [shape]}
        place = {"translate": draw.point(0.7), "rotate_degrees": draw.point(90.0), "scale": draw.between(0.5, 1.5)}
        shape = {"type": "instance", "group": "tuft of strands", "transform": place}
    if "shutter" in content["camera"] and draw.chance(0.6):
        begin = content["camera"]["shutter"][0] + content["camera"].get("time", 0.0)
        shape["motion"] = [{"time": begin}, {"time": begin + 0.7, "translate": draw.point(0.2)}]
    content["shapes"].append(shape)


def _shape(draw: Draw) -> Json:
    if draw.chance(0.35):
        file = draw.one(("strands.npy", "strands.txt"))
        made: Json = {"type": "curves", "file": file, "transform": {"scale": draw.between(0.5, 1.2)}}
        return made | ({"radius": draw.between(0.01, 0.1)} if draw.chance(0.3) else {})
    basis = draw.one(tuple(_LEAST))
    counts = [draw.one(_LEAST[basis]) for _ in range(draw.count(1, 4))]
    points: list[list[float]] = []
    for count in counts:
        place, way = draw.point(0.9), draw.point(0.5)
        for _ in range(count):
            points.append(place)
            way = [a + b for a, b in zip(way, draw.point(0.35), strict=True)]
            place = [round(a + 0.6 * b, 4) for a, b in zip(place, way, strict=True)]
    radii: Any = draw.between(0.01, 0.15)
    if draw.chance(0.6):
        radii = [radii, draw.one((0.0, draw.between(0.01, 0.1)))]
    made = {"type": "curves", "points": points, "radius": radii, "basis": basis}
    made["profile"] = "ribbon" if draw.chance(0.3) else "round"
    if made["profile"] == "ribbon" and draw.chance(0.6):
        made["normals"] = [draw.point(1.0) for _ in range(draw.one((1, len(points))))]
    return made | ({"counts": counts} if len(counts) > 1 or draw.chance(0.3) else {})


def _hair(draw: Draw, white: bool) -> Json:
    made: Json = {"type": "hair"}
    way = "reflectance" if white else draw.one(("reflectance", "absorption_coefficient", "melanin", "texture"))
    if way == "reflectance":
        made["reflectance"] = [1.0, 1.0, 1.0] if white else draw.color()
    elif way == "texture":
        colors = [draw.color(), draw.color()]
        made["reflectance"] = draw.one(({"ramp": colors}, {"checker": colors}, {"texture": "colors.png"}))
    elif way == "absorption_coefficient":
        made["absorption_coefficient"] = draw.color(0.0, 2.0)
    else:
        made |= {"eumelanin": draw.between(0.1, 2.0)} if draw.chance(0.7) else {}
        made |= {"pheomelanin": draw.between(0.1, 2.0)} if draw.chance(0.7) else {}
    # Narrower lobes need more samples than tests have
    made |= {"roughness": draw.between(0.3, 1.0)} if draw.chance(0.7) else {}
    made |= {"azimuthal_roughness": draw.between(0.3, 1.0)} if draw.chance(0.7) else {}
    made |= {"tilt_degrees": draw.between(-6.0, 6.0)} if draw.chance(0.5) else {}
    made |= {"ior": draw.between(1.2, 1.8)} if draw.chance(0.5) else {}
    made |= {"termination": draw.between(0.05, 0.3)} if draw.chance(0.3) else {}
    if draw.chance(0.25):
        varied: tuple[Json, ...] = ({"ramp": [0.2, 0.9]}, {"checker": [0.3, 1.0]}, {"texture": "numbers.png"})
        made["opacity"] = draw.one((draw.between(0.3, 1.0), draw.one(varied)))
        made |= {"opacity_cutoff": draw.between(0.2, 0.8)} if draw.chance(0.4) else {}
    return made
