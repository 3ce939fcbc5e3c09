"""Converts pbrt's participating media to ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from clrender.errors import SceneError
from clrender.grids import GridData
from clrender.importers.pbrt.definitions import Definitions
from clrender.importers.pbrt.film import Exposure
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.textures import TextureReader
from clrender.importers.shared.colored_grids import density_and_hue
from clrender.importers.shared.matrices import Matrix, is_affine, transform_key
from clrender.importers.shared.measured_media import MEASURED_MEDIA
from clrender.importers.shared.staging import Staging
from clrender.spectra.colors import Color
from clrender.wording import quoted, suggestion

__all__ = ["MediumReader"]

_MOST_G: Final = 0.99
_GRIDS: Final = ("uniformgrid", "heterogeneous", "nanovdb", "rgbgrid")
_LEAST_EXTINCTION: Final = 1e-12


class MediumReader:
    """Converts media, and maps pbrt's names to them.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    """

    def __init__(self, staging: Staging, textures: TextureReader) -> None:
        self._staging, self._textures = staging, textures
        self._named: Definitions[str, str | None] = Definitions()
        self.exposure = Exposure()
        """What the film makes of all light."""

    def named(self, name: str) -> str | None:
        """Our name of a medium; None if there is none of that name, or one that is not supported."""
        if name in self._named:
            return self._named[name]
        if name:
            self._staging.note(f"the medium {quoted(name)} is not defined: nothing is in its place")
        return None

    def define(self, name: str, parameters: Parameters, matrix: Matrix) -> Callable[[], None]:
        """Define a named medium; `matrix` places its grid, if it has one.

        The result makes it: see `Definitions.define`.
        """
        return self._named.define(name, lambda: self._made(name, parameters, matrix))

    def _made(self, name: str, parameters: Parameters, matrix: Matrix) -> str | None:
        """Our name of a new medium; None if it is left out."""
        kind = parameters.text("type", "homogeneous")
        if kind != "homogeneous" and kind not in _GRIDS:
            self._staging.note(f"a medium of type {quoted(kind)} is not known and left out")
            return None
        if kind == "rgbgrid":
            return self._colored(name, parameters, matrix)
        measured, spectra = self.measured(parameters, "preset"), dict[str, Any]()
        if measured is None:
            measured = (
                self._textures.coefficients(parameters, "sigma_s", (1.0, 1.0, 1.0)),
                self._textures.coefficients(parameters, "sigma_a", (1.0, 1.0, 1.0)),
            )
            spectra = self.spectra(parameters)
        grids = {}
        if kind in _GRIDS:
            found = self._grids(name, kind, parameters, matrix)
            if found is None:
                return None
            grids = found
        made = self.added(name, *measured, parameters, {**spectra, **grids})
        self._tell_unused(parameters)
        return made

    def spectra(self, parameters: Parameters) -> dict[str, Any]:
        """Coefficients that are spectra, times the scale, by our keys."""
        scale = parameters.number("scale", 1.0)
        found = {
            key: self._textures.spectrum_of_coefficient(parameters, name, scale)
            for key, name in (("absorption", "sigma_a"), ("scattering", "sigma_s"))
        }
        return {key: said for key, said in found.items() if said is not None}

    def _tell_unused(self, parameters: Parameters) -> None:
        for unknown in parameters.unused():
            self._staging.note(f"{quoted(unknown)} of a medium is not understood and does nothing")

    def _grids(self, name: str, kind: str, parameters: Parameters, matrix: Matrix) -> dict[str, Any] | None:
        """The grids of a medium; None if it is left out."""
        if not is_affine(matrix):
            raise parameters.fault("the medium's transform is no affine one that can be inverted; give it another")
        if kind == "nanovdb":
            file = parameters.text("filename")
            if not file:
                raise parameters.fault('the medium has no "filename"; give it')
            line = parameters.values["filename"].line
            grid = self._staging.grid_of_file(file, line)
            if grid is None:
                return None
            made = {"density": {"file": grid, **transform_key(matrix)}}
            if self._staging.has_grid(file, line, "temperature"):
                also = self._staging.grid_of_file(file, line, "temperature")
                if also is not None:
                    made["temperature"] = {"file": also, **transform_key(matrix), **self._kelvin(parameters)}
            return made
        sides = self._sides(parameters)
        made = {"density": {**self._inline(name, "density", parameters, sides, matrix), "edges": "fall"}}
        if parameters.get("temperature") is not None:
            hot = self._inline(name, "temperature", parameters, sides, matrix)
            made["temperature"] = {**hot, **self._kelvin(parameters)}
        factors = parameters.numbers("Lescale")
        if factors is not None and len(factors) > 1 and "temperature" not in made:
            made["emission_grid"] = self._inline(name, "Lescale", parameters, sides, matrix)
        return made

    def _kelvin(self, parameters: Parameters) -> dict[str, float]:
        """How numbers become kelvin."""
        offset = parameters.number("temperatureoffset", parameters.number("temperaturecutoff", 0.0))
        scale = parameters.number("temperaturescale", 1.0)
        if not scale > 0.0:
            raise parameters.fault("the scale of temperatures must be above 0", "temperaturescale")
        return {"offset": offset, "scale": scale}

    def _sides(self, parameters: Parameters) -> tuple[int, int, int]:
        nz, ny, nx = (int(parameters.number(key, 1.0)) for key in ("nz", "ny", "nx"))
        return nz, ny, nx

    def _inline(
        self, name: str, key: str, parameters: Parameters, sides: tuple[int, int, int], matrix: Matrix
    ) -> dict[str, Any]:
        """A grid whose numbers are in the scene file."""
        values = parameters.numbers(key)
        if values is None:
            raise parameters.fault(f"the medium has no {quoted(key)}; give it")
        if min(sides) < 1 or len(values) != sides[0] * sides[1] * sides[2]:
            nz, ny, nx = sides
            numbers = "densities" if key == "density" else f"numbers of {quoted(key)}"
            raise parameters.fault(f"the medium has {len(values)} {numbers} for {nx} x {ny} x {nz}", key)
        return self._kept(name, key, values.reshape(sides), parameters, matrix)

    def _kept(
        self, name: str, key: str, values: NDArray[np.float64], parameters: Parameters, matrix: Matrix
    ) -> dict[str, Any]:
        """A grid of the medium's box, kept for the scene."""
        low, high = (parameters.numbers(each, 3) for each in ("p0", "p1"))
        corners = [[float(x) for x in (each[0] if each is not None else [default] * 3)]
                   for each, default in ((low, 0.0), (high, 1.0))]  # fmt: skip
        asset = f"densities of {name}" if key == "density" else f"{key} of {name}"
        try:
            self._staging.draft.grids[asset] = GridData.checked(values, "the medium")
        except SceneError as error:
            raise parameters.fault(str(error), key) from None
        return {"file": asset, "box": corners, **transform_key(matrix)}

    def _colored(self, name: str, parameters: Parameters, matrix: Matrix) -> str:
        """A medium whose coefficients are colours that vary from place to place."""
        if not is_affine(matrix):
            raise parameters.fault("the medium's transform is no affine one that can be inverted; give it another")
        sides = self._sides(parameters)
        absorption, scattering, emitted = (self._colors(key, parameters, sides) for key in ("sigma_a", "sigma_s", "Le"))
        if absorption is None and scattering is None:
            raise parameters.fault('the medium has neither "sigma_a" nor "sigma_s"; give one of them')
        ones = np.ones((*sides, 3))
        lost, turned = (ones if each is None else each for each in (absorption, scattering))
        extinction = lost + turned
        density, hue, varies = density_and_hue(extinction)
        if varies:
            self._staging.note(
                f"in the medium {quoted(name)}, colours weaken alike everywhere: by the mean of their hues"
            )
        share = np.minimum(turned / np.where(extinction > _LEAST_EXTINCTION, extinction, 1.0), 1.0)
        scale = max(parameters.number("scale", 1.0), 0.0)
        made: dict[str, Any] = {
            "scattering": [scale * each for each in hue],
            "g": min(max(parameters.number("g", 0.0), -_MOST_G), _MOST_G),
        }
        if any(each > 0.0 for each in made["scattering"]):
            made["density"] = {**self._kept(name, "density", density, parameters, matrix), "edges": "fall"}
            made["albedo"] = self._kept(name, "albedo", share, parameters, matrix)
            factor = scale * parameters.number("Lescale", 1.0) * self.exposure.ratio
            if emitted is not None and emitted.any() and factor > 0.0:
                emitted = self.exposure.balanced(emitted)
                # What weakens no light sends none
                made["emission"] = [factor if each > 0.0 else 0.0 for each in hue]
                some = np.where(density > _LEAST_EXTINCTION, density, 1.0)[..., None]
                made["emission_grid"] = self._kept(name, "Le", lost * emitted / some, parameters, matrix)
        self._tell_unused(parameters)
        return self._staging.medium(name, made)

    def _colors(self, key: str, parameters: Parameters, sides: tuple[int, int, int]) -> NDArray[np.float64] | None:
        """A grid of colours in the scene file."""
        values = parameters.numbers(key, 3)
        if values is None:
            return None
        if not (values >= 0.0).all():
            raise parameters.fault(f"a number of {quoted(key)} is below 0", key)
        nz, ny, nx = sides
        if min(sides) < 1 or len(values) != nz * ny * nx:
            raise parameters.fault(f"the medium has {len(values)} colours of {quoted(key)} for {nx} x {ny} x {nz}", key)
        return values.reshape(*sides, 3)

    def measured(self, parameters: Parameters, key: str) -> tuple[Color, Color] | None:
        """Scattering and absorption of a measured medium; None if none is named."""
        name = parameters.text(key)
        if not name:
            return None
        if name not in MEASURED_MEDIA:
            text = f"the medium {quoted(name)} is not known{suggestion(name, MEASURED_MEDIA)}"
            raise parameters.fault(text, key)
        return MEASURED_MEDIA[name]

    def added(
        self,
        wanted: str,
        scattering: Color,
        absorption: Color,
        parameters: Parameters,
        more: dict[str, Any] | None = None,
    ) -> str:
        """Add a medium with the scale and the mean cosine of a directive; returns its name.

        Parameters
        ----------
        wanted : str
            Its name, if that is free or of an equal medium.
        scattering, absorption : three floats
            Per unit of length, times the scale.
        parameters : Parameters
        more : dict, optional
            Its grids, and coefficients that are spectra.
        """
        scale = parameters.number("scale", 1.0)
        made: dict[str, Any] = {
            "absorption": [max(x * scale, 0.0) for x in absorption],
            "scattering": [max(x * scale, 0.0) for x in scattering],
            "g": min(max(parameters.number("g", 0.0), -_MOST_G), _MOST_G),
        }
        made |= more or {}
        given = (0.0, 0.0, 0.0) if parameters.get("Le") is None else self._textures.light(parameters, "Le")
        if "temperature" in made and self.exposure.balance is not None:
            self._staging.note("a medium that shines by temperatures gets the white balance of white")
        emitted = self.exposure.balanced((1.0, 1.0, 1.0) if "temperature" in made else given)
        if any(x > 0.0 for x in emitted):
            factors = parameters.numbers("Lescale")
            mean = 1.0 if factors is None else float(np.cumsum(factors)[-1]) / len(factors)
            if factors is not None and len(factors) > 1 and "temperature" in made:
                self._staging.note(
                    f"the scales of the temperatures of the medium {quoted(wanted)} are read as their mean"
                )
            factor = scale * (1.0 if "emission_grid" in made else mean) * self.exposure.ratio
            made["emission"] = [max(float(le * a * factor), 0.0) for le, a in zip(emitted, absorption, strict=True)]
        if not any(made.get("emission", ())):
            for key in ("emission", "emission_grid", "temperature"):
                made.pop(key, None)
        return self._staging.medium(wanted, made)
