"""Converts Mitsuba's colours and textures to ours."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from clrender.exact.angles import angle_of, sin_cos
from clrender.exact.matrices import length
from clrender.image.pictures import CODED_ENDINGS
from clrender.importers.mitsuba.nested_spectra import NESTED_SPECTRA, nested_spectrum
from clrender.importers.mitsuba.plugins import Plugin, Spectrum
from clrender.importers.shared.curved import map_of, mean_color
from clrender.importers.shared.matrices import Matrix
from clrender.importers.shared.spectra import light_table, reflectance_table
from clrender.importers.shared.staging import Staging
from clrender.spectra.colors import Color, blackbody_color, light_color, luminance, reflectance_color
from clrender.wording import quoted, suggestion

__all__ = ["TextureReader"]

_WRAPS: Final = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp"}
_FILTERS: Final = {"bilinear": "linear", "nearest": "nearest", "trilinear": "linear", "ewa": "linear"}


_COLDEST: Final = 100.0
_HOTTEST: Final = 1e5
"""Temperatures of black bodies in scenes, kelvin."""


class TextureReader:
    """Reads colours, or textures instead of them.

    Parameters
    ----------
    staging : Staging
    old : bool
        Whether the file is one of 0.6, whose images are upright.

    Attributes
    ----------
    colored : bool
        Whether a colour was read that is that of the vertices.
    """

    def __init__(self, staging: Staging, old: bool) -> None:
        self._staging, self._old = staging, old
        self.colored = False

    def light(self, plugin: Plugin, name: str, default: float) -> Color:
        """The colour of a light."""
        nested = plugin.child(name)
        if nested is not None and nested.kind == "spectrum":
            return self._nested_light(nested)
        if nested is not None:
            self._staging.note(f"a texture as {quoted(name)} of {plugin.label} is left out: it shines with {default:g}")
            return (default,) * 3
        return self.light_of(plugin.spectrum(name), default)

    def shining(self, plugin: Plugin, name: str, default: float) -> Any:
        """What a light sends out as scenes say it: a colour, or a spectrum."""
        nested, spectrum = plugin.child(name), plugin.spectrum(name)
        color = self.light(plugin, name, default)
        if nested is not None and nested.kind == "spectrum":
            kelvin = nested.number("temperature", 5000.0) if nested.type == "blackbody" else 0.0
            if _COLDEST <= kelvin <= _HOTTEST:
                return {"blackbody": kelvin, "scale": luminance(color)}
            spectrum = None if nested.type in ("rgb", "srgb") else nested_spectrum(nested)
        if spectrum is None or spectrum.color is not None:
            return list(color)
        if not spectrum.wavelengths:
            return {"illuminant": "E", "scale": spectrum.values[0]} if spectrum.values[0] >= 0.0 else list(color)
        return light_table(spectrum.wavelengths, spectrum.values) or list(color)

    def light_of(self, spectrum: Spectrum | None, default: float) -> Color:
        """The colour of a light with this spectrum."""
        if spectrum is None:
            return (default,) * 3
        if spectrum.color is not None:
            return spectrum.color
        if not spectrum.wavelengths:
            # Equal power at all wavelengths, which is reddish compared with D65
            return light_color([300.0, 900.0], [spectrum.values[0]] * 2)
        return light_color(spectrum.wavelengths, spectrum.values)

    def _nested_light(self, nested: Plugin) -> Color:
        if nested.type == "blackbody":
            kelvin, scale = nested.number("temperature", 5000.0), nested.number("scale", 1.0)
            if not 1.0 <= kelvin <= 1e6:
                raise nested.fault(f"the temperature is {kelvin:g}; it must be 1 to 1000000 kelvin")
            red, green, blue = blackbody_color(kelvin)
            return red * scale, green * scale, blue * scale
        if nested.type in ("d65", *NESTED_SPECTRA):
            if nested.type != "d65":
                return self.light_of(nested_spectrum(nested), 1.0)
            # D65 is the white point of Rec. 709
            factors = [self.light_of(nested.spectrum(name), 1.0) for name in ("scale", "color")]
            self._tell_unused(nested)
            red, green, blue = (a * b for a, b in zip(*factors, strict=True))
            return red, green, blue
        self._staging.note(f"{nested.label} is not known: white in its place")
        return 1.0, 1.0, 1.0

    def color(self, plugin: Plugin, name: str, default: float, texture: bool = True) -> Any:
        """A reflectance: a colour, or one of our textures if allowed.

        Parameters
        ----------
        plugin : Plugin
        name : str
        default : float
        texture : bool
            Whether a texture is allowed.
        """
        nested = plugin.child(name)
        if nested is not None and nested.kind == "texture" and texture:
            return self.texture(nested)
        if nested is not None:
            if nested.type in NESTED_SPECTRA:
                found = nested_spectrum(nested)
                return self._staging.reflectance(self.surface_of(found, default), f"{quoted(name)} of {plugin.label}")
            sentence = f"{nested.label} cannot be {quoted(name)} of {plugin.label}: {default:g} in its place"
            self._staging.note(sentence)
            return [default] * 3
        color = self.surface_of(plugin.spectrum(name), default)
        return self._staging.reflectance(color, f"{quoted(name)} of {plugin.label}")

    def reflecting(self, plugin: Plugin, name: str, default: float) -> Any:
        """A reflectance: like `color`, or a spectrum."""
        nested = plugin.child(name)
        spectrum = plugin.spectrum(name) if nested is None else nested_spectrum(nested)
        color = self.color(plugin, name, default)
        if spectrum is None or spectrum.color is not None or not spectrum.wavelengths:
            return color
        return reflectance_table(spectrum.wavelengths, spectrum.values) or color

    def surface_of(self, spectrum: Spectrum | None, default: float) -> Color:
        """The colour of a surface with this spectrum."""
        if spectrum is None:
            return (default,) * 3
        if spectrum.color is not None:
            return spectrum.color
        if not spectrum.wavelengths:
            return (spectrum.values[0],) * 3
        return reflectance_color(spectrum.wavelengths, spectrum.values)

    def share(self, plugin: Plugin, name: str, default: float) -> Any:
        """A number between 0 and 1, or one of our textures."""
        nested = plugin.child(name)
        if nested is not None and nested.kind == "texture":
            found = self.texture(nested, number=True)
            return sum(found) / 3.0 if isinstance(found, list) else found
        return self._staging.share(plugin.number(name, default), f"{quoted(name)} of {plugin.label}")

    def emission(self, plugin: Plugin) -> Any:
        """Radiance of an area light: a colour, or a texture."""
        nested = plugin.child("radiance")
        if nested is not None and nested.kind == "texture":
            return self.texture(nested, light=True)
        return self.shining(plugin, "radiance", 1.0)

    def texture(self, plugin: Plugin, number: bool = False, light: bool = False) -> Any:
        """One of our textures, or a colour.

        Parameters
        ----------
        plugin : Plugin
        number : bool
            Whether it is a number, whose images are linear by default.
        light : bool
            Whether its colours are those of light.
        """
        if plugin.busy:
            raise plugin.fault("the texture contains itself; give it another one")
        plugin.busy = True
        made: Any
        if plugin.type == "bitmap":
            made = self._bitmap(plugin, number)
        elif plugin.type in ("checkerboard", "checker"):
            colors = [self._of_checker(plugin, f"color{i}", default, light) for i, default in ((0, 0.4), (1, 0.2))]
            made = {"checker": colors, **self._transform(plugin, False)}
        elif plugin.type == "mesh_attribute" and not (number or light) and plugin.text("name") == "vertex_color":
            made = [self._staging.share(plugin.number("scale", 1.0), f'"scale" of {plugin.label}')] * 3
            self.colored = True
        elif plugin.type == "scale" and plugin.children_of("texture"):
            made = self._scaled(plugin, self.texture(plugin.children_of("texture")[0], number, light), light)
        else:
            self._staging.note(f"{plugin.label} is not known: grey of 0.5 in its place")
            plugin.ignore(*plugin.values)
            made = [0.5, 0.5, 0.5]
        plugin.busy = False
        self._tell_unused(plugin)
        return made

    def _tell_unused(self, plugin: Plugin) -> None:
        for name in plugin.unused():
            self._staging.note(f"{quoted(name)} of {plugin.label} is not understood and does nothing")

    def _of_checker(self, plugin: Plugin, name: str, default: float, light: bool) -> list[float]:
        """One of the colours of a checkerboard; that of a texture is its mean."""
        nested = plugin.child(name)
        if nested is None:
            found = plugin.spectrum(name)
            color = self.light_of(found, default) if light else self.surface_of(found, default)
        elif nested.kind == "texture":
            self._staging.note("a texture in a checkerboard is read as its mean colour")
            made = self.texture(nested, light=light)
            return made if isinstance(made, list) else mean_color(self._staging, made, default, plugin.line)
        elif light:
            color = self._nested_light(nested)
        else:
            made = self.color(plugin, name, default, texture=False)
            return list(made)
        return list(color) if light else self._staging.reflectance(color, plugin.label)

    def _scaled(self, plugin: Plugin, whole: Any, light: bool) -> Any:
        """A texture of 0.6 times a number or a colour."""
        factor = self.factor(plugin)

        def times(color: Any) -> list[float]:
            product = [a * b for a, b in zip(color, factor, strict=True)]
            return product if light else self._staging.reflectance((product[0], product[1], product[2]), plugin.label)

        if isinstance(whole, list):
            return times(whole)
        if "checker" in whole:
            return {**whole, "checker": [times(color) for color in whole["checker"]]}
        before = np.ones(3) * whole.get("scale", 1.0)
        scale = [max(float(a * b), 0.0) for a, b in zip(before, factor, strict=True)]
        return {**whole, "scale": scale[0] if len(set(scale)) == 1 else scale}

    def factor(self, plugin: Plugin) -> Color:
        """What a texture of 0.6 that scales another one multiplies it by."""
        return self.surface_of(plugin.spectrum("scale" if plugin.has("scale") else "value"), 1.0)

    def picture(self, plugin: Plugin, number: bool) -> dict[str, Any] | None:
        """A bitmap for a bump map, of numbers, or a normal map; None for other textures."""
        if plugin.type != "bitmap":
            self._staging.note(f"{plugin.label} cannot be a map of normals or heights: it is left out")
            return None
        return map_of(self._staging, self._bitmap(plugin, number), plugin.line, number)

    def _bitmap(self, plugin: Plugin, number: bool) -> dict[str, Any]:
        plugin.ignore("accel", "format", "cache", "max_anisotropy")
        file = plugin.text("filename")
        if not file:
            raise plugin.fault('the bitmap has no "filename"; give it')
        made: dict[str, Any] = {"texture": self._staging.files.name(file, f"line {plugin.line}")}
        raw = plugin.flag("raw", False) or plugin.number("gamma", 0.0) == 1.0
        if file.lower().endswith(CODED_ENDINGS):
            made["color_space"] = "linear" if raw else "srgb"
        wrap = plugin.text("wrap_mode", "repeat")
        made["wrap"] = self._chosen(plugin, wrap, _WRAPS, "wrap_mode")
        made["filter"] = self._chosen(plugin, plugin.text("filter_type", "bilinear"), _FILTERS, "filter_type")
        if number:
            made["channel"] = "luminance"
        return {**made, **self._transform(plugin, not self._old)}

    def _chosen(self, plugin: Plugin, value: str, known: dict[str, str], name: str) -> str:
        if value not in known:
            raise plugin.fault(f"{quoted(name)} is {quoted(value)}, which is not known{suggestion(value, known)}")
        return known[value]

    def _transform(self, plugin: Plugin, upside_down: bool) -> dict[str, Any]:
        """Our transform of texture coordinates.

        Mitsuba 3 has v = 0 at the top edge of an image, we (and 0.6) at the bottom: its v is 1 - ours.
        """
        if self._old:
            scale = [plugin.number(f"{axis}scale", 1.0) for axis in "uv"]
            offset = [plugin.number(f"{axis}offset", 0.0) for axis in "uv"]
            plane = np.array([[scale[0], 0.0, offset[0]], [0.0, scale[1], offset[1]]])
        else:
            matrix: Matrix = plugin.matrix("to_uv")
            # The translation of a 2D matrix may be in the third column, or in the fourth
            plane = np.array([[matrix[i, 0], matrix[i, 1], matrix[i, 3] + matrix[i, 2]] for i in (0, 1)])
        if upside_down:
            plane[1] = -plane[1]
            plane[1, 2] += 1.0
        return self._as_steps(plugin, plane)

    def _as_steps(self, plugin: Plugin, plane: Any) -> dict[str, Any]:
        """Decompose a matrix into scale, then rotation, then translation, at least approximately."""
        first, second = plane[:, 0], plane[:, 1]
        along, turn = length(first), angle_of(float(first[1]), float(first[0]))
        sine, cosine = sin_cos(turn)
        across = float(-sine * second[0] + cosine * second[1])
        skew = float(cosine * second[0] + sine * second[1])
        if abs(skew) > 1e-6 * max(along, abs(across)):
            self._staging.note(f"the transform of {plugin.label} is skewed, which is not known here: without the skew")
        if abs(turn) > 3.0:  # half a turn is a scale, which is easier to read
            along, across, turn = -along, -across, 0.0 if abs(abs(turn) - math.pi) < 1e-9 else turn - math.pi
        shift = [float(plane[0, 2]), float(plane[1, 2])]
        if (along, across, turn, shift) == (1.0, 1.0, 0.0, [0.0, 0.0]):
            return {}
        return {"transform": {"scale": [along, across], "rotate_degrees": math.degrees(turn), "offset": shift}}
