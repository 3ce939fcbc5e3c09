"""Which parts of the schema of scene files mixed scenes have: keys, the types of what stands there, and words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

__all__ = ["Part", "parts_of_scene", "parts_of_schema"]

Part: TypeAlias = tuple[str, ...]
"""(table, key), (table, key, table of the value) or (table, key, word)."""
_TOP = "Scene"


def parts_of_schema(schema: dict[str, Any]) -> set[Part]:
    """All that a scene may have, of a JSON Schema.

    Parameters
    ----------
    schema : dict
        As ``clrender schema`` prints it.
    """
    found: set[Part] = set()
    for table, node in {_TOP: schema, **schema["$defs"]}.items():
        for key, value in node["properties"].items():
            found.add((table, key))
            found |= {(table, key, name) for name in _names(value)}
    return found


def _names(node: Any) -> Iterator[str]:
    """Tables and words that may stand at a place."""
    if isinstance(node, list):
        for each in node:
            yield from _names(each)
    elif isinstance(node, dict):
        if "$ref" in node:
            yield node["$ref"].rpartition("/")[2]
        yield from (word for word in node.get("enum", ()) if isinstance(word, str))
        for key, each in node.items():
            if key not in ("default", "discriminator", "enum", "propertyNames"):
                yield from _names(each)


def parts_of_scene(schema: dict[str, Any], content: dict[str, Any]) -> set[Part]:
    """What a scene has of it.

    Parameters
    ----------
    schema : dict
    content : dict
        What a scene file says.
    """
    return set(_parts(schema, _TOP, schema, content))


def _parts(schema: dict[str, Any], table: str, node: dict[str, Any], content: dict[str, Any]) -> Iterator[Part]:
    for key, value in content.items():
        yield table, key
        names = set(_names(node["properties"][key]))
        for each in value.values() if key == "parameters" else _leaves(value):
            if isinstance(each, str) and each in names:
                yield table, key, each
            if isinstance(each, dict):
                inner = next(name for name in names if name in schema["$defs"] and _fits(schema["$defs"][name], each))
                yield table, key, inner
                yield from _parts(schema, inner, schema["$defs"][inner], each)


def _leaves(value: Any) -> Iterator[Any]:
    """A value, or those in lists of them, or in dictionaries by the user's names."""
    if isinstance(value, list):
        for each in value:
            yield from _leaves(each)
    elif isinstance(value, dict) and value and all(isinstance(each, dict) and _named(value) for each in value.values()):
        yield from value.values()
    else:
        yield value


def _named(value: dict[str, Any]) -> bool:
    """Whether the keys are names that the scene gives, which have blanks and numbers here."""
    return any(" " in key or key in ("fog", "haze", "walls", "lens", "touching") for key in value)


def _fits(node: dict[str, Any], content: dict[str, Any]) -> bool:
    properties = node["properties"]
    constant = properties.get("type", {}).get("const")
    has = set(node.get("required", ())) <= set(content) <= set(properties)
    return has and (constant is None or content.get("type", constant) == constant)
