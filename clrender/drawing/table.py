"""A table of text, for pages and Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Table"]


@dataclass(frozen=True)
class Table:
    """Text in rows and columns.

    Attributes
    ----------
    caption : str
    header : sequence of str
    rows : sequence of sequence of str
    words : int
        Number of leading columns that hold words; the others hold numbers.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1
