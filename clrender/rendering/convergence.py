"""The error of a render as its samples arrive: what a convergence plot is made of."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError, UsageError
from clrender.film.replicates import standard_error_of
from clrender.image.compare import relative_squared_error
from clrender.image.tone_map import LUMINANCE

if TYPE_CHECKING:
    from clrender.film import Film
    from clrender.rendering.rendered_image import Progress, RenderedImage

__all__ = ["METRICS", "ConvergenceRun", "ErrorMeasure", "Measured", "Metric"]

Metric: TypeAlias = Literal["rms", "relmse"]
METRICS: Final[tuple[Metric, ...]] = ("rms", "relmse")
_ROWS: Final = 64
"""Number of image rows from which the error is estimated."""
_GROWTH: Final = 1.12
"""Ratio of the samples of consecutive points: twenty points per decade."""
_SHARE: Final = 20.0
"""Least interval between two points, in multiples of the last one's duration: measuring must not slow the render."""

_Floats: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """State of a render at one point of the plot.

    Attributes
    ----------
    samples : float
        Mean samples per pixel.
    seconds : float
        Time since the first launch.
    error : float or None
        Error of the image in the metric of the plot; None if unknown.
    """

    samples: float
    seconds: float
    error: float | None


class ErrorMeasure:
    """Error of an image: its difference from a reference, or else the standard error of its pixels.

    Parameters
    ----------
    reference : (height, width, 3) floats or RenderedImage, optional
        Radiance of the same scene with a much smaller error.
    metric : {"rms", "relmse"}
        ``rms``: root mean square of the error of luminance, divided by the mean luminance. ``relmse``: the mean of the
        squared error over the squared radiance, as in `clrender.image.compare.relative_squared_error`.
    """

    def __init__(self, reference: npt.ArrayLike | RenderedImage | None, metric: Metric) -> None:
        if metric not in METRICS:
            raise UsageError(f"the metric is {metric!r}, but must be {' or '.join(METRICS)}")
        self.metric = metric
        self.reference = None if reference is None else _radiance(reference)

    def check(self, height: int, width: int) -> None:
        """Refuse an image of another size than the reference.

        Raises
        ------
        UsageError
        """
        if self.reference is not None and self.reference.shape[:2] != (height, width):
            rows, columns, _ = self.reference.shape
            raise UsageError(f"the reference has {columns} x {rows} pixels, but the image {width} x {height}")

    def of_film(self, film: Film) -> float | None:
        """Error of some rows of a film; None if one of their pixels has no error yet."""
        rows = _some_rows(film.height)
        if self.reference is None and not film.replicate_spp:
            return None
        if not film.counts[rows].all():
            return None
        try:
            errors = None if self.reference is not None else standard_error_of(film, rows)
            parts = [film.mean_of(slice(row, row + 1), slice(0, film.width)) for row in _each(rows)]
        except RenderError:  # the film was developed and its sums are released
            return None
        return self._of(np.concatenate(parts).astype(np.float64), errors, rows)

    def of_image(self, image: RenderedImage) -> float | None:
        """Error of some rows of an image; None without a reference and without the layer ``stderr``."""
        height, width, _ = image.linear.shape
        self.check(height, width)
        rows = _some_rows(height)
        errors = image.aovs.get("stderr")
        if self.reference is None and errors is None:
            return None
        found = image.linear[rows].astype(np.float64)
        return self._of(found, None if errors is None else errors[rows].astype(np.float64), rows)

    def _of(self, found: _Floats, errors: _Floats | None, rows: slice) -> float | None:
        if self.reference is not None:
            truth = self.reference[rows]
            errors = found - truth
        else:
            assert errors is not None
            truth = found
        if self.metric == "relmse":
            error = relative_squared_error(errors, truth)
        else:
            weights = np.asarray(LUMINANCE)
            mean = float((truth @ weights).mean())
            error = math.sqrt(float(np.mean((errors @ weights) ** 2))) / mean if mean > 0.0 else math.nan
        return error if math.isfinite(error) else None


class ConvergenceRun:
    """An ``on_progress`` callback that records one run of a plot.

    Parameters
    ----------
    measure : ErrorMeasure
    changed : callable
        Called after each point, with whether it is the last one.
    """

    def __init__(self, measure: ErrorMeasure, changed: Callable[[bool], None]) -> None:
        self._measure = measure
        self._changed = changed
        self._points: list[Measured] = []
        self._film: Film | None = None
        self._not_before = 0.0
        self._ended: float | None = None

    def __call__(self, progress: Progress) -> None:
        """Record the progress of a render; called by `Session.render`. A new render starts anew.

        Raises
        ------
        UsageError
            When the reference and the image have different sizes.
        """
        film = progress.film
        if film is None:
            return
        if self._film is not film:
            self._measure.check(film.height, film.width)
            self._film, self._not_before, self._ended = film, 0.0, None
            self._points.clear()
        now, samples = time.monotonic(), film.ledger.samples / (film.width * film.height)
        last = self._points[-1].samples if self._points else 0.0
        done = progress.samples_done >= progress.samples_total
        if done:
            self._ended = progress.seconds
        if samples <= last or not (done or (samples >= last * _GROWTH and now >= self._not_before)):
            return
        self._points.append(Measured(samples, progress.seconds, self._measure.of_film(film)))
        self._not_before = now + _SHARE * (time.monotonic() - now)
        self._changed(done)

    @property
    def points(self) -> list[Measured]:
        """The recorded points, in the order of samples."""
        self._complete()
        return list(self._points)

    def add(self, images: Iterable[RenderedImage]) -> None:
        """Add a point for each of some finished images: one render with few samples, one with more, and so on."""
        for image in images:
            stats = image.stats
            pixels = image.linear.shape[0] * image.linear.shape[1]
            point = Measured(stats["samples"] / pixels, stats["render_seconds"], self._measure.of_image(image))
            self._points.append(point)
        self._points.sort(key=lambda point: point.samples)

    def _complete(self) -> None:
        """Add a point for samples that were committed after the last call, when the devices were already done."""
        film = self._film
        if film is None or film.developed or self._ended is None:
            return
        samples = film.ledger.samples / (film.width * film.height)
        if samples > (self._points[-1].samples if self._points else 0.0):
            if self._points and self._points[-1].seconds == self._ended:
                self._points.pop()
            self._points.append(Measured(samples, self._ended, self._measure.of_film(film)))


def _some_rows(height: int) -> slice:
    return slice(0, height, max(1, height // _ROWS))


def _each(rows: slice) -> range:
    return range(*rows.indices(rows.stop))


def _radiance(reference: npt.ArrayLike | RenderedImage) -> _Floats:
    pixels = np.asarray(getattr(reference, "linear", reference), np.float64)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size or not np.isfinite(pixels).all():
        raise UsageError(
            f"the reference has the shape {pixels.shape}, but must be (height, width, 3) of finite numbers: radiance"
        )
    return pixels
