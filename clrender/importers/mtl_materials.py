"""Converts materials of OBJ files to our own.

Sources: the MTL format (Wavefront); the alpha of a Phong-like lobe from B. Walter et al., "Microfacet models for
refraction through rough surfaces" (2007), section 5.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeAlias

from clrender.importers.lost_pictures import LOST
from clrender.importers.mtl_file import MtlMaterial
from clrender.importers.mtl_pictures import MtlPictures
from clrender.scene.values import POWER_LIMIT
from clrender.wording import quoted

__all__ = ["GREY", "Converted", "converted"]

_Color: TypeAlias = tuple[float, float, float]
GREY: Final = 0.6
"""Reflectance of surfaces without a colour."""
_PBR: Final = ("pr", "pm", "ps", "pc", "pcr", "aniso", "anisor", "map_pr", "map_pm", "map_ps", "map_pc", "map_pcr")
_READ: Final = {
    *("ka", "kd", "ks", "ns", "ke", "d", "tr", "ni", "tf", "illum", "map_kd", "map_ks", "map_ke", "map_d", "bump"),
    *("norm", "map_aniso", *_PBR),
}
_HIGHLIGHT: Final = 0.08
"""Reflectance at normal incidence of a highlight (illum 2) with Ks = 1, such that Ks = 0.5 is plastic."""
_BLACK: Final = (0.0, 0.0, 0.0)
_MOST_F0: Final = 0.95


class Converted(NamedTuple):
    """A converted material.

    Attributes
    ----------
    material : dict
        In the form of a scene file.
    emission : list of float, or dict, or None
        Radiance of the shapes with this material.
    """

    material: dict[str, Any]
    emission: list[float] | dict[str, Any] | None


def converted(source: MtlMaterial, pictures: MtlPictures, note: Callable[[str], None]) -> Converted:
    """Convert a material.

    Parameters
    ----------
    source : MtlMaterial
    pictures : MtlPictures
    note : callable
        Called with a sentence for the user.

    Raises
    ------
    SceneError
        A value is invalid.
    """
    return _Converter(source, pictures, note).result()


class _Converter:
    def __init__(self, source: MtlMaterial, pictures: MtlPictures, note: Callable[[str], None]) -> None:
        self._source, self._pictures, self._tell = source, pictures, note
        self._illum = self._model()
        self._d = self._dissolve()

    def result(self) -> Converted:
        for key in self._source.lines:
            if key not in _READ:
                self._tell(f"{self._source.label}: {quoted(key)} of materials is not read")
        material = self._body()
        self._add_opacity(material)
        for key in ("bump", "norm"):
            picture = self._source.picture(key)
            found = None if picture is None else self._pictures.relief(picture, key == "norm")
            if found is not None:
                material[found[0]] = found[1]
        return Converted(material, self._emission())

    def _note(self, sentence: str) -> None:
        self._tell(f"{self._source.label}: the material {quoted(self._source.name)} {sentence}")

    def _model(self) -> int:
        illum = self._source.number("illum", 2.0 if "ks" in self._source else 1.0)
        if illum not in range(10):
            self._note(f"has illum {illum:g}, which is not known: taken as 2")
            return 2
        return int(illum)

    def _dissolve(self) -> float:
        """Opacity, 0 to 1: d, else 1 - Tr."""
        given, clear = self._source.number("d", 1.0), self._source.number("tr", 0.0)
        if "d" in self._source and "tr" in self._source and abs(given - (1.0 - clear)) > 1e-3:
            self._note(f"has d {given:g} and Tr {clear:g}, which contradict each other: d counts")
        if "d" not in self._source and clear == 1.0:
            self._note("has Tr 1 without d, by which many programs mean opaque: taken so")
            return 1.0
        return min(max(given if "d" in self._source else 1.0 - clear, 0.0), 1.0)

    def _shares(self, key: str, default: float) -> _Color:
        """A colour clamped to 0 to 1."""
        if key in self._source and self._source.lines[key][0].startswith("spectral"):
            self._note(f"has a {key.capitalize()} by a spectrum (.rfl), which is not read: left out")
        color = self._source.color(key, default)
        red, green, blue = (min(max(each, 0.0), 1.0) for each in color)
        if (red, green, blue) != color:
            self._note(f"has {key.capitalize()} {' '.join(f'{x:g}' for x in color)}: held between 0 and 1")
        return red, green, blue

    def _share(self, key: str, default: float) -> float:
        return min(max(self._source.number(key, default), 0.0), 1.0)

    def _base(self) -> list[float] | dict[str, Any]:
        """Kd, multiplied by its image."""
        picture = self._source.picture("map_kd")
        color = self._shares("kd", GREY if picture is None else 1.0)
        if picture is not None and color == _BLACK:
            self._note("has a picture of Kd, but a black Kd, which would hide it: Kd is taken as 1")
            color = (1.0, 1.0, 1.0)
        if self._pictures.lost(picture):
            return [LOST * x for x in color]
        return self._pictures.color(picture, color) or list(color)

    def _roughness(self, default: float) -> float:
        """Roughness from Ns, the exponent of a highlight: alpha² = 2 / (Ns + 2), and roughness² = alpha."""
        if "ns" not in self._source:
            return default
        return min(math.sqrt(math.sqrt(2.0 / (max(self._source.number("ns", 0.0), 0.0) + 2.0))), 1.0)

    def _body(self) -> dict[str, Any]:
        """The material without opacity and bump map."""
        clear = self._transmitted()
        if any(key in self._source for key in _PBR):
            return self._physical(clear)
        if clear is not None:
            return self._glass(clear)
        base, specular = self._base(), self._shares("ks", 0.0)
        if self._illum == 0:
            self._note("has illum 0, a colour without light: taken as a diffuse surface")
        if self._illum < 2 or (specular == _BLACK and "map_ks" not in self._source):
            return {"type": "lambert", "reflectance": base}
        mirrors = self._illum != 2
        if self._illum in (3, 8) and base == list(_BLACK) and "map_ks" not in self._source:
            if "ns" not in self._source:
                return {"type": "mirror", "reflectance": list(specular)}
            return {"type": "conductor", "f0": list(specular), "roughness": self._roughness(0.0)}
        return {
            "type": "principled",
            "base_color": base,
            "roughness": self._roughness(0.0 if mirrors else 0.5),
            **self._reflection(specular, 1.0 if mirrors else _HIGHLIGHT),
        }

    def _reflection(self, specular: _Color, factor: float) -> dict[str, Any]:
        """Index and colour with which `principled` reflects Ks times a factor at normal incidence."""
        picture = self._source.picture("map_ks")
        if picture is not None and specular == _BLACK:
            specular = (1.0, 1.0, 1.0)
        largest = max(specular)
        f0 = min(factor * largest, _MOST_F0)
        tint: _Color = (specular[0] / largest, specular[1] / largest, specular[2] / largest)
        color = self._pictures.color(picture, tint) or list(tint)
        return {"ior": (1.0 + math.sqrt(f0)) / (1.0 - math.sqrt(f0)), "specular_color": color}

    def _transmitted(self) -> _Color | None:
        """The colour of light transmitted by glass; None if it is not glass."""
        given = "tf" in self._source
        filtered = self._shares("tf", 1.0)
        if self._illum in (6, 7) and filtered != _BLACK:
            return filtered
        if self._illum in (4, 9) and filtered != _BLACK and (self._d < 1.0 or (given and filtered != (1.0, 1.0, 1.0))):
            return filtered
        if given and self._illum < 4 and filtered != (1.0, 1.0, 1.0):
            self._note("has Tf, which is read of glass (illum 4, 6, 7 and 9) only: left out")
        return None

    def _index(self, default: float) -> float:
        index = self._source.number("ni", default)
        if not 1.0 <= index <= 1000.0:
            self._note(f"has Ni {index:g}, which is no index of refraction from 1 to 1000: taken as {default:g}")
            return default
        return index

    def _glass(self, filtered: _Color) -> dict[str, Any]:
        """Glass: thin for illum 4 and 9, which do not refract; else solid."""
        for key in ("map_kd", "map_ks"):
            if key in self._source:
                self._note(f"has a picture of {key[4:].capitalize()}, which is not read of glass: left out")
        table: dict[str, Any] = {"ior": self._index(1.5), "roughness": 0.0}
        if self._illum in (4, 9):
            table["thin"] = True
        if filtered == (1.0, 1.0, 1.0):
            return {"type": "dielectric", **table}
        return {"type": "principled", "base_color": list(filtered), "transmission": 1.0, **table}

    def _physical(self, clear: _Color | None) -> dict[str, Any]:
        """The material of the extension for physically based rendering."""
        table: dict[str, Any] = {"type": "principled", "base_color": self._base(), "ior": max(self._index(1.5), 1.0)}
        if table["ior"] == 1.0:
            table["ior"] = 1.5  # written by exporters without an index
        table["roughness"] = self._mapped("pr", self._roughness(0.5))
        for key, ours in (("pm", "metallic"), ("pc", "coat"), ("pcr", "coat_roughness"), ("aniso", "anisotropy")):
            if key in self._source or f"map_{key}" in self._source:
                table[ours] = self._mapped(key, 0.0)
        if "ps" in self._source or "map_ps" in self._source:
            sheen = self._share("ps", 1.0)
            picture = self._pictures.color(self._source.picture("map_ps"), (sheen, sheen, sheen))
            table["sheen_color"] = picture or [sheen] * 3
        if "anisor" in self._source:
            table["anisotropy_rotation"] = 360.0 * math.fmod(self._source.number("anisor", 0.0), 1.0)
        if clear is not None:
            table["transmission"] = 1.0 - self._d if self._d < 1.0 else 1.0
            table["thin"] = self._illum in (4, 9)
        return table

    def _mapped(self, key: str, default: float) -> float | dict[str, Any]:
        """A number, multiplied by its image."""
        picture = self._source.picture(f"map_{key}")
        value = self._share(key, default if picture is None else 1.0)
        return self._pictures.share(picture, value, "r") or value

    def _add_opacity(self, material: dict[str, Any]) -> None:
        """Add opacity: d times the alpha of its image, if that is the image of Kd, else times its luminance.

        Of glass d is the share of light that it lets through, and the image where thin glass is.
        """
        glass = material["type"] == "dielectric" or material.get("transmission", 0.0) != 0.0
        if glass and not material.get("thin", False):
            if "map_d" in self._source:
                self._note("has a picture of d, which glass with an inside cannot have: left out")
            return
        picture, base = self._source.picture("map_d"), self._source.picture("map_kd")
        channel = "a" if picture is not None and base is not None and picture.name == base.name else "luminance"
        whole = 1.0 if glass else self._d
        opacity = self._pictures.share(picture, whole, channel) or whole
        if whole == 0.0:
            self._note("has d 0 and is not seen at all")
        if opacity != 1.0:
            material["opacity"] = opacity

    def _emission(self) -> list[float] | dict[str, Any] | None:
        """Ke, multiplied by its image."""
        picture = self._source.picture("map_ke")
        red, green, blue = (max(each, 0.0) for each in self._source.color("ke", 0.0 if picture is None else 1.0))
        ambient = self._source.color("ka", 0.0)
        if (red, green, blue) == _BLACK and picture is None and max(ambient) > 1.0:
            self._note("has a Ka above 1, more than there can be of ambient light: taken as emission")
            red, green, blue = (max(each, 0.0) for each in ambient)
        if (red, green, blue) == _BLACK or self._pictures.lost(picture):
            return None
        if max(red, green, blue) > POWER_LIMIT:
            self._note(f"has an emission of {max(red, green, blue):g}: held at {POWER_LIMIT:g}")
            red, green, blue = (min(each, POWER_LIMIT) for each in (red, green, blue))
        return self._pictures.color(picture, (red, green, blue)) or [red, green, blue]
