"""Converts cameras, media, spots, skies and opacity of `cross_check.py` to the formats of Mitsuba and pbrt."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np

__all__ = [
    "element",
    "mitsuba_around",
    "mitsuba_mask",
    "mitsuba_medium",
    "mitsuba_sensor",
    "mitsuba_sky",
    "mitsuba_spot",
    "pbrt_camera",
    "pbrt_interface",
    "pbrt_medium",
    "pbrt_spot",
    "value",
    "words",
]

HARD: Final = 0.9999
"""Beam width of Mitsuba's spots, as a fraction of their cone: their default falloff differs from ours."""
_SKY_NANOMETRES: Final = 106.75
"""Mitsuba divides the sky model's RGB radiance by this, clrender does not."""
_LOOK: Final = (("origin", "position"), ("target", "target"), ("up", "up"))


def words(values: Any) -> str:
    """Numbers separated by blanks."""
    return " ".join(repr(float(x)) for x in np.asarray(values, np.float64).ravel())


def element(tag: str, inside: str = "", **attributes: str) -> str:
    """An XML element."""
    head = "".join(f" {key}={quoteattr(text)}" for key, text in attributes.items())
    return f"<{tag}{head}>{inside}</{tag}>\n" if inside else f"<{tag}{head}/>\n"


def value(tag: str, name: str, given: Any) -> str:
    """A named value of Mitsuba's XML."""
    text = str(given).lower() if isinstance(given, bool) else given if isinstance(given, str) else words(given)
    return element(tag, name=name, value=text)


# --- Mitsuba


def mitsuba_sensor(camera: dict[str, Any], inside: str) -> str:
    """A sensor of a square image, with further child elements."""
    at = {key: ", ".join(map(repr, camera.get(name, (0.0, 1.0, 0.0)))) for key, name in _LOOK}
    look = element("lookat", **at)
    if camera.get("type") == "orthographic":
        half = repr(camera["height"] / 2.0)
        scaled = element("scale", x=half, y=half, z="1")
        return element("sensor", element("transform", scaled + look, name="to_world") + inside, type="orthographic")
    inside = element("transform", look, name="to_world") + value("string", "fov_axis", "y") + inside
    inside += value("float", "fov", camera["vertical_fov"])
    if not camera.get("aperture_radius"):
        return element("sensor", inside, type="perspective")
    for name in ("aperture_radius", "focus_distance"):
        inside += value("float", name, camera[name])
    return element("sensor", inside, type="thinlens")


def mitsuba_medium(described: dict[str, Any], name: str) -> str:
    """A homogeneous medium with a Henyey-Greenstein phase function."""
    absorption, scattering = (np.broadcast_to(described.get(key, 0.0), 3) for key in ("absorption", "scattering"))
    extinction = absorption + scattering
    scale = max(float(extinction.max()), 1e-30)  # a colour is at most 1 there
    albedo = np.divide(scattering, extinction, out=np.zeros(3), where=extinction > 0.0)
    inside = (
        value("rgb", "albedo", albedo) + value("rgb", "sigma_t", extinction / scale) + value("float", "scale", scale)
    )
    phase = element("phase", value("float", "g", described.get("g", 0.0)), type="hg")
    return element("medium", inside + phase, type="homogeneous", id=name)


def mitsuba_around(shape: dict[str, Any], materials: dict[str, Any], fog: str | None) -> str:
    """The media behind and in front of a transmissive surface; an invisible BSDF for a shape without a material."""
    inside = "" if "material" in shape else element("bsdf", type="null")
    clear = "material" not in shape or materials[shape["material"]]["type"] == "dielectric"
    if "interior" in shape:
        inside += element("ref", name="interior", id=shape["interior"])
    return inside + (element("ref", name="exterior", id=fog) if fog is not None and clear else "")


