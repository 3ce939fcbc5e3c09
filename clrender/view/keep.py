"""What was edited in a view, to be kept: a scene with its files, tables of a scene file, and a command line."""

from __future__ import annotations

import shlex
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import IO, TYPE_CHECKING, Any, Final

from clrender.errors import SceneError, UsageError
from clrender.exporters import exported, scene_text
from clrender.exporters.own import toml_text
from clrender.files.named import allowed_file
from clrender.limits import Flag, Region, nearest, shown
from clrender.scene.defaults import Image, Render
from clrender.settings import SETTINGS, WORK
from clrender.version import __version__
from clrender.view.edited_scene import EditedScene, camera_toml

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["ARCHIVE", "command_line", "kept_scene", "table_text", "write_archive"]

ARCHIVE: Final = "scene.zip"
"""Name of the download."""
_SCENE: Final = "scene.toml"
_FOLDER: Final = "scene-files"
_READING: Final = {"time_at": "--time-at", "variant": "--variant", "up": "--up", "environment": "--environment"}
_FILE_KEYS: Final = ("file", "texture")
_EPOCH: Final = (1980, 1, 1, 0, 0, 0)
"""Time of all files in an archive: the same scene makes the same archive."""


def kept_scene(edited: EditedScene) -> Scene:
    """The scene as it is rendered, with all settings that a scene file takes in its tables."""
    settings = edited.checked.settings
    in_force = {
        name: getattr(settings, name)
        for name, setting in SETTINGS.items()
        if setting.section == "render" and setting.integrator in (None, settings.integrator)
    }
    changed = {name: value for name, value in in_force.items() if value != SETTINGS[name].default}
    image = Image(width=settings.width, height=settings.height)
    return edited.job.scene.with_checked(image=image, render=Render(**changed))


def command_line(edited: EditedScene, scene: str, *, whole: bool, reading: Sequence[str] = ()) -> str:
    """The command that renders a scene file with a view's settings.

    Parameters
    ----------
    edited : EditedScene
    scene : str
        The file.
    whole : bool
        Whether all settings that were given are options, and how the scene was read, and not only those that no scene
        file can hold.
    reading : sequence of str
        With ``whole``: options by which the scene was read that it does not know itself, such as ``--camera FILE``.
    """
    settings = edited.checked.settings
    given = edited.asked
    words = ["clrender", "render", scene]
    if whole and ("width" in given or "height" in given):
        words += ["--size", f"{settings.width}x{settings.height}"]
    for name, setting in SETTINGS.items():
        value = getattr(settings, name)
        needed = setting.section is None and setting.group != WORK and value != setting.default
        # With --error, the number of samples of a scene file does not count.
        needed = needed or (name == "spp" and settings.error is not None)
        asked = whole and name in given and setting.group != WORK
        if setting.option is None or value is None or not (needed or asked):
            continue
        if isinstance(setting.domain, Flag):
            words.append(setting.option if value else f"--no-{setting.option.removeprefix('--')}")
        else:
            words += [setting.option, Region.text(value) if isinstance(setting.domain, Region) else str(value)]
    if whole:
        words += [*_reading(edited.scene.origin or {}), *reading]
    for plugin in edited.scene.plugins:
        words += ["--plugin", plugin.source]
    return shlex.join([*words, "-o", "image.png"])


def _reading(origin: Mapping[str, Any]) -> Iterator[str]:
    """Options by which a scene was read, as far as it knows them: of a camera's file it does not know the name."""
    for key, option in _READING.items():
        if key in origin:
            yield from (option, str(origin[key]))
    if "shutter" in origin:
        yield from ("--shutter", ":".join(map(str, origin["shutter"])))
    for name, value in origin.get("define", {}).items():
        yield from ("--define", f"{name}={value}")
    if origin.get("hide_environment"):
        yield "--hide-environment"


def table_text(edited: EditedScene, what: str, name: str, reading: Sequence[str] = ()) -> str:
    """A table of the scene as it is now, in TOML, or the settings as a command line.

    Parameters
    ----------
    edited : EditedScene
    what : str
        ``camera``, ``settings``, ``material`` or ``light``.
    name : str
        Of the material, or the place of the light.
    reading : sequence of str
        As of `command_line`.

    Raises
    ------
    UsageError
        There is none of that name, or it has a picture or a mesh that no other scene file could name.
    """
    scene = edited.checked.scene
    if what == "camera":
        return camera_toml(edited.camera)
    if what == "settings":
        return command_line(edited, edited.scene.source, whole=True, reading=reading) + "\n"
    known: Mapping[str, Any] = scene.materials if what == "material" else edited.emitters
    if name not in known:
        raise UsageError(f"there is no {what} {shown(name)}{nearest(name, known)}")
    table = known[name].model_dump(mode="json", exclude_none=True, exclude_unset=True)
    files = scene.files
    for file in _named_files(table):
        with suppress(SceneError):
            if (files.base_folder / file).is_file() and allowed_file(file, files.base_folder, files.allow_paths, name):
                continue
        raise UsageError(
            f"the {what} {shown(name)} names {shown(file)}, which is no file beside the scene but a part of "
            f"{scene.source}: use Download scene of the page, which has it as a file"
        )
    return toml_text({"materials": {name: table}} if what == "material" else {name.partition("[")[0]: [table]})


def _named_files(table: Mapping[str, Any] | Sequence[Any]) -> Iterator[str]:
    """Names of files in a table, or in a list of them."""
    for key, value in table.items() if isinstance(table, Mapping) else enumerate(table):
        if isinstance(value, str):
            if key in _FILE_KEYS:
                yield value
        elif isinstance(value, Mapping | list):
            yield from _named_files(value)


def write_archive(edited: EditedScene, file: IO[bytes]) -> None:
    """Write a ``.zip`` with the scene, the files that it names, and the command that renders the view's image.

    Raises
    ------
    SceneError
        A file of the scene cannot be read, or the scene is too large for a scene file.
    """
    scene = kept_scene(edited)
    export = exported(scene, _FOLDER)
    text = scene_text(export.description, ".toml", f"a scene of a live view, kept by clrender {__version__}")
    command = f"# The image of the view:\n{command_line(edited, _SCENE, whole=False)}\n"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr(zipfile.ZipInfo(_SCENE, _EPOCH), text, zipfile.ZIP_DEFLATED)
        archive.writestr(zipfile.ZipInfo("command.txt", _EPOCH), command, zipfile.ZIP_DEFLATED)
        for name, write in export.files.items():
            about = zipfile.ZipInfo(name, _EPOCH)
            about.compress_type = zipfile.ZIP_DEFLATED
            # Some formats, such as OpenEXR, go back in a file, which a part of an archive does not allow.
            with tempfile.TemporaryFile(prefix="clrender-view-") as plain:
                write(plain)
                plain.seek(0)
                with archive.open(about, "w", force_zip64=True) as into:
                    shutil.copyfileobj(plain, into)
