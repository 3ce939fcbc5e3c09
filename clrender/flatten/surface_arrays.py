"""What the shapes of a scene become: the arrays that `clrender.flatten.surfaces` fills."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.scene.values import Vector

__all__ = ["FlatSurfaces"]

_Rows: TypeAlias = NDArray[np.void]


@dataclass(frozen=True)
class FlatSurfaces:
    """Arrays as in `clrender.flatten.flat_scene.FlatScene`, but possibly empty.

    Attributes
    ----------
    first, count : (S,) int64
        First primitive and number of primitives of each shape.
    origin : (3,) float
        World space, metres; all coordinates are relative to it.
    camera_free : float
        See `clrender.flatten.touching.Moves`.
    curve_rows : (R, 16) float32
        Of the curves among `analytic_shapes`; one row of zeros if there are none.
    attributes : (T + R, 16) float32
        Attributes of textured primitives, such as texture coordinates (`clrender.flatten.attributes`); no rows if there
        are none.
    first_vertex : (S,) int64
        First vertex of each shape that is made of triangles.
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    analytic_shapes: _Rows
    curve_rows: NDArray[np.float32]
    primitive_shape: NDArray[np.uint32]
    shapes: _Rows
    first: NDArray[np.int64]
    count: NDArray[np.int64]
    warnings: tuple[str, ...]
    origin: Vector
    attributes: NDArray[np.float32]
    first_vertex: NDArray[np.int64]
    camera_free: float = math.inf
