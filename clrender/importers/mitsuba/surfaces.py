"""Converts Mitsuba's BSDFs without nested ones to our materials."""

from __future__ import annotations

import math
from typing import Any, Final

from clrender.importers.mitsuba.plugins import Plugin
from clrender.importers.mitsuba.textures import TextureReader
from clrender.importers.shared.curved import below_boundary, rooted
from clrender.importers.shared.fresnel import conductor_reflectance
from clrender.importers.shared.metals import CONDUCTORS, DIELECTRICS
from clrender.importers.shared.staging import Staging, roughness_of
from clrender.spectra.colors import Color, light_color
from clrender.wording import quoted, suggestion

__all__ = ["SurfaceReader"]

_BLACK: Final = {"type": "lambert", "reflectance": [0.0, 0.0, 0.0]}


class SurfaceReader:
    """Converts BSDFs.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    old : bool
        Whether the file is one of 0.6, whose defaults differ.
    """

    def __init__(self, staging: Staging, textures: TextureReader, old: bool) -> None:
        self._staging, self._textures, self._old = staging, textures, old

    def diffuse(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """Ideal diffuse reflection."""
        name = "diffuse_reflectance" if plugin.has("diffuse_reflectance") else "reflectance"
        return {"type": "lambert", "reflectance": self._textures.reflecting(plugin, name, 0.5), "two_sided": two_sided}

    def rough_diffuse(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """Diffuse reflection of a rough surface."""
        self._staging.note('"roughdiffuse" is read as oren_nayar, whose formula is a newer one that loses no light')
        plugin.ignore("use_fast_approx")
        made = self.diffuse(plugin, two_sided)
        return {**made, "type": "oren_nayar", "roughness": self._textures.share(plugin, "alpha", 0.2)}

    def _index(self, plugin: Plugin, name: str, default: str) -> float:
        """An index of refraction: a number or a name."""
        value = plugin.values.get(name)
        if value is not None and value.kind != "string":
            index = plugin.number(name, 1.0)
            if not 1e-3 <= index <= 1000.0:
                raise plugin.fault(f"{quoted(name)} is {index:g}; an index of refraction must be 0.001 to 1000")
            return index
        material = plugin.text(name, default).lower()
        if material not in DIELECTRICS:
            raise plugin.fault(
                f"{quoted(name)} is {quoted(material)}, which is not known{suggestion(material, DIELECTRICS)}"
            )
        return DIELECTRICS[material]

    def _microfacets(self, plugin: Plugin) -> dict[str, Any]:
        """Options of rough metal and glass, which lose light by multiple scattering in Mitsuba."""
        return {**self._rough(plugin), "multiple_scattering": False}

    def _rough(self, plugin: Plugin) -> dict[str, Any]:
        distribution = plugin.text("distribution", "beckmann").lower()
        if distribution not in ("beckmann", "ggx"):
            self._staging.note(f"microfacets of the distribution {quoted(distribution)} are read as Beckmann's")
            distribution = "beckmann"
        plugin.ignore("sample_visible")
        return {"roughness": self._roughness(plugin), "microfacets": distribution}

    def _roughness(self, plugin: Plugin) -> Any:
        """Our roughness, or a texture of it; for textures of alpha along u and v that of 0.1."""
        if any(plugin.child(name) is not None for name in ("alpha_u", "alpha_v")):
            self._staging.note("textures of alpha along u and v are left out: alpha is 0.1 there")
            return roughness_of(0.1)
        if plugin.child("alpha") is not None:
            return rooted(self._staging, self._textures.share(plugin, "alpha", 0.1), 1, plugin.line)
        alpha = plugin.number("alpha", 0.1)
        if plugin.has("alpha_u", "alpha_v"):
            u, v = plugin.number("alpha_u", 0.1), plugin.number("alpha_v", 0.1)
            alpha = math.sqrt(max(u * v, 0.0))
            if u != v:
                self._staging.note("alpha along u and along v is read as one: the root of their product")
        return roughness_of(alpha)

    def dielectric(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """Smooth, rough or thin glass."""
        made = {
            "type": "dielectric",
            "ior": self._index(plugin, "int_ior", "bk7"),
            "exterior_ior": self._index(plugin, "ext_ior", "air"),
        }
        for name in ("specular_reflectance", "specular_transmittance"):
            if self._textures.color(plugin, name, 1.0, texture=False) != [1.0] * 3:
                self._staging.note(f"{quoted(name)} of dielectrics is left out: they lose no light")
        if plugin.type == "thindielectric":
            made["thin"] = True
        elif plugin.type == "roughdielectric":
            made |= self._microfacets(plugin)
        return made

    def hair(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """Fibres of hair."""
        index = self._index(plugin, "int_ior", "amber") / self._index(plugin, "ext_ior", "air")
        made: dict[str, Any] = {"type": "hair", "ior": self._staging.within(index, 1.05, 3.0, "int_ior")}
        for name in ("longitudinal_roughness", "azimuthal_roughness", "scale_tilt", "eumelanin", "pheomelanin"):
            if plugin.child(name) is not None:
                self._staging.note(f"a texture as {quoted(name)} of hair is left out: the default in its place")
        for key, name in (("roughness", "longitudinal_roughness"), ("azimuthal_roughness", "azimuthal_roughness")):
            made[key] = self._staging.share(plugin.number(name, 0.3), name)
        made["tilt_degrees"] = self._staging.within(plugin.number("scale_tilt", 2.0), -20.0, 20.0, "scale_tilt")
        if plugin.child("sigma_a") is not None:
            self._staging.note("a texture of the absorption of hair is left out: it is that of its default")
        elif plugin.has("sigma_a"):
            scale = plugin.number("scale", 1.0)
            absorbed = self._textures.surface_of(plugin.spectrum("sigma_a"), 1.0)
            made["absorption_coefficient"] = [self._staging.within(scale * x, 0.0, 1000.0, "sigma_a") for x in absorbed]
        else:
            for name in ("eumelanin", "pheomelanin"):
                if plugin.has(name):
                    made[name] = self._staging.within(plugin.number(name, 0.0), 0.0, 100.0, name)
        return made

    def measured(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """Measured reflectance of the RGL database."""
        name = plugin.text("filename", "")
        if not name:
            raise plugin.fault(f"{plugin.label} needs a filename")
        return self._staging.measured(name, plugin.line) | {"two_sided": two_sided}

    def _metal(self, plugin: Plugin) -> tuple[Color, Color]:
        """Complex index of refraction, relative to the exterior."""
        name = plugin.text("material", "Cu" if self._old else "none")
        if not plugin.has("eta") and name not in CONDUCTORS:
            raise plugin.fault(f"the metal {quoted(name)} is not known{suggestion(name, CONDUCTORS)}; give eta and k")
        eta, k = CONDUCTORS.get(name, CONDUCTORS["none"])
        if plugin.has("eta", "k"):
            eta, k = self._index_color(plugin, "eta", 0.0), self._index_color(plugin, "k", 1.0)
        outside = 1.0
        if plugin.has("ext_eta"):
            outside = self._index(plugin, "ext_eta", "air")
        least, most = 1e-3, 1000.0
        eta = tuple(min(max(x / outside, least), most) for x in eta)  # type: ignore[assignment]
        k = tuple(min(max(x / outside, 0.0), most) for x in k)  # type: ignore[assignment]
        return eta, k

    def _index_color(self, plugin: Plugin, name: str, default: float) -> Color:
        spectrum = plugin.spectrum(name)
        if spectrum is not None and spectrum.wavelengths:
            return light_color(spectrum.wavelengths, spectrum.values)  # as Mitsuba does
        return self._textures.surface_of(spectrum, default)

    def conductor(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """Smooth or rough metal."""
        eta, k = self._metal(plugin)
        rough = self._microfacets(plugin) if plugin.type == "roughconductor" else {"roughness": 0.0}
        made: dict[str, Any] = {"type": "conductor", **rough, "two_sided": two_sided}
        plain = max(eta) <= 1e-3 and set(k) == {1.0}  # "none": reflects everything
        tint = self._textures.color(plugin, "specular_reflectance", 1.0, texture=plain)
        if plain and rough["roughness"] == 0.0:
            return {"type": "mirror", "reflectance": tint, "two_sided": two_sided}
        if plain:
            return {**made, "f0": tint}
        measured = made | {"eta": list(eta), "k": list(k)}
        if tint == [1.0] * 3:
            return measured
        if max(tint) == min(tint):
            return self.dimmed(plugin, measured, tint[0])
        self._staging.note(
            "the colour of a metal's specular_reflectance is put into its reflectance straight on (Schlick)"
        )
        straight = [conductor_reflectance(n, x) for n, x in zip(eta, k, strict=True)]
        made["f0"] = [a * b for a, b in zip(straight, tint, strict=True)]
        return made

    def dimmed(self, plugin: Plugin, whole: dict[str, Any], share: float) -> dict[str, Any]:
        """Exactly a fraction of a material's reflectance: a mixture with black."""
        name = self._staging.material(f"{plugin.id or plugin.type}, undimmed", whole)
        black = self._staging.material("black", dict(_BLACK))
        return {"type": "mix", "materials": [name, black], "weight": 1.0 - share}

    def plastic(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """A diffuse surface under a smooth or rough boundary."""
        inside, outside = self._index(plugin, "int_ior", "polypropylene"), self._index(plugin, "ext_ior", "air")
        ior = inside / outside
        base = self._textures.color(plugin, "diffuse_reflectance", 0.5)
        if plugin.flag("nonlinear", False):
            base = below_boundary(self._staging, base, max(ior, 1.0), plugin.line)
        specular = self._textures.color(plugin, "specular_reflectance", 1.0, texture=False)
        if specular != [1.0] * 3:
            self._staging.note("what plastic loses by its specular_reflectance goes to the diffuse surface below")
        rough = self._rough(plugin) if plugin.type == "roughplastic" else {"roughness": 0.0}
        if not ior >= 1.0:
            self._staging.note("plastic thinner than what is around it is read as of index 1")
        return {
            "type": "principled",
            "base_color": base,
            **rough,
            "ior": min(max(ior, 1.0), 1000.0),
            "specular_color": specular,
            "two_sided": two_sided,
        }

    def principled(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """Disney's principled BSDF as glTF's."""
        self._staging.note(
            "\"principled\" is Disney's there and glTF's here: alike, but not equal, in sheen, coat and tints"
        )
        share = self._textures.share
        base = self._textures.color(plugin, "base_color", 0.5)
        made: dict[str, Any] = {
            "type": "principled",
            "base_color": base,
            "roughness": share(plugin, "roughness", 0.5),
            "metallic": share(plugin, "metallic", 0.0),
            "anisotropy": share(plugin, "anisotropic", 0.0),
            "two_sided": two_sided,
        }
        root = math.sqrt(0.08 * self._staging.share(plugin.number("specular", 0.5), "specular"))
        made["ior"] = plugin.number("eta", (1.0 + root) / (1.0 - root))
        transmission = share(plugin, "spec_trans", 0.0)
        if transmission != 0.0:
            made["transmission"] = transmission
            made["thin"] = plugin.type == "principledthin"
            # Transmissive materials have two sides
            made.pop("two_sided")
        coat = share(plugin, "clearcoat", 0.0)
        if coat != 0.0:
            # Disney's clear coat has a quarter of the strength, and alpha from 0.1 to 0.001
            made["coat"] = coat if isinstance(coat, dict) else 0.25 * coat
            gloss = self._staging.share(plugin.number("clearcoat_gloss", 0.0), "clearcoat_gloss")
            made["coat_roughness"] = roughness_of(0.1 + (0.001 - 0.1) * gloss)
        sheen = share(plugin, "sheen", 0.0)
        if sheen != 0.0 and not isinstance(sheen, dict):
            tint = self._staging.share(plugin.number("sheen_tint", 0.0), "sheen_tint")
            color = base if isinstance(base, list) else [1.0] * 3
            most = max(*color, 1e-6)
            made["sheen_color"] = [sheen * ((1.0 - tint) + tint * x / most) for x in color]
        plugin.ignore("clearcoat_gloss", "sheen_tint", "diffuse_reflectance_sampling_rate")
        return made
