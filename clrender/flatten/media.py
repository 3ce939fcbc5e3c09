"""Media inside dielectrics, transmissive principled shapes and interiors, numbered by priority."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.flatten.spectral import SpectralPlace
from clrender.flatten.subsurface import single_scattering
from clrender.scene.description import Scene
from clrender.scene.materials import Dielectric, Material, Principled, Subsurface
from clrender.scene.medium import Grids
from clrender.scene.shapes import Shape
from clrender.scene.spectra import DispersiveIndex, SpectralColor
from clrender.scene.values import Vector
from clrender.spectra.lifting import unbounded_spectra

__all__ = ["MATCHED_IOR", "MEDIA_LIMIT", "Media", "Solid", "absorption_coefficients", "scene_media", "solid_of"]

MEDIA_LIMIT: Final = 255
"""Most media of a scene: paths store their numbers in bytes (``kernels/material/interior.h``)."""

MATCHED_IOR: Final = float(np.nextafter(np.float32(1.0), np.float32(2.0)))
"""Index of a medium that does not refract but has a surface; equal indices mean that there is no surface."""

Solid: TypeAlias = tuple[str | None, str | None]
"""Names of a shape's material and interior."""

_BLACK: Final[Vector] = (0.0, 0.0, 0.0)
_MATCHED: Final = Dielectric(type="dielectric", ior=1.0)
"""The surface of a shape that has an interior and no material."""
_COLUMNS: Final = {name: slice(at, at + count) for name, at, count, _ in layout.ROWS["MEDIUM"]}


class _Medium(NamedTuple):
    priority: int | None
    ior: float = 1.0
    absorption: Vector = _BLACK
    scattering: Vector = _BLACK
    g: float = 0.0
    albedo: Vector | None = None  # of a subsurface material
    emission: Vector = _BLACK
    grids: Grids | None = None
    name: str | None = None  # of the medium that has the grids

    @property
    def is_vacuum(self) -> bool:
        """Whether it equals vacuum, apart from its priority."""
        return self[1:] == _Medium(None)[1:]


@dataclass(frozen=True)
class Media:
    """Media of a scene.

    Attributes
    ----------
    rows : (n + 1, 16) float32
        ``MEDIUM_ROW_*`` of ``kernels/types.h``; row 0 is outside of all media. All zero: paths need not track media.
    of_solid : mapping of Solid to int
        Row of each pair that bounds a medium: its material is subsurface, or a dielectric or principled with
        transmission that is not thin.
    no_boundary : frozenset of Solid
        Pairs whose shapes never affect light, so that they are left out unless they emit.
    scatters : bool
        Whether any medium scatters or shines, or there is fog: then paths outside of all shapes are in a medium, too.
    straight : bool
        Whether light passes some surfaces undeflected, so that shadow rays must continue through them.
    subsurface : bool
        Whether there are subsurface materials.
    fog : bool
        Whether the medium outside of all shapes scatters or shines.
    glows : bool
        Whether any medium shines.
    grids : tuple of (str, Grids)
        Grids of media, each with the name of one that has them, in the order of the heads that rows name.
    spectral : tuple of SpectralPlace
        Numbers of `rows` that depend on the wavelength.
    """

    rows: NDArray[np.float32]
    of_solid: Mapping[Solid, int]
    no_boundary: frozenset[Solid]
    scatters: bool
    straight: bool
    subsurface: bool = False
    fog: bool = False
    glows: bool = False
    grids: tuple[tuple[str, Grids], ...] = ()
    spectral: tuple[SpectralPlace, ...] = ()


def solid_of(shape: Shape) -> Solid:
    """A shape's material and interior."""
    return shape.material, shape.interior


