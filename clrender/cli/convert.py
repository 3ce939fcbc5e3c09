"""`clrender convert`: converts a scene of any format to clrender's, with its meshes and images beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from clrender.cli.completing import complete_scenes
from clrender.cli.options import load_options
from clrender.cli.outputs import check_distinct, scene_files
from clrender.errors import UsageError
from clrender.files.access import atomic_write, check_writable

__all__ = ["convert"]

_ENDINGS = (".toml", ".json")


@click.command()
@click.argument("scene", shell_complete=complete_scenes)
@click.argument("output", type=click.Path(path_type=Path))
@click.option("--force", is_flag=True, help="Overwrite OUTPUT if it exists.")
@load_options
def convert(
    scene: str,
    output: Path,
    force: bool,
    reading: dict[str, Any],
) -> None:
    """Convert SCENE, in any supported format, to OUTPUT (.toml or .json) in clrender's format.

    Meshes, image files and IES files are written to a folder beside it, for example room-files for room.toml. The
    converted scene renders to the same image, bit for bit.
    """
    if output.suffix.lower() not in _ENDINGS:
        raise UsageError(f"{output}: the ending {output.suffix!r} is not that of a scene file; name a .toml or .json.")
    if output.exists() and not force and not output.is_dir():
        raise UsageError(f"{output}: exists already; choose another name, or overwrite it with --force")
    check_writable(output)
    check_distinct([output], [Path(scene)])
    from clrender.exporters import exported, scene_text
    from clrender.importers import load
    from clrender.version import __version__

    loaded = load(scene, **reading)
    check_distinct([output], scene_files(scene, loaded))
    folder = output.with_name(f"{output.stem}-files")
    export = exported(loaded, folder.name)
    if export.files and folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder}: is a file, where the folder for meshes and pictures would be; name another output")
    if export.files and ascii(folder.name) != ascii(folder.name.encode("utf-8", "replace").decode()):
        reason = (
            "is no UTF-8, but the scene file, which is, names the folder of its files after it; choose another name"
        )
        raise UsageError(f"{ascii(str(output))[1:-1]}: the name {reason}")
    name = ascii(Path(scene).name)[1:-1]
    text = scene_text(export.description, output.suffix.lower(), f"{name}, as clrender {__version__} converts it")
    with export.written(output), atomic_write(output) as file:
        file.write(text)
    for note in loaded.notes:
        click.echo(f"note: {note}", err=True)
    beside = f", {len(export.files)} files in {folder}" if export.files else ""
    click.echo(f"{output}: {len(loaded.shapes)} shapes{beside}, scene sha256 {loaded.sha256()}")
