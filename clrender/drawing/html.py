"""Self-contained HTML pages: style, tables, paragraphs."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from string import Template
from typing import Final

from clrender.drawing.table import Table

__all__ = ["html_document", "html_table", "paragraphs"]

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
caption span { display: block; position: sticky; left: 0; max-width: min(56rem, 100vw - 2.5rem); }
th, td { padding: .35rem .5rem; border-bottom: 1px solid var(--rule); text-align: right; vertical-align: top;
  white-space: nowrap; }
th { vertical-align: bottom; white-space: normal; background: var(--band); }
.short { min-width: 26rem; } .short th { background: none; padding: 0; }
.words { text-align: left; } .prose td { white-space: normal; min-width: 9rem; }
.prose td:nth-child(3) { min-width: 20rem; }
.prose td:nth-child(2) { white-space: nowrap; font-weight: 600; min-width: 0; }
.holds td:nth-child(2) { color: var(--good); } .fails td:nth-child(2) { color: var(--bad); }
.open td:nth-child(2) { color: var(--open); } .first td { border-top: 2px solid var(--rule); }
figure { margin: 2rem 0; } figcaption { color: var(--soft); max-width: 46rem; margin-top: .5rem; }
figcaption strong { color: var(--ink); }
.row { display: grid; grid-template-columns: repeat(var(--columns), minmax(0, 30rem)); gap: .6rem;
  margin-bottom: .6rem; }
.row img { width: 100%; height: auto; display: block; }
figure > .row:not(.pixels) img { width: auto; max-width: 100%; }
.row span { font-size: .85rem; color: var(--soft); }
.pixels img { image-rendering: pixelated; }
svg { max-width: 100%; height: auto; width: 40rem; border: 1px solid var(--rule); }
.slider { position: relative; width: min(100%, max(var(--wide), 40rem)); overflow: hidden; }
.slider img { display: block; width: 100%; height: auto; image-rendering: pixelated; }
.slider img + img { position: absolute; inset: 0; clip-path: inset(0 calc(100% - var(--cut)) 0 0); }
.slider::after { content: ""; position: absolute; inset: 0 auto 0 calc(var(--cut) - 1px); width: 2px; background: #fff;
  box-shadow: 0 0 3px #000; pointer-events: none; }
.slider span { position: absolute; top: .5rem; right: .5rem; padding: .1rem .5rem; border-radius: .2rem;
  background: #000a; color: #fff; font-size: .85rem; pointer-events: none; }
.slider span:first-of-type { right: auto; left: .5rem; }
.slider input { position: absolute; inset: 0; width: 100%; height: 100%; margin: 0; opacity: 0; cursor: ew-resize; }
.slider:focus-within { outline: 2px solid var(--open); outline-offset: 2px; }
.row figure { margin: 0; }
.scale { display: flex; justify-content: space-between; font-size: .8rem; color: var(--soft); }
.scale i { flex: 1; height: .8rem; margin: .25rem .6rem; background: var(--colors); border: 1px solid var(--rule); }
@media (max-width: 36rem) {
  .row { grid-template-columns: 1fr; }
  .short { min-width: 0; } td { white-space: normal; }
  .prose thead { display: none; } .prose tr, .prose td { display: block; } .prose td { text-align: left; border: 0; }
  .prose tr { border-bottom: 1px solid var(--rule); padding: .4rem 0; } .prose td:nth-child(3) { min-width: 0; }
  figure { overflow-x: auto; } svg { width: 32rem; max-width: none; }
}
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


def html_document(heading: str, parts: Sequence[str]) -> str:
    """An HTML page.

    Parameters
    ----------
    heading : str
        Text.
    parts : sequence of str
        HTML, in order.
    """
    return _HTML.substitute(heading=escape(heading), body="\n".join(parts))


def paragraphs(texts: Sequence[str]) -> list[str]:
    """Each text as an HTML paragraph."""
    return [f"<p>{escape(text)}</p>" for text in texts]


def html_table(table: Table, kind: str, row_classes: Sequence[str]) -> str:
    """A table that scrolls on narrow pages.

    Parameters
    ----------
    table : Table
    kind : str
        Class of the table: ``prose`` if cells contain sentences.
    row_classes : sequence of str
        Class of each row; further rows have none.
    """

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
