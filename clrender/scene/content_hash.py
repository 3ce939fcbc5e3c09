"""Hash of a scene's content, independent of its location and spelling."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Set
from typing import TYPE_CHECKING, Any

from clrender.exposure import PHOTOGRAPHIC
from clrender.scene.shapes import Mesh

if TYPE_CHECKING:
    from clrender.scene.description import Scene

__all__ = ["content_sha256", "put_at"]


def content_sha256(scene: Scene, left_out: Set[str]) -> str:
    """Hash of a scene's content; files count by their content, not by their names.

    Parameters
    ----------
    scene : Scene
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
    content = scene.model_dump(mode="json", exclude=set(left_out))
    for key in PHOTOGRAPHIC:
        content.get("camera", {}).pop(key, None)
    if not scene.camera.mirrored:  # hashes in existing films predate this key
        content.get("camera", {}).pop("mirrored", None)
    if not scene.groups:  # likewise
        content.pop("groups", None)
    for index in range(len(scene.shapes)):
        content["shapes"][index].pop("name", None)
    for at, shape in scene.all_shapes():
        if at[0] == "groups":
            content["groups"][at[1]]["shapes"][at[3]].pop("name", None)
        if isinstance(shape, Mesh) and shape.file is not None:
            put_at(content, (*at, "file"), scene.mesh_of(at, shape).sha256())
    for index, instance in scene.instances():
        if instance.file is not None:
            content["shapes"][index]["transforms"] = scene.transforms(index).sha256()
    picture = scene.environment_picture()
    for light in content["lights"]:
        if light["type"] == "environment" and picture is not None:
            light["file"] = picture.sha256()
    for index, _ in scene.ies_lights():
        content["lights"][index]["file"] = scene.ies_profile(index).sha256()
    if named := scene.texture_files():
        store = scene.textures()
        for at, texture in named:
            put_at(content, at, store.picture(texture).sha256)
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def put_at(description: Any, at: tuple[str | int, ...], value: str) -> None:
    """Store a string at a path in nested tables and lists."""
    for step in at[:-1]:
        description = description[step]
    description[at[-1]] = value
