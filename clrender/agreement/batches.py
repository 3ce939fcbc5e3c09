"""Independent batches of two integrators' images compared, tile by tile, by t-tests.

The samples of one image are stratified against each other, so their variance does not give the error of their mean.
Images of different seeds are independent, however, and the means of their tiles are close to normally distributed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.agreement.significance import has_outlier, holm, welch
from clrender.agreement.verdict import Verdict, verdict
from clrender.statistics.student_t import critical_value

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["LEVEL", "Batches", "Pair", "compare_batches", "tile_means"]

Floats = npt.NDArray[np.float64]

LEVEL: Final = 0.01
"""Probability that any pair compared by one command is reported to differ although no two do."""
_ROUNDING: Final = 64 * 2.0**-24
"""Relative difference that rounding in single precision can make, 3.8e-6: a few dozen operations."""
_FIREFLIES: Final = 1e-4
"""Probability that a tile of normally distributed noise is counted as one with fireflies."""
_NINE_IN_TEN: Final = 1.2816
"""Standard errors beyond the critical value at which a difference is detected nine times in ten."""


@dataclass(frozen=True)
class Batches:
    """Independent renders of a scene by one integrator.

    Attributes
    ----------
    label : str
        Its name, with a number if it is compared with itself.
    name : str
        Key of `clrender.integrators.INTEGRATORS`.
    tiles : (batches, rows, columns, 3) float64
        Mean radiance of each tile in each batch.
    tile_size : int
        Side of a tile, pixels; those at the right and lower edge of the image may be smaller.
    whole : (batches,) float64
        Mean radiance of the whole image over pixels and channels.
    image : (height, width, 3) float32
        Mean of all batches.
    numbers : dict
        JSON-able: spp, rays, seconds, nonfinite_samples, seeds.
    """

    label: str
    name: str
    tiles: Floats
    tile_size: int
    whole: Floats
    image: npt.NDArray[np.float32]
    numbers: dict[str, Any]


@dataclass(frozen=True)
class Pair:
    """Comparison of two integrators; signed numbers are `first` minus `second`.

    Attributes
    ----------
    first, second : str
        Labels.
    scores : (rows, columns) float64
        z-score of each tile, of the channel that differs most.
    numbers : dict
        JSON-able: mean_ratio and its interval, mean_p_value, tiles, tiles_differ, tiles_darker, tiles_brighter,
        largest_z and its tile, visible_in_tile, visible_in_mean, tiles_with_fireflies.
    verdict : Verdict
    """

    first: str
    second: str
    scores: Floats
    numbers: dict[str, Any]
    verdict: Verdict


def tile_means(image: npt.ArrayLike, side: int) -> Floats:
    """Means of the tiles of an image; those at its right and lower edge may be smaller.

    Parameters
    ----------
    image : (height, width, 3) float
    side : int
        Pixels.

    Returns
    -------
    (rows, columns, 3) float64
    """
    pixels = np.asarray(image, np.float64)
    height, width = pixels.shape[:2]
    tops, lefts = np.arange(0, height, side), np.arange(0, width, side)
    sums = np.add.reduceat(np.add.reduceat(pixels, tops, axis=0), lefts, axis=1)
    counts = np.diff(np.append(tops, height))[:, None] * np.diff(np.append(lefts, width))[None, :]
    means: Floats = sums / counts[:, :, None]
    return means


def compare_batches(scene: Scene, a: Batches, b: Batches, level: float = LEVEL, specular_chains: bool = False) -> Pair:
    """Test whether two sets of batches have the same means, in every tile and over the whole image.

    Half of `level` is spent on the tiles and their channels, by Welch's t-test and Holm's correction; half on the mean
    of the whole image, which reveals a small difference everywhere that no single tile can show.

    A tile that missed rare, bright light in all its batches is dark and has hardly any variance, so a noisy integrator
    would look significantly darker than a calm one. Its neighbours did receive such light: the variance of a tile is
    therefore taken to be no smaller than the mean variance of the tiles around it.

    Parameters
    ----------
    scene : Scene
    a, b : Batches
    level : float
        Probability that they are found to differ although they do not, if tile means are normally distributed.
    specular_chains : bool
        As for `clrender.agreement.verdict.verdict`.
    """
    shape = a.tiles.shape[1:]
    x, y = a.tiles.reshape(len(a.tiles), -1), b.tiles.reshape(len(b.tiles), -1)
    size = (x.mean(axis=0) + y.mean(axis=0)) / 2.0
    tiles = welch(x, y, _ROUNDING * size, (_variance_around(a.tiles).ravel(), _variance_around(b.tiles).ravel()))
    differ = holm(tiles.p, level / 2.0)
    whole = welch(a.whole[:, None], b.whole[:, None], _ROUNDING * (a.whole.mean() + b.whole.mean()) / 2.0)
    whole_differs = bool(whole.p[0] <= level / 2.0)

    def any_channel(marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        return np.asarray(marked.reshape(shape).any(axis=2), np.bool_)

    darker, brighter = any_channel(differ & (tiles.z < 0.0)), any_channel(differ & (tiles.z > 0.0))
    scores = tiles.z.reshape(shape)
    largest = np.take_along_axis(scores, np.abs(scores).argmax(axis=2)[..., None], axis=2)[..., 0]
    row, column = np.unravel_index(int(np.abs(largest).argmax()), largest.shape)
    lit = size > 0.0
    seen = _detectable(level / 2.0 / len(size), tiles.df) * tiles.error + _ROUNDING * size
    mean_seen = float((_detectable(level / 2.0, whole.df) * whole.error)[0])
    numbers = {
        **_ratio(a.whole, b.whole),
        "mean_p_value": float(whole.p[0]),
        "tiles": int(largest.size),
        "tiles_differ": int(np.count_nonzero(darker | brighter)),
        "tiles_darker": int(np.count_nonzero(darker)),
        "tiles_brighter": int(np.count_nonzero(brighter)),
        "largest_z": float(largest[row, column]),
        "largest_z_tile": [int(column), int(row)],
        "visible_in_tile": float(np.median(seen[lit] / size[lit])) if lit.any() else None,
        "visible_in_mean": mean_seen / float(b.whole.mean()) + _ROUNDING if b.whole.any() else None,
        "tiles_with_fireflies": int(
            np.count_nonzero(any_channel(has_outlier(x, _FIREFLIES) | has_outlier(y, _FIREFLIES)))
        ),
    }
    below = bool(darker.any()) or (whole_differs and whole.z[0] < 0.0)
    above = bool(brighter.any()) or (whole_differs and whole.z[0] > 0.0)
    return Pair(a.label, b.label, largest, numbers, verdict(a.name, b.name, scene, below, above, specular_chains))


def _variance_around(tiles: Floats) -> Floats:
    """Mean of the variances of a tile and its neighbours, of each channel; (rows, columns, 3)."""
    variance = np.pad(tiles.var(axis=0, ddof=1), ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    around: Floats = np.nanmean(np.lib.stride_tricks.sliding_window_view(variance, (3, 3), axis=(0, 1)), axis=(-2, -1))
    return around


def _detectable(level: float, df: Floats) -> Floats:
    """Difference, in standard errors, that a test at this level detects nine times in ten."""
    grid = np.linspace(df.min(), df.max(), 32)
    return np.asarray(np.interp(df, grid, critical_value(level, grid)) + _NINE_IN_TEN, np.float64)


def _ratio(a: Floats, b: Floats) -> dict[str, Any]:
    """Mean of `a` over that of `b`, and its 95 % confidence interval (by the delta method)."""
    above, below = float(a.mean()), float(b.mean())
    if above <= 0.0 or below <= 0.0:
        return {"mean_ratio": None, "mean_ratio_95": None}
    # The relative errors combine as those of a difference do.
    test = welch(a[:, None] / above, b[:, None] / below)
    ratio = above / below
    reach = ratio * float(test.error[0] * critical_value(0.05, test.df)[0])
    return {"mean_ratio": ratio, "mean_ratio_95": [ratio - reach, ratio + reach]}
