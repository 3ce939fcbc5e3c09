"""What the shapes of a scene send out by themselves: their own emission, or that of their material."""

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
    """Radiance of the front of a shape.

    Attributes
    ----------
    color : (3,) float or texture
        W/(sr m2), but for ...
    strength : float
        ... this factor.
    place : tuple of str and int
        Of the key that says so, for messages.
    """

    color: Color | Texture
    strength: float
    place: tuple[str | int, ...]

    @property
    def texture(self) -> Texture | None:
        """What it shines as, if that is a texture."""
        return self.color if isinstance(self.color, ImageTexture | Checker | Ramp) else None

    @property
    def constant(self) -> Vector:
        """Radiance of a shape that is the same all over, W/(sr m2); of others black."""
        if self.texture is not None:
            return (0.0, 0.0, 0.0)
        assert isinstance(self.color, tuple)
        red, green, blue = (self.strength * c for c in self.color)
        return (red, green, blue)


def emits(scene: Scene, shape: AnyShape) -> bool:
    """Whether a shape shines, by itself or because its material does."""
    if shape.shines or shape.material is None:
        return shape.shines
    material = scene.materials[shape.material]
    return isinstance(material, Principled) and material.shines


def shape_emission(scene: Scene, index: int) -> Emission | None:
    """Emission of one of a scene's shapes; None for a shape that does not shine.

    Parameters
    ----------
    scene : Scene
    index : int
        Of the shape.
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
