"""The box around a scene's shapes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clrender.scene.description import Scene
from clrender.scene.geometry import affine, polyhedron
from clrender.scene.shapes import Disk, Mesh, Sphere

__all__ = ["scene_bounds"]


def scene_bounds(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The box around all shapes, world space, metres.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    low, high : (3,) float64
        Infinite, and `low` above `high`, where there is nothing.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for index, shape in enumerate(scene.shapes):
        place = affine(shape.transform)
        if isinstance(shape, Sphere | Disk):
            middle = np.array(place.point(shape.center))
            low, high = (
                np.minimum(low, middle - shape.radius * place.scale),
                np.maximum(high, middle + shape.radius * place.scale),
            )
            continue
        mesh = scene.mesh(index) if isinstance(shape, Mesh) else polyhedron(shape)
        named = np.zeros(len(mesh.vertices), bool)
        named[mesh.triangles.reshape(-1)] = True
        used = mesh.vertices[named]
        points = np.empty((len(used), 3), np.float32)
        place.points_into(used, points)
        if len(points):
            low, high = np.minimum(low, points.min(0)), np.maximum(high, points.max(0))
    return low, high
