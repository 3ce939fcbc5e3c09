"""Light for models that have none: a grey surround, brighter from above and behind the camera, and a soft key light.

With d a direction, f forward and u = +y, the surround's radiance is 0.4 + 0.2 u·d - 0.2 f·d. A diffuse surface with
normal n reflects its reflectance times 0.4 + (2/3) (0.2 u·n - 0.2 f·n): at its silhouette, where f·n is 0, this is more
than the 0.1 to 0.2 behind it. The key light, 3.5 (k·d)^16, adds at most 7/18, so that white does not clip.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos_degrees
from clrender.scene import Camera
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.values import Vector, cross, length

__all__ = ["studio_light"]

_HEIGHT: Final = 64
_EVEN, _FROM_ABOVE, _FROM_BEHIND, _KEY = 0.4, 0.2, 0.2, 3.5
_DOUBLINGS: Final = 4
"""Base-2 logarithm of the exponent of the key light's cosine lobe."""
_KEY_PLACE: Final = (-0.55, 0.65, 0.8)
"""Direction from the camera's target to the key light: to the left, above, and towards the camera."""


def studio_light(camera: Camera, up: Vector = (0.0, 1.0, 0.0)) -> EnvironmentPicture:
    """Environment map for a scene without light, relative to its camera; 128 x 64 pixels.

    Parameters
    ----------
    camera : Camera
    up : three floats
        Unit vector towards its brighter side.
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
    grey = (_EVEN + _FROM_ABOVE * cosine(up)) - _FROM_BEHIND * cosine(forward) + _KEY * lobe
    return EnvironmentPicture(np.repeat(grey[:, :, None], 3, axis=2).astype(np.float32))


@lru_cache(maxsize=1)
def _directions() -> tuple[NDArray[np.float64], ...]:
    """Directions of the pixel centres, each component (H, 2 H)."""
    polar = [sin_cos_degrees((row + 0.5) * 180.0 / _HEIGHT) for row in range(_HEIGHT)]
    turns = [sin_cos_degrees((column + 0.5) * 180.0 / _HEIGHT) for column in range(2 * _HEIGHT)]
    across, up = (np.array(each)[:, None] for each in zip(*polar, strict=True))
    aside, back = (np.array(each)[None, :] for each in zip(*turns, strict=True))
    return across * aside, np.broadcast_to(up, (_HEIGHT, 2 * _HEIGHT)), -(across * back)


def _unit(v: Vector) -> Vector:
    size = length(v)
    return (v[0] / size, v[1] / size, v[2] / size)
