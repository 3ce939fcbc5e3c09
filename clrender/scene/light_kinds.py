"""The lights of a scene that are no shapes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from clrender.scene.values import (
    NUMBER_OR_TRIPLE,
    POWER_LIMIT,
    Color,
    FileName,
    Finite,
    Part,
    Vector,
    fault,
    length,
    number_as_triple,
)

__all__ = ["LIGHT_TYPES", "DirectionalLight", "EnvironmentLight", "Light", "PointLight"]


class PointLight(Part):
    """Shines alike in all directions from one point."""

    type: Literal["point"]
    position: Vector
    intensity: Color = Field(description="W/sr")


class DirectionalLight(Part):
    """Parallel light from infinitely far away."""

    type: Literal["directional"]
    direction: Vector = Field(description="in which the light travels")
    irradiance: Color = Field(description="W/m2 on a surface that faces it")

    @model_validator(mode="after")
    def _has_a_direction(self) -> DirectionalLight:
        if length(self.direction) == 0.0:
            raise fault("light", "has length zero; give a direction such as [0, -1, 0]", "direction")
        return self


class EnvironmentLight(Part):
    """Light from every direction outside the scene: the same radiance, or a picture of it in latitude and longitude.

    The top of the picture is at +y, its middle column at +z, and the column a quarter of its width from the left edge
    at +x; between pixels radiance is interpolated.
    """

    type: Literal["environment"]
    radiance: Color | None = Field(None, description="W/(sr m2)")
    file: FileName | None = Field(
        None, description="instead of `radiance`: `.exr`, `.hdr` or `.png` (sRGB, 1 is white)"
    )
    rotate_degrees: Finite = Field(0.0, description="turns the picture about +y, from +z towards +x")
    scale: Annotated[Color, BeforeValidator(number_as_triple), WithJsonSchema(NUMBER_OR_TRIPLE)] = Field(
        (1.0, 1.0, 1.0), description="factor of the radiance"
    )

    @model_validator(mode="after")
    def _is_one_of_both(self) -> EnvironmentLight:
        if (self.radiance is None) == (self.file is None):
            both = "needs" if self.file is None else "has both"
            words = "either `radiance` or `file`" if self.file is None else "`radiance` and `file`; keep one of them"
            raise fault("light", f"{both} {words}")
        if max(self.constant) > POWER_LIMIT:
            raise fault(
                "light", f"makes a radiance of {max(self.constant):g}; at most {POWER_LIMIT:g} is known", "scale"
            )
        return self

    @property
    def constant(self) -> Vector:
        """Radiance times scale, W/(sr m2), where it is the same everywhere; else black."""
        red, green, blue = (r * s for r, s in zip(self.radiance or (0.0, 0.0, 0.0), self.scale, strict=True))
        return (red, green, blue)


LIGHT_TYPES: Final[Mapping[str, type[Part]]] = {
    "point": PointLight,
    "directional": DirectionalLight,
    "environment": EnvironmentLight,
}
Light: TypeAlias = Annotated[PointLight | DirectionalLight | EnvironmentLight, Field(discriminator="type")]
