"""Check a built site: links to pages, anchors, images and scripts are valid, and nothing is loaded from other hosts.

A site must work from a folder without a network: images, style sheets and scripts of other hosts are faults. Links to
other hosts that a reader may follow are allowed.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

__all__ = ["faults"]

_FETCHED: Final = ("src", "srcset", "poster", "data")
"""Attributes whose address a browser fetches automatically; also `href` of a `link`."""
_HARMLESS: Final = ("canonical", "license", "author", "search", "next", "prev", "index", "genindex")
"""Values of `rel` of a `link` whose address is not fetched."""


class _Page(HTMLParser):
    """The anchors and links of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[tuple[str, bool]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        self.links += [(given[name], True) for name in _FETCHED if name in given]
        if "href" in given:
            self.links.append((given["href"], tag == "link" and given.get("rel") not in _HARMLESS))


def faults(site: Path) -> list[str]:
    """Faults of the links of a site, a line each.

    Parameters
    ----------
    site : Path
        Folder of the built site.
    """
    pages = {path.resolve(): _Page(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        for link, fetched in page.links:
            if problem := _problem(path, link, fetched, pages):
                found.append(f"{path.relative_to(site.resolve())}: {link}: {problem}")
    return found


def _problem(path: Path, link: str, fetched: bool, pages: dict[Path, _Page]) -> str:
    parts = urlsplit(link)
    if parts.scheme == "data" or not link:
        return ""
    if parts.scheme or parts.netloc:
        return "is fetched from another host" if fetched else ""
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if target.is_dir():
        target /= "index.html"
    if not target.is_file():
        return "there is no such file"
    anchor = unquote(parts.fragment)
    if anchor and target in pages and anchor not in pages[target].anchors:
        return "there is no such anchor"
    return ""


def main() -> int:
    """Print the faults of a site; returns 1 if there are any."""
    site = Path(sys.argv[1])
    found = faults(site)
    for line in found:
        print(line, file=sys.stderr)
    if not any(site.rglob("*.html")):
        print(f"{site} holds no page", file=sys.stderr)
        return 1
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
