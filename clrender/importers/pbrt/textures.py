"""Converts pbrt's spectra and textures to our colours and textures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, Final

from clrender.image.pictures import CODED_ENDINGS
from clrender.importers.pbrt.definitions import Definitions
from clrender.importers.pbrt.parameters import Parameter, Parameters
from clrender.importers.shared.curved import decoded, inverted, mean_color, number_channel, rooted
from clrender.importers.shared.metals import CONDUCTORS, GLASSES
from clrender.importers.shared.spectra import ILLUMINANTS, coefficient_table, light_table, reflectance_table
from clrender.importers.shared.staging import Staging, roughness_of
from clrender.spectra.colors import (
    Color,
    blackbody_color,
    light_color,
    luminance,
    reflectance_color,
    value_at,
)
from clrender.spectra.glasses import glass_index
from clrender.wording import quoted, suggestion

__all__ = ["TextureReader"]

_WRAPS: Final = {"repeat": "repeat", "clamp": "clamp", "black": "clamp", "octahedralsphere": "clamp"}
_TEXT_LIMIT: Final = 2**20
_SODIUM: Final = 587.6
"""Wavelength at which a dispersive index is evaluated, nanometres."""


class TextureReader:
    """Reads spectra and named textures.

    Parameters
    ----------
    staging : Staging
    """

    def __init__(self, staging: Staging) -> None:
        self._staging = staging
        self._textures: Definitions[tuple[str, str], Any] = Definitions()
        self._channels: dict[str, str] = {}

    # --- spectra

    def light(self, parameters: Parameters, name: str) -> Color:
        """The colour of a light; white if none is given.

        pbrt scales the spectra of lights to a luminance of 1, except for colours, where white has that luminance.
        """
        found = parameters.get(name)
        if found is None:
            return 1.0, 1.0, 1.0
        if found.kind == "rgb":
            return self._rgb(parameters, name, found)
        if found.kind == "blackbody":
            kelvin = parameters.number(name, 6500.0)
            if not 1.0 <= kelvin <= 1e6:
                raise parameters.fault(f"the temperature is {kelvin:g}; it must be 1 to 1000000 kelvin", name)
            return _of_unit_luminance(blackbody_color(kelvin))
        if found.kind != "spectrum":
            raise parameters.fault(
                f"{quoted(name)} is of type {found.kind}, but must be rgb, blackbody or spectrum", name
            )
        if isinstance(found.values, list) and found.values[:1] in (["stdillum-D65"], ["illum-D65"]):
            return 1.0, 1.0, 1.0
        waves, values = self._spectrum(parameters, name, found)
        return _of_unit_luminance(light_color(waves, values))

    def spectrum_of_light(self, parameters: Parameters, name: str, scale: float) -> dict[str, Any] | None:
        """The spectrum of a light of this luminance, as scenes say it; None if it is a colour."""
        found = parameters.get(name)
        if found is None or not 0.0 <= scale <= 1e12:
            return None
        if found.kind == "blackbody":
            kelvin = parameters.number(name, 6500.0)
            return {"blackbody": kelvin, "scale": scale} if 100.0 <= kelvin <= 1e5 else None
        if found.kind != "spectrum":
            return None
        if isinstance(found.values, list):
            named = found.values[0] if found.values else ""
            if named in ILLUMINANTS:
                return {"illuminant": ILLUMINANTS[named], "scale": scale}
            if "." not in named:
                return None
        waves, values = self._spectrum(parameters, name, found)
        bright = luminance(light_color(waves, values))
        return light_table(waves, values, scale / bright) if bright > 0.0 else None

    def _rgb(self, parameters: Parameters, name: str, found: Parameter) -> Color:
        if isinstance(found.values, list) or len(found.values) != 3:
            raise parameters.fault(f"{quoted(name)} must have three numbers", name)
        red, green, blue = (float(x) for x in found.values)
        return red, green, blue

    def _spectrum(self, parameters: Parameters, name: str, found: Parameter) -> tuple[list[float], list[float]]:
        """Wavelengths and values, from the scene file or another one."""
        numbers = found.values
        if isinstance(numbers, list):
            file = numbers[0] if numbers else ""
            if "." not in file:
                self._staging.note(f"the spectrum {quoted(file)} is not known: white, or 1, in its place")
                return [300.0, 900.0], [1.0, 1.0]
            text = self._staging.files.read(file, f"line {found.line}", _TEXT_LIMIT).decode("utf-8", "replace")
            words = [word for line in text.splitlines() for word in line.partition("#")[0].split()]
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                raise parameters.fault(f"{quoted(file)} holds other things than numbers", name) from None
            if not all(map(math.isfinite, numbers)):
                raise parameters.fault(f"{quoted(file)} has a number that is not finite; give another", name)
        if len(numbers) < 2 or len(numbers) % 2:
            raise parameters.fault(f"{quoted(name)} is no spectrum; give wavelengths, each with its value", name)
        waves, values = ([float(x) for x in numbers[first::2]] for first in (0, 1))
        if any(not later > earlier for earlier, later in itertools.pairwise(waves)):
            raise parameters.fault(f"the wavelengths of {quoted(name)} do not grow; sort them", name)
        return waves, values

    def spectrum_of_coefficient(self, parameters: Parameters, name: str, scale: float) -> dict[str, Any] | None:
        """The spectrum of a medium's coefficient times a scale, as scenes say it; None if it is a colour."""
        found = parameters.get(name)
        if found is None or found.kind != "spectrum":
            return None
        return coefficient_table(*self._spectrum(parameters, name, found), scale)

    def metal(self, parameters: Parameters, name: str, default: str) -> Color:
        """Real or imaginary part of the index of a metal."""
        found = parameters.get(name)
        part = 0 if name.endswith("eta") else 1
        if found is not None and found.kind == "rgb":
            return self._rgb(parameters, name, found)
        if found is not None and found.kind in ("float", "texture"):
            return (self.plain_number(parameters, name, 1.0),) * 3
        if found is None or (isinstance(found.values, list) and found.values and "." not in found.values[0]):
            named = found.values[0] if found is not None else default
            symbol = named.removeprefix("metal-").rsplit("-", 1)[0]
            if symbol not in CONDUCTORS or not named.startswith("metal-"):
                known = [f"metal-{each}-eta" for each in CONDUCTORS]
                raise parameters.fault(f"the metal {quoted(named)} is not known{suggestion(named, known)}", name)
            return CONDUCTORS[symbol][part]
        return reflectance_color(*self._spectrum(parameters, name, found))

    def index(self, parameters: Parameters, name: str = "eta", default: float = 1.5) -> float:
        """Index of refraction of a dielectric, at one wavelength."""
        found = parameters.get(name)
        if found is None:
            return default
        if found.kind == "spectrum":
            if isinstance(found.values, list) and found.values and found.values[0] in GLASSES:
                return glass_index(GLASSES[found.values[0]])
            return value_at(*self._spectrum(parameters, name, found), _SODIUM)
        return self.plain_number(parameters, name, default)

    def refraction(self, parameters: Parameters, name: str = "eta") -> dict[str, Any]:
        """Index of refraction of a dielectric as scenes say it: at one wavelength, or a dispersion."""
        found, ior = parameters.get(name), min(max(self.index(parameters, name), 1e-3), 1000.0)
        if found is None or found.kind != "spectrum":
            return {"ior": ior}
        if isinstance(found.values, list) and found.values and found.values[0] in GLASSES:
            return {"dispersion": {"glass": GLASSES[found.values[0]]}}
        waves, values = self._spectrum(parameters, name, found)
        table = light_table(waves, values)
        if table is None or not 1.0 <= min(values) <= max(values) <= 10.0:
            self._staging.note("an index of refraction below 1 or above 10 is that at 588 nm alone")
            return {"ior": ior}
        return {"dispersion": table}

    def plain_number(self, parameters: Parameters, name: str, default: float) -> float:
        """A number that cannot be a picture here: its default, with a note, in place of one."""
        found = parameters.get(name)
        if found is not None and found.kind == "texture":
            value = self._named(parameters, name, "float")
            if isinstance(value, list):
                return float(sum(value)) / 3.0
            self._staging.note(f"a texture as {quoted(name)} is left out: {default:g} in its place")
            return default
        return parameters.number(name, default)

    # --- reflectances and numbers, or textures

    def color(self, parameters: Parameters, name: str, default: float) -> Any:
        """A reflectance: a colour, or one of our textures."""
        found = parameters.get(name)
        if found is None:
            return [default] * 3
        if found.kind == "texture":
            return self._named(parameters, name, "spectrum")
        if found.kind == "rgb":
            color = self._rgb(parameters, name, found)
        elif found.kind == "float":
            color = (parameters.number(name, default),) * 3
        elif found.kind == "spectrum":
            color = reflectance_color(*self._spectrum(parameters, name, found))
        else:
            raise parameters.fault(f"{quoted(name)} is of type {found.kind}, but must be a colour", name)
        return self._staging.reflectance(color, f"{quoted(name)} of a material")

    def reflecting(self, parameters: Parameters, name: str, default: float) -> Any:
        """A reflectance: like `color`, or a spectrum."""
        color, found = self.color(parameters, name, default), parameters.get(name)
        if found is None or found.kind != "spectrum":
            return color
        return reflectance_table(*self._spectrum(parameters, name, found)) or color

    def mean_color(self, parameters: Parameters, name: str, default: float) -> list[float]:
        """A reflectance where there can be no texture: that of a texture is its mean, with a note."""
        color = self.color(parameters, name, default)
        if isinstance(color, list):
            return color
        self._staging.note(f"a texture as {quoted(name)} is read as its mean colour")
        return mean_color(self._staging, color, default, parameters.line)

    def coefficients(self, parameters: Parameters, name: str, default: Color) -> Color:
        """Coefficients of a medium."""
        found = parameters.get(name)
        if found is None:
            return default
        if found.kind == "rgb":
            return self._rgb(parameters, name, found)
        if found.kind == "spectrum":
            return reflectance_color(*self._spectrum(parameters, name, found))
        if found.kind == "texture":
            self._staging.note(f"a texture as {quoted(name)} is left out: {default[0]:g} in its place")
            return default
        return (parameters.number(name, 0.0),) * 3

    def share(self, parameters: Parameters, name: str, default: float) -> Any:
        """A number between 0 and 1, or one of our textures."""
        found = parameters.get(name)
        if found is not None and found.kind == "texture":
            value = self._named(parameters, name, "float")
            if isinstance(value, list):
                return sum(value) / 3.0
            return self._number(value, found.line)
        return self._staging.share(parameters.number(name, default), quoted(name))

    def _number(self, texture: dict[str, Any], line: int) -> dict[str, Any]:
        """A float texture, with the channel of its picture that is the number."""
        if "texture" not in texture or "channel" in texture:
            return texture
        name = texture["texture"]
        if name not in self._channels:
            self._channels[name] = number_channel(self._staging, name, line)
        made: dict[str, Any] = {**texture, "channel": self._channels[name]}
        if made["channel"] == "luminance":
            self._staging.note("a coloured picture as a number is its luminance, and not the mean of its colours")
        if made["channel"] == "a" and made.get("color_space") == "srgb":
            made = decoded(self._staging, made, line)  # in pbrt the coding is that of all channels
        return made

    def roughness(self, parameters: Parameters, prefix: str = "") -> Any:
        """Our roughness, or a texture of it: the root of alpha, which is the root of pbrt's unless remapping is off."""
        found = parameters.get(f"{prefix}roughness")
        apart = any(parameters.get(f"{prefix}{axis}roughness") is not None for axis in "uv")
        if found is None or found.kind != "texture" or apart:
            return roughness_of(self._alpha(parameters, prefix))
        remapped = parameters.flag("remaproughness", True)
        value = self.share(parameters, f"{prefix}roughness", 0.0)
        return rooted(self._staging, value, 2 if remapped else 1, found.line)

    def _alpha(self, parameters: Parameters, prefix: str = "", default: float = 0.0) -> float:
        """Alpha of a microfacet distribution: the square root of the roughness, unless remapping is off."""
        remapped = parameters.flag("remaproughness", True)
        both = self.plain_number(parameters, f"{prefix}roughness", default)
        u, v = (self.plain_number(parameters, f"{prefix}{axis}roughness", both) for axis in "uv")
        if u != v:
            self._staging.note("roughness along u and along v is read as one: the root of their product")
        u, v = max(u, 0.0), max(v, 0.0)
        product = math.sqrt(u * v) if u != v else u
        return math.sqrt(product) if remapped else product

    # --- textures

    def define(self, name: str, kind: str, made_of: str, parameters: Parameters) -> Callable[[], None]:
        """Define a named texture; the result makes it: see `Definitions.define`.

        Parameters
        ----------
        name : str
        kind : str
            ``spectrum`` or ``float``.
        made_of : str
            ``imagemap`` and so on.
        parameters : Parameters
        """

        def make() -> Any:
            made = self._made(kind, made_of, parameters)
            for unknown in parameters.unused():
                self._staging.note(
                    f"{quoted(unknown)} of a texture of type {quoted(made_of)} is not understood and does nothing"
                )
            return made

        return self._textures.define((kind, name), make)

    def _named(self, parameters: Parameters, name: str, kind: str) -> Any:
        wanted = parameters.text(name)
        if (kind, wanted) not in self._textures:
            known = [each for of_kind, each in self._textures if of_kind == kind]
            raise parameters.fault(
                f"the {kind} texture {quoted(wanted)} is not defined{suggestion(wanted, known)}", name
            )
        return self._textures[(kind, wanted)]

    def _value(self, parameters: Parameters, name: str, kind: str, default: float) -> Any:
        found = parameters.get(name)
        if found is not None and found.kind == "texture":
            return self._named(parameters, name, kind)
        if kind == "float":
            return [parameters.number(name, default)] * 3
        return self.color(parameters, name, default)

    def _made(self, kind: str, made_of: str, parameters: Parameters) -> Any:
        if made_of == "imagemap":
            return self._imagemap(kind, parameters)
        if made_of == "constant":
            return self._value(parameters, "value", kind, 1.0)
        if made_of == "checkerboard":
            colors = [self._value(parameters, f"tex{i}", kind, 2.0 - i) for i in (1, 2)]
            if all(isinstance(color, list) for color in colors) and parameters.whole("dimension", 2) == 2:
                return {"checker": colors, "size": 1.0, **self._mapping(parameters)}
        elif made_of == "scale":
            return self._scaled(kind, parameters)
        elif made_of == "mix":
            amount = self._value(parameters, "amount", "float", 0.5)
            first, second = self._value(parameters, "tex1", kind, 0.0), self._value(parameters, "tex2", kind, 1.0)
            if all(isinstance(each, list) for each in (amount, first, second)):
                return [a + (b - a) * t for a, b, t in zip(first, second, amount, strict=True)]
        self._staging.note(
            f"a texture of type {quoted(made_of)} is not known, or not of such parts: grey of 0.5 in its place"
        )
        parameters.ignore(*parameters.values)
        return [0.5, 0.5, 0.5]

    def _scaled(self, kind: str, parameters: Parameters) -> Any:
        whole, factor = self._value(parameters, "tex", kind, 1.0), self._value(parameters, "scale", "float", 1.0)
        if isinstance(factor, dict) and isinstance(whole, list):
            whole, factor = factor, whole
        if isinstance(factor, list) and isinstance(whole, list):
            return [a * b for a, b in zip(whole, factor, strict=True)]
        if isinstance(factor, list) and "texture" in whole:
            before = whole.get("scale", [1.0] * 3)
            return {**whole, "scale": [max(a * b, 0.0) for a, b in zip(before, factor, strict=True)]}
        self._staging.note("a product of two textures, or of a checkerboard, is read as the first one")
        return whole

    def _imagemap(self, kind: str, parameters: Parameters) -> Any:
        file = parameters.text("filename")
        if not file:
            raise parameters.fault('the imagemap has no "filename"; give it')
        line = parameters.values["filename"].line
        wrap = parameters.text("wrap", "repeat")
        if wrap not in _WRAPS:
            raise parameters.fault(f'"wrap" is {quoted(wrap)}, which is not known{suggestion(wrap, _WRAPS)}', "wrap")
        if wrap == "black":
            self._staging.note("pictures that are black beyond their edges go on as their edges do")
        made: dict[str, Any] = {"texture": self._staging.files.name(file, f"line {line}"), "wrap": _WRAPS[wrap]}
        made["filter"] = "nearest" if parameters.text("filter", "bilinear") == "point" else "linear"
        if file.lower().endswith(CODED_ENDINGS):
            encoding = parameters.text("encoding", "sRGB")
            made["color_space"] = "linear" if encoding == "linear" else "srgb"
            if encoding.startswith("gamma"):
                self._staging.note("pictures encoded by a gamma are read as sRGB")
        parameters.ignore("encoding", "maxanisotropy")
        factor = parameters.number("scale", 1.0)
        if factor != 1.0:
            made["scale"] = [max(factor, 0.0)] * 3
        made |= self._mapping(parameters)
        if not parameters.flag("invert", False):
            return made
        if kind == "float":
            made = self._number(made, line)
        return inverted(self._staging, made, line, number=kind == "float")

    def _mapping(self, parameters: Parameters) -> dict[str, Any]:
        if parameters.text("mapping", "uv") != "uv":
            self._staging.note("textures that are mapped otherwise than by uv are mapped by uv")
            parameters.ignore("v1", "v2")
        scale = [parameters.number(f"{axis}scale", 1.0) for axis in "uv"]
        offset = [parameters.number(f"{axis}delta", 0.0) for axis in "uv"]
        return {} if (scale, offset) == ([1.0] * 2, [0.0] * 2) else {"transform": {"scale": scale, "offset": offset}}


def _of_unit_luminance(color: Color) -> Color:
    size = luminance(color)
    if not size > 0.0:
        return 0.0, 0.0, 0.0
    red, green, blue = (x / size for x in color)
    return red, green, blue
