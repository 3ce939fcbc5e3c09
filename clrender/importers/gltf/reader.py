"""Reads glTF 2.0: a `.gltf` with its external files, or a `.glb`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from clrender.importers.asset_files import AssetFiles
from clrender.importers.choices import Choices
from clrender.importers.draft import Draft
from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.animation import moved_at
from clrender.importers.gltf.animation_checks import check_animations
from clrender.importers.gltf.cameras import add_camera
from clrender.importers.gltf.container import opened
from clrender.importers.gltf.deform import joint_transforms
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.draco import decode_draco
from clrender.importers.gltf.instancing import flattening, instance_maps, placed
from clrender.importers.gltf.lights import add_lights
from clrender.importers.gltf.materials import Materials
from clrender.importers.gltf.matrices import IDENTITY, Matrix
from clrender.importers.gltf.meshes import Meshes, Part
from clrender.importers.gltf.motion import NodeMotion
from clrender.importers.gltf.nodes import Nodes
from clrender.importers.gltf.textures import Textures
from clrender.importers.gltf.validator import validate
from clrender.importers.instancing import place_group
from clrender.scene.values import NAME_LIMIT, SHAPE_LIMIT
from clrender.wording import counted

__all__ = ["read"]


def read(path: Path, files: AssetFiles, choices: Choices | None = None) -> Draft:
    """The scene of a glTF file.

    Parameters
    ----------
    path : pathlib.Path
    files : AssetFiles
    choices : Choices, optional
        Moment of its animation, and material variant.

    Raises
    ------
    SceneError
        With the JSON pointer of the fault.
    """
    choices = choices or Choices()
    # Emission in glTF is mostly a detail of a model that viewers light themselves
    document = opened(path, files, Draft(wants_light=True, wants_exposure=True))
    validate(document)
    accessors = Accessors(document)
    accessors.check()
    decode_draco(document, accessors)
    check_animations(document, accessors)
    # Of an open shutter the image is of an animation, which begins at time 0
    moment = 0.0 if choices.time_at is None and choices.shutter is not None else choices.time_at
    nodes = Nodes(document, moved_at(document, accessors, moment))
    motion = NodeMotion(document, accessors, nodes, choices)
    skins = [
        joint_transforms(document, accessors, index, motion.joints(skin))
        for index, skin in enumerate(document.items("skins"))
    ]
    meshes = Meshes(document, accessors, Materials(document, Textures(document, accessors), choices.variant))
    for index in nodes.shown:
        if "mesh" in document.items("nodes")[index]:
            _add_shapes(document, accessors, nodes, motion, skins, meshes, index)
    add_camera(document, nodes, motion)
    add_lights(document, nodes, motion)
    description = document.draft.description
    if not description["shapes"]:
        document.note("nothing in it has a surface: the image is of what is around it")
        description.setdefault("camera", {"position": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0]})
    return document.draft


def _add_shapes(
    document: Document,
    accessors: Accessors,
    nodes: Nodes,
    motion: NodeMotion,
    skins: list[list[Matrix]],
    meshes: Meshes,
    index: int,
) -> None:
    """Add the shapes of a node's mesh, for each of its instances."""
    node, shapes = document.items("nodes")[index], document.draft.description["shapes"]
    joints = skins[node["skin"]] if "skin" in node else None
    weights = nodes.weights(index, document.items("meshes")[node["mesh"]])
    changes = bool(motion.times) and _deforms(node, motion, joints, weights, document, index)
    parts = meshes.parts(node["mesh"], weights, joints, index, deforms=changes)
    # Skinned vertices are already in world space, independent of their node
    keys = [] if joints else motion.keys(index)
    world = IDENTITY if joints or keys else nodes.world[index]
    moves = {"motion": keys} if keys else {}
    maps = instance_maps(document, accessors, index)
    made = [_shape(part) for part in parts]
    if changes and (maps is not None or not _add_poses(document, accessors, motion, meshes, index, parts, made)):
        document.note(f"/nodes/{index}: its mesh changes its form, and is rendered as it is at the time of the image")
    name = (node.get("name") or document.items("meshes")[node["mesh"]].get("name") or "")[:NAME_LIMIT]
    places = np.array([world[:3]]) if maps is None else placed(world, maps)
    flat = flattening(places)
    if flat.any():
        document.note(f"/nodes/{index}: {_times(int(np.count_nonzero(flat)))} left out, which its transform flattens")
        places = places[~flat]
    if maps is not None and place_group(document.draft, made, places, name, moves):
        return
    if len(shapes) + len(places) * len(made) > SHAPE_LIMIT:
        raise document.fault(
            f"/nodes/{index}", f"makes more than {counted(SHAPE_LIMIT, 'shape')} of the scene; export fewer"
        )
    for rows in places.tolist():
        matrix = (*(tuple(row) for row in rows), IDENTITY[3])
        for shape in made:
            where: dict[str, Any] = {} if matrix == IDENTITY else {"transform": {"matrix": matrix}}
            where |= moves
            shapes.append({**shape, **({"name": name} if name else {}), **where})


def _add_poses(
    document: Document,
    accessors: Accessors,
    motion: NodeMotion,
    meshes: Meshes,
    index: int,
    parts: list[Part],
    made: list[dict[str, Any]],
) -> bool:
    """Give a node's shapes their forms while the shutter is open; whether that can be done.

    They must not shine, nor become mirror images on their way.
    """
    node, materials = document.items("nodes")[index], document.draft.description["materials"]
    if any("emission" in materials.get(shape["material"], {}) for shape in made):
        return False
    mesh, poses = node["mesh"], [list[dict[str, Any]]() for _ in made]
    weights = motion.weights(index, document.items("meshes")[mesh])
    for time, number in motion.forms():
        joints = None
        if "skin" in node:
            worlds = motion.joints(document.items("skins")[node["skin"]], number)
            joints = joint_transforms(document, accessors, node["skin"], worlds)
        files = meshes.posed(mesh, parts, weights[number], joints, f" of /nodes/{index} at {time!r} s")
        if files is None:
            return False
        for of_part, file in zip(poses, files, strict=True):
            of_part.append({"time": time, "file": file})
    for shape, of_shape in zip(made, poses, strict=True):
        shape["poses"] = of_shape
    if any(each != weights[0] for each in weights) and _has_other_targets(document.items("meshes")[mesh]):
        text = "colours and texture coordinates of its morph targets are those at the time of the image"
        document.note(f"/nodes/{index}: {text}")
    return True


def _has_other_targets(mesh: dict[str, Any]) -> bool:
    """Whether morph targets of a mesh change what poses do not have."""
    keys = [key for each in mesh["primitives"] for target in each.get("targets", []) for key in target]
    return any(key.startswith(("COLOR_", "TEXCOORD_")) for key in keys)


def _deforms(
    node: dict[str, Any],
    motion: NodeMotion,
    joints: list[Matrix] | None,
    weights: list[float],
    document: Document,
    index: int,
) -> bool:
    """Whether a mesh changes its form while the shutter is open: by its joints, or its morph targets."""
    if joints is not None and any(motion.of(joint) for joint in document.items("skins")[node["skin"]]["joints"]):
        return True
    mesh = document.items("meshes")[node["mesh"]]
    return any(each != weights for each in motion.weights(index, mesh))


def _shape(part: Part) -> dict[str, Any]:
    """Description of a primitive's shape, without transform and name."""
    shape: dict[str, Any] = {"type": "mesh", "file": part.mesh, "material": part.material.name}
    return {**shape, "vertex_colors": "linear"} if part.colored else shape


def _times(count: int) -> str:
    return "a mesh was" if count == 1 else f"{count} meshes were"
