"""Converts Mitsuba's participating media to ours."""

from __future__ import annotations

from typing import Any

from clrender.importers.mitsuba.plugins import Plugin
from clrender.importers.mitsuba.textures import TextureReader
from clrender.importers.shared.spectra import Color
from clrender.importers.shared.staging import Staging
from clrender.wording import quoted

__all__ = ["MediumReader"]

_MOST_G = 0.99


class MediumReader:
    """Converts media, each once.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader

    Attributes
    ----------
    bounded : set of str
        Names of the media that end at a shape.
    """

    def __init__(self, staging: Staging, textures: TextureReader) -> None:
        self._staging, self._textures = staging, textures
        self._made: dict[int, str] = {}
        self._kept: list[Plugin] = []
        self.bounded: set[str] = set()

    def name(self, plugin: Plugin) -> str | None:
        """The name of a medium; None for an unsupported one."""
        if plugin.type != "homogeneous":
            self._staging.note(f"{plugin.label} is not known and left out")
            return None
        if id(plugin) not in self._made:
            media = self._staging.draft.description.setdefault("media", {})
            name, described = (plugin.id or f"medium {len(media) + 1}")[:160], self._described(plugin)
            while media.get(name, described) != described:
                name += "'"
            self._made[id(plugin)] = name
            self._kept.append(plugin)
            media[name] = described
        return self._made[id(plugin)]

    def _described(self, plugin: Plugin) -> dict[str, Any]:
        scale = plugin.number("scale", 1.0)
        if plugin.has("sigma_a", "sigma_s"):  # 0.6
            absorption, scattering = (self._color(plugin, name, 0.0) for name in ("sigma_a", "sigma_s"))
        else:
            extinction, albedo = self._color(plugin, "sigma_t", 1.0), self._color(plugin, "albedo", 0.75)
            scattering = tuple(t * a for t, a in zip(extinction, albedo, strict=True))  # type: ignore[assignment]
            absorption = tuple(t * (1.0 - a) for t, a in zip(extinction, albedo, strict=True))  # type: ignore[assignment]
        made: dict[str, Any] = {
            "absorption": [max(scale * x, 0.0) for x in absorption],
            "scattering": [max(scale * x, 0.0) for x in scattering],
        }
        for phase in plugin.children_of("phase"):
            if phase.type == "hg":
                g = phase.number("g", 0.8)
                made["g"] = min(max(g, -_MOST_G), _MOST_G)
            elif phase.type != "isotropic":
                self._staging.note(f"{phase.label} is read as one that scatters alike to all sides")
        plugin.ignore("has_spectral_extinction", "sample_emitters")
        for name in plugin.unused():
            self._staging.note(f"{quoted(name)} of {plugin.label} is not understood and does nothing")
        return made

    def _color(self, plugin: Plugin, name: str, default: float) -> Color:
        nested = plugin.child(name)
        if nested is not None:
            if nested.type == "constvolume":
                return self._textures.surface_of(nested.spectrum("value"), default)
            self._staging.note(f"{nested.label} is not known: {default:g} in its place")
        return self._textures.surface_of(plugin.spectrum(name), default)
