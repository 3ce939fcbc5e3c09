"""The bounding box of a scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.assembly import assemble
from clrender.flatten.curves import flat_curves
from clrender.flatten.motion import swept_boxes
from clrender.flatten.polyhedra import polyhedron
from clrender.scene.description import Scene
from clrender.scene.posed import Deformation
from clrender.scene.shapes import AnyShape, Curves, Disk, Mesh, Sphere
from clrender.scene.transforms import affine
from clrender.wording import place as place_in_file

__all__ = ["is_seen", "scene_bounds"]


def is_seen(scene: Scene, shape: AnyShape) -> bool:
    """Whether a shape's material is not wholly transparent by a constant opacity."""
    if shape.material is None:
        return True
    material = scene.materials[shape.material]
    opacity = material.opacity
    return not isinstance(opacity, float) or (opacity > 0.0 and opacity >= (material.opacity_cutoff or 0.0))


def scene_bounds(scene: Scene, seen_only: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounding box of all shapes, world space, metres.

    Parameters
    ----------
    scene : Scene
    seen_only : bool
        Whether to leave out what `is_seen` says is transparent.

    Returns
    -------
    low, high : (3,) float64
        Infinite, with `low` above `high`, for an empty scene.
    """
    assembly = assemble(scene)
    scene = assembly.scene
    lows, highs = [np.full((1, 3), np.inf)], [np.full((1, 3), -np.inf)]
    for group, shapes in enumerate(assembly.groups):
        low, high = _bounds(scene, shapes, seen_only)
        if group in assembly.deformations and (low <= high).all():
            low, high = _all_forms(scene, shapes.start, assembly.deformations[group])
        if (low <= high).all():
            of_group = assembly.group_of == group
            maps, motion_of = assembly.maps[of_group], assembly.motion_of[of_group]
            middle, half = (low + high) / 2.0, (high - low) / 2.0
            center = (maps[:, :, :3] * middle).sum(axis=2) + maps[:, :, 3]
            extent = (np.abs(maps[:, :, :3]) * half).sum(axis=2)
            still = motion_of < 0
            lows.append((center - extent)[still])
            highs.append((center + extent)[still])
            for number in np.unique(motion_of[~still]).tolist():
                some = motion_of == number
                swept = swept_boxes(assembly.motions[number], (center - extent)[some], (center + extent)[some])
                lows.append(swept[0])
                highs.append(swept[1])
    low, high = _bounds(scene, range(assembly.own_shapes), seen_only)
    return np.concatenate([*lows, low[None]]).min(axis=0), np.concatenate([*highs, high[None]]).max(axis=0)


def _all_forms(scene: Scene, index: int, deformation: Deformation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounding box of all that a mesh passes while it changes its form."""
    lows, highs = [], []
    for mesh in deformation.meshes:
        points = np.empty((len(mesh.vertices), 3), np.float32)
        affine(scene.plain_shapes[index].transform).points_into(mesh.vertices, points)
        lows.append(points.min(axis=0).astype(np.float64))
        highs.append(points.max(axis=0).astype(np.float64))
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _bounds(scene: Scene, shapes: range, seen_only: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounding box of some shapes that are not instances."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for index in shapes:
        shape = scene.plain_shapes[index]
        if seen_only and not is_seen(scene, shape):
            continue
        place = affine(shape.transform)
        if isinstance(shape, Sphere | Disk):
            middle = np.array(place.point(shape.center))
            low, high = (
                np.minimum(low, middle - shape.radius * place.scale),
                np.maximum(high, middle + shape.radius * place.scale),
            )
            continue
        if isinstance(shape, Curves):
            at = scene.place_of(index)
            curves = flat_curves(shape, scene.strands(at, shape), place, f"{scene.source}: {place_in_file(at)}").shapes
            center, extent = (curves[name][:, :3].astype(np.float64) for name in ("center_radius", "normal"))
            low, high = np.minimum(low, (center - extent).min(0)), np.maximum(high, (center + extent).max(0))
            continue
        mesh = scene.mesh(index) if isinstance(shape, Mesh) else polyhedron(shape)
        used = mesh.vertices
        if isinstance(shape, Mesh):
            named = np.zeros(len(used), bool)
            named[mesh.triangles] = True
            used = used if named.all() else used[named]
        points = np.empty((len(used), 3), np.float32)
        place.points_into(used, points)
        if len(points):
            low, high = np.minimum(low, points.min(0)), np.maximum(high, points.max(0))
    return low, high
