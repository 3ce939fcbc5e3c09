"""Loads a scene of any format, by the extension of its file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from numbers import Real
from pathlib import Path
from typing import Any, Final

from clrender.errors import SceneError, UsageError
from clrender.importers.asset_files import AssetFiles
from clrender.importers.cameras.read import camera_file, with_camera
from clrender.importers.choices import Choices
from clrender.importers.draft import Draft
from clrender.importers.framing import FRAMED, completed
from clrender.limits import checked_path, shown
from clrender.plugins import as_plugins
from clrender.scene import Camera, Scene, SunSkyLight
from clrender.scene.load import load as load_own
from clrender.wording import printable, quoted

__all__ = ["CHOICES", "SCENE_ENDINGS", "load"]

_READERS: Final[Mapping[str, str]] = {
    ".gltf": "clrender.importers.gltf",
    ".glb": "clrender.importers.gltf",
    ".obj": "clrender.importers.obj",
    ".ply": "clrender.importers.ply",
    ".stl": "clrender.importers.stl",
    ".xml": "clrender.importers.mitsuba",
    ".pbrt": "clrender.importers.pbrt",
    ".usd": "clrender.importers.usd",
    ".usda": "clrender.importers.usd",
    ".usdc": "clrender.importers.usd",
    ".usdz": "clrender.importers.usd",
}
"""Modules by extension. Each has ``read(path, files) -> Draft``, and is imported on demand."""
_GLTF: Final = (".gltf", ".glb")
_ANIMATED: Final = (*_GLTF, ".usd", ".usda", ".usdc", ".usdz")
"""Extensions of animated scenes, which are read at a moment."""
_OWN: Final = (".toml", ".json", "")
"""Extensions of scenes of clrender's own format; built-in ones have none."""
_CHOOSING: Final = (*_ANIMATED, ".xml")
"""Extensions whose ``read`` also takes `Choices`."""
_MODELS: Final = (".obj", ".ply", ".stl")
"""Extensions of models whose upward axis is not known."""
CHOICES: Final[Mapping[str, tuple[str, ...]]] = {
    "time_at": (*_ANIMATED, *_OWN, ".xml", ".pbrt"),
    "variant": _GLTF,
    "up": _MODELS,
    "define": (".xml",),
}
"""Extensions of the scenes that have each of the choices of `load`."""
SCENE_ENDINGS: Final = (".toml", ".json", *_READERS)
_OF_PROGRAMS: Final = frozenset(
    {
        *(".3dm", ".3ds", ".3mf", ".abc", ".blend", ".c4d", ".dae", ".dxf", ".fbx", ".fcstd", ".hip", ".igs", ".lwo"),
        *(".ma", ".max", ".mb", ".skp", ".step", ".stp", ".x3d"),
    }
)
"""Endings of models that other programs read, and not this one."""
"""Extensions of the files that `load` reads."""


