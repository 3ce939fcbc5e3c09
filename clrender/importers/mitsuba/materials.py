"""Mitsuba's BSDFs as our materials."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from clrender.importers.mitsuba.plugins import Plugin
from clrender.importers.mitsuba.textures import TextureReader
from clrender.importers.shared.fresnel import internal_reflectance
from clrender.importers.shared.metals import CONDUCTORS, DIELECTRICS
from clrender.importers.shared.spectra import Color, light_color
from clrender.importers.shared.staging import Staging, roughness_of
from clrender.scene.materials import MIX_DEPTH
from clrender.scene.wording import quoted, suggestion

__all__ = ["BLACK", "MaterialReader"]

BLACK: Final = {"type": "lambert", "reflectance": [0.0, 0.0, 0.0]}
_BECKMANN: Final = (
    "microfacets of Beckmann's distribution are read as GGX of the same alpha, whose highlights reach further"
)
_MULTIPLE: Final = (
    "rough metals and glass return the light that Mitsuba loses between their facets: wide lobes are brighter"
)
_SOLID: Final = ("dielectric", "principled")


class MaterialReader:
    """Makes materials of BSDFs, each once.

    Parameters
    ----------
    staging : Staging
    textures : TextureReader
    old : bool
        Whether the file is one of 0.6, whose defaults differ.
    """

    def __init__(self, staging: Staging, textures: TextureReader, old: bool) -> None:
        self._staging, self._textures, self._old = staging, textures, old
        self._made: dict[tuple[int, bool], str | None] = {}
        self._kept: list[Plugin] = []
        self._depth = 0

    def name(self, plugin: Plugin, two_sided: bool = False) -> str | None:
        """The name of the material; None for a surface that is not seen.

        Raises
        ------
        SceneError
            BSDFs contain each other, or are nested too deep.
        """
        key = (id(plugin), two_sided)
        if key not in self._made:
            self._kept.append(plugin)  # so that nothing else gets its identity
            described = self._guarded(plugin, two_sided)
            name = None if described is None else self._staging.material(plugin.id or plugin.type, described)
            self._made[key] = name
        return self._made[key]

    def _guarded(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        """The description of a material, unless it contains itself."""
        if self._depth >= MIX_DEPTH or plugin.busy:
            raise plugin.fault(f"BSDFs are nested more than {MIX_DEPTH} deep, or contain themselves; use fewer")
        plugin.busy, self._depth = True, self._depth + 1
        described = self._described(plugin, two_sided)
        plugin.busy, self._depth = False, self._depth - 1
        for unknown in plugin.unused():
            self._staging.note(f"{quoted(unknown)} of {plugin.label} is not understood and does nothing")
        return described

    def _described(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        made: dict[str, Callable[[Plugin, bool], dict[str, Any] | None]] = {
            "diffuse": self._diffuse,
            "roughdiffuse": self._rough_diffuse,
            "dielectric": self._dielectric,
            "thindielectric": self._dielectric,
            "roughdielectric": self._dielectric,
            "conductor": self._conductor,
            "roughconductor": self._conductor,
            "plastic": self._plastic,
            "roughplastic": self._plastic,
            "principled": self._principled,
            "principledthin": self._principled,
            "twosided": self._twosided,
            "mask": self._mask,
            "bumpmap": self._bumpy,
            "bump": self._bumpy,
            "normalmap": self._bumpy,
            "blendbsdf": self._blend,
            "mixturebsdf": self._mixture,
        }
        if plugin.type == "null":
            return None
        if plugin.type in made:
            return made[plugin.type](plugin, two_sided)
        self._staging.note(f"{plugin.label} is not known: a diffuse grey of 0.5 in its place")
        plugin.ignore(*plugin.values, *(child.name for child in plugin.children))
        plugin.children_of(*(child.kind for child in plugin.children))
        return {"type": "lambert", "reflectance": [0.5, 0.5, 0.5], "two_sided": two_sided}

    def _nested(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        """The description of the one BSDF inside; None where it is not seen."""
        inside = plugin.children_of("bsdf")
        if len(inside) != 1:
            raise plugin.fault(f"{plugin.label} has {len(inside)} BSDFs inside, but must have one")
        return self._guarded(inside[0], two_sided)

    # --- the simple ones

    def _diffuse(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        name = "diffuse_reflectance" if plugin.has("diffuse_reflectance") else "reflectance"
        return {"type": "lambert", "reflectance": self._textures.color(plugin, name, 0.5), "two_sided": two_sided}

    def _rough_diffuse(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        self._staging.note('"roughdiffuse" is read as oren_nayar, whose formula is a newer one that loses no light')
        plugin.ignore("use_fast_approx")
        made = self._diffuse(plugin, two_sided)
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

    def _alpha(self, plugin: Plugin, default_distribution: str = "beckmann") -> Any:
        """Our roughness; for a texture of alpha that of 0.1."""
        if plugin.text("distribution", default_distribution) != "ggx":
            self._staging.note(_BECKMANN)
        plugin.ignore("sample_visible")
        if any(plugin.child(name) is not None for name in ("alpha", "alpha_u", "alpha_v")):
            self._staging.note("textures of alpha are left out: alpha is 0.1 there")
            return roughness_of(0.1)
        alpha = plugin.number("alpha", 0.1)
        if plugin.has("alpha_u", "alpha_v"):
            u, v = plugin.number("alpha_u", 0.1), plugin.number("alpha_v", 0.1)
            alpha = max(u * v, 0.0) ** 0.5
            if u != v:
                self._staging.note("alpha along u and along v is read as one: the root of their product")
        if alpha > 0.1:
            self._staging.note(_MULTIPLE)
        return roughness_of(alpha)

    def _dielectric(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
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
            made["roughness"] = self._alpha(plugin)
        return made

    def _metal(self, plugin: Plugin) -> tuple[Color, Color]:
        """Complex index of refraction, relative to what is outside."""
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

    def _conductor(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        eta, k = self._metal(plugin)
        roughness = self._alpha(plugin) if plugin.type == "roughconductor" else 0.0
        made: dict[str, Any] = {"type": "conductor", "roughness": roughness, "two_sided": two_sided}
        plain = max(eta) <= 1e-3 and set(k) == {1.0}  # "none": reflects everything
        tint = self._textures.color(plugin, "specular_reflectance", 1.0, texture=plain)
        if plain and roughness == 0.0:
            return {"type": "mirror", "reflectance": tint, "two_sided": two_sided}
        if plain:
            return {**made, "f0": tint}
        made |= {"eta": list(eta), "k": list(k)}
        if tint == [1.0] * 3:
            return made
        if max(tint) == min(tint):
            return self._dimmed(plugin, made, tint[0])
        self._staging.note(
            "the colour of a metal's specular_reflectance is put into its reflectance straight on (Schlick)"
        )
        straight = [((n - 1.0) ** 2 + x * x) / ((n + 1.0) ** 2 + x * x) for n, x in zip(eta, k, strict=True)]
        return {
            "type": "conductor",
            "roughness": roughness,
            "two_sided": two_sided,
            "f0": [a * b for a, b in zip(straight, tint, strict=True)],
        }

    def _dimmed(self, plugin: Plugin, whole: dict[str, Any], share: float) -> dict[str, Any]:
        """Exactly a share of what a material reflects: a mixture with black."""
        name = self._staging.material(f"{plugin.id or plugin.type}, undimmed", whole)
        black = self._staging.material("black", dict(BLACK))
        return {"type": "mix", "materials": [name, black], "weight": 1.0 - share}

    # --- layered ones

    def _plastic(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        inside, outside = self._index(plugin, "int_ior", "polypropylene"), self._index(plugin, "ext_ior", "air")
        ior = inside / outside
        base = self._textures.color(plugin, "diffuse_reflectance", 0.5)
        if plugin.flag("nonlinear", False):
            if isinstance(base, dict):
                self._staging.note('"nonlinear" of a textured plastic is left out: its colours are less saturated')
            else:
                inner = internal_reflectance(ior)
                base = [x * (1.0 - inner) / (1.0 - x * inner) for x in base]
        specular = self._textures.color(plugin, "specular_reflectance", 1.0, texture=False)
        roughness = self._alpha(plugin) if plugin.type == "roughplastic" else 0.0
        if not ior >= 1.0:
            self._staging.note("plastic thinner than what is around it is read as of index 1")
        return {
            "type": "principled",
            "base_color": base,
            "roughness": roughness,
            "ior": min(max(ior, 1.0), 1000.0),
            "specular_color": specular,
            "two_sided": two_sided,
        }

    def _principled(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
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
        root = (0.08 * self._staging.share(plugin.number("specular", 0.5), "specular")) ** 0.5
        made["ior"] = plugin.number("eta", (1.0 + root) / (1.0 - root))
        transmission = share(plugin, "spec_trans", 0.0)
        if transmission != 0.0:
            made["transmission"] = transmission
            made["thin"] = plugin.type == "principledthin"
            # What is clear has two sides
            made.pop("two_sided")
        coat = share(plugin, "clearcoat", 0.0)
        if coat != 0.0:
            # Disney's coat has a quarter of the strength, and alpha from 0.1 to 0.001
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

    # --- those that hold others

    def _twosided(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        inside = plugin.children_of("bsdf")
        if not 1 <= len(inside) <= 2:
            raise plugin.fault(f"{plugin.label} has {len(inside)} BSDFs inside, but must have one or two")
        if len(inside) == 2 and inside[0] is not inside[1]:
            self._staging.note("of two-sided surfaces with two BSDFs both sides have the first one")
        return self._guarded(inside[0], True)

    def _mask(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        opacity = self._textures.share(plugin, "opacity", 0.5)
        made = self._nested(plugin, two_sided)
        if made is None or opacity == 1.0:
            return made
        solid = made["type"] == "dielectric" or made.get("transmission", 0.0) != 0.0
        if solid and not made.get("thin"):
            self._staging.note("the opacity of glass with an inside is left out")
            return made
        return {**made, "opacity": opacity}

    def _bumpy(self, plugin: Plugin, two_sided: bool) -> dict[str, Any] | None:
        made = self._nested(plugin, two_sided)
        plugin.ignore("use_shadowing_function", "flip_invalid_normals")
        scale = plugin.number("scale", 1.0)
        pictures = plugin.children_of("texture")
        if made is None or not pictures:
            return made
        for each in pictures:
            plugin.ignore(each.name)
        picture = self._textures.picture(pictures[0])
        if picture is None or made["type"] == "mix":
            if picture is not None:
                self._staging.note("normal and bump maps of mixtures are left out; put them inside")
            return made
        if plugin.type == "normalmap":
            picture.pop("channel", None)
            return {**made, "normal_map": picture}
        picture.pop("filter", None)
        return {**made, "bump_map": {**picture, "scale": scale}}

    def _blend(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        inside = plugin.children_of("bsdf")
        if len(inside) != 2:
            raise plugin.fault(f"{plugin.label} has {len(inside)} BSDFs inside, but must have two")
        return self._mix(plugin, inside, self._textures.share(plugin, "weight", 0.5), two_sided)

    def _mixture(self, plugin: Plugin, two_sided: bool) -> dict[str, Any]:
        """Of 0.6: any number, each with a weight."""
        inside = plugin.children_of("bsdf")
        weights = [
            float(x) for x in plugin.text("weights").replace(",", " ").split() if x.replace(".", "", 1).isdigit()
        ]
        if len(inside) != 2 or len(weights) != 2 or sum(weights) > 1.0 + 1e-6:
            raise plugin.fault("a mixture of other than two BSDFs with weights up to 1 is not read; use blendbsdf")
        total = sum(weights)
        made = self._mix(plugin, inside, weights[1] / max(total, 1e-9), two_sided)
        return made if total > 1.0 - 1e-6 else self._dimmed(plugin, made, total)

    def _mix(self, plugin: Plugin, inside: list[Plugin], weight: Any, two_sided: bool) -> dict[str, Any]:
        names = []
        for each in inside:
            name = self.name(each, two_sided)
            if name is None:
                raise plugin.fault('a mixture with "null" is not read; use a mask instead')
            if "opacity" in self._staging.draft.description["materials"][name]:
                raise plugin.fault("a mask inside of a mixture is not read; put the mask around it")
            names.append(name)
        return {"type": "mix", "materials": names, "weight": weight}
