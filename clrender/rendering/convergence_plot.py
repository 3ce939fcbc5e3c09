"""Convergence plot of one or several renders for notebooks: error against samples and time."""

from __future__ import annotations

import contextlib
import importlib
import math
import secrets
import time
from collections.abc import Iterable, Mapping
from html import escape
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

import numpy.typing as npt

from clrender.drawing.axes import log_axis, plain_number
from clrender.errors import UsageError
from clrender.rendering.convergence import ConvergenceRun, ErrorMeasure, Measured, Metric
from clrender.wording import counted, rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from clrender.rendering.rendered_image import Progress, RenderedImage

__all__ = ["ConvergencePlot", "Measured"]

_REDRAW_SECONDS: Final = 1.0
_SHARE: Final = 20.0
"""Least interval between two drawings, in multiples of the last one's duration: they must not slow the render."""
_TABLE_ROWS: Final = 12
_NAMES: Final[Mapping[Metric, tuple[str, str]]] = {
    "rms": ("relative error (RMS)", "slope −1/2: 1 / √samples"),
    "relmse": ("relative squared error (relMSE)", "slope −1: 1 / samples"),
}
"""Axis title and expected slope of each metric."""
_SLOPES: Final[Mapping[Metric, float]] = {"rms": -0.5, "relmse": -1.0}


