"""Cameras of ``transforms.json``, as NeRF, instant-ngp and nerfstudio have it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from clrender.errors import SceneError
from clrender.exact.angles import tangent
from clrender.importers.cameras.lens_parameters import from_model
from clrender.wording import quoted

__all__ = ["frames"]

_FISHEYE: Final = ("OPENCV_FISHEYE", "FISHEYE")
_PANORAMIC: Final = ("EQUIRECTANGULAR",)
_PLAIN: Final = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")


def frames(content: Mapping[str, Any], source: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """(name, keys of the camera) of every frame, in the file's order.

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
    if not isinstance(content["frames"], list):
        raise SceneError(f"{source}: frames is no list; it has an entry for each image")
    for number, frame in enumerate(content["frames"]):
        place = f"{source}: frames[{number}]"
        if not isinstance(frame, Mapping) or "transform_matrix" not in frame:
            raise SceneError(f"{place} has no transform_matrix; add the camera's pose")
        keys = _lens({**content, **frame}, place)
        pose = {"camera_to_world": frame["transform_matrix"], "convention": "opengl"}
        yield str(frame.get("file_path", number)), keys | pose


def _lens(said: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Projection of a frame, whose own numbers replace those of the file."""

    def number(name: str, default: float | None = None) -> float:
        value = said.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            missing = f"has no {name}; add it" if value is None else f"{name} is {quoted(str(value))}, and no number"
            raise SceneError(f"{place} {missing}")
        return float(value)

    model = str(said.get("camera_model", "OPENCV_FISHEYE" if said.get("is_fisheye") else "OPENCV")).upper()
    if model in _PANORAMIC:
        return {"type": "panoramic"}
    if model not in (*_FISHEYE, *_PLAIN):
        known = ", ".join((*_PLAIN, *_FISHEYE, *_PANORAMIC))
        raise SceneError(f"{place} has the camera_model {quoted(model)}, which is not known; known are {known}")
    if "w" not in said or "h" not in said:
        if "fl_x" in said:
            raise SceneError(f"{place} has no {'h' if 'w' in said else 'w'}; add the size of its image, pixels")
        # As in NeRF's synthetic scenes, whose images are square
        return {"vertical_fov": math.degrees(number("camera_angle_x"))}
    width, height = number("w"), number("h")
    across = number("fl_x") if "fl_x" in said else 0.5 * width / tangent(0.5 * number("camera_angle_x"))
    down = across
    if "fl_y" in said or ("fl_x" not in said and "camera_angle_y" in said):
        down = number("fl_y") if "fl_y" in said else 0.5 * height / tangent(0.5 * number("camera_angle_y"))
    middle = [number("cx", 0.5 * width), number("cy", 0.5 * height)]
    k = [number(f"k{n}", 0.0) for n in range(1, 5)]
    if model in _FISHEYE:
        keys = from_model("OPENCV_FISHEYE", [across, down, *middle, *k])
    elif k[3]:
        raise SceneError(f"{place} has a k4 of {k[3]:g}, which a lens of radial terms k1 to k3 has not; leave it out")
    else:
        p = [number("p1", 0.0), number("p2", 0.0)]
        keys = from_model("FULL_OPENCV", [across, down, *middle, *k[:2], *p, k[2], 0.0, 0.0, 0.0])
    return keys | {"resolution": [int(width), int(height)]}