def mitsuba_mask(opacity: Any, nested: str, name: str, folder: Path, bitmap: Any) -> str:
    """A material with opacity, a number or the alpha of an image, which is written as a separate grey image."""
    if not isinstance(opacity, dict):
        return element("bsdf", value("float", "opacity", opacity) + nested, type="mask", id=name)
    from PIL import Image

    grey = f"{Path(opacity['texture']).stem}_alpha.png"
    with Image.open(folder / opacity["texture"]) as picture:
        picture.getchannel("A").save(folder / grey)
    inside = bitmap({**opacity, "texture": grey, "color_space": "linear"}, "opacity")
    return element("bsdf", inside + nested, type="mask", id=name)


def mitsuba_spot(light: dict[str, Any]) -> str:
    """A spot with a hard edge, as the falloff is another function there."""
    position, direction = np.array(light["position"]), np.array(light["direction"])
    up = (1.0, 0.0, 0.0) if abs(direction[0]) < 0.9 * np.linalg.norm(direction) else (0.0, 1.0, 0.0)
    at = {"origin": position, "target": position + direction, "up": np.array(up)}
    look = element("lookat", **{key: ", ".join(map(repr, vector.tolist())) for key, vector in at.items()})
    half = light["cone_degrees"] / 2.0
    inside = element("transform", look, name="to_world") + value("rgb", "intensity", light["intensity"])
    inside += value("float", "cutoff_angle", half) + value("float", "beam_width", HARD * half)
    return element("emitter", inside, type="spot")


def mitsuba_sky(light: dict[str, Any]) -> str:
    """The sky without sun and ground: the spectra of the sun's disc differ. Up is z there."""
    if light["sun_scale"] != 0.0 or light["ground"]:
        raise ValueError("of a sun_sky only the sky has an equal in Mitsuba: give sun_scale = 0 and ground = false")
    x, y, z = light["sun_direction"]
    turned = element("transform", element("rotate", x="1", angle="-90"), name="to_world")
    towards = element("vector", name="sun_direction", x=repr(x), y=repr(y), z=repr(z))
    inside = turned + towards + value("float", "turbidity", light["turbidity"]) + value("float", "sun_scale", 0.0)
    inside += value("float", "sky_scale", _SKY_NANOMETRES * light.get("sky_scale", 1.0) * light.get("scale", 1.0))
    return element("emitter", inside + value("float", "albedo", light["ground_albedo"]), type="sunsky")


# --- pbrt


def pbrt_camera(camera: dict[str, Any]) -> str:
    """A camera of a square image."""
    if camera.get("type") == "orthographic":
        half = camera["height"] / 2.0
        return f'Camera "orthographic" "float screenwindow" [{words([-half, half, -half, half])}]'
    made = f'Camera "perspective" "float fov" {camera["vertical_fov"]!r}'
    if not camera.get("aperture_radius"):
        return made
    return f'{made} "float lensradius" {camera["aperture_radius"]!r} "float focaldistance" {camera["focus_distance"]!r}'


def pbrt_medium(described: dict[str, Any], name: str) -> str:
    """A homogeneous medium."""
    absorption, scattering = (np.broadcast_to(described.get(key, 0.0), 3) for key in ("absorption", "scattering"))
    coefficients = f'"rgb sigma_a" [{words(absorption)}] "rgb sigma_s" [{words(scattering)}]'
    return f'MakeNamedMedium "{name}" "string type" "homogeneous" {coefficients} "float g" {described.get("g", 0.0)!r}'


def pbrt_interface(shape: dict[str, Any], fog: str | None) -> str:
    """The media behind and in front of a surface, if any."""
    if "interior" not in shape and fog is None:
        return ""
    # By default, the medium behind a surface is the one in front of it
    return f'MediumInterface "{shape.get("interior", "")}" "{fog or ""}"'


def pbrt_spot(light: dict[str, Any]) -> str:
    """A spot with a smoothstep in the cosine, as here."""
    half = light["cone_degrees"] / 2.0
    edge = math.cos(math.radians(half))
    delta = half - math.degrees(math.acos(edge + light.get("blend", 0.15) * (1.0 - edge)))
    position = np.array(light["position"])
    where = f'"point3 from" [{words(position)}] "point3 to" [{words(position + light["direction"])}]'
    angles = f'"float coneangle" {half!r} "float conedeltaangle" {delta!r}'
    return f'LightSource "spot" {where} {angles} "rgb I" [{words(light["intensity"])}]'
