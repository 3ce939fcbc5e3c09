"""Moves primitives of flat surfaces along their normals, and doubles those that move both ways."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.attributes import COLORS, TANGENTS
from clrender.flatten.faces import normals

if TYPE_CHECKING:
    from clrender.flatten.surface_arrays import FlatSurfaces
    from clrender.flatten.touching import Moves

__all__ = ["moved"]


def moved(surfaces: FlatSurfaces, moves: Moves) -> FlatSurfaces:
    """The surfaces with each primitive where `moves` has it; copies come next to each other."""
    if not moves.any:
        return surfaces
    count = len(surfaces.triangles)
    times = 1 + (moves.first[:count] != moves.second[:count])
    starts = np.concatenate([[0], np.cumsum(times)])
    of = np.repeat(np.arange(count), times)
    by = moves.first[of]
    by[starts[:-1][times == 2] + 1] = moves.second[:count][times == 2]
    vertices, vertex_normals, triangles = _corners(surfaces, of, by)
    more = len(of) - count
    first = np.where(surfaces.first < count, starts[np.minimum(surfaces.first, count)], surfaces.first + more)
    shape = surfaces.primitive_shape
    primitive_shape = np.concatenate([shape[:count][of], shape[count:]])
    shapes = surfaces.shapes.copy()
    shapes["first_primitive"] = first
    return dataclasses.replace(
        surfaces,
        vertices=vertices,
        normals=vertex_normals,
        triangles=triangles,
        analytic_shapes=_round(surfaces, moves.first[count:], moves.second[count:]),
        primitive_shape=primitive_shape,
        shapes=shapes,
        first=first,
        count=np.bincount(primitive_shape, minlength=len(shapes)).astype(np.int64),
        attributes=_attributes(surfaces.attributes, of, count, len(shape)),
    )


def _corners(
    surfaces: FlatSurfaces, of: NDArray[np.int64], by: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices, their normals, and the triangles `of` moved `by`; neighbours in one plane still share vertices."""
    triangles = surfaces.triangles[of]
    some = np.flatnonzero(by)
    old = triangles[some]
    corners = surfaces.vertices[old].astype(np.float64)
    places = (corners + (normals(corners) * by[some, None])[:, None]).astype("<f4")
    keys = np.concatenate([old.reshape(-1, 1), places.reshape(-1, 3).view(np.uint32)], axis=1)
    unique, inverse = np.unique(keys, axis=0, return_inverse=True)
    triangles[some] = (len(surfaces.vertices) + inverse.reshape(-1, 3)).astype(np.uint32)
    added = np.ascontiguousarray(unique[:, 1:]).view("<f4")
    vertex_normals = surfaces.normals
    if len(vertex_normals) == len(surfaces.vertices):
        vertex_normals = np.concatenate([vertex_normals, vertex_normals[unique[:, 0]]])
    return np.concatenate([surfaces.vertices, added]), vertex_normals, triangles


def _round(surfaces: FlatSurfaces, first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.void]:
    """Spheres that grow, and disks that move: once, by the smaller of two moves."""
    rows = surfaces.analytic_shapes.copy()
    by = np.where(np.abs(first) <= np.abs(second), first, second)
    rows["center_radius"][:, :3] += (by[:, None] * rows["normal"][:, :3]).astype(np.float32)
    rows["center_radius"][:, 3] += (by * rows["normal"][:, 3]).astype(np.float32)
    return rows


def _attributes(rows: NDArray[np.float32], of: NDArray[np.int64], count: int, primitives: int) -> NDArray[np.float32]:
    """Attribute rows of the triangles `of`, of the other primitives, and rows that those refer to by number."""
    if not len(rows):
        return rows
    words = rows[:count][of].view(np.uint32)
    for column in (COLORS, TANGENTS):
        words[:, column] += np.where(words[:, column] >= primitives, len(of) - count, 0).astype(np.uint32)
    return np.concatenate([words.view(np.float32), rows[count:]])
