"""Colours, numbers, textures and maps of materials as LuxCore's."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from clrender.exporters.luxcore_text import Properties
from clrender.exporters.pictures import (
    Bitmap,
    Curve,
    PictureFiles,
    Squares,
    height_picture,
    normal_picture,
    scale_turn_offset,
)
from clrender.exporters.target import Target
from clrender.scene.textures import BumpMap, NormalMap, Texture

__all__ = ["TextureWriter"]

_SAME: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".exr")
"""Endings of pictures that LuxCore reads as clrender does, if their numbers are linear."""


class TextureWriter:
    """Writes textures; constants need none.

    Parameters
    ----------
    target : Target
    properties : dict
        Where they are written.

    Attributes
    ----------
    files : PictureFiles
    """

    def __init__(self, target: Target, properties: Properties) -> None:
        self._target, self._properties = target, properties
        # LuxCore knows powers of numbers, but not sRGB
        self.files = PictureFiles(target, _SAME, decodes=False)

    def color(self, given: Any, at: tuple[str | int, ...], factor: Any = 1.0) -> Any:
        """A colour: three numbers, or the name of a texture.

        Parameters
        ----------
        given : three floats or Texture
        at : tuple of str or int
            Its place in the scene.
        factor : float or three floats
            Factor for it.
        """
        if isinstance(given, Texture):
            return self._texture(given, at, False, factor)
        return np.array(given) * factor

    def number(self, given: Any, at: tuple[str | int, ...], curve: Curve | None = None) -> Any:
        """A number, or the name of a texture.

        Parameters
        ----------
        given : float or Texture
        at : tuple of str or int
            Its place in the scene.
        curve : callable, optional
            What is done to it.
        """
        if isinstance(given, Texture):
            return self._texture(given, at, True, 1.0, curve)
        return given if curve is None else float(curve(np.array(given, np.float64)))

    def normal_map(self, given: NormalMap, at: tuple[str | int, ...], signs: tuple[float, float]) -> str:
        """The name of a texture of normals; for `signs` see `normal_picture`."""
        picture, curve = normal_picture(given, signs)
        return self._new("normals", {"type": "normalmap", "texture": self._texture(picture, at, False, 1.0, curve)})

    def bump_map(self, given: BumpMap, at: tuple[str | int, ...]) -> str:
        """The name of a texture of heights, metres."""
        return self._texture(height_picture(given), at, True, given.scale)

    def _new(self, wanted: str, values: Properties) -> str:
        name = self._target.id("texture", wanted)
        self._properties.update({f"scene.textures.{name}.{key}": value for key, value in values.items()})
        return name

    def _texture(
        self, given: Texture, at: tuple[str | int, ...], number: bool, factor: Any, curve: Curve | None = None
    ) -> str:
        made = self.files.resolved(given, at, number, factor, curve)
        if isinstance(made, Squares):
            values: Properties = {"type": "checkerboard2d"}
            values |= {f"texture{i + 1}": np.broadcast_to(color, 3) for i, color in enumerate(made.colors)}
            return self._new("checker", values | self._mapping(made, at))
        wrap, other = made.wrap
        if other != wrap:
            self._target.leave_out("another way of repeating a texture along v; it is that along u", *at)
        if wrap == "mirror":
            self._target.leave_out("the mirroring of textures, which are repeated", *at)
        values = {"type": "imagemap", "file": made.file, "gamma": 1.0, "wrap": "clamp" if wrap == "clamp" else "repeat"}
        values |= {"filter": "nearest"} if made.nearest else {}
        return self._new("picture", values | self._mapping(made, at))

    def _mapping(self, made: Bitmap | Squares, at: tuple[str | int, ...]) -> Properties:
        """The transform of texture coordinates: a scale, then a rotation, then an offset."""
        flip = isinstance(made, Bitmap)  # v of LuxCore's pictures is 0 at their upper edge
        (across, along), turn, (u, v), sheared = scale_turn_offset(made.plane)
        if sheared:
            self._target.leave_out("the shear of a texture", *at)
        if flip:
            along, turn, v = -along, -turn, 1.0 - v
        # LuxCore turns clockwise
        scale = {"mapping.uvscale": [across, along], "mapping.rotation": -turn, "mapping.uvdelta": [u, v]}
        return {"mapping.type": "uvmapping2d", **scale}
