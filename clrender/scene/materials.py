"""What surfaces are made of: the tables `[materials.NAME]` of a scene file, validated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, TypeAlias

from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    WithJsonSchema,
    model_validator,
)

from clrender.meshes.data import COORDINATE_LIMIT
from clrender.scene.frozen import FrozenDict
from clrender.scene.metals import METALS, metal_spectra
from clrender.scene.spectra import Dispersion, ExtinctionColor, IndexColor, SpectralColor
from clrender.scene.textures import (
    BumpMap,
    ColorOrTexture,
    MaterialTexture,
    NormalMap,
    ParameterOrTexture,
    PictureShare,
    ReflectanceOrTexture,
    ShareOrTexture,
    ThicknessOrTexture,
    textures_of,
)
from clrender.scene.values import (
    NUMBER_OR_TRIPLE,
    POWER_LIMIT,
    Extinction,
    FileName,
    Finite,
    Flag,
    Index,
    Length,
    Name,
    Part,
    Power,
    Reflectance,
    Share,
    Termination,
    Vector,
    fault,
    number_as_triple,
)

__all__ = [
    "BASE_COLORS",
    "MATERIAL_TYPES",
    "MIX_DEPTH",
    "Conductor",
    "Dielectric",
    "Hair",
    "Iridescent",
    "Lambert",
    "Material",
    "Measured",
    "Mirror",
    "Mix",
    "OrenNayar",
    "PluginMaterial",
    "Principled",
    "Subsurface",
    "material_parts",
    "material_textures",
    "material_without_color",
    "passes_light",
]

MIX_DEPTH: Final = 16
"""Deepest nesting of mixtures."""

SMOOTH_BELOW: Final = 1e-3
"""Below this alpha a lobe is a delta distribution: single precision cannot represent narrower lobes."""
MOST_G: Final = 0.95
"""Largest magnitude of the mean cosine for which `clrender.flatten.subsurface` inverts albedos."""
BASE_COLORS: Final = ("reflectance", "base_color", "f0")
"""Keys of a material's main colour."""
_Degrees = Annotated[Finite, Field(ge=-360.0, le=360.0)]
_AttenuationColor: TypeAlias = Annotated[
    Reflectance | None,
    Field(description="transmittance at `attenuation_distance`, above 0 (default: [1, 1, 1])"),
]
_AttenuationDistance: TypeAlias = Annotated[
    Length | None, Field(description="metres, in the medium behind the front side")
]
_PathLength = Annotated[Finite, Field(ge=1e-12, le=COORDINATE_LIMIT)]
_Radius: TypeAlias = Annotated[
    tuple[_PathLength, _PathLength, _PathLength], BeforeValidator(number_as_triple), WithJsonSchema(NUMBER_OR_TRIPLE)
]
_NO_INSIDE: Final = "cannot be given beside thin: such a wall has no inside; leave it out"
if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    _Metal: TypeAlias = str
else:
    _Metal = Literal[tuple(METALS)]


class _Surface(Part):
    """What every material has."""

    termination: Termination = Field(
        None,
        validation_alias=AliasChoices("termination", "absorption"),
        description="for the roulette `constant`: probability that a path ends at a hit",
    )
    opacity: PictureShare = Field(
        1.0, description="fraction of light that interacts with the surface; in an image often its `channel` a"
    )
    opacity_cutoff: Share | None = Field(
        None, description="threshold: the surface is opaque where the opacity is at least this, and absent elsewhere"
    )

    @model_validator(mode="after")
    def _lets_through(self) -> _Surface:
        if self.opacity_cutoff is not None and self.opacity == 1.0:
            sentence = "does nothing without opacity; give that a number below 1 or a texture, or leave this out"
            raise fault("material", sentence, "opacity_cutoff")
        if self.opacity_cutoff == 0.0:
            raise fault(
                "material", "is 0, which leaves no hole; give a number above it, or leave it out", "opacity_cutoff"
            )
        if self.masked and self.solid:
            sentence = "cannot be given to what has an inside: light would get there through no boundary"
            cure = "make it thin, or leave this out" if "thin" in type(self).model_fields else "leave it out"
            raise fault("material", f"{sentence}; {cure}", "opacity")
        return self

    @property
    def solid(self) -> bool:
        """Whether light passes through it into a medium."""
        return False

    @property
    def masked(self) -> bool:
        """Whether light passes the surface unaffected, at least at some points."""
        return not isinstance(self.opacity, float) or self.opacity < (self.opacity_cutoff or 1.0)


