"""`clrender convert`: converts any scene to clrender's format or another program's, with its files beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import click

from clrender.cli.completing import complete_scenes
from clrender.cli.options import load_options
from clrender.cli.outputs import check_distinct, scene_files
from clrender.errors import UsageError
from clrender.files.access import atomic_write, check_writable
from clrender.wording import counted, printable

__all__ = ["convert"]

_OWN: Final = (".toml", ".json")
_FOREIGN: Final = {".xml": "exported_to_mitsuba", ".scn": "exported_to_luxcore", ".py": "exported_to_cycles"}
"""Functions of `clrender.exporters` by the ending of the scene file."""


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
    """Convert SCENE, in any supported format, to OUTPUT: clrender's format (.toml or .json), Mitsuba 3's (.xml),
    LuxCore's (.scn), or a Python program that builds it in Blender for Cycles (.py).

    Meshes, image files and IES files are written to a folder beside it, for example room-files for room.toml. A scene
    in clrender's format renders to the same image, bit for bit. What another program cannot express is noted, and with
    --strict refused.
    """
    ending = output.suffix.lower()
    if ending not in _OWN and ending not in _FOREIGN:
        text = f"the ending {output.suffix!r} is not that of a scene file; name a .toml, .json, .xml, .scn or .py."
        raise UsageError(f"{output}: {text}")
    if output.exists() and not force and not output.is_dir():
        raise UsageError(f"{output}: exists already; choose another name, or overwrite it with --force")
    check_writable(output)
    check_distinct([output])
    from clrender import exporters
    from clrender.importers import load
    from clrender.version import __version__

    loaded = load(scene, **reading)
    check_distinct([output], scene_files(scene, loaded))
    folder = output.with_name(f"{output.stem}-files")
    export = getattr(exporters, _FOREIGN.get(ending, "exported"))(loaded, folder.name)
    if export.files and folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder}: is a file, where the folder for meshes and pictures would be; name another output")
    if export.files and ascii(folder.name) != ascii(folder.name.encode("utf-8", "replace").decode()):
        reason = (
            "is no UTF-8, but the scene file, which is, names the folder of its files after it; choose another name"
        )
        raise UsageError(f"{printable(str(output))}: the name {reason}")
    notes, sha256 = list(loaded.notes), ""
    if isinstance(export, exporters.ForeignExport):
        export.check(loaded, reading["strict"])
        data = export.text
        notes += export.notes
    else:
        title = f"{printable(Path(scene).name)}, as clrender {__version__} converts it"
        data = exporters.scene_text(export.description, ending, title)
        sha256 = f", scene sha256 {loaded.sha256()}"
    with export.written(output), atomic_write(output) as file:
        file.write(data)
    for note in notes:
        click.echo(f"note: {note}", err=True)
    beside = f", {counted(len(export.files), 'file')} in {folder}" if export.files else ""
    click.echo(f"{output}: {counted(len(loaded.shapes), 'shape')}{beside}{sha256}")
