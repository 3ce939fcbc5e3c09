"""Colours, numbers, textures and maps of materials as Blender's nodes."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from clrender.exporters.cycles_nodes import NodeTree, Socket
from clrender.exporters.pictures import Curve, PictureFiles, Squares, height_picture, normal_picture, scale_turn_offset
from clrender.exporters.target import Target
from clrender.scene.textures import BumpMap, NormalMap, Texture

__all__ = ["TextureWriter"]

_SAME: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".exr")
"""Endings of pictures that Blender reads as clrender does, if their numbers are linear."""
_WRAPS: Final = {"repeat": "REPEAT", "clamp": "EXTEND", "mirror": "MIRROR"}


class TextureWriter:
    """Writes textures into trees of nodes; constants need none.

    Parameters
    ----------
    target : Target

    Attributes
    ----------
    files : PictureFiles
    """

    def __init__(self, target: Target) -> None:
        self._target = target
        # Cycles interpolates numbers in sRGB before it decodes them
        self.files = PictureFiles(target, _SAME, decodes=False)

    def color(
        self, tree: NodeTree, given: Any, at: tuple[str | int, ...], factor: Any = 1.0, curve: Curve | None = None
    ) -> Any:
        """A colour: three numbers, or the output of a node.

        Parameters
        ----------
        tree : NodeTree
        given : three floats or Texture
        at : tuple of str or int
            Its place in the scene.
        factor : float or three floats
            Factor for it.
        curve : callable, optional
            What is done to it then.
        """
        if isinstance(given, Texture):
            return self._texture(tree, given, at, False, factor, curve)
        made = np.array(given) * factor
        return made if curve is None else curve(made)

    def number(self, tree: NodeTree, given: Any, at: tuple[str | int, ...], curve: Curve | None = None) -> Any:
        """A number, or the output of a node.

        Parameters
        ----------
        tree, at
            See `color`.
        given : float or Texture
        curve : callable, optional
            What is done to it.
        """
        if isinstance(given, Texture):
            return self._texture(tree, given, at, True, 1.0, curve)
        return given if curve is None else float(curve(np.array(given, np.float64)))

    def normal_map(self, tree: NodeTree, given: NormalMap, at: tuple[str | int, ...]) -> Socket:
        """Normals by a normal map."""
        picture, curve = normal_picture(given)
        color = self._texture(tree, picture, at, False, 1.0, curve)
        return tree.node("NormalMap", {"Color": color, "Strength": 1.0}, space="TANGENT", uv_map="UVMap")

    def bump_map(self, tree: NodeTree, given: BumpMap, at: tuple[str | int, ...]) -> Socket:
        """Normals by a map of heights."""
        height = self._texture(tree, height_picture(given), at, True, 1.0)
        return tree.node("Bump", {"Height": height, "Distance": given.scale, "Strength": 1.0})

    def _texture(
        self,
        tree: NodeTree,
        given: Texture,
        at: tuple[str | int, ...],
        number: bool,
        factor: Any,
        curve: Curve | None = None,
    ) -> Socket:
        made = self.files.resolved(given, at, number, factor, curve)
        scale, turn, offset, sheared = scale_turn_offset(made.plane)
        uv: Any = tree.node("UVMap", {}, uv_map="UVMap")
        if sheared:
            uv = _affine(tree, uv, made.plane)
        elif (scale, turn, offset) != ((1.0, 1.0), 0.0, (0.0, 0.0)):
            placed = {"Location": (*offset, 0.0), "Rotation": (0.0, 0.0, math.radians(turn)), "Scale": (*scale, 1.0)}
            uv = tree.node("Mapping", {"Vector": uv, **placed}, vector_type="POINT")
        if isinstance(made, Squares):
            first, second = (np.broadcast_to(color, 3) for color in made.colors)
            return tree.node("TexChecker", {"Vector": uv, "Color1": second, "Color2": first, "Scale": 1.0})
        wrap, other = made.wrap
        if other != wrap:
            self._target.leave_out("another way of repeating a texture along v; it is that along u", *at)
        filtered = "Closest" if made.nearest else "Linear"
        return tree.node("TexImage", {"Vector": uv}, image=made.file, interpolation=filtered, extension=_WRAPS[wrap])


def _affine(tree: NodeTree, uv: Socket, plane: Any) -> Socket:
    """Texture coordinates under any affine map, (2, 3)."""
    axes = {}
    for axis, (a, b, offset) in zip("XY", plane.tolist(), strict=True):
        along = tree.node("VectorMath", {0: uv, 1: (a, b, 0.0)}, "Value", operation="DOT_PRODUCT")
        axes[axis] = tree.math("ADD", along, offset)
    return tree.node("CombineXYZ", {**axes, "Z": 0.0})
