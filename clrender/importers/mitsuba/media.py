"""Converts Mitsuba's participating media to ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from clrender.grids import GridData
from clrender.importers.mitsuba.nested_spectra import nested_spectrum
from clrender.importers.mitsuba.plugins import Plugin, Spectrum
from clrender.importers.mitsuba.textures import TextureReader
from clrender.importers.shared.colored_grids import density_and_hue
from clrender.importers.shared.matrices import transform_key
from clrender.importers.shared.spectra import coefficient_table, split_by_albedo
from clrender.importers.shared.staging import Staging
from clrender.spectra.colors import Color
from clrender.wording import quoted

__all__ = ["MediumReader"]

_MOST_G = 0.99
_ONE = "density of 1"
"""Name of a grid for media of which only the albedo is one."""


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
        if plugin.type not in ("homogeneous", "heterogeneous"):
            self._staging.note(f"{plugin.label} is not known and left out")
            return None
        if id(plugin) not in self._made:
            described = self._described(plugin)
            if described is None:
                return None
            media = self._staging.draft.description.setdefault("media", {})
            name = (plugin.id or f"medium {len(media) + 1}")[:160]
            while media.get(name, described) != described:
                name += "'"
            self._made[id(plugin)] = name
            self._kept.append(plugin)
            media[name] = described
        return self._made[id(plugin)]

    def _described(self, plugin: Plugin) -> dict[str, Any] | None:
        """A medium of ours; None if its grid is left out."""
        scale = plugin.number("scale", 1.0)
        density = albedos = None
        extinction = (1.0, 1.0, 1.0)
        nested = plugin.child("sigma_t") or plugin.child("density")
        if nested is not None and nested.type == "gridvolume":
            density = self._grid(nested)
            if density is None:
                return None
            extinction = self._hue(density, nested)
        spectra: dict[str, Any] = {}
        parts: tuple[Any, Any] | None = None
        if plugin.has("sigma_a", "sigma_s"):  # 0.6
            absorption, scattering = (self._color(plugin, name, 0.0) for name in ("sigma_a", "sigma_s"))
            for key, name in (("absorption", "sigma_a"), ("scattering", "sigma_s")):
                said = self._table(plugin, name, scale)
                if said is not None:
                    spectra[key] = said
        else:
            if density is None:
                extinction = self._color(plugin, "sigma_t", 1.0)
            thinned = None if density is not None else self._table(plugin, "sigma_t")
            volume = plugin.child("albedo")
            albedos = None if volume is None or volume.type != "gridvolume" else self._grid(volume)
            if albedos is not None and density is None:  # the same everywhere
                self._staging.draft.grids[_ONE] = GridData(np.ones((1, 1, 1), np.float32))
                density = {**albedos, "file": _ONE}
            albedo = (1.0, 1.0, 1.0) if albedos is not None else self._color(plugin, "albedo", 0.75)
            turned = None if albedos is not None else self._table(plugin, "albedo")
            scattering = tuple(t * a for t, a in zip(extinction, albedo, strict=True))  # type: ignore[assignment]
            absorption = tuple(t * (1.0 - a) for t, a in zip(extinction, albedo, strict=True))  # type: ignore[assignment]
            parts = thinned or extinction, turned or albedo
        made: dict[str, Any] = {
            "absorption": [max(scale * x, 0.0) for x in absorption],
            "scattering": [max(scale * x, 0.0) for x in scattering],
        }
        made |= spectra if parts is None else split_by_albedo(*parts, scale, made)
        if density is not None:
            made["density"] = density
        if albedos is not None:
            made["albedo"] = albedos
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

    def _grid(self, volume: Plugin) -> dict[str, Any] | None:
        """The grid of a volume; None if its file is left out."""
        file = volume.text("filename")
        if not file:
            raise volume.fault('the volume has no "filename"; give it')
        grid = self._staging.grid_of_file(file, volume.line)
        if grid is None:
            return None
        made: dict[str, Any] = {"file": grid, **transform_key(volume.matrix())}
        if not volume.flag("use_grid_bbox", False) and volume.type == "gridvolume":
            made["box"] = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
        if volume.text("filter_type", "trilinear") != "trilinear":
            self._staging.note(f"{volume.label} is read with linear interpolation")
        volume.ignore("raw", "accel", "wrap_mode")
        for name in volume.unused():
            self._staging.note(f"{quoted(name)} of {volume.label} is not understood and does nothing")
        return made

    def _hue(self, density: dict[str, Any], volume: Plugin) -> Color:
        """The colour of an extinction: that of a grid of colours, which becomes one of numbers."""
        data = self._staging.draft.grids[density["file"]]
        if data.channels == 1:
            return 1.0, 1.0, 1.0
        values, (red, green, blue), varies = density_and_hue(data.values.astype(np.float64))
        density["file"] = f"{density['file']} in numbers"
        self._staging.draft.grids[density["file"]] = GridData(values.astype(np.float32), data.placement)
        if varies:
            self._staging.note(f"in {volume.label}, colours weaken alike everywhere: by the mean of their hues")
        return (red, green, blue) if max(red, green, blue) > 0.0 else (1.0, 1.0, 1.0)

    def _color(self, plugin: Plugin, name: str, default: float) -> Color:
        return self._textures.surface_of(self._spectrum(plugin, name, default), default)

    def _table(self, plugin: Plugin, name: str, scale: float = 1.0) -> dict[str, Any] | None:
        """A coefficient, or an albedo, as scenes say it, times a scale; None if it is a colour."""
        found = self._spectrum(plugin, name, None)
        return None if found is None else coefficient_table(found.wavelengths, found.values, scale)

    def _spectrum(self, plugin: Plugin, name: str, default: float | None) -> Spectrum | None:
        """What is given by a name; notes what is not known, unless there is no default."""
        nested = plugin.child(name)
        if nested is None or nested.type == "gridvolume":
            return plugin.spectrum(name)
        if nested.type == "constvolume":
            return self._spectrum(nested, "value", default)
        found = nested_spectrum(nested)
        if found is None and default is not None:
            self._staging.note(f"{nested.label} is not known: {default:g} in its place")
        return found
