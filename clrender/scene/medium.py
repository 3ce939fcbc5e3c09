"""Media that fill shapes or the whole scene: the tables `[media.NAME]` of a scene file, validated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from clrender.scene.poses import Transform
from clrender.scene.spectra import Coefficient, LightColor, SpectralColor
from clrender.scene.values import FileName, Finite, Part, Text, Vector, fault
from clrender.spectra.colors import table_wavelengths

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["ColorGrid", "Density", "Grid", "Grids", "Medium", "Temperature"]


class Grid(Part):
    """Numbers in space."""

    file: FileName = Field(description="the grid: `.npy` of the shape (nz, ny, nx), `.vol`, `.nvdb` or `.vdb`")
    name: Text = Field("density", description="of an `.nvdb` or `.vdb` file, the name of the grid in it")
    box: tuple[Vector, Vector] | None = Field(
        None,
        description="lowest and highest corner of the grid's box, before the transform; default: where the file says, "
        "and of `.npy` the unit cube",
    )
    transform: Transform = Field(
        Transform(), description="of the box, in the space of the scene, or of the group whose shapes it fills"
    )

    @property
    def asset(self) -> str:
        """Names what is read from the file: of an ``.nvdb`` or ``.vdb`` one of several grids."""
        return f"{self.file} {self.name}" if self._may_be_one_of_several and self.name != "density" else self.file

    @property
    def _may_be_one_of_several(self) -> bool:
        return self.file.lower().endswith((".nvdb", ".vdb"))

    @model_validator(mode="after")
    def _is_named_in_its_file(self) -> Self:
        if not self._may_be_one_of_several and self.name != type(self).model_fields["name"].default:
            raise fault("medium", "is of a grid in an .nvdb or .vdb file; others have one grid: leave it out", "name")
        return self

    @model_validator(mode="after")
    def _has_a_volume(self) -> Self:
        if self.box is not None and not all(a < b for a, b in zip(*self.box, strict=True)):
            raise fault("medium", "has no volume; give the lowest corner first, and then the highest", "box")
        return self


class Density(Grid):
    """A grid of numbers by which a medium's absorption and scattering are multiplied; outside of its box they are 0."""

    edges: Literal["keep", "fall"] = Field(
        "keep",
        description="whether the density keeps the numbers of the outermost cells up to the edges, or falls to zeros",
    )


class ColorGrid(Grid):
    """Numbers, or colours (`.npy` (nz, ny, nx, 3), `.vol` of three channels), which go on beyond the edges."""


class Temperature(Grid):
    """A grid of temperatures, after (number - `offset`) `scale`, kelvin. It goes on beyond its edges."""

    name: Text = Field("temperature", description="of an `.nvdb` or `.vdb` file, the name of the grid in it")
    scale: Annotated[Finite, Field(gt=0.0, le=1e9)] = 1.0
    offset: Annotated[Finite, Field(ge=-1e9, le=1e9)] = 0.0


class Grids(NamedTuple):
    """The grids of a medium."""

    density: Density
    albedo: ColorGrid | None = None
    emission_grid: ColorGrid | None = None
    temperature: Temperature | None = None

    def given(self) -> Iterator[tuple[str, Grid]]:
        """Those that there are, with their keys."""
        for key, grid in self._asdict().items():
            if grid is not None:
                yield key, grid


def _met(coefficient: Vector) -> NDArray[np.bool_]:
    """(95,) at which lines of tables of spectra a coefficient is not 0."""
    if isinstance(coefficient, SpectralColor):
        return np.asarray(coefficient.values > 0.0)
    return np.full(len(table_wavelengths()), max(coefficient) > 0.0)


class Medium(Part):
    """Participating medium, such as smoke, fog or milk."""

    late_keys: ClassVar[frozenset[str]] = frozenset({"density", "emission", "albedo", "emission_grid", "temperature"})

    absorption: Coefficient = Field((0.0, 0.0, 0.0), description="absorption coefficient, per metre")
    scattering: Coefficient = Field((0.0, 0.0, 0.0), description="scattering coefficient, per metre")
    emission: LightColor = Field(
        (0.0, 0.0, 0.0),
        description="radiance that a metre of it adds, W/(sr m3); only where it also absorbs or scatters",
    )
    g: Annotated[Finite, Field(ge=-0.99, le=0.99)] = Field(
        0.0,
        description="anisotropy of the Henyey-Greenstein phase function: above 0 forward, below 0 backward scattering",
    )

    density: Density | None = Field(None, description="where it is how dense; default: the same everywhere")
    albedo: ColorGrid | None = Field(
        None,
        description="beside a density: grid, from 0 to 1, by which scattering is multiplied; the rest is absorbed",
    )
    emission_grid: ColorGrid | None = Field(
        None, description="beside a density: grid by which the emission is multiplied, too"
    )
    temperature: Temperature | None = Field(
        None,
        description="beside a density: grid of temperatures; the emission is multiplied by the colour of a black body, "
        "whose spectrum is 1 at its peak, and is 0 up to 100 K",
    )

    @model_validator(mode="after")
    def _absorbs_what_it_sends(self) -> Medium:
        for number, channel in enumerate(("red", "green", "blue")):
            if self.emission[number] > 0.0 and self.absorption[number] + self.scattering[number] == 0.0:
                text = f"shines in {channel} without absorbing or scattering it; give it some absorption"
                raise fault("medium", text, "emission")
        if isinstance(self.emission, SpectralColor):
            met = _met(self.absorption) | _met(self.scattering)
            if (alone := np.flatnonzero((self.emission.values > 0.0) & ~met)).size:
                line = float(table_wavelengths()[alone[0]])
                text = f"shines at {line:g} nm without absorbing or scattering there; give it some absorption"
                raise fault("medium", text, "emission")
        return self

    @model_validator(mode="after")
    def _has_what_grids_vary(self) -> Medium:
        for key in ("albedo", "emission_grid", "temperature"):
            if getattr(self, key) is None:
                continue
            of = "scattering" if key == "albedo" else "emission"
            if self.density is None:
                raise fault("medium", "is given without a density; give that a grid, too", key)
            if max(getattr(self, of)) == 0.0:
                raise fault("medium", f"does nothing without {of}; give some", key)
        if self.emission_grid is not None and self.temperature is not None:
            raise fault("medium", "is given beside temperature; keep one of them", "emission_grid")
        return self

    @property
    def grids(self) -> Grids | None:
        """Its grids, if it has a density."""
        if self.density is None:
            return None
        return Grids(self.density, self.albedo, self.emission_grid, self.temperature)

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
