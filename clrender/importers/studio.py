"""Light for models that have none: a grey surround, brighter from above and behind the camera, and a soft key light.

With d a direction, f forward and u = +y, the surround's radiance is 0.4 + 0.2 u·d - 0.2 f·d, of which a matt surface
with normal n returns its reflectance times 0.4 + (2/3) (0.2 u·n - 0.2 f·n): around its outline, where f·n is 0, more
than the 0.1 to 0.2 that are behind it. The key light, 3.5 times k·d to the power of 16, adds 7/18 at most, so that
white clips nowhere.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.scene import Camera
from clrender.scene.angles import sin_cos_degrees
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.values import Vector, cross, length

__all__ = ["studio_light"]

_HEIGHT: Final = 64
_EVEN, _FROM_ABOVE, _FROM_BEHIND, _KEY = 0.4, 0.2, 0.2, 3.5
_DOUBLINGS: Final = 4
"""Of the power that the cosine from the middle of the key light is raised to."""
_KEY_PLACE: Final = (-0.55, 0.65, 0.8)
"""Where the key light is, seen from the camera's target: to the left, above, and towards the camera."""


def studio_light(camera: Camera) -> EnvironmentPicture:
    """The light of a scene without any, as its camera sees it; 128 x 64 pixels.

    Parameters
    ----------
    camera : Camera
    """
    x, y, z = (a - b for a, b in zip(camera.target, camera.position, strict=True))
    forward = _unit((x, y, z))
    right = _unit(cross(forward, _unit(camera.up)))
    upward = cross(right, forward)
    aside, above, behind = _KEY_PLACE
    aside = -aside if camera.mirrored else aside
    key = [aside * r + above * u - behind * f for r, u, f in zip(right, upward, forward, strict=True)]
    toward = _unit((key[0], key[1], key[2]))
    dx, dy, dz = _directions()

    def cosine(axis: Vector) -> NDArray[np.float64]:
        return (axis[0] * dx + axis[1] * dy) + axis[2] * dz

    lobe = np.maximum(cosine(toward), 0.0)
    for _ in range(_DOUBLINGS):
        lobe = lobe * lobe
    grey = (_EVEN + _FROM_ABOVE * dy) - _FROM_BEHIND * cosine(forward) + _KEY * lobe
    return EnvironmentPicture(np.repeat(grey[:, :, None], 3, axis=2).astype(np.float32))


@lru_cache(maxsize=1)
def _directions() -> tuple[NDArray[np.float64], ...]:
    """Of the pixels' middles, each component (H, 2 H)."""
    polar = [sin_cos_degrees((row + 0.5) * 180.0 / _HEIGHT) for row in range(_HEIGHT)]
    turns = [sin_cos_degrees((column + 0.5) * 180.0 / _HEIGHT) for column in range(2 * _HEIGHT)]
    across, up = (np.array(each)[:, None] for each in zip(*polar, strict=True))
    aside, back = (np.array(each)[None, :] for each in zip(*turns, strict=True))
    return across * aside, np.broadcast_to(up, (_HEIGHT, 2 * _HEIGHT)), -(across * back)


def _unit(v: Vector) -> Vector:
    size = length(v)
    return (v[0] / size, v[1] / size, v[2] / size)
