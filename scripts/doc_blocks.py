"""The code blocks of a page, with their annotations; tests run them, and figures are made from some.

An invisible comment before a block may be `<!-- file: NAME -->`, the name by which the page's commands refer to it, or
`<!-- not run: WHY -->`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from markdown_it import MarkdownIt

__all__ = ["Block", "blocks"]

_SHELL: Final = re.compile(r"(\$ )?((\./)?scripts/|clrender |pip |dask |source )")


@dataclass(frozen=True)
class Block:
    """A code block.

    Attributes
    ----------
    page : Path
    line : int
        Line number in the page, from 1.
    language : str
        As given in the page, or guessed from the text: ``console``, ``toml``, ``text``.
    text : str
    file : str or None
        Its file name for the commands after it.
    not_run : str or None
        Why it is not run.
    """

    page: Path
    line: int
    language: str
    text: str
    file: str | None = None
    not_run: str | None = None


def blocks(page: Path) -> list[Block]:
    """All code blocks of a page.

    Parameters
    ----------
    page : Path
    """
    found: list[Block] = []
    said: dict[str, str] = {}
    for token in MarkdownIt("commonmark").enable("table").parse(page.read_text()):
        if token.type == "html_block":
            said = dict(re.findall(r"<!-- (file|not run): (.*?) -->", token.content, re.DOTALL))
            continue
        if token.type in ("fence", "code_block"):
            assert token.map is not None
            language = token.info.strip() or _looks_like(token.content)
            file, reason = said.get("file"), said.get("not run")
            found.append(Block(page, token.map[0] + 1, language, token.content, file, reason))
        said = {}
    return found


def _looks_like(text: str) -> str:
    if _SHELL.match(text):
        return "console"
    return "toml" if text.startswith("[") else "text"
