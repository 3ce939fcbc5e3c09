"""`clrender view`: a scene in the browser, live."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from clrender.cli.options import (
    device_option,
    display_options,
    environment_option,
    load_options,
    scene_argument,
    setting_options,
    size_option,
)
from clrender.cli.outputs import check_distinct, scene_files
from clrender.cli.waiting import Waiting

if TYPE_CHECKING:
    from clrender.scene import Scene

__all__ = ["view"]


@dataclass(frozen=True)
class _SceneFile:
    """Source of the scene: the file or name from the command line."""

    name: str
    how: dict[str, Any]

    def read(self) -> Scene:
        from clrender.importers import load

        return load(self.name, **self.how)

    def files(self, scene: Scene) -> Sequence[Path]:
        return scene_files(self.name, scene)


@click.command()
@scene_argument
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port to listen on (a free one).")
@click.option("--host", default="127.0.0.1", metavar="A", help="Address to listen on (127.0.0.1: this machine only).")
@click.option("--no-open", is_flag=True, help="Print the address without opening a browser.")
@click.option(
    "-o",
    "--output",
    "outputs",
    metavar="FILE",
    type=click.Path(path_type=Path),
    multiple=True,
    help="File that the page may write: .png .jpg .exr .npy .hdr .film. Repeatable.",
)
@size_option
@device_option
@partial(setting_options, without=("time_limit",))
@environment_option
@partial(display_options, of="the page's picture, where it can be changed")
@load_options
def view(
    *,
    scene: str,
    port: int,
    host: str,
    no_open: bool,
    outputs: tuple[Path, ...],
    size: tuple[int, int] | None,
    devices: tuple[str, ...],
    environment: Path | float | None,
    tone_map: str,
    exposure: float,
    reading: dict[str, Any],
    **settings: Any,
) -> None:
    """Show SCENE in the browser while it renders; camera, settings and materials can be changed interactively.

    The first line of output is the address of the page. Anyone who knows it can see and control the view, only from
    this machine unless --host is given. The scene is loaded again when its file changes. Ctrl-C ends the view.
    """
    from clrender.image.files import check_output
    from clrender.view.engine import Engine
    from clrender.view.server import listen, serve

    for path in outputs:
        check_output(path)
    source = _SceneFile(scene, {**reading, "environment": environment})
    check_distinct(outputs)
    with Waiting(partial(click.echo, err=True)) as waiting:
        waiting.stage("reading")
        description = source.read()
    check_distinct(outputs, source.files(description))
    chosen = {name: value for name, value in settings.items() if value is not None}
    if size is not None:
        chosen |= {"width": size[0], "height": size[1]}
    listening = listen(host, port)
    if listening.getsockname()[0] not in ("127.0.0.1", "::1"):
        click.echo(
            f"warning: {host} can be reached from other machines; whoever learns the address with its token can steer "
            "the view, and it goes over the network unencrypted",
            err=True,
        )

    def ready(address: str) -> None:
        click.echo(address)
        sys.stdout.flush()
        if not no_open:
            webbrowser.open(address)

    try:
        with listening:
            with Waiting(partial(click.echo, err=True)) as waiting:
                waiting.stage("opening")
                engine = Engine(
                    description,
                    device=list(devices) or None,
                    source=source,
                    reading=() if reading["camera"] is None else ("--camera", str(reading["camera"])),
                    outputs=outputs,
                    background=True,
                    tone_map=tone_map,
                    exposure=exposure,
                    **chosen,
                )
            with engine:
                serve(engine, listening, host, ready)
    except KeyboardInterrupt as end:
        if type(end) is not KeyboardInterrupt:  # SIGTERM, SIGHUP
            raise
