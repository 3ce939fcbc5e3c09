"""Thin films on materials, as kernels read them: what interference leaves of light, and the films themselves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from clrender import layout
from clrender.exact.elementary import sines_cosines
from clrender.exact.matrices import interpolated
from clrender.scene.materials import Dielectric, Iridescent
from clrender.scene.textures import ThicknessMap
from clrender.spectra.colors import table_wavelengths
from clrender.spectra.film import film_table

if TYPE_CHECKING:
    from clrender.scene.description import Scene

__all__ = ["facet_cosines", "interference_means", "thin_film_rows"]

_STEP: Final = 4.0
"""Nanometres from row to row; ``THIN_FILM_ROWS_PER_NANOMETRE`` of ``kernels/material/thin_film.h`` is its inverse."""
_FINER: Final = 5
"""Parts of each line of the tables of spectra, over which phases are integrated."""
_DIRECTIONS: Final = 24
"""Facets along each side of a square of random numbers."""


@cache
def interference_means() -> NDArray[np.float64]:
    """Means of exp(2πi x / λ) over wavelengths λ in daylight, for red, green and blue.

    Returns
    -------
    (3072, 6) float64
        Real parts and then imaginary ones, for differences x of two ways of light in steps of 4 nm. The last is 0:
        differences that are as large leave nothing.
    """
    lines = table_wavelengths()
    fine = np.linspace(lines[0], lines[-1], (len(lines) - 1) * _FINER + 1)
    light = interpolated(fine, lines, film_table()[:, 3])
    weights = np.stack([light * interpolated(fine, lines, film_table()[:, channel]) for channel in range(3)], axis=1)
    weights[[0, -1]] *= 0.5
    weights /= weights.sum(axis=0)
    means = np.zeros((layout.THIN_FILM_STEPS, 6))
    for row in range(layout.THIN_FILM_STEPS - 1):
        sine, cosine = sines_cosines(2.0 * math.pi * _STEP * row / fine)
        means[row, :3] = (weights * cosine[:, None]).sum(axis=0)
        means[row, 3:] = (weights * sine[:, None]).sum(axis=0)
    return means


@cache
def facet_cosines() -> NDArray[np.float64]:
    """Cosines between a direction and the facets of GGX that reflect it, as two with the same first three moments.

    Returns
    -------
    (24, 24, 3) float64
        Both cosines and the probability of the second; rows by the root of alpha, columns by that of the direction's
        cosine, from 0 to 1.
    """
    roots = np.arange(layout.THIN_FILM_FACETS) / (layout.THIN_FILM_FACETS - 1)
    alpha, cosine = np.maximum(roots * roots, 1e-4), np.maximum(roots * roots, 1e-4)
    alpha, cosine = alpha[:, None, None], cosine[None, :, None]
    middles = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    u, v = np.repeat(middles, _DIRECTIONS), np.tile(middles, _DIRECTIONS)
    # Visible normals (Dupuy and Benyoub, CGF 42(8), 2023)
    sine = np.sqrt(1.0 - cosine * cosine)
    x, z = alpha * sine, np.broadcast_to(cosine, np.broadcast_shapes(alpha.shape, cosine.shape))
    length = np.sqrt(x * x + z * z)
    x, z = x / length, z / length
    up = (1.0 - v) * (1.0 + z) - z
    sines, cosines = sines_cosines(2.0 * math.pi * u)
    level = np.sqrt(np.maximum(1.0 - up * up, 0.0))
    h_x, h_y, h_z = alpha * (level * cosines + x), alpha * (level * sines), np.maximum(up + z, 0.0)
    length = np.sqrt(h_x * h_x + h_y * h_y + h_z * h_z)
    seen = np.maximum((sine * h_x + cosine * h_z) / length, 0.0)
    out_z = 2.0 * seen * h_z / length - cosine
    both = [_hidden(alpha, z) for z in (cosine, np.maximum(out_z, 1e-7))]
    weights = np.where(out_z > 0.0, (1.0 + both[0]) / (1.0 + both[0] + both[1]), 0.0)
    weights = weights / weights.sum(axis=2)[..., None]
    mean = (weights * seen).sum(axis=2)
    apart = seen - mean[..., None]
    spread = np.sqrt((weights * apart * apart).sum(axis=2))
    skew = (weights * apart * apart * apart).sum(axis=2) / np.maximum(spread * spread * spread, 1e-30)
    skew = np.where(spread > 1e-6, skew, 0.0)
    width = np.sqrt(skew * skew + 4.0)
    low, high = (mean + 0.5 * spread * (skew + sign * width) for sign in (-1.0, 1.0))
    return np.stack([np.clip(low, 0.0, 1.0), np.clip(high, 0.0, 1.0), 0.5 * (1.0 - skew / width)], axis=2)


def _hidden(alpha: NDArray[np.float64], cosine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smith's Λ."""
    slope2 = alpha * alpha * (1.0 - cosine * cosine) / (cosine * cosine)
    return np.asarray(0.5 * (np.sqrt(1.0 + slope2) - 1.0))


def thin_film_rows(scene: Scene, textures: Mapping[tuple[int, str], int]) -> NDArray[np.float32]:
    """The films of a scene's materials.

    Parameters
    ----------
    scene : Scene
    textures : mapping of (int, str) to int
        See `clrender.flatten.texture_rows.FlatTextures.films`.

    Returns
    -------
    (N, 8) float32
        `interference_means`; `facet_cosines`, of a column and the next; and then a row THIN_FILM_ROW_* for each
        material. One row of zeros if there is no film.
    """
    materials = list(scene.materials.values())
    if not any(isinstance(material, Iridescent) and material.filmed for material in materials):
        return np.zeros((1, 8), np.float32)
    rows = np.zeros((layout.THIN_FILM_MATERIALS + len(materials), 8), np.float32)
    rows[: layout.THIN_FILM_STEPS, :6] = interference_means()
    facets = facet_cosines()
    pairs = np.concatenate([facets, np.concatenate([facets[:, 1:], facets[:, -1:]], axis=1)], axis=2)
    rows[layout.THIN_FILM_STEPS : layout.THIN_FILM_MATERIALS, :6] = pairs.reshape(-1, 6)
    columns = layout.columns("THIN_FILM")
    for number, material in enumerate(materials):
        row = rows[layout.THIN_FILM_MATERIALS + number]
        row.view(np.uint32)[[columns["SHARE_TEXTURE"], columns["THICKNESS_TEXTURE"]]] = layout.NONE
        row[columns["IOR"]] = row[columns["INDEX"]] = 1.0
        if not isinstance(material, Iridescent) or not material.filmed:
            continue
        share, thickness = material.iridescence, material.iridescence_thickness
        row[columns["SHARE"]] = share if isinstance(share, float) else 1.0
        least, most = thickness.range if isinstance(thickness, ThicknessMap) else (0.0, thickness)
        row[columns["LEAST"]], row[columns["RANGE"]] = least, most - least
        for key, column in (("iridescence", "SHARE_TEXTURE"), ("iridescence_thickness", "THICKNESS_TEXTURE")):
            if (number, key) in textures:
                row.view(np.uint32)[columns[column]] = textures[number, key]
        outside = material.exterior_ior if isinstance(material, Dielectric) else 1.0
        row[columns["IOR"]] = material.iridescence_ior / outside
        row[columns["INDEX"]] = material.iridescence_ior
    return rows
