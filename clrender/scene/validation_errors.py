"""Converts validation errors to one sentence that names the location, the problem and the remedy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from clrender.errors import SceneError
from clrender.limits import given_too
from clrender.scene.former_keys import former_keys
from clrender.wording import place, quoted, shown, suggestion

__all__ = ["scene_error"]

_Location = tuple[int | str, ...]
_OTHERS: Final = 3
"""Other places with problems that a message names."""

_EXPECTED: Final[Mapping[str, str]] = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a smaller whole number",
    "finite_number": "a finite number",
    "string_type": "a text in quotes",
    "string_unicode": "a text without lone surrogates",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "tuple_type": "a list, in square brackets",
    "list_type": "a list",
    "dict_type": "a table",
    "mapping_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
}
_BOUNDS: Final[Mapping[str, tuple[str, str]]] = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def scene_error(
    error: ValidationError, root: type[BaseModel], source: str, above: tuple[int | str, ...] = ()
) -> SceneError:
    """The error that a user sees for a pydantic error.

    Parameters
    ----------
    error : pydantic.ValidationError
        From validating a table of class `root`.
    source : str
        Name of the file, or of the class for a table built in code.
    above : tuple of int or str
        Place of the table in the scene.

    Returns
    -------
    SceneError
        ``source: place: what is wrong and what would be right``; of other problems only the places are named.
    """
    details = error.errors(include_url=False)
    # A misspelt key also leaves the right one missing: report the cause, not the consequence.
    first = next((item for item in details if item["type"] == "extra_forbidden"), details[0])
    location, sentence = _explained(first, details, root)
    location = (*above, *location)
    where = place(location) or "the scene"
    misspelt = {item["loc"][:-1] for item in details if item["type"] == "extra_forbidden"}
    rest = (item for item in details if item["type"] != "missing" or item["loc"][:-1] not in misspelt)
    others = _others(((*above, *_explained(item, details, root)[0]) for item in rest), location)
    if sentence.startswith("the key"):
        return SceneError(f"{source}: {where}: {sentence}{others}" if location else f"{source}: {sentence}{others}")
    return SceneError(f"{source}: {where} {sentence}{others}")


def _others(locations: Iterable[_Location], explained: _Location) -> str:
    """The first other places that have problems, in parentheses; there may be thousands."""
    places: list[str] = []
    for name in map(place, locations):
        if not name or name == place(explained) or name in places:
            continue
        if len(places) == _OTHERS:
            return f" (also wrong: {', '.join(places)}, and more)"
        places.append(name)
    return f" (also wrong: {', '.join(places)})" if places else ""


def _explained(item: ErrorDetails, details: list[ErrorDetails], root: type[BaseModel]) -> tuple[_Location, str]:
    """Location without the tags that pydantic adds, and the sentence."""
    kind, context, value = item["type"], item.get("ctx", {}), item["input"]
    location, table, kinds = _resolved(item["loc"], root)
    if "sentence" in context:
        return location + tuple(context["below"]), str(context["sentence"])
    if kind != "extra_forbidden" and len(location) == 3 and location[2] == "[key]":
        name = shown(location[1])
        return location[:1], f"holds a name that is {name}, but names must be texts of 1 to 200 characters"
    if kind == "extra_forbidden":
        if table and (present := former_keys(table).get(str(location[-1]))):
            return location, given_too(present)
        near = suggestion(location[-1], table.model_fields if table else ())
        return location, f"is an unknown key{near or '; docs/scene-file.md lists those that there are'}"
    if kind == "missing":
        if isinstance(location[-1], int):
            needed = 1 + max(other["loc"][-1] for other in details if other["loc"][:-1] == item["loc"][:-1])  # type: ignore[operator]
            return location[:-1], f"has only {_entries(location[-1])}, but must have {needed}"
        return location[:-1], f"the key `{location[-1]}` is missing; add it" + _meaning(table, location[-1])
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _tag_problem(kind, location, value, kinds)
    if kind == "literal_error":
        return location, _literal_problem(table, location, value, str(context.get("expected", "")))
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        return location, f"is {shown(value)}, but must be {words} {_plain(context[key])}"
    if kind in _EXPECTED:
        return location, f"is {shown(value)}, but must be {_EXPECTED[kind]}"
    if kind in ("too_long", "string_too_long"):
        unit = "characters" if kind.startswith("string") else "entries"
        return location, f"has too many {unit}; at most {context['max_length']} are allowed"
    if kind in ("too_short", "string_too_short"):
        unit = "characters" if kind.startswith("string") else "entries"
        return location, f"has too few {unit}; at least {context['min_length']} would be right"
    return location, f"is wrong: {item['msg'].lower()}"


def _resolved(
    location: _Location, root: type[BaseModel]
) -> tuple[_Location, type[BaseModel] | None, Mapping[str, type[BaseModel]]]:
    """The location without union member names, the table of its last step, and that step's possible types."""
    table: type[BaseModel] | None = root
    kinds: Mapping[str, type[BaseModel]] = {}
    forms: Mapping[str, type[BaseModel]] | None = None
    kept: list[int | str] = []
    for number, step in enumerate(location):
        if forms is not None and isinstance(step, str) and step.startswith("<"):
            table, forms = forms.get(step), None  # a texture instead of a constant (`textures.py`)
            continue
        if kinds and step in kinds and len(kept) >= 2:
            table, kinds = kinds[str(step)], {}
            continue
        kept.append(step)
        if table is not None and step in table.model_fields:
            tables = list(_tables(table.model_fields[str(step)].annotation))
            tagged = {tag: each for each in tables for tag in _tags(each)}
            kinds = tagged if len(tables) > 1 else {}
            forms = {f"<{name}>": each for each in tables for name in list(each.model_fields)} if not tagged else None
            if number < len(location) - 1:
                table = None if kinds else (tables[0] if tables else table)
    return tuple(kept), table, kinds


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    """The tables that a field may contain, directly or in a list or table."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) is not Literal:
        for inner in get_args(annotation):
            yield from _tables(inner)


def _tags(table: type[BaseModel]) -> tuple[str, ...]:
    """Values of the key `type` that select this table."""
    field = table.model_fields.get("type")
    return get_args(field.annotation) if field is not None else ()


def _entries(count: int) -> str:
    return "one entry" if count == 1 else f"{count} entries"


def _plain(bound: float) -> str:
    """A bound as text, with all digits if it is a small integer."""
    return str(int(bound)) if bound == int(bound) and abs(bound) < 1e10 else f"{bound:g}"


def _meaning(table: type[BaseModel] | None, key: str) -> str:
    """Meaning of a missing key."""
    field = table.model_fields.get(key) if table else None
    return f" ({field.description})" if field and field.description else ""


def _tag_problem(
    kind: str, location: _Location, value: Any, known: Mapping[str, type[BaseModel]]
) -> tuple[_Location, str]:
    if kind == "union_tag_not_found":
        return location, f"the key `type` is missing; add one of {', '.join(known)}"
    given = value.get("type") if isinstance(value, Mapping) else None
    near = suggestion(given, known) if isinstance(given, str) else f"; known here: {', '.join(known)}"
    if given == "area" and location[:1] == ("lights",):
        near = "; a light with an area is a shape with `emission`"
    return (
        *location,
        "type",
    ), f"is {quoted(given) if isinstance(given, str) else shown(given)}, which is not known{near}"


def _literal_problem(table: type[BaseModel] | None, location: _Location, value: Any, expected: str) -> str:
    names = [name for name in expected.replace(" or ", ", ").replace("'", "").split(", ") if name]
    if isinstance(value, str):
        return f"is {quoted(value)}, which is not known" + suggestion(value, names)
    return f"is {shown(value)}, but must be one of {', '.join(names)}"
