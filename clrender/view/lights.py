"""What lights a scene and can be changed in a view: its lights, its shapes that shine, and lights that are added."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

from clrender.scene import Scene
from clrender.scene.camera import Camera
from clrender.scene.groups import Instance
from clrender.scene.light_kinds import LIGHT_TYPES, DirectionalLight, Light, PointLight, SpotLight
from clrender.scene.shapes import AnyShape, Quad, Sphere
from clrender.scene.spectra import SpectralColor
from clrender.scene.values import cross, length
from clrender.view.parameters import parameters, spectrum_words

__all__ = [
    "ADDED",
    "Emitter",
    "added_light",
    "emitter_keys",
    "emitter_parameters",
    "emitters",
    "free_place",
    "label_of",
    "place_of_shape",
    "with_emitters",
]

Emitter: TypeAlias = Light | AnyShape
ADDED: Final = ("point", "spot", "sphere", "area", "directional")
"""Kinds of lights that a view adds."""

_SHAPE_KEYS: Final = ("emission", "center", "radius", "origin", "edge_u", "edge_v", "normal", "visible_to_camera")
"""Keys of a shape that are about its light, and where it is; its others belong to the scene file."""
_HEIGHT: Final = 0.25
"""Of an added lamp above the picked point, as a share of the distance from the camera."""
_PLACE: Final = re.compile(r"(lights|shapes)\[(\d+)\]")
_PI: Final = 3.141592653589793


def emitters(scene: Scene, changed: Mapping[str, Emitter | None] | None = None) -> Mapping[str, Emitter]:
    """Lights and shining shapes of a scene with edits, by place, ``lights[0]`` or ``shapes[3]``; of groups, none.

    Parameters
    ----------
    scene : Scene
        As it was read.
    changed : mapping, optional
        As of `with_emitters`.
    """

    def found() -> Mapping[str, Emitter]:
        lights: dict[str, Any] = {f"lights[{index}]": light for index, light in enumerate(scene.lights)}
        shining = {
            f"shapes[{index}]": shape
            for index, shape in enumerate(scene.shapes)
            if not isinstance(shape, Instance) and shape.emission is not None
        }
        return {**lights, **shining}

    own: Mapping[str, Emitter] = scene.of_contents("emitters", found)
    now = {place: part for place, part in {**own, **(changed or {})}.items() if part is not None}
    return now if now.keys() == own.keys() else {place: now[place] for place in sorted(now, key=_split)}


def with_emitters(scene: Scene, changed: Mapping[str, Emitter | None]) -> Scene:
    """The scene with other lights or shining shapes, each checked already, at these places.

    What changes are whole tables that nothing else of the scene names, so nothing has to be checked anew.

    Parameters
    ----------
    scene : Scene
    changed : mapping
        By place. Those beyond the scene's own are added behind them, in the order of their numbers; None: removed.
    """
    if not changed:
        return scene
    kept: dict[str, Any] = {}
    for table, own in (("lights", scene.lights), ("shapes", scene.shapes)):
        of_table = {_split(place)[1]: part for place, part in changed.items() if _split(place)[0] == table}
        if of_table:
            numbers = sorted({*range(len(own)), *of_table})
            parts = [of_table[each] if each in of_table else own[each] for each in numbers]
            kept[table] = tuple(part for part in parts if part is not None)
    return scene.with_checked(**kept)


def free_place(scene: Scene, changed: Mapping[str, Emitter | None], table: str) -> str:
    """A place for another light (table ``lights``) or shining shape (``shapes``), behind all others."""
    used = [_split(place)[1] for place in changed if _split(place)[0] == table]
    return f"{table}[{max([len(scene.lights if table == 'lights' else scene.shapes) - 1, *used]) + 1}]"


def place_of_shape(scene: Scene, changed: Mapping[str, Emitter | None], index: int) -> str:
    """The place of a shape of the scene with edits, by its index there."""
    own = len(scene.shapes)
    added = sorted(number for table, number in map(_split, changed) if table == "shapes" and number >= own)
    return f"shapes[{index if index < own else added[index - own]}]"


def _split(place: str) -> tuple[str, int]:
    found = _PLACE.fullmatch(place)
    assert found is not None, place
    return found[1], int(found[2])


def added_light(kind: str, position: Sequence[float], camera: Camera, stops: float) -> tuple[str, Emitter]:
    """A light above a point, which lights a white surface there to what the exposure makes white; and its table.

    Parameters
    ----------
    kind : str
        Of `ADDED`.
    position : (float, float, float)
        The point, metres.
    camera : Camera
        Up is the camera's.
    stops : float
        Of its exposure.
    """
    up = _scaled(camera.up, 1.0 / length(camera.up))
    side = cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.5 else (0.0, 0.0, 1.0))
    side = _scaled(side, 1.0 / length(side))
    height = _HEIGHT * max(length(_sum(position, _scaled(camera.position, -1.0))), 1e-6)
    white, down, place = 2.0**-stops, _scaled(up, -1.0), _sum(position, _scaled(up, height))
    irradiance = _color(_PI * white)
    if kind == "directional":
        slanted = _rounded(_sum(_scaled(down, 1.0), _scaled(side, 0.5)))
        return "lights", DirectionalLight(type="directional", direction=slanted, irradiance=irradiance)
    if kind == "point":
        return "lights", PointLight(type="point", position=_rounded(place), intensity=_color(_PI * white * height**2))
    if kind == "spot":
        intensity = _color(_PI * white * height**2)
        return "lights", SpotLight(
            type="spot", position=_rounded(place), direction=_rounded(down), intensity=intensity, cone_degrees=60.0
        )
    if kind == "sphere":
        # Irradiance of a sphere at a distance: pi L (r / h)^2
        return "shapes", Sphere(
            type="sphere", center=_rounded(place), radius=_rounded([height / 8])[0], emission=_color(64.0 * white)
        )
    # Of a small square whose side is h / 2, facing the point: L / 4
    edge_u, edge_v = _scaled(cross(up, side), height / 2), _scaled(side, height / 2)
    corner = _sum(place, _scaled(_sum(edge_u, edge_v), -0.5))
    return "shapes", Quad(
        type="quad",
        origin=_rounded(corner),
        edge_u=_rounded(edge_u),
        edge_v=_rounded(edge_v),
        emission=_color(4.0 * _PI * white),
    )


def _sum(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _scaled(a: Sequence[float], by: float) -> tuple[float, float, float]:
    return (a[0] * by, a[1] * by, a[2] * by)


def _rounded(values: Sequence[float]) -> Any:
    """Numbers as people write them: they stand in a scene file afterwards. 0.0 adds to -0.0 as 0."""
    return tuple(float(f"{each:.4g}") + 0.0 for each in values)


def _color(value: float) -> Any:
    return _rounded([value] * 3)


def label_of(place: str, part: Emitter) -> str:
    """A name for people: that of the shape, or its type, and the place."""
    name = getattr(part, "name", None) or part.type.replace("_", " ")
    return f"{name} ({place})"


def _factor(part: Emitter, told: dict[str, Any]) -> dict[str, Any]:
    color = getattr(part, told["name"])
    if not isinstance(color, SpectralColor):
        return told
    about = {"kind": "number", "value": color.spectrum.scale, "schema": {"type": "number", "minimum": 0.0}}
    return {**told, **about, "help": f"factor of its {spectrum_words(color)}"}


def emitter_keys(part: Emitter) -> list[str]:
    """Keys of a light or shining shape that may be changed."""
    return [each["name"] for each in emitter_parameters(part) if each["kind"] != "fixed"]


def emitter_parameters(part: Emitter) -> list[dict[str, Any]]:
    """As of `clrender.view.parameters.parameters`. Alternatives that the scene does not use are left out.

    What it uses stays: without a value, a light would have no light. Light with a spectrum is a number, the factor of
    the spectrum.
    """
    known = [{**_factor(part, each), "optional": False} for each in parameters(part) if each["value"] is not None]
    if part.type in LIGHT_TYPES:
        return known
    return [each for each in known if each["name"] in _SHAPE_KEYS]
