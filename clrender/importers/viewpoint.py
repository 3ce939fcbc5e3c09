"""From which side a model without a camera is seen.

It is seen from the front, unless much more of it is seen from elsewhere: the front of a room may be a wall. How much
is seen from a place is counted among points of all surfaces, by a depth buffer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import length
from clrender.importers.surface_points import SurfacePoints
from clrender.scene.values import Vector, cross

__all__ = ["FRONT", "SIDES", "chosen_side", "visible"]

FRONT: Final = "from the front, a little from above"

SIDES: Final[dict[str, Vector]] = {
    FRONT: (0.45, 0.35, 1.0),
    "from the right, a little from above": (1.0, 0.35, -0.45),
    "from the left, a little from above": (-1.0, 0.35, 0.45),
    "from the back, a little from above": (-0.45, 0.35, -1.0),
    "straight from the front": (0.0, 0.1, 1.0),
    "straight from the right": (1.0, 0.1, 0.0),
    "straight from the left": (-1.0, 0.1, 0.0),
    "straight from the back": (0.0, 0.1, -1.0),
    "from the front, steeply from above": (0.45, 1.2, 1.0),
    "from above": (0.0, 1.0, 0.3),
}
"""Directions to the camera for an upward y axis and a front towards +z, and their names; the first are preferred."""
_LEAST: Final = 0.7
"""Share of all surfaces that has to be seen from another side: more than of a solid, of which about half is seen."""
_GAIN: Final = 1.4
"""By which factor this has to be more than from the front."""
_AS_GOOD: Final = 0.9
"""Share of the most that is seen from any side, from which on a preferred side is taken."""
_CELLS: Final = 56
"""Of the depth buffer, per side. Each has several points where a surface fills it."""
_STEEPEST: Final = 10.0
"""Largest slope of a surface, in depth over width, up to which its points in a cell count as at one depth."""


def visible(points: SurfacePoints, eye: Sequence[float], toward: Vector, up: Vector, slope: float) -> NDArray[np.bool_]:
    """Which points a camera sees that no other surface hides.

    Parameters
    ----------
    points : SurfacePoints
        Of all surfaces.
    eye : three floats
        The camera's position.
    toward, up : three floats
        Unit vector of the view, and a direction that is upward in the image.
    slope : float
        Tangent of half the angle of view.

    Returns
    -------
    (N,) bool
    """
    right = cross(toward, up)
    right = _scaled(right, 1.0 / length(right))
    upward = cross(right, toward)
    x, y, z = (points.positions - np.array(eye)).T
    depth, across, above = ((a[0] * x + a[1] * y) + a[2] * z for a in (toward, right, upward))
    with np.errstate(divide="ignore", invalid="ignore"):
        columns, rows = ((each / (depth * slope) + 1.0) * (0.5 * _CELLS) for each in (across, above))
        inside = (depth > 0.0) & (columns >= 0.0) & (columns < _CELLS) & (rows >= 0.0) & (rows < _CELLS)
    cells = np.where(inside, rows, 0.0).astype(np.intp) * _CELLS + np.where(inside, columns, 0.0).astype(np.intp)
    nearest = np.full(_CELLS * _CELLS, np.inf)
    np.minimum.at(nearest, cells[inside], depth[inside])
    nx, ny, nz = points.normals.T
    cosine = np.abs((x * nx + y * ny) + z * nz) / np.maximum(np.sqrt((x * x + y * y) + z * z), 1e-300)
    steepness = np.minimum(np.sqrt(1.0 - np.minimum(cosine * cosine, 1.0)), _STEEPEST * cosine) / np.maximum(
        cosine, 1e-9
    )
    seen: NDArray[np.bool_] = inside & (depth <= nearest[cells] * (1.0 + 2.0 * (1.0 + steepness) * slope / _CELLS))
    return seen


def chosen_side(points: SurfacePoints, middle: Sequence[float], distance: float, slope: float) -> str:
    """The name of the side from which a model is to be seen.

    Parameters
    ----------
    points : SurfacePoints
        Of all surfaces, in coordinates with y upward and the front towards +z.
    middle : three floats
        The centre of what is seen, in the same coordinates.
    distance : float
        Of the camera from there.
    slope : float
        Tangent of half the angle of view.
    """
    counts = {}
    for name, way in SIDES.items():
        outward = _scaled(way, 1.0 / length(way))
        eye = [m + distance * o for m, o in zip(middle, outward, strict=True)]
        counts[name] = int(visible(points, eye, _scaled(outward, -1.0), (0.0, 1.0, 0.0), slope).sum())
    most = max(counts.values())
    if most <= max(_LEAST * len(points.positions), _GAIN * counts[FRONT]):
        return FRONT
    return next(name for name, count in counts.items() if count >= _AS_GOOD * most)


def _scaled(v: Vector, by: float) -> Vector:
    return (by * v[0], by * v[1], by * v[2])
