"""Projectors of other renderers."""

from __future__ import annotations

from typing import Any

import numpy as np

from clrender.exact.matrices import length
from clrender.importers.shared.matrices import Matrix, handedness
from clrender.importers.shared.staging import Staging
from clrender.scene.environment import EnvironmentPicture

__all__ = ["projector_keys"]


def projector_keys(
    staging: Staging, file: str, line: int, matrix: Matrix, rightward: bool, factor: Any = None
) -> tuple[dict[str, Any], EnvironmentPicture]:
    """Place, directions and picture of a projector that looks along its own +z, with +y up.

    Parameters
    ----------
    staging : Staging
        The draft keeps pictures that are no file's own.
    file : str
        Name of the picture in the scene.
    line : int
        Where it is named, for messages.
    matrix : (4, 4) float64
        From the projector's space to world space.
    rightward : bool
        Whether the picture's right is at +x.
    factor : (3,) float64, optional
        For the picture's colours.

    Returns
    -------
    keys : dict
    picture : EnvironmentPicture

    Raises
    ------
    SceneError
        The picture cannot be read.
    """
    files, place = staging.files, f"line {line}"
    name = files.name(file, place)
    picture = EnvironmentPicture.read(name, files.folder, files.allow_paths, f"{files.source}: {place}")
    # Our right is forward x up = z x y, which is -x of a right-handed projector
    mirrored = (handedness(matrix) > 0.0) == rightward
    if mirrored or factor is not None:
        pixels = picture.pixels[:, ::-1] if mirrored else picture.pixels
        pixels = pixels if factor is None else pixels * np.asarray(factor, np.float32)
        picture = EnvironmentPicture.checked(np.ascontiguousarray(pixels), f"{files.source}: {place}")
        name = f"{file} ({'mirrored' if mirrored else 'balanced'})"
        staging.draft.environments[name] = picture
    keys = {
        "type": "projector",
        "position": [float(x) for x in matrix[:3, 3]],
        "direction": [float(x) for x in matrix[:3, 2] / length(matrix[:3, 2])],
        "up": [float(x) for x in matrix[:3, 1] / length(matrix[:3, 1])],
        "file": name,
    }
    return keys, picture
