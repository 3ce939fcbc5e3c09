"""The report as a page: one self-contained HTML file, or Markdown with its pictures beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from string import Template
from typing import Final

from clrender.report.pictures import Figure, data_uri
from clrender.report.plots import Plot
from clrender.report.prose import differences, introduction, method
from clrender.report.results import Results
from clrender.report.tables import Table, noise_table, times_table, verdict_table
from clrender.report.verdicts import FAILS, HOLDS, verdicts

__all__ = ["Page", "html_page", "markdown_page", "picture_name"]

_HEADING: Final = "The founding report, reproduced"

_HTML: Final = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$heading</title>
<style>
:root { color-scheme: light dark; --ink: #1d1f22; --soft: #5b6067; --paper: #fff; --rule: #d9dce0; --band: #f5f6f7;
  --good: #1c7a3c; --bad: #b3261e; --open: #8a6100; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --soft: #a5abb3; --paper: #16181c; --rule: #3a3d42;
  --band: #1e2126; --good: #6fce8d; --bad: #ff8f85; --open: #e8bd5a; } }
body { margin: 0 auto; padding: 2rem 1.25rem 4rem; max-width: 76rem; background: var(--paper); color: var(--ink);
  font: 1rem/1.55 system-ui, sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; } h2 { margin-top: 2.6rem; font-size: 1.35rem; }
p { max-width: 46rem; }
.scroll { overflow-x: auto; margin: 1.2rem 0; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; min-width: 100%; }
caption { caption-side: bottom; text-align: left; color: var(--soft); padding-top: .6rem; }
caption span { display: block; max-width: 56rem; }
th, td { padding: .35rem .6rem; border-bottom: 1px solid var(--rule); text-align: right; vertical-align: top;
  white-space: nowrap; }
th { vertical-align: bottom; white-space: normal; background: var(--band); }
.words { text-align: left; } .prose td { white-space: normal; min-width: 9rem; }
.prose td:nth-child(3) { min-width: 20rem; }
.prose td:nth-child(2) { white-space: nowrap; font-weight: 600; min-width: 0; }
.holds td:nth-child(2) { color: var(--good); } .fails td:nth-child(2) { color: var(--bad); }
.open td:nth-child(2) { color: var(--open); } .first td { border-top: 2px solid var(--rule); }
figure { margin: 2rem 0; } figcaption { color: var(--soft); max-width: 46rem; margin-top: .5rem; }
figcaption strong { color: var(--ink); }
.row { display: grid; grid-template-columns: repeat(var(--columns), minmax(0, 30rem)); gap: .6rem;
  margin-bottom: .6rem; }
@media (max-width: 36rem) { .row { grid-template-columns: 1fr; } }
.row img { width: 100%; height: auto; display: block; }
.row span { font-size: .85rem; color: var(--soft); }
.pixels img { image-rendering: pixelated; }
svg { max-width: 100%; height: auto; width: 40rem; border: 1px solid var(--rule); }
</style>
</head>
<body>
<main>
<h1>$heading</h1>
$body
</main>
</body>
</html>
""")


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


def html_page(page: Page) -> str:
    """The page as one HTML file, with pictures, plots and style inside."""
    found = verdicts(page.results)
    classes = [{HOLDS: "holds", FAILS: "fails"}.get(each.outcome, "open") for each in found]
    times = times_table(page.results)
    starts = ["first" if i == 0 or times.rows[i - 1][0] != row[0] else "" for i, row in enumerate(times.rows)]
    parts = [
        *_paragraphs(introduction(page.results)),
        "<h2>Its conclusions</h2>",
        _html_table(verdict_table(found), "prose", classes),
        "<h2>Its benchmark and ours</h2>",
        _html_table(times, "", starts),
        _html_table(noise_table(page.results), "", []),
        "<h2>Why our numbers differ</h2>",
        *_paragraphs(differences(page.results)),
        "<h2>Plots</h2>",
        *(f"<figure>{each.svg}<figcaption>{escape(each.caption)}</figcaption></figure>" for each in page.plots),
        "<h2>Figures</h2>",
        *(_html_figure(each) for each in page.figures),
        "<h2>How it was measured</h2>",
        *_paragraphs(method(page.results)),
    ]
    return _HTML.substitute(heading=_HEADING, body="\n".join(parts))


def markdown_page(page: Page) -> str:
    """The page as Markdown, which refers to pictures by `picture_name`."""
    found = verdicts(page.results)
    parts = [
        f"# {_HEADING}",
        *introduction(page.results),
        "## Its conclusions",
        _markdown_table(verdict_table(found)),
        "## Its benchmark and ours",
        _markdown_table(times_table(page.results)),
        _markdown_table(noise_table(page.results)),
        "## Why our numbers differ",
        *differences(page.results),
        "## Plots",
        *(f"![{each.caption}]({picture_name(each)})\n\n*{each.caption}*" for each in page.plots),
        "## Figures",
        *(_markdown_figure(each) for each in page.figures),
        "## How it was measured",
        *method(page.results),
    ]
    return "\n\n".join(part.replace("*", "\\*") if _is_prose(part) else part for part in parts) + "\n"


def picture_name(of: Figure | Plot) -> str:
    """Name of the file of a figure or a plot, beside the Markdown page."""
    return f"report-{of.name}.{'svg' if isinstance(of, Plot) or of.svg else 'jpg'}"


def _paragraphs(texts: Sequence[str]) -> list[str]:
    return [f"<p>{escape(text)}</p>" for text in texts]


def _html_table(table: Table, kind: str, row_classes: Sequence[str]) -> str:
    def cells(row: Sequence[str], tag: str) -> str:
        scope = ' scope="col"' if tag == "th" else ""
        return "".join(
            f"<{tag}{scope}{' class=words' if i < table.words else ''}>{escape(text)}</{tag}>"
            for i, text in enumerate(row)
        )

    lines = [
        f'<tr class="{row_classes[i] if i < len(row_classes) else ""}">{cells(row, "td")}</tr>'
        for i, row in enumerate(table.rows)
    ]
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(table.caption[:60])}">'
        f'<table class="{kind}"><caption><span>{escape(table.caption)}</span></caption>\n'
        f"<thead><tr>{cells(table.header, 'th')}</tr></thead>\n<tbody>\n{chr(10).join(lines)}\n</tbody></table></div>"
    )


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
    return f"![{figure.title}]({picture_name(figure)})\n\n**{figure.title}.** {figure.caption}{order}"


def _is_prose(part: str) -> bool:
    return not part.startswith(("|", "#", "!"))
