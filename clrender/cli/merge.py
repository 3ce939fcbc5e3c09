"""`clrender merge`: merges films of one render, and writes the film or its image."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from clrender.cli.options import exr_options, outputs_option, tone_options, view_options
from clrender.cli.outputs import check_distinct, check_formats, check_image_size, raise_last, write_each
from clrender.wording import counted, grouped

if TYPE_CHECKING:
    from clrender.image.tone_map import DisplayMap

__all__ = ["merge"]


@click.command()
@click.argument("films", metavar="FILM...", nargs=-1, required=True, type=click.Path(path_type=Path))
@outputs_option
@view_options
@tone_options
@exr_options
@click.pass_context
def merge(
    ctx: click.Context,
    /,
    *,
    films: tuple[Path, ...],
    outputs: tuple[Path, ...],
    tone_map: str | DisplayMap,
    exposure: float,
    f_stop: float | None,
    shutter: float | None,
    iso: float | None,
    **exr: Any,
) -> None:
    """Merge FILMs of the same request, such as the shards of a render, and write the film or its image.

    The result is identical, bit for bit, to that of a single render, in any order of the films. Films are refused if
    their samples overlap, or if their requests or kernels differ. Of one FILM, such as a checkpoint, it writes the
    image of the samples so far.
    """
    from clrender.film.merge import merge_films
    from clrender.image.exposure import camera_exposure, photographic_stops
    from clrender.image.files import check_output
    from clrender.rendering.rendered_image import RenderedImage

    for path in outputs:
        check_output(path)
    check_formats(ctx, outputs)
    check_distinct(outputs)
    merged = merge_films(films)
    check_image_size(outputs, merged.width, merged.height)
    camera = camera_exposure(merged.provenance, {"f_stop": f_stop, "shutter": shutter, "iso": iso})
    photographic_stops(**camera)  # refuses half of an exposure before anything is written
    told = {name: value for name, value in merged.provenance.items() if name != "layers"}  # which films do not hold
    told["camera_exposure"] = camera or None
    image = RenderedImage(merged.mean(), told, merged, interrupted=False)
    raise_last(write_each(outputs, lambda path: image.save(path, tone_map, exposure, **exr)))
    taken = merged.ledger.taken()
    least, most = int(taken.min()), int(taken.max())
    held = grouped(most) if least == most else f"{grouped(least)} to {grouped(most)}"
    asked = merged.provenance.get("spp")
    if isinstance(asked, int) and least < asked:  # a shard was forgotten, or the render was stopped
        samples = f"{held} of {counted(asked, 'sample')}"
    else:
        samples = f"{held} sample{'' if most == 1 else 's'}"
    click.echo(
        f"{' '.join(map(str, outputs))}: {merged.width}x{merged.height}, {samples} per pixel, of "
        f"{counted(len(films), 'film')}, image sha256 {image.stats['image_sha256']}"
    )
