"""Reads cameras from files of several kinds, and picks one of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from clrender.errors import SceneError, UsageError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.cameras.calibration import calibrated_keys, own_keys
from clrender.importers.cameras.colmap import images, is_colmap
from clrender.importers.cameras.transforms import frames
from clrender.importers.choices import Choices
from clrender.limits import checked_path
from clrender.scene.camera import Camera
from clrender.scene.description import Scene
from clrender.scene.load import parsed_file
from clrender.scene.validation_errors import scene_error
from clrender.wording import counted, printable, quoted, suggestion

__all__ = ["CameraKeys", "camera_file", "camera_keys_of", "load_cameras", "with_camera"]

CameraKeys = tuple[dict[str, Any], dict[str, Any]]
"""Tables `camera` and `image` of a scene file; the camera may lack its pose."""

_GLTF: Final = (".gltf", ".glb")
_USD: Final = (".usd", ".usda", ".usdc", ".usdz")
_TIMED: Final = (*_GLTF, *_USD)
_TABLES: Final = (".toml", ".json")
_POSES: Final = ("camera_to_world", "world_to_camera")
_FRAME: Final = ("position", "target", "up")
_SHOWN: Final = 3
"""Cameras that a message names."""


def load_cameras(path: str | Path, *, time_at: float | None = None) -> dict[str, Camera]:
    """All cameras of a file, by name, in the file's order.

    Parameters
    ----------
    path : str or pathlib.Path
        ``transforms.json``; a folder of COLMAP; ``.gltf`` or ``.glb``; a USD stage; or a ``.toml`` or ``.json`` with a
        camera of a scene file, or with a camera matrix and distortion as OpenCV has them, whose camera has an empty
        name.
    time_at : float, optional
        Moment of a glTF file's animation, seconds from its start, or of a stage; default: the rest pose.

    Returns
    -------
    dict of str to Camera
        In its `Camera.resolution` each has the size of its image, if the file says it. Without a pose it is at the
        origin and looks along +z, with y down.

    Raises
    ------
    SceneError
        A camera cannot be read: file, place, problem and cure.
    """
    path = checked_path(path, "a file of cameras")
    made = {}
    for name, (keys, _) in _keys(path, _source(path), time_at).items():
        placed = keys if _has_pose(keys) else {**keys, "world_to_camera": _ORIGIN, "convention": "opencv"}
        made[name] = _validated(placed, _named(path, name))
    return made


_ORIGIN: Final = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


def camera_keys_of(text: str | Path, *, time_at: float | None = None) -> tuple[str, CameraKeys]:
    """One camera of a file.

    Parameters
    ----------
    text : str or pathlib.Path
        A file as for `load_cameras`; if it has several cameras, followed by ``#`` and the name of one, the name of its
        file, or its number from 0.
    time_at : float, optional
        See `load_cameras`.

    Returns
    -------
    name, (camera, image)
        What it is called in messages, and its tables.

    Raises
    ------
    SceneError
        It cannot be read.
    UsageError
        The file has several, and none of them was named; or there is no such camera.
    """
    path, name = camera_file(text)
    found = _keys(path, _source(path), time_at)
    if not found:
        raise SceneError(f"{_source(path)}: has no camera; name another file")
    if not name:
        if len(found) > 1:
            names = ", ".join(quoted(each) for each in list(found)[:_SHOWN])
            more = ", …" if len(found) > _SHOWN else ""
            raise UsageError(
                f"{path} has {counted(len(found), 'camera')}; write {path}#NAME or #NUMBER for one of {names}{more}"
            )
        name = next(iter(found))
    else:
        name = _picked(name, found, path)
    return _named(path, name), found[name]


def camera_file(text: str | Path) -> tuple[Path, str]:
    """A file of cameras and the name behind the ``#``, if there is one."""
    whole = checked_path(text, "camera")
    if not whole.exists() and "#" in str(whole):
        before, _, name = str(whole).rpartition("#")
        return Path(before), name
    return whole, ""


