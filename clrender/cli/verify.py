"""`clrender verify`: verifies that an image is the result of the render in its metadata, or a data set of its own."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from clrender.cli.completing import complete_devices, complete_scenes
from clrender.cli.options import EnvironmentType, allow_path_option, number, plugin_option
from clrender.cli.progress import ProgressDisplay
from clrender.cli.streams import tell
from clrender.errors import UsageError
from clrender.wording import counted, grouped

if TYPE_CHECKING:
    from clrender.datasets import DatasetVerification
    from clrender.verification import Verification

__all__ = ["verify"]


@click.command()
@click.argument("image", type=click.Path(path_type=Path))
@click.option(
    "--fraction",
    type=number(0.0, 1.0, above=True),
    default=0.1,
    show_default=True,
    metavar="F",
    help="Fraction of the tiles (16 by 16 pixels), or of a data set's images, to render again, selected at random.",
)
@click.option(
    "--sample",
    type=number(1, 10**9, whole=True),
    metavar="N",
    help="Number of images of a data set to render again, in place of --fraction.",
)
@click.option(
    "--scene", metavar="SCENE", shell_complete=complete_scenes, help="Scene of the image (as named in the file)."
)
@click.option(
    "--environment",
    type=EnvironmentType(),
    metavar="FILE",
    help="Value of `render --environment` (as named in the file).",
)
@click.option(
    "--guiding-field",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Value of `render --guiding-field`, if the image was made with one.",
)
@click.option(
    "-d",
    "--device",
    "devices",
    metavar="SPEC",
    multiple=True,
    shell_complete=complete_devices,
    help="As for `clrender render`; any devices can be used.",
)
@click.option(
    "--seed",
    type=number(0, 2**32 - 1, whole=True),
    metavar="N",
    help="Seed of the selection of tiles, to repeat a check (random).",
)
@click.option("--json", "as_json", is_flag=True, help="Print the results as JSON.")
@click.option("--quiet", is_flag=True, help="No progress; only errors on stderr.")
@plugin_option
@allow_path_option
def verify(
    image: Path,
    fraction: float,
    sample: int | None,
    scene: str | None,
    environment: Path | float | None,
    guiding_field: Path | None,
    devices: tuple[str, ...],
    seed: int | None,
    as_json: bool,
    quiet: bool,
    plugins: tuple[Path, ...],
    allow_paths: tuple[Path, ...],
) -> None:
    """Render random tiles of IMAGE (.film .exr .png) again with its own settings and compare them bit for bit.

    IMAGE may also be the folder of a data set (`clrender dataset`): all of its files are compared with its manifest,
    and some of its images are rendered again.

    Reports the probability that this check detects wrong tiles. Exits with code 1 if anything differs, and with code 2
    if the file cannot be verified: if its scene is missing, it was made by other kernels, or its pixels were processed.
    """
    from clrender.verification import verify as verify_image

    if image.is_dir():
        _refuse_options(environment, guiding_field)
        _verify_dataset(image, fraction, sample, scene, devices, seed, as_json, quiet, plugins, allow_paths)
        return
    if sample is not None:
        raise UsageError("--sample is for data sets; of an image, --fraction says how many tiles are rendered again")
    with ProgressDisplay(quiet=quiet) as display:
        found = verify_image(
            image,
            fraction,
            scene=scene,
            environment=environment,
            guiding_field=guiding_field,
            allow_paths=allow_paths,
            plugins=plugins,
            device=list(devices) or None,
            seed=seed,
            on_progress=display,
            notify=display.say,
        )
    numbers = {**_numbers(found), "detection_of_one": found.detection(1)}
    _report(image, found, numbers if as_json else _confidence(found))


def _report(path: Path, found: Verification | DatasetVerification, conclusion: dict[str, object] | str) -> None:
    """Print the numbers, or the conclusion if nothing is wrong, and the faults; exit with 1 if there are any."""
    if not isinstance(conclusion, str):
        tell(json.dumps(conclusion, indent=2))
    elif found.sound:
        tell(f"{path}: {conclusion}")
    if not found.sound:
        for fault in found.faults:
            click.echo(f"error: {path}: verification failed: {fault}", err=True)
        sys.exit(1)


def _refuse_options(environment: Path | float | None, guiding_field: Path | None) -> None:
    for option, value in (("--environment", environment), ("--guiding-field", guiding_field)):
        if value is not None:
            raise UsageError(f"{option} is not for data sets, whose description says it; leave it out")


def _verify_dataset(
    folder: Path,
    fraction: float,
    sample: int | None,
    scene: str | None,
    devices: tuple[str, ...],
    seed: int | None,
    as_json: bool,
    quiet: bool,
    plugins: tuple[Path, ...],
    allow_paths: tuple[Path, ...],
) -> None:
    from clrender.datasets import verify_dataset

    found = verify_dataset(
        folder,
        fraction,
        sample=sample,
        scene=scene,
        allow_paths=allow_paths,
        plugins=plugins,
        device=list(devices) or None,
        seed=seed,
        notify=None if quiet else lambda line: click.echo(line, err=True),
    )
    _report(folder, found, _numbers(found) if as_json else _confidence_in_set(found))


def _numbers(found: Verification | DatasetVerification) -> dict[str, object]:
    least = found.detected() if found.sound else None
    return {**dataclasses.asdict(found), "sound": found.sound, "detected_95": least}


def _confidence_in_set(found: DatasetVerification) -> str:
    """The conclusion if nothing is wrong with a data set, as text."""
    done = (
        f"{counted(found.files, 'file')} of {counted(found.images, 'image')} as the manifest says, "
        f"{found.checked} rendered again"
    )
    line = f"{done}, identical bit for bit"
    if found.checked == found.images:
        return line
    least = found.detected()
    chance = f"would have been detected with probability {found.detection(least):.1%}"
    return f"{line}; if {least} or more were wrong together with the manifest, it {chance}"


def _confidence(found: Verification) -> str:
    """The conclusion if no difference was found, as text."""
    done = (
        f"{grouped(found.checked)} of {counted(found.tiles, 'tile')} rendered again "
        f"({counted(found.samples, 'sample')})"
    )
    if found.checked == found.tiles:
        return f"{done}, identical bit for bit"
    least = found.detected()
    return (
        f"{done}, identical bit for bit; if {least} or more of the {counted(found.tiles, 'tile')} were wrong, this "
        "check would "
        f"have detected it with probability {found.detection(least):.1%}, a single wrong tile with "
        f"{found.detection(1):.1%}"
    )
