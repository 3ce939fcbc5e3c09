"""Radiance at the corners of patches, for smooth display, and its contrast across patches."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from clrender.radiosity.patches import Patches

__all__ = ["Corners"]

_CREASE: Final = 0.8
"""Cosine of the largest angle between patches of one smooth surface."""

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


class Corners:
    """Groups of patch corners that coincide on one smooth surface.

    Parameters
    ----------
    patches : Patches
        Only their shapes matter: a shape that moves keeps its corners.
    """

    def __init__(self, patches: Patches) -> None:
        count = len(patches)
        self._areas = patches.areas
        self._count = count
        points = patches.corners.reshape(-1, 3)
        middles = ((patches.corners + np.roll(patches.corners, -1, axis=1)) / 2.0).reshape(-1, 3)
        shape = np.repeat(patches.shape, 3)
        ids = _same(np.concatenate([points, middles]), np.concatenate([shape, shape]))
        corner_ids, middle_ids = ids[: 3 * count], ids[3 * count :]
        self._pairs = _pairs(corner_ids, patches.normals)
        self._hanging = _hanging(corner_ids, middle_ids, patches.normals)

    def values(self, radiance: _Floats, used: NDArray[np.bool_]) -> _Floats:
        """Area-weighted mean of the patches around each corner; a hanging node gets the mean of its edge's ends.

        Parameters
        ----------
        radiance : (n, 3) float64
            Radiance of one side of each patch.
        used : (n,) bool
            Patches whose side is in the solution.

        Returns
        -------
        (n, 3, 3) float64
            By patch, corner and channel.
        """
        first, second = self._pairs
        weight = np.where(used, self._areas, 0.0)
        owner = np.arange(3 * self._count) // 3
        total = weight[owner]
        totals = total + np.bincount(first, total[second], len(owner)) + np.bincount(second, total[first], len(owner))
        values = np.empty((len(owner), 3))
        for channel in range(3):
            part = (weight * radiance[:, channel])[owner]
            some = part + np.bincount(first, part[second], len(owner))
            some = some + np.bincount(second, part[first], len(owner))
            values[:, channel] = some / np.where(totals > 0.0, totals, 1.0)
        corner, edge = self._hanging
        patch, number = np.divmod(edge, 3)
        values[corner] = (values[edge] + values[patch * 3 + (number + 1) % 3]) / 2.0
        return values.reshape(-1, 3, 3)

    def contrast(self, radiance: _Floats, used: NDArray[np.bool_]) -> _Floats:
        """Contrast across each patch: gradient of its radiance times its size.

        Parameters
        ----------
        radiance, used
            As for `values`.

        Returns
        -------
        (n,) float64
            Radiance of the largest channel.
        """
        values = self.values(radiance, used)
        contrast: _Floats = (values.max(axis=1) - values.min(axis=1)).max(axis=1)
        return contrast


def _same(points: _Floats, shape: _Ints) -> _Ints:
    """An index for each point, equal if shape and position are."""
    order = np.lexsort((points[:, 2], points[:, 1], points[:, 0], shape))
    there, of = points[order], shape[order]
    fresh = np.ones(len(order), bool)
    fresh[1:] = (there[1:] != there[:-1]).any(axis=1) | (of[1:] != of[:-1])
    ids = np.empty(len(order), np.int64)
    ids[order] = np.cumsum(fresh) - 1
    return ids


def _alike(normals: _Floats, first: _Ints, second: _Ints) -> NDArray[np.bool_]:
    a, b = normals[first // 3], normals[second // 3]
    alike: NDArray[np.bool_] = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]) + a[:, 2] * b[:, 2] > _CREASE
    return alike


def _pairs(ids: _Ints, normals: _Floats) -> tuple[_Ints, _Ints]:
    """Pairs of corners at one point whose patches have similar normals."""
    order = np.argsort(ids, kind="stable")
    firsts, seconds, step = [order[:0]], [order[:0]], 1
    while step < len(order):
        together = ids[order[step:]] == ids[order[:-step]]
        if not together.any():
            break
        a, b = order[:-step][together], order[step:][together]
        alike = _alike(normals, a, b)
        firsts.append(a[alike])
        seconds.append(b[alike])
        step += 1
    return np.concatenate(firsts), np.concatenate(seconds)


def _hanging(corner_ids: _Ints, middle_ids: _Ints, normals: _Floats) -> tuple[_Ints, _Ints]:
    """Hanging nodes: corners at the middle of another patch's edge, each with that edge (its first corner)."""
    order = np.argsort(middle_ids, kind="stable")
    start = np.searchsorted(middle_ids[order], corner_ids)
    found = start < len(order)
    found[found] = middle_ids[order[start[found]]] == corner_ids[found]
    corner = np.flatnonzero(found)
    edge = order[start[found]]
    alike = _alike(normals, corner, edge)
    return corner[alike], edge[alike]