def scene_media(scene: Scene) -> Media:
    """Number the media of all shapes in ascending precedence.

    Those without a priority come first, then the others by priority; of equal priorities, the first in the scene has
    precedence. Shapes that agree in priority, index, absorption and scattering share a medium.

    Raises
    ------
    SceneError
        There are more than `MEDIA_LIMIT`.
    """
    shining = {solid_of(shape) for _, shape in scene.all_shapes() if shape.shines}
    solids = _solids(scene)
    media = {solid: _medium(scene, solid, material) for solid, material in solids.items()}
    ranked = _by_priority(media)
    outside = _Medium(None)
    if scene.fog is not None:
        outside = _Medium(None, 1.0, *scene.media[scene.fog].numbers, emission=scene.media[scene.fog].emission)
    # A vacuum is invisible, unless it displaces another medium
    empty = outside.is_vacuum and all(m[2:] == outside[2:] for m in media.values() if m.priority is None)
    dark: set[Solid] = set()
    if empty:
        dark = {
            n for n, m in media.items() if m.priority is None and _bends_nothing(solids[n]) and m[2:] == outside[2:]
        }
    shown = [media[solid] for solid in media if solid in shining]
    while ranked and empty and ranked[0].is_vacuum and ranked[0] not in shown:
        dark |= {solid for solid, medium in media.items() if medium == ranked[0]}
        del ranked[0]
    kept = {solid: medium for solid, medium in media.items() if solid not in dark or solid in shining}
    if outside.is_vacuum and all(medium.priority is None and medium[2:] == outside[2:] for medium in kept.values()):
        return Media(np.zeros((1, 16), np.float32), {}, frozenset(dark), scatters=False, straight=False)
    unranked = list(dict.fromkeys(medium for medium in kept.values() if medium.priority is None))
    numbers = {medium: number for number, medium in enumerate([*unranked, *ranked], 1)}
    if len(numbers) > MEDIA_LIMIT:
        text = f"the interiors of its shapes are {len(numbers)} different media, but paths tell {MEDIA_LIMIT} apart"
        raise SceneError(f"{scene.source}: materials: {text}; let more of them agree in index, absorption and priority")
    # In single precision, as in the kernels. Shadow rays do not pass a surface of index MATCHED_IOR
    indices = [np.float32(1.0), *(np.float32(medium.ior) for medium in numbers if medium.ior != MATCHED_IOR)]
    straight = any(indices.count(np.float32(medium.ior)) > 1 for medium in ranked)
    straight |= any(medium.priority is None and _bends_nothing(solids[solid]) for solid, medium in kept.items())
    of_solid = {solid: numbers[medium] for solid, medium in kept.items()}
    subsurface = any(medium.albedo is not None for medium in numbers)
    glows = any(max(medium.emission) > 0.0 for medium in (outside, *numbers))
    scatters = subsurface or not outside.is_vacuum or glows or any(max(medium.scattering) > 0.0 for medium in numbers)
    grids = {each.grids: each.name for each in numbers if each.grids is not None}
    rows = _rows(outside, numbers, len(unranked), list(grids))
    fog = max(outside.scattering) > 0.0 or max(outside.emission) > 0.0
    named = tuple((name or "", each) for each, name in grids.items())
    spectral = [
        SpectralPlace("media_rows", number, _COLUMNS["IOR"].start, 1, medium.ior.values)
        for medium, number in numbers.items()
        if isinstance(medium.ior, DispersiveIndex)
    ]
    spectral += [place for medium, number in ((outside, 0), *numbers.items()) for place in _spectra(medium, number)]
    return Media(rows, of_solid, frozenset(dark), scatters, straight, subsurface, fog, glows, named, tuple(spectral))


def _spectra(medium: _Medium, number: int) -> Iterator[SpectralPlace]:
    """The numbers of a medium's row that spectra say, or follow from some."""
    absorption, scattering, emission = medium.absorption, medium.scattering, medium.emission
    if isinstance(absorption, SpectralColor) or isinstance(scattering, SpectralColor):
        lost, turned = _values(absorption), _values(scattering)
        for name, values in (("SIGMA", lost), ("EXTINCTION", lost + turned), ("SCATTERING", turned)):
            yield SpectralPlace("media_rows", number, _COLUMNS[name].start, 3, values)
    if isinstance(emission, SpectralColor):
        yield SpectralPlace("media_rows", number, _COLUMNS["EMISSION"].start, 3, emission.values)


def _values(coefficient: Vector) -> NDArray[np.float64]:
    """A coefficient at the lines of tables of spectra, (95,)."""
    if isinstance(coefficient, SpectralColor):
        return coefficient.values
    return unbounded_spectra(np.array(coefficient))


def _solids(scene: Scene) -> dict[Solid, Dielectric | Principled | Subsurface]:
    """Pairs that bound media and their surfaces, in the order of the materials, then of the shapes."""
    places = {name: place for place, name in enumerate(scene.materials)}
    appear = dict.fromkeys(solid_of(shape) for _, shape in scene.all_shapes())
    solids: dict[Solid, Dielectric | Principled | Subsurface] = {}
    for name, interior in sorted(appear, key=lambda solid: -1 if solid[0] is None else places[solid[0]]):
        material = scene.materials[name] if name is not None else _MATCHED if interior is not None else None
        if isinstance(material, Subsurface) or (isinstance(material, Dielectric | Principled) and material.solid):
            solids[name, interior] = material
    return solids


