"""`clrender render`: a scene becomes image files."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

import click

from clrender.cli import STARTED
from clrender.cli.interrupt import INTERRUPTED, Interrupt, interruptible
from clrender.cli.options import LIGHT_SAMPLERS, allow_path_option, number, tone_options
from clrender.cli.options import size as parse_size
from clrender.cli.progress import ProgressDisplay, ProgressLike, duration, quantity
from clrender.errors import ClrenderError, UsageError
from clrender.integrators import INTEGRATORS

if TYPE_CHECKING:
    from clrender.rendered_image import RenderedImage
    from clrender.scene import Scene

__all__ = ["render"]

_FILM_BYTES: Final = 52
"""Memory a pixel takes while it is rendered."""


@click.command()
@click.argument("scene", metavar="SCENE")
@click.option(
    "-o",
    "--output",
    "outputs",
    metavar="FILE",
    type=click.Path(path_type=Path),
    multiple=True,
    required=True,
    help="Where to: .png .jpg for display, .exr .npy .hdr linear, .film exact sums. Repeatable.",
)
@click.option("--spp", type=number(1, 2**20, whole=True), help="Samples per pixel (from the scene, else 64).")
@click.option("--size", type=parse_size, metavar="WxH", help="Pixels (from the scene, else 800x800).")
@click.option("--seed", type=number(0, 2**32 - 1, whole=True), help="Another seed, other noise (0).")
@click.option(
    "-d",
    "--device",
    "devices",
    metavar="SPEC",
    multiple=True,
    help="auto, cpu, gpu, all, an index of `clrender devices` or a part of a name; repeatable "
    "(CLRENDER_DEVICE, else auto).",
)
@click.option("--integrator", type=click.Choice(tuple(INTEGRATORS)), help="How light is followed (path).")
@click.option("--shadow-rays", type=number(1, 4096, whole=True), help="Rays to lights per diffuse hit (1).")
@click.option(
    "--indirect-rays",
    type=number(0, 4096, whole=True),
    help="New rays from the first diffuse hit (1); 0: direct light only.",
)
@click.option(
    "--max-depth", type=number(0, 2**31 - 1, whole=True), help="Scattering events at most; 0: emission only (no limit)."
)
@click.option(
    "--light-sampler",
    type=click.Choice(LIGHT_SAMPLERS),
    help="How one of many lights is picked: by what each can give there, by power, alike (auto: the tree from 16 on).",
)
@click.option("--roulette", type=click.Choice(("throughput", "absorption", "none")), help="How paths end (throughput).")
@click.option(
    "--absorption", type=number(0, 1, below=True), metavar="A", help="Probability to end a path at every hit."
)
@click.option(
    "--reuse",
    type=click.Choice(("1", "2", "4", "8", "16")),
    help="Pixels that share their indirect light, for --integrator reuse (16).",
)
@click.option(
    "--photons",
    type=number(1, 2**26, whole=True),
    metavar="N",
    help="Photons for each sample, for --integrator photon (131072).",
)
@click.option(
    "--photon-radius",
    type=number(0, above=True),
    metavar="R",
    help="Metres around a point in which the first sample looks for them (a hundredth of the scene's).",
)
@click.option("--patches", type=number(1, 2**20, whole=True), help="Of radiosity: how many, about (8000).")
@click.option("--patch-rays", type=number(1, 2**16, whole=True), metavar="N", help="Of radiosity: from each (256).")
@click.option(
    "--radiosity-display",
    type=click.Choice(("constant", "smooth", "gather")),
    help="Patches evenly bright, interpolated, or looked up by paths after three bounces (smooth).",
)
@tone_options
@click.option(
    "--aov",
    metavar="LIST",
    default="",
    help="Layers of an .exr: albedo,normal,depth,position,object,material,samples.",
)
@click.option("--denoise", is_flag=True, help="Take the noise off with Open Image Denoise.")
@click.option("--tile", type=number(1, 65536, whole=True), help="Side of a tile; never changes the image.")
@click.option(
    "--samples-per-pass",
    type=number(1, 2**20, whole=True),
    metavar="K",
    help="Samples at once; never changes the image.",
)
@click.option("--work-group", type=number(1, 4096, whole=True), help="Work-items; never changes the image.")
@click.option(
    "--lanes",
    type=click.Choice(("1", "4", "8", "16")),
    help="Paths side by side in a work-item; never changes the image.",
)
@click.option(
    "--time",
    "time_limit",
    type=number(0, above=True),
    metavar="S",
    help="Stop after S seconds and write what there is.",
)
@click.option(
    "--stats", type=click.Path(path_type=Path), metavar="FILE", help="Write numbers about the render as JSON."
)
@click.option("--quiet", is_flag=True, help="No progress; nothing on stderr but errors.")
@allow_path_option
def render(
    *,
    scene: str,
    outputs: tuple[Path, ...],
    size: tuple[int, int] | None,
    devices: tuple[str, ...],
    lanes: str | None,
    reuse: str | None,
    tone_map: str,
    exposure: float,
    aov: str,
    denoise: bool,
    stats: Path | None,
    quiet: bool,
    allow_paths: tuple[Path, ...],
    **settings: Any,
) -> None:
    """Render SCENE (a .toml or .json file, or a name of `clrender scenes`) to FILE.

    Ctrl-C stops within a second, writes the image so far and exits with 130.
    """
    _check_outputs(outputs, stats)
    layers = _layers(aov, outputs)
    with interruptible() as interrupt:
        from clrender.scene import load

        begun = time.perf_counter()
        description = load(scene, allow_paths=allow_paths)
        load_seconds = time.perf_counter() - begun
        width, height = size or (description.image.width, description.image.height)
        _check_memory(width, height)
        chosen = {name: value for name, value in settings.items() if value is not None}
        chosen |= {"width": width, "height": height}
        chosen |= ({"aov": layers} if layers else {}) | ({"denoise": True} if denoise else {})
        if lanes is not None:
            chosen["lanes"] = int(lanes)
        if reuse is not None:
            chosen["reuse"] = int(reuse)
        called = time.perf_counter()
        keep_film = any(path.suffix.lower() == ".film" for path in outputs)
        image = _run(description, devices, interrupt, quiet, keep_film, chosen)
        if interrupt.wanted() and not image.film.samples:
            _end_interrupted("interrupted before the first sample; nothing was written")
        # The renderer counts from its call; the user from the command.
        image.stats["load_seconds"] = image.stats.get("load_seconds", 0.0) + load_seconds
        image.stats["setup_seconds"] = image.stats.get("setup_seconds", 0.0) + called - STARTED
        _write(image, outputs, tone_map, exposure, stats)
    click.echo(_result_line(image, outputs))
    if interrupt.wanted():
        sys.exit(INTERRUPTED)


def _end_interrupted(message: str) -> NoReturn:
    """End the program as interrupted."""
    click.echo(f"error: {message}", err=True)
    sys.exit(INTERRUPTED)


def _check_outputs(outputs: Sequence[Path], stats: Path | None) -> None:
    from clrender.files import check_writable
    from clrender.image.files import check_output

    for path in outputs:
        check_output(path)
    if stats is not None:
        check_writable(stats)
    places = [os.path.realpath(path) for path in (*outputs, *([stats] if stats else []))]
    for place in places:
        if places.count(place) > 1:
            raise UsageError(f"{place}: is named twice as an output; give each output a name of its own.")


def _layers(aov: str, outputs: Sequence[Path]) -> tuple[str, ...]:
    """Names in the list of --aov, and a file to hold them."""
    from clrender.aov import check_aovs

    layers = check_aovs(name.strip() for name in aov.split(",") if name.strip())
    if layers and not any(path.suffix.lower() == ".exr" for path in outputs):
        raise UsageError("--aov: only .exr files hold layers; name one with -o, such as -o image.exr")
    return layers


def _check_memory(width: int, height: int) -> None:
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # a system that does not tell
        return
    wanted = width * height * _FILM_BYTES
    if wanted > memory:
        raise UsageError(
            f"--size: an image of {width}x{height} pixels takes {wanted / 2**30:.1f} GiB of memory and this machine "
            f"has {memory / 2**30:.1f}; ask for a smaller one."
        )


def _run(
    description: Scene,
    devices: Sequence[str],
    interrupt: Interrupt,
    quiet: bool,
    keep_film: bool,
    settings: Mapping[str, Any],
) -> RenderedImage:
    from clrender.rendering import render as render_scene

    with ProgressDisplay(quiet=quiet) as display:

        def on_progress(progress: ProgressLike) -> None:
            if progress.samples_done:
                interrupt.has_picture.set()
            display(progress)

        return render_scene(
            description,
            device=list(devices) or None,
            on_progress=on_progress,
            should_stop=interrupt.wanted,
            notify=display.say,
            keep_film=keep_film,
            **settings,
        )


def _write(image: RenderedImage, outputs: Sequence[Path], tone_map: str, exposure: float, stats: Path | None) -> None:
    """Write everything that can be written, then complain about the rest."""
    from clrender.files import atomic_write

    numbers = image.stats
    rendered = time.perf_counter()
    failures: list[ClrenderError] = []
    for path in outputs:
        numbers["write_seconds"] = time.perf_counter() - rendered
        numbers["wall_seconds"] = time.perf_counter() - STARTED
        try:
            image.save(path, tone_map=tone_map, exposure=exposure)
        except ClrenderError as error:
            failures.append(error)
    numbers["write_seconds"] = time.perf_counter() - rendered
    numbers["wall_seconds"] = time.perf_counter() - STARTED
    if stats is not None:
        try:
            with atomic_write(stats) as file:
                file.write(json.dumps(numbers, indent=2).encode() + b"\n")
        except ClrenderError as error:
            failures.append(error)
    for failure in failures[:-1]:
        click.echo(f"error: {str(failure).rstrip('.')}", err=True)
    if failures:
        raise failures[-1]


def _result_line(image: RenderedImage, outputs: Sequence[Path]) -> str:
    """What there is now, in one line."""
    numbers = image.stats
    height, width = image.linear.shape[:2]
    total = width * height * numbers["spp"]
    held = image.film.samples
    parts = [f"{' '.join(map(str, outputs))}: {width}x{height}"]
    if image.interrupted:
        parts.append(f"stopped early with {held} of {total} samples ({held / (width * height):.3g} a pixel)")
    else:
        parts.append(f"{numbers['spp']} samples a pixel")
    seconds = numbers["render_seconds"]
    speed = quantity(held / seconds) if seconds > 0 else "-"
    parts.append(f"{seconds:.2f} s" if seconds < 10 else duration(seconds))
    parts.append(f"{speed} samples/s on {', '.join(device['name'] for device in numbers['devices'])}")
    if numbers.get("nonfinite_samples"):
        parts.append(f"{numbers['nonfinite_samples']} samples were not finite and are left out")
    return ", ".join(parts)
