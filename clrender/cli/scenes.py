"""`clrender scenes`: lists the built-in scenes."""

from __future__ import annotations

import click

from clrender.scene import builtin_names

__all__ = ["scenes"]


@click.command()
def scenes() -> None:
    """List the built-in scenes, one line each."""
    names = builtin_names()
    width = max(map(len, names), default=0)
    for name, description in names.items():
        click.echo(f"{name:<{width}}  {description}")
