"""What writers say of cameras: camera matrix, distortion and pose."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from clrender.cameras.poses import pose_matrix
from clrender.cameras.projection import Equidistant, Intrinsics, Parallel, Rectilinear
from clrender.errors import SceneError
from clrender.scene import Camera

__all__ = ["camera_pose", "camera_told", "pinhole", "refuse_camera"]


def camera_pose(camera: Camera, convention: str) -> npt.NDArray[np.float64]:
    """The matrix from camera space, of this convention, to world space, (4, 4) float64."""
    right, upward, forward = camera.axes
    return pose_matrix(camera.position, [right, [-each for each in upward], forward], convention)


def pinhole(camera: Camera, size: tuple[int, int]) -> dict[str, float] | None:
    """Focal lengths and principal point, pixels from the corner of the image.

    Parameters
    ----------
    camera : Camera
    size : (int, int)
        Width and height of the image, pixels.

    Returns
    -------
    dict or None
        ``fx fy cx cy skew``; None for panoramic and orthographic cameras. Of a fisheye it is the scale at its middle.
    """
    width, height = size
    projection = camera.projection(width, height)
    if isinstance(projection, Rectilinear):
        fx, fy = width / projection.width, height / projection.height
        return {"fx": fx, "fy": fy, "cx": -projection.left * fx, "cy": -projection.top * fy, "skew": 0.0}
    if isinstance(projection, Intrinsics):
        (fx, fy), (cx, cy) = projection.focal, projection.principal
        found = {"fx": fx * width, "fy": fy * height, "cx": cx * width, "cy": cy * height}
        return {**found, "skew": projection.skew * width}
    if isinstance(projection, Equidistant):
        focal = 0.5 * height / projection.angle
        return {"fx": focal, "fy": focal, "cx": 0.5 * width, "cy": 0.5 * height, "skew": 0.0}
    return None


def _region(camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """What an orthographic camera sees: metres to the right and down, from its axis to the upper left corner."""
    seen = camera.projection(*size)
    if not isinstance(seen, Parallel):
        return {}
    return {"region": {"left": seen.left, "top": seen.top, "width": seen.width, "height": seen.height}}


def camera_told(camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """A camera for readers of JSON, with its pose in the convention of OpenGL."""
    numbers = pinhole(camera, size)
    distortion = None if camera.distortion is None else camera.distortion.model_dump(mode="json")
    return {
        "type": camera.type,
        "width": size[0],
        "height": size[1],
        **(numbers or {}),
        **_region(camera, size),
        **({} if distortion is None else {"distortion": distortion}),
        "camera_to_world": camera_pose(camera, "opengl").tolist(),
        "convention": "opengl",
        "pixel_origin": "corner",
    }


def refuse_camera(camera: Camera, writer: str, reason: str) -> SceneError:
    """The error of a writer that cannot describe a camera."""
    return SceneError(f"the writer {writer} {reason} of type {camera.type}; leave it out, or use another camera")