def _rows(
    outside: _Medium, numbers: Mapping[_Medium, int], unranked: int, grids: Sequence[Grids]
) -> NDArray[np.float32]:
    rows = np.zeros((len(numbers) + 1, 16), np.float32)
    for medium, number in ((outside, 0), *numbers.items()):
        extinction = [a + s for a, s in zip(medium.absorption, medium.scattering, strict=True)]
        for name, value in (("IOR", medium.ior), ("SIGMA", medium.absorption), ("EXTINCTION", extinction)):
            rows[number, _COLUMNS[name]] = value
        rows[number, _COLUMNS["SCATTERING"]], rows[number, _COLUMNS["G"]] = medium.scattering, medium.g
        if medium.albedo is not None:
            rows[number, _COLUMNS["ALBEDO"]] = medium.albedo
            rows[number, _COLUMNS["FLAGS"]] = np.uint32(layout.MEDIUM_FLAG_SUBSURFACE).view(np.float32)
        flags = 0
        if medium.grids is not None:
            rows[number, _COLUMNS["GRID"]] = np.uint32(2 * grids.index(medium.grids)).view(np.float32)
            flags |= layout.MEDIUM_FLAG_GRID
        if max(medium.emission) > 0.0:
            rows[number, _COLUMNS["EMISSION"]] = medium.emission
            flags |= layout.MEDIUM_FLAG_GLOWS
        if flags:
            rows[number, _COLUMNS["FLAGS"]] = np.uint32(flags).view(np.float32)
    rows[0, _COLUMNS["UNRANKED"]] = np.uint32(unranked).view(np.float32)
    return rows


def absorption_coefficients(material: Dielectric | Principled) -> Vector:
    """σ = -ln(color) / distance, per metre (Beer's law; glTF, KHR_materials_volume).

    Uses the logarithm of `decimal`, which has the same bits on all machines.
    """
    if material.attenuation_color is None or material.attenuation_distance is None:
        return (0.0, 0.0, 0.0)
    distance = Decimal(material.attenuation_distance)
    red, green, blue = (max(0.0, float(-Decimal(share).ln() / distance)) for share in material.attenuation_color)
    return (red, green, blue)


def _medium(scene: Scene, solid: Solid, material: Dielectric | Principled | Subsurface) -> _Medium:
    if isinstance(material, Subsurface):
        return _below(material)
    priority = material.priority if isinstance(material, Dielectric) else None
    if solid[1] is None:
        return _Medium(priority, material.spectral_ior, absorption_coefficients(material))
    medium = scene.media[solid[1]]
    found = _Medium(priority, material.spectral_ior, *medium.numbers, emission=medium.emission)
    if medium.grids is None or found == _Medium(priority, material.spectral_ior):
        return found
    return found._replace(grids=medium.grids, name=solid[1])


def _below(material: Subsurface) -> _Medium:
    """The medium inside a subsurface material, with its mean free paths, and an albedo that yields its reflectance."""
    extinction = [1.0 / length for length in material.radius]
    shares = [single_scattering(albedo, material.g) for albedo in material.albedo]
    scattering: Vector = (shares[0] * extinction[0], shares[1] * extinction[1], shares[2] * extinction[2])
    red, green, blue = (a - b for a, b in zip(extinction, scattering, strict=True))
    ior = MATCHED_IOR if material.ior is None else material.ior
    return _Medium(material.priority, ior, (red, green, blue), scattering, material.g, material.albedo)


def _by_priority(media: Mapping[Solid, _Medium]) -> list[_Medium]:
    """Unique media with a priority, in ascending precedence."""
    places: dict[_Medium, int] = {}
    for place, medium in enumerate(media.values()):
        places.setdefault(medium, place)
    ranked = [(medium.priority, -place, medium) for medium, place in places.items() if medium.priority is not None]
    return [medium for _, _, medium in sorted(ranked)]


def _bends_nothing(material: Material) -> bool:
    """Whether its surface, without priorities, leaves light unchanged."""
    return isinstance(material, Dielectric) and np.float32(material.ior / material.exterior_ior) == 1.0
