"""`clrender blender`: writes the add-on that Blender installs."""

from __future__ import annotations

from pathlib import Path

import click

from clrender.wording import counted

__all__ = ["blender"]


@click.command()
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    required=True,
    type=click.Path(path_type=Path),
    help="Add-on to write, a .zip; it is overwritten.",
)
def blender(output: Path) -> None:
    """Write the add-on for Blender 4.2 or later, which renders its scenes with clrender.

    In Blender: Edit, Preferences, Get Extensions, Install from Disk. Then "clrender" is in the list of render engines.
    """
    from clrender.blender import write_addon
    from clrender.errors import UsageError
    from clrender.files.access import atomic_write, check_writable

    if output.suffix.lower() != ".zip":
        raise UsageError(f"{output}: Blender installs add-ons of .zip files; name one, such as clrender_addon.zip")
    check_writable(output)
    with atomic_write(output) as file:
        count = write_addon(file)
    click.echo(
        f"{output}: the add-on, {counted(count, 'file')}; in Blender: Edit, Preferences, Get Extensions, Install "
        "from Disk"
    )
