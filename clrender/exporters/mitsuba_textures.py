"""Colours, numbers, textures and maps of materials as Mitsuba's."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender.exact.matrices import product
from clrender.exporters.mitsuba_xml import Element, element, spectral, transform, value
from clrender.exporters.pictures import Curve, PictureFiles, Squares, height_picture, normal_picture
from clrender.exporters.target import Target
from clrender.scene.textures import BumpMap, NormalMap, Texture

__all__ = ["TextureWriter"]

_Floats: TypeAlias = NDArray[np.float64]
_SAME: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".ppm", ".exr", ".pfm")
"""Endings of pictures that Mitsuba reads as clrender does. It reads mantissas of ``.hdr`` as m, not m + 1/2."""
_FLOATS: Final = (".exr", ".hdr", ".pfm")
"""Pictures that are linear; of colours they may become spectra, which Mitsuba denies to those that are raw."""
_FLIP: Final = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0]])
"""Mitsuba's v of a picture is 0 at its upper edge."""


class TextureWriter:
    """Writes constants and textures.

    Parameters
    ----------
    target : Target

    Attributes
    ----------
    files : PictureFiles
    """

    def __init__(self, target: Target) -> None:
        self._target, self.files = target, PictureFiles(target, _SAME)

    def color(self, name: str, given: Any, at: tuple[str | int, ...], factor: Any = 1.0) -> Element:
        """A colour.

        Parameters
        ----------
        name : str
            Mitsuba's name for it.
        given : three floats or Texture
        at : tuple of str or int
            Its place in the scene.
        factor : float or three floats
            Factor for it.
        """
        if isinstance(given, Texture):
            return self._texture(name, given, at, False, factor)
        return spectral(name, given, factor)

    def number(self, name: str, given: Any, at: tuple[str | int, ...], curve: Curve | None = None) -> Element:
        """A number.

        Parameters
        ----------
        name, at
            See `color`.
        given : float or Texture
        curve : callable, optional
            What is done to it.
        """
        if isinstance(given, Texture):
            return self._texture(name, given, at, True, 1.0, curve)
        return value("float", name, given if curve is None else float(curve(np.array(given, np.float64))))

    def normal_map(self, given: NormalMap, at: tuple[str | int, ...], signs: tuple[float, float]) -> Element:
        """A map of normals, with the middle value at 0.5; for `signs` see `normal_picture`."""
        picture, curve = normal_picture(given, signs)
        return self._texture("normalmap", picture, at, False, 1.0, curve)

    def bump_map(self, given: BumpMap, at: tuple[str | int, ...]) -> Element:
        """A map of heights."""
        return self._texture("heights", height_picture(given), at, True, 1.0)

    def _texture(
        self,
        name: str,
        given: Texture,
        at: tuple[str | int, ...],
        number: bool,
        factor: Any,
        curve: Curve | None = None,
    ) -> Element:
        made = self.files.resolved(given, at, number, factor, curve)
        color = not number and name != "normalmap"
        if isinstance(made, Squares):
            # The side of Mitsuba's squares is half a unit
            both = [value("rgb", f"color{i}", np.broadcast_to(color, 3)) for i, color in enumerate(made.colors)]
            return element("texture", *both, *_to_uv(0.5 * made.plane), type="checkerboard", name=name)
        wrap, other = made.wrap
        if other != wrap:
            self._target.leave_out("another way of repeating a texture along v; it is that along u", *at)
        inside = [
            value("string", "filename", made.file),
            value("boolean", "raw", made.linear and not (color and made.file.endswith(_FLOATS))),
            value("string", "wrap_mode", wrap),
            value("string", "filter_type", "nearest" if made.nearest else "bilinear"),
        ]
        upright = product(_FLIP[:, :2], made.plane)
        upright[:, 2] += _FLIP[:, 2]
        return element("texture", *inside, *_to_uv(upright), type="bitmap", name=name)


def _to_uv(plane: _Floats) -> list[Element]:
    """The transform of texture coordinates; none for the identity."""
    made = np.eye(4)
    made[:2, :2], made[:2, 3] = plane[:, :2], plane[:, 2]
    return [] if (made == np.eye(4)).all() else [transform(made, "to_uv")]
