"""Puts together the scene file: what clrender reads of the glTF file, and what such a file cannot say."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from .lights import LAMP, LAMP_MATERIAL

__all__ = ["Placed", "SceneParts", "assembled"]


@dataclass(frozen=True)
class Placed:
    """An object as Blender has it.

    Attributes
    ----------
    name : str
    visible_camera, shadow_catcher : bool
    """

    name: str
    visible_camera: bool = True
    shadow_catcher: bool = False


@dataclass
class SceneParts:
    """What is added to the meshes and materials of the glTF file.

    Attributes
    ----------
    camera : dict
        Table `[camera]`.
    width, height : int
        Pixels.
    lights, shapes : list of dict
        Tables of lights, and of shapes that shine.
    environment : dict or None
    objects : dict of str to Placed
        By the names that the glTF file has for them.
    sheets : set of str
        Names of materials of meshes with open edges, which have no inside.
    """

    camera: dict[str, Any]
    width: int
    height: int
    lights: list[dict[str, Any]] = field(default_factory=list)
    shapes: list[dict[str, Any]] = field(default_factory=list)
    environment: dict[str, Any] | None = None
    objects: dict[str, Placed] = field(default_factory=dict)
    sheets: set[str] = field(default_factory=set)


def assembled(converted: Mapping[str, Any], parts: SceneParts) -> dict[str, Any]:
    """The scene, in the form of a scene file.

    Parameters
    ----------
    converted : dict
        As `clrender convert` writes it; empty if there are no meshes. Its camera and lights are those that models get
        that have none, and are replaced.
    parts : SceneParts
    """
    shapes = [_shape(shape, parts.objects) for shape in converted.get("shapes", [])]
    materials = {n: _material(n, each, parts.sheets) for n, each in converted.get("materials", {}).items()}
    if any(shape.get("material") == LAMP for shape in parts.shapes):
        materials[LAMP] = dict(LAMP_MATERIAL)
    return {
        **converted,
        "camera": parts.camera,
        "image": {"width": parts.width, "height": parts.height},
        "materials": materials,
        "shapes": [*shapes, *parts.shapes],
        "lights": [*parts.lights, *([] if parts.environment is None else [parts.environment])],
    }


def _shape(shape: Mapping[str, Any], objects: Mapping[str, Placed]) -> dict[str, Any]:
    made = dict(shape)
    placed = objects.get(made.get("name", ""))
    if placed is not None:
        made["name"] = placed.name
        if not placed.visible_camera:
            made["visible_to_camera"] = False
        if placed.shadow_catcher:
            made["shadow_catcher"] = True
    return made


def _material(name: str, material: Mapping[str, Any], sheets: Collection[str]) -> dict[str, Any]:
    """A material; glTF has no solids without a thickness, but all that lets light through in Blender is one."""
    made = dict(material)
    if made.get("thin") and name not in sheets and "opacity" not in made:
        del made["thin"]
    return made
