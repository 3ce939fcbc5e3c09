"""Materials as Mitsuba's BSDFs."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from clrender.exporters.files import write_bytes
from clrender.exporters.mitsuba_textures import TextureWriter
from clrender.exporters.mitsuba_xml import Element, element, spectral, value
from clrender.exporters.surfaces import (
    BUMP_BESIDE,
    GLOSS_OF_SHEETS,
    ONCE,
    alphas_of,
    is_rough,
    tell_of_film,
    without_measured,
)
from clrender.exporters.target import Target
from clrender.flatten.hair import hair_absorption
from clrender.flatten.measured import is_anisotropic
from clrender.measured import MeasuredFile
from clrender.scene.materials import (
    Conductor,
    Dielectric,
    Hair,
    Lambert,
    Material,
    Measured,
    Mirror,
    Mix,
    OrenNayar,
    Principled,
    Subsurface,
)
from clrender.scene.textures import ImageTexture, Texture

__all__ = ["MaterialWriter"]

_At: TypeAlias = tuple[str | int, ...]
_BLACK: Final = "black"
_COAT: Final = 0.25
"""Strength of Disney's clear coat of 1, as a fraction of clrender's."""
_COAT_ALPHA: Final = (0.1, 0.001)
"""Alpha of Disney's clear coat at a gloss of 0 and 1."""
_STRETCH: Final = 0.9
"""The square of the ratio of Disney's two alphas is 1 - 0.9 anisotropic."""