class _Bumpy(_Surface):
    """What every material has that is not made of others."""

    normal_map: NormalMap | None = None
    bump_map: BumpMap | None = None


class _Opaque(_Bumpy):
    """What every material has that is seen from both sides."""

    two_sided: Flag = Field(True, description="false: the back side is black")


class Lambert(_Opaque):
    """Ideal diffuse reflection."""

    type: Literal["lambert"]
    reflectance: ReflectanceOrTexture


class Mirror(_Opaque):
    """Ideal specular reflection."""

    type: Literal["mirror"]
    reflectance: ReflectanceOrTexture = (1.0, 1.0, 1.0)


_Distribution: TypeAlias = Literal["ggx", "beckmann"]


class _Microfacets(Part):
    """What metals and glass have for the sake of other renderers."""

    microfacets: _Distribution = Field("ggx", description="distribution of the microfacet normals")
    multiple_scattering: Flag = Field(
        True,
        description="false: single scattering only, so rough surfaces lose energy, as in most other renderers",
    )


class _Refracting(Part):
    """What a material with an index of refraction has, which may depend on the wavelength."""

    dispersion: Dispersion | None = Field(None, description="index of refraction by wavelength (`spectral`)")

    if TYPE_CHECKING:
        ior: float

    @model_validator(mode="before")
    @classmethod
    def _has_an_index(cls, given: Any) -> Any:
        """The keys with `ior`, where `dispersion` says that."""
        said = given.get("dispersion") if isinstance(given, Mapping) else None
        if not said or "ior" in given or (isinstance(said, Mapping) and list(said) == ["abbe"]):
            return given
        try:
            dispersion = Dispersion.model_validate(said)
        except ValidationError:
            return {**given, "ior": 1.5}  # the key itself is refused in its place
        return given if dispersion.abbe is not None else {**given, "ior": float(dispersion.indices(1.0))}

    @model_validator(mode="after")
    def _has_one_index(self) -> _Refracting:
        if self.dispersion is None or self.dispersion.abbe is not None:
            return self
        said = float(self.dispersion.indices(1.0))
        if abs(self.ior - said) > 1e-9:
            raise fault("material", f"is {self.ior:g}, but its dispersion says {said:.6g}; leave it out", "ior")
        return self

    @property
    def derived_keys(self) -> frozenset[str]:
        """Keys whose values follow from others, and cannot be changed alone."""
        said = self.dispersion is not None and self.dispersion.abbe is None
        return frozenset({"ior"}) if said else frozenset()

    @property
    def spectral_ior(self) -> float:
        """`ior`, with its values by wavelength if there is a dispersion."""
        return self.ior if self.dispersion is None else self.dispersion.indices(self.ior)


class Iridescent(Part):
    """What a material has that may lie below a thin film, as of oil, oxide or soap (Belcour and Barla 2017)."""

    iridescence: ShareOrTexture = Field(0.0, description="share of the surface that has a thin film, which iridesces")
    iridescence_ior: Annotated[Finite, Field(ge=1.0, le=5.0)] = Field(
        1.3, description="index of refraction of the film"
    )
    iridescence_thickness: ThicknessOrTexture = Field(
        400.0, description="thickness of the film, nanometres; or an image with the `range` that it stands for"
    )

    @model_validator(mode="after")
    def _has_a_film(self) -> Iridescent:
        if self.iridescence == 0.0:
            for key in ("iridescence_ior", "iridescence_thickness"):
                if key in self.model_fields_set:
                    sentence = "does nothing without iridescence; give that the share of the surface with the film"
                    raise fault("material", f"{sentence}, up to 1, or leave this out", key)
        return self

    @property
    def filmed(self) -> bool:
        """Whether there is a film, at least at some points."""
        return self.iridescence != 0.0 and self.iridescence_thickness != 0.0


IRIDESCENCE_KEYS: Final = frozenset({"iridescence", "iridescence_ior", "iridescence_thickness"})
"""Keys of `Iridescent`, which are younger than others."""


def _ior_by_dispersion(schema: dict[str, Any]) -> None:
    """Say in a JSON Schema that ``ior`` is needed only where no dispersion says it."""
    schema["required"] = [key for key in schema["required"] if key != "ior"]


