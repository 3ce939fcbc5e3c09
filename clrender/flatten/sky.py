"""Sun and sky: an environment map of sky and ground, and the sun's disc."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.angles import sin_cos_degrees
from clrender.exact.elementary import arctangent
from clrender.flatten.sky_model import SUN_DEGREES, sky_radiance, sun_disc
from clrender.scene.environment import EnvironmentPicture
from clrender.scene.light_kinds import SunSkyLight
from clrender.scene.values import Color, Vector

if TYPE_CHECKING:
    from clrender.scene.description import Scene

__all__ = ["Sun", "scene_sun", "sky_picture"]

_WIDTH: Final = 1024
_HEIGHT: Final = 512
_LUMINANCE: Final = (0.2126, 0.7152, 0.0722)
_WORDS: Final = {name: (at, size) for name, at, size, _ in layout.ROWS["SUN"]}
_TABLE_WORDS: Final = 32

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Sun:
    """The sun as a light.

    Attributes
    ----------
    axis : (3,) float
        Unit vector towards its centre.
    mean : (3,) float
        Mean radiance of the disc, whose part below the horizon is black.
    spread : float
        1 - cosine of its angular radius.
    darkening : (3, 6) float64
        See `clrender.flatten.sky_model.SunDisc`.
    """

    axis: Vector
    mean: Color
    spread: float
    darkening: _Floats

    @property
    def words(self) -> NDArray[np.float32]:
        """Its table, as `kernels/light/sun.h` reads it; the index of its light is left to be filled in."""
        words = np.zeros(_TABLE_WORDS, np.float32)
        parts = {"RED": self.darkening[0], "GREEN": self.darkening[1], "BLUE": self.darkening[2]}
        for name, values in {**parts, "AXIS": self.axis, "SPREAD": self.spread}.items():
            at, size = _WORDS[name]
            words[at : at + size] = values
        return words


def scene_sun(scene: Scene) -> Sun | None:
    """The sun of a scene; None if there is none, or it is black."""
    light = scene.sky
    if light is None:
        return None
    disc = sun_disc(light.sun_elevation, light.turbidity)
    scale = _product(light.sun_scale, light.scale)
    share = _above_horizon(light.sun_elevation)
    red, green, blue = (mean * s * share for mean, s in zip(disc.mean, scale, strict=True))
    if sum(weight * each for weight, each in zip(_LUMINANCE, (red, green, blue), strict=True)) == 0.0:
        return None
    return Sun(light.sun_axis, (red, green, blue), _spread(), disc.darkening * np.array(scale)[:, None])


def sky_picture(light: SunSkyLight) -> EnvironmentPicture | None:
    """Environment map of sky and ground, with the sun's azimuth in the middle column; None if all is black.

    Returns
    -------
    EnvironmentPicture or None
        1024 x 512 pixels.
    """
    sky, sun = _product(light.sky_scale, light.scale), _product(light.sun_scale, light.scale)
    return _picture(light.sun_elevation, light.turbidity, light.ground_albedo, light.ground, sky, sun)


@lru_cache(maxsize=4)
def _picture(
    elevation: float, turbidity: float, albedo: Color, ground: bool, sky_scale: Color, sun_scale: Color
) -> EnvironmentPicture | None:
    upper = _upper(elevation, turbidity, albedo) * np.array(sky_scale)[:, None, None]
    pixels = np.zeros((_HEIGHT, _WIDTH, 3))
    half = _WIDTH // 2
    pixels[: _HEIGHT // 2, half:] = upper.transpose(1, 2, 0)
    pixels[: _HEIGHT // 2, :half] = pixels[: _HEIGHT // 2, : half - 1 : -1]
    if ground:
        disc = sun_disc(elevation, turbidity)
        rise = sin_cos_degrees(elevation)[0]
        sun = 2.0 * math.pi * _spread() * _above_horizon(elevation) * rise
        for channel in range(3):
            irradiance = _irradiance(upper[channel]) + disc.mean[channel] * sun_scale[channel] * sun
            pixels[_HEIGHT // 2 :, :, channel] = albedo[channel] * irradiance / math.pi
    return EnvironmentPicture(pixels.astype(np.float32)) if pixels.any() else None


def _upper(elevation: float, turbidity: float, albedo: Color) -> _Floats:
    """Radiance at the pixel centres above the horizon, (3, H / 2, W / 2), from the sun's azimuth to its opposite."""
    polar = [sin_cos_degrees((row + 0.5) * 180.0 / _HEIGHT) for row in range(_HEIGHT // 2)]
    turns = [sin_cos_degrees((column + 0.5) * 360.0 / _WIDTH) for column in range(_WIDTH // 2)]
    across, up = (np.array(each)[:, None] for each in zip(*polar, strict=True))
    aside, ahead = (np.array(each)[None, :] for each in zip(*turns, strict=True))
    rise, level = sin_cos_degrees(elevation)
    x, y, z = across * aside, up - rise, across * ahead - level
    apart = np.minimum(x * x + y * y + z * z, 4.0)
    return sky_radiance(elevation, turbidity, albedo, np.broadcast_to(up, apart.shape), apart)


def _irradiance(upper: _Floats) -> float:
    """Irradiance of the ground from the upper half of the map: each row is a ring between two zenith angles."""
    sines = np.array([sin_cos_degrees(row * 180.0 / _HEIGHT)[0] for row in range(_HEIGHT // 2 + 1)])
    means = np.cumsum(upper, axis=1)[:, -1] / upper.shape[1]
    return math.pi * math.fsum((means * np.diff(sines * sines)).tolist())


def _spread() -> float:
    sine = sin_cos_degrees(SUN_DEGREES / 2.0)[0]
    return 2.0 * sine * sine


def _above_horizon(elevation: float) -> float:
    """Fraction of the disc's area above the horizon."""
    t = elevation / SUN_DEGREES
    if t >= 1.0:
        return 1.0
    root = math.sqrt(1.0 - t * t)
    angle = 2.0 * float(arctangent(np.array([t / (1.0 + root)]))[0])
    return 0.5 + (angle + t * root) / math.pi


def _product(a: Color, b: Color) -> Color:
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])
