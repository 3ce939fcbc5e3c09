"""Option types of the commands, and options that several share: numbers with bounds, sizes, folders to read from."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

__all__ = [
    "LIGHT_SAMPLERS",
    "PIXEL_LIMIT",
    "SIDE_LIMIT",
    "TONE_MAPS",
    "allow_path_option",
    "number",
    "size",
    "tone_options",
]

SIDE_LIMIT: Final = 65536
PIXEL_LIMIT: Final = 2**30
TONE_MAPS: Final = ("linear", "sqrt", "srgb", "reinhard", "aces", "agx")
"""The names of `clrender.image.tone_map.TONE_MAPS`, without loading NumPy for `--help`."""
LIGHT_SAMPLERS: Final = ("auto", "bvh", "power", "uniform")
"""Of `clrender.scene.lights.LIGHT_SAMPLERS`, likewise."""


def number(
    low: float, high: float = math.inf, *, whole: bool = False, above: bool = False, below: bool = False
) -> Callable[[Any], int | float]:
    """Option type: a finite number (or whole number) within bounds, with an error that names them.

    Parameters
    ----------
    low, high : float
        Smallest and largest value.
    whole : bool
        Whether fractions are refused.
    above : bool
        Whether `low` itself is refused.
    below : bool
        Whether `high` itself is refused.
    """
    bounds = f"above {low:.12g}" if above else f"of at least {low:.12g}"
    if math.isfinite(high):
        bounds += f" and {'below' if below else 'at most'} {high:.12g}"
    wanted = f"{'a whole number' if whole else 'a number'} {bounds}"

    def convert(value: Any) -> int | float:
        try:
            # Longer texts are no numbers a person means, and slow to convert.
            result = int(str(value)[:400]) if whole else float(value)
        except ValueError:
            raise click.BadParameter(f"{_shown(value)} is not {wanted}.") from None
        low_ok = result > low if above else result >= low
        high_ok = result < high if below else result <= high
        if not (low_ok and high_ok and result < math.inf):
            raise click.BadParameter(f"{_shown(value)} is not {wanted}.")
        return result

    convert.__name__ = "N" if whole else "X"
    return convert


def size(value: Any) -> tuple[int, int]:
    """Option type: an image size such as 800x600, as (width, height)."""
    match = re.fullmatch(r"(\d{1,9})[xX×](\d{1,9})", str(value), re.ASCII)
    if match is None:
        raise click.BadParameter(f"{_shown(value)} is not a size in pixels such as 800x600.")
    width, height = int(match[1]), int(match[2])
    if not (1 <= width <= SIDE_LIMIT and 1 <= height <= SIDE_LIMIT):
        raise click.BadParameter(f"{_shown(value)} does not have sides of 1 to {SIDE_LIMIT} pixels.")
    if width * height > PIXEL_LIMIT:
        raise click.BadParameter(f"{_shown(value)} is more than {PIXEL_LIMIT} pixels.")
    return width, height


def tone_options(command: Any) -> Any:
    """Decorator: the two options of every command that makes display images."""
    tone_map = click.option(
        "--tone-map", type=click.Choice(TONE_MAPS), default="srgb", show_default=True, help="For .png and .jpg."
    )
    exposure = click.option(
        "--exposure", type=number(-128, 128), default=0.0, show_default=True, metavar="EV", help="Stops, for display."
    )
    return tone_map(exposure(command))


def allow_path_option(command: Any) -> Any:
    """Decorator: where a scene that is rendered may read files from."""
    return click.option(
        "--allow-path",
        "allow_paths",
        type=click.Path(path_type=Path, exists=True, file_okay=False),
        metavar="DIR",
        multiple=True,
        help="A folder, besides the scene's own, that the scene may read files from. Repeatable.",
    )(command)


def _shown(value: object) -> str:
    text = str(value)
    return repr(text if len(text) <= 60 else f"{text[:57]}…")
