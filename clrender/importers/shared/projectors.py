"""Projectors of other renderers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from clrender.exact.matrices import length
from clrender.importers.shared.light_pictures import made_of_picture
from clrender.importers.shared.matrices import Matrix, handedness, is_affine
from clrender.importers.shared.staging import Staging
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.light_kinds import WIDEST_PICTURE

__all__ = ["projector_keys"]

Field: TypeAlias = Callable[[int, int], float]


def projector_keys(
    staging: Staging, file: str, line: int, matrix: Matrix, rightward: bool, field: Field, factor: Any = None
) -> tuple[dict[str, Any], EnvironmentPicture] | None:
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
    field : callable
        Gives the vertical field of view, degrees, for the width and height of the picture.
    factor : (3,) float64, optional
        For the picture's colours.

    Returns
    -------
    keys : dict
    picture : EnvironmentPicture
        Or None in the place of both, where the projector is left out for a fault.

    Raises
    ------
    SceneError
        As of `made_of_picture`.
    """

    def judged(picture: EnvironmentPicture) -> tuple[EnvironmentPicture, float]:
        if not is_affine(matrix):
            raise staging.fault(line, "the projector's transform cannot be inverted; give it another")
        height, width, _ = picture.pixels.shape
        if (degrees := field(width, height)) > WIDEST_PICTURE:
            sentence = f"the picture of the projector is {degrees:g} degrees high; at most {WIDEST_PICTURE:g} is known"
            raise staging.fault(line, sentence)
        return picture, degrees

    made = made_of_picture(staging, file, line, judged)
    if made is None:
        return None
    name, (picture, degrees) = made
    # Our right is forward x up = z x y, which is -x of a right-handed projector
    mirrored = (handedness(matrix) > 0.0) == rightward
    if mirrored or factor is not None:
        pixels = picture.pixels[:, ::-1] if mirrored else picture.pixels
        pixels = pixels if factor is None else pixels * np.asarray(factor, np.float32)
        picture = EnvironmentPicture.checked(np.ascontiguousarray(pixels), f"{staging.files.source}: line {line}")
        name = f"{file} ({'mirrored' if mirrored else 'balanced'})"
        staging.draft.environments[name] = picture
    keys = {
        "type": "projector",
        "position": [float(x) for x in matrix[:3, 3]],
        "direction": [float(x) for x in matrix[:3, 2] / length(matrix[:3, 2])],
        "up": [float(x) for x in matrix[:3, 1] / length(matrix[:3, 1])],
        "file": name,
        "vertical_fov": degrees,
    }
    return keys, picture
