"""The parts of pages that scripts make: each stands between a mark that names its script, and an end."""

from __future__ import annotations

from typing import Final

__all__ = ["with_part"]

_END: Final = "<!-- end -->"


def with_part(page: str, maker: str, text: str) -> str:
    """A page with one of its parts made anew.

    Parameters
    ----------
    page : str
        Text with the mark ``<!-- made by scripts/MAKER begin -->`` and, behind the part, ``<!-- end -->``.
    maker : str
        What the mark names: a script, and which part of it where it makes several.
    text : str
        The part.
    """
    begin = f"<!-- made by scripts/{maker} begin -->"
    before, mark, rest = page.partition(begin)
    _, end, after = rest.partition(_END)
    if not mark or not end:
        raise SystemExit(f"the page has no part that begins with {begin} and ends with {_END}")
    return f"{before}{begin}\n\n{text}\n{_END}{after}"
