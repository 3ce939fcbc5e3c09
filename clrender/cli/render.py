"""`clrender render`: renders a scene to image files."""

from __future__ import annotations

import functools
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from clrender.cli import STARTED
from clrender.cli.completing import complete_layers
from clrender.cli.frames import FRAMES_PER_SECOND, Frames, can_resume, check_one, frames, is_done, named
from clrender.cli.interrupt import Interrupt, interruptible
from clrender.cli.options import (
    DomainType,
    device_option,
    environment_option,
    exr_options,
    load_options,
    number,
    outputs_option,
    progress_options,
    scene_argument,
    setting_options,
    size_option,
    tone_options,
    view_options,
)
from clrender.cli.options import shard as parse_shard
from clrender.cli.outputs import (
    check_distinct,
    check_formats,
    check_image_size,
    raise_last,
    scene_files,
    write_each,
)
from clrender.cli.progress import STYLES, ProgressDisplay, ProgressView, duration, quantity
from clrender.cli.streams import tell
from clrender.cli.waiting import Waiting
from clrender.errors import RenderError, UsageError
from clrender.limits import Range
from clrender.wording import counted, grouped, rounded

if TYPE_CHECKING:
    from clrender.image.tone_map import DisplayMap
    from clrender.rendering.job import RenderJob
    from clrender.rendering.rendered_image import Progress, RenderedImage

__all__ = ["render"]

_FILM_PIXELS: Final = 1 << 24
"""Largest image, in pixels, whose exact sums stay in memory until its outputs are written: they take up to 0.9 GiB."""


