"""`clrender merge`: merges films of one render into one film."""

from __future__ import annotations

from pathlib import Path

import click

__all__ = ["merge"]


@click.command()
@click.argument("films", metavar="FILM...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", required=True, metavar="FILM", type=click.Path(path_type=Path), help="Output .film file."
)
def merge(films: tuple[Path, ...], output: Path) -> None:
    """Merge FILMs of the same request, such as the shards of a render, into one film.

    The result is identical, bit for bit, to that of a single render, in any order of the films. Films are refused if
    their samples overlap, or if their requests or kernels differ.
    """
    from clrender.cli.outputs import check_distinct
    from clrender.errors import UsageError
    from clrender.files import check_writable
    from clrender.film.merge import merge_films

    if output.suffix.lower() != ".film":
        raise UsageError(f"{output}: exact sums are kept in a .film; give it that ending")
    check_writable(output)
    check_distinct([output], films)
    merged = merge_films(films)
    merged.save(output)
    taken = merged.ledger.taken()
    samples = f"{taken.min()}" if taken.min() == taken.max() else f"{taken.min()} to {taken.max()}"
    click.echo(f"{output}: {merged.width}x{merged.height}, {samples} samples per pixel, of {len(films)} films")
