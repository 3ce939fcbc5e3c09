"""Converts pbrt's participating media to ours."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from clrender.errors import SceneError
from clrender.grids import GridData
from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.textures import TextureReader
from clrender.importers.shared.matrices import Matrix, is_affine, transform_key
from clrender.importers.shared.measured_media import MEASURED_MEDIA
from clrender.importers.shared.staging import Staging
from clrender.spectra.colors import Color
from clrender.wording import quoted, suggestion

__all__ = ["MediumReader"]

_MOST_G: Final = 0.99
_NAME_LIMIT: Final = 160
_GRIDS: Final = ("uniformgrid", "heterogeneous", "nanovdb")
_TEMPERATURE: Final = ("temperature", "temperaturescale", "temperaturecutoff", "temperatureoffset")


class MediumReader:
    """Converts media, and maps pbrt's names to them.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    """

    def __init__(self, staging: Staging, textures: TextureReader) -> None:
        self._staging, self._textures = staging, textures
        self._named: dict[str, str] = {}

    def named(self, name: str) -> str | None:
        """Our name of a medium; None if there is none of that name, or one that is not supported."""
        return self._named.get(name)

    def define(self, name: str, parameters: Parameters, matrix: Matrix) -> None:
        """Define a named medium; `matrix` places its grid, if it has one."""
        kind = parameters.text("type", "homogeneous")
        if kind != "homogeneous" and kind not in _GRIDS:
            self._staging.note(f"a medium of type {quoted(kind)} is not known and left out")
            return
        measured = self.measured(parameters, "preset")
        if measured is None:
            measured = (
                self._textures.coefficients(parameters, "sigma_s", (1.0, 1.0, 1.0)),
                self._textures.coefficients(parameters, "sigma_a", (1.0, 1.0, 1.0)),
            )
        density = None
        if kind in _GRIDS:
            density = self._density(name, kind, parameters, matrix)
            if density is None:
                return
        self._named[name] = self.added(name, *measured, parameters, density)
        for unknown in parameters.unused():
            self._staging.note(f"{quoted(unknown)} of a medium is not understood and does nothing")

    def _density(self, name: str, kind: str, parameters: Parameters, matrix: Matrix) -> dict[str, Any] | None:
        """The grid of a medium; None if it is left out."""
        if not is_affine(matrix):
            raise parameters.fault("the medium's transform is no affine one that can be inverted; give it another")
        for key in _TEMPERATURE:
            if key in parameters.values:
                parameters.get(key)
                self._staging.note(f"the medium {quoted(name)} does not shine by its {key}, which is not known")
        if kind == "nanovdb":
            file = parameters.text("filename")
            if not file:
                raise parameters.fault('the medium has no "filename"; give it')
            line = parameters.values["filename"].line
            grid = self._staging.grid_of_file(file, line)
            return None if grid is None else {"file": grid, **transform_key(matrix)}
        sides = [int(parameters.number(key, 1.0)) for key in ("nz", "ny", "nx")]
        values = parameters.numbers("density")
        if values is None:
            raise parameters.fault('the medium has no "density"; give it')
        if min(sides) < 1 or len(values) != sides[0] * sides[1] * sides[2]:
            nz, ny, nx = sides
            raise parameters.fault(f"the medium has {len(values)} densities for {nx} x {ny} x {nz}", "density")
        low, high = (parameters.numbers(key, 3) for key in ("p0", "p1"))
        corners = [[float(x) for x in (each[0] if each is not None else [default] * 3)]
                   for each, default in ((low, 0.0), (high, 1.0))]  # fmt: skip
        key = f"densities of {name}"
        try:
            grid_data = GridData.checked(values.astype(np.float32).reshape(sides), "the medium")
        except SceneError as error:
            raise parameters.fault(str(error), "density") from None
        self._staging.draft.grids[key] = grid_data
        return {"file": key, "box": corners, "edges": "fall", **transform_key(matrix)}

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
        density: dict[str, Any] | None = None,
    ) -> str:
        """Add a medium with the scale and the mean cosine of a directive; returns its name.

        Parameters
        ----------
        wanted : str
            Its name, if that is free or of an equal medium.
        scattering, absorption : three floats
            Per unit of length, times the scale.
        parameters : Parameters
        density : dict, optional
            Its grid.
        """
        scale = parameters.number("scale", 1.0)
        made: dict[str, Any] = {
            "absorption": [max(x * scale, 0.0) for x in absorption],
            "scattering": [max(x * scale, 0.0) for x in scattering],
            "g": min(max(parameters.number("g", 0.0), -_MOST_G), _MOST_G),
        }
        if density is not None:
            made["density"] = density
        emitted = self._textures.coefficients(parameters, "Le", (0.0, 0.0, 0.0))
        if any(x > 0.0 for x in emitted):
            factors = parameters.numbers("Lescale")
            if factors is not None and len(factors) > 1:
                self._staging.note(f"the grid of the emission of the medium {quoted(wanted)} is read as its mean")
            factor = scale * (1.0 if factors is None else float(np.cumsum(factors)[-1]) / len(factors))
            made["emission"] = [max(le * a * factor, 0.0) for le, a in zip(emitted, absorption, strict=True)]
        media = self._staging.draft.description.setdefault("media", {})
        name, number = wanted[:_NAME_LIMIT], 2
        while media.get(name, made) != made:
            name, number = f"{wanted[:_NAME_LIMIT]} {number}", number + 1
        media[name] = made
        return name