@click.command()
@scene_argument
@outputs_option
@size_option
@device_option
@setting_options
@environment_option
@view_options
@functools.partial(tone_options, moving=True)
@click.option(
    "--aov",
    metavar="LIST",
    shell_complete=complete_layers,
    help="Layers of the .exr: alpha,albedo,emission,normal,normal_camera,tangent,depth,z_depth,position,uv,flow,"
    "scene_flow,"
    "object,material,instance,category,part,samples,crypto_object,crypto_material,stderr,unconverged.",
)
@click.option(
    "--amodal",
    metavar="LIST",
    help="Layers of the .exr with what these instances, or all, cover as if nothing stood before them.",
)
@click.option(
    "--light-groups",
    is_flag=True,
    help="Layers of the .exr with the part of each group of lights; they add up to the image.",
)
@click.option(
    "--spectrum",
    type=DomainType(Range(3, 300, whole=True)),
    default=None,
    metavar="N",
    help="With --spectral: layers of the .exr with the radiance in N bands of equal width from 360 to 830 nm.",
)
@click.option(
    "--alpha",
    is_flag=True,
    help="Coverage as fourth channel of .png and .exr; the camera does not see the environment.",
)
@exr_options
@click.option(
    "--shard",
    type=parse_shard,
    metavar="I/N",
    help="Render the I-th of N disjoint parts of the samples to a .film for `clrender merge`.",
)
@click.option(
    "--checkpoint",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Save the render to this film every few seconds and when it ends, for whatever reason.",
)
@click.option(
    "--resume",
    is_flag=True,
    help="Resume from the checkpoint, if it exists; --spp may be increased. With --frames: keep those that are done.",
)
@click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Render on a Dask cluster: tcp://host:8786 of its scheduler, or local:N for N processes on this machine.",
)
@click.option(
    "--guiding-field",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Guide paths by the field of this file instead of training one.",
)
@click.option(
    "--save-guiding-field",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the field that guided the paths to this file.",
)
@click.option(
    "--frames",
    type=frames,
    metavar="A:B[:S]",
    help="Render frames A to B (in steps of S) of an animation; outputs are named like frame_%04d.png.",
)
@click.option(
    "--fps",
    type=number(1e-3, 1e6),
    metavar="N",
    help=f"Frames per second, from time 0 on ({FRAMES_PER_SECOND:g}).",
)
@click.option("--denoise", is_flag=True, help="Denoise with Open Image Denoise; introduces bias.")
@click.option("--stats", type=click.Path(path_type=Path), metavar="FILE", help="Write render statistics as JSON.")
@progress_options
@load_options
@click.pass_context
def render(
    ctx: click.Context,
    /,
    *,
    scene: str,
    outputs: tuple[Path, ...],
    size: tuple[int, int] | None,
    devices: tuple[str, ...],
    environment: Path | float | None,
    tone_map: str | DisplayMap,
    exposure: float,
    f_stop: float | None,
    shutter: float | tuple[float, float] | None,
    iso: float | None,
    aov: str | None,
    amodal: str | None,
    light_groups: bool,
    spectrum: int | None,
    alpha: bool,
    exr_type: str,
    exr_compression: str,
    exr_tile: int | None,
    shard: tuple[int, int] | None,
    checkpoint: Path | None,
    resume: bool,
    cluster: str | None,
    denoise: bool,
    guiding_field: Path | None,
    save_guiding_field: Path | None,
    frames: Frames | None,
    fps: float | None,
    stats: Path | None,
    progress: str,
    preview: bool,
    quiet: bool,
    reading: dict[str, Any],
    **settings: Any,
) -> None:
    """Render SCENE (a scene or model file, or the name of a built-in scene) to FILE.

    Defaults, in parentheses, apply where neither the command line nor the scene sets a value. Ctrl-C stops within a
    second, writes the image so far and exits with code 130.
    """
    written = [*outputs, *(path for path in (stats, checkpoint, save_guiding_field) if path)]
    _check_frames(ctx, frames, outputs)
    _check_outputs(ctx, outputs if frames is None else named(outputs, frames.first), stats)
    _check_field(save_guiding_field, cluster)
    if denoise:
        from clrender.image.denoise import check_denoiser

        check_denoiser()
    _check_progress(progress, preview, quiet)
    how = {**_saving(checkpoint, resume and frames is None), **_on_cluster(cluster)}
    if frames is None:
        check_distinct(written)
    layers = _layers(aov, outputs)
    _check_layers(light_groups, "--light-groups", outputs)
    _check_layers(amodal is not None, "--amodal", outputs)
    _check_layers(spectrum is not None, "--spectrum", outputs)
    if alpha:
        layers, reading["hide_environment"] = _with_alpha(layers, outputs), True
    exr = {"exr_type": exr_type, "exr_compression": exr_compression, "exr_tile": exr_tile}
    _check_exr((*layers, "instance") if amodal else layers, exr)
    lost = "interrupted before the first sample; nothing was written"
    with interruptible(tells=not quiet and progress == "auto", lost=lost) as interrupt, ExitStack() as stack:
        from clrender.aov import FLOWS
        from clrender.importers import load
        from clrender.rendering.job import RenderJob
        from clrender.rendering.rendered_image import IncompleteRender

        begun = time.perf_counter()
        waiting = stack.enter_context(Waiting(None if quiet else STYLES[progress]().say))
        waiting.stage("reading")
        chosen = {name: value for name, value in settings.items() if value is not None}
        chosen |= {"aov": layers, "denoise": denoise, "guiding_field": guiding_field, "light_groups": light_groups}
        chosen |= {"amodal": amodal} if amodal else {}
        chosen |= {"spectrum": spectrum} if spectrum else {}
        photographic: dict[str, Any] = {"f_stop": f_stop, "shutter": shutter, "iso": iso}
        if isinstance(shutter, tuple):
            reading["shutter"], photographic["shutter"] = shutter, None

        def job_at(seconds: float | None) -> RenderJob:
            moment = {} if seconds is None else {"time_at": seconds}
            description = load(scene, environment=environment, **{**reading, **moment})
            if frames is not None and FLOWS.intersection(layers) and description.camera.flow_step is None:
                description = description.changed({"camera.flow_step": frames.step / (fps or FRAMES_PER_SECOND)})
            return RenderJob.of(description.with_exposure(**photographic), size=size, **chosen)

        if frames is not None:
            _render_frames(
                frames,
                1.0 / (fps or FRAMES_PER_SECOND),
                job_at,
                outputs,
                scene,
                devices,
                interrupt,
                waiting,
                {"tone_map": tone_map, "exposure": exposure, **exr},
                resume,
                quiet,
                progress,
            )
            return
        job = job_at(None)
        read_seconds = time.perf_counter() - begun
        check_distinct(written, scene_files(scene, job.scene))
        if save_guiding_field is not None and job.settings.guiding == "off":
            raise UsageError("--save-guiding-field: no field guides this render; ask for one with --guiding on")
        job = job.shard(*shard) if shard else job
        check_image_size(outputs, *job.settings.film_size)
        view = None if quiet else _view(job, progress, preview, tone_map, exposure)
        called = time.perf_counter()
        failure = None
        try:
            image = _run(job, devices, interrupt, view, {**how, "keep_film": _keeps_film(job, outputs)}, waiting)
        except IncompleteRender as error:
            failure, image = error, error.image
        if not image.film.samples:
            _end_if(interrupt)
        # The renderer's times start at its call; users expect them from the start of the command.
        for name in ("read_seconds", "load_seconds"):
            image.stats[name] = image.stats.get(name, 0.0) + read_seconds
        image.stats["setup_seconds"] = image.stats.get("setup_seconds", 0.0) + called - STARTED
        how_written = {"tone_map": tone_map, "exposure": exposure, **exr}
        line = functools.partial(_result_line, image, outputs)
        _write(image, outputs, how_written, line, stats, checkpoint, save_guiding_field)
    if failure is not None:
        raise RenderError(f"{failure}; {' '.join(map(str, outputs))} contains the samples taken until then")
    if interrupt.wanted():
        sys.exit(interrupt.exit_code)


