"""Write man/clrender.1, the manual page, from the command line's own help; run it after changes of the help."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import click

from clrender.cli import COMMANDS, main
from clrender.version import __version__

__all__ = ["current"]

PAGE: Final = Path(__file__).resolve().parents[1] / "man" / "clrender.1"

EXIT_STATUS: Final = {
    "0": "done",
    "1": "failed while rendering or writing, or a check found a fault",
    "2": "wrong usage or bad input",
    "3": "no usable OpenCL device",
    "129": "ended by SIGHUP; the image so far was written",
    "130": "interrupted by SIGINT; the image so far was written",
    "143": "ended by SIGTERM; the image so far was written",
}
ENVIRONMENT: Final = {
    "CLRENDER_DEVICE": "default of --device",
    "CLRENDER_PROBE_SECONDS": "time limit of the driver check, in seconds",
    "XDG_CACHE_HOME": "parent of the folder that caches compiled kernels and device check results",
    "OCL_ICD_VENDORS": "folder or file of OpenCL drivers; when set, no other driver is considered",
}
EXAMPLES: Final = {
    "clrender new first": "write an example scene to edit",
    "clrender render first/scene.toml -o picture.png": "render it",
    "clrender render room --spp 4096 --checkpoint room.film --resume -o room.exr": "render with checkpoints",
    "clrender doctor": "find problems with OpenCL on this machine and how to fix them",
}


def current(_page: str = "") -> str:
    """The page as it should be."""
    top = click.Context(main, info_name="clrender", **main.context_settings)
    parts = [
        f'.TH CLRENDER 1 "" "clrender {__version__}" "User Commands"',
        ".SH NAME\nclrender \\- physically based OpenCL renderer",
        f".SH SYNOPSIS\n.B clrender\n{_text('[--version] [--help] COMMAND [ARGUMENTS]')}",
        f".SH DESCRIPTION\n{_prose(main.help or '')}",
        f".PP\n{_text('Without a command, it prints this help.')}",
        ".SH COMMANDS",
        *(_command(top, name) for name in COMMANDS),
        f".SH EXIT STATUS\n{_list(EXIT_STATUS)}",
        f".SH ENVIRONMENT\n{_list(ENVIRONMENT)}",
        f".SH EXAMPLES\n{_list(EXAMPLES)}",
    ]
    return "\n".join(parts) + "\n"


def _command(top: click.Context, name: str) -> str:
    command = main.get_command(top, name)
    assert command is not None
    context = click.Context(command, info_name=name, parent=top)
    usage = " ".join(["clrender", name, *command.collect_usage_pieces(context)])
    options = [each for each in command.params if isinstance(each, click.Option)]
    records = [record for option in options if (record := option.get_help_record(context))]
    # click keeps the help option of the first context
    records.append(("-h, --help", "Show this message and exit."))
    return "\n".join([f".SS {_text(usage)}", _prose(command.help or ""), _list(dict(records))])


def _prose(text: str) -> str:
    """Paragraphs; those marked as verbatim for click keep their lines."""
    paragraphs = []
    for part in re.split(r"\n\s*\n", text.strip()):
        kept = part.lstrip().startswith("\b")
        lines = [line.strip() for line in part.replace("\b", "").strip().splitlines()]
        paragraphs.append("\n".join([".nf", *map(_text, lines), ".fi"]) if kept else _text(" ".join(lines)))
    return "\n.PP\n".join(paragraphs)


def _list(entries: dict[str, str]) -> str:
    return "\n".join(f".TP\n.B {_text(name)}\n{_text(' '.join(words.split()))}" for name, words in entries.items())


def _text(text: str) -> str:
    """A line of text, escaped so that roff finds no request in it."""
    escaped = (
        text.replace("\\", "\\e")
        .replace("-", "\\-")
        .replace("`", "\\(ga")
        .replace("'", "\\(aq")
        .replace(chr(34), "\\(dq")
    )
    return f"\\&{escaped}" if escaped.startswith(".") else escaped


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(current(), encoding="utf-8")
