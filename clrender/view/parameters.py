"""Materials and lights as tables of parameters that a page can offer, made from the scene's own model."""

from __future__ import annotations

import functools
import math
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, Final

from clrender.scene.spectra import SpectralColor

if TYPE_CHECKING:
    from clrender.scene.values import Part

__all__ = ["changeable", "is_plain", "parameters", "spectrum_words"]

_STRUCTURE: Final = ("type", "plugin", "file", "materials", "normal_map", "bump_map")
"""Keys that are no numbers: what a material or light is, and what it is made of."""


@functools.cache
def _schemas(kind: type[Part]) -> dict[str, dict[str, Any]]:
    """JSON Schema of each key that may be changed, with references resolved."""
    whole = kind.model_json_schema()
    found = {}
    for name, schema in whole["properties"].items():
        plain = None if name in _STRUCTURE else _plain(schema, whole.get("$defs", {}))
        if plain is not None:
            found[name] = {**plain, "description": schema.get("description", "")}
    return found


def _plain(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any] | None:
    """The alternative of a schema that is a number, a colour, a flag or a choice; None: there is none."""
    if "$ref" in schema:
        return _plain(definitions[schema["$ref"].rsplit("/", 1)[-1]], definitions)
    if "anyOf" in schema or "oneOf" in schema:
        parts = [_plain(part, definitions) for part in schema.get("anyOf", schema.get("oneOf", []))]
        some = [part for part in parts if part is not None]
        triples = [part for part in some if part["type"] == "array"]
        return next(iter(triples or some), None)
    if "enum" in schema or "const" in schema:
        return {"type": "string", "enum": schema.get("enum", [schema.get("const")])}
    if schema.get("type") in ("number", "integer", "boolean"):
        kept = ("type", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
        return {key: schema[key] for key in kept if key in schema}
    if schema.get("type") == "array" and schema.get("minItems") == schema.get("maxItems") == 3:
        items = schema.get("prefixItems") or [schema["items"]]
        return {"type": "array", "items": _plain(items[0], definitions) or {"type": "number"}}
    return None


def changeable(part: Part) -> list[str]:
    """Keys that hold, or may hold, a number, a colour, a flag or a choice."""
    return list(_schemas(type(part)))


def is_plain(value: object) -> bool:
    """Whether a value is a number, a flag, a name, nothing, or three numbers: never a texture, and so never a file.

    Nor is the colour of a spectrum three numbers: they would replace the spectrum.
    """
    if isinstance(value, SpectralColor):
        return False
    if isinstance(value, list | tuple):
        return len(value) == 3 and all(isinstance(each, int | float) and is_plain(each) for each in value)
    if isinstance(value, float):
        return math.isfinite(value)
    return value is None or isinstance(value, bool | int | str)


def parameters(part: Part) -> list[dict[str, Any]]:
    """The keys of a material, light or shape, in the order of the model.

    Returns
    -------
    list of dict
        ``name``, ``value``, ``kind`` (``number integer color vector flag choice``, or ``fixed``: a texture or the like,
        told in words), ``schema`` (JSON Schema of what may be given), ``optional`` (whether it may be without a value)
        and ``help``.
    """
    kinds = {"number": "number", "integer": "integer", "array": "color", "boolean": "flag", "string": "choice"}
    derived: Collection[str] = getattr(part, "derived_keys", ())
    table = []
    for name, schema in _schemas(type(part)).items():
        value = getattr(part, name)
        plain = is_plain(value) and name not in derived
        table.append(
            {
                "name": name,
                "value": value if plain else _described(value),
                "kind": ("vector" if _is_vector(schema) else kinds[schema["type"]]) if plain else "fixed",
                "schema": {key: each for key, each in schema.items() if key != "description"},
                "optional": type(part).model_fields[name].default is None,
                "help": schema["description"],
            }
        )
    for name in _STRUCTURE[1:]:
        value = getattr(part, name, None)
        if value is not None:
            table.append(
                {"name": name, "value": _described(value), "kind": "fixed", "schema": {}, "optional": False, "help": ""}
            )
    return table


def _is_vector(schema: dict[str, Any]) -> bool:
    """Whether three numbers are a place or a direction: those of a colour are not negative."""
    return schema["type"] == "array" and float(schema["items"].get("minimum", 0.0)) < 0.0


def spectrum_words(color: SpectralColor) -> str:
    """A spectrum in a few words, without its factor."""
    spectrum = color.spectrum
    if spectrum.illuminant is not None:
        return f"spectrum {spectrum.illuminant}"
    if spectrum.blackbody is not None:
        return f"black body of {spectrum.blackbody:g} K"
    return f"spectrum, {spectrum.wavelengths[0]:g} to {spectrum.wavelengths[-1]:g} nm"


def _described(value: Any) -> str:
    """A value that cannot be changed here, in a few words."""
    if isinstance(value, SpectralColor):
        return f"{spectrum_words(value)}, times {value.spectrum.scale:g}"
    texture = getattr(value, "texture", None)
    if isinstance(texture, str):
        return f"texture {texture}"[:80]
    kind = getattr(value, "type", None)
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(kind if isinstance(kind, str) else value)[:80]