def _check_frames(ctx: click.Context, frames: Frames | None, outputs: Sequence[Path]) -> None:
    """Check that nothing contradicts --frames, nor is for it alone."""
    given = ctx.params
    if frames is None:
        if given["fps"] is not None:
            raise UsageError("--fps: is for --frames; leave it out, or name the frames")
        check_one(outputs)
        return
    of_one = ("time_at", "shard", "checkpoint", "cluster", "stats", "save_guiding_field", "preview", "time_limit")
    options = {name: next(each for each in ctx.command.params if each.name == name).opts[-1] for name in of_one}
    frames.check(outputs, {option: given[name] for name, option in options.items()}, given["resume"])


def _render_frames(
    frames: Frames,
    spacing: float,
    job_at: Callable[[float | None], RenderJob],
    outputs: Sequence[Path],
    scene: str,
    devices: Sequence[str],
    interrupt: Interrupt,
    waiting: Waiting,
    how: Mapping[str, Any],
    resume: bool,
    quiet: bool,
    progress: str,
) -> None:
    """Render one frame after the other, in one session; one that is interrupted is not written.

    Parameters
    ----------
    frames : Frames
    spacing : float
        Seconds between two frames.
    job_at : callable
        The job of the image at a time.
    outputs : sequence of pathlib.Path
        Patterns of names of a frame's files.
    scene : str
        As the command has it.
    devices : sequence of str
    interrupt : Interrupt
    waiting : Waiting
    how : mapping
        How files are written.
    resume : bool
        Keep frames that are done.
    quiet, progress
        Of the display.
    """
    from clrender.rendering.session import Session
    from clrender.rendering.telling import once

    style = None if quiet else STYLES[progress]()
    kept = 0
    others_kept = "--resume keeps the others" if can_resume(outputs) else "the others are written"
    with Session(list(devices) or None, notify=once(waiting.say), on_stage=waiting.stage) as session:
        for number in frames:
            others = "nothing was written" if number == frames.first else others_kept
            interrupt.lost = f"interrupted before frame {number} was done; {others}"
            _end_if(interrupt)
            paths, job = named(outputs, number), job_at(number * spacing)
            if number == frames.first:
                every = (path for each in frames for path in named(outputs, each))
                check_distinct(every, scene_files(scene, job.scene))
                check_image_size(paths, *job.settings.film_size)
            if resume and is_done(paths, job, how):
                kept += 1
                continue
            with ProgressDisplay(quiet=style is None, view=None if quiet else STYLES[progress]()) as display:
                image = session.render(
                    job, on_progress=display, should_stop=interrupt.wanted, keep_film=_keeps_film(job, paths)
                )
                display.finish(image)
            _end_if(interrupt)
            interrupt.has_picture.set()  # what is rendered is written
            _write(image, paths, how, functools.partial(_result_line, image, paths, f"frame {number}: "))
            interrupt.has_picture.clear()
    if kept:
        tell(f"{grouped(kept)} of {counted(len(frames), 'frame was', 'frames were')} done before")
    if interrupt.wanted():  # too late
        sys.exit(interrupt.exit_code)


