"""Materials as LuxCore's."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np

from clrender.exporters.luxcore_text import Properties
from clrender.exporters.luxcore_textures import TextureWriter
from clrender.exporters.surfaces import (
    BUMP_BESIDE,
    GLOSS_OF_SHEETS,
    ONCE,
    Inside,
    alphas_of,
    inside_of,
    is_rough,
    passes,
    radiance_of,
    tell_of_film,
    tell_of_glow,
    tell_of_grid,
    without_measured,
)
from clrender.exporters.target import Target
from clrender.exporters.triangles import At
from clrender.flatten.emission import emits
from clrender.flatten.hair import hair_color
from clrender.scene.materials import (
    Conductor,
    Dielectric,
    Hair,
    Lambert,
    Material,
    Mirror,
    Mix,
    OrenNayar,
    Principled,
    Subsurface,
    material_parts,
)
from clrender.scene.shapes import AnyShape
from clrender.scene.textures import ImageTexture, Texture

__all__ = ["MaterialWriter"]

_SMOOTHEST: Final = 1e-3
"""Alpha of smooth metals, which LuxCore has not."""
_COAT_INDEX: Final = 1.5


class MaterialWriter:
    """Writes materials, each once for each emission and medium of a shape.

    Parameters
    ----------
    target : Target
    properties : dict
        Where they are written, each after those that it refers to.
    textures : TextureWriter
    """

    def __init__(self, target: Target, properties: Properties, textures: TextureWriter) -> None:
        self._target, self._properties, self._textures = target, properties, textures
        self._names: dict[str, str] = {}
        self._turned = False  # of the shape whose material is being written

    def of_shape(self, at: At, shape: AnyShape, turned: bool) -> str:
        """The name of the material of a shape, with its emission and the medium behind it; for `turned` see
        `turns_green`."""
        scene, self._turned = self._target.scene, turned
        through = passes(scene, shape)
        inside = inside_of(scene, shape) if through else None
        tell_of_grid(self._target, inside)
        tell_of_glow(self._target, inside)
        surface = shape.model_dump(mode="json", include={"material", "emission"})
        key = json.dumps([surface, through, None if inside is None else inside.key, turned])
        if key not in self._names:
            more: Properties = {}
            if emits(scene, shape):
                if any(map(_is_thin_glass, material_parts(scene.materials, shape.material))):
                    self._target.leave_out("most of the light that thin glass emits", *at)
                more |= {"emission": self._textures.color(*radiance_of(scene, at, shape)), "emission.power": 0.0}
                more |= {"emission.efficency": 0.0, "emission.gain": [1.0] * 3}
            if through:
                if inside is not None and any(inside.scattering) and shape.material is not None:
                    sentence = "light that scatters in glass, of which LuxCore loses up to a third"
                    self._target.leave_out(sentence, "materials", shape.material)
                more["volume.interior"] = self.volume(shape.material, inside)
            self._names[key] = self._named(shape.material, more, invisible=through and shape.material is None)
        return self._names[key]

    def volume(self, material: str | None, inside: Inside | None) -> str:
        """The name of the volume behind a material, which is empty without a medium."""
        described = None if material is None else self._target.scene.materials[material]
        priority = getattr(described, "priority", None)
        # Without a priority, the material's own indices count
        values: Properties = {"ior": (getattr(described, "ior", None) or 1.0) if priority is not None else 1.0}
        values["priority"] = 0 if priority is None else priority
        if inside is None or not any(inside.scattering):
            absorption = (0.0, 0.0, 0.0) if inside is None else inside.absorption
            values = {"type": "clear", "absorption": absorption, **values}
        else:
            both = {"absorption": inside.absorption, "scattering": inside.scattering}
            values = {"type": "homogeneous", **both, "asymmetry": [inside.g] * 3, "multiscattering": True, **values}
        key = f"volume {json.dumps({name: np.asarray(value).tolist() for name, value in values.items()})}"
        if key not in self._names:
            name = self._target.id("volume", inside.name if inside is not None else "empty")
            self._names[key] = name
            self._properties.update({f"scene.volumes.{name}.{each}": value for each, value in values.items()})
        return self._names[key]

    def _part(self, name: str) -> str:
        """One of the materials of a mixture."""
        key = f"part {name} {self._turned}"
        if key not in self._names:
            self._names[key] = self._named(name, {})
        return self._names[key]

    def _new(self, wanted: str, values: Properties) -> str:
        name = self._target.id("material", wanted)
        self._properties.update({f"scene.materials.{name}.{key}": value for key, value in values.items()})
        return name

    def _named(self, name: str | None, more: Properties, invisible: bool = False) -> str:
        if name is None:
            black = {"type": "null"} if invisible else {"type": "matte", "kd": [0.0] * 3}
            return self._new("invisible" if invisible else "black", black | more)
        material, at = self._target.scene.materials[name], ("materials", name)
        values = self._surface(material, at) | self._bumps(material, at)
        values = values if getattr(material, "two_sided", True) else self._one_sided(name, values)
        return self._new(name, values | self._mask(material, at) | more)

    def _one_sided(self, name: str, values: Properties) -> Properties:
        back = self._new("back", {"type": "matte", "kd": [0.0] * 3})
        return {"type": "twosided", "frontmaterial": self._new(name, values), "backmaterial": back}

    def _mask(self, material: Material, at: At) -> Properties:
        """The opacity, which LuxCore calls transparency."""
        if not material.masked:
            return {}
        cutoff = material.opacity_cutoff
        if cutoff is None:
            return {"transparency": self._textures.number(material.opacity, (*at, "opacity"))}
        if isinstance(material.opacity, ImageTexture) and material.opacity.filter == "linear":
            sentence = "the cutoff of an opacity between texels, whose edges follow the texels"
            self._target.leave_out(sentence, *at, "opacity_cutoff")
        curve = lambda x: np.asarray(x >= cutoff, np.float32)  # noqa: E731
        return {"transparency": self._textures.number(material.opacity, (*at, "opacity"), curve)}

    def _bumps(self, material: Material, at: At) -> Properties:
        if isinstance(material, Mix | Hair):
            return {}
        if material.normal_map is not None:
            if material.bump_map is not None:
                self._target.leave_out(BUMP_BESIDE, *at, "bump_map")
            sentence = "the balance of normal maps, with which LuxCore's images are 1 to 2 % darker"
            self._target.leave_out(sentence, *at, "normal_map")
            signs = (1.0, -1.0 if self._turned else 1.0)
            return {"bumptex": self._textures.normal_map(material.normal_map, (*at, "normal_map"), signs)}
        if material.bump_map is not None:
            return {"bumptex": self._textures.bump_map(material.bump_map, (*at, "bump_map"))}
        return {}

    def _surface(self, material: Material, at: At) -> Properties:
        material = without_measured(self._target, material, at, "matte")
        tell_of_film(self._target, material, at)
        color = self._textures.color
        if isinstance(material, Lambert):
            return {"type": "matte", "kd": color(material.reflectance, (*at, "reflectance"))}
        if isinstance(material, OrenNayar):
            self._target.leave_out("the roughness of oren_nayar, which is written as matte", *at)
            return {"type": "matte", "kd": color(material.reflectance, (*at, "reflectance"))}
        if isinstance(material, Mirror):
            return {"type": "mirror", "kr": color(material.reflectance, (*at, "reflectance"))}
        if isinstance(material, Conductor):
            return self._conductor(material, at)
        if isinstance(material, Dielectric):
            return self._glass(material, at, material.exterior_ior, [1.0] * 3)
        if isinstance(material, Subsurface):
            if material.ior is not None:
                return self._glass(material, at, 1.0, [1.0] * 3)
            self._target.leave_out("the inside of subsurface without an index, which is written as matte", *at)
            return {"type": "matte", "kd": color(material.albedo, (*at, "albedo"))}
        if isinstance(material, Hair):
            self._target.leave_out("hair, which is written as matte", *at)
            return {"type": "matte", "kd": color(hair_color(material), (*at, "reflectance"))}
        if isinstance(material, Mix):
            first, second = map(self._part, material.materials)
            amount = self._textures.number(material.weight, (*at, "weight"))
            return {"type": "mix", "material1": first, "material2": second, "amount": amount}
        assert isinstance(material, Principled)  # scenes with plugins are refused
        return self._principled(material, at)

    def _roughness(self, material: Any, at: At) -> Properties:
        """Alpha along u and along v."""
        alphas = alphas_of(self._target, material, at) if isinstance(material, Conductor | Principled) else None
        if alphas is None:
            least = np.float32(_SMOOTHEST)
            alpha = self._textures.number(material.roughness, (*at, "roughness"), lambda x: np.maximum(x * x, least))
            alphas = (alpha, alpha)
        return dict(zip(("uroughness", "vroughness"), alphas, strict=True))

    def _facets(self, material: Any, at: At) -> None:
        """Note what LuxCore's microfacets lack."""
        if not is_rough(material.roughness):
            return
        self._target.leave_out("the distribution of microfacets, for which there is Schlick's", *at)
        if getattr(material, "multiple_scattering", True):
            self._target.leave_out(ONCE, *at)

    # --- metals and glass

    def _conductor(self, material: Conductor, at: At) -> Properties:
        self._facets(material, at)
        rough = self._roughness(material, at)
        if not is_rough(material.roughness):
            self._target.leave_out("smooth metals, which have an alpha of 0.001", *at)
        self._target.leave_out("the reflectance of metals at grazing angles, where LuxCore's is up to 15 % off", *at)
        if material.index is None:
            fresnel = {"type": "fresnelcolor", "kr": self._textures.color(material.f0, (*at, "f0"))}
        else:
            fresnel = dict(zip(("type", "n", "k"), ("fresnelconst", *material.index), strict=True))
        return {"type": "metal2", "fresnel": self._fresnel(fresnel), **rough}

    def _fresnel(self, values: Properties) -> str:
        name = self._target.id("texture", "fresnel")
        self._properties.update({f"scene.textures.{name}.{key}": value for key, value in values.items()})
        return name

    def _glass(self, material: Any, at: At, outside: float, tint: Any) -> Properties:
        values: Properties = {"kr": [1.0] * 3, "kt": tint}
        if getattr(material, "priority", None) is None:
            values |= {"interiorior": material.ior, "exteriorior": outside}
        rough = is_rough(material.roughness)
        if getattr(material, "thin", False):
            if rough:
                self._target.leave_out("the roughness of thin glass", *at)
            self._target.leave_out("the balance of thin glass, of which LuxCore's gains light at grazing angles", *at)
            return {"type": "archglass", **values}
        if not rough or getattr(material, "ior", 1.0) == outside:
            return {"type": "glass", **values}
        self._facets(material, at)
        return {"type": "roughglass", **values, **self._roughness(material, at)}

    # --- the principled model, of parts that LuxCore mixes

    def _principled(self, material: Principled, at: At) -> Properties:
        made = {} if material.metallic == 1.0 else self._dielectric(material, at)
        if material.metallic != 0.0:
            self._facets(material, at)
            fresnel = {"type": "fresnelcolor", "kr": self._textures.color(material.base_color, (*at, "base_color"))}
            metal = {"type": "metal2", "fresnel": self._fresnel(fresnel), **self._roughness(material, at)}
            made = self._mixed(material.metallic, (*at, "metallic"), made, metal)
        if material.sheen_color != (0.0, 0.0, 0.0):
            self._target.leave_out("sheen", *at, "sheen_color")
        if material.coat != 0.0:
            strength = self._textures.color if isinstance(material.coat, Texture) else lambda given, _: [given] * 3
            alpha = self._textures.number(material.coat_roughness, (*at, "coat_roughness"), np.square)
            base = self._new(f"{at[1]}-base", made | self._bumps(material, at))
            coat = {"ks": strength(material.coat, (*at, "coat")), "index": _COAT_INDEX}
            made = {"type": "glossycoating", "base": base, **coat, "uroughness": alpha, "vroughness": alpha}
        return made

    def _mixed(self, amount: Any, at: At, first: Properties, second: Properties) -> Properties:
        """A mixture of two parts, or one of them."""
        if not isinstance(amount, Texture) and amount in (0.0, 1.0):
            return second if amount else first
        both = (self._new(f"{at[1]}-part", each) for each in (first, second))
        values = dict(zip(("material1", "material2"), both, strict=True))
        return {"type": "mix", **values, "amount": self._textures.number(amount, at)}

    def _dielectric(self, material: Principled, at: At) -> Properties:
        base = self._textures.color(material.base_color, (*at, "base_color"))
        if material.transmission == 0.0:
            return self._opaque(material, at, base)
        glass = self._glass(material, at, 1.0, base)
        opaque = {} if material.transmission == 1.0 else self._opaque(material, at, base)
        return self._mixed(material.transmission, (*at, "transmission"), opaque, glass)

    def _opaque(self, material: Principled, at: At, base: Any) -> Properties:
        """The diffuse part, below the reflection of a dielectric."""
        if material.diffuse_roughness != 0.0:
            self._target.leave_out("the roughness of the diffuse part of principled", *at, "diffuse_roughness")
        share = material.diffuse_transmission
        if share != 0.0:
            self._target.leave_out(GLOSS_OF_SHEETS, *at, "diffuse_transmission")
            kept = self._textures.color(material.base_color, (*at, "base_color"), 1.0 - share)
            passed = share * np.array(material.diffuse_transmission_color)
            if isinstance(kept, str):
                self._target.leave_out("the balance of sheets with a texture, which transmit less", *at)
            else:
                # LuxCore's share is of what is not reflected
                passed = np.minimum(passed / np.maximum(1.0 - kept, 1e-6), 1.0)
            return {"type": "mattetranslucent", "kr": kept, "kt": passed}
        if material.ior == 1.0 or material.specular == 0.0:
            return {"type": "matte", "kd": base}
        sentence = "the balance of plastic, which reflects up to 2 % less, and has no gloss on its back"
        self._target.leave_out(sentence, *at)
        color, specular = material.specular_color, material.specular
        if isinstance(color, Texture) and isinstance(specular, Texture):
            self._target.leave_out("the texture of the strength of the dielectric reflection", *at, "specular")
            specular = 1.0
        if isinstance(specular, Texture):
            tint = self._textures.color(specular, (*at, "specular"), np.array(color))
        else:
            tint = self._textures.color(color, (*at, "specular_color"), specular)
        return {"type": "glossy2", "kd": base, "ks": tint, "index": material.ior, **self._roughness(material, at)}


def _is_thin_glass(material: Material) -> bool:
    """Whether it is LuxCore's ``archglass``, or a mixture with it."""
    glass = isinstance(material, Dielectric) or getattr(material, "transmission", 0.0) != 0.0
    return glass and bool(getattr(material, "thin", False))
