"""`clrender warmup`: compiles kernels before they are needed."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from clrender.cli.completing import complete_devices, complete_scenes
from clrender.cli.interrupt import interruptible
from clrender.cli.options import allow_path_option, plugin_option, setting_option

__all__ = ["warmup"]


@click.command()
@click.argument("names", metavar="[SCENE]...", nargs=-1, shell_complete=complete_scenes)
@setting_option("integrator")
@click.option("-d", "--device", metavar="SPEC", shell_complete=complete_devices, help="As for `clrender render`.")
@click.option("--quiet", is_flag=True, help="No progress; only errors on stderr.")
@plugin_option
@allow_path_option
def warmup(
    names: tuple[str, ...],
    integrator: str | None,
    device: str | None,
    quiet: bool,
    plugins: tuple[Path, ...],
    allow_paths: tuple[Path, ...],
) -> None:
    """Check devices and compile kernels now, so that later renders begin at once.

    Without a SCENE, the kernels that can render any scene are compiled, in some ten seconds; long renders still
    compile faster ones for their scene meanwhile. With SCENEs, the fast kernels of these are.

    Drivers keep compiled kernels until they, clrender or its cache change.
    """
    from clrender.drivers import select
    from clrender.importers.load import load
    from clrender.rendering.warm_up import warm_up

    def say(line: str) -> None:
        if not quiet:
            click.echo(line, err=True)

    scenes = {name: load(name, allow_paths=allow_paths, plugins=plugins) for name in names}
    with interruptible(lost="interrupted") as interrupt:
        settings = {} if integrator is None else {"integrator": integrator}
        warm_up(select(device, notify=say), scenes, interrupt.wanted, say, **settings)
        if interrupt.wanted():
            sys.exit(interrupt.exit_code)
