"""A camera in a TOML or JSON file: our own table, or a camera matrix and coefficients as calibration programs write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from clrender.cameras.rotations import rotation_of
from clrender.errors import SceneError
from clrender.importers.cameras.lens_parameters import opencv_distortion
from clrender.wording import counted, quoted

__all__ = ["calibrated_keys", "own_keys"]

_MATRIX: Final = ("K", "camera_matrix", "cameraMatrix", "mtx", "intrinsic_matrix")
_COEFFICIENTS: Final = ("D", "dist", "dist_coeffs", "distCoeffs", "distortion_coefficients", "distortion")
_MODEL: Final = ("distortion_model", "model")
_SIZES: Final = (("width", "height"), ("image_width", "image_height"), ("w", "h"))
_SIZE: Final = ("resolution", "image_size", "img_size")
_POSE: Final = ("camera_to_world", "world_to_camera", "convention", "position", "target", "up", "pixel_origin")
"""Our own keys that may stand beside a matrix."""
_PLAIN: Final = ("plumb_bob", "rational_polynomial", "brown-conrady", "opencv", "pinhole")
_FISHEYE: Final = ("equidistant", "fisheye", "kannala-brandt", "opencv_fisheye")


def own_keys(content: Mapping[str, Any], source: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Tables `camera` and `image` of a file that is, or has, a table `camera` of a scene file.

    Parameters
    ----------
    content : mapping
        What the file says.
    source : str
        Its name in messages.

    Raises
    ------
    SceneError
        One of the two is no table.
    """
    for key in ("camera", "image"):
        if not isinstance(content.get(key, {}), Mapping):
            raise SceneError(f"{source}: {key} is {quoted(str(content[key]))}, but must be a table")
    camera = content["camera"] if "camera" in content else {k: v for k, v in content.items() if k != "image"}
    return dict(camera), dict(content.get("image", {}))


def calibrated_keys(content: Mapping[str, Any], source: str) -> dict[str, Any] | None:
    """Keys of a calibrated camera, in OpenCV's convention; None if the file has no camera matrix.

    Parameters
    ----------
    content : mapping
        What the file says.
    source : str
        Its name in messages.

    Raises
    ------
    SceneError
        A number is missing or not usable.
    """
    names = [name for name in _MATRIX if name in content]
    if not names:
        return None
    matrix = _numbers(content[names[0]], 9, source, names[0]).reshape(3, 3)
    if matrix[2].tolist() != [0.0, 0.0, 1.0] or matrix[1, 0] != 0.0:
        raise SceneError(f"{source}: {names[0]} is no camera matrix [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")
    (fx, skew, cx), (_, fy, cy) = matrix[:2].tolist()
    keys: dict[str, Any] = {"type": "intrinsics", "fx": fx, "fy": fy, "cx": cx, "cy": cy, "pixel_origin": "center"}
    keys |= {"skew": skew} if skew else {}
    keys |= _lens(content, source) | _resolution(content, source)
    return keys | {key: content[key] for key in _POSE if key in content} | _extrinsics(content, source)


def _lens(content: Mapping[str, Any], source: str) -> dict[str, Any]:
    name = next((name for name in _COEFFICIENTS if name in content), None)
    if name is None:
        return {}
    if isinstance(content[name], Mapping) and "data" not in content[name]:
        return {"distortion": content[name]}
    said = next((content[key] for key in _MODEL if key in content), "fisheye" if content.get("fisheye") else "opencv")
    model = str(said).lower()
    if model not in (*_PLAIN, *_FISHEYE):
        known = ", ".join((*_PLAIN, *_FISHEYE))
        raise SceneError(f"{source}: the distortion model {quoted(str(said))} is not known; known are {known}")
    try:
        made = opencv_distortion(_numbers(content[name], None, source, name).tolist(), model in _FISHEYE)
    except ValueError as error:
        raise SceneError(f"{source}: {name} {error}") from None
    return {"distortion": made} if made else {}


def _resolution(content: Mapping[str, Any], source: str) -> dict[str, Any]:
    for first, second in _SIZES:
        if first in content and second in content:
            return {"resolution": [content[first], content[second]]}
    for name in _SIZE:
        if name in content:
            return {"resolution": [int(x) for x in _numbers(content[name], 2, source, name).tolist()]}
    return {}


def _extrinsics(content: Mapping[str, Any], source: str) -> dict[str, Any]:
    """From world to camera, as OpenCV's ``rvec``, ``tvec`` or ``R``, ``t``."""
    move = next((name for name in ("tvec", "t", "T") if name in content), None)
    turn = next((name for name in ("rvec", "R") if name in content), None)
    if move is None or turn is None:  # alone, R is the rectification of a stereo pair
        return {}
    if turn == "rvec":
        rotation = rotation_of(_numbers(content[turn], 3, source, turn))
    else:
        rotation = _numbers(content[turn], 9, source, turn).reshape(3, 3)
    translation = _numbers(content[move], 3, source, move)
    return {"world_to_camera": np.column_stack([rotation, translation]).tolist(), "convention": "opencv"}


def _numbers(value: Any, count: int | None, source: str, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Numbers as a flat array; they may be nested, or in a table with ``data``, as OpenCV and ROS write them."""
    values = value["data"] if isinstance(value, Mapping) and "data" in value else value
    try:
        if not isinstance(values, Sequence) or isinstance(values, str):
            raise TypeError
        numbers = np.asarray(values, np.float64).reshape(-1)
        if not np.isfinite(numbers).all():
            raise ValueError
    except (TypeError, ValueError):
        raise SceneError(f"{source}: {name} is {quoted(str(value)[:60])}, but must be a list of numbers") from None
    if count is not None and len(numbers) != count:
        raise SceneError(f"{source}: {name} has {counted(len(numbers), 'number')}, but must have {count}")
    return numbers
