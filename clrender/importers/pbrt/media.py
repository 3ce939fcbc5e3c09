"""Converts pbrt's participating media to ours."""

from __future__ import annotations

from typing import Any, Final

from clrender.importers.pbrt.parameters import Parameters
from clrender.importers.pbrt.textures import TextureReader
from clrender.importers.shared.measured_media import MEASURED_MEDIA
from clrender.importers.shared.spectra import Color
from clrender.importers.shared.staging import Staging
from clrender.wording import quoted, suggestion

__all__ = ["MediumReader"]

_MOST_G: Final = 0.99
_NAME_LIMIT: Final = 160


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

    def define(self, name: str, parameters: Parameters) -> None:
        """Define a named medium."""
        kind = parameters.text("type", "homogeneous")
        if kind != "homogeneous":
            self._staging.note(f"a medium of type {quoted(kind)} is not known and left out")
            return
        measured = self.measured(parameters, "preset")
        if measured is None:
            measured = (
                self._textures.coefficients(parameters, "sigma_s", (1.0, 1.0, 1.0)),
                self._textures.coefficients(parameters, "sigma_a", (1.0, 1.0, 1.0)),
            )
        self._named[name] = self.added(name, *measured, parameters)
        for unknown in parameters.unused():
            self._staging.note(f"{quoted(unknown)} of a medium is not understood and does nothing")

    def measured(self, parameters: Parameters, key: str) -> tuple[Color, Color] | None:
        """Scattering and absorption of a measured medium; None if none is named."""
        name = parameters.text(key)
        if not name:
            return None
        if name not in MEASURED_MEDIA:
            text = f"the medium {quoted(name)} is not known{suggestion(name, MEASURED_MEDIA)}"
            raise parameters.fault(text, key)
        return MEASURED_MEDIA[name]

    def added(self, wanted: str, scattering: Color, absorption: Color, parameters: Parameters) -> str:
        """Add a medium with the scale and the mean cosine of a directive; returns its name.

        Parameters
        ----------
        wanted : str
            Its name, if that is free or of an equal medium.
        scattering, absorption : three floats
            Per unit of length, times the scale.
        parameters : Parameters
        """
        scale = parameters.number("scale", 1.0)
        made: dict[str, Any] = {
            "absorption": [max(x * scale, 0.0) for x in absorption],
            "scattering": [max(x * scale, 0.0) for x in scattering],
            "g": min(max(parameters.number("g", 0.0), -_MOST_G), _MOST_G),
        }
        media = self._staging.draft.description.setdefault("media", {})
        name, number = wanted[:_NAME_LIMIT], 2
        while media.get(name, made) != made:
            name, number = f"{wanted[:_NAME_LIMIT]} {number}", number + 1
        media[name] = made
        return name
