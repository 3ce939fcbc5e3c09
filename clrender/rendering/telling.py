"""Lines of text for users, of which each is told once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from clrender.limits import check_function

__all__ = ["once"]

_MOST: Final = 10_000
"""Lines that are remembered: a command that has as many different ones would fill the memory with more."""


def once(notify: Callable[[str], None] | None) -> Callable[[str], None] | None:
    """A function that passes each line on only the first time; None for none.

    Parameters
    ----------
    notify : callable or None
        Called with one line of text.
    """
    check_function(notify, "notify")
    if notify is None:
        return None
    told = set[str]()

    def tell(line: str) -> None:
        if line not in told and len(told) < _MOST:
            told.add(line)
            notify(line)

    return tell
