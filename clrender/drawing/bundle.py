"""The files of the page, and its modules as one, for a notebook's widget and pages that are one file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

__all__ = ["joined", "page_file", "style_sheet", "widget_module"]

_FOLDERS: Final = tuple(Path(__file__).parents[1] / room / "page" for room in ("view", "inspection"))
"""Folders of the page's files: its own, and those of light paths, which have a page of their own as well."""
_SHEETS: Final = ("style.css", "paths.css")

_IMPORT: Final = re.compile(r'^import \{ ([\w, ]+) \} from "\./(\w+\.js)";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export (?=(?:async )?(?:function|const) (\w+))", re.MULTILINE)


def page_file(name: str) -> Path | None:
    """A file of the page: one of those that are there, by its name alone; None: there is none."""
    found = {each.name: each for folder in _FOLDERS for each in folder.iterdir()}
    return found.get(name)


def style_sheet() -> str:
    """The style sheets as one."""
    return "\n".join(_read(name) for name in _SHEETS)


def _read(name: str) -> str:
    path = page_file(name)
    assert path is not None, name
    return path.read_text(encoding="utf-8")


def widget_module() -> str:
    """A module as an ``anywidget`` wants it: what it exports has ``render``, the function of ``widget.js``."""
    return f"{joined('widget.js')}\nexport default {{ render: {_variable('widget.js')}.render }};\n"


def joined(name: str) -> str:
    """Define a module's exports as ``module_NAME``, with all that it imports.

    Each module becomes a function that is called once and returns what the module exports, so that names of one do not
    meet those of another.

    Parameters
    ----------
    name : str
        A file of the page.
    """
    parts: dict[str, str] = {}
    _add(name, parts)
    return "\n".join(parts.values())


def _add(name: str, parts: dict[str, str]) -> None:
    """Add a module behind those that it imports."""
    if name in parts:
        return
    text = _read(name)
    for imported in _IMPORT.finditer(text):
        _add(imported[2], parts)
    text = _IMPORT.sub(lambda found: f"const {{ {found[1]} }} = {_variable(found[2])};\n", text)
    exported = [found[1] for found in _EXPORT.finditer(text)]
    text = _EXPORT.sub("", text)
    parts[name] = f"const {_variable(name)} = (() => {{\n{text}\nreturn {{ {', '.join(exported)} }};\n}})();"


def _variable(name: str) -> str:
    return f"module_{name.removesuffix('.js')}"
