"""Puts together the scene file: what clrender reads of the glTF file, and what such a file cannot say."""

from __future__ import annotations

from collections.abc import Mapping
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
    is_open : bool
        Whether its mesh has open edges, and so no inside.
    """

    name: str
    visible_camera: bool = True
    shadow_catcher: bool = False
    is_open: bool = False


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
    """

    camera: dict[str, Any]
    width: int
    height: int
    lights: list[dict[str, Any]] = field(default_factory=list)
    shapes: list[dict[str, Any]] = field(default_factory=list)
    environment: dict[str, Any] | None = None
    objects: dict[str, Placed] = field(default_factory=dict)


def assembled(converted: Mapping[str, Any], parts: SceneParts) -> dict[str, Any]:
    """The scene, in the form of a scene file.

    Parameters
    ----------
    converted : dict
        As `clrender convert` writes it; empty if there are no meshes. Its camera and lights are those that models get
        that have none, and are replaced.
    parts : SceneParts
    """
    materials, groups, own = _solids(converted, parts.objects)
    shapes = [_shape(shape, parts.objects) for shape in own]
    if any(shape.get("material") == LAMP for shape in parts.shapes):
        materials[LAMP] = dict(LAMP_MATERIAL)
    return {
        **converted,
        "camera": parts.camera,
        "image": {"width": parts.width, "height": parts.height},
        "materials": materials,
        "shapes": [*shapes, *parts.shapes],
        **({"groups": groups} if groups else {}),
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


def _solids(
    converted: Mapping[str, Any], objects: Mapping[str, Placed]
) -> tuple[dict[str, Any], dict[str, Any], list[dict[str, Any]]]:
    """Materials, groups and shapes, of which those that let light through are solids in closed meshes.

    glTF has no solids without a thickness, but all that lets light through in Blender is one. A material of closed and
    open meshes becomes two.
    """
    shapes = [dict(shape) for shape in converted.get("shapes", [])]
    groups = {
        name: {**group, "shapes": [dict(shape) for shape in group["shapes"]]}
        for name, group in converted.get("groups", {}).items()
    }
    is_open: list[tuple[dict[str, Any], bool]] = []
    open_groups = set()
    for shape in shapes:
        placed = objects.get(shape.get("name", ""))
        sheet = placed is not None and placed.is_open
        is_open.append((shape, sheet))
        if sheet and "group" in shape:
            open_groups.add(shape["group"])
    is_open += [(shape, name in open_groups) for name, group in groups.items() for shape in group["shapes"]]
    materials = {name: dict(each) for name, each in converted.get("materials", {}).items()}
    of_sheets = {shape.get("material") for shape, sheet in is_open if sheet}
    for name in [each for each, material in materials.items() if material.get("thin") and "opacity" not in material]:
        solid = {key: value for key, value in materials[name].items() if key != "thin"}
        if name not in of_sheets:
            materials[name] = solid
            continue
        inside = f"{name} (solid)"
        while inside in materials:
            inside += "_"
        for shape, sheet in is_open:
            if not sheet and shape.get("material") == name:
                shape["material"] = inside
                materials[inside] = solid
    return materials, groups, shapes