def _end_if(interrupt: Interrupt) -> None:
    """End the program if the user has requested it."""
    if interrupt.wanted():
        click.echo(f"error: {interrupt.lost}", err=True)
        sys.exit(interrupt.exit_code)


def _check_outputs(ctx: click.Context, outputs: Sequence[Path], stats: Path | None) -> None:
    """Check that every output can be written, and that every requested result has an output."""
    from clrender.files.access import check_writable
    from clrender.image.files import FILM_ENDINGS, check_output

    for path in outputs:
        check_output(path)
    if stats is not None:
        check_writable(stats)
    check_formats(ctx, outputs)
    endings = {path.suffix.lower() for path in outputs}
    if ctx.params["shard"] and not endings.issubset(FILM_ENDINGS):
        other = next(path for path in outputs if path.suffix.lower() not in FILM_ENDINGS)
        raise UsageError(f"{other}: a shard holds a part of the samples; write it to a .film, for `clrender merge`")
    if ctx.params["denoise"] and endings.issubset(FILM_ENDINGS):
        raise UsageError("--denoise: a .film holds the exact sums; name another output with -o, or leave it out")


def _check_field(path: Path | None, cluster: str | None) -> None:
    """Check that a guiding field can be written."""
    if path is None:
        return
    from clrender.files.access import check_writable

    if cluster is not None:
        raise UsageError("--save-guiding-field: with --cluster the field is on the workers; save it from a render here")
    check_writable(path)


def _save_field(image: RenderedImage, path: Path) -> None:
    """Write the field that guided an image."""
    if image.guiding_field is None:
        unpaid = "guided" in image.stats and not image.stats["guided"]
        why = "by its training, guiding does not pay here" if unpaid else "no field was trained in this render"
        click.echo(f"warning: {path} was not written: {why}", err=True)
    else:
        image.guiding_field.save(path)


def _layers(aov: str | None, outputs: Sequence[Path]) -> tuple[str, ...]:
    """Parse the list of --aov, and check that an output can hold the layers."""
    if aov is None:
        return ()
    from clrender.aov import AOVS, check_aovs

    layers = check_aovs(name.strip() for name in aov.split(",") if name.strip())
    if not layers:
        raise UsageError(f"--aov is {aov!r}, but must be a list of {', '.join(AOVS)}")
    if layers == ("alpha",):
        _check_alpha("--aov alpha", outputs)
    else:
        _check_layers(True, "--aov", outputs)
    return layers


def _check_layers(wanted: bool, option: str, outputs: Sequence[Path]) -> None:
    """Check that an output can hold layers."""
    if wanted and not any(path.suffix.lower() == ".exr" for path in outputs):
        raise UsageError(f"{option}: only .exr files hold layers; name one with -o, such as -o image.exr")


def _with_alpha(layers: Sequence[str], outputs: Sequence[Path]) -> tuple[str, ...]:
    """The layers and alpha, after checking that an output can hold it."""
    _check_alpha("--alpha", outputs)
    return tuple(dict.fromkeys((*layers, "alpha")))


