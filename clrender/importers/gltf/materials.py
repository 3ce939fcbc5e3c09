"""Converts glTF materials and their supported extensions to `principled` materials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from clrender.errors import SceneError
from clrender.importers.gltf.document import Document
from clrender.importers.gltf.textures import Textures
from clrender.importers.lost_pictures import LOST
from clrender.scene.textures import TextureTransform
from clrender.wording import quoted, suggestion

__all__ = ["Materials", "Used"]

_LEAST_LEFT: Final = 1e-3
"""Replaces 0 in an attenuation colour, which no finite medium has."""
_HIGH_INDEX: Final = 1000.0
_MOST_FILM_INDEX: Final = 5.0
_THICKEST_FILM: Final = 10000.0
"""Nanometres."""
_MOST_SPECULAR: Final = 0.98
"""Largest reflectance at normal incidence for which an index of refraction is found."""


@dataclass(frozen=True)
class Used:
    """A material of the draft.

    Attributes
    ----------
    name : str
        Name in the draft.
    uv_sets : frozenset of int
        Sets of texture coordinates that its textures need.
    tangent_uv_set : int or None
        Set of its normal map, or of its anisotropy; None: it needs no tangents.
    tangent_transform : TextureTransform
        Of its normal map: tangents run along the picture.
    colored : bool
        Whether vertex colours multiply its colour.
    transparent : bool
        Whether alpha is used.
    place : str
        JSON pointer.
    """

    name: str
    uv_sets: frozenset[int]
    tangent_uv_set: int | None
    tangent_transform: TextureTransform
    colored: bool
    transparent: bool
    place: str


class Materials:
    """Converts materials when a primitive uses them.

    Parameters
    ----------
    document : Document
    textures : Textures
    variant : str, optional
        Name of a variant (KHR_materials_variants).

    Raises
    ------
    SceneError
        The file has no such variant.
    """

    def __init__(self, document: Document, textures: Textures, variant: str | None) -> None:
        self._document, self._textures = document, textures
        self._made: dict[int | None, Used] = {}
        self._variant = _variant_number(document, variant)

    def of(self, primitive: dict[str, Any]) -> Used:
        """The material of a primitive, in the chosen variant."""
        index: int | None = primitive.get("material")
        variants = self._document.extension(primitive, "KHR_materials_variants")
        for mapping in variants["mappings"] if variants and self._variant is not None else ():
            if self._variant in mapping["variants"]:
                index = mapping["material"]
        if index not in self._made:
            self._made[index] = self._make(index)
        return self._made[index]

    def _make(self, index: int | None) -> Used:
        source = {} if index is None else self._document.items("materials")[index]
        at = "the default material" if index is None else f"/materials/{index}"
        made = _Material(self._document, self._textures, source, at).made()
        materials = self._document.draft.description["materials"]
        name = source.get("name", "").encode("utf-8", "replace").decode()[:150] or f"material {index}"
        name = "default" if index is None else name
        if name in materials:
            name = f"{name} {at}"
        materials[name] = made
        used = [value for value in made.values() if isinstance(value, dict) and "texture" in value]
        sets = frozenset(value.get("uv_set", 0) for value in used)
        unlit = self._document.extension(source, "KHR_materials_unlit") is not None
        transparent = source.get("alphaMode", "OPAQUE") != "OPAQUE"
        asking = made.get("normal_map", made.get("anisotropy"))
        tangent_set = None if asking is None else asking.get("uv_set", 0) if isinstance(asking, dict) else 0
        turned = TextureTransform(**(asking if isinstance(asking, dict) else {}).get("transform", {}))
        return Used(name, sets, tangent_set, turned, not unlit, transparent, at)


def _variant_number(document: Document, variant: str | None) -> int | None:
    declared = document.extension(document.root, "KHR_materials_variants") or {"variants": []}
    names = [each["name"] for each in declared["variants"]]
    if variant is None:
        if names:
            shown = ", ".join(quoted(name) for name in names[:8])
            document.note(f"it has variants of its materials ({shown}); choose one with --variant NAME")
        return None
    if variant not in names:
        text = f"has no variant {quoted(variant)}{suggestion(variant, names)}"
        raise SceneError(f"{document.files.source}: /extensions/KHR_materials_variants {text}")
    return names.index(variant)


class _Material:
    """A material under construction."""

    def __init__(self, document: Document, textures: Textures, source: dict[str, Any], at: str) -> None:
        self._document, self._textures = document, textures
        self._source, self._at = source, at
        self._extensions: Mapping[str, dict[str, Any]] = source.get("extensions", {})
        self.made_of: dict[str, Any] = {"type": "principled"}

    def made(self) -> dict[str, Any]:
        """The material in the form of our own scene files."""
        base = self._base()
        if "KHR_materials_unlit" in self._extensions:
            self._unlit(base)
            return self.made_of
        glossy = "KHR_materials_pbrSpecularGlossiness" in self._extensions
        if glossy:
            base = self._specular_glossiness(self._extension("pbrSpecularGlossiness"))
        else:
            self._base_layer(base)
        self._glass()
        self._sheet()
        if not glossy:
            self._dielectric()
        self._layers()
        self._film()
        self._emission()
        self._alpha(base)
        if "normalTexture" in self._source:
            self._normal(self._source["normalTexture"], f"{self._at}/normalTexture")
        return self.made_of

    def _note(self, sentence: str) -> None:
        self._document.note(f"{self._at}{sentence}")

    def _extension(self, name: str) -> dict[str, Any]:
        return self._extensions.get(f"KHR_materials_{name}", {})

    def _number(self, key: str, factor: float, info: dict[str, Any] | None, at: str, channel: str) -> None:
        """Set a number, multiplied by one channel of a texture if there is one."""
        texture = self._textures.made(info, f"{self._at}{at}") if factor else None
        if texture is not None:
            texture |= {"channel": channel, "color_space": "linear", "scale": [factor] * 3}
        self.made_of[key] = factor if texture is None else texture

    def _color(self, key: str, factor: list[float], info: dict[str, Any] | None, at: str) -> None:
        texture = self._textures.made(info, f"{self._at}{at}") if any(factor) else None
        if texture is not None:
            texture |= {"color_space": "srgb", "scale": factor}
        elif self._textures.lost(info):
            factor = [LOST * x for x in factor] if key == "base_color" else [0.0 for _ in factor]
        self.made_of[key] = factor if texture is None else texture

    def _base(self) -> dict[str, Any]:
        found: dict[str, Any] = self._source.get("pbrMetallicRoughness", {})
        return found

    def _base_layer(self, base: dict[str, Any]) -> None:
        at = "/pbrMetallicRoughness"
        self._color(
            "base_color",
            base.get("baseColorFactor", [1.0] * 4)[:3],
            base.get("baseColorTexture"),
            f"{at}/baseColorTexture",
        )
        for key, name, channel in (("metallic", "metallicFactor", "b"), ("roughness", "roughnessFactor", "g")):
            place = f"{at}/metallicRoughnessTexture"
            self._number(key, base.get(name, 1.0), base.get("metallicRoughnessTexture"), place, channel)

    def _specular_glossiness(self, given: dict[str, Any]) -> dict[str, Any]:
        """KHR_materials_pbrSpecularGlossiness: a diffuse colour, and a reflectance at normal incidence by colour.

        The index of refraction is the one of the largest reflectance, and `specular_color` has the others relative to
        it. Returns what stands for the base of metallic and roughness.
        """
        at = "/extensions/KHR_materials_pbrSpecularGlossiness"
        base = {"baseColorFactor": given.get("diffuseFactor", [1.0] * 4)}
        if "diffuseTexture" in given:
            base["baseColorTexture"] = given["diffuseTexture"]
        self._color("base_color", base["baseColorFactor"][:3], given.get("diffuseTexture"), f"{at}/diffuseTexture")
        specular = given.get("specularFactor", [1.0] * 3)
        most = min(max(specular), _MOST_SPECULAR)
        root = math.sqrt(most)
        self.made_of |= {"metallic": 0.0, "roughness": 1.0 - given.get("glossinessFactor", 1.0)}
        self.made_of["ior"] = (1.0 + root) / (1.0 - root)
        texture = given.get("specularGlossinessTexture")
        color = [min(x / most, 1.0) for x in specular] if most > 0.0 else [0.0] * 3
        self._color("specular_color", color, texture, f"{at}/specularGlossinessTexture")
        if texture is not None:
            self._note(f"{at}/specularGlossinessTexture: its alpha, the glossiness, was left out")
        return base

    def _glass(self) -> None:
        """KHR_materials_transmission: a thin wall, but with KHR_materials_volume the boundary of a solid."""
        glass, volume = self._extension("transmission"), self._extension("volume")
        factor = glass.get("transmissionFactor", 0.0)
        if not factor:
            return
        at = "/extensions/KHR_materials_transmission/transmissionTexture"
        self._number("transmission", factor, glass.get("transmissionTexture"), at, "r")
        if not volume.get("thicknessFactor"):
            self.made_of["thin"] = True
            return
        if "thicknessTexture" in volume:
            self._note(
                "/extensions/KHR_materials_volume/thicknessTexture was left out: light goes through the mesh itself"
            )
        color, distance = volume.get("attenuationColor", [1.0] * 3), volume.get("attenuationDistance", math.inf)
        if distance < 1e12 and min(color) < 1.0:
            self.made_of["attenuation_color"] = [max(share, _LEAST_LEFT) for share in color]
            self.made_of["attenuation_distance"] = max(distance, 1e-9)

    def _sheet(self) -> None:
        """KHR_materials_diffuse_transmission: of a sheet, such as a leaf; what has an inside is not one."""
        sheet, at = self._extension("diffuse_transmission"), "/extensions/KHR_materials_diffuse_transmission"
        factor = sheet.get("diffuseTransmissionFactor", 0.0)
        if not factor:
            return
        if self.made_of.get("transmission") and not self.made_of.get("thin"):
            self._note(f"{at} was left out: light is transmitted into a solid here (KHR_materials_volume)")
            return
        if self._extension("volume").get("thicknessFactor"):
            text = "was left out: what lets diffuse light through is a sheet here (KHR_materials_diffuse_transmission)"
            self._note(f"/extensions/KHR_materials_volume {text}")
        for name in ("diffuseTransmissionTexture", "diffuseTransmissionColorTexture"):
            if name in sheet:
                self._note(f"{at}/{name} was left out: its factor counts everywhere")
        self.made_of["diffuse_transmission"] = factor
        self.made_of["diffuse_transmission_color"] = sheet.get("diffuseTransmissionColorFactor", [1.0] * 3)

    def _dielectric(self) -> None:
        """KHR_materials_ior, KHR_materials_dispersion and KHR_materials_specular."""
        ior = self._extension("ior").get("ior", 1.5)
        if not 1.0 <= ior <= _HIGH_INDEX:
            used = _HIGH_INDEX if ior == 0.0 or ior > 1.0 else 1.0
            if ior != 0.0:  # 0 means a surface that reflects all light
                self._note(f"/extensions/KHR_materials_ior/ior is {ior:g}; {used:g} is taken instead")
            ior = used
        self.made_of["ior"] = ior
        dispersion = self._extension("dispersion").get("dispersion", 0.0)
        if dispersion > 0.0:
            self.made_of["dispersion"] = {"abbe": min(max(20.0 / dispersion, 1.0), 1e6)}
        specular, at = self._extension("specular"), "/extensions/KHR_materials_specular"
        if not specular:
            return
        self._number(
            "specular",
            specular.get("specularFactor", 1.0),
            specular.get("specularTexture"),
            f"{at}/specularTexture",
            "a",
        )
        color = specular.get("specularColorFactor", [1.0] * 3)
        if max(color) > 1.0:
            self._note(f"{at}/specularColorFactor is above 1, where it was cut off")
            color = [min(share, 1.0) for share in color]
        self._color("specular_color", color, specular.get("specularColorTexture"), f"{at}/specularColorTexture")

    def _layers(self) -> None:
        """Clear coat, sheen and anisotropy."""
        if coat := self._extension("clearcoat"):
            at = "/extensions/KHR_materials_clearcoat"
            self._number(
                "coat", coat.get("clearcoatFactor", 0.0), coat.get("clearcoatTexture"), f"{at}/clearcoatTexture", "r"
            )
            rough = f"{at}/clearcoatRoughnessTexture"
            self._number(
                "coat_roughness",
                coat.get("clearcoatRoughnessFactor", 0.0),
                coat.get("clearcoatRoughnessTexture"),
                rough,
                "g",
            )
            if "clearcoatNormalTexture" in coat and coat["clearcoatNormalTexture"] != self._source.get("normalTexture"):
                self._note(f"{at}/clearcoatNormalTexture was left out: a coat has the normals of what is below it")
        if sheen := self._extension("sheen"):
            at = "/extensions/KHR_materials_sheen"
            self._color(
                "sheen_color",
                sheen.get("sheenColorFactor", [0.0] * 3),
                sheen.get("sheenColorTexture"),
                f"{at}/sheenColorTexture",
            )
            rough = f"{at}/sheenRoughnessTexture"
            self._number(
                "sheen_roughness",
                sheen.get("sheenRoughnessFactor", 0.0),
                sheen.get("sheenRoughnessTexture"),
                rough,
                "a",
            )
        anisotropy = self._extension("anisotropy")
        if anisotropy.get("anisotropyStrength"):
            at = "/extensions/KHR_materials_anisotropy"
            texture = anisotropy.get("anisotropyTexture")
            self._number("anisotropy", anisotropy["anisotropyStrength"], texture, f"{at}/anisotropyTexture", "b")
            turn = math.degrees(anisotropy.get("anisotropyRotation", 0.0))
            self.made_of["anisotropy_rotation"] = math.fmod(turn, 360.0)
            if texture is not None:
                self._note(f"{at}/anisotropyTexture: its directions, in red and green, were left out; its blue counts")

    def _film(self) -> None:
        """KHR_materials_iridescence: a thin film on all that reflects."""
        film, at = self._extension("iridescence"), "/extensions/KHR_materials_iridescence"
        factor = film.get("iridescenceFactor", 0.0)
        if not factor:
            return
        self._number("iridescence", factor, film.get("iridescenceTexture"), f"{at}/iridescenceTexture", "r")
        ior = film.get("iridescenceIor", 1.3)
        if ior > _MOST_FILM_INDEX:
            self._note(f"{at}/iridescenceIor is {ior:g}; {_MOST_FILM_INDEX:g} is taken instead")
        self.made_of["iridescence_ior"] = min(ior, _MOST_FILM_INDEX)
        least, most = film.get("iridescenceThicknessMinimum", 100.0), film.get("iridescenceThicknessMaximum", 400.0)
        if max(least, most) > _THICKEST_FILM:
            self._note(f"{at}: its film is thicker than {_THICKEST_FILM:g} nm, which is taken instead")
        least, most = min(least, _THICKEST_FILM), min(most, _THICKEST_FILM)
        info = film.get("iridescenceThicknessTexture")
        texture = self._textures.made(info, f"{self._at}{at}/iridescenceThicknessTexture")
        if texture is not None:
            texture |= {"channel": "g", "range": [least, most]}
        self.made_of["iridescence_thickness"] = most if texture is None else texture

    def _emission(self) -> None:
        factor = self._source.get("emissiveFactor", [0.0] * 3)
        if not any(factor):
            return
        self._color("emission", factor, self._source.get("emissiveTexture"), "/emissiveTexture")
        strength = self._extension("emissive_strength").get("emissiveStrength", 1.0)
        if strength > 1e12:
            self._note(
                "/extensions/KHR_materials_emissive_strength/emissiveStrength is above 1e12, where it was cut off"
            )
        self.made_of["emission_strength"] = min(strength, 1e12)
        self._front_only()

    def _front_only(self) -> None:
        if self._source.get("doubleSided"):
            self._document.note("double-sided materials shine from their fronts only; they reflect on both sides")

    def _alpha(self, base: dict[str, Any]) -> None:
        """Alpha modes; a mask makes the surface fully opaque or fully transparent."""
        mode, alpha = self._source.get("alphaMode", "OPAQUE"), base.get("baseColorFactor", [1.0] * 4)[3]
        if mode == "OPAQUE":
            return
        if self.made_of.get("transmission") and not self.made_of.get("thin"):
            self._note("/alphaMode was left out: what has an inside has no holes (KHR_materials_volume)")
            return
        cutoff = self._source.get("alphaCutoff", 0.5) if mode == "MASK" else None
        at = f"{self._at}/pbrMetallicRoughness/baseColorTexture"
        texture = self._textures.made(base.get("baseColorTexture"), at) if alpha else None
        if cutoff is not None and (cutoff > 1.0 or cutoff == 0.0 or texture is None):
            if (1.0 if texture is not None else alpha) < cutoff:
                self.made_of["opacity"] = 0.0
            return
        if texture is not None:
            texture |= {"channel": "a", "scale": [alpha] * 3}
        if texture is not None or alpha < 1.0:
            self.made_of["opacity"] = alpha if texture is None else texture
        if cutoff is not None:
            self.made_of["opacity_cutoff"] = cutoff

    def _normal(self, info: dict[str, Any], at: str) -> None:
        texture = self._textures.made(info, at)
        if texture is not None:
            self.made_of["normal_map"] = texture | {"scale": min(max(info.get("scale", 1.0), -100.0), 100.0)}

    def _unlit(self, base: dict[str, Any]) -> None:
        """An unlit material emits its colour."""
        self.made_of |= {"base_color": [0.0] * 3, "specular": 0.0, "metallic": 0.0, "roughness": 1.0}
        at = "/pbrMetallicRoughness/baseColorTexture"
        self._color("emission", base.get("baseColorFactor", [1.0] * 4)[:3], base.get("baseColorTexture"), at)
        self._document.note("unlit materials shine with their colour as radiance, and light what is around them")
        self._front_only()
        self._alpha(base)