class MaterialWriter:
    """Writes materials, each once for each index of refraction around it.

    Parameters
    ----------
    target : Target
    textures : TextureWriter

    Attributes
    ----------
    written : list of Element
        In an order in which each refers only to those before it.
    """

    def __init__(self, target: Target, textures: TextureWriter) -> None:
        self._target, self._textures = target, textures
        self._ids: dict[tuple[str, float | None, bool], str] = {}
        self.written: list[Element] = []

    def reference(self, name: str | None, around: float | None = None, turned: bool = False) -> Element:
        """A reference to a material, which is written at its first use.

        Parameters
        ----------
        name : str or None
            None: black.
        around : float, optional
            Index of refraction in front of it, for materials with a priority.
        turned : bool
            See `turns_green`.
        """
        key = (name if name is not None else "", around, turned)
        if key not in self._ids:
            if name is None:
                black = element("bsdf", value("rgb", "reflectance", [0.0] * 3), type="diffuse")
                made, wanted = element("bsdf", black, type="twosided"), _BLACK
            else:
                made, wanted = (
                    self._masked(self._target.scene.materials[name], ("materials", name), around, turned),
                    name,
                )
            made.set("id", self._target.id("material", wanted))
            self.written.append(made)
            self._ids[key] = made.get("id", "")
        return element("ref", id=self._ids[key])

    def _masked(self, material: Material, at: _At, around: float | None, turned: bool) -> Element:
        inside = self._two_sided(material, at, around, turned)
        if not material.masked:
            return inside
        cutoff = material.opacity_cutoff
        if cutoff is None:
            opacity = self._textures.number("opacity", material.opacity, (*at, "opacity"))
        else:
            if isinstance(material.opacity, ImageTexture) and material.opacity.filter == "linear":
                sentence = "the cutoff of an opacity between texels, whose edges follow the texels"
                self._target.leave_out(sentence, *at, "opacity_cutoff")
            opacity = self._textures.number(
                "opacity",
                material.opacity,
                (*at, "opacity"),
                lambda x: np.asarray(x >= cutoff, np.float32),
            )
        return element("bsdf", opacity, inside, type="mask")

    def _two_sided(self, material: Material, at: _At, around: float | None, turned: bool) -> Element:
        surface = self._surface(material, at, around, turned)
        front = self._bumpy(surface, material, at, turned)
        opaque = isinstance(material, Lambert | OrenNayar | Mirror | Conductor | Measured) or (
            isinstance(material, Principled) and material.transmission == 0.0 and material.diffuse_transmission == 0.0
        )
        flat = isinstance(material, Subsurface) and material.ior is None
        if flat or (opaque and material.two_sided):  # type: ignore[union-attr]
            # Mitsuba's back is the front in a mirror, where ours is the same surface seen from behind
            both = [front] if front is surface else [front, self._bumpy(surface, material, at, turned, behind=True)]
            return element("bsdf", *both, type="twosided")
        return front

    def _bumpy(self, surface: Element, material: Material, at: _At, turned: bool, behind: bool = False) -> Element:
        """A surface with its normal map or bump map."""
        if isinstance(material, Mix | Hair):
            return surface
        side = -1.0 if behind else 1.0
        if material.solid and (material.normal_map is not None or material.bump_map is not None):
            self._target.leave_out("some light that passes glass with a normal map or bump map", *at)
        if material.normal_map is not None:
            if material.bump_map is not None:  # Mitsuba turns the one below the other with the surface
                self._target.leave_out(BUMP_BESIDE, *at, "bump_map")
            signs = (side, -side if turned else side)
            picture = self._textures.normal_map(material.normal_map, (*at, "normal_map"), signs)
            # Else Mitsuba models a microsurface of two facets, which clrender does not
            plain = value("boolean", "use_shadowing_function", False)
            return element("bsdf", picture, plain, surface, type="normalmap")
        if material.bump_map is not None:
            picture = self._textures.bump_map(material.bump_map, (*at, "bump_map"))
            scale = value("float", "scale", side * material.bump_map.scale)
            return element("bsdf", picture, scale, surface, type="bumpmap")
        return surface

    def _surface(self, material: Material, at: _At, around: float | None, turned: bool) -> Element:
        if isinstance(material, Measured):
            file = self._target.scene.measured(str(at[-1]), material)
            if file.has_spectra:
                if is_anisotropic(self._target.scene, material):
                    sentence = "where the x axis of measured reflectance lies: there along the texture coordinate u"
                    self._target.leave_out(sentence, *at)
                return self._measured(material, file)
            material = without_measured(self._target, material, at, "diffuse: Mitsuba reads files of RGL with spectra")
        tell_of_film(self._target, material, at)
        if isinstance(material, Lambert):
            return self._diffuse(material.reflectance, (*at, "reflectance"))
        if isinstance(material, OrenNayar):
            self._target.leave_out("the roughness of oren_nayar, which is written as diffuse", *at)
            return self._diffuse(material.reflectance, (*at, "reflectance"))
        if isinstance(material, Mirror):
            color = self._textures.color("specular_reflectance", material.reflectance, (*at, "reflectance"))
            return element("bsdf", value("string", "material", "none"), color, type="conductor")
        if isinstance(material, Conductor):
            return self._conductor(material, at)
        if isinstance(material, Dielectric):
            outside = material.exterior_ior if around is None else around
            return self._glass(material, at, material.ior, outside, material.roughness, material.multiple_scattering)
        if isinstance(material, Subsurface):
            return self._subsurface(material, at, around)
        if isinstance(material, Hair):
            return self._hair(material, at)
        if isinstance(material, Mix):
            weight = self._textures.number("weight", material.weight, (*at, "weight"))
            parts = [self.reference(each, turned=turned) for each in material.materials]
            return element("bsdf", weight, *parts, type="blendbsdf")
        assert isinstance(material, Principled)  # scenes with plugins are refused
        return self._principled(material, at)

    def _measured(self, material: Measured, file: MeasuredFile) -> Element:
        write = partial(write_bytes, data=file.content.tobytes())
        name = self._target.files.add(self._target.folder, Path(material.file).stem, file.ending, file.sha256(), write)
        return element("bsdf", value("string", "filename", name), type="measured")

    def _hair(self, material: Hair, at: _At) -> Element:
        if isinstance(material.reflectance, Texture):
            self._target.leave_out("the texture of hair, which is written as one colour", *at, "reflectance")
        index = [value("float", "int_ior", material.ior), value("float", "ext_ior", 1.0)]
        rough = [
            value("float", "longitudinal_roughness", material.roughness),
            value("float", "azimuthal_roughness", material.azimuthal_roughness),
            value("float", "scale_tilt", material.tilt_degrees),
        ]
        return element("bsdf", value("rgb", "sigma_a", hair_absorption(material)), *index, *rough, type="hair")

    def _diffuse(self, reflectance: Any, at: _At) -> Element:
        return element("bsdf", self._textures.color("reflectance", reflectance, at), type="diffuse")

    def _alpha(self, roughness: Any, at: _At, name: str = "alpha") -> Element:
        return self._textures.number(name, roughness, (*at, "roughness"), np.square)

    def _facets(self, material: Conductor | Dielectric | Subsurface) -> Element:
        return value("string", "distribution", getattr(material, "microfacets", "ggx"))

    def _conductor(self, material: Conductor, at: _At) -> Element:
        if material.index is None:
            # Disney's metals have Schlick's Fresnel term, too
            if material.microfacets != "ggx":
                self._target.leave_out("the Beckmann microfacets of a metal with f0, whose facets are of GGX", *at)
            color = self._textures.color("base_color", material.f0, (*at, "f0"))
            if material.multiple_scattering and is_rough(material.roughness):
                self._target.leave_out(ONCE, *at)
            rough = self._disney_roughness(material, at)
            return element("bsdf", color, value("float", "metallic", 1.0), *rough, type="principled")
        eta, k = (spectral(name, each) for name, each in zip(("eta", "k"), material.index, strict=True))
        if not is_rough(material.roughness):
            return element("bsdf", eta, k, type="conductor")
        if material.multiple_scattering:
            self._target.leave_out(ONCE, *at)
        alphas = alphas_of(self._target, material, at)
        if alphas is None:
            sides = [self._alpha(material.roughness, at)]
        else:
            sides = [value("float", name, alpha) for name, alpha in zip(("alpha_u", "alpha_v"), alphas, strict=True)]
        return element("bsdf", eta, k, self._facets(material), *sides, type="roughconductor")

    def _disney_roughness(self, material: Conductor | Principled, at: _At) -> list[Element]:
        """Roughness and anisotropy of Disney's model, whose alphas are r^2 / s along u and r^2 s along v."""
        alphas = alphas_of(self._target, material, at)
        if alphas is None:
            return [self._textures.number("roughness", material.roughness, (*at, "roughness"))]
        along, across = alphas
        if along == 0.0 or across == 0.0:  # smooth, whatever its anisotropy
            return [value("float", "roughness", 0.0)]
        if across > along or across < (1.0 - _STRETCH) * along:
            self._target.leave_out("anisotropy along v, or by more than a factor of 10, in Disney's model", *at)
        ratio = min(max(across / along, 1.0 - _STRETCH), 1.0)
        both = {"roughness": math.sqrt(math.sqrt(along * across)), "anisotropic": (1.0 - ratio) / _STRETCH}
        return [value("float", name, number) for name, number in both.items()]

    def _glass(
        self,
        material: Dielectric | Subsurface,
        at: _At,
        inside: float,
        outside: float,
        roughness: Any,
        multiple: bool = True,
    ) -> Element:
        indices = [value("float", "int_ior", inside), value("float", "ext_ior", outside)]
        rough = is_rough(roughness)
        if getattr(material, "thin", False):
            if rough:
                self._target.leave_out("the roughness of thin glass", *at)
            return element("bsdf", *indices, type="thindielectric")
        if not rough or inside == outside:
            return element("bsdf", *indices, type="dielectric")
        if multiple:
            self._target.leave_out(ONCE, *at)
        return element("bsdf", *indices, self._facets(material), self._alpha(roughness, at), type="roughdielectric")

    def _subsurface(self, material: Subsurface, at: _At, around: float | None) -> Element:
        """With an index glass around its medium; without one diffuse."""
        if material.ior is not None:
            return self._glass(material, at, material.ior, 1.0 if around is None else around, material.roughness)
        self._target.leave_out("the inside of subsurface without an index, which is written as diffuse", *at)
        return self._diffuse(material.albedo, (*at, "albedo"))

    def _principled(self, material: Principled, at: _At) -> Element:
        if material.diffuse_roughness != 0.0:
            self._target.leave_out("the roughness of the diffuse part of principled", *at, "diffuse_roughness")
        if is_rough(material.roughness) and (material.metallic != 0.0 or material.transmission != 0.0):
            self._target.leave_out(ONCE, *at)
        plain = ("metallic", "transmission", "diffuse_transmission", "coat", "anisotropy", "roughness")
        constant = not isinstance(material.specular, Texture)
        if constant and material.sheen_color == (0.0, 0.0, 0.0) and all(getattr(material, k) == 0.0 for k in plain):
            return self._plastic(material, at)
        return self._disney(material, at)

    def _plastic(self, material: Principled, at: _At) -> Element:
        """A diffuse surface below a smooth dielectric one.

        Rough plastic is none for others: of white it reflects 74 % at a roughness of 0.5, Disney's model 105 %.
        """
        if material.ior == 1.0 or material.specular == 0.0:
            return self._diffuse(material.base_color, (*at, "base_color"))
        base = self._textures.color("diffuse_reflectance", material.base_color, (*at, "base_color"))
        tint = self._textures.color("specular_reflectance", material.specular_color, (*at, "specular_color"))
        # Not by a darker tint: what is not reflected reaches the surface below
        index = material.ior if material.specular == 1.0 else self._index(material, at)
        indices = [value("float", "int_ior", index), value("float", "ext_ior", 1.0)]
        return element("bsdf", base, tint, *indices, type="plastic")

    def _disney(self, material: Principled, at: _At) -> Element:
        """Disney's model, which is alike in its metal, glass and diffuse parts."""
        if material.metallic != 1.0 and material.transmission != 1.0:
            self._target.leave_out("the balance of principled, of which Mitsuba's reflects up to 5 % more", *at)
        if material.microfacets != "ggx":
            self._target.leave_out("the Beckmann microfacets of principled, whose facets are of GGX", *at)
        numbers = self._textures.number
        inside = [self._textures.color("base_color", material.base_color, (*at, "base_color"))]
        inside += self._disney_roughness(material, at)
        inside.append(value("float", "eta", self._index(material, at)))
        if material.specular_color != (1.0, 1.0, 1.0):
            self._target.leave_out("the colour of the dielectric reflection of principled", *at, "specular_color")
        thin = material.diffuse_transmission != 0.0 or (material.thin and material.transmission != 0.0)
        if material.transmission != 0.0:
            inside.append(numbers("spec_trans", material.transmission, (*at, "transmission")))
        if material.diffuse_transmission != 0.0:
            inside.append(value("float", "diff_trans", 2.0 * material.diffuse_transmission))
            if material.transmission == 0.0 and material.specular != 0.0 and material.ior != 1.0:
                self._target.leave_out(GLOSS_OF_SHEETS, *at, "diffuse_transmission")
            if material.diffuse_transmission_color != (1.0, 1.0, 1.0):
                self._target.leave_out("the colour of diffuse transmission", *at)
        if thin and material.metallic != 0.0:
            self._target.leave_out("the metal in thin principled", *at, "metallic")
        elif not thin:
            inside.append(numbers("metallic", material.metallic, (*at, "metallic")))
        if material.coat != 0.0:
            if thin:
                self._target.leave_out("the clear coat of thin principled", *at, "coat")
            else:
                inside += self._coat(material, at)
        if material.sheen_color != (0.0, 0.0, 0.0):
            inside += self._sheen(material, at)
        return element("bsdf", *inside, type="principledthin" if thin else "principled")

    def _index(self, material: Principled, at: _At) -> float:
        """The index of refraction that has the reflectance at normal incidence, scaled by `specular`."""
        root = (material.ior - 1.0) / (material.ior + 1.0)
        if not isinstance(material.specular, float):
            self._target.leave_out("the texture of the strength of the dielectric reflection", *at, "specular")
        elif material.transmission == 0.0:
            root *= math.sqrt(material.specular)
        # Mitsuba's model is undefined at 1
        return max((1.0 + root) / (1.0 - root), 1.001)

    def _coat(self, material: Principled, at: _At) -> list[Element]:
        coat = material.coat
        if not isinstance(coat, float) or not isinstance(material.coat_roughness, float):
            self._target.leave_out("clear coats where they, or their roughness, are textures", *at, "coat")
            return []
        if coat > _COAT:
            sentence = "the strength of clear coats beyond Mitsuba's strongest, which is a quarter of ours"
            self._target.leave_out(sentence, *at, "coat")
        rough, smooth = _COAT_ALPHA
        gloss = min(max((rough - material.coat_roughness * material.coat_roughness) / (rough - smooth), 0.0), 1.0)
        return [value("float", "clearcoat", min(coat / _COAT, 1.0)), value("float", "clearcoat_gloss", gloss)]

    def _sheen(self, material: Principled, at: _At) -> list[Element]:
        if isinstance(material.sheen_color, Texture):
            self._target.leave_out("textures of sheen", *at, "sheen_color")
            return []
        self._target.leave_out("the roughness of sheen, which Disney's has not", *at, "sheen_color")
        return [value("float", "sheen", max(material.sheen_color))]
