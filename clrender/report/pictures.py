"""The report's figures that consist of images side by side, whole and in detail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from clrender.drawing.pictures import jpeg, shrunk
from clrender.image.tone_map import to_display
from clrender.report.results import Results

__all__ = ["Figure", "Panel", "figures", "strip"]

_Pixels = npt.NDArray[np.uint8]
_Images = Mapping[str, npt.NDArray[Any]]

_WHOLE: Final = 480
"""Largest longer side of a whole image, pixels."""

_STRIP_BYTES: Final = 60_000
_STRIP_PANEL: Final = 280
_GAP: Final = 6

# Left, top and side of square details, as fractions of the image.
_SPHERE: Final = (0.54, 0.58, 0.40)
_SHADOW: Final = (0.50, 0.70, 0.30)
_NOISE: Final = (0.42, 0.62, 0.25)


@dataclass(frozen=True)
class Panel:
    """An image of a figure, (H, W, 3) display pixels, and its label."""

    pixels: _Pixels
    words: str


@dataclass(frozen=True)
class Figure:
    """A figure of the report, or an additional one.

    Attributes
    ----------
    name : str
        Name of its file.
    title, caption : str
    rows : sequence of sequence of Panel
        Images, row by row; empty if there is a drawing.
    svg : str
        The drawing.
    """

    name: str
    title: str
    caption: str
    rows: Sequence[Sequence[Panel]] = field(default_factory=tuple)
    svg: str = ""


def figures(images: _Images, results: Results) -> list[Figure]:
    """All figures that consist of images.

    Parameters
    ----------
    images : mapping
        See `clrender.report.runs.Measured`.
    results : Results
        For the captions.
    """
    return [
        Figure(
            "figure-2-5",
            "Figures 2 and 5: reflection, colour bleeding, soft shadows",
            "A mirror sphere reflects the room (room-mirror). The green wall bleeds colour onto the white sphere "
            "beside it. Area lights cast soft shadows.",
            [
                [
                    Panel(_whole(images["mirror"]), "reflection"),
                    Panel(_detail(images["reference"], _SPHERE), "colour bleeding"),
                    Panel(_detail(images["reference"], _SHADOW), "soft shadows"),
                ]
            ],
        ),
        Figure(
            "figure-4",
            "Figure 4: direct and indirect light, and direct light only",
            f"{-100 * results.beside_reference(results.direct_mean):.0f} % of the light on surfaces is indirect: "
            "without it the ceiling and the shadows are black.",
            [
                [
                    Panel(_whole(images["reference"]), "direct and indirect"),
                    Panel(_whole(images["direct"]), "direct only"),
                ]
            ],
        ),
        Figure(
            "figure-6",
            "Figure 6: tone curves",
            "The square root, which the report calls logarithmic (it is a power law), and linear display of the same "
            "render.",
            [
                [
                    Panel(_whole(images["reference"]), "square root"),
                    Panel(_whole(images["reference"], "linear"), "linear"),
                ]
            ],
        ),
        _compared(
            "figure-7", "Figure 7: samples", "256, 64 and 16 samples per pixel, two shadow rays.", images,
            {"samples-256": "256 samples", "samples-64": "64 samples", "samples-16": "16 samples"},
        ),
        _compared(
            "figure-8", "Figure 8: shadow rays", "One, two and four shadow rays, 16 samples per pixel.", images,
            {"base": "1 shadow ray", "samples-16": "2 shadow rays", "shadow-4": "4 shadow rays"},
        ),
        _compared(
            "figure-9", "Figure 9: depth",
            "Deepest paths of about 14, 7 and 5; 16 samples, one shadow ray. Surviving paths are divided by their "
            "probability, so all have the same mean, but towards the right it is concentrated in ever rarer, brighter "
            "fireflies.",
            images,
            {name: f"deepest path {_deepest(results, name)}" for name in ("base", "depth-7", "depth-5")},
        ),
        _compared(
            "roulettes", "Additional: the roulette",
            "The report's roulette, of constant probability, and clrender's, which ends paths according to their "
            "throughput: same samples, same shadow rays.",
            images, {"base": "constant probability", "own-base": "by throughput"},
        ),
        Figure(
            "whitted",
            "Section 2.1.2: Whitted's ray tracing",
            "Path tracing and Whitted's ray tracing of the scene room: mirror and glass are traced, but lights are "
            "sampled at their centres, shadows are hard, and there is no light between diffuse surfaces.",
            [[Panel(_whole(images["path"]), "path tracing"), Panel(_whole(images["whitted"]), "Whitted")]],
        ),
    ]  # fmt: skip


def _compared(name: str, title: str, caption: str, images: _Images, words: Mapping[str, str]) -> Figure:
    """Images of several rows side by side, with a magnified detail of each below."""
    wholes = [Panel(_whole(images[row]), word) for row, word in words.items()]
    details = [Panel(_detail(images[row], _NOISE), f"{word}, detail") for row, word in words.items()]
    return Figure(name, title, caption, [wholes, details])


def _deepest(results: Results, name: str) -> int:
    """Deepest path of the first run, whose image is shown."""
    return results.rows[name].runs[0].deepest


def _whole(linear: npt.NDArray[Any], tone_map: str = "sqrt") -> _Pixels:
    """Display pixels; large images are downsampled by an integer factor, in linear radiance."""
    return to_display(shrunk(linear, _WHOLE), tone_map)


def _detail(linear: npt.NDArray[Any], where: tuple[float, float, float]) -> _Pixels:
    height, width = linear.shape[:2]
    left, top, side = int(where[0] * width), int(where[1] * height), max(int(where[2] * min(width, height)), 1)
    return to_display(linear[top : top + side, left : left + side], "sqrt")


def strip(figure: Figure) -> bytes:
    """All images of a figure as one JPEG file of at most 60 kB.

    Parameters
    ----------
    figure : Figure
        A figure with images.
    """
    from PIL import Image

    columns = max(len(row) for row in figure.rows)
    cell = _STRIP_PANEL + _GAP
    sheet = np.full((len(figure.rows) * cell - _GAP, columns * cell - _GAP, 3), 255, np.uint8)
    for i, row in enumerate(figure.rows):
        for j, panel in enumerate(row):
            enlarged = panel.pixels.shape[0] < _STRIP_PANEL
            how = Image.Resampling.NEAREST if enlarged else Image.Resampling.LANCZOS
            picture = Image.fromarray(panel.pixels)
            picture.thumbnail((_STRIP_PANEL, _STRIP_PANEL), how)
            scale = _STRIP_PANEL / max(picture.size)
            picture = picture.resize((round(picture.width * scale), round(picture.height * scale)), how)
            pixels = np.asarray(picture)
            sheet[i * cell : i * cell + pixels.shape[0], j * cell : j * cell + pixels.shape[1]] = pixels
    for quality in range(88, 0, -6):
        data = jpeg(sheet, quality)
        if len(data) <= _STRIP_BYTES:
            break
    return data
