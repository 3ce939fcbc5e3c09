"""Lights that are no shapes as LuxCore's."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.exact.angles import arccosine, sin_cos_degrees
from clrender.exact.matrices import length, product
from clrender.exporters.luxcore_text import Properties
from clrender.exporters.luxcore_textures import TextureWriter
from clrender.exporters.skies import sky_map
from clrender.exporters.target import LAMPS, Target
from clrender.exporters.triangles import At
from clrender.importers.shared.matrices import rotation
from clrender.scene import (
    DirectionalLight,
    EnvironmentLight,
    PointLight,
    SpotLight,
    SunSkyLight,
)

__all__ = ["LightWriter"]

_MAP: Final = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From the directions of LuxCore's maps, whose upper edge is at +z and whose middle is at -x, to ours."""


class LightWriter:
    """Writes lights.

    Parameters
    ----------
    target : Target
    properties : dict
        Where they are written.
    textures : TextureWriter
    """

    def __init__(self, target: Target, properties: Properties, textures: TextureWriter) -> None:
        self._target, self._properties, self._textures = target, properties, textures

    def write(self) -> None:
        """All lights of the scene that are no shapes."""
        for index, light in enumerate(self._target.scene.lights):
            values = self._light(light, ("lights", index))
            if values is not None:
                name = self._target.id("light", str(values["type"]))
                plain = {"color": [1.0] * 3, "gain": [1.0] * 3, "power": 0.0, "efficency": 0.0}
                self._properties.update({f"scene.lights.{name}.{key}": each for key, each in (plain | values).items()})

    def _light(self, light: Any, at: At) -> Properties | None:
        if isinstance(light, PointLight):
            # LuxCore's is of the flux, whatever the unit
            gain = [4.0 * math.pi] * 3
            return {"type": "point", "position": light.position, "color": light.intensity, "gain": gain}
        if isinstance(light, DirectionalLight):
            return {"type": "sharpdistant", "direction": light.direction, "color": light.irradiance}
        if isinstance(light, SpotLight):
            return self._spot(light, at)
        if isinstance(light, SunSkyLight):
            pixels, sunny = sky_map(self._target.scene, light)
            if sunny:
                self._target.leave_out("the edge of the sun, which is drawn into a map of sky and ground", *at)
            return self._map("sky", pixels, (1.0, 1.0, 1.0), light.sun_turn)
        if isinstance(light, EnvironmentLight):
            if light.file is None:
                return {"type": "constantinfinite", "color": light.constant}
            picture = self._target.scene.environment_picture()
            assert picture is not None
            return self._map("environment", picture.pixels, light.scale, light.rotate_degrees)
        self._target.leave_out(LAMPS[type(light)], *at)
        return None

    def _spot(self, light: SpotLight, at: At) -> Properties | None:
        half = light.cone_degrees / 2.0
        if half >= 180.0:
            self._target.leave_out("cones of 360 degrees", *at)
            return None
        edge = sin_cos_degrees(half)[1]
        inner = math.degrees(arccosine(min(edge + light.blend * (1.0 - edge), 1.0)))
        sentence = "the fall of spots, which is a fourth power, after a growth by 1 / cosine off the axis"
        self._target.leave_out(sentence, *at)
        towards = np.array(light.position) + np.array(light.direction) / length(light.direction)
        cone = {"coneangle": half, "conedeltaangle": half - inner}
        return {"type": "spot", "position": light.position, "target": towards, "color": light.intensity, **cone}

    def _map(self, stem: str, pixels: NDArray[np.float32], scale: Any, degrees: float) -> Properties:
        """An environment map, turned about +y."""
        turned = product(rotation((0.0, 1.0, 0.0), degrees), _MAP)
        values = {"file": self._textures.files.made(stem, pixels), "gamma": 1.0, "gain": scale}
        return {"type": "infinite", **values, "transformation": turned.T, "visibilitymapcache.enable": False}
