"""Validation rules for JSON values; each returns the value, or raises an error that names its location."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from clrender.errors import SceneError
from clrender.importers.gltf.document import Document, escaped
from clrender.wording import counted, quoted, shown

__all__ = [
    "LEFT_OUT",
    "Rule",
    "Table",
    "Walk",
    "choice",
    "flag",
    "integer",
    "many",
    "named",
    "number",
    "ref",
    "share",
    "text",
]

LEFT_OUT: Final = object()
"""Marks an unknown value that may be ignored: its key is removed."""


class Walk:
    """Context of the rules.

    Parameters
    ----------
    document : Document

    Attributes
    ----------
    root : dict
        The JSON object.
    met : dict of str to str
        Names of the extensions found, each with its first location.
    """

    def __init__(self, document: Document) -> None:
        self.document, self.root = document, document.root
        self.met: dict[str, str] = {}
        self._unknown: set[tuple[str, str]] = set()

    def fault(self, at: str, sentence: str) -> SceneError:
        """See `Document.fault`."""
        return self.document.fault(at, sentence)

    def forgive(self, at: str, sentence: str) -> None:
        """See `Document.forgive`."""
        self.document.forgive(at, sentence)

    def unknown(self, at: str, key: str, table: str) -> None:
        """Note a property that is not in the specification, once per name and kind of object."""
        if (table, key) not in self._unknown:
            self._unknown.add((table, key))
            self.document.note(f"{at}/{escaped(key)} is no property that glTF 2.0 knows there; it was left out")

    def size(self, collection: str) -> int:
        """Number of objects in one of the root's arrays."""
        found = self.root.get(collection)
        return len(found) if isinstance(found, list) else 0


Rule: TypeAlias = Callable[[Walk, Any, str], Any]


def number(low: float = -math.inf, high: float = math.inf, above: float = -math.inf) -> Rule:
    """Rule: a finite number, as a float."""

    def rule(walk: Walk, value: Any, at: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise walk.fault(at, f"is {shown(value)}, but must be a number")
        try:
            found = float(value)
        except OverflowError:
            found = math.inf
        if not math.isfinite(found):
            raise walk.fault(at, "is too large a number; it must be finite")
        if not low <= found <= high or not found > above:
            bound = f"above {above:g}" if not found > above else f"from {low:g} to {high:g}"
            raise walk.fault(at, f"is {shown(value)}, but must be {bound}")
        return found

    return rule


def share() -> Rule:
    """Rule: a number from 0 to 1; others are cut off."""
    finite = number()

    def rule(walk: Walk, value: Any, at: str) -> float:
        found: float = finite(walk, value, at)
        held = min(max(found, 0.0), 1.0)
        if found != held:
            walk.forgive(at, f"is {shown(value)}, but must be from 0 to 1, where it was cut off; export it again")
        return held

    return rule


def integer(low: int = 0, high: int = 2**53, among: tuple[int, ...] = ()) -> Rule:
    """Rule: an integer; 1.0 counts as one."""

    def rule(walk: Walk, value: Any, at: str) -> int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int):
            raise walk.fault(at, f"is {shown(value)}, but must be a whole number")
        if among and value not in among:
            raise walk.fault(at, f"is {shown(value)}, but must be one of {', '.join(map(str, among))}")
        if not low <= value <= high:
            bound = f"at least {low}" if value < low else f"at most {high}"
            raise walk.fault(at, f"is {shown(value)}, but must be {bound}")
        return value

    return rule


def text() -> Rule:
    """Rule: any text."""

    def rule(walk: Walk, value: Any, at: str) -> str:
        if not isinstance(value, str):
            raise walk.fault(at, f"is {shown(value)}, but must be a text")
        return value

    return rule


def choice(*names: str) -> Rule:
    """Rule: one of these texts; others are noted and ignored, as extensions may add more."""

    def rule(walk: Walk, value: Any, at: str) -> Any:
        text()(walk, value, at)
        if value in names:
            return value
        walk.document.note(f"{at} is {quoted(value)}, which is none of {', '.join(names)}; it was left out")
        return LEFT_OUT

    return rule


def flag() -> Rule:
    """Rule: true or false."""

    def rule(walk: Walk, value: Any, at: str) -> bool:
        if not isinstance(value, bool):
            raise walk.fault(at, f"is {shown(value)}, but must be true or false")
        return value

    return rule


