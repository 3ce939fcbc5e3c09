"""What other programs ask of camera and settings."""

from __future__ import annotations

from typing import Final

import numpy as np

from clrender.errors import SceneError
from clrender.exact.matrices import length
from clrender.exporters.target import Target
from clrender.flatten.bounds import scene_bounds
from clrender.flatten.emission import emits
from clrender.scene import EnvironmentLight, Scene, SunSkyLight

__all__ = ["check_camera", "clip_distances", "hides_lights", "path_depth"]

_NEAR, _FAR = 1e-2, 1e4
"""Metres at which cameras of other programs clip unless told otherwise."""
_PATHS: Final = ("path", "reuse")


def check_camera(target: Target, program: str) -> None:
    """Refuse cameras that a program has not, and note what its others lack.

    Raises
    ------
    SceneError
        It is neither a perspective nor an orthographic camera.
    """
    camera = target.scene.camera
    if camera.type not in ("perspective", "orthographic"):
        text = f"is of type {camera.type}, which {program} has not; make it perspective or orthographic"
        raise SceneError(f"{target.scene.source}: camera {text}")
    if camera.aperture_radius and camera.type == "orthographic":
        target.leave_out("the lens of an orthographic camera", "camera", "aperture_radius")
    elif camera.aperture_radius and camera.blades:
        target.leave_out("the blades of the aperture, which is round", "camera", "blades")
    if camera.exposure is not None:
        target.leave_out("the exposure of display images", "camera", next(iter(camera.exposure)))


def clip_distances(scene: Scene) -> tuple[float, float] | None:
    """Distances of clipping planes that clip nothing, metres; None for an empty scene."""
    low, high = scene_bounds(scene)
    if not (low <= high).all():
        return None
    reach = length(high - low) + length(np.maximum(np.abs(low - scene.camera.position), high - low))
    return min(_NEAR, 1e-4 * reach), max(_FAR, 2.0 * reach)


def path_depth(target: Target) -> int | None:
    """Most scattering events of a path; None without a limit."""
    render = target.scene.render
    depth: int | None = render.max_depth
    if render.integrator == "direct" or render.indirect_rays == 0:
        return 1 if depth is None else min(depth, 1)
    if render.integrator not in _PATHS:
        target.leave_out(f"the integrator {render.integrator}, for which there is path", "render", "integrator")
    return depth


def hides_lights(target: Target, can: bool) -> bool:
    """Whether the camera sees no light, where a program hides all of them or none. What else is hidden is named.

    Parameters
    ----------
    target : Target
    can : bool
        Whether the program can hide them.
    """
    scene = target.scene
    parts = [(at, emits(scene, shape), shape.visible_to_camera) for at, shape in scene.all_shapes()]
    for i, light in enumerate(scene.lights):
        if isinstance(light, EnvironmentLight | SunSkyLight):
            parts.append((("lights", i), True, light.visible_to_camera))
    hides = can and {visible for _, shines, visible in parts if shines} == {False}
    for at, shines, visible in parts:
        if not visible and not (shines and hides):
            target.leave_out("that the camera does not see it", *at, "visible_to_camera")
    return hides
