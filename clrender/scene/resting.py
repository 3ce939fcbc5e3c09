"""Scenes at one moment: what rests while the shutter is open, as if it had no motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from clrender.scene.groups import Instance, ShapeOrInstance
from clrender.scene.motion import rests
from clrender.scene.posed import deforms, standing
from clrender.scene.poses import Transform
from clrender.scene.shapes import Mesh
from clrender.scene.transforms import affine, combined

if TYPE_CHECKING:
    import numpy.typing as npt

    from clrender.scene.description import Scene
    from clrender.scene.shapes import AnyShape
    from clrender.scene.transforms import Affine

__all__ = ["carried", "is_identity", "opened", "placements", "resting"]


def is_identity(map_: Affine) -> bool:
    """Whether a map leaves all points where they are."""
    return map_.linear == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)) and map_.offset == (0.0, 0.0, 0.0)


def carried(shape: AnyShape, outer: Affine) -> AnyShape:
    """A shape whose transform is followed by another map."""
    if is_identity(outer):
        return shape
    inner = combined(outer, affine(shape.transform))
    rows = tuple((*row, offset) for row, offset in zip(inner.linear, inner.offset, strict=True))
    return shape.with_checked(transform=Transform(matrix=(*rows, (0.0, 0.0, 0.0, 1.0))))


def resting(scene: Scene) -> Scene:
    """The scene with shapes that do not move while the shutter is open where they are then, without their motions.

    Instances keep theirs; `placements` has where they are. Meshes that change their form keep their poses, and have the
    form in which the shutter finds them.
    """
    if not scene.has_motion:
        return scene
    begin, end = scene.camera.interval
    posed = {
        index: (scene.place_of(index), mesh)
        for index, mesh in enumerate(scene.shapes)
        if isinstance(mesh, Mesh) and mesh.poses
    }
    if posed:
        stand, other = standing(scene, list(posed.values()))
        forms = dict(zip(posed, stand, strict=True))
        for index, (_, mesh) in posed.items():
            if deforms(mesh, begin, end):
                forms[index] = forms[index].with_checked(poses=mesh.poses)
        scene = other.with_checked(shapes=tuple(forms.get(i, each) for i, each in enumerate(scene.shapes)))
    shapes: list[ShapeOrInstance] = []
    for shape in scene.shapes:
        still = rests(shape.motion, begin, end) if shape.motion and not isinstance(shape, Instance) else None
        shapes.append(shape if still is None else carried(shape, still).with_checked(motion=()))  # type: ignore[arg-type]
    return scene.with_checked(shapes=tuple(shapes))


def placements(scene: Scene, index: int) -> npt.NDArray[np.float64]:
    """Maps of the instance `shapes[index]`; of one that moves while the shutter is open, those before its motion.

    Parameters
    ----------
    scene : Scene
    index : int
        Index of an instance in its shapes.

    Returns
    -------
    (N, 3, 4) float64
        From group space to world space, metres.

    Raises
    ------
    SceneError
        A file of transforms cannot be read.
    """
    maps, keys = scene.transforms(index).maps, scene.shapes[index].motion
    still = rests(keys, *scene.camera.interval) if keys else None
    if still is None or is_identity(still):
        return maps
    rows = [
        [sum_of(row, maps[:, :, column]) + (offset if column == 3 else 0.0) for column in range(4)]
        for row, offset in zip(still.linear, still.offset, strict=True)
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def sum_of(row: tuple[float, float, float], vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(N,) products of a row with (N, 3) columns."""
    return np.asarray((row[0] * vectors[:, 0] + row[1] * vectors[:, 1]) + row[2] * vectors[:, 2])


def opened(scene: Scene) -> Scene:
    """The scene at the moment when the shutter opens: nothing in it moves, and its camera rests."""
    camera = scene.camera.opened
    if camera.interval[0] != camera.interval[1]:
        camera = camera.with_checked(time=camera.interval[0], shutter=None, rolling_shutter=0.0)
    if camera is scene.camera and not scene.has_motion:
        return scene
    return resting(scene.with_checked(camera=camera))
