"""Cameras of COLMAP: its folders with ``cameras`` and ``images``, as text or binary (colmap/src/colmap/scene)."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from clrender.cameras.rotations import rotation_of_quaternion
from clrender.errors import SceneError
from clrender.files.named import open_scene_file
from clrender.importers.cameras.lens_parameters import MODELS, from_model
from clrender.wording import quoted

__all__ = ["images", "is_colmap"]

_LIMIT: Final = 2**32
_NUMBERS: Final = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
)  # fmt: skip
"""Camera models by their number in binary files."""
_COUNTS: Final = {**{name: len(each) for name, each in MODELS.items()}, "FOV": 5, "THIN_PRISM_FISHEYE": 12}
_ENDINGS: Final = (".bin", ".txt")
_POINT: Final = 24
"""Bytes of a point of an image."""


class _Image(NamedTuple):
    """An image in the file."""

    name: str
    camera: int
    rotation: list[float]
    translation: list[float]
    place: str


def is_colmap(path: Path) -> bool:
    """Whether it is a folder of COLMAP, or one of its two files."""
    folder = path if path.is_dir() else path.parent
    return (path.is_dir() or path.name in {f"{stem}{end}" for stem in ("cameras", "images") for end in _ENDINGS}) and (
        _ending(folder) is not None
    )


def images(path: Path, source: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """(name, keys of the camera) of every image, by name.

    Parameters
    ----------
    path : pathlib.Path
        The folder, or one of the two files.
    source : str
        Its name in messages.

    Raises
    ------
    SceneError
        The files are damaged, or a camera is of a model that clrender has not.
    """
    folder = path if path.is_dir() else path.parent
    ending = path.suffix if path.suffix in _ENDINGS else _ending(folder)
    text = ending == ".txt"
    cameras = dict(_parsed(folder / f"cameras{ending}", source, _cameras_of_text if text else _cameras_of_binary))
    found = list(_parsed(folder / f"images{ending}", source, _images_of_text if text else _images_of_binary))
    for image in sorted(found, key=lambda each: each.name):
        if image.camera not in cameras:
            raise SceneError(f"{image.place}: the camera {image.camera} is not in cameras{ending}")
        try:
            rotation = rotation_of_quaternion(image.rotation)
        except ValueError as error:
            raise SceneError(f"{image.place}: its rotation {error}") from None
        pose = np.column_stack([rotation, image.translation]).tolist()
        yield image.name, {**cameras[image.camera], "world_to_camera": pose, "convention": "opencv"}


def _ending(folder: Path) -> str | None:
    return next((e for e in _ENDINGS if all((folder / f"{stem}{e}").is_file() for stem in ("cameras", "images"))), None)


def _parsed(path: Path, source: str, parse: Callable[[bytes, str], Iterator[Any]]) -> Iterator[Any]:
    label = f"{source}: {path.name}"
    file, size = open_scene_file(path, label, _LIMIT)
    with file:
        data = file.read(size)
    try:
        yield from parse(data, label)
    except (struct.error, UnicodeDecodeError, ValueError, IndexError):
        raise SceneError(f"{label}: is damaged or ends too early; export it again") from None


def _camera(model: str, size: tuple[int, int], parameters: list[float], place: str) -> dict[str, Any]:
    if model not in MODELS:
        raise SceneError(
            f"{place}: has the model {quoted(model)}, which clrender has not; known are {', '.join(MODELS)}"
        )
    if len(parameters) != len(MODELS[model]) or not all(map(math.isfinite, parameters)):
        raise SceneError(f"{place}: must have {len(MODELS[model])} finite parameters of its model {model}")
    return from_model(model, parameters) | {"resolution": list(size)}


def _lines(data: bytes, label: str) -> Iterator[tuple[str, str]]:
    """Lines that are no comments, and their places."""
    for number, line in enumerate(data.decode("utf-8").splitlines(), 1):
        if not line.startswith("#"):
            yield line.strip(), f"{label}: line {number}"


def _cameras_of_text(data: bytes, label: str) -> Iterator[tuple[int, dict[str, Any]]]:
    for line, place in _lines(data, label):
        if line:
            number, model, width, height, *parameters = line.split()
            yield int(number), _camera(model, (int(width), int(height)), [float(each) for each in parameters], place)


def _images_of_text(data: bytes, label: str) -> Iterator[_Image]:
    rows = list(_lines(data, label))
    # Every second line has the points of an image, and may be empty
    for line, place in rows[::2]:
        if line:
            _, *numbers, camera, name = line.split(maxsplit=9)
            values = [float(each) for each in numbers]
            yield _Image(name, int(camera), values[:4], values[4:], place)


def _cameras_of_binary(data: bytes, label: str) -> Iterator[tuple[int, dict[str, Any]]]:
    (count,), at = struct.unpack_from("<Q", data), 8
    for index in range(count):
        number, kind, width, height = struct.unpack_from("<iiQQ", data, at)
        model = _NUMBERS[kind] if 0 <= kind < len(_NUMBERS) else str(kind)
        amount = _COUNTS.get(model, 0)
        parameters = list(struct.unpack_from(f"<{amount}d", data, at + 24))
        at += 24 + 8 * amount
        yield number, _camera(model, (width, height), parameters, f"{label}: camera {index}")


def _images_of_binary(data: bytes, label: str) -> Iterator[_Image]:
    (count,), at = struct.unpack_from("<Q", data), 8
    for index in range(count):
        _, *numbers, camera = struct.unpack_from("<i7di", data, at)
        end = data.index(b"\0", at + 64)
        name = data[at + 64 : end].decode("utf-8")
        (points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + _POINT * points
        if at > len(data):
            raise ValueError
        yield _Image(name, camera, numbers[:4], numbers[4:], f"{label}: image {index}")
