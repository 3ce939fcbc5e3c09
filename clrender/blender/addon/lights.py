"""Lights of Blender as lights, and shapes that shine, of clrender.

Blender has watts: of a point or a spot 1/(4 pi) of them go into each steradian along its axis, and those of a flat lamp
of area A are a radiance of 1/(pi A) times as much. Its lamps are bodies of light, through which other light passes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from .axes import Matrix, Vector, column, length, unit

__all__ = ["LAMP", "LAMP_MATERIAL", "SHOWN", "BlenderLight", "light_tables"]

LAMP: Final = "lamp of Blender"
"""Name of the material of shapes that stand for lamps."""
SHOWN: Final = 1.0 / 8.0
"""Opacity of lamps, whose radiance is divided by it. Cycles' lamps let all light pass; the less of it they hold up
here, the more noise there is where mirrors show them."""
LAMP_MATERIAL: Final = {"type": "lambert", "reflectance": [0.0, 0.0, 0.0], "opacity": SHOWN}
_SEGMENTS: Final = 64
"""Sides of the polygon that stands for an ellipse."""
_WIDE_SUN: Final = math.radians(1.0)
"""Angle of a sun from which on it is noted that shadows are sharp."""


@dataclass(frozen=True)
class BlenderLight:
    """A light of Blender, by Blender's own names.

    Attributes
    ----------
    name : str
        Of the object.
    matrix : Matrix
        To Blender's world.
    type : str
        ``POINT``, ``SPOT``, ``SUN`` or ``AREA``.
    color : Vector
        With that of its temperature.
    energy : float
        Watts, with the factor of its exposure; of a sun, W/m².
    normalize : bool
        Whether the energy is that of the whole lamp, whatever its size.
    radius : float
        Of a point or a spot, metres.
    angle : float
        Of a sun, radians.
    spot_size : float
        Full angle of the cone, radians.
    spot_blend : float
    shape : str
        ``SQUARE``, ``RECTANGLE``, ``DISK`` or ``ELLIPSE``.
    size, size_y : float
        Of an area light, metres, before the object's scale.
    spread : float
        Radians; pi: all directions.
    visible_camera : bool
        Whether the camera sees the lamp itself.
    use_shadow, use_nodes, is_portal : bool
    """

    name: str
    matrix: Matrix
    type: str
    color: Vector = (1.0, 1.0, 1.0)
    energy: float = 10.0
    normalize: bool = True
    radius: float = 0.0
    angle: float = 0.0
    spot_size: float = math.pi / 4.0
    spot_blend: float = 0.15
    shape: str = "SQUARE"
    size: float = 1.0
    size_y: float = 1.0
    spread: float = math.pi
    visible_camera: bool = True
    use_shadow: bool = True
    use_nodes: bool = False
    is_portal: bool = False


@dataclass
class _Made:
    lights: list[dict[str, Any]]
    shapes: list[dict[str, Any]]
    notes: list[str]


def light_tables(light: BlenderLight) -> tuple[list[dict[str, Any]], list[dict[str, Any]], list[str]]:
    """Tables `[[lights]]` and `[[shapes]]` of a light, and notes of what is left out.

    Parameters
    ----------
    light : BlenderLight

    Returns
    -------
    tuple of list
        At most one table altogether.
    """
    made = _Made([], [], [])
    if light.is_portal:
        made.notes.append(f"{light.name} was left out: portals only guide Cycles' samples")
    elif light.energy > 0.0 and any(light.color):
        _KINDS.get(light.type, _unknown)(light, made)
        if not light.use_shadow:
            made.notes.append(f"{light.name}: that it has no shadows was left out")
        if light.use_nodes:
            made.notes.append(f"{light.name}: its nodes were left out; its colour and power count")
    return made.lights, made.shapes, made.notes


def _times(light: BlenderLight, factor: float) -> list[float]:
    return [max(share, 0.0) * light.energy * factor for share in light.color]


def _unknown(light: BlenderLight, made: _Made) -> None:
    made.notes.append(f"{light.name} was left out: lights of the type {light.type} are not known")


def _point(light: BlenderLight, made: _Made) -> None:
    position = list(column(light.matrix, 3))
    if light.radius <= 0.0:
        intensity = _times(light, _intensity(light))
        made.lights.append({"type": "point", "position": position, "intensity": intensity})
        return
    area = 4.0 * math.pi * light.radius * light.radius if light.normalize else 1.0
    emission = _times(light, 1.0 / (math.pi * area))
    ball = {"type": "sphere", "center": position, "radius": light.radius, "emission": emission}
    made.shapes.append(_shape(light, ball))


def _intensity(light: BlenderLight) -> float:
    """Intensity along the axis of a watt; what is not normalised is a radiance times the area, or that of 1 m²."""
    area = 1.0 if light.normalize else 4.0 * math.pi * light.radius * light.radius or 4.0
    return area / (4.0 * math.pi)


def _spot(light: BlenderLight, made: _Made) -> None:
    direction = [-x for x in column(light.matrix, 2)]
    if light.radius > 0.0:
        made.notes.append(f"{light.name}: its radius was left out; the shadows of a spot light are sharp")
    made.lights.append(
        {
            "type": "spot",
            "position": list(column(light.matrix, 3)),
            "direction": direction,
            "intensity": _times(light, _intensity(light)),
            "cone_degrees": math.degrees(light.spot_size),
            "blend": light.spot_blend,
        }
    )


def _sun(light: BlenderLight, made: _Made) -> None:
    if light.angle > _WIDE_SUN:
        degrees = math.degrees(light.angle)
        made.notes.append(f"{light.name}: its angle of {degrees:.3g} degrees was left out; its shadows are sharp")
    direction = [-x for x in column(light.matrix, 2)]
    made.lights.append({"type": "directional", "direction": direction, "irradiance": _times(light, 1.0)})


def _area(light: BlenderLight, made: _Made) -> None:
    position, across, up = (column(light.matrix, index) for index in (3, 0, 1))
    tall = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    u, v = [x * light.size for x in across], [x * tall for x in up]
    normal = _cross(u, v)
    round_ = light.shape in ("DISK", "ELLIPSE")
    area = length(normal) * (math.pi / 4.0 if round_ else 1.0)
    if area == 0.0:
        made.notes.append(f"{light.name} was left out: it has no area")
        return
    emission = _times(light, 1.0 / (math.pi * area) if light.normalize else 1.0 / math.pi)
    forward = [-x for x in column(light.matrix, 2)]
    # Lamps shine along -z; a mirrored one does so with its other side
    if sum(n * f for n, f in zip(normal, forward, strict=True)) < 0.0:
        v, normal = [-x for x in v], _cross(v, u)
    if light.spread < math.pi * 0.999:
        made.notes.append(f"{light.name}: its spread was left out; it shines to all sides, by the cosine")
    if not round_:
        origin = [p - 0.5 * (a + b) for p, a, b in zip(position, u, v, strict=True)]
        shape: dict[str, Any] = {"type": "quad", "origin": origin, "edge_u": u, "edge_v": v}
    elif abs(length(u) - length(v)) <= 1e-6 * length(u):
        shape = {"type": "disk", "center": list(position), "normal": list(unit(normal)), "radius": 0.5 * length(u)}
    else:
        shape = _ellipse(position, u, v)
    made.shapes.append(_shape(light, {**shape, "emission": emission}))


def _ellipse(center: Vector, u: list[float], v: list[float]) -> dict[str, Any]:
    """A polygon of the area of the ellipse whose axes are u and v."""
    step = 2.0 * math.pi / _SEGMENTS
    grow = 0.5 * math.sqrt(step / math.sin(step))
    turns = [(math.cos(i * step), math.sin(i * step)) for i in range(_SEGMENTS)]
    rim = [[c + grow * (x * a + y * b) for c, a, b in zip(center, u, v, strict=True)] for x, y in turns]
    faces = [[0, 1 + i, 1 + (i + 1) % _SEGMENTS] for i in range(_SEGMENTS)]
    return {"type": "mesh", "vertices": [list(center), *rim], "faces": faces}


def _shape(light: BlenderLight, table: dict[str, Any]) -> dict[str, Any]:
    hidden = {} if light.visible_camera else {"visible_to_camera": False}
    table["emission"] = [share / SHOWN for share in table["emission"]]
    return {"name": light.name, "material": LAMP, **table, **hidden}


def _cross(a: Vector | list[float], b: Vector | list[float]) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


_KINDS: Final = {"POINT": _point, "SPOT": _spot, "SUN": _sun, "AREA": _area}
