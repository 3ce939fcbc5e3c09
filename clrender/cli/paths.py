"""`clrender paths`: the light paths of a pixel, as JSON or as a page."""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from clrender.cli.interrupt import interruptible
from clrender.cli.options import (
    device_option,
    environment_option,
    load_options,
    number,
    scene_argument,
    setting_options,
    size_option,
    tone_options,
)
from clrender.cli.outputs import check_distinct, raise_last, scene_files, write_each
from clrender.cli.streams import tell
from clrender.cli.waiting import Waiting
from clrender.errors import RenderError
from clrender.settings import SETTINGS, WORK
from clrender.wording import counted, grouped

if TYPE_CHECKING:
    from clrender.inspection import PathMaps, PixelPaths

__all__ = ["paths"]

_OTHERS: Final = ("reuse", "photon", "radiosity")
_WITHOUT: Final = frozenset(
    {"crop", "time_limit", "error", "confidence", "share", "error_floor"}
    | {name for name, each in SETTINGS.items() if each.group == WORK or each.integrator in _OTHERS}
) - {"max_memory"}
"""Settings that choose pixels or samples, divide the work, or are of integrators without light paths."""


def pixel(value: Any) -> tuple[int, int]:
    """Option type: a column and a row such as 400,300."""
    parts = str(value).split(",")
    if len(parts) != 2 or not all(part.strip().isascii() and part.strip().isdigit() for part in parts):
        raise click.BadParameter(f"{str(value)[:60]!r} is not a column and a row such as 400,300.")
    if max(len(part) for part in parts) > 9:
        raise click.BadParameter(f"{str(value)[:60]!r} is not within any image.")
    return int(parts[0]), int(parts[1])


@click.command()
@scene_argument
@click.option(
    "--pixel", "place", type=pixel, metavar="X,Y",
    help="Column and row of the pixel, from 0,0 at the upper left.",
)  # fmt: skip
@click.option(
    "--maps", is_flag=True,
    help="In the place of a pixel, maps of the image: what each bounce adds, lengths of paths, errors by strategy.",
)  # fmt: skip
@click.option(
    "--bounces", type=number(0, 32, whole=True), default=6, show_default=True, metavar="N",
    help="With --maps: scattering events that have a map of their own; there is one more for those after them.",
)  # fmt: skip
@click.option(
    "-o", "--output", "outputs", metavar="FILE", type=click.Path(path_type=Path), multiple=True, required=True,
    help="Output file: .json, or .html for a page with pictures; of maps also .exr. Repeatable.",
)  # fmt: skip
@click.option(
    "--samples", type=number(1, 2**20, whole=True), default=256, show_default=True, metavar="N",
    help="Number of samples whose vertices are written, those that contribute most; all are traced.",
)  # fmt: skip
@size_option
@device_option
@functools.partial(setting_options, without=_WITHOUT)
@environment_option
@functools.partial(tone_options, moving=True)
@click.option("--quiet", is_flag=True, help="No progress; only errors on stderr.")
@load_options
def paths(
    *,
    scene: str,
    place: tuple[int, int] | None,
    maps: bool,
    bounces: int,
    outputs: tuple[Path, ...],
    samples: int,
    size: tuple[int, int] | None,
    devices: tuple[str, ...],
    environment: Path | float | None,
    tone_map: str,
    exposure: float,
    f_stop: float | None,
    shutter: float | tuple[float, float] | None,
    iso: float | None,
    quiet: bool,
    reading: dict[str, Any],
    **settings: Any,
) -> None:
    """Show the light paths of a pixel of SCENE, or maps of where the light of its image comes from.

    With --pixel: every vertex, density, weight and contribution. The paths are those of `clrender render` with the same
    options, and add up to its pixel, bit for bit. They are sorted by what they contribute: the first ones are what
    makes a firefly. For the integrators path, direct, whitted and bdpt, and for guided paths. With bdpt, paths from
    lights that the camera sees add to the pixel, too; the line says how much.

    With --maps: what each bounce adds to the image, the mean length of the paths of each pixel, and the error of each
    strategy of sampling. For the integrator path.
    """
    from clrender.files.access import check_writable
    from clrender.importers import load
    from clrender.inspection.maps import PathMaps, check_maps_ending, maps_in
    from clrender.inspection.pipelines import check_integrator
    from clrender.inspection.pixel_paths import check_ending, check_pixel
    from clrender.inspection.tracing import paths_in
    from clrender.rendering.job import RenderJob
    from clrender.rendering.session import Session
    from clrender.rendering.telling import once

    if maps == (place is not None):
        raise click.UsageError("Give either --pixel X,Y, for the light paths of a pixel, or --maps.")
    for path in outputs:
        check_maps_ending(path) if maps else check_ending(path)
        check_writable(path)
    check_distinct(outputs)
    say = None if quiet else functools.partial(click.echo, err=True)
    with interruptible() as interrupt, Waiting(say) as waiting:
        waiting.stage("reading")
        photographic: dict[str, Any] = {"f_stop": f_stop, "shutter": shutter, "iso": iso}
        if isinstance(shutter, tuple):
            reading["shutter"], photographic["shutter"] = shutter, None
        description = load(scene, environment=environment, **reading).with_exposure(**photographic)
        chosen = {name: value for name, value in settings.items() if value is not None}
        job = RenderJob.of(description, size=size, **chosen)
        if place is not None:
            check_integrator(job.settings.integrator)
            check_pixel(place, job.settings.width, job.settings.height)
        check_distinct(outputs, scene_files(scene, description))
        pictured = any(path.suffix.lower() == ".html" for path in outputs)
        with Session(list(devices) or None, notify=once(say), on_stage=waiting.stage) as session:
            found: PixelPaths | PathMaps
            try:
                if place is None:
                    found = maps_in(session, job, bounces, should_stop=interrupt.wanted)
                else:
                    found = paths_in(session, job, place, samples, pictured, should_stop=interrupt.wanted)
            except RenderError:
                if not interrupt.wanted():
                    raise
                click.echo("error: interrupted; nothing was written", err=True)
                sys.exit(interrupt.exit_code)
        if isinstance(found, PathMaps):
            found = dataclasses.replace(found, stops=found.stops + exposure)
        elif found.surroundings is not None:
            stops = found.surroundings.stops + exposure
            around = dataclasses.replace(found.surroundings, stops=stops, tone_map=tone_map)
            found = dataclasses.replace(found, surroundings=around)
        interrupt.has_picture.set()  # writing is short and should not be interrupted
        raise_last(write_each(outputs, found.save))
    tell(_maps_line(found, outputs) if isinstance(found, PathMaps) else _result_line(found, outputs))
    if interrupt.wanted():
        sys.exit(interrupt.exit_code)


