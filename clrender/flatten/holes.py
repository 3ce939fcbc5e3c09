"""Opacity masks of triangles: a coarse grid tells rays where they pass or hit without a texture lookup.

Each triangle whose opacity is a texture is divided into a grid of cells along its barycentric coordinates. Each cell
has two bits: it is fully transparent, and it is fully opaque (Gruen, Benthin and Woop, "Sub-triangle opacity masks for
faster ray tracing of transparent objects", HPG 2020). The bits only save time: a ray that hits any other cell looks up
the texture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.flatten.texel_table import wrap_period
from clrender.flatten.texture_means import TextureMeans
from clrender.scene.shapes import Curves, Disk, Sphere

if TYPE_CHECKING:
    from clrender.flatten.surface_arrays import FlatSurfaces
    from clrender.flatten.texture_rows import FlatTextures
    from clrender.scene.description import Scene

__all__ = ["hole_rows"]

_Floats: TypeAlias = NDArray[np.float64]
_GRID: Final = layout.HOLE_GRID
_WORDS: Final = _GRID * _GRID // 32
_PARTS: Final = 4
"""Subdivisions of a cell along each side: texels are counted in axis-aligned rectangles, but cells may be slanted."""
_MOST_ROWS: Final = 2**16
"""Most triangles with distinct texture coordinates; rays that hit others always look up the texture."""
_AT_ONCE: Final = 2**9
_LEAST_TEXELS: Final = float(layout.HOLE_GRID)
"""Least size, in texels, of a triangle with mixed opacity that gets a grid: cells should not be finer than texels."""
_COLUMN: Final = next(at for name, at, _, _ in layout.ROWS["ATTRIBUTE"] if name == "HOLES")
_MARGIN: Final = 1e-3
"""Fraction of a cell, and of a texel: many times the rounding error of a point."""


def hole_rows(scene: Scene, surfaces: FlatSurfaces, textures: FlatTextures) -> NDArray[np.uint32]:
    """Opacity masks of all triangles whose opacity is a texture.

    Parameters
    ----------
    scene : Scene
    surfaces : FlatSurfaces
        The rows are entered in its `attributes` (ATTRIBUTE_ROW_HOLES).
    textures : FlatTextures

    Returns
    -------
    (N, 64) uint32
        Cell (i, j), where the weights of B and C begin at i / 32 and j / 32, is bit 32 j + i. In the first half of a
        row the bit means that the cell is fully transparent, in the second that it is fully opaque. Row 0 has no bits;
        triangles have it whose side BC is much the shortest, because the BVH stores them as B C A.
    """
    rows = [np.zeros((1, 2 * _WORDS), np.uint32)]
    made = 1
    numbers = {name: number for number, name in enumerate(scene.materials)}
    slots = textures.slots.view(np.uint32)[:, layout.TEXTURE_SLOTS["OPACITY"]]
    shapes_of: dict[str, list[int]] = {}
    for index, shape in enumerate(scene.shapes):
        if shape.material is not None and not isinstance(shape, Sphere | Disk | Curves):
            shapes_of.setdefault(shape.material, []).append(index)
    for name, indices in shapes_of.items():
        number = int(slots[numbers[name]])
        if number == layout.NONE:
            continue
        means = TextureMeans(textures, number)
        spans = [np.arange(surfaces.first[i], surfaces.first[i] + surfaces.count[i]) for i in indices]
        triangles = np.concatenate(spans)
        first = 6 * means.uv_set
        corners, of = _different(surfaces.attributes[triangles, first : first + 6])
        corners = corners[: max(0, _MOST_ROWS - made)]
        bits = _masks(means, scene.materials[name].opacity_cutoff, corners.reshape(-1, 3, 2).astype(np.float64))
        known = (of < len(corners)) & ~_turned(surfaces.vertices[surfaces.triangles[triangles]])
        row = np.where(known, of + made, 0).astype(np.uint32)
        surfaces.attributes[triangles, _COLUMN] = row.view(np.float32)
        rows.append(bits)
        made += len(bits)
    return np.concatenate(rows)


def _turned(corners: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which triangles, (N, 3, 3), the BVH may store with other vertices first (``kernels/geometry/triangle.h``)."""
    ab, bc, ca = (np.abs(corners - np.roll(corners, -1, axis=1)).max(axis=2)).T
    return np.asarray(bc * np.float32(3.9) < np.maximum(ab, ca))


def _different(rows: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """The unique rows, and the index of each row among them."""
    whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * 4))).ravel()
    _, first, of = np.unique(whole, return_index=True, return_inverse=True)
    return rows[first], of.astype(np.int64)


