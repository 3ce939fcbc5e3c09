"""`clrender dataset`: makes a labelled data set of many images."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from clrender.cli.completing import complete_files
from clrender.cli.options import allow_path_option, device_option, plugin_option
from clrender.cli.outputs import check_folder, scene_files
from clrender.errors import UsageError
from clrender.limits import shown
from clrender.wording import counted, grouped

if TYPE_CHECKING:
    from clrender.datasets import DatasetPlan, DatasetProgress

__all__ = ["dataset"]

_FIRST_LINE = 2.0
_LINES_APART_AT_MOST = 60.0


def _images(value: Any) -> tuple[int, int]:
    """Option type: numbers of images such as 0:100, from the first to before the last."""
    match = re.fullmatch(r"(\d{1,9}):(\d{1,9})", str(value), re.ASCII)
    if match is None or int(match[1]) >= int(match[2]):
        raise click.BadParameter(f"{shown(value)} is no range of images such as 0:100, whose end is not included.")
    return int(match[1]), int(match[2])


def _part(value: Any) -> tuple[int, int]:
    """Option type: a part of the images such as 1/7."""
    match = re.fullmatch(r"(\d{1,7})/(\d{1,7})", str(value), re.ASCII)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise click.BadParameter(f"{shown(value)} is no part such as 1/7, from 1/N to N/N.")
    return int(match[1]), int(match[2])


@click.command()
@click.argument("spec", type=click.Path(path_type=Path), shell_complete=complete_files)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder of the data set; made if missing."
)
@click.option("--images", type=_images, metavar="A:B", help="Only the images from A to before B.")
@click.option("--part", type=_part, metavar="K/N", help="Only the K-th of N parts of the images.")
@click.option("--writers", metavar="LIST", help="images,coco,bop,transforms,webdataset (as the file says).")
@click.option(
    "--merge",
    "others",
    type=click.Path(path_type=Path),
    metavar="DIR",
    multiple=True,
    help="Copy the images of a part that was made in this folder, and render none. Repeatable.",
)
@click.option("--dry-run", is_flag=True, help="Print what each image would be, one JSON object a line.")
@device_option
@click.option("--quiet", is_flag=True, help="No progress; only errors on stderr.")
@plugin_option
@allow_path_option
def dataset(
    spec: Path,
    output: Path | None,
    images: tuple[int, int] | None,
    part: tuple[int, int] | None,
    writers: str | None,
    others: tuple[Path, ...],
    dry_run: bool,
    devices: tuple[str, ...],
    quiet: bool,
    plugins: tuple[Path, ...],
    allow_paths: tuple[Path, ...],
) -> None:
    """Make the data set that SPEC (.toml or .json) describes in DIR.

    Images that are there already are not rendered again. When all are there, the manifest is written, by which
    `clrender verify DIR` proves the data set. Parts may be made in the same folder, or merged from others.
    """
    from clrender.datasets import DatasetPlan, make_dataset, merge_datasets

    if output is None and not dry_run:
        raise UsageError("the option --output is missing; name the folder of the data set with -o DIR")
    names = None if writers is None else [name.strip() for name in writers.split(",") if name.strip()]
    plan = DatasetPlan.load(spec, names, allow_paths, plugins)
    wanted = _wanted(plan.spec.images, images, part)
    if dry_run:
        for line in () if quiet else plan.warnings:
            click.echo(line, err=True)
        for index in wanted:
            click.echo(json.dumps(_told(plan, index)))
        return
    assert output is not None
    from clrender.datasets.records import MANIFEST, RECORDS

    read = scene_files(str(spec.parent / plan.spec.scene), plan.base)
    read += [spec.parent / plan.spec.camera.file] if plan.spec.camera.file is not None else []
    check_folder(output, {MANIFEST, RECORDS, *plan.spec.writers}, read)
    if others:
        if images or part:
            raise UsageError("--merge copies all images that there are; leave --images and --part out")
        progress = merge_datasets(plan, output, others)
        click.echo(_result(output, plan, progress, "copied"))
        return
    show = None if quiet else _Lines()
    progress = make_dataset(
        plan,
        output,
        images=wanted,
        device=list(devices) or None,
        on_progress=show,
        notify=None if quiet else lambda line: click.echo(line, err=True),
    )
    click.echo(_result(output, plan, progress, "rendered"))


def _wanted(count: int, images: tuple[int, int] | None, part: tuple[int, int] | None) -> range:
    """Numbers of the images to make."""
    first, stop = images or (0, count)
    if stop > count:
        raise UsageError(f"--images {first}:{stop}: the data set has {counted(count, 'image')}, 0:{count}")
    if part is None:
        return range(first, stop)
    number, parts = part
    begin, end = (first + (stop - first) * each // parts for each in (number - 1, number))
    return range(begin, end)


def _told(plan: DatasetPlan, index: int) -> dict[str, Any]:
    """What an image would be."""
    from clrender.datasets.views import camera_told

    varied = plan.image(index)
    return {
        "image": index,
        "camera": camera_told(varied.moment.camera, varied.size),
        "drawn": varied.drawn,
        "seed": varied.seed,
    }


class _Lines:
    """Plain lines after 2, 4, 8, … seconds, then once a minute."""

    def __init__(self) -> None:
        self._next = _FIRST_LINE

    def __call__(self, progress: DatasetProgress) -> None:
        if progress.seconds < self._next:
            return
        self._next = progress.seconds + min(progress.seconds, _LINES_APART_AT_MOST)
        left = progress.seconds * (progress.total - progress.done) / progress.done
        line = (
            f"{grouped(progress.done)} of {counted(progress.total, 'image')}, {progress.rendered} rendered, "
            f"{left:.0f} s left"
        )
        click.echo(line, err=True)


def _result(folder: Path, plan: DatasetPlan, progress: DatasetProgress, what: str) -> str:
    """Summary of the result in one line."""
    parts = [f"{folder}: {counted(progress.rendered, 'image')} {what}"]
    if progress.missing:
        are = "is" if progress.missing == 1 else "are"
        parts.append(f"{grouped(progress.missing)} of {grouped(plan.spec.images)} {are} missing")
        return ", ".join(parts)
    from clrender.datasets.records import MANIFEST, file_sha256

    digest = file_sha256(folder / MANIFEST)
    return ", ".join([*parts, f"all {grouped(plan.spec.images)} are there, manifest sha256 {digest}"])