def _maps_line(found: PathMaps, outputs: Sequence[Path]) -> str:
    """Summary of maps in one line."""
    shares = found.shares
    largest = int(shares.argmax())
    words = f"{shares[largest]:.0%} of the light after {largest} scattering events"
    noise = ", ".join(f"{name} {value:.2%}" for name, value in found.noise.items())
    return f"{' '.join(map(str, outputs))}: {words}, errors of {noise}, image sha256 {found.about['image_sha256']}"


def _result_line(found: PixelPaths, outputs: Sequence[Path]) -> str:
    """Summary of the result in one line."""
    x, y = found.pixel
    red, green, blue = found.radiance.tolist()
    parts = [f"{' '.join(map(str, outputs))}: pixel {x},{y}", f"radiance {red:.6g} {green:.6g} {blue:.6g}"]
    first = found.samples[0]
    parts.append(f"{grouped(len(found.samples))} of {counted(len(found.values), 'sample')}")
    if first.finite:
        words = (
            f"sample {first.index} contributes most: {first.share:.1%} of the pixel, "
            f"{counted(len(first.vertices), 'vertex', 'vertices')}"
        )
        parts.append(words)
    if found.splats is not None:
        red, green, blue = found.splats.splatted.tolist()
        parts.append(f"{red:.6g} {green:.6g} {blue:.6g} of it splatted by paths from lights")
        if found.splats.paths:
            most = found.splats.paths[0]
            parts.append(f"light path {most.path} of sample {most.sample} splats most: {most.share:.1%} of the pixel")
    if found.nonfinite_samples:
        parts.append(f"{counted(found.nonfinite_samples, 'sample was', 'samples were')} not finite and left out")
    return ", ".join(parts)
