"""Rows of meshes that change their form, as kernels read them (kernels/geometry/pose.h)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.flatten.surfaces import placed_normals, turned_away, with_area
from clrender.scene.transforms import affine

if TYPE_CHECKING:
    from clrender.flatten.surface_arrays import FlatSurfaces
    from clrender.scene.description import Scene
    from clrender.scene.posed import Deformation

__all__ = ["FlatPoses", "flat_poses"]

_MOTION: Final = layout.columns("MOTION")
_ROUNDING: Final = 2.0**-24


@dataclass(frozen=True)
class FlatPoses:
    """A mesh that changes its form, in the space of its group.

    Attributes
    ----------
    rows : (n, 16) float32
        Of each knot in time those of all triangles, with their corners, and then likewise their normals if it has any.
    knots : int
    boxes : (T, 6) float32
        Of each triangle, lowest and highest coordinates of all that it passes.
    """

    rows: NDArray[np.float32]
    knots: int
    boxes: NDArray[np.float32]


def flat_poses(scene: Scene, surfaces: FlatSurfaces, index: int, deformation: Deformation) -> FlatPoses:
    """Rows of a shape that changes its form.

    Parameters
    ----------
    scene : Scene
        Whose `shapes[index]` it is, as it is when the shutter opens.
    surfaces : FlatSurfaces
        Of that scene.
    index : int
    deformation : Deformation
    """
    shape, first, count = scene.plain_shapes[index], int(surfaces.first[index]), int(surfaces.count[index])
    transform, begin = affine(shape.transform), int(surfaces.first_vertex[index])
    triangles = surfaces.triangles[first : first + count].astype(np.int64) - begin
    vertices, normals = [], []
    for mesh in deformation.meshes:
        points = np.empty((len(mesh.vertices), 3), np.float32)
        transform.points_into(mesh.vertices, points)
        vertices.append(points)
        if mesh.normals is not None:
            some = np.empty((len(mesh.vertices), 3), np.float32)
            placed_normals(mesh.normals, transform, points, triangles.astype(np.uint32), some, flip=shape.flip_normals)
            normals.append(some)
    corners = np.stack([points[triangles].reshape(count, 9) for points in vertices])
    blocks = [corners]
    if normals:
        turned = _turned(vertices, triangles.astype(np.uint32), normals)
        signs = np.where(turned, np.float32(-1.0), np.float32(1.0))[:, None]
        blocks.append(np.stack([some[triangles].reshape(count, 9) * signs for some in normals]))
    rows = np.zeros((len(blocks), len(vertices), count, 16), np.float32)
    rows[..., :9] = np.stack(blocks)
    rows[..., _MOTION["TIME"]] = deformation.shares[:, None]
    rows[:, :-1, :, _MOTION["INVERSE_SPAN"]] = (1.0 / np.diff(deformation.shares))[:, None]
    passed = corners.reshape(len(vertices), count, 3, 3).astype(np.float64)
    low, high = passed.min(axis=(0, 2)), passed.max(axis=(0, 2))
    # As boxes of what rests are enlarged (kernels/geometry/build.h), and by the rounding of what is between two poses
    room = 16.0 * _ROUNDING * (high - low).max(axis=1, keepdims=True)
    low, high = (edge + sign * (room + 8.0 * _ROUNDING * np.abs(edge)) for edge, sign in ((low, -1.0), (high, 1.0)))
    boxes = np.concatenate([low, high], axis=1).astype(np.float32)
    return FlatPoses(rows.reshape(-1, 16), len(vertices), boxes)


def _turned(
    vertices: list[NDArray[np.float32]], triangles: NDArray[np.uint32], normals: list[NDArray[np.float32]]
) -> NDArray[np.bool_]:
    """Which triangles have normals that point to their back, at the first time at which each has an area."""
    turned, open_ = np.zeros(len(triangles), bool), np.arange(len(triangles))
    for points, some in zip(vertices, normals, strict=True):
        turned[open_] = turned_away(points, triangles[open_], some)
        open_ = open_[~with_area(points, triangles[open_])]
        if not len(open_):
            break
    return turned
