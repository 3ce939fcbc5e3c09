"""A benchmark as a page: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from clrender.bench.peers import OWN
from clrender.drawing.html import html_document, html_table, paragraphs
from clrender.drawing.pictures import figure_of
from clrender.drawing.svg import BLUE, GREY, INK, draw
from clrender.drawing.table import Table
from clrender.wording import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["bench_page"]

_BAR: Final = 0.36
"""Height of a bar with its spacing, inches."""

_PLOTS: Final = (
    ("mpaths_per_second", "million paths per second, scaled to an idle machine"),
    ("efficiency", "efficiency: 1 / (relMSE × seconds)"),
)


def bench_page(rows: Sequence[dict[str, Any]], lines: Sequence[dict[str, Any]], how: Sequence[str]) -> str:
    """The page.

    Parameters
    ----------
    rows : sequence of dict
        See `clrender.bench.summary`.
    lines : sequence of dict
        The runs, as from `Run.line`.
    how : sequence of str
        Sentences on size, samples and turns.
    """
    own = next((line for line in lines if line["renderer"] == OWN), {})
    where = (
        [f"clrender {own['version']} on {own['device']} ({own['driver']}), {counted(own['processors'], 'processor')}."]
        if own
        else []
    )
    parts = [*paragraphs([*where, *how])]
    for key, words in _PLOTS:
        known = [row for row in rows if key in row]
        if known:
            parts.append(figure_of(_bars(known, key, words), _caption(key)))
    parts += ["<h2>Numbers</h2>", html_table(_table(rows), "", _starts(rows))]
    return html_document("Benchmark", parts)


def _caption(key: str) -> str:
    if key == "efficiency":
        return "Medians. Twice the efficiency gives the same error in half the time."
    return (
        "Medians over the runs; lines show the range. Rates are per second of CPU time times the number of processors."
    )


def _bars(rows: Sequence[dict[str, Any]], key: str, words: str) -> str:
    """A bar for each renderer on each scene, as SVG."""
    names = [f"{row['scene']}  {row['renderer']}" for row in rows]
    places = range(len(rows))

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel=words)
        drawn = [BLUE if row["renderer"] == OWN else GREY for row in rows]
        axes.barh(places, [row[key] for row in rows], color=drawn, height=0.62)
        ends = [row[key] for row in rows]
        if key != "efficiency":
            ends = [row["highest"] for row in rows]
            axes.hlines(places, [row["lowest"] for row in rows], ends, color=INK, linewidth=1.2)
        for place, end, row in zip(places, ends, rows, strict=True):
            axes.annotate(f"{row[key]:.3g}", (end, place), (6, 0), textcoords="offset points", va="center")
        axes.set_yticks(places, names)
        axes.tick_params(axis="y", length=0)
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.grid(axis="x")

    return draw(key, words, (8.4, 1.0 + _BAR * len(rows)), paint)


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    def cells(row: dict[str, Any]) -> list[str]:
        rays = "mrays_per_second" in row
        rate = row["mrays_per_second" if rays else "mpaths_per_second"]
        spread = f"{row['lowest']:.3f} – {row['highest']:.3f}"
        ratio = f"{row['ratio']:.2f}" if "ratio" in row else ""
        error = f"{row['rel_mse']:.3g}" if "rel_mse" in row else ""
        better = f"{row['efficiency_ratio']:.2f}" if "efficiency_ratio" in row else ""
        what = [row["scene"], row["renderer"], "rays" if rays else "paths"]
        return [*what, f"{rate:.3f}", spread, str(row["runs"]), ratio, error, better]

    rates = ("million per second", "lowest – highest", "runs")
    header = (
        "scene",
        "renderer",
        "unit",
        *rates,
        "relative speed of clrender",
        "relMSE",
        "relative efficiency of clrender",
    )
    caption = (
        "Medians over the runs. Rates are per second of CPU time times the number of processors. Relative speed and "
        "efficiency: clrender's value divided by that of the renderer, median over the runs."
    )
    return Table(caption, header, [cells(row) for row in rows], words=3)


def _starts(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Classes of rows: the first of each scene."""
    return ["first" if i == 0 or rows[i - 1]["scene"] != row["scene"] else "" for i, row in enumerate(rows)]
