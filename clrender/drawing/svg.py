"""Matplotlib figures as SVG in one style, light and dark: text stays text, and output is reproducible."""

from __future__ import annotations

import importlib
import io
import logging
import re
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final

from clrender.errors import UsageError
from clrender.extras import install_command, missing_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "EDGE",
    "GREY",
    "INK",
    "ORANGE",
    "PAPER",
    "RULE",
    "LineStyle",
    "draw",
    "line_style",
    "require_matplotlib",
]

PAPER: Final = "#fdfdfd"
INK: Final = "#222222"
EDGE: Final = "#888888"
RULE: Final = "#dddddd"
BLUE: Final = "#0b62a8"
ORANGE: Final = "#b3490b"
GREY: Final = "#666666"
_VIOLET: Final = "#6600cc"
_BROWN: Final = "#593816"

_DARK: Final = {
    PAPER: "#16181c", INK: "#e4e4e4", EDGE: "#999999", RULE: "#3a3d42", BLUE: "#6db3f2", ORANGE: "#f0945a",
    GREY: "#aaaaaa", _VIOLET: "#8a5cff", _BROWN: "#fff3a0",
}  # fmt: skip
"""Replacement colours on a dark background; other colours are unchanged."""

_LINE_COLOURS: Final = (BLUE, ORANGE, _VIOLET, _BROWN)
"""Distinct with each kind of colour blindness, on both backgrounds; a test has the distances."""
_DASHES: Final = ("-", "--", "-.", (0, (1.0, 1.2)), (0, (6.0, 1.5, 1.0, 1.5, 1.0, 1.5)))
_MARKERS: Final = ("o", "s", "^", "D", "v")

_STYLE: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # included in Matplotlib: text has the same layout on every machine
    "font.size": 10.0,
    "figure.facecolor": PAPER,
    "axes.facecolor": PAPER,
    "axes.edgecolor": EDGE,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.0,
    "text.color": INK,
    "xtick.color": EDGE,
    "ytick.color": EDGE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}


@dataclass(frozen=True)
class LineStyle:
    """How a curve is drawn, in the terms of Matplotlib.

    Attributes
    ----------
    color : str
    linestyle : str or (float, tuple of float)
    marker : str
    """

    color: str
    linestyle: str | tuple[float, tuple[float, ...]]
    marker: str


def line_style(number: int) -> LineStyle:
    """Style of a curve by its number, from 0: the first twenty differ, and the first four in everything.

    Nothing depends on colour alone: dashes and markers differ between curves that are next to each other.
    """
    return LineStyle(
        _LINE_COLOURS[number % len(_LINE_COLOURS)], _DASHES[number % len(_DASHES)], _MARKERS[number % len(_MARKERS)]
    )


def require_matplotlib() -> None:
    """Check that Matplotlib is installed, before anything is rendered.

    Raises
    ------
    UsageError
        The message says what to install.
    """
    # Notes on its font cache do not concern a reader of the report.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    if find_spec("matplotlib") is None:
        raise missing_extra("report", "plots are drawn with Matplotlib, which is not installed")
    try:
        for module in ("matplotlib", "matplotlib.figure"):
            importlib.import_module(module)
    except ImportError as error:
        raise UsageError(
            f"plots are drawn with Matplotlib, which cannot be loaded ({error}); install it anew with "
            f"`{install_command('report')} --force-reinstall`"
        ) from None


def draw(
    name: str, title: str, size: tuple[float, float], paint: Callable[[Figure], None], description: str = ""
) -> str:
    """Draw a figure as one SVG element, standalone or for HTML.

    Parameters
    ----------
    name : str
        Must be unique within a page: the ids of clip paths are derived from it.
    title : str
        Title for screen readers.
    size : (float, float)
        Width and height in inches of 72 SVG units.
    paint : callable
        Adds axes and their contents to an empty figure.
    description : str
        What is to be seen, for screen readers.
    """
    require_matplotlib()
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    no_metadata: dict[str, Any] = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    file = io.StringIO()
    with rc_context({**_STYLE, "svg.hashsalt": name}):
        figure = Figure(figsize=size, layout="constrained")
        paint(figure)
        figure.savefig(file, format="svg", metadata=no_metadata)
    svg = file.getvalue()
    svg = svg[svg.index("<svg") :]
    view = re.search(r'viewBox="[^"]*"', svg)
    assert view is not None
    # No fixed size, so that the page decides; the namespaces; the title for screen readers.
    described = f' aria-describedby="{name}-text"' if description else ""
    opening = (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" {view.group()} role="img" '
        f'aria-label="{escape(title)}"{described}>'
        f"<title>{escape(title)}</title>{_colours()}"
    )
    svg = opening + svg[svg.index(">") + 1 :]
    named = set(re.findall(r"#([\w-]+)[\")]", svg))
    svg = re.sub(r' id="([^"]*)"', lambda found: found.group() if found.group(1) in named else "", svg)
    svg = svg.replace("'DejaVu Sans'", "system-ui")
    for place, light in enumerate(_DARK):
        svg = re.sub(f"(fill|stroke): {light}", rf"\1: var(--c{place})", svg)
    if description:
        svg = svg.replace("</title>", f'</title><desc id="{name}-text">{escape(description)}</desc>', 1)
    return svg.strip()


def _colours() -> str:
    """A style sheet with the colours that differ on a dark background."""
    light = ";".join(f"--c{place}:{colour}" for place, colour in enumerate(_DARK))
    dark = ";".join(f"--c{place}:{colour}" for place, colour in enumerate(_DARK.values()))
    return f"<style>svg{{{light}}}@media (prefers-color-scheme:dark){{svg{{{dark}}}}}</style>"