def _check_alpha(option: str, outputs: Sequence[Path]) -> None:
    """Check that an output can hold a fourth channel."""
    if not any(path.suffix.lower() in (".png", ".exr") for path in outputs):
        raise UsageError(
            f"{option}: only .png and .exr files hold a fourth channel; name one with -o, such as -o image.png"
        )


def _check_exr(layers: Sequence[str], exr: Mapping[str, Any]) -> None:
    """Check that the format of the `.exr` preserves the layers."""
    if layers:
        from clrender.image.exr_write import ExrFormat
        from clrender.rendering.rendered_image import check_mattes

        check_mattes(layers, ExrFormat(*exr.values()))


def _saving(checkpoint: Path | None, resume: bool) -> dict[str, Any]:
    """Arguments of the renderer for a checkpoint, after checking that it can be written."""
    if checkpoint is None:
        if resume:
            raise UsageError("--resume: there is no checkpoint to resume from; name it with --checkpoint FILE")
        return {}
    from clrender.film.checkpoint import check_checkpoint

    check_checkpoint(checkpoint, resume)
    return {"checkpoint": checkpoint, "resume": resume}


def _on_cluster(address: str | None) -> dict[str, Any]:
    """Arguments of the renderer for a cluster, after checking its address without connecting."""
    if address is None:
        return {}
    from clrender.cluster.address import check_address

    try:
        check_address(address)
    except UsageError as error:
        if not str(error).startswith("cluster is"):
            raise
        raise UsageError(f"--{error}") from None
    return {"cluster": address}


def _check_progress(progress: str, preview: bool, quiet: bool) -> None:
    """Check that at most one kind of progress display is requested."""
    if quiet and progress == "json":
        raise UsageError("--quiet and --progress json contradict each other; leave one out")
    if preview and (quiet or progress == "json"):
        other = "--quiet" if quiet else "--progress json"
        raise UsageError(f"--preview and {other} contradict each other; leave one out")


def _view(job: RenderJob, progress: str, preview: bool, tone_map: str | DisplayMap, exposure: float) -> ProgressView:
    """The display of progress."""
    if preview:
        from clrender.cli.preview import preview_here
        from clrender.image.exposure import photographic_stops

        view = preview_here(tone_map, exposure + photographic_stops(**(job.scene.camera.exposure or {})))
        if view is not None:
            return view
    return STYLES[progress]()


def _keeps_film(job: RenderJob, outputs: Sequence[Path]) -> bool:
    """Whether the exact sums stay in memory until all outputs are written, in case that one of them cannot be."""
    wanted = any(path.suffix.lower() == ".film" for path in outputs)
    return wanted or math.prod(job.settings.film_size) <= _FILM_PIXELS


def _run(
    job: RenderJob,
    devices: Sequence[str],
    interrupt: Interrupt,
    view: ProgressView | None,
    how: Mapping[str, Any],
    waiting: Waiting,
) -> RenderedImage:
    from clrender.api import render as render_scene

    with ProgressDisplay(quiet=view is None, view=view) as display:
        waiting.say = display.say

        def on_progress(progress: Progress) -> None:
            if progress.samples_done:
                interrupt.has_picture.set()
            display(progress)

        image = render_scene(
            job,
            device=list(devices) or None,
            on_progress=on_progress,
            should_stop=interrupt.wanted,
            notify=display.say,
            on_stage=waiting.stage,
            **how,
        )
        display.finish(image)
    return image


