"""Converts a scene's materials to the rows that kernels read: a `Material` each, and further rows where needed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.flatten.hair import hair_color, hair_numbers
from clrender.flatten.measured import MeasuredArrays, is_anisotropic, measured_color
from clrender.flatten.media import MATCHED_IOR, Solid, solid_of
from clrender.flatten.microfacets import fresnel, fresnel_average
from clrender.flatten.plugin_rows import parameter_numbers, plugin_number, used_plugins
from clrender.flatten.spectral import SpectralPlace
from clrender.scene.materials import (
    BASE_COLORS,
    Conductor,
    Dielectric,
    Hair,
    Iridescent,
    Lambert,
    Material,
    Measured,
    Mirror,
    Mix,
    OrenNayar,
    PluginMaterial,
    Principled,
    Subsurface,
    passes_light,
)
from clrender.scene.spectra import DispersiveIndex, SpectralColor
from clrender.scene.textures import Checker, ImageTexture, PluginTexture, Ramp
from clrender.scene.values import Vector

if TYPE_CHECKING:
    from clrender.plugins import Plugin
    from clrender.scene.description import Scene

__all__ = ["MaterialArrays", "flat_materials", "has_row", "material_numbers"]

_Row: TypeAlias = NDArray[np.float32]
_MOST_TERMINATION: Final = 0.999
_UNKNOWN: Final = 0.5
"""Placeholder for a value that a texture gives."""
_COLUMNS: Final = {
    **{name: slice(at, at + count) for name, at, count, _ in layout.ROWS["MATERIAL"]},
    **{name: slice(16 + at, 16 + at + count) for name, at, count, _ in layout.ROWS["LAYER"]},
}


@dataclass(frozen=True)
class MaterialArrays:
    """The materials of a scene as the kernels read them.

    Attributes
    ----------
    materials : (M,) `Material`
        The named materials in order, then the other pairs of material and interior: see `material_numbers`.
    rows : (2 M, 16) float32
        MATERIAL_ROW_* and LAYER_ROW_* of ``kernels/types.h``, one row of zeros if no material needs any.
    by_row : bool
        Whether any material does.
    beckmann : bool
        Whether any needs the albedo tables of Beckmann's distribution.
    turned_glass : bool
        Whether any needs those of anisotropic glass.
    spectral : tuple of SpectralPlace
        Numbers of both arrays that depend on the wavelength.
    """

    materials: NDArray[np.void]
    rows: _Row
    by_row: bool
    beckmann: bool
    turned_glass: bool
    spectral: tuple[SpectralPlace, ...] = ()


def has_row(material: Material) -> bool:
    """Whether a material needs more numbers than a colour and an index."""
    if material.masked or (isinstance(material, Iridescent) and material.filmed):
        return True
    if isinstance(material, Lambert | Mirror):
        return not material.two_sided
    if isinstance(material, Subsurface):
        return material.rough
    return not isinstance(material, Dielectric) or material.rough or material.thin


def material_numbers(scene: Scene) -> dict[Solid, int]:
    """Rows of `MaterialArrays.materials`: one for each material, then for each other pair that shapes name.

    Returns
    -------
    dict of Solid to int
    """
    solids: list[Solid] = [(name, None) for name in scene.materials]
    solids += [solid_of(shape) for shape in scene.plain_shapes]
    return {solid: number for number, solid in enumerate(dict.fromkeys(solids))}


def flat_materials(scene: Scene, medium_of: Mapping[Solid, int], measured: MeasuredArrays) -> MaterialArrays:
    """Arrays of a scene's materials.

    Parameters
    ----------
    scene : Scene
    medium_of : mapping of Solid to int
        See `clrender.flatten.media.Media.of_solid`.
    measured : MeasuredArrays
        Of its measured materials.
    """
    numbered = material_numbers(scene)
    materials = np.zeros(len(numbered), dtype=layout.dtype("Material"))
    by_row = any(has_row(material) for material in scene.materials.values())
    rows = np.zeros((len(scene.materials), 32) if by_row else (1, 16), np.float32)
    numbers = {name: number for number, name in enumerate(scene.materials)}
    spectral: list[SpectralPlace] = []
    for number, (name, material) in enumerate(scene.materials.items()):
        row = materials[number]
        row["medium"] = medium_of.get((name, None), 0)
        color = _color(scene, name, material)
        default = 0.0 if _passes_light(scene, material) else min(1.0 - max(color), _MOST_TERMINATION)
        row["color"] = (*color, default if material.termination is None else material.termination)
        row["kind"] = _kind(material)
        row["ior"] = _index(material)
        if isinstance(material, Principled) and row["medium"] and row["ior"] == 1.0:
            # An index of 1 would mean that there is no boundary (kernels/material/interior.h), but this one reflects
            row["ior"] = MATCHED_IOR
        if by_row:
            _put(rows[number], KIND=_bits(int(row["kind"])), COLOR=color, IOR=float(row["ior"]), FLAGS=_bits(0))
            _put(rows[number], OPACITY=_opacity(material))
            _fill(material, rows[number], numbers)
            if isinstance(material, PluginMaterial):
                _fill_plugin(scene, material, rows[number])
            if isinstance(material, Measured):
                _fill_measured(scene, material, measured, rows[number])
        if has_row(material):
            row["kind"], row["row"] = layout.MATERIAL_BY_ROW, number
        spectral += _spectral(material, number, by_row)
    for solid, number in list(numbered.items())[len(scene.materials) :]:
        row = materials[number]
        if solid[0] is not None:
            materials[number] = materials[numbers[solid[0]]]
            spectral += _spectral(scene.materials[solid[0]], number, False)
            row["medium"] = medium_of.get(solid, 0)
        elif solid[1] is not None:
            row["kind"], row["color"], row["ior"] = layout.MATERIAL_DIELECTRIC, (1.0, 1.0, 1.0, 0.0), 1.0
            row["medium"] = medium_of.get(solid, 0)
        else:
            row["kind"], row["color"], row["ior"] = layout.MATERIAL_LAMBERT, (0.0, 0.0, 0.0, _MOST_TERMINATION), 1.0
    beckmann = by_row and any(_compensates_beckmann(material) for material in scene.materials.values())
    turned_glass = any(_is_anisotropic_glass(material) for material in scene.materials.values())
    return MaterialArrays(materials, rows.reshape(-1, 16), by_row, beckmann, turned_glass, tuple(spectral))


_SPECTRAL: Final = {
    **dict.fromkeys(BASE_COLORS, "COLOR"),
    "specular_color": "SPECULAR_COLOR",
    "sheen_color": "SHEEN_COLOR",
    "diffuse_transmission_color": "DIFFUSE_TRANSMISSION_COLOR",
}
"""Columns of colours that may be spectra."""


def _spectral(material: Material, number: int, by_row: bool) -> list[SpectralPlace]:
    """What depends on the wavelength of a material with this row of `MaterialArrays.materials`, and of its rows."""
    columns: dict[str, tuple[int, NDArray[np.float64]]] = {}
    for key, column in _SPECTRAL.items():
        color = getattr(material, key, None)
        if isinstance(color, SpectralColor):
            columns[column] = 3, color.values
    if isinstance(material, Conductor) and (index := material.spectral_index) is not None:
        pairs = list(zip(index[0].tolist(), index[1].tolist(), strict=True))
        columns |= {"ETA": (3, index[0]), "K": (3, index[1])}
        columns["COLOR"] = 3, np.array([fresnel(1.0, n, k) for n, k in pairs])
        columns["FRESNEL"] = 3, np.array([fresnel_average(n, k) for n, k in pairs])
    if isinstance(material, Dielectric | Principled) and isinstance(ior := material.spectral_ior, DispersiveIndex):
        outside = material.exterior_ior if isinstance(material, Dielectric) else 1.0
        columns["IOR"] = 1, ior.values / outside
    places = [
        SpectralPlace("materials", number, {"COLOR": "color", "IOR": "ior"}[column], count, values)
        for column, (count, values) in columns.items()
        if column in ("COLOR", "IOR")
    ]
    if by_row:
        for column, (count, values) in columns.items():
            at = _COLUMNS[column].start
            places.append(SpectralPlace("material_rows", 2 * number + at // 16, at % 16, count, values))
    return places


def _is_anisotropic_glass(material: Material) -> bool:
    return isinstance(material, Principled) and material.solid and material.anisotropy != 0.0


def _compensates_beckmann(material: Material) -> bool:
    if isinstance(material, Principled):
        return material.microfacets == "beckmann"
    if not isinstance(material, Conductor | Dielectric) or not has_row(material):
        return False
    return material.microfacets == "beckmann" and material.multiple_scattering


_KINDS: Final[dict[type, int]] = {
    Lambert: layout.MATERIAL_LAMBERT,
    Mirror: layout.MATERIAL_MIRROR,
    Dielectric: layout.MATERIAL_DIELECTRIC,
    OrenNayar: layout.MATERIAL_OREN_NAYAR,
    Conductor: layout.MATERIAL_CONDUCTOR,
    Principled: layout.MATERIAL_PRINCIPLED,
    Hair: layout.MATERIAL_HAIR,
    Measured: layout.MATERIAL_MEASURED,
    PluginMaterial: layout.MATERIAL_PLUGIN,
    Mix: layout.MATERIAL_MIX,
}


def _kind(material: Material) -> int:
    if isinstance(material, Subsurface):
        return layout.MATERIAL_SUBSURFACE if material.ior is None else layout.MATERIAL_DIELECTRIC
    return _KINDS[type(material)]


def _bits(number: int) -> np.float32:
    """Bits of an integer, reinterpreted as a float."""
    return np.uint32(number).view(np.float32)


def _put(row: _Row, **of: Any) -> None:
    for name, value in of.items():
        row[_COLUMNS[name]] = _UNKNOWN if isinstance(value, ImageTexture | Checker | Ramp | PluginTexture) else value


def _opacity(material: Material) -> float:
    """The effective opacity, if it is constant; the cutoff, if it is a texture."""
    if not isinstance(material.opacity, float):
        return material.opacity_cutoff or 0.0
    if material.opacity_cutoff is None:
        return material.opacity
    return 0.0 if material.masked else 1.0


def _index(material: Material) -> float:
    """Index of refraction behind the front, relative to that before it."""
    if isinstance(material, Dielectric):
        return material.ior / material.exterior_ior
    if isinstance(material, Subsurface):
        return MATCHED_IOR if material.ior is None else material.ior
    return material.ior if isinstance(material, Principled) else 1.0


def _color(scene: Scene, name: str, material: Material) -> Vector:
    """Approximate reflectance as one colour; for a metal that at normal incidence."""
    if isinstance(material, Dielectric | Subsurface):
        return (1.0, 1.0, 1.0)
    if isinstance(material, Mix):
        first, second = (_color(scene, part, scene.materials[part]) for part in material.materials)
        weight = material.weight if isinstance(material.weight, float) else _UNKNOWN
        red, green, blue = (a + (b - a) * weight for a, b in zip(first, second, strict=True))
        return (red, green, blue)
    if isinstance(material, Conductor):
        if material.index is None:
            return material.f0 if isinstance(material.f0, tuple) else (_UNKNOWN,) * 3
        red, green, blue = (fresnel(1.0, eta, k) for eta, k in zip(*material.index, strict=True))
        return (red, green, blue)
    if isinstance(material, PluginMaterial):
        return _plugin_color(scene, material)
    if isinstance(material, Hair):
        return hair_color(material)
    if isinstance(material, Measured):
        return measured_color(scene, name, material)
    color = material.base_color if isinstance(material, Principled) else material.reflectance
    return color if isinstance(color, tuple) else (_UNKNOWN,) * 3


def _plugin(scene: Scene, material: PluginMaterial) -> Plugin:
    return next(each for each in used_plugins(scene) if each.name == material.plugin)


def _plugin_color(scene: Scene, material: PluginMaterial) -> Vector:
    """The first colour among a plugin's parameters, or grey."""
    numbers, at = parameter_numbers(scene, material), 0
    for each in _plugin(scene, material).parameters:
        if each.type == "color" and each.textured:
            red, green, blue = numbers[at : at + 3]
            return (red, green, blue)
        at += each.count
    return (_UNKNOWN,) * 3


