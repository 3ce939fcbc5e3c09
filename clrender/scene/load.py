"""Reads a scene file (.toml, .json) or a built-in scene into a validated `Scene`."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from clrender.errors import SceneError
from clrender.files.named import open_scene_file
from clrender.files.package_data import scenes_folder
from clrender.scene.description import Scene
from clrender.scene.shapes import Mesh
from clrender.scene.validation_errors import scene_error
from clrender.wording import place, printable, quoted, suggestion

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["SCENE_FILE_LIMIT", "builtin_names", "load", "parsed_file"]

SCENE_FILE_LIMIT: Final = 2**28
"""Largest scene file, bytes; larger geometry belongs in mesh files."""

# The parser takes time quadratic in the length of a dotted key; no scene's keys have more than a few parts.
_LONG_KEY = re.compile(
    r"""(?:(?<![\w-])[\w-]+[ \t]*\.[ \t]*|"[^"\n]*"[ \t]*\.[ \t]*|'[^'\n]*'[ \t]*\.[ \t]*){33}""", re.ASCII
)
_BUILTIN: Final = re.compile(r"[A-Za-z0-9_-]{1,100}")
"""Names that built-in scenes may have."""
_POSITION = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


class _DuplicateKey(ValueError):
    """A JSON object contains a key twice."""


def load(path_or_name: str | Path, *, allow_paths: Sequence[str | Path] = ()) -> Scene:
    """Read and validate a scene and the files it names.

    Parameters
    ----------
    path_or_name : str or pathlib.Path
        A ``.toml`` or ``.json`` file, or the name of a built-in scene (as a str it wins: write ``./room`` for a
        file).
    allow_paths : sequence of str or pathlib.Path
        Folders, besides the scene's own, from which these may be read.

    Raises
    ------
    SceneError
        In one sentence: file, place, what is wrong, what would be right.
    """
    path = _located(path_or_name)
    folders = [Path(folder) for folder in allow_paths]
    for folder in folders:
        if not folder.is_dir():
            raise SceneError(f"{quoted(str(folder))} is no folder, so nothing in it can be allowed")
    builtin = path.parent == scenes_folder() and path != Path(path_or_name)
    source = str(path_or_name) if builtin else printable(str(path))  # as typed, wherever it is installed
    content = parsed_file(path, source)
    try:
        scene = Scene.model_validate(content)
    except ValidationError as error:
        raise scene_error(error, Scene, source) from None
    except RecursionError:
        raise SceneError(f"{source}: the scene is nested too deeply; a scene has no more than a few levels") from None
    scene = scene.placed(source, path.parent, folders)
    scene.read_named()
    for at, shape in scene.all_shapes():
        if isinstance(shape, Mesh) and shape.file is not None and (mesh := scene.mesh_of(at, shape)).left_out:
            # Others of its files are read whole as well, or refused
            where = f"{source}: {place((*at, 'file'))}: {quoted(shape.file)}"
            raise SceneError(f"{where}: {mesh.warning}; export it again")
    return scene


def builtin_names() -> dict[str, str]:
    """Built-in scenes.

    Returns
    -------
    dict
        Name to a description of one line, sorted by name.
    """
    names = {}
    for path in sorted(scenes_folder().glob("*.toml")):
        with path.open(encoding="utf-8") as file:
            names[path.stem] = file.readline().lstrip("# ").rstrip()
    return names


def _builtin(name: str) -> Path | None:
    """File of the built-in scene of this name; None if there is none."""
    path = scenes_folder() / f"{name}.toml"
    return path if _BUILTIN.fullmatch(name) and path.is_file() else None


def _located(path_or_name: str | Path) -> Path:
    """Path of the file or built-in scene."""
    text = str(path_or_name)
    builtin = isinstance(path_or_name, str) and _BUILTIN.fullmatch(text)
    if builtin and (named := _builtin(text)) is not None:
        return named
    path = Path(path_or_name)
    if path.suffix.lower() in (".toml", ".json"):
        return path
    with suppress(OSError):  # of a name that no file can have
        if path.is_dir():
            raise SceneError(f"{quoted(text)} is a folder; name a scene file in it")
        for found in (path.with_name(f"{path.name}{ending}") for ending in (".toml", ".json") if path.name):
            if found.is_file():
                raise SceneError(f"{quoted(text)} is no scene; did you mean {quoted(str(found))}?")
        if isinstance(path_or_name, Path) and not path.exists() and (named := _builtin(text)) is not None:
            return named
    if builtin and not path.exists():
        known = suggestion(text, builtin_names()) or "; `clrender scenes` lists them; files have endings"
        raise SceneError(f"there is no built-in scene {quoted(text)}{known}")
    cure = "name a scene or model file with its ending, or a built-in scene (`clrender scenes`)"
    raise SceneError(f"{quoted(text)} is no scene: {cure}")


def parsed_file(path: Path, source: str, what: str = "the scene file") -> Any:
    """Content of a TOML or JSON file, as Python's built-in types.

    Parameters
    ----------
    path : pathlib.Path
        JSON if it ends in ``.json``.
    source : str
        Its name in messages.
    what : str
        What it is, in messages.

    Raises
    ------
    SceneError
        It cannot be read, or its syntax is wrong.
    """
    file, size = open_scene_file(path, f"{source}: {what}", SCENE_FILE_LIMIT)
    with file:
        data = file.read(size)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - (data.rfind(b"\n", 0, error.start) + 1) + 1
        where = f"{source}: line {line}, column {column}"
        raise SceneError(f"{where}: not UTF-8; save the file in that encoding") from None
    try:
        if path.suffix.lower() == ".json":
            return _from_json(text)
        long_key = _LONG_KEY.search(text)
        if long_key:
            line = text.count("\n", 0, long_key.start()) + 1
            raise SceneError(
                f"{source}: line {line}: the scene is nested too deeply; a key has no more than a few parts"
            )
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{source}: {_toml_problem(str(error), text)}") from None
    except json.JSONDecodeError as error:
        what = _lowered(error.msg)
        raise SceneError(f"{source}: line {error.lineno}, column {error.colno}: not valid JSON: {what}") from None
    except (RecursionError, MemoryError):
        raise SceneError(f"{source}: the scene is nested too deeply; a scene has no more than a few levels") from None
    except _DuplicateKey as error:
        raise SceneError(f"{source}: the key {error} is given twice in one object; keep one of them") from None
    except ValueError:
        # Both parsers convert integers with int(), which refuses thousands of digits.
        raise SceneError(
            f"{source}: the scene holds a number with too many digits; write it as 1e300 or shorter"
        ) from None


def _from_json(text: str) -> Any:
    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table = dict(pairs)
        if len(table) != len(pairs):
            seen: set[str] = set()
            for key, _ in pairs:
                if key in seen:
                    raise _DuplicateKey(quoted(key))
                seen.add(key)
        return table

    return json.loads(text, object_pairs_hook=unique)


def _toml_problem(message: str, text: str) -> str:
    """The parser's message, with its position moved to the front."""
    found = _POSITION.search(message)
    if not found:
        return f"not valid TOML: {_lowered(message)}"
    line, column = found.groups()
    if line is None:
        last = text.rsplit("\n", 1)[-1]
        line, column = str(text.count("\n") + 1), str(len(last) + 1)
    return f"line {line}, column {column}: not valid TOML: {_lowered(message[: found.start()])}"


def _lowered(message: str) -> str:
    return printable(message[:1].lower() + message[1:200])
