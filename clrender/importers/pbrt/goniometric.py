"""pbrt's goniometric lights: a picture of radiant intensity by direction becomes a table like that of an IES file."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.elementary import sines_cosines
from clrender.exact.matrices import inner, inverse, length, lengths, times, total
from clrender.image.exposure import LUMENS_PER_WATT
from clrender.importers.shared.light_pictures import made_of_picture
from clrender.importers.shared.matrices import Matrix, is_similarity
from clrender.importers.shared.sky_maps import square_place
from clrender.importers.shared.staging import Staging
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.ies import IesProfile
from clrender.scene.values import cross

__all__ = ["goniometric_keys"]

_LEAST_STEPS: Final = 36
_MOST_STEPS: Final = 360
"""From pole to pole of the table."""


def goniometric_keys(staging: Staging, file: str, line: int, matrix: Matrix) -> tuple[dict[str, Any], float] | None:
    """Place, directions and table of a light whose intensity is a picture: an equal-area square around its +y axis.

    Parameters
    ----------
    staging : Staging
        The draft keeps the table.
    file : str
        Name of the picture in the scene. The mean of its channels counts.
    line : int
        Where it is named, for messages.
    matrix : (4, 4) float64
        From the light's space to world space; it can be inverted.

    Returns
    -------
    keys : dict
        Of an IES light whose intensity is that of the picture, W/sr.
    mean : float
        Of the picture: the light's flux is 4 pi times as much.
        Or None in the place of both, where the light is left out for a fault.

    Raises
    ------
    SceneError
        As of `made_of_picture`.
    """
    axis, zero = (_unit(times(matrix[:3, :3], along)) for along in ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]))
    zero = _unit(zero - inner(zero, axis) * axis)

    def table_of(picture: EnvironmentPicture) -> tuple[IesProfile, float]:
        height, width, _ = picture.pixels.shape
        if height != width:
            sentence = f"the picture of the light has {width} by {height} pixels; it must be as wide as high"
            raise staging.fault(line, sentence)
        values = inner(picture.pixels.astype(np.float64), np.full(3, 1.0 / 3.0))
        mean = float(total(total(values))) / (width * height)
        if mean <= 0.0:
            raise staging.fault(line, "the picture of the light is black; give it another")
        back = inverse(matrix[:3, :3])
        try:
            return _profile(values, back, axis, zero, mean if is_similarity(matrix) else None), mean
        except ValueError:
            raise staging.fault(line, "the picture of the light is too bright; give it a smaller scale") from None

    made = made_of_picture(staging, file, line, table_of)
    if made is None:
        return None
    _, (profile, mean) = made
    # A number, as the lines of a file that is included twice say nothing
    table = f"{file} (goniometric {len(staging.draft.profiles) + 1})"
    staging.draft.profiles[table] = profile
    keys = {
        "type": "ies",
        "position": [float(x) for x in times(matrix, [0.0, 0.0, 0.0, 1.0])[:3]],
        "direction": [float(x) for x in axis],
        "horizontal_zero": [float(x) for x in zero],
        "file": table,
    }
    return keys, mean


def _profile(
    values: NDArray[np.float64], back: Any, axis: NDArray[np.float64], zero: NDArray[np.float64], mean: float | None
) -> IesProfile:
    """The picture (n, n) in steps of half a texel, scaled to its mean; `back` leads from the world to the light."""
    count = len(values)
    steps = min(max(2 * count, _LEAST_STEPS), _MOST_STEPS)
    side = np.array(cross(zero.tolist(), axis.tolist()))  # an IES file's horizontal angles increase in this way
    degrees = np.arange(2 * steps + 1, dtype=np.float64) * (180.0 / steps)
    sin_theta, cos_theta = sines_cosines(np.arange(steps + 1) / steps * np.pi)
    sin_phi, cos_phi = sines_cosines(np.arange(2 * steps + 1) / steps * np.pi)
    intensity = np.empty((steps + 1, 2 * steps + 1))
    around = cos_phi[:, None] * zero + sin_phi[:, None] * side
    for row in range(steps + 1):
        own = times(back, cos_theta[row] * axis + sin_theta[row] * around)
        own /= lengths(own)[:, None]
        # The square's middle is at +y: pbrt exchanges y and z of directions
        u, v = square_place(own[:, [0, 2, 1]])
        column, line = (np.clip((at * count).astype(np.int64), 0, count - 1) for at in (u, v))
        intensity[row] = values[line, column]
    intensity[:, -1] = intensity[:, 0]
    candela = intensity * LUMENS_PER_WATT
    if mean is not None:
        weights = np.maximum(sin_theta, 0.0)
        found = float(total(total(weights[:, None] * intensity[:, :-1]))) / (float(total(weights)) * 2 * steps)
        candela *= mean / found if found > 0.0 else 1.0
    return IesProfile.checked(degrees[: steps + 1], degrees, candela, np.zeros((2, 0)))


def _unit(vector: Any) -> NDArray[np.float64]:
    return np.asarray(vector, np.float64) / length(vector)
