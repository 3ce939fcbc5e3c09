"""The viewer of the page as one module, for a notebook's widget, which cannot load several."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

__all__ = ["PAGE", "joined", "widget_module"]

PAGE: Final = Path(__file__).parent / "page"
"""Folder of the page's files."""

_IMPORT: Final = re.compile(r'^import \{ ([\w, ]+) \} from "\./(\w+\.js)";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export (?=(?:async )?(?:function|const) (\w+))", re.MULTILINE)


def widget_module() -> str:
    """A module as an ``anywidget`` wants it: what it exports has ``render``, the function of ``widget.js``."""
    return f"{joined('widget.js')}\nexport default {{ render: {_variable('widget.js')}.render }};\n"


def joined(name: str, folder: Path = PAGE) -> str:
    """Define a module's exports as ``module_NAME``, with all that it imports.

    Each module becomes a function that is called once and returns what the module exports, so that names of one do not
    meet those of another.

    Parameters
    ----------
    name : str
        A file of the folder.
    folder : pathlib.Path
        Modules that it lacks are those of the live view.
    """
    parts: dict[str, str] = {}
    _add(name, folder, parts)
    return "\n".join(parts.values())


def _add(name: str, folder: Path, parts: dict[str, str]) -> None:
    """Add a module behind those that it imports."""
    if name in parts:
        return
    own = folder / name
    text = (own if own.exists() else PAGE / name).read_text(encoding="utf-8")
    for imported in _IMPORT.finditer(text):
        _add(imported[2], folder, parts)
    text = _IMPORT.sub(lambda found: f"const {{ {found[1]} }} = {_variable(found[2])};\n", text)
    exported = [found[1] for found in _EXPORT.finditer(text)]
    text = _EXPORT.sub("", text)
    parts[name] = f"const {_variable(name)} = (() => {{\n{text}\nreturn {{ {', '.join(exported)} }};\n}})();"


def _variable(name: str) -> str:
    return f"module_{name.removesuffix('.js')}"
