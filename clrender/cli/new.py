"""`clrender new`: writes a first scene."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Final

import click

__all__ = ["new"]

_TEMPLATE: Final = Path(__file__).with_name("first_scene.toml")
_NAME: Final = "scene.toml"


@click.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
def new(folder: Path) -> None:
    """Write a commented example scene to DIR, which may already exist."""
    from clrender.cli.folder import output_folder
    from clrender.errors import UsageError
    from clrender.files.access import atomic_write

    scene = folder / _NAME
    if os.path.lexists(scene):
        raise UsageError(f"{scene}: exists already and is not overwritten; name another folder, or move the file")
    with output_folder(folder, _NAME), atomic_write(scene) as file:
        file.write(_TEMPLATE.read_bytes())
    picture = shlex.quote(str(folder / "picture.png"))
    click.echo(f"{scene}: an example scene; render it with: clrender render {shlex.quote(str(scene))} -o {picture}")
