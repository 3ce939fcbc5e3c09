"""What lights a scene and can be changed in a view: its lights, and its shapes that shine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

from clrender.scene import Scene
from clrender.scene.groups import Instance
from clrender.scene.light_kinds import LIGHT_TYPES, Light
from clrender.scene.shapes import AnyShape
from clrender.view.parameters import parameters

__all__ = ["Emitter", "emitter_keys", "emitter_parameters", "emitters", "label_of", "with_emitters"]

Emitter: TypeAlias = Light | AnyShape

_SHAPE_KEYS: Final = ("emission", "center", "radius", "origin", "edge_u", "edge_v", "normal", "visible_to_camera")
"""Keys of a shape that are about its light, and where it is; its others belong to the scene file."""


def emitters(scene: Scene) -> Mapping[str, Emitter]:
    """Lights and shining shapes by their place in the scene, ``lights[0]`` or ``shapes[3]``; of groups, none."""

    def found() -> Mapping[str, Emitter]:
        lights: dict[str, Any] = {f"lights[{index}]": light for index, light in enumerate(scene.lights)}
        shining = {
            f"shapes[{index}]": shape
            for index, shape in enumerate(scene.shapes)
            if not isinstance(shape, Instance) and shape.emission is not None
        }
        return {**lights, **shining}

    return scene.of_contents("emitters", found)


def with_emitters(scene: Scene, changed: Mapping[str, Emitter]) -> Scene:
    """The scene with other lights or shining shapes, each checked already, at these places.

    What changes are numbers of one table, so that nothing else of the scene has to be checked anew.
    """
    if not changed:
        return scene
    lights: list[Any] = list(scene.lights)
    shapes: list[Any] = list(scene.shapes)
    for place, part in changed.items():
        table, _, index = place.rstrip("]").partition("[")
        (lights if table == "lights" else shapes)[int(index)] = part
    kept = {"lights": tuple(lights)} if any(place.startswith("lights") for place in changed) else {}
    if any(place.startswith("shapes") for place in changed):
        kept["shapes"] = tuple(shapes)
    return scene.with_checked(**kept)


def label_of(place: str, part: Emitter) -> str:
    """A name for people: that of the shape, or its type, and the place."""
    name = getattr(part, "name", None) or part.type.replace("_", " ")
    return f"{name} ({place})"


def emitter_keys(part: Emitter) -> list[str]:
    """Keys of a light or shining shape that may be changed."""
    return [each["name"] for each in emitter_parameters(part) if each["kind"] != "fixed"]


def emitter_parameters(part: Emitter) -> list[dict[str, Any]]:
    """As of `clrender.view.parameters.parameters`. Alternatives that the scene does not use are left out."""
    known = [each for each in parameters(part) if each["value"] is not None]
    if part.type in LIGHT_TYPES:
        return known
    return [each for each in known if each["name"] in _SHAPE_KEYS]
