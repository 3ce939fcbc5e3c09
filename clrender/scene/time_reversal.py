"""Scenes whose time runs backward: for what leads from the time of an image to an earlier one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from clrender.scene.light_kinds import MOVING_LIGHTS
from clrender.scene.shapes import Mesh

if TYPE_CHECKING:
    from clrender.scene.description import Scene

__all__ = ["reversed_about"]


def reversed_about(scene: Scene, time: float) -> Scene:
    """The scene that is at `time` + t as this one is at `time` - t.

    Parameters
    ----------
    scene : Scene
    time : float
        Seconds.
    """

    def turned(shapes: Sequence[Any]) -> tuple[Any, ...]:
        made = []
        for shape in shapes:
            changed: dict[str, Any] = {"motion": _reversed(shape.motion, time)} if shape.motion else {}
            if isinstance(shape, Mesh) and shape.poses:
                changed["poses"] = _reversed(shape.poses, time)
            made.append(shape.with_checked(**changed) if changed else shape)
        return tuple(made)

    groups = {name: group.with_checked(shapes=turned(group.shapes)) for name, group in scene.groups.items()}
    lights = [
        light.with_checked(motion=_reversed(light.motion, time))
        if isinstance(light, MOVING_LIGHTS) and light.motion
        else light
        for light in scene.lights
    ]
    camera = scene.camera
    if camera.motion:
        camera = camera.with_checked(motion=_reversed(camera.motion, time))
    return scene.with_checked(shapes=turned(scene.shapes), groups=groups, lights=tuple(lights), camera=camera)


def _reversed(keys: Sequence[Any], time: float) -> tuple[Any, ...]:
    return tuple(key.with_checked(time=2.0 * time - key.time) for key in reversed(keys))
