"""Keys of motions: where nodes of an animated file are while the shutter of the camera is open."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Final

import numpy as np

from clrender.importers.choices import Choices
from clrender.importers.gltf.accessors import Accessors
from clrender.importers.gltf.animation import values_at
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.matrices import IDENTITY, Matrix
from clrender.importers.gltf.nodes import Nodes
from clrender.importers.shared.motions import light_motion, unflattened

__all__ = ["NodeMotion"]

_PARTS: Final = 16
"""Pieces of each time between two key frames: their ends are exact, and between them a pose is interpolated."""
_JUMP: Final = 2.0**-20
"""Of the time for which the shutter is open: how long before a key frame without interpolation its jump begins."""


class NodeMotion:
    """World transforms of all nodes at several times.

    Parameters
    ----------
    document : Document
        Validated.
    accessors : Accessors
    nodes : Nodes
        At the time of the image.
    choices : Choices
        With a `shutter`; without one, nothing moves.

    Attributes
    ----------
    times : list of float
        Seconds, ascending; empty if nothing moves.
    """

    def __init__(self, document: Document, accessors: Accessors, nodes: Nodes, choices: Choices) -> None:
        self.times: list[float] = []
        self._document, self._nodes = document, nodes
        self._poses: list[Nodes] = []
        self._forms: list[int] = []
        self._ways: dict[int, list[Matrix]] = {}
        animations = document.items("animations")
        if choices.shutter is None or not animations:
            return
        begin, end = ((choices.time_at or 0.0) + each for each in choices.shutter)
        keys, jump = {begin, end}, _JUMP * (end - begin)
        for sampler in animations[0]["samplers"]:
            frames = accessors.raw(sampler["input"]).astype(np.float64).tolist()
            keys |= {time for time in frames if begin < time < end}
            if sampler.get("interpolation") == "STEP":
                keys |= {time - jump for time in frames if begin < time - jump and time < end}
        for first, last in pairwise(sorted(keys)):
            parts = _PARTS if last - first > 2.0 * jump else 1
            self._forms += range(len(self.times), len(self.times) + parts, 2)
            self.times += [first + (last - first) * part / parts for part in range(parts)]
        self._forms.append(len(self.times))
        self.times.append(end)
        self._poses = [Nodes(document, values_at(document, accessors, time)) for time in self.times]

    def start(self, index: int) -> Matrix:
        """World transform of a node at the time of the image; not flat if it is not while the shutter is open."""
        return self._way(index)[0]

    def of(self, index: int) -> list[Matrix]:
        """World transforms of a node at `times`; empty if it rests."""
        worlds = self._way(index)[1:]
        return worlds if any(world != worlds[0] for world in worlds[1:]) else []

    def _way(self, index: int) -> list[Matrix]:
        """World transforms of a node at the time of the image, and then at `times`, without flat ones among others."""
        if index not in self._ways:
            worlds = [pose.world[index] for pose in (self._nodes, *self._poses)]
            if not all(map(_side, worlds)):
                worlds = [tuple(map(tuple, each.tolist())) for each in unflattened([np.array(each) for each in worlds])]
            self._ways[index] = worlds
        return self._ways[index]

    def weights(self, index: int, mesh: dict[str, Any]) -> list[list[float]]:
        """Weights of the morph targets of a node's mesh at `times`."""
        return [pose.weights(index, mesh) for pose in self._poses]

    def forms(self) -> list[tuple[float, int]]:
        """Times for poses of meshes, with their places in `times`: every second, as vertices go straight between."""
        return [(self.times[number], number) for number in self._forms]

    def joints(self, skin: dict[str, Any], number: int | None = None) -> list[Matrix]:
        """World transforms of a skin's joints at one of `times`, or at the time of the image."""
        return [self._way(joint)[0 if number is None else number + 1] for joint in skin["joints"]]

    def keys(self, index: int) -> list[dict[str, Any]]:
        """Keys of a motion from the node's own space to world space; empty if it rests, or cannot be followed."""
        worlds = self.of(index)
        sides = set(map(_side, worlds))
        if len(sides) > 1:
            self._document.note(
                f"/nodes/{index} rests while the shutter is open: on its way it becomes its mirror image"
            )
        if sides not in ({1.0}, {-1.0}):
            return []
        return [
            {"time": time, "matrix": (*world[:3], IDENTITY[3])} for time, world in zip(self.times, worlds, strict=False)
        ]

    def rigid_keys(self, index: int) -> list[dict[str, Any]]:
        """Keys of the motion of a node's light from its `start`; empty if it rests, or is always flat."""
        worlds = self.of(index)
        if not all(map(_side, worlds)):
            return []
        keys = [(time, np.array(world)) for time, world in zip(self.times, worlds, strict=False)]
        return light_motion(np.array(self.start(index)), keys) if keys else []


def _side(world: Matrix) -> float:
    """1, or -1 of what mirrors, or 0 of what flattens."""
    a, b, c = ((row[0], row[1], row[2]) for row in world[:3])
    normal = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
    volume = a[0] * normal[0] + a[1] * normal[1] + a[2] * normal[2]
    sizes = [math.sqrt(x * x + y * y + z * z) for x, y, z in (a, b, c)]
    return math.copysign(1.0, volume) if abs(volume) > 1e-12 * sizes[0] * sizes[1] * sizes[2] else 0.0
