"""The report as a page: one self-contained HTML file, or Markdown with separate images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from clrender.drawing.html import html_document, html_table, paragraphs
from clrender.drawing.pictures import data_uri, figure_of
from clrender.drawing.table import Table
from clrender.report.pictures import Figure
from clrender.report.plots import Plot
from clrender.report.prose import differences, introduction, method
from clrender.report.results import Results
from clrender.report.tables import noise_table, times_table, verdict_table
from clrender.report.verdicts import FAILS, HOLDS, verdicts

__all__ = ["Page", "html_page", "markdown_page", "picture_name"]

_HEADING: Final = "The founding report, reproduced"


@dataclass(frozen=True)
class Page:
    """Contents of a page.

    Attributes
    ----------
    results : Results
    figures : sequence of Figure
    plots : sequence of Plot
    """

    results: Results
    figures: Sequence[Figure]
    plots: Sequence[Plot]


_SECTIONS: Final = (
    "Its conclusions",
    "Its benchmark and ours",
    "Why our numbers differ",
    "Plots",
    "Figures",
    "How it was measured",
)
"""Headings, in order."""

_SEEN: Final = {
    "figure-1": "A plan of the room from above and from the front, with its lengths, two lights and the camera",
    "figure-2-5": "The room in a mirror sphere; a white sphere, green on the side of the green wall; a soft shadow",
    "figure-3": "A hemisphere of dots, which are denser towards the normal",
    "figure-4": "The room twice: bright, and with a black ceiling and black shadows",
    "figure-6": "The room twice: bright with the square root, and dark, with black shadows, with linear values",
    "figure-7": "The room with 256, 64 and 16 samples per pixel, and a detail of each: from fine grain to coarse",
    "figure-8": "The room by one, two and four shadow rays, and a detail of each: soft shadows have finer grain",
    "figure-9": "The room with paths of three depths, and a detail of each: to the right fewer, brighter specks",
    "roulettes": "The room by two kinds of roulette, and a detail of each: the constant one has brighter specks",
    "whitted": "The room by path tracing, and by Whitted's ray tracing with hard shadows and a black ceiling",
    "time": "A plot of seconds against samples per pixel: rising lines, two of clrender far below that of the report",
    "noise": "A plot of relMSE against samples per pixel: falling points, those of clrender's roulette far below",
    "shadow": "A plot of noise at equal time against shadow rays: two lines near 1, highest at four",
}
"""What is to be seen in each picture of the Markdown page, by name."""


def html_page(page: Page) -> str:
    """The page as one HTML file, with embedded images, plots and style."""
    found = verdicts(page.results)
    classes = [{HOLDS: "holds", FAILS: "fails"}.get(each.outcome, "open") for each in found]
    times = times_table(page.results)
    starts = ["first" if i == 0 or times.rows[i - 1][0] != row[0] else "" for i, row in enumerate(times.rows)]
    sections = (
        [html_table(verdict_table(found), "prose", classes)],
        [html_table(times, "", starts), html_table(noise_table(page.results), "", [])],
        paragraphs(differences(page.results)),
        [figure_of(each.svg, each.caption) for each in page.plots],
        [_html_figure(each) for each in page.figures],
        paragraphs(method(page.results)),
    )
    parts = [*paragraphs(introduction(page.results)), _html_contents(page.figures)]
    for heading, section in zip(_SECTIONS, sections, strict=True):
        parts += [f'<h2 id="{_anchor(heading)}">{heading}</h2>', *section]
    return html_document(_HEADING, parts)


def markdown_page(page: Page) -> str:
    """The page as Markdown, which refers to images by `picture_name`."""
    found = verdicts(page.results)
    parts = [
        f"# {_HEADING}",
        *introduction(page.results),
        _markdown_contents(),
    ]
    sections = (
        [_markdown_table(verdict_table(found))],
        [_markdown_table(times_table(page.results)), _markdown_table(noise_table(page.results))],
        differences(page.results),
        [f"![{_SEEN[each.name]}]({picture_name(each)})\n\n*{each.caption}*" for each in page.plots],
        [_markdown_figure(each) for each in page.figures],
        method(page.results),
    )
    for heading, section in zip(_SECTIONS, sections, strict=True):
        parts += [f"## {heading}", *section]
    return "\n\n".join(part.replace("*", "\\*") if _is_prose(part) else part for part in parts) + "\n"


def picture_name(of: Figure | Plot) -> str:
    """File name of a figure or plot of the Markdown page."""
    return f"report-{of.name}.{'svg' if isinstance(of, Plot) or of.svg else 'jpg'}"


def _anchor(heading: str) -> str:
    """Fragment of a heading's address, as forges and the documentation site make it."""
    return heading.lower().replace(" ", "-")


def _html_contents(figures: Sequence[Figure]) -> str:
    inner = "".join(f'<li><a href="#{each.name}">{escape(each.title)}</a></li>' for each in figures)
    items = "".join(
        f'<li><a href="#{_anchor(heading)}">{heading}</a>{f"<ul>{inner}</ul>" if heading == "Figures" else ""}</li>'
        for heading in _SECTIONS
    )
    return f'<nav aria-label="Contents"><ul>{items}</ul></nav>'


def _markdown_contents() -> str:
    return "\n".join(f"- [{heading}](#{_anchor(heading)})" for heading in _SECTIONS)


def _html_figure(figure: Figure) -> str:
    rows = []
    for i, row in enumerate(figure.rows):
        pictures = "".join(
            f'<div><img src="{data_uri(panel.pixels)}" width="{panel.pixels.shape[1]}" '
            f'height="{panel.pixels.shape[0]}" '
            f'alt="{escape(f"{figure.title}: {panel.words}")}"><span>{escape(panel.words)}</span></div>'
            for panel in row
        )
        rows.append(f'<div class="row{" pixels" if i else ""}" style="--columns: {len(row)}">{pictures}</div>')
    caption = f"<figcaption><strong>{escape(figure.title)}.</strong> {escape(figure.caption)}</figcaption>"
    return f'<figure id="{figure.name}">{figure.svg}{"".join(rows)}{caption}</figure>'


def _markdown_table(table: Table) -> str:
    rule = ["---" if i < table.words else "---:" for i in range(len(table.header))]
    lines = [table.header, rule, *table.rows]
    body = "\n".join(
        f"| {' | '.join(text.replace('|', '/').replace('*', chr(92) + '*') for text in row)} |" for row in lines
    )
    caption = table.caption.replace("*", "\\*")
    return f"{body}\n\n{caption}"


def _markdown_figure(figure: Figure) -> str:
    words = "; ".join(", ".join(panel.words for panel in row) for row in figure.rows[:1])
    order = f" From left to right: {words}." if words else ""
    return f"![{_SEEN[figure.name]}]({picture_name(figure)})\n\n**{figure.title}.** {figure.caption}{order}"


def _is_prose(part: str) -> bool:
    return not part.startswith(("|", "#", "!", "- ["))