def _passes_light(scene: Scene, material: Material) -> bool:
    """Whether a material transmits light; of a plugin, it says so itself."""
    if isinstance(material, Mix):
        return any(_passes_light(scene, scene.materials[name]) for name in material.materials)
    if isinstance(material, PluginMaterial):
        return _plugin(scene, material).header.transmits
    return passes_light(scene.materials, material)


def _fill_plugin(scene: Scene, material: PluginMaterial, row: _Row) -> None:
    """Write the number of a plugin and its parameters. The other columns keep it from being taken for a mirror."""
    numbers = np.zeros(layout.PLUGIN_NUMBERS, np.float32)
    given = parameter_numbers(scene, material)
    numbers[: len(given)] = given
    half = layout.PLUGIN_NUMBERS // 2
    _put(row, PLUGIN=_bits(plugin_number(scene, material.plugin)), NUMBERS=numbers[:half], MORE_NUMBERS=numbers[half:])
    turned = "tangents" in _plugin(scene, material).header.needs
    turn = (material.anisotropy_rotation / 360.0) % 1.0
    _put(row, ROUGHNESS=1.0, ANISOTROPY=1.0 if turned else 0.0, ROTATION=turn)


def _fill_measured(scene: Scene, material: Measured, measured: MeasuredArrays, row: _Row) -> None:
    """Write where the tables of a material are. An isotropic one needs no tangents."""
    turned = is_anisotropic(scene, material)
    turn = (material.anisotropy_rotation / 360.0) % 1.0
    _put(row, MEASURED=_bits(measured.head_of[material.file]), FLAGS=_sides(material))
    _put(row, ROUGHNESS=1.0, ANISOTROPY=1.0 if turned else 0.0, ROTATION=turn)


