"""Materials as trees of Blender's nodes."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from clrender.exporters.cycles_nodes import Inputs, NodeTree, Socket
from clrender.exporters.cycles_textures import TextureWriter
from clrender.exporters.pictures import Curve
from clrender.exporters.surfaces import (
    ONCE,
    Inside,
    inside_of,
    inside_of_subsurface,
    is_brushed,
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
)
from clrender.scene.shapes import AnyShape
from clrender.scene.textures import Texture

__all__ = ["MaterialWriter", "volume"]

_BLACK: Final = (0.0, 0.0, 0.0)
_WHITE: Final = (1.0, 1.0, 1.0)
_COAT_INDEX: Final = 1.5


class MaterialWriter:
    """Writes materials, each once for each emission and medium of a shape.

    Parameters
    ----------
    target : Target
    textures : TextureWriter

    Attributes
    ----------
    written : dict
        Trees of nodes by name, as JSON has them.
    """

    def __init__(self, target: Target, textures: TextureWriter) -> None:
        self._target, self._textures = target, textures
        self.written: dict[str, Any] = {}
        self._names: dict[str, str] = {}

    def of_shape(self, at: At, shape: AnyShape) -> str:
        """The name of the material of a shape, with its emission and the medium behind it."""
        scene = self._target.scene
        through = passes(scene, shape)
        inside = inside_of(scene, shape) if through else self._diffuse_inside(shape)
        tell_of_grid(self._target, inside)
        tell_of_glow(self._target, inside)
        surface = shape.model_dump(mode="json", include={"material", "emission"})
        key = json.dumps([surface, through, None if inside is None else inside.key])
        if key not in self._names:
            tree = NodeTree()
            closure = self._whole(tree, at, shape, through)
            described = tree.described(closure, None if inside is None else volume(tree, inside))
            name = self._target.id("material", shape.material or "black")
            self._names[key] = name
            self.written[name] = {**described, "front_shines": emits(scene, shape)}
        return self._names[key]

    def _diffuse_inside(self, shape: AnyShape) -> Inside | None:
        """The medium in subsurface without an index, into and out of which its surface transmits as if diffuse."""
        material = None if shape.material is None else self._target.scene.materials[shape.material]
        if not isinstance(material, Subsurface):
            return None
        return inside_of_subsurface(f"materials.{shape.material}", f"inside of {shape.material}", material)

    def _whole(self, tree: NodeTree, at: At, shape: AnyShape, through: bool) -> Socket | None:
        """What happens at a surface, with the light that its front sends out."""
        scene = self._target.scene
        shines = self._emission(tree, at, shape) if emits(scene, shape) else None
        if shape.material is None:
            return tree.added(tree.node("BsdfTransparent", {"Color": _WHITE}), shines) if through else shines
        material, place = scene.materials[shape.material], ("materials", shape.material)
        closure = self._surface(tree, material, place)
        closure = tree.added(closure, shines) or closure
        return self._masked(tree, material, place, closure)

    def _emission(self, tree: NodeTree, at: At, shape: AnyShape) -> Socket:
        color = self._textures.color(tree, *radiance_of(self._target.scene, at, shape))
        return tree.node("Emission", {"Color": color, "Strength": tree.math("SUBTRACT", 1.0, tree.behind())})

    def _masked(self, tree: NodeTree, material: Material, at: At, closure: Socket) -> Socket:
        if not material.masked:
            return closure
        opacity = self._textures.number(tree, material.opacity, (*at, "opacity"))
        if material.opacity_cutoff is not None:
            opacity = tree.math("SUBTRACT", 1.0, tree.math("LESS_THAN", opacity, material.opacity_cutoff))
        return tree.mixed(opacity, tree.node("BsdfTransparent", {"Color": _WHITE}), closure)

    def _normal(self, tree: NodeTree, material: Any, at: At) -> Inputs:
        """The input of a closure for the normal of a normal map or bump map."""
        if material.normal_map is not None:
            if material.bump_map is not None:
                self._target.leave_out("the bump map beside a normal map", *at, "bump_map")
            sentence = "the balance of normal maps, with which Cycles' images are darker where normals lean"
            self._target.leave_out(sentence, *at, "normal_map")
            return {"Normal": self._textures.normal_map(tree, material.normal_map, (*at, "normal_map"))}
        if material.bump_map is not None:
            return {"Normal": self._textures.bump_map(tree, material.bump_map, (*at, "bump_map"))}
        return {}

    def _surface(self, tree: NodeTree, material: Material, at: At) -> Socket:
        material = without_measured(self._target, material, at, "diffuse")
        tell_of_film(self._target, material, at)
        if isinstance(material, Mix):
            first, second = (
                self._surface(tree, self._target.scene.materials[name], ("materials", name))
                for name in material.materials
            )
            return tree.mixed(self._textures.number(tree, material.weight, (*at, "weight")), first, second)
        if isinstance(material, Hair):
            self._target.leave_out("hair, which is written as diffuse", *at)
            color = self._textures.color(tree, hair_color(material), (*at, "reflectance"))
            return tree.node("BsdfDiffuse", {"Color": color, "Roughness": 0.0})
        closure = self._both_sides(tree, material, at)
        if getattr(material, "two_sided", True):
            return closure
        return tree.mixed(tree.behind(), closure, tree.node("BsdfDiffuse", {"Color": _BLACK}))

    def _both_sides(self, tree: NodeTree, material: Any, at: At) -> Socket:
        bent = self._normal(tree, material, at)

        def color(key: str) -> Any:
            return self._textures.color(tree, getattr(material, key), (*at, key))

        if isinstance(material, Lambert):
            return tree.node("BsdfDiffuse", {"Color": color("reflectance"), "Roughness": 0.0, **bent})
        if isinstance(material, OrenNayar):
            rough = self._rough_diffuse(tree, material.roughness, (*at, "roughness"))
            plain = {"IOR": 1.0, "Roughness": 1.0, "Diffuse Roughness": rough}
            return tree.node("BsdfPrincipled", {"Base Color": color("reflectance"), **plain, **bent})
        if isinstance(material, Mirror):
            return tree.node("BsdfAnisotropic", {"Color": color("reflectance"), "Roughness": 0.0, **bent})
        if isinstance(material, Conductor):
            return self._conductor(tree, material, at, bent)
        if isinstance(material, Dielectric):
            if material.priority is not None:
                self._target.leave_out("priorities, where closed shapes overlap", *at, "priority")
            return self._glass(tree, material, at, material.ior / material.exterior_ior, bent)
        if isinstance(material, Subsurface):
            if material.priority is not None:
                self._target.leave_out("priorities, where closed shapes overlap", *at, "priority")
            if material.ior is None:
                return tree.node("BsdfTranslucent", {"Color": _WHITE, **bent})
            return self._glass(tree, material, at, material.ior, bent)
        return self._principled(tree, material, at, bent)

    def _facets(self, material: Any, at: At) -> str:
        """Blender's name for the distribution of microfacets."""
        if getattr(material, "microfacets", "ggx") == "beckmann":
            if is_rough(material.roughness) and getattr(material, "multiple_scattering", True):
                self._target.leave_out(ONCE, *at)
            return "BECKMANN"
        return "MULTI_GGX" if getattr(material, "multiple_scattering", True) else "GGX"

    def _roughness(self, tree: NodeTree, material: Any, at: At) -> Any:
        if is_brushed(material):
            self._target.leave_out("anisotropy", *at, "anisotropy")
        return self._textures.number(tree, material.roughness, (*at, "roughness"))

    def _rough_diffuse(self, tree: NodeTree, roughness: Any, at: At) -> Any:
        if roughness != 0.0:
            self._target.leave_out("the balance of rough diffuse surfaces, which are up to 2 % darker", *at)
        return self._textures.number(tree, roughness, at)

    def _conductor(self, tree: NodeTree, material: Conductor, at: At, bent: Inputs) -> Socket:
        rough = {"Roughness": self._roughness(tree, material, at), **bent}
        facets = self._facets(material, at)
        if facets == "MULTI_GGX" and is_rough(material.roughness):
            self._target.leave_out("the balance of rough metals, whose edges are up to 5 % darker", *at)
        if material.index is not None:
            index = dict(zip(("IOR", "Extinction"), material.index, strict=True))
            return tree.node("BsdfMetallic", {**index, **rough}, fresnel_type="PHYSICAL_CONDUCTOR", distribution=facets)
        colors = {"Base Color": self._textures.color(tree, material.f0, (*at, "f0")), "Edge Tint": _WHITE}
        return tree.node("BsdfMetallic", {**colors, **rough}, fresnel_type="F82", distribution=facets)

    def _glass(self, tree: NodeTree, material: Any, at: At, index: float, bent: Inputs) -> Socket:
        if getattr(material, "thin", False):
            if is_rough(material.roughness):
                self._target.leave_out("the roughness of thin glass", *at)
            return self._thin(tree, index, bent)
        if index == 1.0:
            return tree.node("BsdfTransparent", {"Color": _WHITE})
        rough = self._roughness(tree, material, at)
        inputs = {"Color": _WHITE, "Roughness": rough, "IOR": index, **bent}
        return tree.node("BsdfGlass", inputs, distribution=self._facets(material, at))

    def _thin(self, tree: NodeTree, index: float, bent: Inputs) -> Socket:
        """Both sides of a wall: of what the first does not reflect, the reflections in between return a part."""
        # Blender takes the wall for the inside of a solid where it is met from its back
        turned = tree.math("POWER", index, tree.math("MULTIPLY_ADD", tree.behind(), -2.0, 1.0))
        once = tree.node("Fresnel", {"IOR": turned, **bent})
        both = tree.math("DIVIDE", tree.math("MULTIPLY", once, 2.0), tree.math("ADD", once, 1.0))
        mirror = tree.node("BsdfAnisotropic", {"Color": _WHITE, "Roughness": 0.0, **bent})
        return tree.mixed(both, tree.node("BsdfTransparent", {"Color": _WHITE}), mirror)

    # --- the principled model

    def _principled(self, tree: NodeTree, material: Principled, at: At, bent: Inputs) -> Socket:
        textures = self._textures

        def number(key: str, curve: Curve | None = None) -> Any:
            return textures.number(tree, getattr(material, key), (*at, key), curve)

        def color(key: str, factor: float = 1.0) -> Any:
            return textures.color(tree, getattr(material, key), (*at, key), factor)

        share = material.diffuse_transmission
        if share != 0.0:
            self._target.leave_out("gloss and metal of sheets with diffuse transmission", *at, "diffuse_transmission")
            kept = tree.node("BsdfDiffuse", {"Color": color("base_color", 1.0 - share), **bent})
            passed = share * np.array(material.diffuse_transmission_color)
            sheet = tree.added(kept, tree.node("BsdfTranslucent", {"Color": passed, **bent}))
            assert sheet is not None
            return sheet
        if material.thin and material.transmission != 0.0:
            self._target.leave_out("thin walls of principled, which are solid", *at, "thin")
        if material.microfacets != "ggx":
            self._target.leave_out("the distribution of microfacets, for which there is GGX", *at, "microfacets")
        inputs: Inputs = {
            "Roughness": self._roughness(tree, material, at),
            "IOR": 1.0 if material.specular == 0.0 and material.transmission == 0.0 else material.ior,
            "Specular IOR Level": number("specular", lambda x: 0.5 * x),
            "Diffuse Roughness": self._rough_diffuse(tree, material.diffuse_roughness, (*at, "diffuse_roughness")),
            "Coat Weight": number("coat"),
            "Coat Roughness": number("coat_roughness"),
            "Coat IOR": _COAT_INDEX,
            **bent,
        }
        if material.sheen_color != _BLACK:
            self._target.leave_out("the balance of sheen, which is another model", *at, "sheen_color")
            sheen = {"Sheen Weight": 1.0, "Sheen Roughness": number("sheen_roughness")}
            inputs |= {**sheen, "Sheen Tint": color("sheen_color")}

        def part(**more: Any) -> Socket:
            named = {name.replace("_", " "): each for name, each in more.items()}
            return tree.node("BsdfPrincipled", {**inputs, **named}, distribution="MULTI_GGX")

        def opaque() -> Socket:
            return part(Base_Color=color("base_color"), Specular_Tint=color("specular_color"))

        def glass() -> Socket:
            # Cycles colours what passes by the square root
            squared = textures.color(tree, material.base_color, (*at, "base_color"), curve=np.square)
            return part(Base_Color=squared, Specular_Tint=color("specular_color"), Transmission_Weight=1.0)

        def metal() -> Socket:
            return part(Base_Color=color("base_color"), Metallic=1.0)

        def dielectric() -> Socket:
            return self._between(tree, material.transmission, (*at, "transmission"), opaque, glass)

        return self._between(tree, material.metallic, (*at, "metallic"), dielectric, metal)

    def _between(
        self, tree: NodeTree, amount: Any, at: At, first: Callable[[], Socket], second: Callable[[], Socket]
    ) -> Socket:
        """A mixture of two closures, or one of them."""
        if not isinstance(amount, Texture) and amount in (0.0, 1.0):
            return second() if amount else first()
        return tree.mixed(self._textures.number(tree, amount, at), first(), second())


def volume(tree: NodeTree, inside: Inside) -> Socket | None:
    """A homogeneous medium; None for one that does nothing."""
    made: Socket | None = None
    for kind, coefficients in (("VolumeAbsorption", inside.absorption), ("VolumeScatter", inside.scattering)):
        most = max(coefficients)
        if most == 0.0:
            continue
        shares = np.array(coefficients) / most
        # An absorbing medium has the colour that is left
        inputs: Inputs = {
            "Color": 1.0 - shares if kind == "VolumeAbsorption" else shares,
            "Density": most,
        }
        if kind == "VolumeScatter":
            inputs["Anisotropy"] = inside.g
        made = tree.added(made, tree.node(kind, inputs))
    return made
