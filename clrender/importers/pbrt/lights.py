"""Converts pbrt's lights to ours."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import sin_cos, tangent
from clrender.exact.matrices import inner, times, total
from clrender.importers.pbrt.film import Exposure
from clrender.importers.pbrt.goniometric import goniometric_keys
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.textures import TextureReader
from clrender.importers.shared.cameras import vertical_angle
from clrender.importers.shared.matrices import Matrix
from clrender.importers.shared.projectors import projector_keys
from clrender.importers.shared.sky_maps import height_in_square, map_pixels, unfolded_picture
from clrender.importers.shared.staging import Staging
from clrender.scene.environment import EnvironmentPicture
from clrender.spectra.colors import LUMINANCE
from clrender.wording import quoted

__all__ = ["LightReader"]


class LightReader:
    """Converts lights.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    """

    def __init__(self, staging: Staging, textures: TextureReader) -> None:
        self._staging, self._textures = staging, textures
        self.exposure = Exposure()
        """What the film makes of all light."""

    def read(self, kind: str, parameters: Parameters, matrix: Matrix) -> None:
        """Add a light.

        Parameters
        ----------
        kind : str
        parameters : Parameters
        matrix : (4, 4) float64
            From the light's space to world space.
        """
        known: dict[str, Callable[[Parameters, Matrix], dict[str, Any] | None]] = {
            "point": self._point,
            "spot": self._spot,
            "distant": self._distant,
            "infinite": self._infinite,
            "projection": self._projection,
            "goniometric": self._goniometric,
        }
        if kind not in known:
            self._staging.note(f"a light of type {quoted(kind)} is not known and left out")
            return
        made = known[kind](parameters, matrix)
        if made is None:
            return
        for unknown in parameters.unused():
            self._staging.note(
                f"{quoted(unknown)} of a light of type {quoted(kind)} is not understood and does nothing"
            )
        lights = self._staging.draft.description["lights"]
        if made["type"] == "environment" and any(light["type"] == "environment" for light in lights):
            raise parameters.fault("is a second infinite light, but a scene can have only one; remove one")
        lights.append(made)

    def _shining(self, parameters: Parameters, name: str, factor: float) -> Any:
        """A colour, or a spectrum, which the white balance of a film cannot change."""
        scale = parameters.number("scale", 1.0) * factor * self.exposure.ratio
        color = self._color(parameters, name, factor)
        return (self.exposure.balance is None and self._textures.spectrum_of_light(parameters, name, scale)) or color

    def _color(self, parameters: Parameters, name: str, factor: float) -> list[float]:
        scale = parameters.number("scale", 1.0) * factor * self.exposure.ratio
        return [max(float(x) * scale, 0.0) for x in self.exposure.balanced(self._textures.light(parameters, name))]

    def _point(self, parameters: Parameters, matrix: Matrix) -> dict[str, Any]:
        power = parameters.number("power", -1.0)
        place = times(matrix, [*parameters.vector("from", (0.0, 0.0, 0.0)), 1.0])
        intensity = self._shining(parameters, "I", power / (4.0 * math.pi) if power > 0.0 else 1.0)
        return {"type": "point", "position": [float(x) for x in place[:3]], "intensity": intensity}

    def _spot(self, parameters: Parameters, matrix: Matrix) -> dict[str, Any]:
        start, end = parameters.vector("from", (0.0, 0.0, 0.0)), parameters.vector("to", (0.0, 0.0, 1.0))
        cone, delta = parameters.number("coneangle", 30.0), parameters.number("conedeltaangle", 5.0)
        if not 0.0 < cone < 180.0:
            raise parameters.fault(f'"coneangle" is {cone:g}, but must be above 0 and below 180 degrees', "coneangle")
        edge, inner = (sin_cos(math.radians(degrees))[1] for degrees in (cone, max(cone - delta, 0.0)))
        power = parameters.number("power", -1.0)
        # For a cone with a smoothstep falloff, whose mean is one half (PBR 4ed, 12.2.2)
        flux = 2.0 * math.pi * ((1.0 - inner) + (inner - edge) / 2.0)
        return {
            "type": "spot",
            "position": [float(x) for x in times(matrix, [*start, 1.0])[:3]],
            "direction": [float(x) for x in times(matrix[:3, :3], end - start)],
            "intensity": self._shining(parameters, "I", power / flux if power > 0.0 else 1.0),
            "cone_degrees": 2.0 * cone,
            "blend": min(max((inner - edge) / (1.0 - edge), 0.0), 1.0),
        }

    def _distant(self, parameters: Parameters, matrix: Matrix) -> dict[str, Any]:
        start, end = parameters.vector("from", (0.0, 0.0, 0.0)), parameters.vector("to", (0.0, 0.0, 1.0))
        lux = parameters.number("illuminance", -1.0)
        irradiance = self._shining(parameters, "L", lux if lux > 0.0 else 1.0)
        # pbrt's light shines in the direction from `from` to `to`
        direction = [float(x) for x in times(matrix[:3, :3], end - start)]
        return {"type": "directional", "direction": direction, "irradiance": irradiance}

    def _projection(self, parameters: Parameters, matrix: Matrix) -> dict[str, Any] | None:
        """Its picture is a radiant intensity, whatever the direction."""
        file = parameters.text("filename")
        if not file:
            self._staging.note('a light of type "projection" without a picture is left out')
            return None
        degrees, power = parameters.number("fov", 90.0), parameters.number("power", -1.0)
        if not 0.0 < degrees < 180.0:
            raise parameters.fault(f'"fov" is {degrees:g}, but must be above 0 and below 180 degrees', "fov")
        line, balance = parameters.values["filename"].line, self.exposure.balance
        factor = None if balance is None else self.exposure.balanced(np.ones(3))
        made = projector_keys(
            self._staging, file, line, matrix, True, partial(vertical_angle, degrees, "smaller"), factor
        )
        if made is None:
            return None
        keys, picture = made
        scale = parameters.number("scale", 1.0) * self.exposure.ratio
        if power > 0.0:
            scale *= power / max(_flux(picture, keys["vertical_fov"]), 1e-30)
        return {**keys, "even": False, "scale": [max(scale, 0.0)] * 3}

    def _goniometric(self, parameters: Parameters, matrix: Matrix) -> dict[str, Any] | None:
        file, power = parameters.text("filename"), parameters.number("power", -1.0)
        if not file:
            self._staging.note('a light of type "goniometric" without a picture is left out')
            return None
        made = goniometric_keys(self._staging, file, parameters.values["filename"].line, matrix)
        if made is None:
            return None
        keys, mean = made
        return {**keys, "scale": self._color(parameters, "I", power / (4.0 * math.pi * mean) if power > 0.0 else 1.0)}

    def _infinite(self, parameters: Parameters, matrix: Matrix) -> dict[str, Any]:
        lux = parameters.number("illuminance", -1.0)
        if parameters.get("portal") is not None:
            self._staging.note("the portal of an infinite light is left out: it shines from all sides, too")
        file = parameters.text("filename")
        if not file:
            return {
                "type": "environment",
                "radiance": self._shining(parameters, "L", lux / math.pi if lux > 0.0 else 1.0),
            }
        line = parameters.values["filename"].line
        name = self._staging.files.name(file, f"line {line}")
        pixels = map_pixels(self._staging.files, name, f"line {line}")
        picture = unfolded_picture(pixels, matrix, f"{self._staging.files.source}: line {line}")
        factor = 1.0
        if lux > 0.0:
            found = _illuminance(pixels)
            if found > 0.0:
                factor = lux / found
            else:
                self._staging.note("the illuminance of an infinite light, whose picture is black about +z, is left out")
        if self.exposure.balance is not None:
            pixels = self.exposure.balanced(picture.pixels).astype(np.float32)
            picture = EnvironmentPicture.checked(pixels, f"{self._staging.files.source}: line {line}")
        scale = parameters.number("scale", 1.0) * factor * self.exposure.ratio
        self._staging.draft.environments[f"{file} (unfolded)"] = picture
        return {"type": "environment", "file": f"{file} (unfolded)", "scale": [max(scale, 0.0)] * 3}


def _flux(picture: EnvironmentPicture, vertical_fov: float) -> float:
    """Flux, as luminance, of a projector whose radiant intensity is its picture."""
    height, width, _ = picture.pixels.shape
    top = tangent(math.radians(vertical_fov) / 2.0)
    y, x = (((np.arange(count) + 0.5) / count * 2.0 - 1.0) * top for count in (height, width))
    x = x * (width / height)
    squares = 1.0 + (y * y)[:, None] + (x * x)[None, :]
    bright = np.array([inner(row, LUMINANCE) for row in picture.pixels])
    area = (2.0 * top / height) * (2.0 * top / height)
    return float(total(total(bright / (squares * np.sqrt(squares)) * area)))


def _illuminance(pixels: NDArray[np.float32]) -> float:
    """pbrt's measure of a square environment map: half the irradiance, as luminance, of a surface that faces +z.

    It is that of the picture, whatever the light's transform. Each pixel counts as if the half sphere had as many as
    the whole one has, so that lights of a given ``illuminance`` are twice as bright there as they should be, and here.
    """
    height, width, _ = pixels.shape
    u, v = ((np.arange(count) + 0.5) / count for count in (width, height))
    found = 0.0
    for row, at in zip(pixels, v, strict=True):
        found += float(total(inner(row, LUMINANCE) * np.maximum(height_in_square(u, at), 0.0)))
    return float(found * (2.0 * math.pi / (width * height)))
