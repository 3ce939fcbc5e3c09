"""The space that the shapes of a flattened scene take up, where the device has it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.instances import box_of

if TYPE_CHECKING:
    from clrender.flatten.flat_scene import FlatScene

__all__ = ["around_box", "scene_box"]


def scene_box(flat: FlatScene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounding box of all that rays can hit: minimum and maximum, (3,) float64 each; a unit cube if empty."""
    if not flat.triangle_count + flat.analytic_count:
        return np.zeros(3), np.ones(3)
    of = flat.instances
    vertices = flat.arrays["vertices"][: of.own_vertices if flat.triangle_count else 0]
    return box_of(vertices, flat.arrays["analytic_shapes"]["center_radius"][: of.own_analytic], of.boxes)


def around_box(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
    """A sphere around a box.

    Parameters
    ----------
    low, high : (3,) float64

    Returns
    -------
    sphere : (4,) float32
        Centre and radius; a little larger than the box.
    radius : float
        Half of the box's diagonal, at least 1e-12.
    """
    x, y, z = (high - low).tolist()
    radius = max(math.sqrt(x * x + y * y + z * z) / 2.0, 1e-12)
    return np.array([*((low + high) / 2.0), radius * 1.001], np.float32), radius
