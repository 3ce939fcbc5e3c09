"""Lights that are no shapes, and the world, as Blender's."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clrender.exporters.cycles_camera import along
from clrender.exporters.cycles_materials import volume
from clrender.exporters.cycles_nodes import NodeTree, Socket
from clrender.exporters.cycles_textures import TextureWriter
from clrender.exporters.skies import sky_map
from clrender.exporters.surfaces import inside_named, tell_of_glow
from clrender.exporters.target import LAMPS, Target
from clrender.exporters.triangles import At
from clrender.scene import (
    DirectionalLight,
    EnvironmentLight,
    PointLight,
    SpotLight,
    SunSkyLight,
)

__all__ = ["LightWriter"]


class LightWriter:
    """Writes lights.

    Parameters
    ----------
    target : Target
    textures : TextureWriter

    Attributes
    ----------
    written : list of dict
        Lights at places, or from a direction.
    """

    def __init__(self, target: Target, textures: TextureWriter) -> None:
        self._target, self._textures = target, textures
        self.written: list[dict[str, Any]] = []

    def write(self) -> dict[str, Any]:
        """All lights of the scene that are no shapes; gives the tree of nodes of the world."""
        scene, tree = self._target.scene, NodeTree()
        background: Socket | None = None
        for index, light in enumerate(scene.lights):
            if isinstance(light, EnvironmentLight | SunSkyLight):
                background = self._around(tree, light, ("lights", index))
            else:
                self._light(light, ("lights", index))
        if background is None:
            background = tree.node("Background", {"Color": (0.0, 0.0, 0.0)})
        fog = None
        if scene.fog is not None:
            inside = inside_named(scene, scene.fog)
            tell_of_glow(self._target, inside)
            fog = volume(tree, inside)
        return tree.described(background, fog)

    def _light(self, light: Any, at: At) -> None:
        point = {"shadow_soft_size": 0.0, "use_soft_falloff": False}
        # Watts, of which 1 / 4 pi go into each unit of solid angle
        flux = 4.0 * math.pi
        if isinstance(light, PointLight):
            self._add("POINT", light.position, (0.0, -1.0, 0.0), light.intensity, flux, **point)
        elif isinstance(light, SpotLight):
            if light.cone_degrees > 180.0:
                self._target.leave_out("the part of cones beyond 180 degrees", *at)
            if light.cone_degrees < 1.0:
                self._target.leave_out("cones below 1 degree", *at)
            cone = {"spot_size": math.radians(min(light.cone_degrees, 180.0)), "spot_blend": light.blend}
            self._add("SPOT", light.position, light.direction, light.intensity, flux, **point, **cone)
        elif isinstance(light, DirectionalLight):
            self._add("SUN", (0.0, 0.0, 0.0), light.direction, light.irradiance, 1.0, angle=0.0)
        else:
            self._target.leave_out(LAMPS[type(light)], *at)

    def _add(self, kind: str, position: Any, direction: Any, power: Any, factor: float, **values: Any) -> None:
        most = max(power) or 1.0
        name = self._target.id("light", kind.lower())
        described = {"color": (np.array(power) / most).tolist(), "energy": most * factor, **values}
        matrix = along(position, direction).tolist()
        self.written.append({"name": name, "kind": kind, "matrix": matrix, "values": described})

    def _around(self, tree: NodeTree, light: Any, at: At) -> Socket:
        if isinstance(light, SunSkyLight):
            pixels, sunny = sky_map(self._target.scene, light)
            if sunny:
                self._target.leave_out("the edge of the sun, which is drawn into a map of sky and ground", *at)
            return self._map(tree, "sky", pixels, light.sun_turn)
        if light.file is None:
            color, strength = _split(light.constant)
            return tree.node("Background", {"Color": color, "Strength": strength})
        picture = self._target.scene.environment_picture()
        assert picture is not None
        return self._map(tree, "environment", picture.pixels * np.array(light.scale, np.float32), light.rotate_degrees)

    def _map(self, tree: NodeTree, stem: str, pixels: NDArray[np.float32], degrees: float) -> Socket:
        """An environment map, turned about the vertical axis; the middle of Blender's is at +x."""
        towards = tree.node("TexCoord", {}, "Generated")
        turn = (0.0, 0.0, math.radians(90.0 - degrees))
        towards = tree.node("Mapping", {"Vector": towards, "Rotation": turn}, vector_type="POINT")
        name = self._textures.files.made(stem, pixels)
        color = tree.node("TexEnvironment", {"Vector": towards}, image=name, interpolation="Linear")
        return tree.node("Background", {"Color": color})


def _split(color: Any) -> tuple[Any, float]:
    """A colour of at most 1, and a factor."""
    most = max(color)
    return (np.array(color) / most, most) if most > 0.0 else (color, 0.0)
