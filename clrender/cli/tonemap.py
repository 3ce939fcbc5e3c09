"""`clrender tonemap`: converts a linear image to a display image."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from clrender.cli.inputs import read_linear
from clrender.cli.options import tone_options, view_options
from clrender.cli.outputs import check_distinct, check_image_size, raise_last, write_each
from clrender.cli.streams import tell
from clrender.errors import UsageError
from clrender.image.exposure import camera_exposure, photographic_stops

if TYPE_CHECKING:
    from clrender.image.tone_map import DisplayMap

__all__ = ["tonemap"]


@click.command()
@click.argument("image", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    "outputs",
    metavar="FILE",
    type=click.Path(path_type=Path),
    required=True,
    multiple=True,
    help="Output file: .png or .jpg. Repeatable.",
)
@view_options
@tone_options
def tonemap(
    image: Path,
    outputs: tuple[Path, ...],
    tone_map: str | DisplayMap,
    exposure: float,
    **photograph: float | None,
) -> None:
    """Tone-map a linear IMAGE (.npy .exr .hdr .film) for display."""
    from clrender.image.files import (
        DISPLAY_ENDINGS,
        FILM_ENDINGS,
        LINEAR_ENDINGS,
        check_output,
        read_coverage,
        write_image,
    )
    from clrender.image.tone_map import record_of

    if image.suffix.lower() not in (*LINEAR_ENDINGS, *FILM_ENDINGS):
        known = ", ".join((*LINEAR_ENDINGS, *FILM_ENDINGS))
        raise UsageError(
            f"{image}: the ending {image.suffix!r} is not that of a linear image; expected one of {known}."
        )
    for output in outputs:
        if output.suffix.lower() in LINEAR_ENDINGS and image.suffix.lower() in FILM_ENDINGS:
            cure = f"`clrender merge {image} -o {output}` writes the linear image"
            raise UsageError(f"{output}: images for display are .png or .jpg; {cure}.")
        check_output(output, DISPLAY_ENDINGS)
    check_distinct(outputs)
    linear, provenance = read_linear(image)
    alpha = read_coverage(image)
    check_image_size(outputs, linear.shape[1], linear.shape[0])
    exposure += photographic_stops(**camera_exposure(provenance, photograph))
    if provenance is not None:
        provenance = {
            **{name: value for name, value in provenance.items() if name != "layers"},
            "stored": {**provenance.get("stored", {}), **record_of(tone_map, exposure)},
            **({} if alpha is None else {"layers": ["alpha"]}),
        }

    def write(output: Path) -> None:
        write_image(output, linear, provenance, tone_map, exposure, alpha=alpha)
        tell(f"{output}: {linear.shape[1]}x{linear.shape[0]}, {tone_map}, exposure {exposure:g}")

    raise_last(write_each(outputs, write))
