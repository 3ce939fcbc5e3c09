"""Spheres, cubes, cylinders, cones, capsules and planes of a USD stage."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.elementary import sines_cosines
from clrender.importers.draft import Draft
from clrender.importers.shared.matrices import Matrix, is_similarity
from clrender.importers.shared.meshes import quads_mesh, sphere_mesh
from clrender.meshes.data import MeshData

__all__ = ["solid"]

_AROUND: Final = 128
_ALONG: Final = 32
_AXES: Final = {"X": ((0, 0, 1), (1, 0, 0), (0, 1, 0)), "Y": ((0, 1, 0), (0, 0, 1), (1, 0, 0))}
"""Rows of the rotation of +z to the axis; the identity for Z."""

_PLANES: Final = {
    "X": ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    "Y": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "Z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
}


def solid(draft: Draft, item: dict[str, Any], matrix: Matrix) -> tuple[dict[str, Any], Matrix] | None:
    """The shape of a solid, without its material, and the matrix from its space, which may be turned.

    Parameters
    ----------
    draft : Draft
        Receives the meshes.
    item : dict
        See `clrender.importers.usd.extraction`.
    matrix : (4, 4) float64
        From the solid's space to world space.

    Returns
    -------
    described, matrix
        None if it has no extent.
    """
    kind = item["type"].removesuffix("_1")
    turned = _turned(matrix, item.get("axis") or "Z")
    radius, height = float(item.get("radius") or 0.0), float(item.get("height") or 0.0)
    if kind == "Cube":
        size = float(item.get("size") or 0.0)
        return ({"type": "box", "size": [size] * 3}, matrix) if size > 0.0 else None
    if kind == "Plane":
        w, h = float(item.get("width") or 0.0), float(item.get("length") or 0.0)
        if not (w > 0.0 and h > 0.0):
            return None
        # Width and length, whose product of directions is the axis
        across, along = _PLANES[item.get("axis") or "Z"]
        edges = {"edge_u": [w * x for x in across], "edge_v": [h * x for x in along]}
        origin = [-(a + b) / 2.0 for a, b in zip(edges["edge_u"], edges["edge_v"], strict=True)]
        return {"type": "quad", "origin": origin, **edges}, matrix
    if kind == "Sphere" and radius > 0.0:
        if is_similarity(matrix):
            return {"type": "sphere", "radius": radius}, matrix
        draft.note("a sphere that a transform makes an ellipsoid is approximated by 16384 triangles")
        return _mesh(draft, f"sphere of radius {radius!r}", lambda: sphere_mesh(radius)), matrix
    if kind == "Sphere":
        return None
    bottom, top = (float(item.get(name, radius) or 0.0) for name in ("radiusBottom", "radiusTop"))
    top = 0.0 if kind == "Cone" else top
    if min(bottom, top, height) < 0.0 or max(bottom, top) == 0.0 or (height == 0.0 and kind != "Capsule"):
        return None
    name = f"{kind.lower()} of radius {bottom!r} and {top!r}, {height!r} long"
    return _mesh(draft, name, lambda: _turned_profile(kind, bottom, top, height)), turned


def _mesh(draft: Draft, name: str, make: Callable[[], MeshData]) -> dict[str, Any]:
    if name not in draft.meshes:
        draft.meshes[name] = make()
    return {"type": "mesh", "file": name}


def _turned(matrix: Matrix, axis: str) -> Matrix:
    """The matrix after a rotation of +z to an axis, by exchange of columns."""
    if axis not in _AXES:
        return matrix
    made = matrix.copy()
    for column, row in enumerate(np.array(_AXES[axis]).T):
        made[:, column] = matrix[:, int(np.argmax(row))]
    return made


def _turned_profile(kind: str, bottom: float, top: float, height: float) -> MeshData:
    """A closed surface about +z: lines of its profile turned, each with its own normals."""
    low, high = -height / 2.0, height / 2.0
    if kind == "Capsule":
        lines = [_arc(bottom, low, -1.0), *_wall(bottom, top, low, high), _arc(top, high, 1.0)]
    else:
        lines = [_lid(bottom, low, -1.0), *_wall(bottom, top, low, high)]
        lines += [_lid(top, high, 1.0)] if top > 0.0 else []
    turns = np.arange(_AROUND + 1) / _AROUND
    sines, cosines = sines_cosines(2.0 * np.pi * turns)
    sines[-1], cosines[-1] = sines[0], cosines[0]
    vertices: list[NDArray[np.float64]] = []
    normals: list[NDArray[np.float64]] = []
    uvs: list[NDArray[np.float64]] = []
    quads: list[NDArray[np.int64]] = []
    start = 0
    for line in lines:
        steps = len(line)
        r, z, across, along = (line[:, None, column] for column in range(4))
        ones = np.ones(_AROUND + 1)
        vertices.append(np.stack([r * cosines, r * sines, z * ones], axis=2).reshape(-1, 3))
        normals.append(np.stack([across * cosines, across * sines, along * ones], axis=2).reshape(-1, 3))
        v = (z - low) / (high - low) if high > low else 0.0 * z
        uvs.append(np.stack([turns * np.ones((steps, 1)), v * ones], axis=2).reshape(-1, 2))
        row, column = np.meshgrid(np.arange(steps - 1), np.arange(_AROUND), indexing="ij")
        first = (start + row * (_AROUND + 1) + column).ravel()
        quads.append(np.stack([first, first + 1, first + _AROUND + 2, first + _AROUND + 1], axis=1))
        start += steps * (_AROUND + 1)
    made = quads_mesh(np.concatenate(vertices), np.concatenate(quads), np.concatenate(uvs), np.concatenate(normals))
    # At the axis a quad is a triangle
    a, b, c = (made.vertices[made.triangles[:, corner]] for corner in range(3))
    kept = ~((a == b).all(axis=1) | (b == c).all(axis=1) | (c == a).all(axis=1))
    assert made.uvs is not None
    return dataclasses.replace(made, triangles=made.triangles[kept], uvs=made.uvs[kept])


def _lid(radius: float, z: float, side: float) -> NDArray[np.float64]:
    ends = [(0.0, z, 0.0, side), (radius, z, 0.0, side)]
    return np.array(ends if side < 0.0 else ends[::-1])


def _wall(bottom: float, top: float, low: float, high: float) -> list[NDArray[np.float64]]:
    if high == low:
        return []
    slope = bottom - top
    size = float(np.sqrt(slope * slope + (high - low) * (high - low)))
    across, along = (high - low) / size, slope / size
    return [np.array([(bottom, low, across, along), (top, high, across, along)])]


def _arc(radius: float, z: float, side: float) -> NDArray[np.float64]:
    """A quarter of a circle, from below upwards."""
    sines, cosines = sines_cosines(np.arange(_ALONG + 1) / _ALONG * (np.pi / 2.0))
    cosines[-1] = 0.0
    rows = np.stack([radius * cosines, z + side * radius * sines, cosines, side * sines], axis=1)
    return rows if side > 0.0 else rows[::-1]
