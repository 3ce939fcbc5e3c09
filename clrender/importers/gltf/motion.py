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
from clrender.importers.shared.motions import light_motion

__all__ = ["NodeMotion"]

_PARTS: Final = 16
"""Pieces of each time between two key frames: their ends are exact, and between them a pose is interpolated."""


class NodeMotion:
    """World transforms of all nodes at several times.

    Parameters
    ----------
    document : Document
        Validated.
    accessors : Accessors
    choices : Choices
        With a `shutter`; without one, nothing moves.

    Attributes
    ----------
    times : list of float
        Seconds, ascending; empty if nothing moves.
    """

    def __init__(self, document: Document, accessors: Accessors, choices: Choices) -> None:
        self.times: list[float] = []
        self._poses: list[Nodes] = []
        animations = document.items("animations")
        if choices.shutter is None or not animations:
            return
        begin, end = ((choices.time_at or 0.0) + each for each in choices.shutter)
        keys = {begin, end}
        for sampler in animations[0]["samplers"]:
            frames = accessors.raw(sampler["input"]).astype(np.float64).tolist()
            keys |= {time for time in frames if begin < time < end}
        stops = sorted(keys)
        for first, last in pairwise(stops):
            self.times += [first + (last - first) * part / _PARTS for part in range(_PARTS)]
        self.times.append(end)
        self._poses = [Nodes(document, values_at(document, accessors, time)) for time in self.times]

    def of(self, index: int) -> list[Matrix]:
        """World transforms of a node at `times`; empty if it rests."""
        worlds = [pose.world[index] for pose in self._poses]
        return worlds if any(world != worlds[0] for world in worlds[1:]) else []

    def weights(self, index: int, mesh: dict[str, Any]) -> list[list[float]]:
        """Weights of the morph targets of a node's mesh at `times`."""
        return [pose.weights(index, mesh) for pose in self._poses]

    def forms(self) -> list[tuple[float, int]]:
        """Times for poses of meshes, with their places in `times`: every second, as vertices go straight between."""
        return [(time, number) for number, time in enumerate(self.times) if number % 2 == 0]

    def worlds(self, number: int) -> list[Matrix]:
        """World transforms of all nodes at one of `times`."""
        return self._poses[number].world

    def keys(self, index: int) -> list[dict[str, Any]]:
        """Keys of a motion from the node's own space to world space; empty if it rests, or is flat at some time."""
        worlds = self.of(index)
        if any(not _is_solid(world) for world in worlds):
            return []
        return [
            {"time": time, "matrix": (*world[:3], IDENTITY[3])} for time, world in zip(self.times, worlds, strict=False)
        ]

    def rigid_keys(self, index: int, first: Matrix) -> list[dict[str, Any]]:
        """Keys of the motion of a node's light, which `first` has placed; empty as of `keys`."""
        worlds = self.of(index)
        if not all(map(_is_solid, (first, *worlds))):
            return []
        keys = [(time, np.array(world)) for time, world in zip(self.times, worlds, strict=False)]
        return light_motion(np.array(first), keys)


def _is_solid(world: Matrix) -> bool:
    a, b, c = ((row[0], row[1], row[2]) for row in world[:3])
    normal = (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
    volume = abs(a[0] * normal[0] + a[1] * normal[1] + a[2] * normal[2])
    sizes = [math.sqrt(x * x + y * y + z * z) for x, y, z in (a, b, c)]
    return volume > 1e-12 * sizes[0] * sizes[1] * sizes[2]