def with_camera(scene: Scene, camera: str | Path | Camera | Mapping[str, Any], time_at: float | None = None) -> Scene:
    """A copy of a scene with another camera, and an image of the size that the camera says, if it does.

    Parameters
    ----------
    scene : Scene
    camera : str, pathlib.Path, Camera or mapping
        A file as for `camera_keys_of`, a camera, keys of one, or the tables `camera` and `image`. Without a pose it
        stays where the scene's camera is.
    time_at : float, optional
        See `load_cameras`.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError, UsageError
        See `camera_keys_of`.
    """
    if isinstance(camera, Camera):
        return _placed(scene, camera, {}, "camera")
    if isinstance(camera, Mapping):
        source, (keys, image) = "camera", own_keys(camera, "camera")
    elif isinstance(camera, str | Path):
        source, (keys, image) = camera_keys_of(camera, time_at=time_at)
    else:
        raise UsageError(f"camera is {camera!r}, but must be a Camera, its keys, or the name of a file")
    if not _has_pose(keys):
        keys = {**{key: getattr(scene.camera, key) for key in _FRAME}, **keys}
    return _placed(scene, _validated(keys, source), image, source)


def _placed(scene: Scene, camera: Camera, image: dict[str, Any], source: str) -> Scene:
    if camera.resolution is not None and not image:
        image = dict(zip(("width", "height"), camera.resolution, strict=True))
    changed = scene.with_checked(camera=camera)
    if not image:
        return changed
    try:
        return changed.changed({("image", key): value for key, value in image.items()})
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None


def _keys(path: Path, source: str, time_at: float | None) -> dict[str, CameraKeys]:
    """Tables of all cameras of a file by name."""
    ending = path.suffix.lower()
    if time_at is not None and ending not in _TIMED:
        raise SceneError(f"{source} takes no time_at, which is for {' and '.join(_TIMED)}; leave it out")
    if is_colmap(path):
        return {name: (keys, {}) for name, keys in images(path, source)}
    if path.is_dir():
        raise SceneError(f"{source}: has no cameras.bin and images.bin, or .txt, of COLMAP; name another folder")
    if ending in _GLTF:
        from clrender.importers.gltf.cameras import read_cameras

        found = read_cameras(path, AssetFiles(source, path.parent), Choices(time_at))
        return _distinct([(each.name, (each.keys, dict(each.image))) for each in found])
    if ending in _USD:
        from clrender.importers.usd.read import read_cameras as cameras_of_stage

        made = cameras_of_stage(path, AssetFiles(source, path.parent), Choices(time_at))
        return _distinct([(name, (keys, dict(image))) for name, keys, image in made])
    if ending not in _TABLES:
        known = ", ".join((*_TABLES, *_TIMED))
        raise SceneError(f"{source}: is no file of cameras: name one that ends in {known}, or a folder of COLMAP")
    content = parsed_file(path, source, "the camera file")
    if not isinstance(content, Mapping):
        raise SceneError(f"{source}: is no table of a camera, but {quoted(type(content).__name__)}")
    if "frames" in content:
        return _distinct([(name, (keys, {})) for name, keys in frames(content, source)])
    keys = calibrated_keys(content, source)
    return {"": own_keys(content, source) if keys is None else (keys, {})}


def _distinct(cameras: list[tuple[str, CameraKeys]]) -> dict[str, CameraKeys]:
    """Cameras by name; those of a name that others have before them, by name and number."""
    found: dict[str, CameraKeys] = {}
    for number, (name, keys) in enumerate(cameras):
        found[name if name not in found else f"{name} ({number})"] = keys
    return found


def _picked(name: str, found: Mapping[str, CameraKeys], path: Path) -> str:
    if name in found:
        return name
    alike = [each for each in found if Path(each).name == name or Path(each).stem == name]
    if len(alike) == 1:
        return alike[0]
    if name.isdecimal() and int(name) < len(found):
        return list(found)[int(name)]
    if not any(found):
        raise UsageError(f"{path} has no camera {quoted(name)}; the only one has no name: leave out #{name}")
    raise UsageError(f"{path} has no camera {quoted(name)}{suggestion(name, found)}")


def _has_pose(keys: Mapping[str, Any]) -> bool:
    return any(key in keys for key in (*_POSES, *_FRAME))


def _validated(keys: Mapping[str, Any], source: str) -> Camera:
    try:
        return Camera.model_validate(keys)
    except ValidationError as error:
        raise scene_error(error, Camera, source) from None


def _source(path: Path) -> str:
    return printable(str(path))


def _named(path: Path, name: str) -> str:
    return f"{_source(path)}#{printable(name)}" if name else _source(path)
