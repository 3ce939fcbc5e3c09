"""When a render is good enough: confidence intervals of its pixels, looked at a few times that are fixed beforehand.

Looking after every sample and stopping at the first good look would pick moments at which the error is underestimated.
Looks are therefore few, and each gets its share of the error probability (Bonferroni): the intervals of a pixel hold at
all looks together with the probability that was asked for. Shares do not depend on the most samples that are asked for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from clrender.film.film import Film
from clrender.film.replicates import pooled, replicate_counts, standard_error
from clrender.image.tone_map import LUMINANCE
from clrender.settings import FIRST_LOOK, SETTINGS, RenderSettings
from clrender.student import critical_value

__all__ = ["Convergence", "interval_of_mean", "judge", "level", "looks"]

_FLOOR_SHARE: Final = 0.1
"""Of the image's mean luminance: below it a pixel's error is not asked to fall with the pixel."""

_Floats = npt.NDArray[np.float64]


def looks(settings: RenderSettings) -> Iterator[int]:
    """Samples of each pixel at which its error is looked at: 16 replicates, then always twice as many, and at the end.

    They do not depend on the most samples, but for the last: more may be asked for later.
    """
    samples = FIRST_LOOK * (settings.replicate_spp or 1)
    while samples < settings.spp:
        yield samples
        samples *= 2
    yield settings.spp


def level(settings: RenderSettings) -> float:
    """Error probability of the intervals at each look: that of all, over as many looks as there can be."""
    most: int = SETTINGS["spp"].schema()["maximum"]
    return (1.0 - settings.confidence) / len(list(looks(dataclasses.replace(settings, spp=most))))


@dataclass(frozen=True)
class Convergence:
    """What a look found.

    Attributes
    ----------
    errors : (height, width, 3) float64
        Standard errors of the pixels' means, radiance; NaN where unknown.
    intervals : (height, width) float64
        Half of the confidence interval of each pixel's luminance.
    tolerances : (height, width) float64
        What they may be.
    unconverged : (height, width) bool
        Pixels that are not within it.
    wanted : float
        Share of the pixels that has to be.
    """

    errors: _Floats
    intervals: _Floats
    tolerances: _Floats
    unconverged: npt.NDArray[np.bool_]
    wanted: float

    @property
    def share(self) -> float:
        """Of the pixels, those within the tolerance."""
        return 1.0 - float(np.count_nonzero(self.unconverged)) / self.unconverged.size

    @property
    def reached(self) -> bool:
        """Whether these are enough."""
        return bool(np.count_nonzero(~self.unconverged) >= self.wanted * self.unconverged.size)


def judge(film: Film, settings: RenderSettings) -> Convergence:
    """Compare the error of each pixel with what `RenderSettings.error` allows.

    It follows from the exact contents of the film alone, so that it is the same wherever they came from.

    Parameters
    ----------
    film : Film
        With replicates.
    settings : RenderSettings
        With an error.

    Raises
    ------
    UsageError
        The film has no replicates.
    """
    assert settings.error is not None
    errors = standard_error(film)
    mean = film.mean().astype(np.float64)
    luminance = _luminance(mean)
    # What is rounded here could be off in its last digit on another machine
    floor = settings.error_floor or _FLOOR_SHARE * float(f"{luminance.mean():.6g}")
    scale = np.maximum(np.abs(luminance), floor)
    tolerances = settings.error * scale
    counts, inverse = np.unique(replicate_counts(film), return_inverse=True)
    quantiles = np.round(critical_value(level(settings), np.maximum(counts - 1.0, 1.0)), 6)
    # Channels of one pixel may depend on each other in any way: the error of their sum is at most that of all in step
    own, quantile = _luminance(errors), quantiles[inverse.reshape(luminance.shape)]
    intervals = quantile * pooled(own, scale)
    # Where nothing differs so far, nothing may have been found so far: neighbours tell
    unconverged = ~(intervals <= tolerances) | ((own == 0.0) & _around(~(quantile * own <= tolerances)))
    return Convergence(errors, intervals, tolerances, unconverged, settings.share)


def interval_of_mean(settings: RenderSettings, replicates: int, error: _Floats) -> _Floats:
    """Half of the confidence interval of the mean over the image, at the look at which a render ends.

    Of the level that pixels have, too: whoever ends a render by what is seen in it tends to do so where errors look
    small.

    Parameters
    ----------
    settings : RenderSettings
        With an error.
    replicates : int
        The fewest of a pixel; their number less one is taken for the degrees of freedom, which are more.
    error : (3,) float64
        Standard error of the mean.

    Returns
    -------
    (3,) float64
    """
    quantile: _Floats = critical_value(level(settings), np.float64(max(replicates - 1, 1)))
    return quantile * error


def _luminance(channels: _Floats) -> _Floats:
    r, g, b = LUMINANCE
    return np.asarray(r * channels[..., 0] + g * channels[..., 1] + b * channels[..., 2], np.float64)


def _around(marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Which pixels have a marked one among their eight neighbours, or are marked."""
    height, width = marked.shape
    padded = np.pad(marked, 1)
    around = np.zeros_like(marked)
    for row in range(3):
        for column in range(3):
            around |= padded[row : row + height, column : column + width]
    return around
