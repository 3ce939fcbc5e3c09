"""`clrender compare`: how far an image is from a reference."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import click

from clrender.cli.inputs import read_linear

__all__ = ["compare"]

_LINES: Final = (
    ("difference_of_means", "difference of means"),
    ("rmse", "RMSE"),
    ("relmse", "relMSE"),
    ("mean_relative_difference", "mean relative difference"),
    ("max_difference", "largest difference"),
    ("flip", "FLIP"),
)


@click.command()
@click.argument("image", metavar="A", type=click.Path(path_type=Path))
@click.argument("reference", metavar="B", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def compare(image: Path, reference: Path, as_json: bool) -> None:
    """Measure how far image A is from the reference B.

    Reads .npy .exr .hdr .film, and .png .jpg as a display shows them.
    """
    from clrender.compare import compare_images

    numbers = compare_images(read_linear(image)[0], read_linear(reference)[0])
    click.echo(json.dumps(numbers, indent=2) if as_json else _table(numbers))


def _table(numbers: dict[str, Any]) -> str:
    means = [
        ("mean of A", " ".join(f"{value:.6g}" for value in numbers["mean"])),
        ("mean of B", " ".join(f"{value:.6g}" for value in numbers["reference_mean"])),
    ]
    rows = means + [(name, "-" if numbers[key] is None else f"{numbers[key]:.6g}") for key, name in _LINES]
    rows.append(("identical", "yes" if numbers["identical"] else "no"))
    return "\n".join(f"{name:<26}{value}" for name, value in rows)
