"""Emission of shapes: their own, or that of their material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from clrender.scene.materials import Principled
from clrender.scene.textures import Checker, ImageTexture, Ramp, Texture
from clrender.scene.values import Color, Vector

if TYPE_CHECKING:
    from clrender.scene.description import Scene
    from clrender.scene.shapes import AnyShape

__all__ = ["Emission", "emits", "shape_emission"]


@dataclass(frozen=True)
class Emission:
    """Radiance emitted by the front of a shape.

    Attributes
    ----------
    color : (3,) float or texture
        W/(sr m2), but for ...
    strength : float
        ... this factor.
    place : tuple of str and int
        Location of its key, for messages.
    """

    color: Color | Texture
    strength: float
    place: tuple[str | int, ...]

    @property
    def texture(self) -> Texture | None:
        """The emission texture, if there is one."""
        return self.color if isinstance(self.color, ImageTexture | Checker | Ramp) else None

    @property
    def constant(self) -> Vector:
        """The radiance, if it is constant, W/(sr m2); else black."""
        if self.texture is not None:
            return (0.0, 0.0, 0.0)
        assert isinstance(self.color, tuple)
        red, green, blue = (self.strength * c for c in self.color)
        return (red, green, blue)


def emits(scene: Scene, shape: AnyShape) -> bool:
    """Whether a shape emits light, by itself or by its material."""
    if shape.shines or shape.material is None:
        return shape.shines
    material = scene.materials[shape.material]
    return isinstance(material, Principled) and material.shines


def shape_emission(scene: Scene, index: int) -> Emission | None:
    """Emission of one of a scene's shapes; None if it does not emit light.

    Parameters
    ----------
    scene : Scene
    index : int
        Index of the shape.
    """
    shape = scene.shapes[index]
    if shape.shines:
        assert shape.emission is not None
        return Emission(shape.emission, 1.0, (*scene.place_of(index), "emission"))
    material = None if shape.material is None else scene.materials[shape.material]
    if isinstance(material, Principled) and material.shines:
        assert shape.material is not None
        return Emission(material.emission, material.emission_strength, ("materials", shape.material, "emission"))
    return None
