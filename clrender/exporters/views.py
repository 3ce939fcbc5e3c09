"""What other programs ask of camera and settings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from clrender.cameras.projection import Rectilinear
from clrender.errors import SceneError
from clrender.exact.angles import angle_of
from clrender.exact.matrices import length
from clrender.exporters.target import Target
from clrender.flatten.bounds import scene_bounds
from clrender.flatten.emission import emits
from clrender.scene import EnvironmentLight, Scene, SunSkyLight

__all__ = ["FlatView", "check_camera", "clip_distances", "flat_view", "hides_lights", "path_depth"]

_NEAR, _FAR = 1e-2, 1e4
"""Metres at which cameras of other programs clip unless told otherwise."""
_PATHS: Final = ("path", "reuse")
_SQUARE: Final = 1e-6
"""Relative difference of the sides of a pixel that counts as square."""


def check_camera(target: Target, program: str) -> None:
    """Refuse cameras that a program has not, and note what its others lack.

    Raises
    ------
    SceneError
        It is a panoramic camera or a fisheye.
    """
    camera = target.scene.camera
    if camera.type not in ("perspective", "orthographic", "intrinsics"):
        text = f"is of type {camera.type}, which {program} has not; make it perspective or orthographic"
        raise SceneError(f"{target.scene.source}: camera {text}")
    if camera.distortion is not None:
        target.leave_out("the distortion of the lens", "camera", "distortion")
    if camera.skew:
        target.leave_out("the skew of the camera matrix", "camera", "skew")
    if camera.aperture_radius and camera.type == "orthographic":
        target.leave_out("the lens of an orthographic camera", "camera", "aperture_radius")
    elif camera.aperture_radius and camera.blades:
        target.leave_out("the blades of the aperture, which is round", "camera", "blades")
    if camera.exposure is not None:
        target.leave_out("the exposure of display images", "camera", next(iter(camera.exposure)))
    if camera.response is not None:
        target.leave_out("the colours of the sensor, which are those of the standard observer", "camera", "response")


@dataclass(frozen=True)
class FlatView:
    """What a camera without distortion shows, where pixels are square.

    Attributes
    ----------
    vertical_fov : float
        Degrees, of a view that is not shifted; of orthographic cameras it means nothing.
    shift : (float, float)
        Of the view to its right, in widths, and up, in heights.
    """

    vertical_fov: float
    shift: tuple[float, float]


def flat_view(target: Target) -> FlatView:
    """The view of a perspective, orthographic or calibrated camera.

    Parameters
    ----------
    target : Target
    """
    camera, image = target.scene.camera, target.scene.image
    if camera.type != "intrinsics":
        return FlatView(camera.vertical_fov, camera.lens_shift)
    plain = camera.with_checked(distortion=None, skew=0.0)
    seen = plain.projection(image.width, image.height)
    assert isinstance(seen, Rectilinear)
    if abs(seen.width * image.height - seen.height * image.width) > _SQUARE * seen.width * image.height:
        target.leave_out("pixels that are not square: those of their height", "camera", "fy")
    shift = seen.left / seen.width + 0.5, -(seen.top / seen.height + 0.5)
    return FlatView(math.degrees(2.0 * angle_of(seen.height / 2.0, 1.0)), shift)


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
    for at, shape in scene.all_shapes():
        if shape.shadow_catcher:
            target.leave_out("that it catches shadows: the camera sees it", *at, "shadow_catcher")
    return hides
