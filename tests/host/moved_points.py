"""Where motions take points of shapes."""

from __future__ import annotations

import numpy as np

from clrender.scene import Scene
from clrender.scene.motion import Track
from clrender.scene.transforms import affine

__all__ = ["placed_at"]


def placed_at(scene: Scene, index: int, time: float, point: tuple[float, float, float]) -> list[float]:
    """Where a point of a shape is at a time."""
    shape = scene.shapes[index]
    track, first = Track(shape.motion), affine(shape.transform)
    path = track.at(np.array([time]))
    begun = np.array(first.linear) @ np.array(point) + np.array(first.offset)
    return [float(x) for x in track.sign * path.linear[0] @ begun + path.offsets[0]]