class ConvergencePlot:
    """An ``on_progress`` callback that records the convergence of a render and displays it as a plot in a notebook.

    The error is the difference from a reference, or without one the standard error from the replicates. Without both,
    samples are plotted over time. A dashed grey line has the slope of independent samples. Several renders are compared
    in one plot by `run` or `add`. Drawing needs Matplotlib (the extra `notebook`).

    Parameters
    ----------
    reference : (height, width, 3) float32 array or RenderedImage, optional
        Radiance of the same scene with a much smaller error than the render.
    live : bool
        Show the plot in the cell from the first sample on, and update it during the render.
    metric : {"rms", "relmse"}
        ``rms``: root mean square of the error of luminance, relative to the mean luminance. ``relmse``: mean of the
        squared error over the squared radiance, as of ``clrender compare``.

    Examples
    --------
    >>> plot = clrender.ConvergencePlot()  # doctest: +SKIP
    >>> image = clrender.render(scene, spp=1024, replicate_spp=16, on_progress=plot)  # doctest: +SKIP
    >>> plot  # doctest: +SKIP

    >>> plot = clrender.ConvergencePlot(reference)  # doctest: +SKIP
    >>> for name in ("path", "bdpt", "photon"):  # doctest: +SKIP
    ...     clrender.render(scene, integrator=name, spp=256, on_progress=plot.run(name))
    >>> plot  # doctest: +SKIP
    """

    def __init__(
        self,
        reference: npt.ArrayLike | RenderedImage | None = None,
        *,
        live: bool = False,
        metric: Metric = "rms",
    ) -> None:
        self._measure = ErrorMeasure(reference, metric)
        self._runs: dict[str, ConvergenceRun] = {}
        self._last = ""
        self._name = f"convergence-{secrets.token_hex(4)}"
        self._live = live
        self._handle: Any = None
        self._drawn = 0.0

    def __repr__(self) -> str:
        runs = self.runs
        if set(runs) <= {""}:
            return f"<clrender.ConvergencePlot, {_summary(runs.get('', []))}>"
        return f"<clrender.ConvergencePlot; {'; '.join(f'{name}: {_summary(runs[name])}' for name in runs)}>"

    def __call__(self, progress: Progress) -> None:
        """Record the progress of a render; called by `Session.render`. A new render replaces the one before.

        Raises
        ------
        UsageError
            When the reference and the image have different sizes.
        """
        run = self._runs.get("") or self.run("")
        self._last = ""
        run(progress)

    def run(self, label: str) -> ConvergenceRun:
        """An ``on_progress`` callback for one of several renders in this plot.

        Parameters
        ----------
        label : str
            Name in the legend. A render of the same name replaces the one before.

        Returns
        -------
        ConvergenceRun
        """
        self._last = label
        self._runs[label] = ConvergenceRun(self._measure, self._update)
        return self._runs[label]

    def add(self, label: str, images: Iterable[RenderedImage] | RenderedImage) -> None:
        """Plot finished images, a point for each: one with few samples, one with more, and so on.

        Renders of their own have points at exactly these samples; a single render has them where the devices report.

        Parameters
        ----------
        label : str
            Name in the legend. Images of the same name are added to those before.
        images : RenderedImage or sequence of RenderedImage
            Without a reference they need the layer ``stderr``, or their error is unknown.

        Raises
        ------
        UsageError
            When the reference and an image have different sizes.
        """
        from clrender.rendering.rendered_image import RenderedImage

        run = self._runs.get(label) or self.run(label)
        self._last = label
        run.add([images] if isinstance(images, RenderedImage) else images)

    @property
    def points(self) -> list[Measured]:
        """The points of the last run, in the order of samples."""
        return self.runs.get(self._last, [])

    @property
    def runs(self) -> dict[str, list[Measured]]:
        """The points of each run by its label; the label is empty if the plot itself was the callback."""
        return {label: run.points for label, run in self._runs.items()}

    # --- what a notebook shows ---

    def _update(self, done: bool) -> None:
        now = time.monotonic()
        if self._live and (done or now >= self._drawn):
            self._show()
            self._drawn = time.monotonic() + max(_REDRAW_SECONDS, _SHARE * (time.monotonic() - now))

    def _show(self) -> None:
        if self._handle is not None:
            self._handle.update(self)
            return
        with contextlib.suppress(ImportError):  # outside of a notebook
            self._handle = importlib.import_module("IPython.display").display(self, display_id=True)

    def _repr_html_(self) -> str:
        runs = self._drawable()
        if not runs:
            return "<p>No sample yet: give the plot to a render as <code>on_progress</code>.</p>"
        try:
            return (
                f'<div style="max-width: 56rem">{self.svg()}</div>'
                f"<details><summary>Numbers</summary>{_table(runs)}</details>"
            )
        except UsageError as error:  # a table is better than a traceback
            return f"<p>{escape(str(error))}</p>{_table(runs)}"

    def svg(self) -> str:
        """The plot as one SVG element, with a description for screen readers.

        Raises
        ------
        UsageError
            When there is no sample yet, or Matplotlib is not installed.
        """
        runs = self._drawable()
        if not runs:
            raise UsageError("there is nothing to plot yet; give the plot to a render as on_progress")
        from clrender.drawing.svg import draw

        known = _with_errors(runs)
        title = "Error of the image over samples and time" if known else "Samples per pixel over time"
        size = (9.4, 3.9) if known else (6.4, 3.6)
        return draw(self._name, title, size, self._paint, self.description)

    @property
    def description(self) -> str:
        """What the plot shows, in words: each run's first and last error."""
        runs = self._drawable()
        known = _with_errors(runs)
        parts = []
        for label, points in (known or runs).items():
            first, last = points[0], points[-1]
            name = f"{label}: " if label else ""
            if known:
                course = f"{self._number(first)} with {_samples(first)}"
                course += f" to {self._number(last)} with {_samples(last)}" if last is not first else ""
                parts.append(f"{name}{course}, in {rounded(last.seconds)} seconds.")
            else:
                parts.append(f"{name}{_samples(last)} in {rounded(last.seconds)} seconds.")
        name = _NAMES[self._measure.metric][0]
        return " ".join([f"{name[0].upper()}{name[1:]}.", *parts] if known else parts)

    def _number(self, point: Measured) -> str:
        assert point.error is not None
        return plain_number(float(f"{point.error:.3g}"), self._measure.metric == "rms")

    def _drawable(self) -> dict[str, list[Measured]]:
        return {label: points for label, points in self.runs.items() if points}

    def _paint(self, figure: Figure) -> None:
        from clrender.drawing.svg import line_style

        runs = self._drawable()
        known = _with_errors(runs)
        if not known:
            axes = figure.add_subplot(xlabel="seconds", ylabel="samples per pixel")
            for number, (label, points) in enumerate(runs.items()):
                _curve(axes, points, "seconds", "samples", label, line_style(number))
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_formatter(lambda value, _: plain_number(value))
        else:
            metric = self._measure.metric
            name, slope = _NAMES[metric]
            axes, right = figure.subplots(1, 2, sharey=True)
            for number, (label, points) in enumerate(known.items()):
                _curve(axes, points, "samples", "error", label, line_style(number))
                _curve(right, [p for p in points if p.seconds > 0.0], "seconds", "error", label, line_style(number))
            every = list(chain.from_iterable(known.values()))
            last = next(iter(known.values()))[-1]
            for panel, across, title in ((axes, "samples", "samples per pixel"), (right, "seconds", "seconds")):
                values = [value for p in every if (value := getattr(p, across)) > 0.0] or [1.0]
                if getattr(last, across) > 0.0:
                    _guide(panel, values, (getattr(last, across), last.error or 1.0), _SLOPES[metric], slope)
                log_axis(panel, "x", values)
                panel.set_xlabel(title)
                panel.grid(True)
            log_axis(axes, "y", [p.error for p in every if p.error], metric == "rms")
            axes.set_ylabel(name)
            right.grid(True)
        axes.grid(True)
        handles, labels = axes.get_legend_handles_labels()
        if labels:
            figure.legend(handles, labels, loc="outside upper left", ncols=5, handlelength=3.2)


