"""The camera of a glTF scene: the first one in it."""

from __future__ import annotations

import math
from typing import Any, Final

from clrender.importers.gltf.document import Document
from clrender.importers.gltf.matrices import Matrix
from clrender.importers.gltf.nodes import Nodes
from clrender.wording import quoted

__all__ = ["add_camera"]

_LONG_SIDE: Final = 800
"""Longer side of an image whose aspect ratio the camera gives, pixels."""


def add_camera(document: Document, nodes: Nodes) -> None:
    """Add the camera and the size of its image to the draft's description, if there is a camera."""
    cameras = [index for index in nodes.shown if "camera" in document.items("nodes")[index]]
    usable: list[tuple[int, dict[str, Any], float]] = []
    for index in cameras:
        number = document.items("nodes")[index]["camera"]
        made = _made(document, number, nodes.world[index], index)
        if made is not None:
            usable.append((number, *made))
    if not usable:
        return
    number, camera, aspect = usable[0]
    if len(usable) > 1:
        name = document.items("cameras")[number].get("name", f"/cameras/{number}")
        document.note(f"it has {len(usable)} cameras; the image is of the first, {quoted(name)}")
    document.draft.description["camera"] = camera
    if aspect > 0.0:
        aspect = min(max(aspect, 1.0 / 16.0), 16.0)
        document.draft.description["image"] = {
            "width": round(_LONG_SIDE * min(aspect, 1.0)),
            "height": round(_LONG_SIDE / max(aspect, 1.0)),
        }


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
