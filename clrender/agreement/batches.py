"""Independent batches of two integrators' images compared, tile by tile, by t-tests.

Samples of one image are stratified against each other, so their spread says nothing of the error of their mean. Images
of different seeds are independent, however, and the means of their tiles close to normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.agreement.verdict import Verdict, verdict
from clrender.agreement.welch import holm, outlying, student_limit, welch

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["LEVEL", "Batches", "Pair", "compare_batches", "tile_means"]

Floats = npt.NDArray[np.float64]

LEVEL: Final = 0.01
"""Chance that any of the pairs compared at once is said to differ although no two do."""
_ROUNDING: Final = 64 * 2.0**-24
"""Relative difference that is not told from rounding in single precision, 3.8e-6: a few dozen operations."""
_FIREFLIES: Final = 1e-4
"""Chance that a tile of normal noise is said to have fireflies."""
_NINE_IN_TEN: Final = 1.2816
"""Standard errors beyond the limit at which a difference is seen nine times in ten."""


@dataclass(frozen=True)
class Batches:
    """What one integrator made of a scene.

    Attributes
    ----------
    label : str
        Its name, with a number where it is compared with itself.
    name : str
        In `clrender.integrators.INTEGRATORS`.
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
    """Two integrators compared; `first` minus `second` where there is a sign.

    Attributes
    ----------
    first, second : str
        Labels.
    scores : (rows, columns) float64
        z of the channel that differs most, of each tile.
    numbers : dict
        JSON-able: mean_ratio and its interval, mean_chance, tiles, tiles_differ, tiles_darker, tiles_brighter,
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


def compare_batches(scene: Scene, a: Batches, b: Batches, level: float = LEVEL) -> Pair:
    """Test whether two sets of batches have the same means, in every tile and over the whole image.

    Half of `level` is for the tiles and their channels, by Welch's t-test and Holm's correction; half for the whole
    image, in which a small difference everywhere shows that no tile can show.

    Where light is found rarely but then much of it, a tile that lacks it by chance is dark and shows hardly any spread:
    an integrator with more noise would look darker than one with less. Its neighbours have had that light, so a tile
    counts as no less noisy than the mean of those around it.

    Parameters
    ----------
    scene : Scene
    a, b : Batches
    level : float
        Chance that they are found to differ although they do not, as long as the means of tiles are normal.
    """
    shape = a.tiles.shape[1:]
    x, y = a.tiles.reshape(len(a.tiles), -1), b.tiles.reshape(len(b.tiles), -1)
    size = (x.mean(axis=0) + y.mean(axis=0)) / 2.0
    tiles = welch(x, y, _ROUNDING * size, (_variance_around(a.tiles).ravel(), _variance_around(b.tiles).ravel()))
    differ = holm(tiles.chance, level / 2.0)
    whole = welch(a.whole[:, None], b.whole[:, None], _ROUNDING * (a.whole.mean() + b.whole.mean()) / 2.0)
    whole_differs = bool(whole.chance[0] <= level / 2.0)

    def any_channel(marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        return np.asarray(marked.reshape(shape).any(axis=2), np.bool_)

    darker, brighter = any_channel(differ & (tiles.score < 0.0)), any_channel(differ & (tiles.score > 0.0))
    scores = tiles.score.reshape(shape)
    largest = np.take_along_axis(scores, np.abs(scores).argmax(axis=2)[..., None], axis=2)[..., 0]
    row, column = np.unravel_index(int(np.abs(largest).argmax()), largest.shape)
    lit = size > 0.0
    seen = _limit(level / 2.0 / len(size), tiles.freedom) * tiles.error + _ROUNDING * size
    mean_seen = float((_limit(level / 2.0, whole.freedom) * whole.error)[0])
    numbers = {
        **_ratio(a.whole, b.whole),
        "mean_chance": float(whole.chance[0]),
        "tiles": int(largest.size),
        "tiles_differ": int(np.count_nonzero(darker | brighter)),
        "tiles_darker": int(np.count_nonzero(darker)),
        "tiles_brighter": int(np.count_nonzero(brighter)),
        "largest_z": float(largest[row, column]),
        "largest_z_tile": [int(column), int(row)],
        "visible_in_tile": float(np.median(seen[lit] / size[lit])) if lit.any() else None,
        "visible_in_mean": mean_seen / float(b.whole.mean()) + _ROUNDING if b.whole.any() else None,
        "tiles_with_fireflies": int(np.count_nonzero(any_channel(outlying(x, _FIREFLIES) | outlying(y, _FIREFLIES)))),
    }
    below = bool(darker.any()) or (whole_differs and whole.score[0] < 0.0)
    above = bool(brighter.any()) or (whole_differs and whole.score[0] > 0.0)
    return Pair(a.label, b.label, largest, numbers, verdict(a.name, b.name, scene, below, above))


def _variance_around(tiles: Floats) -> Floats:
    """Mean of the variances of a tile and its neighbours, of each channel; (rows, columns, 3)."""
    variance = np.pad(tiles.var(axis=0, ddof=1), ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    around: Floats = np.nanmean(np.lib.stride_tricks.sliding_window_view(variance, (3, 3), axis=(0, 1)), axis=(-2, -1))
    return around


def _limit(chance: float, freedom: Floats) -> Floats:
    """Standard errors that a difference has to have to be seen nine times in ten, at this significance."""
    grid = np.linspace(freedom.min(), freedom.max(), 32)
    return np.asarray(np.interp(freedom, grid, student_limit(chance, grid)) + _NINE_IN_TEN, np.float64)


def _ratio(a: Floats, b: Floats) -> dict[str, Any]:
    """Mean of `a` over that of `b`, and the interval that holds it with 95 % (by the delta method)."""
    above, below = float(a.mean()), float(b.mean())
    if above <= 0.0 or below <= 0.0:
        return {"mean_ratio": None, "mean_ratio_95": None}
    # The relative errors add up as those of a difference do.
    test = welch(a[:, None] / above, b[:, None] / below)
    ratio = above / below
    reach = ratio * float(test.error[0] * student_limit(0.05, test.freedom)[0])
    return {"mean_ratio": ratio, "mean_ratio_95": [ratio - reach, ratio + reach]}
