"""Hash of a scene's content, independent of its location and spelling."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Set
from typing import Any, Final

from clrender.image.exposure import PHOTOGRAPHIC
from clrender.scene.contents import HEAD, SceneContents
from clrender.scene.former_keys import former_keys
from clrender.scene.grid_placement import grid_placement
from clrender.scene.medium import Density, Temperature
from clrender.scene.values import Part

__all__ = ["content_sha256", "names_sha256", "put_at"]

_NAMES: Final = ("name", "category", "light_group")
"""Keys of shapes, instances and lights that change no image, but layers and labels."""


def content_sha256(scene: SceneContents, left_out: Set[str]) -> str:
    """Hash of a scene's content; files count by their content, not by their names.

    Parameters
    ----------
    scene : SceneContents
    left_out : set of str
        Tables to leave out.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    SceneError
        A file cannot be read or is invalid.
    """
    head = {} if left_out >= HEAD else _head(scene)
    parts = {**head, **scene.of_contents("json", lambda: _contents(scene))}
    digest = hashlib.sha256()
    for number, name in enumerate(sorted(parts.keys() - left_out)):
        digest.update(f'{"," if number else "{"}"{name}":'.encode())
        digest.update(parts[name])
    digest.update(b"}")
    return digest.hexdigest()


def names_sha256(scene: SceneContents) -> str:
    """Hash of what layers and labels tell of a scene though its image and its `content_sha256` do not depend on it.

    These are names, categories and light groups, and the order of materials and groups, which numbers them and their
    shapes. Unlike those of `content_sha256`, the hash depends on no file.

    Parameters
    ----------
    scene : SceneContents

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    return scene.of_contents("names_sha256", lambda: _names_sha256(scene))


def _names_sha256(scene: SceneContents) -> str:
    lists: dict[str, Iterable[Part]] = {"shapes": scene.shapes, "lights": scene.lights}
    lists |= {f"groups.{name}": group.shapes for name, group in scene.groups.items()}
    named = {
        place: [(index, *found) for index, part in enumerate(parts) if any(found := _names_of(part))]
        for place, parts in lists.items()
    }
    told = {"names": named, "materials": [*scene.materials], "groups": [*scene.groups]}
    return hashlib.sha256(_json(told)).hexdigest()


def _names_of(part: Part) -> list[str | None]:
    return [getattr(part, key, None) for key in _NAMES]


def _head(scene: SceneContents) -> dict[str, bytes]:
    """Canonical JSON of each table that is not part of the contents."""
    content = scene.model_dump(mode="json", include=set(HEAD))
    for key in PHOTOGRAPHIC:
        if not isinstance(getattr(scene.camera, key), tuple):  # of a shutter, when it opens and closes
            content["camera"].pop(key, None)
    content["camera"].pop("flow_step", None)  # of layers
    if not (scene.camera.motion or scene.has_motion):  # nothing depends on time then
        for key in ("time", "rolling_shutter", *(["shutter"] if isinstance(scene.camera.shutter, tuple) else [])):
            content["camera"].pop(key, None)
    _as_in_films(scene.camera, content["camera"])
    return {name: _json(table) for name, table in content.items()}


def _contents(scene: SceneContents) -> dict[str, bytes]:
    """Canonical JSON of each table of the contents. In large scenes this takes longer than the hash."""
    content = scene.model_dump(mode="json", exclude=set(HEAD))
    if not scene.groups:  # hashes in existing films predate this key
        content.pop("groups", None)
    for index in range(len(scene.shapes)):
        _without_names(content["shapes"][index])
    for at, shape in scene.all_shapes():
        if at[0] == "groups":
            _without_names(content["groups"][at[1]]["shapes"][at[3]])
        _as_in_films(shape, _table_at(content, at))
    for at, mesh in scene.mesh_files():
        put_at(content, (*at, "file"), scene.mesh_of(at, mesh).sha256())
    for at, curves in scene.curve_files():
        put_at(content, (*at, "file"), scene.strands(at, curves).sha256())
    for name, material in scene.materials.items():
        _as_in_films(material, content["materials"][name])
    for index, instance in scene.instances():
        if instance.file is not None:
            content["shapes"][index]["transforms"] = scene.transforms(index).sha256()
        _as_in_films(instance, content["shapes"][index])
    for part, table in zip(scene.lights, content["lights"], strict=True):
        _as_in_films(part, table)
        _without_names(table)
    for index, _ in scene.pictured_lights():
        content["lights"][index]["file"] = scene.light_picture(index).sha256()
    for index, _ in scene.ies_lights():
        content["lights"][index]["file"] = scene.ies_profile(index).sha256()
    for name, medium in scene.media.items():
        _as_in_films(medium, content["media"][name])
    for (_, name, key), grid in scene.grids():
        data = scene.grid(name, key, grid)
        table = {"grid": data.sha256(), "placement": grid_placement(grid, data).tolist()}
        more = ("edges",) if isinstance(grid, Density) else ("scale", "offset") if isinstance(grid, Temperature) else ()
        content["media"][name][key] = table | {each: getattr(grid, each) for each in more}
    for name, material in scene.measured_materials():
        content["materials"][name]["file"] = scene.measured(name, material).sha256()
    if named := scene.texture_files():
        store = scene.textures()
        for at, texture in named:
            put_at(content, at, store.picture(texture).sha256)
    return {name: _json(table) for name, table in content.items()}


def _without_names(table: dict[str, Any]) -> None:
    """Take away what changes no image: names for layers."""
    for key in _NAMES:
        table.pop(key, None)


def _as_in_films(part: Part, table: dict[str, Any]) -> None:
    """Make a table that of hashes in existing films: without later keys at their defaults, and with former names."""
    for key in part.late_keys:
        if getattr(part, key) == type(part).model_fields[key].get_default():
            table.pop(key, None)
    for former, key in former_keys(type(part)).items():
        table[former] = table.pop(key)


def _json(table: Any) -> bytes:
    return json.dumps(table, sort_keys=True, separators=(",", ":")).encode()


def _table_at(description: Any, at: tuple[str | int, ...]) -> Any:
    for step in at:
        description = description[step]
    return description


def put_at(description: Any, at: tuple[str | int, ...], value: str) -> None:
    """Store a string at a path in nested tables and lists."""
    _table_at(description, at[:-1])[at[-1]] = value