def _write(
    image: RenderedImage,
    outputs: Sequence[Path],
    how: Mapping[str, Any],
    line: Callable[[], str],
    stats: Path | None = None,
    checkpoint: Path | None = None,
    field: Path | None = None,
) -> None:
    """Write all outputs, and print a line if all of the image are; the render is kept somewhere if one cannot be.

    Errors are raised only after everything else has been tried.
    """
    from clrender.files.access import atomic_write

    numbers = image.stats
    rendered = time.perf_counter()

    def clocked() -> None:
        numbers["write_seconds"] = time.perf_counter() - rendered
        numbers["wall_seconds"] = time.perf_counter() - STARTED

    def write(path: Path) -> None:
        clocked()
        image.save(path, **how)

    def write_stats(path: Path) -> None:
        with atomic_write(path) as file:
            file.write(json.dumps(numbers, indent=2).encode() + b"\n")

    failures = write_each(outputs, write)
    kept = _kept(image, outputs, list(failures), checkpoint)
    clocked()
    if not failures:
        tell(line())
    if stats is not None:
        failures |= write_each([stats], write_stats)
    if field is not None:
        failures |= write_each([field], lambda path: _save_field(image, path))
    raise_last(failures, kept)


def _kept(image: RenderedImage, outputs: Sequence[Path], failed: Sequence[Path], checkpoint: Path | None) -> str:
    """Make sure that a render of which outputs could not be written is not lost; returns words for the error."""
    from clrender.cli.rescue import rescue

    exact = (".film", ".npy", ".exr")
    if not failed or any(path.suffix.lower() in exact for path in outputs if path not in failed):
        return ""
    place = rescue(image, failed[0])
    if place is None:
        place = checkpoint if checkpoint is not None and checkpoint.exists() else None
    if place is None:
        return "; no folder takes a film of the render either, so it is lost"
    return f"; the render is kept in {place}, from which `clrender tonemap` makes a picture"


def _result_line(image: RenderedImage, outputs: Sequence[Path], begin: str = "") -> str:
    """Summary of the result in one line."""
    numbers = image.stats
    height, width = image.linear.shape[:2]
    wanted = numbers.get("sample_count", numbers["spp"])
    total = width * height * wanted
    held = image.film.samples
    parts = [f"{begin}{' '.join(map(str, outputs))}: {width}x{height}"]
    if image.interrupted:
        parts.append(
            f"stopped early with {grouped(held)} of {counted(total, 'sample')} ({rounded(held / (width * height))} "
            "a pixel)"
        )
    else:
        parts.append(f"{counted(wanted, 'sample')} per pixel")
    if "converged" in numbers:
        parts.append(_convergence_words(numbers, width * height))
    resumed = numbers.get("resumed_samples", 0)
    if resumed:
        parts.append(f"{resumed / held:.0%} of them from the checkpoint")
    seconds = numbers["render_seconds"]
    speed = quantity((held - resumed) / seconds) if seconds > 0 else "-"
    parts.append(f"{seconds:.2f} s" if seconds < 10 else duration(seconds))
    parts.append(f"{speed} samples/s on {_device_names(numbers)}")
    if numbers.get("nonfinite_samples"):
        parts.append(f"{counted(numbers['nonfinite_samples'], 'sample was', 'samples were')} not finite and discarded")
    parts.append(f"image sha256 {numbers['image_sha256']}")
    return ", ".join(parts)


def _convergence_words(numbers: Mapping[str, Any], pixels: int) -> str:
    """Convergence of a render that stops by its error, as text."""
    left = numbers["unconverged_pixels"]
    how = f"within {numbers['error']:.3g} of their luminance at {numbers['confidence']:.4g} confidence"
    if numbers["converged"]:
        return f"converged: {grouped(pixels - left)} of {counted(pixels, 'pixel')} ({1.0 - left / pixels:.2%}) {how}"
    return f"{grouped(left)} of {counted(pixels, 'pixel')} ({left / pixels:.2%}) not {how}: NOT CONVERGED"


def _device_names(numbers: Mapping[str, Any]) -> str:
    """Names of the devices; for a cluster, with the number of each kind."""
    names = [device["name"] for device in numbers["devices"]]
    if "cluster" in numbers:
        names = [name if count == 1 else f"{count} x {name}" for name, count in Counter(names).items()]
    return ", ".join(names)