class Dielectric(Iridescent, _Bumpy, _Microfacets, _Refracting):
    """Smooth or rough interface between transparent media: `ior` behind the front side, `exterior_ior` in front of it.

    With a `priority`, it is instead the medium inside closed shapes: where they overlap, the highest priority applies.
    """

    late_keys: ClassVar[frozenset[str]] = frozenset({"dispersion"}) | IRIDESCENCE_KEYS
    model_config = ConfigDict(json_schema_extra=_ior_by_dispersion)

    type: Literal["dielectric"]
    ior: Index = Field(description="index of refraction; with a `dispersion` that says it, not needed")
    exterior_ior: Index = 1.0
    roughness: ShareOrTexture = Field(0.0, description="microfacet alpha is its square; 0: smooth")
    thin: Flag = Field(False, description="thin wall: both interfaces at zero thickness, without refraction")
    priority: Annotated[int, Strict(), Field(ge=0, le=2**31 - 1)] | None = Field(
        None, description="makes it the medium inside closed shapes; where they overlap, the highest number applies"
    )
    attenuation_color: _AttenuationColor = None
    attenuation_distance: _AttenuationDistance = None

    @model_validator(mode="after")
    def _is_a_medium(self) -> Dielectric:
        if self.thin and self.priority is not None:
            raise fault("material", _NO_INSIDE, "priority")
        if self.priority is not None and "exterior_ior" in self.model_fields_set:
            sentence = "cannot be given beside priority: the volume that is outside has its own index; leave it out"
            raise fault("material", sentence, "exterior_ior")
        _check_attenuation(self)
        return self

    @property
    def solid(self) -> bool:
        """Whether light passes through it into a medium."""
        return not self.thin

    @property
    def rough(self) -> bool:
        """Whether it is rough, rather than a delta distribution, at least at some points."""
        return not isinstance(self.roughness, float) or self.roughness * self.roughness >= SMOOTH_BELOW


class OrenNayar(_Opaque):
    """Energy-preserving rough diffuse reflection (EON: Portsmouth, Kutz and Hill 2025)."""

    type: Literal["oren_nayar"]
    reflectance: ReflectanceOrTexture
    roughness: ShareOrTexture = Field(0.5, description="0: Lambertian; 1: maximum")


