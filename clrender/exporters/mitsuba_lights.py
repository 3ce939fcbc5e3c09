"""Lights that are no shapes as Mitsuba's emitters."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import arccosine, sin_cos_degrees, tan_degrees
from clrender.exact.elementary import angles_of
from clrender.exact.matrices import length
from clrender.exporters.mitsuba_textures import TextureWriter
from clrender.exporters.mitsuba_xml import Element, element, spectral, transform, value
from clrender.exporters.skies import sky_map
from clrender.exporters.target import LAMPS, Target
from clrender.flatten.sky import scene_sun
from clrender.importers.shared.matrices import look_at, rotation
from clrender.scene import DirectionalLight, EnvironmentLight, PointLight, SpotLight, SunSkyLight
from clrender.scene.light_kinds import ProjectorLight
from clrender.scene.spectra import SpectralColor

__all__ = ["SKY_NANOMETRES", "LightWriter"]

SKY_NANOMETRES: Final = 106.75
"""Mitsuba divides the sky model's RGB radiance by this, clrender does not."""
_SPOT_SIDE: Final = 512
_WIDEST: Final = 75.0
"""Degrees of half a cone, beyond which a picture of the cone has too few texels at its edge."""


class LightWriter:
    """Writes lights.

    Parameters
    ----------
    target : Target
    textures : TextureWriter
    """

    def __init__(self, target: Target, textures: TextureWriter) -> None:
        self._target, self._textures = target, textures

    def lights(self) -> list[Element]:
        """All lights of the scene that are no shapes."""
        made = (self._light(light, ("lights", index)) for index, light in enumerate(self._target.scene.lights))
        return [each for each in made if each is not None]

    def _light(self, light: Any, at: tuple[str | int, ...]) -> Element | None:
        if isinstance(light, PointLight):
            place = value("point", "position", light.position)
            return element("emitter", place, spectral("intensity", light.intensity), type="point")
        if isinstance(light, DirectionalLight):
            along = value("vector", "direction", light.direction)
            return element("emitter", along, spectral("irradiance", light.irradiance), type="directional")
        if isinstance(light, SpotLight):
            return self._spot(light, at)
        if isinstance(light, SunSkyLight):
            return self._sky(light, at)
        if isinstance(light, EnvironmentLight):
            if light.file is None:
                return element("emitter", _around(light), type="constant")
            return self._environment(light)
        if isinstance(light, ProjectorLight):
            return self._projector(light, at)
        self._target.leave_out(LAMPS[type(light)], *at)
        return None

    # --- spots

    def _spot(self, light: SpotLight, at: tuple[str | int, ...]) -> Element | None:
        """A spot whose picture makes Mitsuba's fall, linear in the angle, a smooth step in the cosine."""
        half = light.cone_degrees / 2.0
        edge = sin_cos_degrees(half)[1]
        inner = min(math.degrees(arccosine(min(edge + light.blend * (1.0 - edge), 1.0))), 0.9999 * half)
        axis = np.array(light.direction) / length(light.direction)
        across = np.eye(3)[int(np.abs(axis).argmin())]
        origin = np.array(light.position)
        inside = [
            transform(look_at(origin, origin + axis, across)),
            spectral("intensity", light.intensity),
            value("float", "cutoff_angle", half),
            value("float", "beam_width", inner),
        ]
        if half >= 180.0:
            self._target.leave_out("cones of 360 degrees", *at)
            return None
        if half > _WIDEST:
            if light.blend > 0.0:
                self._target.leave_out("the shape of the fall of wide spots, which is linear in the angle", *at)
        elif light.blend > 0.0:
            inside.append(self._fall(half, inner, light.blend))
        return element("emitter", *inside, type="spot")

    def _fall(self, half: float, inner: float, blend: float) -> Element:
        """Picture of the ratio of the two falls over the square around the cone.

        It is above 1 in places, and so no reflectance, which Mitsuba makes of pictures where it renders wavelengths: it
        refuses such spots there.
        """
        edge = sin_cos_degrees(half)[1]
        across = ((np.arange(_SPOT_SIDE) + 0.5) / _SPOT_SIDE * 2.0 - 1.0) * tan_degrees(half)
        square = across[:, None] * across[:, None] + across[None, :] * across[None, :]
        cosine = 1.0 / np.sqrt(1.0 + square)
        t = np.clip((cosine - edge) / (blend * (1.0 - edge)), 0.0, 1.0)
        angle = angles_of(np.sqrt(square), np.ones_like(square)) * (180.0 / math.pi)
        linear = np.clip((half - angle) / (half - inner), 0.0, 1.0)
        ratio = np.divide(t * t * (3.0 - 2.0 * t), linear, out=np.zeros_like(t), where=linear > 1e-6)
        name = self._textures.files.made("spot", ratio[..., None].astype(np.float32))
        inside = [value("string", "filename", name), value("boolean", "raw", True)]
        return element("texture", *inside, value("string", "wrap_mode", "clamp"), type="bitmap", name="texture")

    # --- projectors

    def _projector(self, light: ProjectorLight, at: tuple[str | int, ...]) -> Element:
        """Mitsuba's lights a screen evenly; a picture of directions, and a factor with a colour, go into its pixels."""
        pixels = self._target.scene.light_picture(self._target.scene.lights.index(light)).pixels
        height, width, _ = pixels.shape
        top = tan_degrees(light.vertical_fov / 2.0)
        factor = np.array(light.scale) / math.pi
        if not light.even:
            y, x = (((np.arange(count) + 0.5) / count * 2.0 - 1.0) * top for count in (height, width))
            squares = 1.0 + (y * y)[:, None] + (x * (width / height) * (x * (width / height)))[None, :]
            pixels = pixels / (squares * np.sqrt(squares))[..., None]
            self._target.leave_out("the fall of intensity within the pixels of a projector", *at)
        name = self._textures.files.made("projector", (pixels * factor).astype(np.float32))
        inside = [value("string", "filename", name)]  # of floats, which are linear
        picture = element("texture", *inside, value("string", "wrap_mode", "clamp"), type="bitmap", name="irradiance")
        origin = np.array(light.position)
        axis = np.array(light.direction) / length(light.direction)
        place = transform(look_at(origin, origin + axis, np.array(light.up)))
        field = (value("string", "fov_axis", "y"), value("float", "fov", light.vertical_fov))
        return element("emitter", place, picture, *field, type="projector")

    # --- environments

    def _map(self, stem: str, pixels: NDArray[np.float32], scale: Any, degrees: float) -> Element:
        """An environment map, turned about +y; a factor with a colour goes into its pixels."""
        grey = len(set(scale)) == 1
        pixels = _from_pole_to_pole(pixels)
        pixels, factor = (pixels, scale[0]) if grey else (pixels * np.array(scale, np.float32), 1.0)
        inside = [value("string", "filename", self._textures.files.made(stem, pixels)), value("float", "scale", factor)]
        inside += [transform(rotation((0.0, 1.0, 0.0), degrees))] if degrees else []
        return element("emitter", *inside, type="envmap")

    def _environment(self, light: EnvironmentLight) -> Element:
        picture = self._target.scene.environment_picture()
        assert picture is not None and light.file is not None
        return self._map("environment", picture.pixels, light.scale, light.rotate_degrees)

    def _sky(self, light: SunSkyLight, at: tuple[str | int, ...]) -> Element | None:
        """Mitsuba's own sky where it is the same one; else a map of sky, ground and sun."""
        scales = [a * b for a, b in zip(light.sky_scale, light.scale, strict=True)]
        if (
            scene_sun(self._target.scene) is None
            and not light.ground
            and len(set(scales)) == 1
            and light.rotate_degrees == 0.0
        ):
            upward = transform(rotation((1.0, 0.0, 0.0), -90.0))
            inside = [upward, value("vector", "sun_direction", light.sun_axis)]
            inside += [value("float", "turbidity", light.turbidity), value("rgb", "albedo", light.ground_albedo)]
            both = {"sun_scale": 0.0, "sky_scale": SKY_NANOMETRES * scales[0]}
            inside += [value("float", name, factor) for name, factor in both.items()]
            return element("emitter", *inside, type="sunsky")
        pixels, sunny = sky_map(self._target.scene, light)
        if sunny:
            self._target.leave_out("the edge of the sun, which is drawn into a map of sky and ground", *at)
        return self._map("sky", pixels, (1.0, 1.0, 1.0), light.sun_turn)


def _from_pole_to_pole(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """A map, (H, W, 3), as one of Mitsuba's, (2 H + 1, W, 3), whose first and last rows are at the poles.

    Every other row is one of ours, so that interpolation between rows is the same.
    """
    height, width, _ = pixels.shape
    made = np.empty((2 * height + 1, width, 3), np.float32)
    made[1::2] = pixels
    made[0], made[-1] = pixels[0], pixels[-1]
    made[2:-1:2] = 0.5 * pixels[:-1] + 0.5 * pixels[1:]
    return made


def _around(light: EnvironmentLight) -> Element:
    """The radiance of a constant environment: a spectrum, where that is not tinted."""
    red, green, blue = light.scale
    if isinstance(light.radiance, SpectralColor) and red == green == blue:
        return spectral("radiance", light.radiance, red)
    return value("rgb", "radiance", light.constant)
