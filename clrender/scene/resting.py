"""Scenes at one moment: what rests while the shutter is open, as if it had no motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from clrender.scene.groups import Instance, ShapeOrInstance
from clrender.scene.light_kinds import (
    MOVING_LIGHTS,
    DirectionalLight,
    IesLight,
    Light,
    PluginLight,
    PointLight,
    ProjectorLight,
)
from clrender.scene.motion import rests
from clrender.scene.posed import deforms, standing
from clrender.scene.poses import Transform
from clrender.scene.shapes import Mesh
from clrender.scene.transforms import affine, combined

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from clrender.scene.description import Scene
    from clrender.scene.light_kinds import MovingLight
    from clrender.scene.shapes import AnyShape
    from clrender.scene.transforms import Affine

__all__ = ["carried", "is_identity", "lit_from", "opened", "placements", "resting"]


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


def lit_from(light: MovingLight, outer: Affine) -> MovingLight:
    """A light that a rigid motion has moved, without keys of its own."""
    if is_identity(outer):
        return light.with_checked(motion=()) if light.motion else light
    moved: dict[str, Any] = {"motion": ()}
    if not isinstance(light, DirectionalLight):
        moved["position"] = outer.point(light.position)
    if not isinstance(light, PointLight):
        moved["direction"] = outer.vector(light.direction)
    if isinstance(light, ProjectorLight):
        moved["up"] = outer.vector(light.up)
    if isinstance(light, PluginLight):
        moved["up"] = outer.vector(light.upward)
    if isinstance(light, IesLight):
        moved["horizontal_zero"] = outer.vector(light.zero)
    return light.with_checked(**moved)


def _resting_light(light: Light, begin: float, end: float) -> Light:
    """A light; without its motion and where it is then, if it rests between two times."""
    if not isinstance(light, MOVING_LIGHTS) or not light.motion:
        return light
    still = rests(light.motion, begin, end)
    return light if still is None else lit_from(light, still)


def resting(scene: Scene) -> Scene:
    """The scene with what does not move while the shutter is open where it is then, without its motion.

    Instances keep theirs; `placements` has where they are. Meshes that change their form keep their poses, and have the
    form in which the shutter finds them.
    """
    if not scene.has_motion:
        return scene
    begin, end = scene.camera.interval
    lists: dict[str | None, Sequence[ShapeOrInstance]] = {None: scene.shapes}
    lists |= {name: group.shapes for name, group in scene.groups.items()}
    places = {None: scene.place_of} | {name: _place_in_group(name) for name in scene.groups}
    every = [((name, i), shape) for name, shapes in lists.items() for i, shape in enumerate(shapes)]
    forms: dict[tuple[str | None, int], Mesh] = {}
    posed = [(key, mesh) for key, mesh in every if isinstance(mesh, Mesh) and mesh.poses]
    if posed:
        stand, scene = standing(scene, [(places[name](i), mesh) for (name, i), mesh in posed])
        for (key, mesh), form in zip(posed, stand, strict=True):
            forms[key] = form.with_checked(poses=mesh.poses) if deforms(mesh, begin, end) else form
    made: dict[str | None, list[Any]] = {name: [] for name in lists}
    for key, shape in every:
        shape = forms.get(key, shape)
        still = rests(shape.motion, begin, end) if shape.motion and not isinstance(shape, Instance) else None
        made[key[0]].append(shape if still is None else carried(shape, still).with_checked(motion=()))  # type: ignore[arg-type]
    kept: dict[str, Any] = {"shapes": tuple(made.pop(None))}
    moved = {
        name: scene.groups[name].with_checked(shapes=tuple(now))
        for name, now in made.items()
        if name is not None and any(a is not b for a, b in zip(now, lists[name], strict=True))
    }
    if moved:
        kept["groups"] = {**scene.groups, **moved}
    lights = tuple(_resting_light(light, begin, end) for light in scene.lights)
    if any(a is not b for a, b in zip(lights, scene.lights, strict=True)):
        kept["lights"] = lights
    return scene.with_checked(**kept)


def _place_in_group(name: str) -> Callable[[int], tuple[str | int, ...]]:
    return lambda index: ("groups", name, "shapes", index)


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
