"""Indirect radiance of patches as a small texture on every triangle, sphere and disk, for the final gather."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender.flatten.surface_arrays import FlatSurfaces
from clrender.flatten.surfaces import flat_surfaces
from clrender.radiosity.sides import own_radiance, side_areas
from clrender.radiosity.vectors import cross, dot

if TYPE_CHECKING:
    from clrender.radiosity.patches import Patches

__all__ = ["Atlas", "atlas_of"]

_FINER: Final = 2.0
"""Texels per patch along an edge."""
_MOST: Final = 4096
_CUTS: Final = 8
"""A patch is rasterised by the centres of `_CUTS` x `_CUTS` parts."""
_ROW: Final = 16

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Atlas:
    """The textures that ``kernels/radiosity/gather.h`` reads.

    Attributes
    ----------
    rows : (primitives + 1, 16) float32
        For each primitive, and for the environment: radiance emitted by its front, 1 if gather rays must add it, and
        first texel and texels along an edge (both as bits).
    texels : (t, 3) float32
        Radiance, W/(sr m²). Each primitive has a square for its front and one for its back.
    """

    rows: NDArray[np.float32]
    texels: NDArray[np.float32]


def atlas_of(patches: Patches, indirect: _Floats, used: NDArray[np.bool_], open_share: _Floats) -> Atlas:
    """Textures of the indirect radiance that patches reflect, on the primitives of the original scene.

    A texel is the mean of the uncovered parts of patches in it, or the mean of the whole side if there are none.

    Parameters
    ----------
    patches : Patches
    indirect : (2 n + 1, 3) float64
        That radiance, W/(sr m²); for textured sides as if they were white, because the kernel looks up the texture.
    used : (2 n + 1,) bool
        Sides in the solution.
    open_share : (2 n + 1,) float64
        Uncovered fraction of each side's area.
    """
    surfaces = flat_surfaces(patches.scene)
    count = len(surfaces.triangles) + len(surfaces.analytic_shapes)
    number = np.bincount(patches.primitive, minlength=count)
    along = np.clip(np.ceil(_FINER * np.sqrt(number)), 1, _MOST).astype(np.int64)
    along[number < 2] = 1
    first = np.cumsum(2 * along * along) - 2 * along * along
    total = int((2 * along * along).sum())
    weight = np.where(used, side_areas(patches) * open_share, 0.0)

    of, size = patches.primitive, along[patches.primitive]
    sums, weights = np.zeros((total, 3)), np.zeros(total)
    where = _Places(surfaces, patches)
    for middle in _middles(patches.corners):
        x, y = where.of(middle)
        column = np.clip((x * size).astype(np.int64), 0, size - 1)
        row = np.clip((y * size).astype(np.int64), 0, size - 1)
        for back in (0, 1):
            at = first[of] + (back * size + row) * size + column
            part = weight[back:-1:2]
            weights += np.bincount(at, part, total)
            for channel in range(3):
                sums[:, channel] += np.bincount(at, part * indirect[back:-1:2, channel], total)
    return Atlas(_rows(patches, first, along), _filled(sums, weights, np.repeat(along * along, 2)))


def _filled(sums: _Floats, weights: _Floats, lengths: _Ints) -> NDArray[np.float32]:
    """Weighted means; texels without samples get the mean of their square."""
    square = np.repeat(np.arange(len(lengths)), lengths)
    whole = np.bincount(square, weights, len(lengths))
    means = np.empty_like(sums)
    for channel in range(3):
        mean = np.bincount(square, sums[:, channel], len(lengths)) / np.where(whole > 0.0, whole, 1.0)
        means[:, channel] = np.where(
            weights > 0.0, sums[:, channel] / np.where(weights > 0.0, weights, 1.0), mean[square]
        )
    return means.astype(np.float32)


def _rows(patches: Patches, first: _Ints, along: _Ints) -> NDArray[np.float32]:
    rows = np.zeros((len(first) + 1, _ROW), np.float32)
    rows[patches.primitive, :3] = patches.emission
    rows[:-1, 3] = 0.0 if patches.shadow_rays_find_emission else 1.0
    rows[:, 4] = np.append(first, 0).astype(np.uint32).view(np.float32)
    rows[:, 5] = np.append(along, 1).astype(np.uint32).view(np.float32)
    rows[-1, :3], rows[-1, 3] = own_radiance(patches)[-1], 1.0
    return rows


def _middles(corners: _Floats) -> Iterator[_Floats]:
    """Yields (n, 3) arrays: centres of equal parts of triangles."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    for i in range(_CUTS):
        for j in range(_CUTS - i):
            for third in (1.0, 2.0) if i + j < _CUTS - 1 else (1.0,):
                u, v = (i + third / 3.0) / _CUTS, (j + third / 3.0) / _CUTS
                yield a + u * (b - a) + v * (c - a)


class _Places:
    """Maps points of patches to coordinates on their primitives, in [0, 1]², like ``gather_place`` of the kernel.

    Triangles: barycentric weights of B and C. Spheres: octahedral mapping (Engelhardt and Dachsbacher 2008). Disks: the
    two axes along which the normal is smallest.
    """

    def __init__(self, surfaces: FlatSurfaces, patches: Patches) -> None:
        flat = patches.primitive < len(surfaces.triangles)
        self._flat = np.flatnonzero(flat)
        self._round = np.flatnonzero(~flat)
        corners = surfaces.vertices[surfaces.triangles[patches.primitive[self._flat]]].astype(np.float64)
        self._a, self._ab, self._ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        self._normal = cross(self._ab, self._ac)
        shapes = surfaces.analytic_shapes[patches.primitive[self._round] - len(surfaces.triangles)]
        self._center = shapes["center_radius"].astype(np.float64)
        axis = np.abs(shapes["normal"][:, :3])
        self._disk = axis.any(axis=1)
        self._z = (axis[:, 2] >= axis[:, 0]) & (axis[:, 2] >= axis[:, 1])
        self._y = ~self._z & (axis[:, 1] >= axis[:, 0])

    def of(self, points: _Floats) -> tuple[_Floats, _Floats]:
        """Coordinates, (n,) and (n,), of a point on each patch."""
        x, y = np.zeros(len(points)), np.zeros(len(points))
        to = points[self._flat] - self._a
        square = dot(self._normal, self._normal)
        x[self._flat] = dot(cross(to, self._ac), self._normal) / square
        y[self._flat] = dot(cross(self._ab, to), self._normal) / square
        away = points[self._round] - self._center[:, :3]
        x[self._round], y[self._round] = np.where(self._disk, self._on_disk(away), _unfolded(away))
        return x, y

    def _on_disk(self, away: _Floats) -> _Floats:
        scaled = away / self._center[:, 3:]
        x = np.where(self._z | self._y, scaled[:, 0], scaled[:, 1])
        y = np.where(self._z, scaled[:, 1], scaled[:, 2])
        return np.stack([x, y]) * 0.5 + 0.5


def _unfolded(away: _Floats) -> _Floats:
    """Octahedral mapping of directions to a square, (2, n)."""
    x, y, z = (away / np.maximum(np.abs(away).sum(axis=1), 1e-300)[:, None]).T
    low = z < 0.0
    u = np.where(low, np.copysign(1.0 - np.abs(y), x), x)
    v = np.where(low, np.copysign(1.0 - np.abs(x), y), y)
    return np.stack([u, v]) * 0.5 + 0.5
