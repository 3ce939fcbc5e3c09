"""Curves as triangles: tubes, and ribbons."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.curves import CurveData
from clrender.errors import SceneError
from clrender.exact.elementary import sines_cosines
from clrender.flatten.curves import bezier_segments, strand_radii, strands_place
from clrender.meshes.data import MeshData
from clrender.scene.shapes import Curves
from clrender.wording import counted

__all__ = ["AROUND", "STEPS", "curve_mesh"]

_Floats = NDArray[np.float64]
STEPS: Final = 6
"""Rings of vertices of a segment of a strand."""
AROUND: Final = 12
"""Vertices of a ring."""


def curve_mesh(
    shape: Curves, data: CurveData, place: str = "curves", steps: int = STEPS, around: int = AROUND
) -> MeshData:
    """Tubes around curves, or ribbons along them, before the shape's transform, with normals and texture coordinates.

    The ends of tubes are flat. Across a ribbon, v goes from 0 to 1.

    Parameters
    ----------
    shape : Curves
    data : CurveData
        Its strands.
    place : str
        Beginning of error messages.
    steps, around : int
        Rings of a segment of a strand, and vertices of a ring.

    Raises
    ------
    SceneError
        See `clrender.flatten.curves.bezier_segments`; or there are not as many normals as control points.
    """
    if shape.profile == "ribbon":
        return _ribbons(shape, data, place, steps)
    rows = np.column_stack([data.points, strand_radii(shape, data, place)])
    controls, strand = bezier_segments(rows, data.counts, shape.basis, strands_place(shape, place))
    middle, tangent, along, first = _rings(controls, strand, steps)
    across = _frames(tangent, first)
    up = np.cross(tangent, across)
    sines, cosines = sines_cosines(2.0 * math.pi * np.arange(around) / around)
    normals = across[:, None] * cosines[:, None] + up[:, None] * sines[:, None]
    points = middle[:, None, :3] + middle[:, None, 3:] * normals
    rings = len(middle)
    goes_on = np.ones(rings, bool)
    goes_on[first[1:] - 1] = goes_on[-1] = False
    lower = np.flatnonzero(goes_on)[:, None] * around + np.arange(around)
    next_lower = np.flatnonzero(goes_on)[:, None] * around + (np.arange(around) + 1) % around
    sides = np.stack(
        [lower, next_lower, next_lower + around, lower, next_lower + around, lower + around], axis=2
    ).reshape(-1, 3)
    # Fans over the first vertex of the ring close both ends
    fan = np.stack([np.zeros(around - 2, int), np.arange(2, around), np.arange(1, around - 1)], axis=1)
    last = np.concatenate([first[1:], [rings]]) - 1
    ends = np.concatenate([first[:, None, None] * around + fan, last[:, None, None] * around + fan[:, ::-1]])
    triangles = np.concatenate([sides, ends.reshape(-1, 3)]).astype(np.uint32)
    uvs = np.stack([np.repeat(along, around), np.full(rings * around, 0.5)], axis=1).astype(np.float32)
    flat = normals.reshape(-1, 3).astype(np.float32)
    return MeshData(points.reshape(-1, 3), triangles, flat, uvs=uvs[triangles])


def _ribbons(shape: Curves, data: CurveData, place: str, steps: int) -> MeshData:
    """Flat strips; the side that their normals show is the front."""
    columns = [data.points, strand_radii(shape, data, place)]
    normals = np.array(shape.normals) if shape.normals else data.normals
    if normals is not None:
        if len(normals) not in (1, len(data.points)):
            text = (
                f"has {counted(len(normals), 'entry', 'entries')}; give one, or {len(data.points)} for the "
                "control points of the file"
            )
            raise SceneError(f"{place}.normals {text}")
        columns.append(np.broadcast_to(normals, data.points.shape))
    controls, strand = bezier_segments(np.column_stack(columns), data.counts, shape.basis, strands_place(shape, place))
    middle, tangent, along, first = _rings(controls, strand, steps)
    across = _frames(tangent, first)
    if normals is not None:
        wanted = np.cross(middle[:, 4:], tangent)
        size = np.sqrt((wanted * wanted).sum(axis=1))[:, None]
        across = np.where(size > 1e-9, wanted / np.maximum(size, 1e-9), across)
    half = middle[:, 3:4] * across
    points = np.stack([middle[:, :3] - half, middle[:, :3] + half], axis=1).reshape(-1, 3)
    last = np.concatenate([first[1:], [len(middle)]]) - 1
    at = 2 * np.setdiff1d(np.arange(len(middle)), last)[:, None]
    triangles = np.concatenate([at + np.array([0, 3, 1]), at + np.array([0, 2, 3])]).astype(np.uint32)
    uvs = np.stack([np.repeat(along, 2), np.tile([0.0, 1.0], len(middle))], axis=1).astype(np.float32)
    flat = np.repeat(np.cross(tangent, across), 2, axis=0).astype(np.float32)
    return MeshData(points, triangles, flat, uvs=uvs[triangles])


def _rings(
    controls: _Floats, strand: NDArray[np.int64], steps: int
) -> tuple[_Floats, _Floats, _Floats, NDArray[np.int64]]:
    """Middles and radii (R, 4), unit tangents (R, 3) and shares of the strand (R,) of rings, and the first of each."""
    each = np.bincount(strand)
    counts = each * steps + 1
    first = np.cumsum(counts) - counts
    of = np.repeat(np.arange(len(each)), counts)
    within = np.arange(len(of)) - first[of]
    segment = np.minimum(within // steps, each[of] - 1) + (np.cumsum(each) - each)[of]
    u = ((within - np.minimum(within // steps, each[of] - 1) * steps) / steps)[:, None]
    a, b, c, d = (controls[segment, k] for k in range(4))
    v = 1.0 - u
    places = v * v * v * a + 3.0 * v * v * u * b + 3.0 * v * u * u * c + u * u * u * d
    slopes = (v * v * (b - a) + 2.0 * v * u * (c - b) + u * u * (d - c))[:, :3]
    size = np.sqrt((slopes * slopes).sum(axis=1))
    chord = (d - a)[:, :3]
    slopes = np.where((size > 0.0)[:, None], slopes, chord)
    size = np.sqrt((slopes * slopes).sum(axis=1))
    tangent = np.where((size > 0.0)[:, None], slopes / np.maximum(size, 1e-300)[:, None], (0.0, 0.0, 1.0))
    return places, tangent, within / (counts[of] - 1), first


def _frames(tangent: _Floats, first: NDArray[np.int64]) -> _Floats:
    """Directions across tangents, which turn no more than these do from ring to ring."""
    across = np.zeros_like(tangent)
    t = tangent[first]
    aside = np.eye(3)[np.abs(t).argmin(axis=1)]
    across[first] = np.cross(t, aside)
    lengths = np.diff(np.concatenate([first, [len(tangent)]]))
    for step in range(int(lengths.max())):
        at = first[lengths > step] + step
        before = across[at - 1] if step else across[at]
        flat = before - (before * tangent[at]).sum(axis=1)[:, None] * tangent[at]
        size = np.sqrt((flat * flat).sum(axis=1))[:, None]
        again = np.cross(tangent[at], np.eye(3)[np.abs(tangent[at]).argmin(axis=1)])
        flat = np.where(size > 1e-9, flat, again)
        across[at] = flat / np.sqrt((flat * flat).sum(axis=1))[:, None]
    return across
