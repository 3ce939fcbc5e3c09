"""A page that compares two images: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from clrender.drawing.html import html_document, html_table, paragraphs
from clrender.drawing.pictures import data_uri, diverging, figure_of, shrunk, slider
from clrender.drawing.svg import BLUE, ORANGE, draw, require_matplotlib
from clrender.drawing.table import Table
from clrender.image.flip import flip_map
from clrender.image.tone_map import LUMINANCE, to_display
from clrender.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["compare_page"]

_MOST: Final = 1600
"""Largest longer side of an image in the page, pixels."""

_EXTREME: Final = 99.0
"""Percentile of the differences that gets the strongest colour."""

_Floats = npt.NDArray[np.float64]


def compare_page(
    names: tuple[str, str], image: npt.ArrayLike, reference: npt.ArrayLike, lines: Sequence[Sequence[str]]
) -> str:  # fmt: skip
    """The page.

    Parameters
    ----------
    names : (str, str)
        Names of the image and of its reference.
    image, reference : (H, W, 3) floats
        Radiance, linear Rec. 709, finite, of equal size.
    lines : sequence of (str, str)
        Metrics and their values.

    Raises
    ------
    UsageError
        If Matplotlib is not installed.
    """
    require_matplotlib()
    a, b = (np.asarray(each, np.float32) for each in (image, reference))
    flip, difference = flip_map(a, b), (a - b) @ np.array(LUMINANCE)
    strongest = float(np.percentile(np.abs(difference), _EXTREME)) or float(np.abs(difference).max()) or 1.0
    height, width, _ = a.shape
    shown = shrunk(a, _MOST)
    how = [f"Image A, {names[0]}, and reference B, {names[1]}: {width} × {height} pixels. clrender {__version__}."]
    if shown.shape != a.shape:
        how.append(f"They are shown at {shown.shape[1]} × {shown.shape[0]} pixels; the numbers are for the full size.")
    parts = [
        *paragraphs(how),
        figure_of(
            slider(to_display(shown), to_display(shrunk(b, _MOST)), ("A", "B")),
            "A on the left of the divider, B on the right, tone-mapped to sRGB. Move the divider by dragging or with "
            "the arrow keys.",
        ),
        '<div class="row" style="--columns: 2">',
        figure_of(
            _map(diverging(shrunk(difference, _MOST) / strongest), "difference of luminance")
            + _scale(f"{-strongest:.3g}", f"{strongest:.3g}", "#00f, #fff, #f00"),
            f"Luminance of A minus that of B, W/(sr m²): red where A is brighter. {_EXTREME:g} % of the pixels are "
            "within the colour scale.",
        ),
        figure_of(
            _map(_heat(shrunk(flip, _MOST)), "FLIP") + _scale("0", "1", _gradient()),
            f"FLIP: perceived difference when alternating between A and B; mean {flip.mean():.4f}.",
        ),
        "</div>",
        "<h2>Numbers</h2>",
        html_table(
            Table("Means over pixels and channels; docs/reference.md has the formulas.", ("", ""), lines), "", []
        ),
        "<h2>Histograms</h2>",
        figure_of(_histograms(a, b, flip), "Distributions of luminance and of FLIP over the pixels."),
    ]
    return html_document(f"{names[0]} and {names[1]}", parts)


def _map(pixels: npt.NDArray[np.uint8], words: str) -> str:
    return (
        f'<img src="{data_uri(pixels, lossless=True)}" width="{pixels.shape[1]}" height="{pixels.shape[0]}" '
        f'alt="{escape(words)}">'
    )


def _scale(low: str, high: str, colors: str) -> str:
    return (
        f'<div class="scale" style="--colors: linear-gradient(90deg, {colors})"><span>{escape(low)}</span><i></i>'
        f"<span>{escape(high)}</span></div>"
    )


def _heat(values: _Floats) -> npt.NDArray[np.uint8]:
    """Colour map for numbers from 0 to 1, as in the FLIP paper."""
    from matplotlib import colormaps

    return np.asarray(colormaps["magma"](np.clip(values, 0.0, 1.0), bytes=True)[..., :3], np.uint8)


def _gradient() -> str:
    return ", ".join("#" + bytes(color).hex() for color in _heat(np.linspace(0.0, 1.0, 9)))


def _histograms(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32], flip: _Floats) -> str:
    """Histograms of log luminance and of FLIP, as SVG."""
    luminance = [each.astype(np.float64) @ np.array(LUMINANCE) for each in (a, b)]
    lit = np.concatenate([each[each > 0.0] for each in luminance])
    low, high = np.percentile(lit, (0.1, 100.0)) if lit.size else (0.1, 1.0)
    bins = np.geomspace(low, max(high, 1.01 * low), 80)

    def paint(figure: Figure) -> None:
        left: Axes
        right: Axes
        left, right = figure.subplots(1, 2)
        for values, drawn, name in zip(luminance, (BLUE, ORANGE), "AB", strict=True):
            left.stairs(np.histogram(values, bins)[0] / values.size, bins, color=drawn, label=name, linewidth=1.4)
        left.set_xscale("log")
        left.set_xlabel("luminance, W/(sr m²)")
        left.set_ylabel("fraction of the pixels")
        left.legend()
        edges = np.linspace(0.0, max(float(flip.max()), 1e-3), 60)
        right.stairs(np.histogram(flip, edges)[0] / flip.size, edges, color=BLUE, fill=True, alpha=0.6)
        right.axvline(float(flip.mean()), color=ORANGE, label="mean")
        right.set_xlabel("FLIP")
        right.set_yscale("log")
        right.legend()
        for axes in (left, right):
            axes.grid(axis="y")

    return draw("histograms", "Histograms of luminance and of FLIP", (8.4, 3.4), paint)
