"""The environments that a view offers: none, a constant one, a sky, or one of the files beside the scene."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from clrender.errors import SceneError, UsageError
from clrender.files.named import allowed_file
from clrender.limits import nearest, shown
from clrender.scene import Scene
from clrender.scene.light_kinds import EnvironmentLight, SunSkyLight

__all__ = ["KINDS", "environment_files", "environment_light", "environment_told", "is_environment"]

KINDS: Final = ("scene", "none", "constant", "sky", "file")

_ENDINGS: Final = (".exr", ".hdr", ".pfm")
"""Of pictures of radiance. Others that a scene could name are more likely to be its textures."""
_MOST: Final = 200
_MOST_ENTRIES: Final = 10_000
"""Entries of folders that are looked at: a scene may lie in a folder of many."""
_SKY_SCALE: Final = 0.003
"""Of the sky model: sun and sky then light a white surface to about what the exposure makes white."""
_KEPT: Final = ("visible_to_camera", "rotate_degrees", "light_group")
"""What another environment has of the one before."""


def environment_files(scene: Scene) -> list[str]:
    """Names of environment maps in the scene's folder and its subfolders, relative to it: what a page may choose.

    Only files are listed that the scene itself could name; what lies elsewhere, or is a link to there, is not.
    """
    found = []
    for path in _entries(scene.base_folder):
        name = path.relative_to(scene.base_folder).as_posix()
        try:
            allowed_file(name, scene.base_folder, (), name)
        except SceneError:
            continue
        found.append(name)
    return sorted(found, key=lambda name: (name.count("/"), name))[:_MOST]


def _entries(folder: Path) -> Iterator[Path]:
    """Files with such endings in a folder and in its folders, which themselves are not links."""
    left, folders = _MOST_ENTRIES, [folder]
    for depth in (0, 1):
        below: list[Path] = []
        for each in folders:
            try:
                with os.scandir(each) as entries:
                    for entry in entries:
                        if (left := left - 1) < 0:
                            return
                        if depth == 0 and entry.is_dir(follow_symlinks=False) and not entry.name.startswith("."):
                            below.append(Path(entry.path))
                        elif Path(entry.name).suffix.lower() in _ENDINGS and entry.is_file():
                            yield Path(entry.path)
            except OSError:
                continue
        folders = below


def is_environment(part: object) -> bool:
    """Whether a light is an environment, of which a scene has one at most."""
    return isinstance(part, EnvironmentLight | SunSkyLight)


def environment_told(light: Any) -> dict[str, Any]:
    """What a page is told of an environment: its kind, and the file, if it is one."""
    file = getattr(light, "file", None)
    kind = "sky" if isinstance(light, SunSkyLight) else "constant" if file is None else "file"
    return {"kind": kind, "file": file}


def environment_light(kind: str, file: str, scene: Scene, before: Any, stops: float) -> EnvironmentLight | SunSkyLight:
    """An environment of a kind of `KINDS`, but ``scene`` and ``none``.

    Parameters
    ----------
    kind : str
    file : str
        One of `environment_files`, for ``file``.
    scene : Scene
    before : EnvironmentLight, SunSkyLight or None
        Which it replaces.
    stops : float
        Exposure of the camera: what is not a file is as bright as it makes white.

    Raises
    ------
    UsageError
        There is no such file among those that are listed.
    """
    kept = {key: getattr(before, key) for key in _KEPT if before is not None and key in before.model_fields_set}
    if kind == "sky":
        scale = float(f"{_SKY_SCALE * 2.0**-stops:.4g}")
        return SunSkyLight(type="sun_sky", sun_direction=(0.5, 0.7, 0.5), scale=(scale,) * 3, **kept)
    if kind == "constant":
        radiance = float(f"{2.0**-stops:.4g}")
        return EnvironmentLight(type="environment", radiance=(radiance,) * 3, **kept)
    known = environment_files(scene)
    if file not in known:
        raise UsageError(f"there is no environment map {shown(file)} beside the scene{nearest(file, known)}")
    return EnvironmentLight(type="environment", file=file, **kept)