def load(
    path_or_name: str | Path,
    *,
    allow_paths: Sequence[str | Path] = (),
    time_at: float | None = None,
    shutter: tuple[float, float] | None = None,
    variant: str | None = None,
    environment: str | Path | float | None = None,
    strict: bool = False,
    up: str | None = None,
    define: Mapping[str, str] | None = None,
    camera: str | Path | Camera | Mapping[str, Any] | None = None,
    hide_environment: bool = False,
    plugins: Any = None,
) -> Scene:
    """Read and validate a scene and the files it names.

    Parameters
    ----------
    path_or_name : str or pathlib.Path
        A file with one of the `SCENE_ENDINGS`, or the name of a built-in scene (which wins: write ``./room`` for a
        file).
    allow_paths : sequence of str or pathlib.Path
        Folders, besides the scene's own, from which these files may be read.
    time_at : float, optional
        Time of the image, seconds: the camera's `time`, and the moment of a glTF file's animation, whose rest pose is
        the default.
    shutter : (float, float), optional
        When the camera's shutter opens and closes, seconds from the time of the image: what moves meanwhile is blurred.
    variant : str, optional
        Name of a glTF file's material variant (KHR_materials_variants).
    environment : str, pathlib.Path or float, optional
        Environment map or radiance, for a scene that has none; see `clrender.scene.Scene.with_environment`.
    strict : bool
        Whether a file of another format is refused for faults that are otherwise forgiven, or for which a part is left
        out, with a note.
    up : str, optional
        Axis that points upward in a model of a format that has no camera and does not say (`.obj .ply .stl`): ``y`` or
        ``z``; default: z for `.stl`, as programs for printing and construction have it, else y.
    define : mapping of str to str, optional
        Values of the parameters (``$NAME``) of a Mitsuba scene, before its own defaults.
    camera : str, pathlib.Path, Camera or mapping, optional
        A camera in place of the scene's; see `clrender.importers.cameras.with_camera`.
    hide_environment : bool
        Whether the camera does not see the environment, which lights the scene all the same.
    plugins : Plugin, str, pathlib.Path, or iterable of them, optional
        Plugins that its materials may use; see `clrender.plugin`. No scene file can name one.

    Returns
    -------
    Scene
        Its `clrender.scene.Scene.notes` say what is not supported, and what was done instead.

    Raises
    ------
    SceneError
        In one sentence: file, location, problem and remedy.
    UsageError
        A plugin is not valid.
    """
    allowed = as_plugins(plugins)
    if isinstance(path_or_name, Scene):
        raise SceneError("a Scene is loaded already; render it, or name a file to load another")
    path = checked_path(path_or_name, "a scene to load")
    allow_paths = [allow_paths] if isinstance(allow_paths, str | Path) else allow_paths
    if not isinstance(allow_paths, Iterable):
        raise UsageError(f"allow_paths is {shown(allow_paths)}, but must be a list of folders")
    folders = [checked_path(folder, "allow_paths") for folder in allow_paths]
    ending = path.suffix.lower()
    for key, given in (("time_at", time_at), ("variant", variant), ("up", up), ("define", define or None)):
        if given is not None and ending not in CHOICES[key]:
            known = " and ".join(filter(None, CHOICES[key]))
            raise SceneError(f"{quoted(str(path))} takes no {key}, which is for {known}; leave it out")
    if up not in (None, "y", "z"):
        raise SceneError(f"up is {up!r}; it must be y or z")
    if shutter is not None and (len(shutter) != 2 or not all(math.isfinite(each) for each in shutter)):
        raise SceneError(f"shutter is {shutter!r}; it must be two finite numbers of seconds")
    if time_at is not None and not math.isfinite(time_at):
        raise SceneError(f"time_at is {time_at!r}; it must be a finite number of seconds")
    choices = Choices(time_at, variant, {str(name): str(value) for name, value in (define or {}).items()}, shutter)
    reader = _READERS.get(ending)
    origin = {
        "name": str(path_or_name),
        "time_at": time_at,
        "shutter": None if shutter is None else list(shutter),
        "variant": variant,
        "up": up,
        "define": dict(choices.define) or None,
    }
    if isinstance(environment, str | Path | Real):  # a film cannot record an array
        origin |= {"environment": float(environment) if isinstance(environment, Real) else str(environment)}
    origin = {key: value for key, value in origin.items() if value is not None}
    if reader is None:
        if ending and ending not in SCENE_ENDINGS:
            raise SceneError(_no_scene(path))
        own = load_own(path_or_name, allow_paths=folders).with_origin(origin)
        own = own.with_plugins(allowed)
        return _timed(_changed(own, environment, camera, hide_environment), time_at, shutter)
    read: Callable[..., Draft] = import_module(reader).read
    for folder in folders:
        if not folder.is_dir():
            raise SceneError(f"{quoted(str(folder))} is no folder, so nothing in it can be allowed")
    files = AssetFiles(printable(str(path)), path.parent, folders, strict)
    upright = up or ("z" if ending == ".stl" else "y")
    draft = read(path, files, choices) if ending in _CHOOSING else read(path, files)
    scene = completed(draft, files, upright, surrounded=environment is not None)
    changed = _changed(scene.with_origin(origin).with_plugins(allowed), environment, camera, hide_environment)
    # A pose at one moment is that, whatever the time; what moves from there on has the times of the animation
    posed = ending in _ANIMATED and shutter is None
    return _timed(changed, None if posed else time_at, shutter, has_note=ending in _ANIMATED)


def _timed(
    scene: Scene, time_at: float | None, shutter: tuple[float, float] | None, *, has_note: bool = False
) -> Scene:
    """The scene at a time, seen through a shutter; with a note where that changes nothing, unless it `has_note`."""
    said = {"camera.time": time_at, "camera.shutter": None if shutter is None else tuple(shutter)}
    said = {key: value for key, value in said.items() if value is not None}
    if not said:
        return scene
    if not (scene.has_motion or scene.camera.motion or has_note):
        asked = " and ".join(name for name, value in (("time", time_at), ("shutter", shutter)) if value is not None)
        changes = "change" if " and " in asked else "changes"
        of_day = any(isinstance(light, SunSkyLight) and light.time is not None for light in scene.lights)
        cure = "; the time of day is `time` of its sun_sky light" if of_day and time_at is not None else ""
        note = f"{scene.source}: nothing in it moves, so that the {asked} asked for {changes} nothing{cure}"
        scene = scene.with_notes([*scene.notes, note])
    return scene.changed(said)


def _changed(scene: Scene, environment: Any, camera: Any, hide_environment: bool) -> Scene:
    """The scene in an environment, which may be hidden, with another camera."""
    if environment is not None:
        scene = scene.with_environment(environment)
    if hide_environment:
        scene = scene.with_hidden_environment()
    if camera is None:
        return scene
    scene = with_camera(scene, camera)
    said = {"camera": scene.camera.model_dump(mode="json", exclude_unset=True), "image": scene.image.model_dump()}
    scene = scene.with_origin({**(scene.origin or {}), "camera": said})
    file = camera_file(camera)[0] if isinstance(camera, str | Path) else None
    kept = [note for note in scene.notes if FRAMED not in note]
    return scene.with_notes(kept, [file] if file is not None and file.is_file() else [])


def _no_scene(path: Path) -> str:
    """The sentence that a file with another ending is no scene, and what to do."""
    name = quoted(str(path))
    with suppress(OSError):  # of a name that no file can have
        if path.is_dir():
            return f"{name} is a folder; name a scene file in it"
    exported = (
        "export it as .glb or .obj from a program that reads it, or " if path.suffix.lower() in _OF_PROGRAMS else ""
    )
    known = ", ".join(SCENE_ENDINGS)
    return f"{name} is no scene: {exported}name a file that ends in {known}, or a built-in scene (`clrender scenes`)"