def ref(collection: str) -> Rule:
    """Rule: the index of an object in one of the root's arrays."""
    whole = integer()

    def rule(walk: Walk, value: Any, at: str) -> int:
        found: int = whole(walk, value, at)
        size = walk.size(collection)
        if found >= size:
            there = f"there are only {size}" if size else "there are none"
            raise walk.fault(at, f"is {found}, but of {collection} {there}; name one that exists")
        return found

    return rule


def many(each: Rule, least: int = 1, most: int | None = None, distinct: bool = False, filled: bool = False) -> Rule:
    """Rule: an array. One without entries is forgiven, but for where it has to be `filled`."""

    def rule(walk: Walk, value: Any, at: str) -> list[Any]:
        if not isinstance(value, list):
            raise walk.fault(at, f"is {shown(value)}, but must be an array")
        if len(value) < least:
            sentence = f"has {len(value) or 'no'} entries, but must have at least {least}; leave it out or fill it"
            if value or least > 1 or filled:
                raise walk.fault(at, sentence)
            walk.forgive(at, sentence)
        if most is not None and len(value) > most:
            raise walk.fault(at, f"has {counted(len(value), 'entry', 'entries')}, but must have at most {most}")
        for index, one in enumerate(value):
            value[index] = each(walk, one, f"{at}/{index}")
        if distinct and len(set(value)) < len(value):
            first = {one: i for i, one in reversed(list(enumerate(value)))}
            index = next(i for i, one in enumerate(value) if first[one] < i)
            sentence = f"is {shown(value[index])}, which is there already; leave it out"
            if filled:  # the order has a meaning
                raise walk.fault(f"{at}/{index}", sentence)
            walk.forgive(f"{at}/{index}", sentence)
            return list(dict.fromkeys(value))
        return value

    return rule


def named(each: Rule, least: int = 1) -> Rule:
    """Rule: an object with arbitrary keys."""

    def rule(walk: Walk, value: Any, at: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise walk.fault(at, f"is {shown(value)}, but must be an object")
        if len(value) < least:
            raise walk.fault(at, f"has no entries, but must have at least {least}")
        for key, one in value.items():
            value[key] = each(walk, one, f"{at}/{escaped(key)}")
        return value

    return rule


def _anything(walk: Walk, value: Any, at: str) -> Any:
    return value


@dataclass(frozen=True)
class Table:
    """Rule: an object with known properties.

    Attributes
    ----------
    name : str
        Kind of object, for messages.
    properties : mapping of str to Rule
        Besides ``name``, ``extensions`` and ``extras``, which all objects may have.
    required : tuple of str
    extensions : mapping of str to Rule
        Extensions that are known there.
    """

    name: str
    properties: Mapping[str, Rule]
    required: tuple[str, ...] = ()
    extensions: Mapping[str, Rule] = field(default_factory=dict)

    def __call__(self, walk: Walk, value: Any, at: str) -> dict[str, Any]:
        """Check an object and everything in it."""
        if not isinstance(value, dict):
            raise walk.fault(at, f"is {shown(value)}, but must be an object")
        for key in self.required:
            if key not in value:
                raise walk.fault(at, f"has no `{key}`, which {self.name} must have; add it")
        for key in list(value):
            rule = _ALL.get(key) or self.properties.get(key)
            if key == "extensions":
                self._extensions(walk, value[key], f"{at}/extensions")
            elif rule is None:
                walk.unknown(at, key, self.name)
            else:
                value[key] = rule(walk, value[key], f"{at}/{key}")
                if value[key] is LEFT_OUT:
                    del value[key]
        return value

    def _extensions(self, walk: Walk, value: Any, at: str) -> None:
        if not isinstance(value, dict):
            raise walk.fault(at, f"is {shown(value)}, but must be an object")
        for key in value:
            place = f"{at}/{escaped(key)}"
            walk.met.setdefault(key, place)
            if not isinstance(value[key], dict):
                raise walk.fault(place, f"is {shown(value[key])}, but must be an object")
            value[key] = self.extensions.get(key, _anything)(walk, value[key], place)


_ALL: Final[Mapping[str, Rule]] = {"name": text(), "extras": _anything}
