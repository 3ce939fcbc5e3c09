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
    Share,
    Vector,
    cross,
    fault,
    length,
    number_as_triple,
)

__all__ = ["LIGHT_TYPES", "DirectionalLight", "EnvironmentLight", "IesLight", "Light", "PointLight", "SpotLight"]

Factor = Annotated[Color, BeforeValidator(number_as_triple), WithJsonSchema(NUMBER_OR_TRIPLE)]


_LEAST_CONE: Final = 0.01
"""Degrees; in single precision the edge of a narrower one is not smooth."""


def _check_direction(direction: Vector) -> None:
    if length(direction) == 0.0:
        raise fault("light", "has length zero; give a direction such as [0, -1, 0]", "direction")


class PointLight(Part):
    """Shines alike in all directions from one point."""

    type: Literal["point"]
    position: Vector
    intensity: Color = Field(description="W/sr")


class SpotLight(Part):
    """Shines from one point into a cone, towards whose edge it falls off smoothly."""

    type: Literal["spot"]
    position: Vector
    direction: Vector = Field(description="in which the middle of the cone goes")
    intensity: Color = Field(description="W/sr, in the middle")
    cone_degrees: Annotated[Finite, Field(gt=0.0, le=360.0)] = Field(
        description="whole angle of the cone, from edge to edge"
    )
    blend: Share = Field(0.15, description="share of the cone's solid angle over which light falls off to its edge")

    @model_validator(mode="after")
    def _has_a_direction(self) -> SpotLight:
        _check_direction(self.direction)
        if self.cone_degrees < _LEAST_CONE:
            raise fault("light", f"is {self.cone_degrees:g}; it must be at least {_LEAST_CONE:g}", "cone_degrees")
        return self


class IesLight(Part):
    """Shines from one point as a measured lamp does: an IES file says how much into which direction."""

    type: Literal["ies"]
    position: Vector
    direction: Vector = Field((0.0, -1.0, 0.0), description="in which the file's vertical angle 0 lies")
    file: FileName = Field(description="`.ies`, in candela: 683 of them are 1 W/sr")
    horizontal_zero: Vector | None = Field(
        None,
        description="about where horizontal angle 0 lies, from which angles grow counter-clockwise as seen against "
        "`direction`; default: +z, or +y where `direction` is along z",
    )
    scale: Factor = Field((1.0, 1.0, 1.0), description="factor of the intensity")

    @model_validator(mode="after")
    def _has_directions(self) -> IesLight:
        _check_direction(self.direction)
        if self.horizontal_zero is not None and length(cross(self.horizontal_zero, self.direction)) <= (
            1e-6 * length(self.horizontal_zero) * length(self.direction)
        ):
            raise fault("light", "lies along `direction`; give one across it", "horizontal_zero")
        return self

    @property
    def zero(self) -> Vector:
        """`horizontal_zero`, or what stands for it."""
        if self.horizontal_zero is not None:
            return self.horizontal_zero
        x, y, _ = self.direction
        return (0.0, 0.0, 1.0) if max(abs(x), abs(y)) > 1e-3 * length(self.direction) else (0.0, 1.0, 0.0)


class DirectionalLight(Part):
    """Parallel light from infinitely far away."""

    type: Literal["directional"]
    direction: Vector = Field(description="in which the light travels")
    irradiance: Color = Field(description="W/m2 on a surface that faces it")

    @model_validator(mode="after")
    def _has_a_direction(self) -> DirectionalLight:
        _check_direction(self.direction)
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
    scale: Factor = Field((1.0, 1.0, 1.0), description="factor of the radiance")

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
    "spot": SpotLight,
    "ies": IesLight,
    "directional": DirectionalLight,
    "environment": EnvironmentLight,
}
Light: TypeAlias = Annotated[
    PointLight | SpotLight | IesLight | DirectionalLight | EnvironmentLight, Field(discriminator="type")
]
