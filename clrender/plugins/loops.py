"""The rule of loops in plugins: they count, with bounds that are numbers, so that each ends."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

from clrender.wording import counted

__all__ = ["MOST_TURNS", "loop_faults"]

MOST_TURNS: Final = 1024
"""Most turns of a loop: drivers end longer ones early, and nobody waits for them."""
_FOR: Final = re.compile(r"\bfor\s*\(([^;{}]*);([^;{}]*);([^;(){}]*)\)")
_BEGIN: Final = re.compile(r"\s*int\s+(\w+)\s*=\s*(-?\w+)\s*\Z")
_END: Final = re.compile(r"\s*(\w+)\s*(<=?|>=?)\s*(-?\w+)\s*\Z")
_STEP: Final = re.compile(r"\s*(?:(\+\+|--)\s*(\w+)|(\w+)\s*(\+\+|--)|(\w+)\s*([-+])=\s*(\d+))\s*\Z")
_FORM: Final = "`for (int i = 0; i < 8; ++i)`, with numbers as bounds"


def loop_faults(body: str, first: int, macros: Mapping[str, str]) -> Iterator[tuple[int, str]]:
    """Faults of the loops of a function.

    Parameters
    ----------
    body : str
        Without comments.
    first : int
        Line of its first character.
    macros : mapping of str to str
        What the plugin's own macros stand for.

    Yields
    ------
    line : int
    what : str
    """
    heads = list(_FOR.finditer(body))
    for at in re.finditer(r"\bfor\b", body):
        head = next((each for each in heads if each.start() == at.start()), None)
        fault = f"a loop has to read {_FORM}" if head is None else _fault(head, macros, body)
        if fault:
            yield first + body.count("\n", 0, at.start()), fault


def _fault(head: re.Match[str], macros: Mapping[str, str], body: str) -> str:
    begin, end, step = _BEGIN.match(head[1]), _END.match(head[2]), _STEP.match(head[3])
    if not (begin and end and step):
        return f"a loop has to read {_FORM}"
    name = begin[1]
    if {end[1], next(each for each in (step[2], step[3], step[5]) if each)} != {name}:
        return f"a loop has to count one number; write {_FORM}"
    up = (step[1] or step[4] or step[6])[0] == "+"
    if up != (end[2][0] == "<"):
        return f"this loop counts away from its end; write {_FORM}"
    low, high = (_number(each, macros) for each in (begin[2], end[3]))
    stride = int(step[7] or 1)
    if low is None or high is None or stride == 0:
        return f"a loop has to read {_FORM}"
    turns = (abs(high - low) + 1) // stride
    if turns > MOST_TURNS:
        return f"this loop has {counted(turns, 'turn')}; at most {MOST_TURNS} are possible"
    rest = body[: head.start()] + body[head.end() :]
    changed = rf"\b{name}\s*(?:[-+*/%&|^]|<<|>>)?=(?!=)|\b{name}\s*(?:\+\+|--)|(?:\+\+|--)\s*{name}\b|&\s*{name}\b"
    for other in _FOR.finditer(rest):  # other loops may count by the same name
        found = _BEGIN.match(other[1])
        if found and found[1] == name:
            rest = rest.replace(other.group(), " " * len(other.group()))
    if re.search(changed, rest):
        return f"{name} counts the turns of a loop and is changed elsewhere too; take another name there"
    return ""


def _number(text: str, macros: Mapping[str, str]) -> int | None:
    value = macros.get(text, text)
    return int(value) if re.fullmatch(r"-?\d{1,9}", value) else None
