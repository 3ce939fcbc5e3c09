"""Bring the tables of docs/settings.md up to date with the table of settings (`clrender.settings.SETTINGS`)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from made_part import with_part

from clrender.settings import IMAGE, SETTINGS, STOP, WORK, Setting

__all__ = ["PAGE", "current", "tables"]

PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "settings.md"
_GROUPS: Final = {
    IMAGE: ("The image", "These settings are part of the request: another value gives another image."),
    STOP: ("Stopping", "These settings set the number of samples."),
    WORK: ("Division of the work", "These settings do not change a bit of the image."),
}


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
    return with_part(page, "setting_docs.py:", tables())


def tables() -> str:
    """A section of Markdown for each group of settings."""
    parts: list[str] = []
    for group, (title, about) in _GROUPS.items():
        settings = [setting for setting in SETTINGS.values() if setting.group == group]
        head = ["| name | option | value | default | |", "|---|---|---|---|---|"]
        parts += [f"## {title}", "", about, "", *head, *map(_row, settings), "", _in_scenes(settings), ""]
    return "\n".join(parts)


def _in_scenes(settings: Sequence[Setting]) -> str:
    """Which settings are allowed in a scene file, and where."""
    sections = dict.fromkeys(setting.section for setting in settings if setting.section)
    if not sections:
        return "They cannot be set in a scene file."
    parts = []
    for section in sections:
        names = [f"`{setting.name}`" for setting in settings if setting.section == section]
        parts.append(f"`[{section}]` takes {', '.join(names)}")
    return f"In a scene file {'; '.join(parts)}."


def _row(setting: Setting) -> str:
    option = f"`{setting.option}`" if setting.option else "`--size`" if setting.section == "image" else "–"
    cells = [f"`{setting.name}`", option, setting.domain.words, setting.default_words, setting.help]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    raise SystemExit(main())
