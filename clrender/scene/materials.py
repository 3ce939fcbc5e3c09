"""What surfaces are made of: the tables `[materials.NAME]` of a scene file, validated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, model_validator

from clrender.scene.microfacets import METALS, SMOOTH_BELOW
from clrender.scene.values import (
    Absorption,
    Extinction,
    Finite,
    Flag,
    Index,
    Name,
    Part,
    Reflectance,
    Share,
    Vector,
    fault,
)

__all__ = [
    "MATERIAL_TYPES",
    "MIX_DEPTH",
    "Conductor",
    "Dielectric",
    "Lambert",
    "Material",
    "Mirror",
    "Mix",
    "OrenNayar",
    "Principled",
]

MIX_DEPTH: Final = 16
"""Deepest nesting of mixtures."""

_Degrees = Annotated[Finite, Field(ge=-360.0, le=360.0)]
_METAL: TypeAlias = Literal["Ag", "Au", "Cu"]


class _Surface(Part):
    """What every material has."""

    absorption: Absorption = Field(None, description="probability that the absorption roulette ends a path here")


class _Opaque(_Surface):
    """What every material has that is seen from both sides."""

    two_sided: Flag = Field(True, description="false: black from behind")


class Lambert(_Opaque):
    """Ideal diffuse reflection."""

    type: Literal["lambert"]
    reflectance: Reflectance


class Mirror(_Opaque):
    """Ideal specular reflection."""

    type: Literal["mirror"]
    reflectance: Reflectance = (1.0, 1.0, 1.0)


class Dielectric(_Surface):
    """A boundary between two transparent media, smooth or rough: `ior` behind the front, `exterior_ior` before it."""

    type: Literal["dielectric"]
    ior: Index
    exterior_ior: Index = 1.0
    roughness: Share = Field(0.0, description="its square is alpha of GGX; 0: smooth")
    thin: Flag = Field(False, description="a wall with both boundaries and no thickness, which does not bend light")

    @property
    def rough(self) -> bool:
        """Whether it scatters light, and is no delta."""
        return self.roughness * self.roughness >= SMOOTH_BELOW


class OrenNayar(_Opaque):
    """Diffuse reflection by a rough surface that loses no energy (EON: Portsmouth, Kutz and Hill 2025)."""

    type: Literal["oren_nayar"]
    reflectance: Reflectance
    roughness: Share = Field(0.5, description="0: as `lambert`; 1: roughest")


class Conductor(_Opaque):
    """A metal: a measured one by name, any by `eta` and `k`, or by its colour `f0`; smooth or rough (GGX)."""

    type: Literal["conductor"]
    metal: _METAL | None = None
    eta: tuple[Index, Index, Index] | None = Field(None, description="real part of the index of refraction")
    k: tuple[Extinction, Extinction, Extinction] | None = Field(None, description="and its imaginary part")
    f0: Reflectance | None = Field(None, description="reflectance straight on, of Schlick's Fresnel term")
    roughness: Share = Field(0.2, description="its square is alpha of GGX; 0: smooth")
    anisotropy: Share = Field(0.0, description="how much rougher it is along its direction")
    anisotropy_rotation: _Degrees = Field(0.0, description="degrees, of that direction from the one around the y axis")

    @model_validator(mode="after")
    def _is_a_metal(self) -> Conductor:
        if self.metal is not None and (self.eta is not None or self.k is not None):
            raise fault("material", "is given beside eta or k; a metal has its own", "metal")
        if self.f0 is not None and (self.metal is not None or self.eta is not None or self.k is not None):
            raise fault("material", "is given beside metal, eta or k; give one of them", "f0")
        if self.f0 is None and self.metal is None and (self.eta is None or self.k is None):
            raise fault("material", f"needs a metal ({', '.join(METALS)}), or both eta and k, or f0")
        return self

    @property
    def index(self) -> tuple[Vector, Vector] | None:
        """Real and imaginary part of the index of refraction; None where it has a colour."""
        if self.metal is not None:
            return METALS[self.metal]
        return (self.eta, self.k) if self.eta is not None and self.k is not None else None


class Principled(_Opaque):
    """Metal, plastic, glass, cloth and blends of them: glTF 2.0's metallic-roughness with its extensions."""

    type: Literal["principled"]
    base_color: Reflectance = (1.0, 1.0, 1.0)
    metallic: Share = 0.0
    roughness: Share = Field(0.5, description="its square is alpha of GGX")
    ior: Annotated[Index, Field(ge=1.0)] = 1.5
    specular: Share = Field(1.0, description="strength of the reflection that is not metallic")
    specular_color: Reflectance = Field((1.0, 1.0, 1.0), description="its colour, straight on")
    transmission: Share = Field(0.0, description="share of what is not metal that is clear, tinted by base_color")
    thin: Flag = Field(False, description="what is clear is a wall without thickness, which does not bend light")
    diffuse_roughness: Share = Field(0.0, description="0: as `lambert`; 1: roughest")
    coat: Share = Field(0.0, description="share of the surface under a clear coat")
    coat_roughness: Share = 0.0
    sheen_color: Reflectance = (0.0, 0.0, 0.0)
    sheen_roughness: Share = 0.3
    anisotropy: Share = Field(0.0, description="how much rougher it is along its direction")
    anisotropy_rotation: _Degrees = Field(0.0, description="degrees, of that direction from the one around the y axis")


class Mix(_Surface):
    """Two materials, of which each point shows one or the other."""

    type: Literal["mix"]
    materials: tuple[Name, Name] = Field(description="names of two materials, which may be mixtures, too")
    weight: Share = Field(0.5, description="share of the second")


MATERIAL_TYPES: Final[Mapping[str, type[Part]]] = {
    "lambert": Lambert,
    "mirror": Mirror,
    "dielectric": Dielectric,
    "oren_nayar": OrenNayar,
    "conductor": Conductor,
    "principled": Principled,
    "mix": Mix,
}
Material: TypeAlias = Annotated[
    Lambert | Mirror | Dielectric | OrenNayar | Conductor | Principled | Mix, Field(discriminator="type")
]
