"""Bring the tables of docs/scene-file.md up to date with the schema of scene files (`clrender schema`)."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from made_part import with_part

from clrender.scene import Scene

__all__ = ["PAGE", "current", "tables"]

PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "scene-file.md"
_DEFAULT: Final = r" \(default: ([^)]*)\)$"
"""End of a description that states the default."""
_LARGE: Final = 1e9
"""Bounds beyond it only keep numbers finite and are not listed."""


def main() -> int:
    """Rewrite the page."""
    PAGE.write_text(current(PAGE.read_text()))
    return 0


def current(page: str) -> str:
    """The page with updated tables.

    Parameters
    ----------
    page : str
        Text with the two marks around the tables.
    """
    return with_part(page, "scene_docs.py:", tables(Scene.model_json_schema()))


def tables(schema: dict[str, Any]) -> str:
    """Sections of Markdown for every table of a scene file.

    Parameters
    ----------
    schema : dict
        JSON Schema of a scene.
    """
    parts = ["## Top of the file", "", *_table(schema, schema), ""]
    for title, key, group in (
        ("The camera", "[camera]", ["Camera"]),
        ("Motion of the camera", "[[camera.motion]]", ["CameraKey"]),
        ("The image", "[image]", ["Image"]),
        ("Render settings", "[render]", ["Render"]),
        ("Materials", "[materials.NAME]", _kinds(schema["properties"]["materials"]["additionalProperties"])),
        ("Pictures as textures", "{ texture = … }", ["ImageTexture"]),
        ("Transforms of texture coordinates", "transform = { … }", ["TextureTransform"]),
        ("Checkers", "{ checker = … }", ["Checker"]),
        ("Ramps", "{ ramp = … }", ["Ramp"]),
        ("Textures of plugins", "{ plugin = … }", ["PluginTexture"]),
        ("Normal maps", "normal_map = { … }", ["NormalMap"]),
        ("Bump maps", "bump_map = { … }", ["BumpMap"]),
        ("Shapes", "[[shapes]]", _kinds(schema["properties"]["shapes"]["items"])),
        ("Groups", "[groups.NAME]", ["Group"]),
        ("Transforms", "transform = { … }", ["Transform"]),
        ("Motions", "[[shapes.motion]]", ["MotionKey"]),
        ("Media", "[media.NAME]", ["Medium"]),
        ("Grids of densities", "[media.NAME.density]", ["Density"]),
        ("Lights", "[[lights]]", _kinds(schema["properties"]["lights"]["items"])),
    ):
        parts += [f"## {title}: `{key}`", ""]
        shared = _shared([schema["$defs"][name] for name in group]) if len(group) > 1 else []
        if shared:
            first = schema["$defs"][group[0]]
            parts += ["All of them take:", "", *_table(first, schema, only=shared), ""]
        for name in group:
            table = schema["$defs"][name]
            if len(group) > 1:
                parts += [f'### `type = "{table["properties"]["type"]["const"]}"`', ""]
            parts += [_cell(table.get("description", "")), ""]
            rows = _table(table, schema, without=["type", *shared] if len(group) > 1 else ["type"])
            parts += [*rows, ""] if len(rows) > 2 else []
    return "\n".join(parts)


def _kinds(one_of: dict[str, Any]) -> list[str]:
    return [str(each["$ref"]).rpartition("/")[2] for each in one_of.get("oneOf", [one_of])]


def _shared(group: list[dict[str, Any]]) -> list[str]:
    """Keys with the same meaning in every table of a group."""
    first = group[0]["properties"]
    return [
        key for key, value in first.items()
        if key != "type" and all(_meaning(value, {}) == _meaning(each["properties"].get(key, {}), {}) for each in group)
    ]  # fmt: skip


def _meaning(value: dict[str, Any], schema: dict[str, Any]) -> tuple[str, str]:
    return (_type(value, schema) if value else "", str(value.get("default")))


def _table(
    table: dict[str, Any], schema: dict[str, Any], only: list[str] | None = None, without: list[str] | None = None
) -> list[str]:
    return ["| key | value | default | |", "|---|---|---|---|", *_rows(table, schema, only, without or [])]


def _rows(table: dict[str, Any], schema: dict[str, Any], only: list[str] | None, without: list[str]) -> Iterator[str]:
    required = table.get("required", [])
    # Keys that several tables share are described in one of them.
    for key, value in table["properties"].items():
        if key in without or (only is not None and key not in only):
            continue
        default = "required" if key in required else _default(value)
        yield f"| `{key}` | {_type(value, schema)} | {default} | {_cell(value.get('description', ''))} |"


def _cell(text: str) -> str:
    first = re.sub(r"\s+", " ", text.split("\n\n", maxsplit=1)[0])
    # Defaults have a column of their own.
    return re.sub(_DEFAULT, "", first).replace("|", "\\|")


def _default(value: dict[str, Any]) -> str:
    default = value.get("default")
    told = re.search(_DEFAULT, value.get("description", ""))
    if default is None and told:
        return told.group(1)
    if default is None or "$ref" in value or default in ("", []):
        return "–"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return f"`{default!r}`".replace("'", '"')


def _type(value: dict[str, Any], schema: dict[str, Any]) -> str:
    """The type of a value, in words."""
    if "$ref" in value:
        name = re.sub(r"(?<!^)(?=[A-Z])", " ", str(value["$ref"]).rpartition("/")[2]).lower()
        name = name.replace("texture transform", "transforms of texture coordinates")
        name = name.replace("camera key", "motion of the camera").replace("motion key", "motions")
        return f"table, see {name}s" if name.endswith(" map") else f"table, see {name}"
    if "oneOf" in value:
        named = {str(each["$ref"]).rpartition("/")[2] for each in value["oneOf"] if "$ref" in each}
        more = ["a spectrum"] if "Spectrum" in named else []
        more += ["a texture"] if named - {"Spectrum"} else []
        return " or ".join([*(_type(each, schema) for each in value["oneOf"] if "$ref" not in each), *more])
    if "anyOf" in value:
        return " or ".join(_type(each, schema) for each in value["anyOf"] if each.get("type") != "null")
    if "enum" in value:
        return ", ".join(f"`{each}`" for each in value["enum"])
    if "const" in value:
        return f"`{value['const']}`"
    kind = value.get("type")
    if kind == "array":
        return _array(value, schema)
    if kind == "object" and "oneOf" in value.get("additionalProperties", {}):
        entries = value["additionalProperties"]["oneOf"]
        if any(each.get("type") == "number" for each in entries):
            pictured = any("$ref" in each for each in entries)
            return "numbers, colours and textures by name" if pictured else "numbers and colours by name"
    if kind in ("number", "integer"):
        return _bounded("whole number" if kind == "integer" else "number", value)
    return {"boolean": "`true` or `false`", "string": "text", "object": "tables by name"}.get(str(kind), str(kind))


def _array(value: dict[str, Any], schema: dict[str, Any]) -> str:
    item = value["prefixItems"][0] if "prefixItems" in value else value["items"]
    if "oneOf" in item:
        return "list of tables"
    inner = _type(item, schema)
    count = value.get("maxItems") if value.get("minItems") == value.get("maxItems") else None
    if item.get("type") == "array":
        return f"{count or 'n'} × {inner}"
    return f"{count if count else 'list of'} {inner.replace('number', 'numbers', 1)}"


def _bounded(kind: str, value: dict[str, Any]) -> str:
    low, high = value.get("minimum"), value.get("maximum")
    above, below = value.get("exclusiveMinimum"), value.get("exclusiveMaximum")
    if high is None and isinstance(below, int) and kind == "whole number":
        high, below = below - 1, None
    bounds = [
        f"{word} {number:g}" if number != int(number) else f"{word} {int(number)}"
        for word, number in (("≥", low), (">", above), ("≤", high), ("<", below))
        if number is not None and abs(number) < _LARGE
    ]
    return f"{kind} {', '.join(bounds)}".strip()


if __name__ == "__main__":
    sys.exit(main())
