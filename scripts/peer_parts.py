"""Converts cameras, media and spots of `cross_check.py` to the format of pbrt."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

__all__ = [
    "pbrt_camera",
    "pbrt_interface",
    "pbrt_medium",
    "pbrt_spot",
    "words",
]


def words(values: Any) -> str:
    """Numbers separated by blanks."""
    return " ".join(repr(float(x)) for x in np.asarray(values, np.float64).ravel())


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