def _with_errors(runs: Mapping[str, list[Measured]]) -> dict[str, list[Measured]]:
    """Those points that a logarithmic axis can show, of the runs that have any."""
    found = {label: [p for p in points if p.error is not None and p.error > 0.0] for label, points in runs.items()}
    return {label: points for label, points in found.items() if points}


def _samples(point: Measured) -> str:
    number = rounded(point.samples, 4)
    return f"{number} sample{'' if number == '1' else 's'} per pixel"


def _curve(axes: Axes, points: list[Measured], across: str, up: str, label: str, style: Any) -> None:
    axes.plot(
        [getattr(p, across) for p in points], [getattr(p, up) for p in points], color=style.color,
        linestyle=style.linestyle, marker=style.marker, label=label or None,
    )  # fmt: skip


def _guide(axes: Axes, values: list[float], through: tuple[float, float], slope: float, label: str) -> None:
    """Draw the expected slope, a straight line: the variance of independent samples falls with their number."""
    from clrender.drawing.svg import GREY

    ends = [min(values), max(values)]
    x, y = through
    axes.plot(ends, [y * math.pow(end / x, slope) for end in ends], "--", color=GREY, linewidth=1.0, label=label)


def _summary(points: list[Measured]) -> str:
    last = points[-1] if points else None
    told = "" if last is None else f", {_samples(last)} after {rounded(last.seconds)} s"
    error = "" if last is None or last.error is None else f", relative error {last.error:.3g}"
    return f"{counted(len(points), 'point')}{told}{error}"


def _table(runs: Mapping[str, list[Measured]]) -> str:
    named = set(runs) != {""}
    known = any(p.error is not None for points in runs.values() for p in points)
    rows = []
    for label, points in runs.items():
        step = max(1, len(points) // _TABLE_ROWS)
        for p in points[(len(points) - 1) % step :: step]:  # the last one among them
            cells = [label] if named else []
            cells += [rounded(p.samples, 4), rounded(p.seconds)]
            cells += ["" if p.error is None else f"{p.error:.3g}"] if known else []
            rows.append(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    header = [*(["run"] if named else []), "samples per pixel", "seconds", *(["relative error"] if known else [])]
    head = "".join(f'<th scope="col">{each}</th>' for each in header)
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"
