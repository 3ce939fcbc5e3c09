"""Normal maps of other renderers, whose green is across red: along normal x dp/du, whichever way v runs there.

Ours is along v. The two differ where the texture coordinates of a surface are mirrored. Ours also turns with the
picture where its texture has a transform, and theirs does not.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import lengths
from clrender.importers.shared.curved import green_reversed
from clrender.importers.shared.matrices import handedness
from clrender.importers.shared.staging import Staging
from clrender.meshes.data import MeshData
from clrender.scene.textures import TextureTransform

__all__ = ["with_green_across"]


def with_green_across(staging: Staging) -> None:
    """Give all shapes of a draft the normal maps of pbrt and Mitsuba.

    Triangles whose texture coordinates are mirrored, or whose map is turned, get tangents that say where red and green
    are; other shapes get maps of reversed green, and a note where these are turned otherwise than upside down.

    Parameters
    ----------
    staging : Staging
        Its shapes, materials, meshes and pictures change.
    """
    draft = staging.draft
    for shape in draft.description["shapes"]:
        if not _has_normal_map(staging, shape.get("material")):
            continue
        mirrored = shape.get("flip_normals", False) != (_handedness(shape) < 0.0)
        if shape["type"] != "mesh":
            shape["material"] = _fitted(staging, shape["material"], mirrored)
            continue
        turned = _has_turned_map(staging, shape["material"])
        mesh = draft.meshes[shape["file"]]
        tangents = _tangents(mesh, -1.0 if mirrored else 1.0, turned)
        if tangents is not None:
            name = f"{shape['file']}, green across{' its back' if mirrored else ''}{' throughout' if turned else ''}"
            draft.meshes.setdefault(name, dataclasses.replace(mesh, tangents=tangents))
            shape["file"] = name


def _handedness(shape: dict[str, Any]) -> float:
    """1, or -1 if the way of a shape to the world mirrors it."""
    ways = [key["matrix"] for key in shape.get("motion", ())[:1]]
    ways += [shape["transform"]["matrix"]] if "transform" in shape else []
    made = 1.0
    for way in ways:
        made *= handedness(np.array(way))
    return made


def _has_normal_map(staging: Staging, name: str | None) -> bool:
    material = staging.draft.description["materials"].get(name, {})
    return "normal_map" in material or any(_has_normal_map(staging, part) for part in material.get("materials", ()))


def _has_turned_map(staging: Staging, name: str | None) -> bool:
    """Whether the transform of a normal map's texture turns or mirrors it."""
    material = staging.draft.description["materials"].get(name, {})
    transform = _transform(material.get("normal_map", {}))
    turns = transform.rotate_degrees != 0.0 or min(transform.scale) < 0.0
    return turns or any(_has_turned_map(staging, part) for part in material.get("materials", ()))


def _transform(normal_map: dict[str, Any]) -> TextureTransform:
    return TextureTransform(**normal_map.get("transform", {}))


def _fitted(staging: Staging, name: str, mirrored: bool) -> str:
    """Name of a material like another whose normal maps have green where it belongs on a shape without tangents."""
    described = dict(staging.draft.description["materials"][name])
    fitted = dict(described)
    if "normal_map" in described:
        transform = _transform(described["normal_map"])
        if transform.rotate_degrees or transform.scale[0] < 0.0:
            staging.note("the slopes of a normal map that a transform turns, on a shape that is no mesh, turn with it")
        if mirrored != (transform.scale[1] < 0.0):
            fitted["normal_map"] = green_reversed(staging, described["normal_map"])
    if "materials" in described:
        fitted["materials"] = [_fitted(staging, part, mirrored) for part in described["materials"]]
    return name if fitted == described else staging.material(f"{name}, green across", fitted)


def _tangents(mesh: MeshData, facing: float, every: bool) -> NDArray[np.float32] | None:
    """Tangents of the triangles whose texture coordinates are mirrored, or of all; None if there are none.

    Parameters
    ----------
    mesh : MeshData
    facing : float
        1, or -1 if the mesh is seen from the other side, or in a mirror.
    every : bool
        Whether all triangles with texture coordinates get some.

    Returns
    -------
    (T, 3, 4) float32, or None
        Towards dp/du, with the sign that makes green of the placed triangles normal x dp/du. Zero where green is so.
    """
    if mesh.uvs is None:
        return None
    a, b, c = (np.asarray(mesh.vertices, np.float64)[mesh.triangles[:, i]] for i in range(3))
    first, second = (mesh.uvs[:, i].astype(np.float64) - mesh.uvs[:, 0] for i in (1, 2))
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    along = second[:, 1:] * (b - a) - first[:, 1:] * (c - a)
    size = lengths(along)
    asked = (every | (area * facing < 0.0)) & (size > 0.0) & (area != 0.0)
    if not asked.any():
        return None
    made = np.zeros((len(area), 3, 4), np.float32)
    unit = along * (np.sign(area) / np.where(size > 0.0, size, 1.0))[:, None]
    made[asked, :, :3] = unit[asked, None]
    made[asked, :, 3] = facing
    return made
