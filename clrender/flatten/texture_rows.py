"""Textures as the kernels read them: a row for each, and the textures of materials and lights."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.errors import SceneError
from clrender.exact.angles import sin_cos_degrees
from clrender.flatten.emission import shape_emission
from clrender.flatten.plugin_rows import needs_uvs, parameter_numbers, parameter_slots, plugin_number, used_plugins
from clrender.image.texel_tiles import StoredPicture, coded_values
from clrender.scene.description import Scene
from clrender.scene.materials import OrenNayar, PluginMaterial
from clrender.scene.textures import (
    AnyTexture,
    BumpMap,
    Checker,
    ImageTexture,
    NormalMap,
    PluginTexture,
    Ramp,
    Texture,
    ThicknessMap,
    textures_of,
)
from clrender.scene.values import Vector
from clrender.wording import place

__all__ = ["FILM_KEYS", "SLOTS", "FlatTextures", "flat_textures"]

SLOTS: Final[Mapping[str, int]] = {
    "reflectance": layout.TEXTURE_SLOTS["BASE_COLOR"],
    "f0": layout.TEXTURE_SLOTS["BASE_COLOR"],
    "normal_map": layout.TEXTURE_SLOTS["NORMAL"],
    "bump_map": layout.TEXTURE_SLOTS["BUMP"],
    **{name.lower(): slot for name, slot in layout.TEXTURE_SLOTS.items()},
}
"""Column of a material's texture slots, by key of the material."""
_COLORS: Final = ("reflectance", "f0", "base_color", "specular_color", "sheen_color", "emission")
"""Keys of colours; their files of 8 or 16 bits are sRGB by default."""
FILM_KEYS: Final = ("iridescence", "iridescence_thickness")
"""Keys of a thin film, whose textures have no slots; see `clrender.flatten.thin_films`."""


@dataclass(frozen=True)
class FlatTextures:
    """Arrays as in `clrender.flatten.flat_scene.FlatScene`; without textures, each is one row of zeros.

    Attributes
    ----------
    rows : (N, 16) float32
        TEXTURE_ROW_* of kernels/types.h.
    slots : (M, 16) float32
        Bits: for each material the index of the texture of each parameter, or `layout.NONE`; the last row is for shapes
        without a material, if one of them has textured emission.
    values : (K,) float32
        Decoding tables for numbers of 8 and 16 bits.
    texels : (tiles, 64) uint8
    sha256 : str
        Hash of the images.
    emission : mapping of int to int
        Index of the emission texture, by index of the shape.
    films : mapping of (int, str) to int
        Index of the texture of a thin film, by number and key of the material.
    """

    rows: NDArray[np.float32]
    slots: NDArray[np.float32]
    values: NDArray[np.float32]
    texels: NDArray[np.uint8]
    sha256: str
    emission: Mapping[int, int]
    films: Mapping[tuple[int, str], int]


def flat_textures(scene: Scene) -> FlatTextures:
    """All textures of a scene.

    Raises
    ------
    SceneError
        A file cannot be read, or a linear image is declared as sRGB.
    """
    slots = np.full((len(scene.materials) + 1, 16), layout.NONE, np.uint32)
    rows: list[NDArray[np.float32]] = []
    values = _Values()
    used_plugins(scene)  # checks them
    store = scene.textures()

    def add(texture: AnyTexture, at: tuple[str | int, ...], colored: bool, strength: float = 1.0) -> int:
        picture = store.picture(texture)
        srgb = _is_srgb(texture, picture, colored)
        if srgb and picture.coding in ("half", "float"):
            where = f"{scene.source}: {place((*at, 'color_space'))}"
            raise SceneError(f'{where} is "srgb", but the picture holds linear light; leave it out')
        row = _row(texture, picture, colored, values.of(picture.coding, srgb), values.of(picture.coding, False))
        row[12:15] *= np.float32(strength)
        rows.append(row)
        return len(rows) - 1

    films: dict[tuple[int, str], int] = {}
    for number, (name, material) in enumerate(scene.materials.items()):
        own = parameter_slots(scene, material) if isinstance(material, PluginMaterial) else {}
        for key, texture in textures_of(material):
            if key == "emission":
                continue
            if key in FILM_KEYS:
                films[number, key] = len(rows)
                if isinstance(texture, PluginTexture):
                    rows += _made(scene, texture, len(rows))
                else:
                    add(texture, ("materials", name, key), False)
                continue
            of_diffuse = isinstance(material, OrenNayar) and key == "roughness"
            steps = key.split(".", 1)
            slot, colored = own.get(
                steps[-1], (SLOTS.get("diffuse_roughness" if of_diffuse else key, 0), key in _COLORS)
            )
            if isinstance(texture, PluginTexture):
                slots[number, slot] = len(rows)
                rows += _made(scene, texture, len(rows))
            else:
                slots[number, slot] = add(texture, ("materials", name, *steps), colored)
    emission: dict[int, int] = {}
    known: dict[tuple[Texture, float], int] = {}
    for index in range(len(scene.shapes)):
        light = shape_emission(scene, index)
        if light is not None and light.texture is not None:
            same = (light.texture, light.strength)
            if same not in known:
                known[same] = add(light.texture, light.place, True, light.strength)
            emission[index] = known[same]
    if not any(scene.shapes[index].material is None for index in emission):
        slots = slots[: max(len(scene.materials), 1)]
    sha256 = hashlib.sha256("".join(each.sha256 for each in store.pictures.values()).encode()).hexdigest()
    whole = np.array(rows, np.float32) if rows else np.zeros((1, 16), np.float32)
    return FlatTextures(whole, slots.view(np.float32), values.table, store.texels, sha256, emission, films)


