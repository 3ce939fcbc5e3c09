"""Pictures that lights of other renderers shine by."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from clrender.errors import OutOfMemory, SceneError
from clrender.files.named import allowed_file
from clrender.importers.shared.staging import Staging
from clrender.scene.environment import EnvironmentPicture
from clrender.wording import quoted

__all__ = ["made_of_picture"]

_Made = TypeVar("_Made")


def made_of_picture(
    staging: Staging, file: str, line: int, make: Callable[[EnvironmentPicture], _Made]
) -> tuple[str, _Made] | None:
    """Read the picture of a light and make something of it, or leave out the light for a fault.

    Parameters
    ----------
    staging : Staging
    file : str
        Name of the picture in the scene.
    line : int
        Where it is named, for messages.
    make : callable
        Takes the picture. It may raise a `SceneError`.

    Returns
    -------
    name : str
        Of the picture's file, for the scene.
    made
        What `make` returned. Or None in the place of both, where there was a fault.

    Raises
    ------
    SceneError
        The picture is in a folder that is not allowed, or too large for this machine; or there is another fault, and
        the files are strict.
    """
    files, place = staging.files, f"line {line}"
    name = files.name(file, place)
    label = f"{files.source}: {place}"
    allowed_file(name, files.folder, files.allow_paths, f"{label}: {quoted(name)}")
    try:
        return name, make(EnvironmentPicture.read(name, files.folder, files.allow_paths, label))
    except OutOfMemory:
        raise
    except SceneError as fault:
        staging.draft.leave_out(fault, files.source, files.strict)
        return None
