"""Converts Mitsuba's emitters that are not shapes to our lights."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from clrender.exact.angles import sin_cos
from clrender.exact.matrices import length, times
from clrender.importers.mitsuba.fields_of_view import vertical_field
from clrender.importers.mitsuba.plugins import Plugin
from clrender.importers.mitsuba.textures import TextureReader
from clrender.importers.shared.matrices import Matrix, handedness
from clrender.importers.shared.motions import fault_of_motion, light_motion
from clrender.importers.shared.projectors import projector_keys
from clrender.importers.shared.sky_maps import picture_from_poles, turn_about_y, turned_picture
from clrender.importers.shared.staging import Staging
from clrender.spectra.colors import Color
from clrender.wording import quoted

__all__ = ["EmitterReader"]

_SKY_NANOMETRES: Final = 106.75
"""Mitsuba divides the sky model's RGB radiance by this, clrender does not."""


class EmitterReader:
    """Converts lights.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    """

    def __init__(self, staging: Staging, textures: TextureReader) -> None:
        self._staging, self._textures = staging, textures
        self.moves = False
        """Whether any of those read moves."""

    def read(self, plugin: Plugin) -> None:
        """Add a light.

        Raises
        ------
        SceneError
            It is a second environment.
        """
        known: dict[str, Callable[[Plugin, Matrix], dict[str, Any] | None]] = {
            "point": self._point,
            "spot": self._spot,
            "projector": self._projector,
            "directional": self._directional,
            "constant": self._constant,
            "envmap": self._envmap,
            "sunsky": self._sky,
            "sky": self._sky,
            "sun": self._sky,
        }
        if plugin.type == "area" and plugin.id:
            return  # for the shapes that refer to it
        if plugin.type not in known:
            self._staging.note(f"{plugin.label} is not known and left out")
            return
        plugin.ignore("sampling_weight", "bounding_sphere_radius")
        made = known[plugin.type](plugin, plugin.matrix())
        if made is not None and plugin.keys():
            self._move(plugin, made)
        for name in plugin.unused():
            self._staging.note(f"{quoted(name)} of {plugin.label} is not understood and does nothing")
        if made is None:
            return
        lights = self._staging.draft.description["lights"]
        around = ("environment", "sun_sky")
        if made["type"] in around and any(light["type"] in around for light in lights):
            raise plugin.fault("is a second environment, but a scene can have only one; remove one")
        lights.append(made)

    def _move(self, plugin: Plugin, made: dict[str, Any]) -> None:
        """Give a light the keys of its motion, if it can follow them."""
        keys = plugin.keys()
        if made["type"] not in ("point", "spot", "projector", "directional"):
            self._staging.note(f"the animated transform of {plugin.label} is read as it is at its first moment")
        elif fault_of_motion(plugin.type, [matrix for _, matrix in keys]):
            self._staging.note("a motion makes a light flat on its way: it stands where it is at first")
        else:
            x, y, z = plugin.vector("position", (0.0, 0.0, 0.0)).tolist()
            made["motion"] = light_motion(plugin.matrix(), keys, (x, y, z))
            self.moves = True

    def _point(self, plugin: Plugin, matrix: Matrix) -> dict[str, Any]:
        place = times(matrix, [*plugin.vector("position", (0.0, 0.0, 0.0)), 1.0])
        intensity = self._textures.shining(plugin, "intensity", 1.0)
        return {"type": "point", "position": _floats(place[:3]), "intensity": intensity}

    def _spot(self, plugin: Plugin, matrix: Matrix) -> dict[str, Any]:
        cutoff = plugin.number("cutoff_angle", 20.0)
        beam = plugin.number("beam_width", cutoff * 0.75)
        if not 0.0 < cutoff < 180.0 or not 0.0 <= beam <= cutoff:
            raise plugin.fault(f"the cone's angles are {beam:g} and {cutoff:g}; they must grow, up to 180 degrees")
        if plugin.child("texture") is not None:
            self._staging.note("the texture of a spot is left out")
        edge, inner = (sin_cos(math.radians(degrees))[1] for degrees in (cutoff, beam))
        if beam < 0.999 * cutoff:
            self._staging.note("spots fall off by a smooth step in the cosine, and not linearly with the angle")
        return {
            "type": "spot",
            "position": _floats(matrix[:3, 3]),
            "direction": _floats(matrix[:3, 2]),
            "intensity": self._textures.shining(plugin, "intensity", 1.0),
            "cone_degrees": 2.0 * cutoff,
            "blend": min(max((inner - edge) / (1.0 - edge), 0.0), 1.0),
        }

    def _projector(self, plugin: Plugin, matrix: Matrix) -> dict[str, Any] | None:
        """Its picture is the irradiance, over π, of a screen at distance 1."""
        picture = plugin.child("irradiance")
        if picture is None or picture.type != "bitmap" or not picture.text("filename"):
            self._staging.note(f"{plugin.label} whose irradiance is no bitmap of a file is left out")
            return None
        if picture.flag("raw", False) and Path(picture.text("filename")).suffix.lower() not in (".exr", ".hdr", ".pfm"):
            self._staging.note(f"the picture of {plugin.label} is read as sRGB, though it is said to be linear")
        picture.ignore("filter_type", "wrap_mode", "format", "accel")
        for name in picture.unused():
            self._staging.note(f"{quoted(name)} of the picture of {plugin.label} is not understood and does nothing")
        file, scale = picture.text("filename"), [math.pi * plugin.number("scale", 1.0)] * 3
        made = projector_keys(self._staging, file, picture.line, matrix, False, partial(vertical_field, plugin))
        return None if made is None else {**made[0], "scale": scale}

    def _directional(self, plugin: Plugin, matrix: Matrix) -> dict[str, Any]:
        direction = times(matrix[:3, :3], plugin.vector("direction", (0.0, 0.0, 1.0)))
        irradiance = self._textures.shining(plugin, "irradiance", 1.0)
        return {"type": "directional", "direction": _floats(direction), "irradiance": irradiance}

    def _constant(self, plugin: Plugin, matrix: Matrix) -> dict[str, Any]:
        return {"type": "environment", "radiance": self._textures.shining(plugin, "radiance", 1.0)}

    def _envmap(self, plugin: Plugin, matrix: Matrix) -> dict[str, Any] | None:
        file = plugin.text("filename")
        if not file:
            raise plugin.fault('the environment has no "filename"; give it')
        plugin.ignore("mis_compensation", "cache", "gamma")
        scale = [plugin.number("scale", 1.0)] * 3
        name = self._staging.files.name(file, f"line {plugin.line}")
        turn, files, place = turn_about_y(matrix), self._staging.files, f"line {plugin.line}"
        if turn is None:
            name, picture = f"{file} (turned)", turned_picture(files, name, place, matrix)
        else:
            name, picture = f"{file} (rows from pole to pole)", picture_from_poles(files, name, place)
        self._staging.draft.environments[name] = picture
        return {"type": "environment", "file": name, "scale": scale, **({"rotate_degrees": turn} if turn else {})}

    def _sky(self, plugin: Plugin, matrix: Matrix) -> dict[str, Any] | None:
        """Sun and sky: up is z in Mitsuba, before `to_world`, and y here; the sun's direction is in world space."""
        up = matrix[:3, 2] / length(matrix[:3, 2])
        if up[1] < 1.0 - 1e-6 or handedness(matrix) < 0.0:
            self._staging.note(f"{plugin.label} whose sky is not above +y is left out; turn its to_world")
            return None
        towards = plugin.vector("sun_direction", (0.0, 0.0, 0.0))
        if not towards.any():
            self._staging.note(f"{plugin.label} without sun_direction has its sun at 45 degrees")
            towards = times(matrix[:3, :3], [0.0, 1.0, 1.0])
            plugin.ignore(*(name for name in plugin.values if name in _DATES))
        if towards[1] < 0.0:
            self._staging.note(f"{plugin.label} with its sun below the horizon is left out")
            return None
        albedo: Color | list[float] = self._textures.color(plugin, "albedo", 0.3)
        self._staging.note("the sun of a sunsky has Mitsuba's spectral radiance, 5 to 9 % less than in its RGB mode")
        return {
            "type": "sun_sky",
            "sun_direction": _floats(towards),
            "turbidity": min(max(plugin.number("turbidity", 3.0), 1.0), 10.0),
            "ground_albedo": albedo if isinstance(albedo, list) else [0.3] * 3,
            "ground": False,
            "sky_scale": 0.0 if plugin.type == "sun" else plugin.number("sky_scale", 1.0) / _SKY_NANOMETRES,
            "sun_scale": 0.0 if plugin.type == "sky" else plugin.number("sun_scale", 1.0) / _SKY_NANOMETRES,
        }


_DATES: Final = frozenset(["year", "month", "day", "hour", "minute", "second", "latitude", "longitude", "timezone"])


def _floats(values: Any) -> list[float]:
    return [float(x) for x in values]
