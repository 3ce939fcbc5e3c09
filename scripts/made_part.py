"""Generated parts of pages: each is between a begin mark, which names its script, and an end mark."""

from __future__ import annotations

from typing import Final

__all__ = ["with_part"]

_END: Final = "<!-- end -->"


def with_part(page: str, maker: str, text: str) -> str:
    """A page with one of its generated parts replaced.

    Parameters
    ----------
    page : str
        Text with the mark ``<!-- made by scripts/MAKER begin -->`` and, after the part, ``<!-- end -->``.
    maker : str
        Name in the mark: a script, and which part, if it makes several.
    text : str
        New text of the part.
    """
    begin = f"<!-- made by scripts/{maker} begin -->"
    before, mark, rest = page.partition(begin)
    _, end, after = rest.partition(_END)
    if not mark or not end:
        raise SystemExit(f"the page has no part that begins with {begin} and ends with {_END}")
    return f"{before}{begin}\n\n{text}\n{_END}{after}"
