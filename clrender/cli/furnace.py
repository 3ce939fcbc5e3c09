"""`clrender furnace`: tests of the physics of materials, as a table, a page and numbers."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from clrender.cli.completing import complete_devices, complete_scenes
from clrender.cli.folder import output_folder
from clrender.cli.interrupt import interruptible
from clrender.cli.options import allow_path_option, numbers, plugin_option, setting_option
from clrender.cli.outputs import check_distinct
from clrender.cli.streams import tell

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from clrender.drawing.table import Table
    from clrender.furnace.findings import Finding
    from clrender.furnace.measure import Measured
    from clrender.plugins import Plugin

__all__ = ["furnace"]

_PAGE: Final = "furnace.html"
_NUMBERS: Final = "furnace.json"


@click.command()
@click.argument("subject", metavar="MATERIAL|SCENE", shell_complete=complete_scenes)
@click.option(
    "--material", "names", metavar="NAME", multiple=True, help="Measure only this material of a scene. Repeatable."
)
@click.option(
    "--uv", "uvs", type=numbers("U,V", "0.25,0.5", most=1e5), metavar="U,V", multiple=True,
    help="Texture coordinates at which textured materials are measured. Repeatable.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list of objects instead of a table.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="DIR",
    help="Write furnace.html, a self-contained page with plots, and furnace.json.",
)  # fmt: skip
@setting_option("seed", default=0, help="Seed of the random numbers (0).")
@click.option(
    "-d", "--device", metavar="SPEC", shell_complete=complete_devices,
    help="As for `clrender render`; if several devices match, the first is used.",
)  # fmt: skip
@click.option("--quick", is_flag=True, help="Use 1/16 of the samples.")
@click.option("--check", is_flag=True, help="Exit with code 1 if a fault is found.")
@click.option("--quiet", is_flag=True, help="No progress; only errors on stderr.")
@plugin_option
@allow_path_option
def furnace(
    subject: str, names: tuple[str, ...], uvs: tuple[tuple[float, float], ...], as_json: bool, output: Path | None,
    seed: int, device: str | None, quick: bool, check: bool, quiet: bool, plugins: tuple[Path, ...],
    allow_paths: tuple[Path, ...],
) -> None:  # fmt: skip
    """Test the physical properties of materials.

    MATERIAL is a type, such as conductor, tested with its defaults (white, gold, index 1.5) over a range of
    roughnesses; or a table as in a scene file, such as '{type = "conductor", metal = "Au", roughness = 0.3}'. For a
    SCENE, all its materials are tested. A plugin is given by --plugin and named like a type, and is tested with its
    defaults and with the bounds of each of its numbers; of a light, the intensity and the sampled directions.

    The tests of materials are: the directional albedo in a white furnace; reciprocity; and whether sampled directions
    match the probability density. Each fault is reported with its size. Delta distributions, such as smooth glass,
    have no density to test. The exit code is 0 whatever the result, unless --check is given.
    """
    from clrender.drivers import select
    from clrender.furnace import as_json as numbers_of
    from clrender.furnace import findings, measure, named_light, subjects_of
    from clrender.plugins import as_plugins

    def say(line: str) -> None:
        if not quiet:
            click.echo(line, err=True)

    given = as_plugins(plugins)
    light = named_light(subject, given, bool(names or uvs or output))
    if light is not None:
        _light(light, device, seed, quick, as_json, check, say)
        return
    if output is not None:
        check_distinct((output / _PAGE, output / _NUMBERS))
    what = subjects_of(subject, names, allow_paths, uvs, given)
    if output is not None:
        from clrender.drawing.svg import require_matplotlib

        require_matplotlib()
    folder = nullcontext() if output is None else output_folder(output, _PAGE)
    with folder, interruptible() as interrupt:
        chosen = select(device, notify=say)
        said: set[str] = set()

        def step(name: str) -> None:
            if interrupt.wanted():
                raise KeyboardInterrupt
            if name not in said:
                said.add(name)
                say(f"{len(said)} of {len(what.places)}: {name}")

        try:
            measured = measure(what, chosen[0], seed=seed, side=16 if quick else 64, step=step)
        except KeyboardInterrupt:
            click.echo("error: interrupted; nothing was written", err=True)
            sys.exit(interrupt.exit_code)
        found = [findings(each, len(measured)) for each in measured]
        numbers = [numbers_of(*each) for each in zip(measured, found, strict=True)]
        if output is not None:
            interrupt.has_picture.set()  # writing is short and should not be interrupted
            title = f"{chosen[0].info.title}; seed {seed}"
            _write(output, what.title, title, measured, found, numbers)
    tell(json.dumps(numbers, indent=2) if as_json else _text(measured, found, numbers))
    if check and any(each["faults"] for each in numbers):
        sys.exit(1)


def _light(
    plugin: Plugin, device: str | None, seed: int, quick: bool, as_json: bool, check: bool, say: Callable[[str], None]
) -> None:  # fmt: skip
    """Measure a plugin's light, and print what was found."""
    from clrender.drivers import select
    from clrender.furnace import light_findings, light_json, light_summary, measure_light

    with interruptible() as interrupt:

        def step(title: str) -> None:
            if interrupt.wanted():
                click.echo("error: interrupted", err=True)
                sys.exit(interrupt.exit_code)
            say(title)

        chosen = select(device, notify=say)[0]
        measured = measure_light(plugin, chosen, seed=seed, count=1 << (13 if quick else 17), step=step)
    found = [light_findings(each, len(measured)) for each in measured]
    numbers = [light_json(*each) for each in zip(measured, found, strict=True)]
    lines = _in_columns(light_summary(numbers))
    for each, sentences in zip(measured, found, strict=True):
        lines += ["", f"{each.title}:"]
        lines += [f"  {'FAULT: ' if one.fault else ''}{one.sentence}" for one in sentences]
    tell(json.dumps(numbers, indent=2) if as_json else "\n".join(lines))
    if check and any(each["faults"] for each in numbers):
        sys.exit(1)


def _text(
    measured: Sequence[Measured], found: Sequence[Sequence[Finding]], numbers: Sequence[dict[str, Any]]
) -> str:  # fmt: skip
    """A table, followed by the findings about each material."""
    from clrender.furnace import summary

    lines = _aligned(summary(numbers))
    for each, sentences in zip(measured, found, strict=True):
        lines += ["", f"{each.title}:"]
        lines += [f"  {'FAULT: ' if one.fault else ''}{one.sentence}" for one in sentences]
    return "\n".join(lines)


def _aligned(table: Table) -> list[str]:
    return _in_columns([table.header, *table.rows])


def _in_columns(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _write(
    folder: Path, title: str, device: str, measured: Sequence[Measured], found: Sequence[Sequence[Finding]],
    numbers: Sequence[dict[str, Any]],
) -> None:  # fmt: skip
    from clrender.files.access import atomic_write
    from clrender.furnace import furnace_page
    from clrender.version import __version__

    how = [f"clrender {__version__} on {device}."]
    page = furnace_page(title, measured, found, numbers, how)
    for name, text in ((_PAGE, page), (_NUMBERS, json.dumps(numbers, indent=2) + "\n")):
        with atomic_write(folder / name) as file:
            file.write(text.encode())