def _masks(texture: TextureMeans, cutoff: float | None, corners: _Floats) -> NDArray[np.uint32]:
    """Opacity masks of triangles with these texture coordinates, (T, 3, 2)."""
    edges = np.abs(corners - np.roll(corners, 1, axis=1)).max(axis=(0, 1)) if len(corners) else np.zeros(2)
    x, y = texture.place(np.array([0.0, edges[0], 0.0]), np.array([0.0, 0.0, edges[1]]))
    reach = [2.0 * (abs(at[1] - at[0]) + abs(at[2] - at[0])) / (_GRID * _PARTS) + 4.0 for at in (x, y)]
    sums = _summed(texture, cutoff, reach)
    words = np.zeros((len(corners), 2 * _WORDS), np.uint32)
    # In fine meshes nearly all triangles are fully transparent or fully opaque
    alike = [none[:, 0, 0] for none in _without(texture, sums, corners, 1)]
    for kind in range(2):
        words[alike[kind], kind * _WORDS : (kind + 1) * _WORDS] = 2**32 - 1
    long = np.zeros(len(corners), bool)
    for at in texture.place(corners[..., 0], corners[..., 1]):
        long |= np.ptp(at, axis=1) >= _LEAST_TEXELS
    finely = np.flatnonzero(long & ~alike[0] & ~alike[1])
    for begin in range(0, len(finely), _AT_ONCE):
        some = finely[begin : begin + _AT_ONCE]
        for kind, none in enumerate(_without(texture, sums, corners[some], _GRID * _PARTS)):
            cells = np.asarray(none.reshape(-1, _GRID, _PARTS, _GRID, _PARTS).all(axis=(2, 4)))
            bits = np.packbits(cells.reshape(len(cells), -1), axis=1, bitorder="little")
            words[some, kind * _WORDS : (kind + 1) * _WORDS] = bits.view("<u4")
    return words


def _without(
    texture: TextureMeans, sums: list[NDArray[np.int32]], corners: _Floats, parts: int
) -> list[NDArray[np.bool_]]:
    """Which subdivisions of triangles touch no texel of each of the two kinds in `sums`, (T, parts, parts)."""
    known, (x0, x1), (y0, y1) = _reached(texture, corners, sums[0].shape, parts)
    return [known & (table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0] == 0) for table in sums]


def _summed(texture: TextureMeans, cutoff: float | None, reach: list[float]) -> list[NDArray[np.int32]]:
    """Summed-area tables of texels that are not fully transparent, and of those that are not fully opaque.

    The image is continued by its repetition, or its mirror image, as far as subdivisions of cells may reach.
    """
    wide, high = (
        size if (period := wrap_period(size, wrap)) is None else period + more
        for size, wrap, more in zip(
            texture.size, texture.wraps, (min(int(r), s) for r, s in zip(reach, texture.size, strict=True)), strict=True
        )
    )
    tables = [np.zeros((high + 1, wide + 1), np.int32) for _ in range(2)]
    for row in range(high):
        opacity = texture.texels(np.arange(wide), np.full(wide, row))[:, 0]
        hole = (opacity <= 0.0) if cutoff is None else (opacity < cutoff * (1.0 - 1e-6))
        whole = (opacity >= 1.0) if cutoff is None else (opacity >= cutoff * (1.0 + 1e-6))
        for table, marked in zip(tables, (~hole, ~whole), strict=True):
            table[row + 1, 1:] = table[row, 1:] + np.cumsum(marked, dtype=np.int32)
    return tables


def _reached(
    texture: TextureMeans, corners: _Floats, shape: tuple[int, ...], parts: int
) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    """First and last columns and rows of texels of each subdivision, and whether the tables contain them."""
    reach = (0.0 if texture.is_nearest else 0.5) + _MARGIN
    steps = np.arange(parts) / parts
    known = np.ones((len(corners), parts, parts), bool)
    ranges = []
    places = texture.place(corners[..., 0], corners[..., 1])
    for at, size, wrap, known_to in zip(places, texture.size, texture.wraps, (shape[1] - 1, shape[0] - 1), strict=True):
        a, b, c = at[:, 0, None, None], (at[:, 1] - at[:, 0])[:, None, None], (at[:, 2] - at[:, 0])[:, None, None]
        corner = a + c * steps[:, None] + b * steps
        slack = _MARGIN / parts * (np.abs(b) + np.abs(c)) + reach
        begin = np.floor(corner + (np.minimum(b, 0.0) + np.minimum(c, 0.0)) / parts - slack)
        end = np.floor(corner + (np.maximum(b, 0.0) + np.maximum(c, 0.0)) / parts + slack) + 1.0
        period = wrap_period(size, wrap)
        if period is None:
            begin, end = np.clip(begin, 0, size - 1), np.clip(end, 1, size)
        else:
            shift = np.floor(begin / period) * period
            begin, end = begin - shift, end - shift
        known &= (begin >= 0) & (end <= known_to)
        ranges.append(np.clip(np.stack([begin, end]), 0, known_to).astype(np.int64))
    return known, ranges[0], ranges[1]
