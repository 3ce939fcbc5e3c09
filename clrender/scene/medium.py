"""Media that fill shapes or the whole scene: the tables `[media.NAME]` of a scene file, validated."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import BeforeValidator, Field, WithJsonSchema

from clrender.scene.values import NUMBER_OR_TRIPLE, Finite, Part, Power, Vector, number_as_triple

__all__ = ["Medium"]

_Coefficients: TypeAlias = Annotated[
    tuple[Power, Power, Power], BeforeValidator(number_as_triple), WithJsonSchema(NUMBER_OR_TRIPLE)
]


class Medium(Part):
    """Homogeneous participating medium, such as smoke, fog or milk."""

    absorption: _Coefficients = Field((0.0, 0.0, 0.0), description="absorption coefficient, per metre")
    scattering: _Coefficients = Field((0.0, 0.0, 0.0), description="scattering coefficient, per metre")
    g: Annotated[Finite, Field(ge=-0.99, le=0.99)] = Field(
        0.0,
        description="anisotropy of the Henyey-Greenstein phase function: above 0 forward, below 0 backward scattering",
    )

    @property
    def scatters(self) -> bool:
        """Whether it does more than absorb."""
        return max(self.scattering) > 0.0

    @property
    def numbers(self) -> tuple[Vector, Vector, float]:
        """Absorption and scattering coefficients, and mean cosine."""
        return (self.absorption, self.scattering, self.g if self.scatters else 0.0)
