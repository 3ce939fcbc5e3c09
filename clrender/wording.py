"""Parts of error messages: quoted values, locations in a file, and the nearest known name."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

__all__ = ["place", "quoted", "shown", "suggestion"]

_PLAIN = re.compile(r"[A-Za-z0-9_-]{1,60}\Z")


def _shortened(text: str, limit: int) -> str:
    return text if len(text) <= limit else text[: limit - 3] + "..."


def quoted(name: str) -> str:
    """A name in double quotes, on one line, printable and truncated."""
    inner = ascii(_shortened(name, 60))[1:-1].replace('"', '\\"').replace("\\'", "'")
    return f'"{inner}"'


def shown(value: Any) -> str:
    """An invalid value, formatted for a sentence."""
    if isinstance(value, str):
        return f"the text {quoted(value)}"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}" if len(value) != 1 else "a list of one"
    if isinstance(value, int):
        # Python refuses to format integers of thousands of digits, and nobody would read them.
        return str(value) if abs(value) < 10**30 else "an integer of more than 30 digits"
    if isinstance(value, float):
        return repr(value)
    return _shortened(ascii(value), 40)


def suggestion(wrong: object, known: Iterable[str]) -> str:
    """The end of a sentence: the nearest known name, or all of them if there are few, or nothing."""
    names = [str(name) for name in known]
    if not names:
        return "; there is none here"
    near = difflib.get_close_matches(str(wrong)[:200], names, n=1, cutoff=0.6)
    if near:
        return f"; did you mean {quoted(near[0])}?"
    if len(names) <= 16:
        return f"; known here: {', '.join(quoted(name)[1:-1] for name in names)}"
    return ""


def place(location: Iterable[str | int]) -> str:
    """A location in a file, such as ``materials.white.reflectance[1]``."""
    text = ""
    for step in location:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            name = step if _PLAIN.match(step) else quoted(step)
            text += f".{name}" if text else name
    return text
