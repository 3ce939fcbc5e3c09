"""The cameras of a glTF scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from clrender.importers.asset_files import AssetFiles
from clrender.importers.choices import Choices
from clrender.importers.draft import Draft
from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.animation import moved_at
from clrender.importers.gltf.container import opened
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.matrices import Matrix
from clrender.importers.gltf.motion import NodeMotion
from clrender.importers.gltf.nodes import Nodes
from clrender.importers.gltf.validator import validate
from clrender.wording import counted, quoted

__all__ = ["NodeCamera", "add_camera", "read_cameras"]

_LONG_SIDE: Final = 800
"""Longer side of an image whose aspect ratio the camera gives, pixels."""


@dataclass(frozen=True)
class NodeCamera:
    """A camera where a node places it.

    Attributes
    ----------
    name : str
        Of the camera, else of the node, else its JSON pointer.
    keys : dict
        Table `camera` of a scene file.
    image : dict
        Table `image`; empty if the camera does not give the shape of its image.
    node : int
        Index of the node.
    """

    name: str
    keys: dict[str, Any]
    image: dict[str, int]
    node: int


def add_camera(document: Document, nodes: Nodes, motion: NodeMotion) -> None:
    """Add the first camera and the size of its image to the draft's description, if there is a camera."""
    usable = _cameras(document, nodes, motion.start)
    if not usable:
        return
    first = usable[0]
    if len(usable) > 1:
        document.note(f"it has {counted(len(usable), 'camera')}; the image is of the first, {quoted(first.name)}")
    document.draft.description["camera"] = {**first.keys, **_moving(document, motion, first.node)}
    if first.image:
        document.draft.description["image"] = first.image


def _moving(document: Document, motion: NodeMotion, index: int) -> dict[str, Any]:
    """Keys of the motion of a camera; empty if it rests."""
    keys = []
    for time, world in zip(motion.times, motion.of(index), strict=False):
        made = _made(document, document.items("nodes")[index]["camera"], world, index)
        if made is None:
            return {}
        keys.append({"time": time, **{key: made[0][key] for key in ("position", "target", "up")}})
    return {"motion": keys} if keys else {}


def read_cameras(path: Path, files: AssetFiles, choices: Choices) -> list[NodeCamera]:
    """The cameras of a glTF file, without the rest of its scene.

    Parameters
    ----------
    path : pathlib.Path
    files : AssetFiles
    choices : Choices
        Moment of its animation.

    Raises
    ------
    SceneError
        With the JSON pointer of the fault.
    """
    document = opened(path, files, Draft())
    validate(document)
    accessors = Accessors(document)
    accessors.check()
    nodes = Nodes(document, moved_at(document, accessors, choices.time_at))
    return _cameras(document, nodes, nodes.world.__getitem__)


def _cameras(document: Document, nodes: Nodes, world_of: Callable[[int], Matrix]) -> list[NodeCamera]:
    """The cameras that can be used, in the order of the nodes, whose world transforms `world_of` has."""
    usable = []
    for index in nodes.shown:
        node = document.items("nodes")[index]
        if "camera" not in node:
            continue
        made = _made(document, node["camera"], world_of(index), index)
        if made is not None:
            keys, aspect = made
            name = document.items("cameras")[node["camera"]].get("name") or node.get("name")
            usable.append(NodeCamera(name or f"/cameras/{node['camera']}", keys, _image(aspect), index))
    return usable


def _image(aspect: float) -> dict[str, int]:
    """Size of an image with this aspect ratio; empty for 0."""
    if aspect <= 0.0:
        return {}
    aspect = min(max(aspect, 1.0 / 16.0), 16.0)
    return {"width": round(_LONG_SIDE * min(aspect, 1.0)), "height": round(_LONG_SIDE / max(aspect, 1.0))}


def _made(document: Document, number: int, world: Matrix, node: int) -> tuple[dict[str, Any], float] | None:
    """A camera that looks along the node's -z, and its image's aspect ratio, 0 if unspecified."""
    source, at = document.items("cameras")[number], f"/cameras/{number}"
    kind = source.get("type")
    if kind is None:
        document.note(f"{at} was left out: its type is not known")
        return None
    forward, up = (_unit([sign * world[row][column] for row in range(3)]) for column, sign in ((2, -1.0), (1, 1.0)))
    across = [forward[i - 2] * up[i - 1] - forward[i - 1] * up[i - 2] for i in range(3)]
    if sum(x * x for x in across) < 1e-12:
        document.note(f"{at} was left out: the transform of /nodes/{node} flattens it")
        return None
    position = [world[row][3] for row in range(3)]
    # Far enough for the direction to survive the rounding of large coordinates
    away = max(1.0, *(abs(x) for x in position))
    target = [p + away * f for p, f in zip(position, forward, strict=True)]
    camera: dict[str, Any] = {"position": position, "target": target, "up": up}
    lens = source[kind]
    if kind == "orthographic":
        height, width = abs(lens["ymag"]), abs(lens["xmag"])
        if lens["ymag"] < 0.0 or lens["xmag"] < 0.0:
            document.note(f"{at}/orthographic has a negative xmag or ymag; its size is taken")
        return camera | {"type": "orthographic", "height": 2.0 * height}, width / height
    if lens["yfov"] >= math.pi:
        document.note(f"{at} was left out: its yfov is not below 180 degrees")
        return None
    return camera | {"vertical_fov": math.degrees(lens["yfov"])}, lens.get("aspectRatio", 0.0)


def _unit(vector: list[float]) -> list[float]:
    largest = max(abs(x) for x in vector) or 1.0
    size = math.sqrt(sum((x / largest) * (x / largest) for x in vector)) * largest or 1.0
    return [x / size for x in vector]