class Conductor(Iridescent, _Opaque, _Microfacets):
    """Smooth or rough metal: a measured one by name, by `eta` and `k`, or by its colour `f0`."""

    late_keys: ClassVar[frozenset[str]] = IRIDESCENCE_KEYS

    type: Literal["conductor"]
    metal: _Metal | None = None
    eta: IndexColor | None = Field(None, description="real part of the refractive index")
    k: ExtinctionColor | None = Field(None, description="imaginary part of the refractive index")
    f0: ReflectanceOrTexture | None = Field(
        None, description="reflectance at normal incidence, for Schlick's Fresnel term"
    )
    roughness: ShareOrTexture = Field(0.2, description="microfacet alpha is its square; 0: smooth")
    anisotropy: ShareOrTexture = Field(0.0, description="additional roughness along the direction of anisotropy")
    anisotropy_rotation: _Degrees = Field(
        0.0, description="rotation of that direction, degrees, from the direction around the y axis"
    )

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
        """Real and imaginary part of the index of refraction; None if it has a colour instead."""
        if self.metal is not None:
            return METALS[self.metal]
        return (self.eta, self.k) if self.eta is not None and self.k is not None else None

    @property
    def spectral_index(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The same at the lines of tables of spectra, if that is known, each (95,) float64."""
        if self.metal is not None:
            return metal_spectra(self.metal)
        eta, k = self.eta, self.k
        return (eta.values, k.values) if isinstance(eta, SpectralColor) and isinstance(k, SpectralColor) else None


class Principled(Iridescent, _Opaque, _Refracting):
    """Metal, plastic, glass, cloth and blends of them: the metallic-roughness model of glTF 2.0 with its extensions."""

    late_keys: ClassVar[frozenset[str]] = IRIDESCENCE_KEYS | frozenset(
        {"diffuse_transmission", "diffuse_transmission_color", "microfacets", "dispersion"}
    )

    type: Literal["principled"]
    base_color: ReflectanceOrTexture = (1.0, 1.0, 1.0)
    metallic: ShareOrTexture = 0.0
    roughness: ShareOrTexture = Field(0.5, description="microfacet alpha is its square")
    microfacets: _Distribution = Field(
        "ggx", description="distribution of the microfacet normals; `beckmann`: without transmission, coat and sheen"
    )
    ior: Annotated[Index, Field(ge=1.0)] = 1.5
    specular: ShareOrTexture = Field(1.0, description="strength of the dielectric reflection")
    specular_color: ReflectanceOrTexture = Field(
        (1.0, 1.0, 1.0), description="colour of the dielectric reflection at normal incidence"
    )
    transmission: ShareOrTexture = Field(
        0.0, description="fraction of the dielectric part that transmits light, tinted by base_color"
    )
    thin: Flag = Field(False, description="transmission through a thin wall, without refraction")
    diffuse_transmission: Share = Field(
        0.0, description="fraction of the diffuse light that leaves on the other side, as through a leaf or paper"
    )
    diffuse_transmission_color: Reflectance = Field((1.0, 1.0, 1.0), description="colour of that light")
    diffuse_roughness: ShareOrTexture = Field(0.0, description="0: Lambertian; 1: maximum")
    coat: ShareOrTexture = Field(0.0, description="strength of the clear coat")
    coat_roughness: ShareOrTexture = 0.0
    sheen_color: ReflectanceOrTexture = (0.0, 0.0, 0.0)
    sheen_roughness: ShareOrTexture = 0.3
    anisotropy: ShareOrTexture = Field(0.0, description="additional roughness along the direction of anisotropy")
    anisotropy_rotation: _Degrees = Field(
        0.0, description="rotation of that direction, degrees, from the direction around the y axis"
    )
    attenuation_color: _AttenuationColor = None
    attenuation_distance: _AttenuationDistance = None
    emission: ColorOrTexture = Field(
        (0.0, 0.0, 0.0), description="emitted radiance of shapes with this material, multiplied by `emission_strength`"
    )
    emission_strength: Power = 1.0

    @model_validator(mode="after")
    def _absorbs_inside(self) -> Principled:
        _check_attenuation(self)
        if self.attenuation_color is not None and self.transmission == 0.0:
            sentence = "does nothing without transmission; give it some, or leave both out"
            raise fault("material", sentence, "attenuation_color")
        return self

    @model_validator(mode="after")
    def _has_facets_of_one_kind(self) -> Principled:
        black = (0.0, 0.0, 0.0)
        if self.microfacets != "ggx":
            for key in ("transmission", "coat", "sheen_color"):
                if getattr(self, key) not in (0.0, black):
                    sentence = f"is given beside {key}, which knows GGX only; leave one out"
                    raise fault("material", sentence, "microfacets")
        return self

    @model_validator(mode="after")
    def _has_two_sides(self) -> Principled:
        if self.diffuse_transmission > 0.0:
            if self.solid:
                sentence = (
                    "is for sheets, but light is transmitted into a solid here; give thin = true, or leave it out"
                )
                raise fault("material", sentence, "diffuse_transmission")
            if not self.two_sided:
                raise fault("material", "needs a surface with two sides; leave two_sided out", "diffuse_transmission")
        return self

    @property
    def solid(self) -> bool:
        """Whether light passes through it into a medium."""
        return self.transmission != 0.0 and not self.thin

    @property
    def shines(self) -> bool:
        """Whether it emits light; a texture counts as emission."""
        return self.emission_strength > 0.0 and self.emission != (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _is_not_too_bright(self) -> Principled:
        brightest = self.emission_strength * (max(self.emission) if isinstance(self.emission, tuple) else 0.0)
        if brightest > POWER_LIMIT:
            sentence = f"makes a radiance of {brightest:g}; at most {POWER_LIMIT:g} is known"
            raise fault("material", sentence, "emission_strength")
        return self


def _check_attenuation(material: Dielectric | Principled) -> None:
    """Check that an absorbing material has an inside, and both numbers."""
    color, distance = material.attenuation_color, material.attenuation_distance
    for key, value in (("attenuation_color", color), ("attenuation_distance", distance)):
        if material.thin and value is not None:
            raise fault("material", _NO_INSIDE, key)
    if (color is None) != (distance is None):
        one, other = ("color", "distance") if distance is None else ("distance", "color")
        sentence = f"needs attenuation_{other} beside it: the share of light that is left after that distance"
        raise fault("material", sentence, f"attenuation_{one}")
    for i, share in enumerate(color or ()):
        if share == 0.0:
            sentence = "is 0, which no thickness of a medium does; give a small number such as 0.001"
            raise fault("material", sentence, "attenuation_color", i)


class Subsurface(_Bumpy):
    """Subsurface scattering in closed shapes, such as skin, wax and marble, computed by random walks.

    Without an `ior`, the surface transmits all light with a cosine distribution.
    """

    type: Literal["subsurface"]
    albedo: Reflectance = Field(description="diffuse albedo of a thick, flat slab")
    radius: _Radius = Field(description="mean free path, metres")
    g: Annotated[Finite, Field(ge=-MOST_G, le=MOST_G)] = Field(
        0.0,
        description="anisotropy of the Henyey-Greenstein phase function: above 0 forward, below 0 backward scattering",
    )
    ior: Annotated[Finite, Field(ge=1.01, le=1000.0)] | None = Field(
        None,
        description="refractive index of a dielectric surface; without it the surface neither reflects nor refracts",
    )
    roughness: ShareOrTexture = Field(
        0.0, description="roughness of the dielectric surface: GGX alpha is its square; 0: smooth"
    )
    priority: Annotated[int, Strict(), Field(ge=0, le=2**31 - 1)] | None = Field(
        None, description="where closed shapes overlap, the highest number applies"
    )

    @model_validator(mode="after")
    def _reflects(self) -> Subsurface:
        if self.ior is None and "roughness" in self.model_fields_set:
            sentence = "is given without ior; name the index of the surface that is rough, or leave roughness out"
            raise fault("material", sentence, "roughness")
        return self

    @property
    def solid(self) -> bool:
        """It always has an inside."""
        return True

    @property
    def rough(self) -> bool:
        """Whether its surface is a rough dielectric, at least at some points."""
        if self.ior is None:
            return False
        return not isinstance(self.roughness, float) or self.roughness * self.roughness >= SMOOTH_BELOW


class Hair(_Surface):
    """Fibres of hair or fur, for curves: rough dielectric cylinders with absorption (Chiang et al. 2016)."""

    type: Literal["hair"]
    reflectance: ReflectanceOrTexture | None = Field(
        None, description="colour of many strands, seen from afar; default: by melanin"
    )
    absorption_coefficient: tuple[Extinction, Extinction, Extinction] | None = Field(
        None, description="absorption along a radius of the fibre, instead"
    )
    eumelanin: Annotated[Finite, Field(ge=0.0, le=100.0)] | None = Field(
        None, description="concentration of black and brown pigment (default: 1.3, or 0 beside pheomelanin)"
    )
    pheomelanin: Annotated[Finite, Field(ge=0.0, le=100.0)] | None = Field(
        None, description="concentration of red and yellow pigment"
    )
    ior: Annotated[Finite, Field(ge=1.05, le=3.0)] = 1.55
    roughness: Share = Field(0.3, description="along the fibre")
    azimuthal_roughness: Share = Field(0.3, description="around the fibre")
    tilt_degrees: Annotated[Finite, Field(ge=-20.0, le=20.0)] = Field(2.0, description="of its scales from the fibre")

    @model_validator(mode="after")
    def _has_one_color(self) -> Hair:
        if self.reflectance is not None and self.absorption_coefficient is not None:
            raise fault("material", "is given beside reflectance; keep one of them", "absorption_coefficient")
        other = "reflectance" if self.reflectance is not None else "absorption_coefficient"
        for key in ("eumelanin", "pheomelanin"):
            if getattr(self, key) is not None and getattr(self, other) is not None:
                raise fault("material", f"is given beside {other}; keep one of them", key)
        return self

    @property
    def absorption_of(self) -> Vector | None:
        """Absorption along a radius, by melanin or as it is given; None: the reflectance says it.

        The coefficients of both pigments are those of d'Eon et al. 2011.
        """
        if self.absorption_coefficient is not None or self.reflectance is not None:
            return self.absorption_coefficient
        dark = self.eumelanin if self.eumelanin is not None else (1.3 if self.pheomelanin is None else 0.0)
        red = self.pheomelanin or 0.0
        x, y, z = (dark * a + red * b for a, b in zip((0.419, 0.697, 1.37), (0.187, 0.4, 1.05), strict=True))
        return (x, y, z)


class Measured(_Opaque):
    """Reflectance that was measured: a file of the RGL database (Dupuy and Jakob 2018) or of MERL (Matusik 2003)."""

    type: Literal["measured"]
    file: FileName = Field(description="name of a file `.bsdf` (RGL, of spectra or of RGB) or `.binary` (MERL)")
    anisotropy_rotation: _Degrees = Field(0.0, description="rotation of the sample's x axis, degrees, about the normal")


class PluginMaterial(_Opaque):
    """BSDF of a plugin: a file in OpenCL C, which is given by `--plugin` or in Python, never by a scene."""

    type: Literal["plugin"]
    plugin: Name = Field(description="name of the plugin")
    parameters: Annotated[dict[Name, ParameterOrTexture], Field(max_length=16), AfterValidator(FrozenDict)] = Field(
        default_factory=FrozenDict,
        description="numbers, colours and textures by the names that the plugin has for them (default: the plugin's)",
    )
    anisotropy_rotation: _Degrees = Field(
        0.0, description="rotation of the x axis, degrees, if the plugin needs tangents"
    )


class Mix(_Surface):
    """Mixture of two materials; at each point one of them is selected at random."""

    type: Literal["mix"]
    materials: tuple[Name, Name] = Field(description="names of two materials, which may also be mixtures")
    weight: ShareOrTexture = Field(0.5, description="weight of the second material")


MATERIAL_TYPES: Final[Mapping[str, type[Part]]] = {
    "lambert": Lambert,
    "mirror": Mirror,
    "dielectric": Dielectric,
    "oren_nayar": OrenNayar,
    "conductor": Conductor,
    "principled": Principled,
    "subsurface": Subsurface,
    "hair": Hair,
    "measured": Measured,
    "plugin": PluginMaterial,
    "mix": Mix,
}
Material: TypeAlias = Annotated[
    Lambert
    | Mirror
    | Dielectric
    | OrenNayar
    | Conductor
    | Principled
    | Subsurface
    | Hair
    | Measured
    | PluginMaterial
    | Mix,
    Field(discriminator="type"),
]


def passes_light(materials: Mapping[str, Material], material: Material) -> bool:
    """Whether a material transmits light.

    Parameters
    ----------
    materials : mapping of str to Material
        Materials of a scene, for mixtures.
    material : Material
    """
    if isinstance(material, Mix):
        return any(passes_light(materials, materials[name]) for name in material.materials)
    if isinstance(material, Principled):
        return material.transmission != 0.0 or material.diffuse_transmission > 0.0
    return isinstance(material, Dielectric | Subsurface)


def material_parts(materials: Mapping[str, Material], name: str | None, depth: int = 0) -> Iterator[Material]:
    """The materials that a material mixes, or itself.

    Parameters
    ----------
    materials : mapping of str to Material
        Materials of a scene.
    name : str or None
        Name of one of them. Of none there are none, nor of names that do not exist.
    depth : int
        How deep in mixtures it is; `MIX_DEPTH` is the end.
    """
    material = None if name is None else materials.get(name)
    if isinstance(material, Mix):
        for part in material.materials if depth < MIX_DEPTH else ():
            yield from material_parts(materials, part, depth + 1)
    elif material is not None:
        yield material


def material_textures(materials: Mapping[str, Material], name: str) -> Iterator[tuple[str, MaterialTexture]]:
    """Textures of a material and of those that it mixes, with their keys.

    Parameters
    ----------
    materials : mapping of str to Material
        Materials of a scene.
    name : str
        Name of one of them.
    """
    material = materials[name]
    yield from textures_of(material)
    if isinstance(material, Mix):
        for part in material.materials:
            yield from material_textures(materials, part)


def material_without_color(materials: Mapping[str, Material], name: str) -> str | None:
    """The first of a material and those that it mixes without a base colour; None if all have one.

    Parameters
    ----------
    materials, name
        See `material_textures`.
    """
    material = materials[name]
    if isinstance(material, Mix):
        parts = (material_without_color(materials, part) for part in material.materials)
        return next((part for part in parts if part is not None), None)
    return None if any(getattr(material, key, None) is not None for key in BASE_COLORS) else name