@singledispatch
def _fill(material: Any, row: _Row, _numbers: dict[str, int]) -> None:
    """Write the parameters that are specific to the type of material."""
    _put(row, FLAGS=_sides(material))


def _sides(material: Material) -> np.float32:
    return _bits(0 if getattr(material, "two_sided", True) else layout.MATERIAL_FLAG_ONE_SIDED)


def _distribution(material: Conductor | Dielectric | Principled) -> int:
    return layout.MATERIAL_FLAG_BECKMANN if material.microfacets == "beckmann" else 0


def _facets(material: Conductor | Dielectric) -> int:
    return _distribution(material) | (0 if material.multiple_scattering else layout.MATERIAL_FLAG_SINGLE_SCATTERING)


@_fill.register
def _(material: Dielectric, row: _Row, _numbers: dict[str, int]) -> None:
    flags = _facets(material) | (layout.MATERIAL_FLAG_THIN if material.thin else 0)
    _put(row, ROUGHNESS=material.roughness, FLAGS=_bits(flags))


@_fill.register
def _(material: Subsurface, row: _Row, _numbers: dict[str, int]) -> None:
    _put(row, ROUGHNESS=material.roughness)


@_fill.register
def _(material: OrenNayar, row: _Row, _numbers: dict[str, int]) -> None:
    _put(row, DIFFUSE_ROUGHNESS=material.roughness, FLAGS=_sides(material))


