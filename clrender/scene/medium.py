"""Media that fill shapes or the whole scene: the tables `[media.NAME]` of a scene file, validated."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from clrender.scene.poses import Transform
from clrender.scene.values import NUMBER_OR_TRIPLE, FileName, Finite, Part, Power, Vector, fault, number_as_triple

__all__ = ["Density", "Medium"]

_Coefficients: TypeAlias = Annotated[
    tuple[Power, Power, Power], BeforeValidator(number_as_triple), WithJsonSchema(NUMBER_OR_TRIPLE)
]


class Density(Part):
    """A grid of numbers by which a medium's absorption and scattering are multiplied; outside of its box they are 0."""

    file: FileName = Field(description="the grid: `.npy` of the shape (nz, ny, nx), `.vol` or `.nvdb`")
    box: tuple[Vector, Vector] | None = Field(
        None,
        description="lowest and highest corner of the grid's box, before the transform; default: where the file says, "
        "and of `.npy` the unit cube",
    )
    transform: Transform = Field(
        Transform(), description="of the box, in the space of the scene, or of the group whose shapes it fills"
    )
    edges: Literal["keep", "fall"] = Field(
        "keep",
        description="whether the density keeps the numbers of the outermost cells up to the edges, or falls to zeros",
    )

    @model_validator(mode="after")
    def _has_a_volume(self) -> Density:
        if self.box is not None and not all(a < b for a, b in zip(*self.box, strict=True)):
            raise fault("medium", "has no volume; give the lowest corner first, and then the highest", "box")
        return self


class Medium(Part):
    """Participating medium, such as smoke, fog or milk."""

    late_keys: ClassVar[frozenset[str]] = frozenset({"density", "emission"})

    absorption: _Coefficients = Field((0.0, 0.0, 0.0), description="absorption coefficient, per metre")
    scattering: _Coefficients = Field((0.0, 0.0, 0.0), description="scattering coefficient, per metre")
    emission: _Coefficients = Field(
        (0.0, 0.0, 0.0),
        description="radiance that a metre of it adds, W/(sr m3); only where it also absorbs or scatters",
    )
    g: Annotated[Finite, Field(ge=-0.99, le=0.99)] = Field(
        0.0,
        description="anisotropy of the Henyey-Greenstein phase function: above 0 forward, below 0 backward scattering",
    )

    density: Density | None = Field(None, description="where it is how dense; default: the same everywhere")

    @model_validator(mode="after")
    def _absorbs_what_it_sends(self) -> Medium:
        for number, channel in enumerate(("red", "green", "blue")):
            if self.emission[number] > 0.0 and self.absorption[number] + self.scattering[number] == 0.0:
                text = f"shines in {channel} without absorbing or scattering it; give it some absorption"
                raise fault("medium", text, "emission")
        return self

    @property
    def glows(self) -> bool:
        """Whether it emits light."""
        return max(self.emission) > 0.0

    @property
    def scatters(self) -> bool:
        """Whether it scatters light."""
        return max(self.scattering) > 0.0

    @property
    def numbers(self) -> tuple[Vector, Vector, float]:
        """Absorption and scattering coefficients, and mean cosine."""
        return (self.absorption, self.scattering, self.g if self.scatters else 0.0)