def _made(scene: Scene, texture: PluginTexture, at: int) -> list[NDArray[np.float32]]:
    """Two rows of a plugin's texture, the first of which has the number `at`; the second has its parameters."""
    row = np.zeros(16, np.float32)
    columns = {name: first for name, first, _, _ in layout.ROWS["TEXTURE"]}
    bits = row.view(np.uint32)
    bits[columns["PLUGIN"]], bits[columns["NUMBERS"]] = plugin_number(scene, texture.plugin), at + 1
    bits[1:3] = 1
    bits[3] = layout.TEXTURE_PLUGIN | texture.uv_set << 14
    if needs_uvs(scene, texture):
        row[6:9], row[9:12] = _transformed(texture)
    numbers = np.zeros(16, np.float32)
    given = parameter_numbers(scene, texture)
    numbers[: len(given)] = given
    return [row, numbers]


def _is_srgb(texture: AnyTexture, picture: StoredPicture, colored: bool) -> bool:
    if not isinstance(texture, ImageTexture):
        return False
    if texture.color_space is None:
        return colored and picture.coding in ("unorm8", "unorm16")
    return texture.color_space == "srgb"


class _Values:
    """Unique decoding tables of images."""

    def __init__(self) -> None:
        self._tables: list[NDArray[np.float32]] = []
        self._begins: dict[tuple[str, bool], int] = {}

    def of(self, coding: str, srgb: bool) -> int:
        """Offset of a table; 0 if numbers need no decoding."""
        if coding == "float":
            return 0
        if (coding, srgb) not in self._begins:
            self._begins[coding, srgb] = sum(map(len, self._tables))
            self._tables.append(coded_values(coding, srgb))
        return self._begins[coding, srgb]

    @property
    def table(self) -> NDArray[np.float32]:
        """All tables; a single zero if there are none."""
        return np.concatenate(self._tables) if self._tables else np.zeros(1, np.float32)


def _row(texture: AnyTexture, picture: StoredPicture, colored: bool, values: int, alphas: int) -> NDArray[np.float32]:
    wraps = ("repeat", "repeat") if isinstance(texture, Checker) else ("clamp", "clamp")
    filters, channel = "linear", None if colored else "r"
    factor, bias = (1.0, 1.0, 1.0), 0.0
    if isinstance(texture, Checker | Ramp):
        filters = "nearest" if isinstance(texture, Checker) else "exact"
    else:
        wraps = texture.wrap
    if isinstance(texture, ImageTexture):
        filters, channel, factor = texture.filter, texture.channel or channel, texture.scale
    if isinstance(texture, NormalMap):
        filters, channel = texture.filter, None
        step = {"unorm8": 127.0, "unorm16": 32767.0}.get(picture.coding)
        # In integers the middle of 0 to 2n + 1 is n + 1, which no number between 0 and 1 represents exactly
        spread, bias = (2.0, -1.0) if step is None else ((2.0 * step + 1.0) / step, -(step + 1.0) / step)
        factor = (spread, spread, texture.scale)
    if isinstance(texture, ThicknessMap):
        filters, channel = texture.filter, texture.channel
    if isinstance(texture, BumpMap):
        filters, channel, factor = "exact", texture.channel, (texture.scale,) * 3
    row = np.zeros(16, np.float32)
    bits = row.view(np.uint32)
    bits[0:3] = picture.first_tile, picture.width, picture.height
    bits[3] = (
        picture.texel_bits
        | (layout.TEXEL_FOUR if picture.channels == 4 else 0)
        | (layout.TEXEL_FLOAT if picture.coding == "float" else 0)
        | layout.TEXTURE_WRAPS[wraps[0]] << 5
        | layout.TEXTURE_WRAPS[wraps[1]] << 7
        | layout.TEXTURE_FILTERS[filters] << 9
        | layout.TEXTURE_CHANNELS[channel] << 11
        | texture.uv_set << 14
    )
    bits[4:6] = values, alphas
    row[6:9], row[9:12] = _mapping(texture, picture)
    row[12:15], row[15] = factor, bias
    return row


def _transformed(texture: AnyTexture | PluginTexture) -> tuple[Vector, Vector]:
    """Map from texture coordinates to those of a texture, after its transform."""
    sine, cosine = sin_cos_degrees(texture.transform.rotate_degrees)
    (su, sv), (ou, ov) = texture.transform.scale, texture.transform.offset
    return (cosine * su, -sine * sv, ou), (sine * su, cosine * sv, ov)


def _mapping(texture: AnyTexture, picture: StoredPicture) -> tuple[Vector, Vector]:
    """Map from texture coordinates to column and row of the image, 0 to 1, with row 0 at the top."""
    u, v = _transformed(texture)
    if isinstance(texture, Checker):
        wide, high = (2.0 * size for size in texture.size)
        u, v = (u[0] / wide, u[1] / wide, u[2] / wide), (v[0] / high, v[1] / high, v[2] / high)
    if isinstance(texture, Ramp):
        share, half_texel = (picture.width - 1) / picture.width, 0.5 / picture.width
        u = (u[0] * share, u[1] * share, u[2] * share + half_texel)
    return u, (-v[0], -v[1], 1.0 - v[2])
