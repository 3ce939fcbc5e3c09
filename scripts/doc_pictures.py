"""Shared by the scripts that make figures for docs/: display images of renders, and sheets of images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

import clrender
from clrender.image.tone_map import to_display

__all__ = ["DOCS", "shown", "shown_linear", "write_animation", "write_sheet"]

DOCS: Final = Path(__file__).resolve().parents[1] / "docs"


def shown(image: clrender.RenderedImage) -> Image.Image:
    """Display image of a render.

    Parameters
    ----------
    image : RenderedImage
    """
    return Image.fromarray(to_display(image.picture, exposure=image.camera_stops))


def shown_linear(linear: npt.NDArray[np.float32]) -> Image.Image:
    """Display image of radiance.

    Parameters
    ----------
    linear : (height, width, 3) float32
        Radiance, linear Rec. 709.
    """
    return Image.fromarray(to_display(linear, "srgb"))


def write_sheet(name: str, rows: Sequence[Sequence[Image.Image]], quality: int = 85, gap: int = 4) -> None:
    """Write images of equal size to docs/ as one sheet, in rows with white gaps.

    Parameters
    ----------
    name : str
        Name of the file.
    rows : sequence of sequences of Image
    quality : int
        Quality of the JPEG.
    gap : int
        Gap between two images, pixels.
    """
    width, height = rows[0][0].size
    size = (len(rows[0]) * (width + gap) - gap, len(rows) * (height + gap) - gap)
    sheet = Image.new("RGB", size, "white")
    for row, line in enumerate(rows):
        for column, picture in enumerate(line):
            sheet.paste(picture, (column * (width + gap), row * (height + gap)))
    path = DOCS / name
    sheet.save(path, quality=quality, optimize=True)
    print(f"{name}: {path.stat().st_size / 1024:.0f} KiB")


def write_animation(name: str, frames: Sequence[Image.Image], frames_per_second: int = 24, quality: int = 75) -> None:
    """Write images of equal size to docs/ as a WebP animation that repeats.

    Parameters
    ----------
    name : str
        Name of the file.
    frames : sequence of Image
    frames_per_second : int
    quality : int
        Quality of each frame, of 100.
    """
    path = DOCS / name
    duration = round(1000 / frames_per_second)
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=duration, loop=0, quality=quality, method=6)
    print(f"{name}: {path.stat().st_size / 1024:.0f} KiB")