@_fill.register
def _(material: Conductor, row: _Row, _numbers: dict[str, int]) -> None:
    flags = _facets(material) | (0 if material.two_sided else layout.MATERIAL_FLAG_ONE_SIDED)
    if material.index is None:
        flags |= layout.MATERIAL_FLAG_SCHLICK
    else:
        eta, k = material.index
        _put(row, ETA=eta, K=k, FRESNEL=[fresnel_average(n, m) for n, m in zip(eta, k, strict=True)])
    turn = (material.anisotropy_rotation / 360.0) % 1.0
    _put(row, ROUGHNESS=material.roughness, ANISOTROPY=material.anisotropy, ROTATION=turn, FLAGS=_bits(flags))


@_fill.register
def _(material: Principled, row: _Row, _numbers: dict[str, int]) -> None:
    flags = _distribution(material) | (layout.MATERIAL_FLAG_THIN if material.thin else 0)
    flags |= 0 if material.two_sided else layout.MATERIAL_FLAG_ONE_SIDED
    _put(
        row,
        ROUGHNESS=material.roughness,
        METALLIC=material.metallic,
        TRANSMISSION=material.transmission,
        SPECULAR=material.specular,
        SPECULAR_COLOR=material.specular_color,
        DIFFUSE_ROUGHNESS=material.diffuse_roughness,
        COAT=material.coat,
        COAT_ROUGHNESS=material.coat_roughness,
        FLAGS=_bits(flags),
        SHEEN_COLOR=material.sheen_color,
        SHEEN_ROUGHNESS=material.sheen_roughness,
        ANISOTROPY=material.anisotropy,
        ROTATION=(material.anisotropy_rotation / 360.0) % 1.0,
        DIFFUSE_TRANSMISSION=material.diffuse_transmission,
        DIFFUSE_TRANSMISSION_COLOR=material.diffuse_transmission_color,
    )


@_fill.register
def _(material: Hair, row: _Row, _numbers: dict[str, int]) -> None:
    numbers = hair_numbers(material)
    _put(
        row,
        HAIR_VARIANCE=numbers.variance,
        HAIR_SPREAD=numbers.spread,
        HAIR_PER_LOGARITHM=numbers.per_logarithm,
        HAIR_ETA=material.ior,
        HAIR_TILT_SINE=numbers.tilt[0],
        HAIR_TILT_COSINE=numbers.tilt[1],
        ROUGHNESS=1.0,
    )


@_fill.register
def _(material: Mix, row: _Row, numbers: dict[str, int]) -> None:
    first, second = (numbers[name] for name in material.materials)
    _put(row, COLOR=0.0, WEIGHT=material.weight, FIRST=_bits(first), SECOND=_bits(second))
