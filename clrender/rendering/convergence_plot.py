"""Convergence plot of a render for notebooks: error against samples and time."""

from __future__ import annotations

import contextlib
import importlib
import math
import secrets
import time
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from clrender.errors import RenderError, UsageError
from clrender.film.replicates import standard_error_of
from clrender.image.tone_map import LUMINANCE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from clrender.film import Film
    from clrender.rendering.rendered_image import Progress, RenderedImage

__all__ = ["ConvergencePlot", "Measured"]

_ROWS: Final = 64
"""Number of image rows from which the error is estimated."""
_GROWTH: Final = 1.12
"""Ratio of the samples of consecutive points: twenty points per decade."""
_REDRAW_SECONDS: Final = 1.0
_SHARE: Final = 20.0
"""Least interval between two updates, in multiples of the last update's duration: updates must not slow the render."""


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
        Root mean square error of luminance, relative to the image's mean luminance; None if unknown.
    """

    samples: float
    seconds: float
    error: float | None


class ConvergencePlot:
    """An ``on_progress`` callback that records the convergence of a render and displays it as a plot in a notebook.

    The error is the standard error of the replicates or the difference from a reference. Without both, samples are
    plotted over time. Drawing needs Matplotlib (the extra `notebook`).

    Parameters
    ----------
    reference : (height, width, 3) float32 array or RenderedImage, optional
        Radiance of the same scene with a much smaller error than the render.
    live : bool
        Show the plot in the cell from the first sample on, and update it during the render.

    Examples
    --------
    >>> plot = clrender.ConvergencePlot()  # doctest: +SKIP
    >>> image = clrender.render(scene, spp=1024, replicate_spp=16, on_progress=plot)  # doctest: +SKIP
    >>> plot  # doctest: +SKIP
    """

    def __init__(self, reference: npt.ArrayLike | RenderedImage | None = None, *, live: bool = False) -> None:
        self._points: list[Measured] = []
        self._name = f"convergence-{secrets.token_hex(4)}"
        self._film: Film | None = None
        self._reference = None if reference is None else _luminance_of_reference(reference)
        self._live = live
        self._handle: Any = None
        self._not_before = self._drawn = 0.0
        self._ended: float | None = None

    def __repr__(self) -> str:
        points = self.points
        last = points[-1] if points else None
        told = "" if last is None else f", {last.samples:.4g} samples per pixel after {last.seconds:.3g} s"
        error = "" if last is None or last.error is None else f", relative error {last.error:.3g}"
        return f"<clrender.ConvergencePlot, {len(points)} points{told}{error}>"

    def __call__(self, progress: Progress) -> None:
        """Record the progress of a render; called by `Session.render`. A new render starts a new plot.

        Raises
        ------
        UsageError
            When the reference and the image have different sizes.
        """
        film = progress.film
        if film is None:
            return
        if self._film is not film:
            self._check_reference(film)
            self._film, self._not_before, self._ended = film, 0.0, None
            self._points.clear()
        now, samples = time.monotonic(), film.ledger.samples / (film.width * film.height)
        last = self._points[-1].samples if self._points else 0.0
        done = progress.samples_done >= progress.samples_total
        if done:
            self._ended = progress.seconds
        if samples <= last or not (done or (samples >= last * _GROWTH and now >= self._not_before)):
            return
        self._points.append(Measured(samples, progress.seconds, self._error(film)))
        self._not_before = now + _SHARE * (time.monotonic() - now)
        if self._live and (done or now >= self._drawn):
            self._show()
            self._drawn = time.monotonic() + max(_REDRAW_SECONDS, _SHARE * (time.monotonic() - now))

    @property
    def points(self) -> list[Measured]:
        """The recorded points, in the order of samples."""
        self._complete()
        return list(self._points)

    def _complete(self) -> None:
        """Add a point for samples that were committed after the last call, when the devices were already done."""
        film = self._film
        if film is None or film.developed or self._ended is None:
            return
        samples = film.ledger.samples / (film.width * film.height)
        if samples > (self._points[-1].samples if self._points else 0.0):
            if self._points and self._points[-1].seconds == self._ended:
                self._points.pop()
            self._points.append(Measured(samples, self._ended, self._error(film)))

    def _check_reference(self, film: Film) -> None:
        if self._reference is not None and self._reference.shape != (film.height, film.width):
            height, width = self._reference.shape
            raise UsageError(f"the reference has {width} x {height} pixels, but the image {film.width} x {film.height}")

    def _error(self, film: Film) -> float | None:
        """Root mean square error of some rows; None if one of their pixels has no error yet."""
        rows = slice(0, film.height, max(1, film.height // _ROWS))
        weights = np.asarray(LUMINANCE)
        if self._reference is not None:
            if not film.counts[rows].all():
                return None
            wanted = self._reference[rows]
            found = np.concatenate([film.mean_of(slice(row, row + 1), slice(0, film.width)) for row in _each(rows)])
            distances, mean = found @ weights - wanted, float(wanted.mean())
        elif film.replicate_spp:
            try:
                distances = standard_error_of(film, rows) @ weights
            except RenderError:  # the film was developed and its sums are released
                return None
            mean = float((film.snapshot(_ROWS) @ weights).mean())
        else:
            return None
        error = math.sqrt(float(np.mean(distances**2))) / mean if mean > 0.0 else math.nan
        return error if math.isfinite(error) else None

    # --- what a notebook shows ---

    def _show(self) -> None:
        if self._handle is not None:
            self._handle.update(self)
            return
        with contextlib.suppress(ImportError):  # outside of a notebook
            self._handle = importlib.import_module("IPython.display").display(self, display_id=True)

    def _repr_html_(self) -> str:
        if not self.points:
            return "<p>No sample yet: give the plot to a render as <code>on_progress</code>.</p>"
        try:
            return f'<div style="max-width: 52rem">{self.svg()}</div>'
        except UsageError as error:  # a table is better than a traceback
            return f"<p>{escape(str(error))}</p>{self._table()}"

    def svg(self) -> str:
        """The plot as one SVG element.

        Raises
        ------
        UsageError
            When there is no sample yet, or Matplotlib is not installed.
        """
        if not self.points:
            raise UsageError("there is nothing to plot yet; give the plot to a render as on_progress")
        from clrender.drawing.svg import draw

        known = any(point.error is not None for point in self.points)
        title = "Relative error of the image over samples and time" if known else "Samples per pixel over time"
        return draw(self._name, title, (9.0, 3.2) if known else (6.0, 3.2), self._paint)

    def _paint(self, figure: Figure) -> None:
        known = [point for point in self.points if point.error is not None and point.error > 0.0]
        if not known:
            axes = figure.add_subplot()
            _curve(axes, self.points, "seconds", "samples")
            axes.set(xlabel="seconds", ylabel="samples per pixel")
            axes.grid(True)
            return
        left, right = figure.subplots(1, 2, sharey=True)
        _curve(left, known, "samples", "error")
        _slope(left, known)
        _curve(right, known, "seconds", "error")
        left.set(xlabel="samples per pixel", ylabel="relative error (RMS)")
        right.set(xlabel="seconds")
        for axes in (left, right):
            axes.set(xscale="log", yscale="log")
            axes.grid(True, which="both")

    def _table(self) -> str:
        points = self.points
        shown = points[:: max(1, len(points) // 12)]
        rows = "".join(
            f"<tr><td>{p.samples:.4g}</td><td>{p.seconds:.3g}</td>"
            f"<td>{'' if p.error is None else f'{p.error:.3g}'}</td></tr>"
            for p in shown
        )
        return f"<table><tr><th>samples per pixel</th><th>seconds</th><th>relative error</th></tr>{rows}</table>"


def _curve(axes: Axes, points: list[Measured], across: str, up: str) -> None:
    from clrender.drawing.svg import BLUE

    axes.plot([getattr(p, across) for p in points], [getattr(p, up) for p in points], "o-", color=BLUE)


def _slope(axes: Axes, points: list[Measured]) -> None:
    """Draw the expected slope: the error of independent samples falls with the square root of their number."""
    from clrender.drawing.svg import GREY

    ends = [points[0].samples, points[-1].samples]
    assert points[-1].error is not None
    errors = [points[-1].error * math.sqrt(ends[1] / end) for end in ends]
    axes.plot(ends, errors, "--", color=GREY, label="1 / √samples")
    axes.legend()


def _each(rows: slice) -> range:
    return range(*rows.indices(rows.stop))


def _luminance_of_reference(reference: npt.ArrayLike | RenderedImage) -> npt.NDArray[np.float64]:
    pixels = np.asarray(getattr(reference, "linear", reference), np.float64)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size or not np.isfinite(pixels).all():
        raise UsageError(
            f"the reference has the shape {pixels.shape}, but must be (height, width, 3) of finite numbers: radiance"
        )
    luminance: npt.NDArray[np.float64] = pixels @ np.asarray(LUMINANCE)
    return luminance
