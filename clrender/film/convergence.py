"""Error criterion: confidence intervals of the pixels are tested at a few sample counts that are fixed in advance.

Testing after every sample and stopping at the first success would favour moments at which the error is underestimated.
So there are few tests, and each gets its share of the error probability (Bonferroni correction): a pixel's intervals
are valid at all tests simultaneously with the requested probability. The shares do not depend on the requested maximum
of samples.
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
from clrender.statistics.student_t import critical_value

__all__ = ["Convergence", "interval_of_mean", "judge", "level", "looks"]

_FLOOR_SHARE: Final = 0.1
"""Default floor, relative to the image's mean luminance: for darker pixels the tolerance no longer decreases."""

_Floats = npt.NDArray[np.float64]


def looks(settings: RenderSettings) -> Iterator[int]:
    """Sample counts per pixel at which the error is tested: 16 replicates, repeatedly doubled, and the maximum.

    Except for the last, they do not depend on the maximum, as more samples may be requested later.
    """
    samples = FIRST_LOOK * (settings.replicate_spp or 1)
    while samples < settings.spp:
        yield samples
        samples *= 2
    yield settings.spp


def level(settings: RenderSettings) -> float:
    """Error probability of the intervals at each test: the total divided by the largest possible number of tests."""
    most: int = SETTINGS["spp"].schema()["maximum"]
    return (1.0 - settings.confidence) / len(list(looks(dataclasses.replace(settings, spp=most))))


@dataclass(frozen=True)
class Convergence:
    """Result of a test of the error criterion.

    Attributes
    ----------
    errors : (height, width, 3) float64
        Standard errors of the pixels' means, radiance; NaN where unknown.
    intervals : (height, width) float64
        Half-width of the confidence interval of each pixel's luminance.
    tolerances : (height, width) float64
        Largest allowed half-widths.
    unconverged : (height, width) bool
        Pixels that exceed their tolerance.
    wanted : float
        Required share of the pixels within their tolerance.
    """

    errors: _Floats
    intervals: _Floats
    tolerances: _Floats
    unconverged: npt.NDArray[np.bool_]
    wanted: float

    @property
    def share(self) -> float:
        """Share of the pixels within their tolerance."""
        return 1.0 - float(np.count_nonzero(self.unconverged)) / self.unconverged.size

    @property
    def reached(self) -> bool:
        """Whether this share is large enough."""
        return bool(np.count_nonzero(~self.unconverged) >= self.wanted * self.unconverged.size)


def judge(film: Film, settings: RenderSettings) -> Convergence:
    """Compare the error of each pixel with the limit `RenderSettings.error`.

    The result depends only on the exact contents of the film, so it is the same on every machine.

    Parameters
    ----------
    film : Film
        A film with replicates.
    settings : RenderSettings
        Settings with `error`.

    Raises
    ------
    UsageError
        When the film has no replicates.
    """
    assert settings.error is not None
    errors = standard_error(film)
    mean = film.mean().astype(np.float64)
    luminance = _luminance(mean)
    # Rounded, because the mean could differ in its last digit on another machine
    floor = settings.error_floor or _FLOOR_SHARE * float(f"{luminance.mean():.6g}")
    scale = np.maximum(np.abs(luminance), floor)
    tolerances = settings.error * scale
    counts, inverse = np.unique(replicate_counts(film), return_inverse=True)
    quantiles = np.round(critical_value(level(settings), np.maximum(counts - 1.0, 1.0)), 6)
    # Channels of a pixel may be correlated: the error of their sum is at most that for full correlation
    own, quantile = _luminance(errors), quantiles[inverse.reshape(luminance.shape)]
    intervals = quantile * pooled(own, scale)
    # A variance of zero may mean that no light was found yet, so such pixels are judged by their neighbours
    unconverged = ~(intervals <= tolerances) | ((own == 0.0) & _around(~(quantile * own <= tolerances)))
    return Convergence(errors, intervals, tolerances, unconverged, settings.share)


def interval_of_mean(settings: RenderSettings, replicates: int, error: _Floats) -> _Floats:
    """Half-width of the confidence interval of the mean over the image, at the test at which a render ends.

    It has the same level as the intervals of pixels, because a stopping rule tends to stop when errors look small.

    Parameters
    ----------
    settings : RenderSettings
        Settings with `error`.
    replicates : int
        Smallest number of replicates of any pixel. This number minus one is a lower bound of the degrees of freedom.
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
    """Dilate a mask: pixels that are marked or have a marked pixel among their eight neighbours."""
    height, width = marked.shape
    padded = np.pad(marked, 1)
    around = np.zeros_like(marked)
    for row in range(3):
        for column in range(3):
            around |= padded[row : row + height, column : column + width]
    return around
