"""Differences between an image and its new render, and their likely cause."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.wording import counted, grouped

if TYPE_CHECKING:
    from clrender.film import Film
    from clrender.verification.claim import Claim

__all__ = ["Comparison", "Rectangle", "explanation"]

Rectangle = tuple[int, int, int, int]
"""The first column and row, and those after the last."""

_ROUNDING: Final = 1e-4
_NOISE: Final = 5.0
_FEW: Final = 8


@dataclass(frozen=True)
class Comparison:
    """Tiles of an image compared with the same tiles rendered again.

    Attributes
    ----------
    checked : int
        Tiles.
    differing : tuple of Rectangle
        Tiles with pixels whose bits differ.
    pixels : tuple of (int, int)
        Pixels whose bits differ: column and row.
    means : (checked, 2) float64
        Mean of each tile in the file and in the render.
    relative : float
        Median relative difference of the channels that differ.
    beside : str
        What differs where no channel does; see `Claim`.
    """

    checked: int
    differing: tuple[Rectangle, ...]
    pixels: tuple[tuple[int, int], ...]
    means: npt.NDArray[np.float64]
    relative: float
    beside: str

    @classmethod
    def of(
        cls, claim: Claim, film: Film, tiles: Sequence[Rectangle], alpha: npt.NDArray[np.float32] | None = None
    ) -> Comparison:
        """Compare these tiles; `alpha` as of `Claim.compare`."""
        differing, pixels, means, ratios = [], [], [], [np.zeros(0)]
        for left, top, right, bottom in tiles:
            differs, pair = claim.compare(film, slice(top, bottom), slice(left, right), alpha)
            means.append(pair.mean(axis=(1, 2, 3)))
            if differs.any():
                differing.append((left, top, right, bottom))
                pixels += [(left + column, top + row) for row, column in np.argwhere(differs).tolist()]
                there, here = pair[:, differs].reshape(2, -1)
                other = there != here
                scale = np.maximum(np.abs(there), np.abs(here))[other]
                ratios.append(np.abs(there - here)[other] / scale)
        every = np.concatenate(ratios)
        relative = float(np.median(every)) if len(every) else 0.0
        return cls(len(tiles), tuple(differing), tuple(pixels), np.array(means), relative, claim.beside)


def explanation(comparison: Comparison) -> str:
    """A sentence on what differs, and, if most does, on the likely cause."""
    wrong, checked = len(comparison.differing), comparison.checked
    left, top, right, bottom = comparison.differing[0]
    where = f"columns {left} to {right - 1} of rows {top} to {bottom - 1}"
    if len(comparison.pixels) == 1:
        where = "the pixel in column {} of row {}".format(*comparison.pixels[0])
    first = f"{grouped(wrong)} of {counted(checked, 'tile')} rendered again {'differs' if wrong == 1 else 'differ'}"
    first += f", first {where}" if wrong > 1 else f": {where}"
    if comparison.relative == 0.0:
        return f"{first}, in their {comparison.beside}: the file was changed"
    if 2 * wrong < checked or wrong < 2:
        return f"{first}: samples were changed, or a device computed them wrongly"
    if comparison.relative < _ROUNDING:
        return f"{first}, but only by rounding: it was made by other kernels, or by a device with other rounding"
    if checked >= _FEW and _like_noise(comparison.means):
        return f"{first}, but their means agree: it was probably made with another seed than recorded"
    return (
        f"{first}, and so do their means: it was probably made from another scene or with other settings than recorded"
    )


def _like_noise(means: npt.NDArray[np.float64]) -> bool:
    """Whether the means of tiles differ no more than by chance."""
    difference = means[:, 0] - means[:, 1]
    spread = float(difference.std(ddof=1)) / math.sqrt(len(difference))
    return abs(float(difference.mean())) <= _NOISE * spread
